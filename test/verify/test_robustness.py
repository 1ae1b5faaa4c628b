# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By how much a plan misses when things differ: first order against re-solving, and sampled."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from oblique_plans import HOLE as LEVEL
from oblique_plans import WIRE, oblique_plan
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Capsule,
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    PointLoad,
    Pose,
    Rod,
    Sheet,
    Uncertainty,
    robustness,
)

ROD = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2), tip_mass=0.01, radius=0.003,
          point_masses=((0.6, 0.01),))
DIRECT = DirectSimulator(ROD, n_elements=32)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0)), radius=0.02)
PLAN = InverseSimulator(DIRECT).thread(HOLE, depths=[0.0, 0.3, 0.55, 0.8])
SMALL = 1e-4


def across(shape, center, s):
    """Return the vector (3,) from a center to the DLO, across it, to first order about s."""
    length = shape.s[-1]
    axes, position = shape.frame_at(min(s, length))
    off = position - center
    return off - axes[:, 0] * (axes[:, 0] @ off)


def rods(cause):
    """Return pairs of Rods that differ by +-SMALL of the cause, written out."""
    up, down = 1 + SMALL, 1 - SMALL
    if cause == 'bending_stiffness':
        return [[replace(ROD, bending_stiffness=(0.3 * f, 0.6 * f)) for f in (up, down)]]
    if cause == 'torsional_stiffness':
        return [[replace(ROD, torsional_stiffness=0.25 * f) for f in (up, down)]]
    if cause == 'mass':
        return [[replace(ROD, mass_per_length=0.05 * f, tip_mass=0.01 * f,
                         point_masses=((0.6, 0.01 * f),)) for f in (up, down)]]
    if cause == 'length':
        return [[replace(ROD, length=1 + d) for d in (SMALL, -SMALL)]]
    return [[replace(ROD, natural_curvature=(0.4 + d * a, 0.2 + d * b)) for d in (SMALL, -SMALL)]
            for a, b in ((1, 0), (0, 1))]


@pytest.mark.parametrize('cause', ['bending_stiffness', 'torsional_stiffness', 'mass', 'length',
                                   'natural_curvature'])
def test_causes_in_the_dlo_against_solving_again(cause):
    got = robustness(DIRECT, PLAN, Uncertainty(**{cause: SMALL}))
    assert got.worst == cause
    for k, shape in enumerate(PLAN.shapes):
        squares = 0.0
        for both in rods(cause):
            ahead, back = (across(DirectSimulator(rod, n_elements=32).solve(
                shape.gripper), HOLE.center, 1 - PLAN.depths[k]) for rod in both)
            squares += np.sum((0.5 * (ahead - back)) ** 2)
        assert got.first_order[k] == pytest.approx(np.sqrt(squares), rel=1e-4)


def wavy(j, change):
    """Return a DirectSimulator with `change` (2,) times P_j more natural curvature."""
    polynomial = np.polynomial.legendre.Legendre.basis(j, [0, 1])
    return DirectSimulator(replace(ROD, natural_curvature=lambda s: (
        0.4 + change[0] * polynomial(s), 0.2 + change[1] * polynomial(s))), n_elements=32)


def test_a_curvature_that_varies_against_solving_again():
    got = robustness(DIRECT, PLAN, Uncertainty(curvature_variation=SMALL))
    shares = 1 / np.arange(1, 6) ** 2
    shares = shares / shares.sum()  # of the mean square; that of P_j is 1 / (2 j + 1)
    shape, squares = PLAN.shapes[1], 0.0
    for j, share in enumerate(shares, 1):
        for axis in SMALL * np.sqrt(share * (2 * j + 1)) * np.eye(2):
            ahead, back = (across(wavy(j, change).solve(shape.gripper), HOLE.center,
                                  1 - PLAN.depths[1]) for change in (axis, -axis))
            squares += np.sum((0.5 * (ahead - back)) ** 2)
    assert got.first_order[1] == pytest.approx(np.sqrt(squares), rel=1e-3)
    assert got.worst == 'curvature_variation'


