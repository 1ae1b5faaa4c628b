# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of elements that keep each other off, against differences, SciPy and dense matrices."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from dlo_planner.direct.discretization import Discretization, even_mesh
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.energy.strands import (
    NO_RAYS,
    SOFT,
    near_pairs,
    nearest_points,
    put_friction,
    put_slips,
    smooth_strands,
    tangents,
)
from dlo_planner.geometry.self_distance import self_distance
from dlo_planner.minimize.hessian import assemble, factorize, new_hessian, solve
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import Surroundings

N, RADIUS = 12, 0.02
ROD = Rod(length=1.0, mass_per_length=0.1, bending_stiffness=0.02, torsional_stiffness=0.015,
          natural_curvature=(9.0, 0.0), natural_twist=2.0, radius=RADIUS)


@pytest.fixture(params=['local', 'chebyshev'])
def coil(request):
    """Return a coil of which two turns touch, and the unknowns of a shape near it."""
    around = Surroundings(ROD, np.zeros(3), self_contact=True)
    mesh = Discretization(around, even_mesh(1.0, N, np.zeros(0)), request.param, 6)
    # the last two: what goes straight on behind both ends
    pairs = np.array([[0, 8], [1, 9], [2, 10], [2, 9], [-1, 7], [4, N]])
    rays = np.array([[0.6, 0.1, 0.0], [-0.5, 0.5, 0.3]])
    system = mesh.full._replace(strands=smooth_strands(
        pairs, np.array([0.3, 0.0, 0.1, 0.2, 0.3, 0.2]), np.full(6, 0.25), mesh.radii, rays, 4.0))
    q = mesh.unknowns(mesh.natural + np.random.default_rng(3).normal(scale=0.2, size=(N, 3)))
    return system, q


def at(system, q):
    state = new_configuration(system)
    state.q[:] = q
    return evaluate(system, state)[0], state


def matrix_of(system, q):
    """Return the second derivatives of the potential by the unknowns, by differences."""
    columns, step = [], 1e-6
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = step
        up, down = (at(system, q + sign * change)[1].gradient for sign in (1, -1))
        columns.append((up - down).ravel() / (2 * step))
    return np.array(columns)


def test_gradient_against_differences(coil):
    system, q = coil
    _, state = at(system, q)
    assert np.abs(state.pull).max() > 0.05  # they bear
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = 1e-6
        slope = (at(system, q + change)[0] - at(system, q - change)[0]) / 2e-6
        assert state.gradient[index] == pytest.approx(slope, abs=1e-8)


def test_solutions_and_inertia_against_a_dense_matrix(coil):
    system, q = coil
    _, state = at(system, q)
    hessian, matrix = new_hessian(system), matrix_of(system, q)
    assemble(system, state, hessian)
    assert hessian.coupling.used[0] > 10
    values = np.linalg.eigvalsh(matrix)
    right, out = np.random.default_rng(1).normal(size=q.shape), np.empty(q.shape)
    for shift in (0.0, -0.5 * (values[2] + values[3]), -0.5 * (values[9] + values[10])):
        negative = factorize(system, hessian, shift)
        assert negative == (values + shift <= 0.0).sum()
        solve(system, hessian, right, out)
        left = (matrix + shift * np.eye(len(matrix))) @ out.ravel()
        np.testing.assert_allclose(left, right.ravel(), atol=2e-6 * np.abs(out).max())


@pytest.fixture
def rubbing(coil):
    """Return the coil with friction, which counts from the shape of the same unknowns."""
    system, q = coil
    _, state = at(system, q)
    rng, strands, radii = np.random.default_rng(5), system.effects.strands, np.full(N, RADIUS)
    for i, j in strands.pair[:3]:  # their surfaces touch
        s, t, _ = nearest_points(system.lengths, strands.rays, state.positions, i, j)
        radii[[i, j]] = 0.5 * tangents(state.positions, i, s, j, t, np.empty((3, 3)))
    strands = strands._replace(
        strand_radius=radii, rub_force=rng.normal(scale=0.1, size=(6, 2)), rub_limit=np.array(
            [0.05, 1.0, 0.02, 0.0, 1.0, 1.0]), rub_slip=rng.normal(scale=1e-3, size=(6, 2)),
        rub_places=state.positions.copy(), rub_frames=state.rotations.copy(), rub_spring=50.0)
    return system._replace(strands=strands), q


