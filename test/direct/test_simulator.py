# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of the direct simulator: what users may rely on."""

from dataclasses import replace

import numpy as np
import pytest
from properties import given, settings
from properties import strategies as st
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod, Sphere
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import State


@pytest.fixture
def wire():
    return Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)


@pytest.mark.parametrize(('options', 'named'), [
    ({'n_elements': 1}, 'n_elements = 1'),
    ({'accuracy': 1e-3, 'n_elements': 10}, 'accuracy'),
    ({'accuracy': 1e-3, 'method': 'dfp'}, "method = 'dfp'"),
    ({'strains': 'paper'}, 'strains'),
    ({'method': 'dfp', 'obstacles': [Plane((0, 0, 0), (0, 0, 1))]}, 'method')])
def test_options_that_exclude_each_other_are_named(wire, level, options, named):
    with pytest.raises(InvalidTask) as caught:
        DirectSimulator(wire, **options)
    assert named in str(caught.value)
    other = DirectSimulator(Rod(2.0, 0.1, 1.0, 1.0)).solve(level)
    with pytest.raises(InvalidTask, match='initial has length 2 m'):
        DirectSimulator(wire).solve(level, other)


def test_at_runs_along_the_arcs(curly, level):
    shape = DirectSimulator(curly, n_elements=16).solve(level)
    for k in (0, 5, 16):
        pose = shape.at(shape.s[k])
        np.testing.assert_allclose(pose.position, shape.positions[k], atol=1e-12)
        np.testing.assert_allclose(pose.rotation, shape.frames[k], atol=1e-12)
    step = 1e-6
    middle = 0.37 * 1.3
    ahead, behind = shape.at(middle + step).position, shape.at(middle - step).position
    np.testing.assert_allclose((ahead - behind) / (2 * step), shape.at(middle).direction,
                               atol=1e-8)
    with pytest.raises(InvalidTask, match=r's = 1\.4'):
        shape.at(1.4)


def test_strain_at_nodes_is_second_order(wire, level):
    fine = DirectSimulator(wire, basis='local', n_elements=1024).solve(level)
    errors = [np.abs(DirectSimulator(wire, basis='local', n_elements=n).solve(level).strains
                     - fine.strains[::1024 // n]).max() for n in (32, 64)]
    assert errors[0] / errors[1] > 3.0


def test_point_mass_between_nodes_acts_where_it_is(level):
    # a weightless cantilever bends as if it ended at the mass, small deflection P a^2 (3L - a) / 6
    rod = Rod(1.0, 0.0, 1.0, 1.0, point_masses=((0.333, 1e-4),))
    shape = DirectSimulator(rod, basis='local', n_elements=100).solve(level)
    drop = 1e-4 * 9.81 * 0.333**2 * (3 - 0.333) / 6
    assert 1 - shape.positions[-1, 2] == pytest.approx(drop, rel=1e-3)


@pytest.mark.parametrize('basis', ['chebyshev', 'local'])
def test_strains_at_nodes_of_an_uneven_mesh_are_interpolated(wire, level, basis):
    # strains that grow evenly along the elements' middles do so over the nodes, ends included
    s = np.array([0, 0.05, 0.2, 0.25, 0.6, 0.9, 1.0])
    around = DirectSimulator(wire).surroundings
    shape = DirectSimulator(wire, n_elements=6).solve(level)
    middle = 0.5 * (s[1:] + s[:-1])
    slope, start = np.array([0.7, -2.0, 3.0]), np.array([0.1, 0.2, -0.3])
    mesh = Discretization(around, s, basis, 3)
    uneven = replace(shape, s=s, element_strains=start + np.outer(middle, slope),
                     state=State(mesh))
    np.testing.assert_allclose(uneven.strains, start + np.outer(s, slope), atol=1e-12)


def test_with_set_carries_the_permanent_set_and_nothing_else(wire):
    # an elastic DLO has none: contacts and friction of the shape it comes from do not count
    direct = DirectSimulator(wire, basis='local', n_elements=24,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.5)])
    here = Pose((0, 0, 0.01), (0, 0, 0, 1))
    slid = direct.track([Pose((0.03, 0, 0.02), (0, 0, 0, 1)), here])[-1]
    assert slid.converged and slid.contacts
    wanted, found = direct.solve(here), direct.with_set(slid).solve(here)
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-9)
    drag = [sum(contact.friction for contact in shape.contacts) for shape in (found, wanted, slid)]
    weight = 9.81 * wire.mass_per_length
    np.testing.assert_allclose(drag[0], drag[1], atol=1e-6 * weight)
    assert np.linalg.norm(drag[2] - drag[1]) > 0.1 * weight