def test_a_mass_that_grows_along_the_dlo_against_solving_again():
    got = robustness(DIRECT, PLAN, Uncertainty(mass_gradient=SMALL))
    length, mean = ROD.length, ROD.mass_per_length

    def grown(gradient):
        return DirectSimulator(replace(ROD, mass_per_length=lambda s: mean * (
            1 + gradient * (s / length - 0.5))), n_elements=32)

    shape = PLAN.shapes[1]
    ahead, back = (across(grown(sign * SMALL).solve(shape.gripper), HOLE.center,
                          1 - PLAN.depths[1]) for sign in (1, -1))
    assert got.first_order[1] == pytest.approx(np.linalg.norm(0.5 * (ahead - back)), rel=1e-3)
    assert got.worst == 'mass_gradient'


@pytest.mark.parametrize('cause', ['gripper_position', 'gripper_rotation'])
def test_causes_in_the_robot_against_solving_again(cause):
    got = robustness(DIRECT, PLAN, Uncertainty(**{cause: SMALL}))
    for k, shape in enumerate(PLAN.shapes):
        squares = 0.0
        for axis in np.eye(3):
            both = []
            for sign in (1, -1):
                step = sign * SMALL * axis
                gripper = Pose(shape.gripper.position + step, shape.gripper.quaternion)
                if cause == 'gripper_rotation':
                    turn = Rotation.from_rotvec(step).as_matrix()
                    gripper = Pose.from_rotation(shape.gripper.position,
                                                 turn @ shape.gripper.rotation)
                both.append(across(DIRECT.solve(gripper, shape), HOLE.center, 1 - PLAN.depths[k]))
            squares += np.sum((0.5 * (both[0] - both[1])) ** 2)
        assert got.first_order[k] == pytest.approx(np.sqrt(squares), rel=1e-4)


def test_of_two_centers_the_worse_one_counts():
    second = CutOut(Pose.looking_along((0.3, 0.06, 0.98), (1, 0.2, 0)), radius=0.05)
    plan = InverseSimulator(DIRECT).thread_two(HOLE, second, depths=[0.0, 0.2, 0.4, 0.5])
    assert max(len(passes) for passes in plan.via_points) == 2
    spread = Uncertainty(gripper_rotation=1e-3)
    both, first, last = (robustness(DIRECT, replace(plan, via_points=tuple(
        passes[part] for passes in plan.via_points)), spread).first_order
        for part in (slice(2), slice(1), slice(1, 2)))
    assert (np.abs(first - last) > 0.1 * first)[last > 0].any()
    np.testing.assert_allclose(both, np.maximum(first, last))


SPREAD = Uncertainty(0.02, 0.05, 0.02, 0.001, 0.01, 0.5e-3, 0.002)


def test_samples_scatter_as_the_first_order_says():
    got = robustness(DIRECT, PLAN, SPREAD, samples=300)
    np.testing.assert_allclose(got.first_order, np.sqrt((got.by_cause**2).sum(axis=1)))
    ratio = np.sqrt((got.sampled**2).mean(axis=0)) / got.first_order
    assert (np.abs(ratio - 1) < 0.15).all()  # 300 samples scatter by 4 % and more
    inside = (got.sampled < PLAN.clearances.min(axis=(1, 2))).all(axis=1)
    assert got.success == inside.mean() and 0.5 < got.success <= 1
    assert (np.mean(got.sampled <= got.quantile(0.9), axis=0) >= 0.9).all()


def test_a_sample_without_a_stable_shape_misses_and_goes_on_from_the_one_before(monkeypatch):
    track, calls = DirectSimulator.track, []

    def lost(self, grippers, initial):  # at the second waypoint
        shape = replace(track(self, grippers, initial=initial)[0], converged=len(calls) % 4 != 1)
        calls.append((initial, shape))
        return [shape]

    monkeypatch.setattr(DirectSimulator, 'track', lost)
    got = robustness(DIRECT, PLAN, SPREAD, samples=2)
    assert np.isinf(got.sampled).tolist() == [[False, True, False, False]] * 2
    assert got.success == 0.0
    for first in (0, 4):
        (_, one), (second, _), (third, three), (fourth, _) = calls[first:first + 4]
        assert second is one and third is one and fourth is three