def test_friction_is_the_slope_of_its_potential_where_it_counts_from(rubbing, coil):
    system, q = rubbing
    _, state = at(system, q)
    bare = at(coil[0], q)[1].gradient
    assert np.abs(state.gradient - bare).max() > 1e-3
    for index in np.ndindex(q.shape):
        change = np.zeros_like(q)
        change[index] = 1e-6
        slope = (at(system, q + change)[0] - at(system, q - change)[0]) / 2e-6
        assert state.gradient[index] == pytest.approx(slope, abs=1e-8)


def test_second_derivatives_of_friction_are_those_of_what_slides_and_what_sticks(rubbing, coil):
    # but for its couples, which turn with the strands: there are none of springs without forces
    (system, q), pairs = rubbing, coil[0].effects.strands
    system = system._replace(strands=system.effects.strands._replace(
        pair_force=np.zeros(6), pair_reach=np.zeros(6), rub_force=np.zeros((6, 2)),
        rub_slip=np.zeros((6, 2)), rub_limit=np.array([1.0, 1.0, 1.0, 0.0, 1.0, 1.0])))
    bare = coil[0]._replace(strands=pairs._replace(pair_force=np.zeros(6), pair_reach=np.zeros(6)))
    _, state = at(system, q)
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    rows = hessian.coupling.rows[:hessian.coupling.used[0]].reshape(-1, q.size)
    assert len(rows) == 6  # two of each pair that no grip stands behind, and that may rub
    added = rows.T @ (hessian.coupling.weights[:len(rows), None] * rows)
    wanted = matrix_of(system, q) - matrix_of(bare, q)
    np.testing.assert_allclose(added, wanted, atol=1e-5 * np.abs(wanted).max())


def test_friction_of_what_slides_is_at_its_limit_and_of_what_sticks_below(rubbing):
    system, q = rubbing
    _, state = at(system, q)
    strands, friction = system.effects.strands, np.zeros((6, 2))
    put_friction(strands, system.lengths, state, friction)
    trial = strands.rub_force - 50.0 * strands.rub_slip
    size = np.linalg.norm(trial, axis=1)
    wanted = trial * np.minimum(1.0, strands.rub_limit / size)[:, None]
    np.testing.assert_allclose(friction[:4], wanted[:4], atol=1e-12)
    assert size[1] < 1.0  # one sticks
    assert size[0] > strands.rub_limit[0]  # one slides
    assert not friction[4:].any()  # what is behind a grip does not rub


def test_slip_is_none_of_a_rigid_motion_and_as_far_as_a_strand_goes_along(coil):
    system, q = coil
    _, state = at(system, q)
    turn = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix()
    slips, touched = np.ones((6, 2)), np.ones(6)
    put_slips(system.effects.strands, system.lengths, state, state.positions @ turn.T + 3.0,
              turn @ state.rotations, slips, touched)
    np.testing.assert_allclose(slips, 0.0, atol=1e-15)
    # both strands of a pair were elsewhere: the first by as much along itself
    way, before = 1e-3, state.positions.copy()
    along = (before[1] - before[0]) / np.linalg.norm(before[1] - before[0])
    before[:2] -= way * along
    put_slips(system.effects.strands, system.lengths, state, before, state.rotations.copy(), slips,
              touched)
    assert np.linalg.norm(slips[0]) == pytest.approx(way, rel=0.05)
    assert slips[0, 0] > 0.9 * way
    np.testing.assert_allclose(slips[3:], 0.0, atol=1e-15)