@pytest.mark.parametrize('limits', [{'yield_curvature': 0.3}, {'yield_torsion': 0.2},
                                    {'yield_curvature': 0.3, 'yield_torsion': 0.2}])
def test_elastic_means_that_nothing_yields(limits, level):
    rod = Rod(1.0, 0.1, (1.0, 2.0), 0.7, natural_curvature=(0.2, 0.5), **limits)
    direct = DirectSimulator(rod, n_elements=16).elastic()
    assert not direct.rod.yields
    free = DirectSimulator(replace(rod, yield_curvature=None, yield_torsion=None), n_elements=16)
    np.testing.assert_allclose(direct.solve(level).positions, free.solve(level).positions)


# ------------------------------------------------------------------------------------------------
# What must hold for any rod and pose, whatever the numbers.


unit = st.floats(-1, 1)
triples = st.tuples(unit, unit, unit)
rods = st.builds(
    lambda load, ratio, gj, bend, twist: Rod(1.0, load, (1.0, ratio), gj, natural_curvature=bend,
                                             natural_twist=twist),
    st.floats(0.01, 1.0), st.floats(1.0, 5.0), st.floats(0.4, 1.5), st.tuples(unit, unit), unit)
some = settings(max_examples=25)


@some
@given(rods, triples, triples)
def test_shape_does_not_depend_on_where_the_gripper_is(rod, pose, shift):
    quaternion = Rotation.from_rotvec(pose).as_quat()
    simulator = DirectSimulator(rod)
    here = simulator.solve(Pose((0, 0, 0), quaternion))
    there = simulator.solve(Pose(shift, quaternion))
    moved = here.moved(shift)
    np.testing.assert_allclose(there.positions, moved.positions, atol=1e-12)
    assert abs(there.energy - moved.energy) < 1e-9


@some
@given(rods, triples, triples)
def test_turning_gripper_and_gravity_together_turns_the_shape(rod, pose, turn):
    rotation = Rotation.from_rotvec(turn)
    start = Rotation.from_rotvec(pose)
    gravity = np.array([0, 0, -9.81])
    one = DirectSimulator(rod, gravity=gravity).solve(Pose((0, 0, 0), start.as_quat()))
    two = DirectSimulator(rod, gravity=rotation.apply(gravity)).solve(
        Pose((0, 0, 0), (rotation * start).as_quat()))
    np.testing.assert_allclose(two.positions, one.positions @ rotation.as_matrix().T, atol=1e-8)


@some
@given(rods, triples, st.floats(0.1, 10.0))
def test_scaling_length_scales_the_shape(rod, pose, factor):
    # EI / (w L^3) is all that matters
    larger = Rod(factor, rod.mass_per_length, tuple(factor**3 * k for k in rod.bending_stiffness),
                 factor**3 * rod.torsional_stiffness,
                 natural_curvature=tuple(k / factor for k in rod.natural_curvature),
                 natural_twist=rod.natural_twist / factor)
    gripper = Pose((0, 0, 0), Rotation.from_rotvec(pose).as_quat())
    one, two = (DirectSimulator(r).solve(gripper) for r in (rod, larger))
    np.testing.assert_allclose(two.positions, factor * one.positions, atol=1e-8 * factor)


@some
@given(rods, triples)
def test_mirrored_rod_hangs_mirrored(rod, pose):
    mirror = np.array([1.0, -1.0, 1.0])  # y -> -y; rotation vectors are axial
    other = Rod(1.0, rod.mass_per_length, rod.bending_stiffness, rod.torsional_stiffness,
                natural_curvature=(rod.natural_curvature[0], -rod.natural_curvature[1]),
                natural_twist=-rod.natural_twist)
    turn = Rotation.from_rotvec(pose)
    mirrored = Rotation.from_rotvec(-mirror * np.array(pose))
    one = DirectSimulator(rod).solve(Pose((0, 0, 0), turn.as_quat()))
    two = DirectSimulator(other).solve(Pose((0, 0, 0), mirrored.as_quat()))
    np.testing.assert_allclose(two.positions, one.positions * mirror, atol=1e-8)


@some
@given(triples, st.floats(-3, 3))
def test_rolling_a_round_straight_rod_changes_nothing(pose, roll):
    rod = Rod(1.0, 0.3, 1.0, 0.75)
    simulator = DirectSimulator(rod)
    turn = Rotation.from_rotvec(pose)
    one = simulator.solve(Pose((0, 0, 0), turn.as_quat()))
    two = simulator.solve(Pose((0, 0, 0), (turn * Rotation.from_rotvec([roll, 0, 0])).as_quat()))
    np.testing.assert_allclose(two.positions, one.positions, atol=1e-9)