def test_a_mesh_that_follows_the_accuracy():
    direct = DirectSimulator(ROD, accuracy=1e-5)
    got, other = (robustness(simulator, InverseSimulator(simulator).thread(
        HOLE, depths=[0.0, 0.3], max_misalignment=0), SPREAD, samples=4)
        for simulator in (direct, DIRECT))
    np.testing.assert_allclose(got.first_order, other.first_order, rtol=1e-2)
    np.testing.assert_allclose(got.sampled, other.sampled, rtol=2e-2)


def test_samples_do_not_depend_on_the_executor():
    few = robustness(DIRECT, PLAN, SPREAD, samples=40, seed=3)
    with ThreadPoolExecutor(2) as executor:
        other = robustness(DIRECT, PLAN, SPREAD, samples=40, seed=3, executor=executor)
    np.testing.assert_array_equal(few.sampled, other.sampled)
    assert not np.array_equal(few.sampled, robustness(DIRECT, PLAN, SPREAD, samples=40).sampled)


def test_a_held_contact():
    bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
    direct = DirectSimulator(ROD, basis='local', n_elements=32, obstacles=[bar])
    # inside an element: at a node the nearest point of a row of arcs has a kink
    plan = InverseSimulator(direct).hold_contact(Pose((0.5, 0, 0.72), (0, 0, 0, 1)), 0.51,
                                                 forces=[0.2])
    got = robustness(direct, plan, Uncertainty(mass=SMALL))
    shape, (place, s, _) = plan.shapes[0], plan.via_points[0][0]
    ahead, back = (across(DirectSimulator(both, basis='local', n_elements=32, obstacles=[bar])
                          .solve(shape.gripper, shape), place, s) for both in rods('mass')[0])
    assert got.first_order[0] == pytest.approx(0.5 * np.linalg.norm(ahead - back), rel=2e-3)


def test_a_plan_of_a_part_of_the_dlo_is_refused():
    inserted = InverseSimulator(DIRECT).insert(HOLE, depths=[0.2])
    with pytest.raises(InvalidTask, match='whole DLO'):
        robustness(DIRECT, inserted, SPREAD)


def test_neither_a_rim_nor_yield_hides_a_miss():
    # what holds the DLO in its place, or would let it be set, is not what is asked
    few = robustness(DIRECT, PLAN, SPREAD, samples=6)
    tight = CutOut(HOLE.pose, radius=0.0032)
    rim = DirectSimulator(ROD, n_elements=32, obstacles=[Sheet.around(tight)])
    assert few.sampled.max() > 1e-3
    soft = DirectSimulator(replace(ROD, yield_curvature=0.2, yield_torsion=0.1, hardening=0.1),
                           n_elements=32)
    for simulator in (rim, soft):
        other = robustness(simulator, PLAN, SPREAD, samples=6)
        np.testing.assert_allclose(other.sampled, few.sampled, atol=1e-9)
        np.testing.assert_allclose(other.first_order, few.first_order, atol=1e-9)


def test_a_mass_at_the_end_stays_on_a_shorter_dlo():
    rod = replace(ROD, point_masses=((1.0, 0.01),), tip_mass=0.0)
    direct = DirectSimulator(rod, n_elements=32)
    plan = InverseSimulator(direct).thread(HOLE, depths=[0.0, 0.3])
    got = robustness(direct, plan, Uncertainty(length=0.01), samples=8)
    assert np.isfinite(got.sampled).all() and (got.sampled[:, 0] > 0).any()


def test_a_node_at_the_end_stays_on_a_shorter_dlo():
    got = []
    for nodes in ((), (1.0,)):  # every mesh has a node there
        direct = DirectSimulator(replace(ROD, nodes=nodes), n_elements=32)
        plan = InverseSimulator(direct).thread(HOLE, depths=[0.0, 0.3])
        got.append(robustness(direct, plan, Uncertainty(length=0.01), samples=8))
    np.testing.assert_allclose(got[1].by_cause, got[0].by_cause, rtol=1e-6)
    np.testing.assert_allclose(got[1].sampled, got[0].sampled, atol=1e-9)


