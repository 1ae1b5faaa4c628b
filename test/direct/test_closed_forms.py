# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables and closed forms; none of the numbers comes from this package."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod

HEAVY = [(1, 0.123471), (5, 0.495905), (20, 0.829881), (100, 0.937524)]
END_LOADED = [(1, 0.30172), (5, 0.71379), (10, 0.81061)]
TIP_A, TIP_B = (0.579107656, 0.244237020), (0.033067174, 0.013696251)


@pytest.mark.parametrize(('load', 'drop'), HEAVY)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_heavy_elastica(load, drop, basis):
    rod = Rod(1.0, load / 9.81, 1.0, 0.75)
    shape = DirectSimulator(rod, accuracy=1e-5, basis=basis).solve(Pose.identity())
    assert shape.converged
    assert -shape.positions[-1, 2] == pytest.approx(drop, abs=1e-5)
    assert shape.error_estimate < 1e-5


@pytest.mark.parametrize(('load', 'drop'), END_LOADED)
def test_end_loaded_cantilever(load, drop):
    rod = Rod(1.0, 0.0, 1.0, 0.75, tip_mass=load / 9.81)
    shape = DirectSimulator(rod, accuracy=1e-5).solve(Pose.identity())
    assert -shape.positions[-1, 2] == pytest.approx(drop, abs=1e-5)


def test_small_deflections_are_those_of_beam_theory():
    # w L^4 / 8 EI about each axis on its own, load at 45 degrees to the principal axes
    rod = Rod(1.0, 1e-4, (1.0, 3.0), 1.0)
    load = 1e-4 * 9.81
    gripper = Pose((0, 0, 0), (np.sin(np.pi / 8), 0, 0, np.cos(np.pi / 8)))  # rolled by 45 deg
    shape = DirectSimulator(rod, basis='local', n_elements=256).solve(gripper)
    along_b = load / np.sqrt(2) / (8 * 1.0)  # bending about n
    along_n = load / np.sqrt(2) / (8 * 3.0)
    moved = gripper.rotation.T @ shape.positions[-1]
    assert moved[2] == pytest.approx(-along_b, rel=1e-4)
    assert moved[1] == pytest.approx(-along_n, rel=1e-4)


def test_free_of_gravity_the_natural_shape_is_a_helix():
    kappa, tau = 3.0, 2.0
    rod = Rod(2.0, 0.1, 1.0, 1.0, natural_curvature=(0.0, kappa), natural_twist=tau)
    shape = DirectSimulator(rod, gravity=(0, 0, 0)).solve(Pose.identity())
    # its axis is the Darboux vector, radius and pitch follow
    speed = np.hypot(kappa, tau)
    axis = shape.frames[0] @ np.array([tau, 0, kappa]) / speed
    height = shape.positions @ axis
    np.testing.assert_allclose(height, shape.s * tau / speed, atol=1e-12)
    center = kappa / speed**2 * shape.frames[0, :, 1]
    radius = np.linalg.norm(shape.positions - height[:, None] * axis - center, axis=1)
    np.testing.assert_allclose(radius, kappa / speed**2, atol=1e-12)


@pytest.mark.parametrize(('masses', 'tip'), [(0.0, TIP_A), (1.0, TIP_B)])
def test_benchmarks_a_and_b_to_a_micrometer(masses, tip, level):
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, tip_mass=masses)
    shape = DirectSimulator(rod, accuracy=1e-6).solve(level)
    error = np.hypot(shape.positions[-1, 0] - tip[0], shape.positions[-1, 2] - tip[1])
    assert error < 1e-6
    assert error / 10 < shape.error_estimate < 1e-6
    assert shape.residual < 1e-8


@pytest.mark.parametrize('options', [
    {}, {'n_elements': 16}, {'basis': 'local'}, {'basis': 'local', 'n_elements': 200},
    {'n_terms': 4}, {'n_terms': 20}, {'basis': 'fourier'}, {'basis': 'fourier', 'n_terms': 30},
])
@pytest.mark.parametrize(('masses', 'tip'), [(0.0, TIP_A), (1.0, TIP_B)])
def test_error_estimate_is_not_optimistic(masses, tip, options, level):
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, tip_mass=masses)
    shape = DirectSimulator(rod, **options).solve(level)
    error = np.hypot(shape.positions[-1, 0] - tip[0], shape.positions[-1, 2] - tip[1])
    assert shape.converged
    assert shape.error_estimate > error / 10
    assert shape.error_estimate < 20 * error + 1e-9  # nor useless


def test_reaction_carries_weight_and_moment(curly, level):
    shape = DirectSimulator(curly, basis='local', n_elements=400).solve(level)
    weight = 9.81 * (0.2 * 1.3 + 0.1 + 0.2)
    np.testing.assert_allclose(shape.gripper_wrench[:3], (0, 0, weight), atol=1e-9)
    # the moment is the first element's, carried to the clamp
    u = shape.strains[0] - curly.natural_strains([0.0])[0]
    moment = shape.frames[0] @ (curly.stiffness * u)
    np.testing.assert_allclose(-shape.gripper_wrench[3:], moment, atol=3e-3)


@pytest.mark.parametrize('n_elements', [32, 64, 200])
@pytest.mark.parametrize('masses', [0.0, 1.0])
def test_error_estimate_without_a_series_is_the_error(masses, n_elements, level):
    # of second order: known to its size, at the node where it is largest
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, tip_mass=masses)
    shape = DirectSimulator(rod, basis='local', n_elements=n_elements).solve(level)
    exact = DirectSimulator(rod, basis='local', accuracy=1e-8).solve(level)
    errors = np.linalg.norm(shape.positions - exact.positions_at(shape.s), axis=1)
    assert shape.error_estimate == pytest.approx(errors.max(), rel=0.05)
    assert errors[-1] < 0.9 * errors.max() or masses  # it is not that of the tip
