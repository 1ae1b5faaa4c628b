# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Grasped inside, other loads, files, resampling, strain and stress."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Pose, Rod
from dlo_planner.rods import GraspedInside, Section

TILTED = Pose((0.1, 0.2, 1.0), Rotation.from_rotvec([0.1, 0.4, 0.3]).as_quat())
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


def test_both_parts_of_a_dlo_grasped_in_its_middle_hang_alike(wire):
    shape = GraspedInside(wire, 0.5, basis='local').solve(LEVEL)
    assert shape.converged
    assert shape.s[0] == 0 and shape.s[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(shape.positions, shape.positions[::-1] * [-1, 1, 1], atol=1e-12)
    half = DirectSimulator(Rod.circular(0.5, 1e-3, 8960.0, 110e9, 0.34), basis='local').solve(LEVEL)
    np.testing.assert_allclose(shape.positions[64:], half.positions, atol=1e-12)
    assert shape.gripper_wrench[2] == pytest.approx(wire.mass_per_length * 9.81)
    np.testing.assert_allclose(shape.gripper_wrench[3:], 0, atol=1e-12)


def test_grasped_inside_keeps_frames_strains_and_natural_shape(curly):
    direct = GraspedInside(curly, 0.5, basis='local', gravity=(0, 0, 0))
    shape = direct.solve(TILTED)
    # without gravity it is the natural shape, which one end's simulator knows as a whole
    whole = DirectSimulator(curly, basis='local', gravity=(0, 0, 0), n_elements=260)
    end = shape.at(0.0)
    other = whole.solve(end)
    for s in (0.2, 0.5, 0.65, 1.3):
        np.testing.assert_allclose(shape.at(s).position, other.at(s).position, atol=1e-9)
        np.testing.assert_allclose(shape.at(s).rotation, other.at(s).rotation, atol=1e-9)
    np.testing.assert_allclose(shape.element_strains, np.tile([2.0, 1.0, -0.5], (128, 1)),
                               atol=1e-9)
    hanging = GraspedInside(curly, 0.5).track([TILTED, LEVEL])
    assert all(one.converged for one in hanging)
    assert hanging[0].gripper_wrench[2] == pytest.approx(9.81 * (0.2 * 1.3 + 0.3))
    assert np.isfinite(hanging[0].error_estimate)


def test_distributed_load_is_a_weight(wire):
    heavier = Rod(1.0, 3 * wire.mass_per_length, wire.bending_stiffness, wire.torsional_stiffness)
    weight = -2 * 9.81 * wire.mass_per_length
    for load in ((0, 0, weight), lambda s: (0, 0, weight)):
        one = DirectSimulator(wire, load=load).solve(TILTED)
        np.testing.assert_allclose(one.positions, DirectSimulator(heavier).solve(TILTED).positions,
                                   atol=1e-10)
    with pytest.raises(InvalidTask, match=r'load\('):
        DirectSimulator(wire, load=lambda s: 3)


def test_mass_that_varies_along_the_dlo():
    # all the mass in the last hundredth is a tip mass
    end = Rod(1.0, lambda s: 10.0 if s > 0.99 else 0.0, 1.0, 0.7)
    tip = Rod(1.0, 0.0, 1.0, 0.7, tip_mass=0.1)
    one, other = (DirectSimulator(rod, basis='local', n_elements=400).solve(LEVEL)
                  for rod in (end, tip))
    assert one.gripper_wrench[2] == pytest.approx(0.981)
    np.testing.assert_allclose(one.positions, other.positions, atol=3e-3)


def test_surface_stress_of_a_cantilever():
    # sigma = M d / (2 I) at the root, M = F L
    wire = Rod.circular(0.3, 4e-3, 0.0, 200e9, 0.3, tip_mass=0.02, max_bend_curvature=0.5)
    shape = DirectSimulator(wire, basis='local').solve(LEVEL)
    moment = 0.02 * 9.81 * 0.3
    inertia = np.pi * (4e-3) ** 4 / 64
    stress = moment * 2e-3 / inertia
    assert shape.surface_stress[0, 0] == pytest.approx(stress, rel=1e-4)
    assert shape.surface_strain[0, 0] == pytest.approx(stress / 200e9, rel=1e-4)
    assert shape.bend_radius[0] == pytest.approx(200e9 * inertia / moment, rel=0.01)
    sharpest = moment / (200e9 * inertia)  # at the clamp, half an element before any middle
    assert 0.5 - shape.bend_margin == pytest.approx(sharpest, rel=1e-4)
    assert 1 / shape.bend_radius[0] < 0.999 * sharpest
    np.testing.assert_allclose(shape.surface_stress[:, 1], 0, atol=1e-3)


def test_surface_stress_is_largest_at_both_of_two_clamps():
    wire = Rod.circular(0.3, 4e-3, 8960.0, 200e9, 0.3)
    end = Pose((0.29, 0, 1), (0, 0, 0, 1))
    shape = DirectSimulator(wire, basis='local').solve(LEVEL, far_end=end)
    stress = shape.surface_stress[:, 0]
    assert shape.converged
    np.testing.assert_allclose(stress, stress[::-1], rtol=1e-4, atol=1e-4 * stress.max())
    at_middles = np.abs(shape.strains[:, 2]).max() * 2e-3 * 200e9
    assert stress[-1] > at_middles


def test_section_numbers_of_a_square():
    # Timoshenko and Goodier: J = 0.1406 a^4, largest shear = T / (0.208 a^3)
    square = Section.of('rectangular', 0.5, 0.5, 1.0, 0.0)
    assert square.torsional_stiffness == pytest.approx(0.5 * 0.1406, rel=1e-3)
    assert square.torsional_stiffness / 0.5 / square.shear_arm == pytest.approx(0.208, rel=2e-3)


def test_stress_needs_a_section(wire):
    bare = Rod(1.0, 0.1, 1.0, 1.0)
    with pytest.raises(InvalidTask, match='section'):
        _ = DirectSimulator(bare).solve(LEVEL).surface_stress
    assert np.isnan(DirectSimulator(bare).solve(LEVEL).bend_margin)  # nothing was looked at


def test_resampled_shapes_lie_on_the_same_arcs(curly):
    shape = DirectSimulator(curly).solve(TILTED)
    for n in (7, 64, 300):
        other = shape.resample(n)
        assert len(other.positions) == n + 1
        for k in (1, n // 2, n):
            np.testing.assert_allclose(other.positions[k], shape.at(other.s[k]).position)
        np.testing.assert_allclose(other.element_strains.mean(axis=0),
                                   shape.element_strains.mean(axis=0), atol=1e-12)


def test_the_papers_unknowns_find_the_same_shape(wire):
    reference = DirectSimulator(wire, n_terms=12)
    for pose in (LEVEL, TILTED):
        wanted = reference.solve(pose)
        found = DirectSimulator(wire, method='dfp', strains='paper', n_terms=8).solve(pose)
        assert found.converged and found.iterations < found.evaluations
        np.testing.assert_allclose(found.positions, wanted.positions, atol=2e-5)
    slow = DirectSimulator(wire, method='downhill_simplex', strains='paper', n_terms=3).solve(LEVEL)
    quick = DirectSimulator(wire, method='dfp', strains='paper', n_terms=3).solve(LEVEL)
    np.testing.assert_allclose(slow.positions, quick.positions, atol=1e-6)
    assert slow.evaluations > 20 * quick.evaluations


def test_surface_stress_of_a_twisted_tube():
    # tau = T r / J, and by torsion alone there is no axial stress
    tube = Rod.tube(0.5, 0.012, 0.008, 0.0, 200e9, 0.3, natural_curvature=(0.0, 0.0))
    end = Pose((0.5, 0, 0), Rotation.from_rotvec([0.2, 0, 0]).as_quat())
    shape = DirectSimulator(tube, basis='local', n_elements=8).solve(Pose.identity(), far_end=end)
    polar = np.pi / 2 * (0.006**4 - 0.004**4)
    moment = 200e9 / 2.6 * polar * 0.2 / 0.5
    assert abs(shape.far_wrench[3]) == pytest.approx(moment, rel=1e-4)
    np.testing.assert_allclose(shape.surface_stress[:, 1], moment * 0.006 / polar, rtol=1e-4)
    np.testing.assert_allclose(shape.surface_stress[:, 0], 0, atol=1e-6 * moment * 0.006 / polar)


def test_a_resampled_shape_is_as_exact_as_it_was(wire):
    shape = DirectSimulator(wire, n_elements=16).solve(TILTED)
    assert 1e-6 < shape.error_estimate == shape.resample(50).error_estimate