@pytest.mark.every(2)
@pytest.mark.parametrize('s', [1.0, 0.999])
def test_a_load_at_the_end_stays_on_a_shorter_dlo(s):
    got = []
    for place in (None, s):  # None is the tip, of whatever length
        direct = DirectSimulator(ROD, n_elements=32,
                                 point_loads=[PointLoad((0, 0, -0.02), s=place)])
        plan = InverseSimulator(direct).thread(HOLE, depths=[0.0, 0.3])
        got.append(robustness(direct, plan, Uncertainty(length=0.01), samples=8))
    if s == ROD.length:
        np.testing.assert_allclose(got[1].by_cause, got[0].by_cause, rtol=1e-6)
        np.testing.assert_allclose(got[1].sampled, got[0].sampled, atol=1e-9)
    np.testing.assert_allclose(got[1].sampled, got[0].sampled, atol=0.3 * 0.01)


def test_success_asks_for_every_waypoint():
    got = robustness(DIRECT, PLAN, SPREAD, samples=60)
    room = np.quantile(got.sampled, 0.5, axis=0)  # half the samples keep it, at each waypoint
    tight = replace(PLAN, clearances=np.tile(room[:, None, None], (1, 1, 3)))
    again = robustness(DIRECT, tight, SPREAD, samples=60)
    inside = again.sampled < room
    assert again.success == inside.all(axis=1).mean() < inside.any(axis=1).mean()
    for part in (0.1, 0.5, 0.9, 0.99):
        bound = got.quantile(part)
        assert ((got.sampled <= bound).mean(axis=0) >= part).all()
        assert ((got.sampled < bound).mean(axis=0) <= part).all()


def test_progress_and_deadline():
    seen, spread = [], Uncertainty(length=1e-4)
    robustness(DIRECT, PLAN, spread, samples=30, progress=lambda *step: seen.append(step))
    assert seen == [(1, 2), (2, 2)]
    for samples in (0, 30):
        with pytest.raises(DeadlineExceeded, match='deadline'):
            robustness(DIRECT, PLAN, spread, samples=samples, deadline=1e-9)


def gets_through(rod, plan):
    """Return whether a DLO of a Rod touches nothing, by points of shapes that are solved again.

    In a thin sheet about LEVEL: a disk about each point of its axis.
    """
    direct, shape = DirectSimulator(rod), None
    for planned in plan.shapes:
        shape = direct.track([planned.gripper], initial=planned if shape is None else shape)[0]
        if not shape.converged:
            return False
        s = np.linspace(0.0, rod.length, 801)
        points = shape.positions_at(s) - LEVEL.center
        height, beside = points @ LEVEL.normal, np.hypot(points[:, 1], points[:, 2])
        gap = np.where(beside < LEVEL.radius, np.hypot(LEVEL.radius - beside, height),
                       np.abs(height))
        if gap.min() < rod.radius or beside[np.argmin(np.abs(height))] > LEVEL.radius:
            return False
    return True


def test_an_oblique_dlo_that_is_said_to_get_through_touches_nothing():
    plan, off, count = oblique_plan(), 0.08, 60
    got = robustness(DirectSimulator(WIRE), plan, Uncertainty(bending_stiffness=off),
                     samples=count, seed=5)
    rim, least = plan.clearances[:, :, 0].min(axis=1), plan.clearances.min(axis=(1, 2))
    assert least.min() < 0.5 * rim.min()
    said = (got.sampled < least).all(axis=1)
    assert got.success == said.mean()
    drawn = np.exp(np.random.default_rng(5).normal(size=count) * off)
    true = np.array([gets_through(replace(WIRE, bending_stiffness=factor * 1.22e-4), plan)
                     for factor in drawn])
    assert not (said & ~true).any()          # what is said is so,
    assert 0.8 * true.mean() < said.mean() < 0.7
    by_the_rim = (got.sampled < rim).all(axis=1)
    assert by_the_rim.sum() >= true.sum() + 6  # and the rim alone would say too much