@pytest.mark.parametrize('way', np.eye(3))
def test_what_ends_square_on_a_strand_has_tangents_too(way):
    other = np.roll(way, 1)
    positions, axes = np.array([2 * way, way, -other, other]), np.empty((3, 3))
    assert tangents(positions, 0, 1.0, 2, 0.5, axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(axes[0], way, atol=1e-15)


def test_what_was_apart_has_not_rubbed_yet(rubbing):
    system, q = rubbing
    _, state = at(system, q)
    strands, slips, touched = system.effects.strands, np.ones((6, 2)), np.ones(6)

    def seen(away):
        before = state.positions.copy()
        s, t, _ = nearest_points(system.lengths, strands.rays, before, 0, 8)
        axes = np.empty((3, 3))
        tangents(before, 0, s, 8, t, axes)
        before[:2] += away * axes[0]
        put_slips(strands, system.lengths, state, before, state.rotations.copy(), slips, touched)
        return touched[0]

    reach = strands.pair_reach[0]
    assert seen(0.0) == pytest.approx(1.0, rel=1e-2)  # what presses; see SOFT
    assert 0.0 < seen(0.05 * reach) < 0.6
    assert seen(0.11 * reach) == 0.0
    assert not touched[4:].any()


def test_nearest_points_of_chords_against_scipy():
    rng = np.random.default_rng(0)
    for _ in range(40):
        points = rng.normal(size=(4, 3))
        lengths = np.array([np.linalg.norm(points[1] - points[0]), 1.0,
                            np.linalg.norm(points[3] - points[2])])
        s, t, distance = nearest_points(lengths, NO_RAYS, points, 0, 2)

        def square(x, points=points, lengths=lengths):
            w = (points[0] + x[0] * (points[1] - points[0]) - points[2]
                 - x[1] * (points[3] - points[2]))
            return w @ w + SOFT * (lengths[0] ** 2 * (x[0] - 0.5) ** 2
                                   + lengths[2] ** 2 * (x[1] - 0.5) ** 2)

        best = min((minimize(square, begin, bounds=[(0, 1)] * 2, tol=1e-14)
                    for begin in ([0.5, 0.5], [0.1, 0.9], [0.9, 0.1])), key=lambda one: one.fun)
        assert distance == pytest.approx(np.sqrt(best.fun), abs=1e-6)
        assert square((s, t)) == pytest.approx(distance ** 2, abs=1e-12)


def test_pairs_are_those_that_the_self_distance_is_of():
    mesh = Discretization(Surroundings(ROD, np.zeros(3), self_contact=True),
                          even_mesh(1.0, 60, np.zeros(0)), 'local', 0)
    system = mesh.system(np.eye(3))
    _, state = at(system, mesh.unknowns(mesh.natural))
    arrays = [np.array(one) for one in (system.lengths, state.strains, NO_RAYS, state.positions)]
    gap = self_distance(arrays[0], arrays[1], np.array(state.rotations), arrays[3], mesh.radii,
                        np.inf, np.inf)[1]
    found = np.empty((500, 2), dtype=np.int64)
    assert near_pairs(*arrays, mesh.radii, gap - 2e-3, found) == 0
    count = near_pairs(*arrays, mesh.radii, gap + 2e-3, found)
    assert 0 < count < 500
    assert (found[:count, 1] - found[:count, 0] > 20).all()  # none of one turn


def test_pairs_behind_an_end_are_those_of_what_has_gone_back():
    # a circle of which a quarter turn is left, and back across the line behind its beginning
    angles = np.concatenate([np.linspace(0, 1.5 * np.pi, 31), np.full(9, 1.5 * np.pi)])
    steps = np.column_stack([np.cos(angles), np.sin(angles), np.full(40, 0.02)])
    positions = np.vstack([np.zeros(3), np.cumsum(0.05 * steps, axis=0)])
    crosses = 3 + int(np.argmax((positions[4:-1, 1] > 0) != (positions[5:, 1] > 0))) + 1
    lengths, strains = np.full(40, 0.05), np.zeros((40, 3))
    strains[:30, 2] = np.diff(angles)[:30] / 0.05
    rays = np.array([[2.0, 0, 0], [0, 0, 0]])
    apart = nearest_points(lengths, rays, positions, -1, crosses)[2]
    assert apart == pytest.approx(0.02 * 0.05 * (crosses + 0.5), abs=5e-4)
    found, radii = np.empty((50, 2), dtype=np.int64), np.full(40, 0.3 * apart)
    assert near_pairs(lengths, strains, rays, positions, radii, 0.0, found) == 0
    count = near_pairs(lengths, strains, rays, positions, radii, 0.5 * apart, found)
    assert [-1, crosses] in found[:count].tolist()
    assert (found[:count, 1] > 20).all()  # none that leaves it
    assert near_pairs(lengths, strains, NO_RAYS, positions, radii, 0.5 * apart, found) < count