@some
@given(rods, triples)
def test_shape_has_less_energy_than_the_straight_one_and_its_length(rod, pose):
    gripper = Pose((0, 0, 0), Rotation.from_rotvec(pose).as_quat())
    shape = DirectSimulator(rod).solve(gripper)
    unbent = DirectSimulator(rod, gravity=(0, 0, 0)).solve(gripper)
    masses = np.full(65, rod.mass_per_length / 64)
    masses[[0, -1]] /= 2
    natural_energy = 9.81 * masses @ unbent.positions[:, 2]
    assert shape.converged
    assert shape.energy <= natural_energy + 1e-12
    chords = np.linalg.norm(np.diff(shape.positions, axis=0), axis=1)
    assert (chords <= np.diff(shape.s) + 1e-15).all()
    frames = np.einsum('kji,kjl->kil', shape.frames, shape.frames)
    np.testing.assert_allclose(frames, np.broadcast_to(np.eye(3), frames.shape), atol=1e-12)


# ------------------------------------------------------------------------------------------------
# How a shape answers to its gripper, against differences of solved shapes.


ROD = {'length': 1.0, 'mass_per_length': 0.05, 'bending_stiffness': (0.3, 0.8),
       'torsional_stiffness': 0.4, 'tip_mass': 0.03, 'radius': 0.005}
GRIPPER = Pose((0, 0, 1), Rotation.from_rotvec([0.1, 0.3, 0.2]).as_quat())
END = Pose((0.6, 0.3, 0.8), Rotation.from_rotvec([0.3, 0.3, 0.9]).as_quat())
CASES = {
    'free': ({'natural_curvature': (1.0, -0.5), 'natural_twist': 2.0}, {}, None, 1e-8),
    'touching': ({'natural_curvature': (1.0, -0.5), 'natural_twist': 2.0}, {'obstacles': [
        Plane((0, 0, 0.8), (0.1, 0, 1)), Sphere((0.3, 0.0, 0.85), 0.06)]}, None, 1e-4),
    'held': ({}, {}, END, 1e-5),
    'yielding': ({'yield_curvature': 0.31, 'hardening': 0.1}, {}, None, 1e-8),
    'fibers': ({'yield_curvature': 0.15, 'yield_torsion': 0.05, 'section_model': 'round',
                'hardening': 0.1}, {}, None, 1e-5)}


def differences(solve, s, step=1e-5):
    """Return (6, 6): change of the frame at `s` by twists of the gripper, of what `solve` finds."""
    slopes = np.zeros((6, 6))
    for k, twist in enumerate(step * np.eye(6)):
        up, down = (solve(Pose.from_rotation(
            GRIPPER.position + sign * twist[3:],
            Rotation.from_rotvec(sign * twist[:3]).as_matrix() @ GRIPPER.rotation)).at(s)
            for sign in (1, -1))
        slopes[:3, k] = Rotation.from_matrix(up.rotation @ down.rotation.T).as_rotvec()
        slopes[3:, k] = up.position - down.position
    return slopes / (2 * step)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('case', CASES)
def test_against_differences(case, basis):
    more, options, end, tolerance = CASES[case]
    simulator = DirectSimulator(Rod(**ROD, **more), basis=basis, **options)
    before = simulator.solve(Pose((0, 0, 1), (0, 0, 0, 1)), far_end=end)
    shape = simulator.solve(GRIPPER, before, far_end=end)
    answer = Sensitivity(shape)
    for s in (0.3, 1.0):
        slopes = differences(lambda pose: simulator.solve(pose, before, far_end=end), s)
        np.testing.assert_allclose(answer.at(s), slopes, atol=tolerance)


def test_a_shape_from_a_file_is_refused(tmp_path, wire, level):
    shape = DirectSimulator(wire).solve(level)
    shape.save(tmp_path / 'a.npz')
    with pytest.raises(InvalidTask, match='shape'):
        Sensitivity(type(shape).load(tmp_path / 'a.npz'))


def test_what_yields_in_the_step_goes_on_yielding():
    # moved a little farther on its way it yields a little more, and no longer springs back alone
    rod = Rod(**ROD, yield_curvature=0.3, hardening=0.1)
    simulator = DirectSimulator(rod, basis='local')
    shape = simulator.solve(GRIPPER)
    assert shape.dissipated > 0
    answer = Sensitivity(shape)
    elastic = Sensitivity(DirectSimulator(rod, basis='local').solve(GRIPPER, shape))
    np.testing.assert_allclose(answer.at(1.0), differences(simulator.solve, 1.0), atol=1e-7)
    assert np.abs(elastic.at(1.0) - answer.at(1.0)).max() > 0.01  # as it would be, let go
