# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading near the centers of more cut-outs."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, DirectSimulator, Infeasible, InverseSimulator, Pose, Rod
from dlo_planner.plan.path import GripperPath

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
STRIP = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2))
DIRECT = DirectSimulator(WIRE, n_elements=32)
INVERSE = InverseSimulator(DIRECT)


def hole(position, **size):
    return CutOut(Pose.looking_along(position, (1, 0, 0)), **size)


HOLES = [hole((0, 0, 1)), hole((0.2, 0.02, 0.99)), hole((0.4, 0.0, 0.93))]
DEPTHS = np.linspace(0, 0.9, 31)


@pytest.fixture(scope='module')
def plan():
    return INVERSE.thread_sequence(HOLES, depths=DEPTHS)


def squares(shape, depth, holes, weights):
    """Return the weighted squared distances, by sampling."""
    points = shape.positions_at(np.linspace(1 - depth, 1, 2001))
    first = np.linalg.norm(shape.at(1 - depth).position - holes[0].center)
    others = [np.linalg.norm(points - one.center, axis=1).min() for one in holes[1:]]
    return np.sum((np.array(weights) * [first, *others]) ** 2)


@pytest.mark.parametrize('weights', [(1, 1, 1), (1, 5, 0.5)])
def test_no_pose_nearby_is_better(weights, rng):
    found = INVERSE.thread_sequence(HOLES, weights=weights, depths=[0.3, 0.6])
    shape = found.shapes[1]
    least = squares(shape, 0.6, HOLES, weights)
    assert least == pytest.approx(np.sum((np.array(weights) * found.position_errors[1]) ** 2),
                                  rel=1e-3)
    assert least > 1e-5
    for step in rng.normal(size=(30, 6)) * 0.01:
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        gripper = Pose.from_rotation(shape.gripper.position + step[3:],
                                     turn @ shape.gripper.rotation)
        assert squares(DIRECT.solve(gripper, shape), 0.6, HOLES, weights) > least * (1 - 1e-4)


def test_two_are_hit_and_three_are_missed_by_what_is_said(plan):
    assert plan.fraction == 1 and plan.stability.min() > 0
    for depth, misses, miss in zip(DEPTHS, plan.position_errors, plan.position_error, strict=True):
        # the second one is reached at 0.202, the third one at 0.41; it counts from 0.16 on
        assert len(misses) == (1 if depth < 0.2 else 2 if depth < 0.41 else 3)
        assert miss == pytest.approx(max(misses), rel=1e-12)
        if depth < 0.16:
            assert max(misses) < 1e-6
    assert plan.position_error[-1] > 1e-3


def test_the_way_is_continuous():
    fine = INVERSE.thread_sequence(HOLES, depths=np.linspace(0.1, 0.6, 101))
    steps = np.linalg.norm(np.diff([pose.position for pose in fine.grippers], axis=0), axis=1)
    assert steps.max() < 4 * np.median(steps)
    apart = [Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude()
             for a, b in zip(fine.grippers, fine.grippers[1:], strict=False)]
    assert max(apart) < 0.05


@pytest.mark.parametrize('rod', [WIRE, STRIP], ids=['wire', 'strip'])
def test_what_the_dlo_can_reach_is_reached(rod):
    inverse = InverseSimulator(DirectSimulator(rod, n_elements=32))
    shape = inverse.thread(HOLES[0], depths=[0.6]).shapes[0]
    on_it = [hole(shape.at(s).position) for s in (0.4, 0.55, 0.75, 0.9)]
    found = inverse.thread_sequence(on_it, depths=[0.0, 0.6])
    assert max(found.position_errors[1]) < 1e-5


def test_one_and_two_are_exact():
    depths = [0.0, 0.3, 0.6]
    for holes, other in ((HOLES[:1], INVERSE.thread(HOLES[0], depths=depths)),
                         (HOLES[:2], INVERSE.thread_two(*HOLES[:2], depths=depths))):
        for one, two in zip(INVERSE.thread_sequence(holes, depths=depths).grippers,
                            other.grippers, strict=True):
            assert one == two


def test_a_dlo_that_is_bent_a_little_begins_nearest_to_its_centers_and_is_not_rolled_for_nothing():
    hanging = DIRECT.solve(Pose.looking_along((0, 0, 1), (1, 0, 0.3)))
    holes = [CutOut(Pose.looking_along(hanging.at(s).position, hanging.at(s).direction))
             for s in (0.55, 0.65, 0.75)]
    bent = DirectSimulator(replace(WIRE, natural_curvature=(-0.05, -0.02)), n_elements=32)
    plan = InverseSimulator(bent).thread_sequence(holes, depths=np.linspace(0, 0.45, 19))
    positions, rotations = GripperPath.of(plan).at(np.linspace(*plan.times[:2], 9))
    on_the_way = bent.track([Pose.from_rotation(*frame) for frame in zip(
        positions, rotations, strict=True)], initial=plan.shapes[0])
    missed = [np.linalg.norm(shape.positions_at(np.linspace(0.9, 1, 1001)) - holes[0].center,
                             axis=1).min() for shape in on_the_way]
    assert max(missed) < plan.position_error[:2].max() + 2e-4
    turns = [Rotation.from_matrix(one.rotation.T @ other.rotation).as_rotvec()[0]
             for one, other in itertools.pairwise(plan.grippers)]
    assert abs(sum(turns)) < 0.1


def test_what_coarse_waypoints_miss_is_what_fine_ones_miss():
    # a step is kept in a ball: what it keeps back at a waypoint comes nearer after it
    centers = (0, -0.061, -0.007), (0.2, -0.026, 0.08), (0.4, 0.007, -0.091), (0.6, -0.008, -0.2)
    holes = [CutOut(Pose.looking_along(center, (1, 0, -0.1 * k)))
             for k, center in enumerate(centers)]
    missed = []
    for part in (1, 6):
        plan = INVERSE.thread_sequence(holes, depths=np.linspace(0, 0.8, 39 * part + 1))
        late = plan.position_errors[::part][13:]  # which one is hit first is a matter of the way
        missed.append([np.linalg.norm(one) for one in late])
    np.testing.assert_allclose(*missed, rtol=0.05)


@pytest.mark.every(2)
@pytest.mark.parametrize('seed', [211, 219])
def test_it_is_as_near_as_a_search_from_other_rolls_comes(seed):
    rng = np.random.default_rng(seed)
    bends = 10 ** rng.uniform(-1.8, -0.3)
    rod = Rod(1.0, 0.05, (bends, bends * rng.uniform(1, 2)), 0.7 * bends,
              natural_curvature=tuple(rng.uniform(-1.5, 1.5, 2)), natural_twist=rng.uniform(-1, 1))
    simulator = DirectSimulator(rod, basis='local', n_elements=48)
    centers = np.array([[0, 0, 1], [0.2, *rng.uniform(-0.12, 0.12, 2) + [0, 1]],
                        [0.4, *rng.uniform(-0.25, 0.25, 2) + [0, 1]]])
    plan = InverseSimulator(simulator).thread_sequence(
        [CutOut(Pose.looking_along(center, (1, 0, 0))) for center in centers],
        depths=np.linspace(0, 0.7, 36))
    found = np.linalg.norm(plan.position_errors[-1])

    def misses(where, base):
        shape = simulator.solve(Pose.from_rotation(
            where[3:], Rotation.from_rotvec(where[:3]).as_matrix() @ base))
        if not (shape.converged and shape.stability > 0):
            return np.ones(9)
        places = shape.positions_at(np.linspace(0.3, 1.0, 1401))
        return np.concatenate([places[0] - centers[0], *(
            (places - center)[np.linalg.norm(places - center, axis=1).argmin()]
            for center in centers[1:])])

    last, best = plan.grippers[-1], []
    for roll in np.arange(4) * np.pi / 2:
        base = Rotation.from_rotvec(roll * last.direction).as_matrix() @ last.rotation
        begins = simulator.solve(Pose.from_rotation((0, 0, 0), base)).at(0.3).position
        best.append(np.linalg.norm(least_squares(
            misses, np.concatenate([np.zeros(3), centers[0] - begins]), args=(base,),
            max_nfev=30).fun))
    assert found < min(best) + 5e-4  # of which half is the distance of two places


def sized(*radii):
    """Return three holes of these radii, m, through which the wire has to bend."""
    return [CutOut(Pose.looking_along(center, (1, 0, -0.2)), radius=radius) for center, radius in
            zip(((0, 0, 1), (0.2, 0.02, 0.95), (0.4, -0.02, 0.9)), radii, strict=True)]


def least_room(weights, holes):
    """Return the least clearance (m) of a plan by explicit weights, -inf where it is refused."""
    try:
        return INVERSE.thread_sequence(holes, weights=weights, depths=DEPTHS[:26]).clearance.min()
    except Infeasible:
        return -np.inf


def test_a_hole_that_is_twice_as_wide_may_be_missed_twice_as_far():
    holes = sized(0.005, 0.03, 0.03)
    by_room = [1 / (hole.radius - WIRE.radius) for hole in holes]
    assert least_room(np.ones(3), holes) == -np.inf
    plan = INVERSE.thread_sequence(holes, depths=DEPTHS[:26])
    assert plan.clearance.min() == pytest.approx(least_room(by_room, holes), rel=1e-3)
    # where the wire passes the planes of the holes, by sampling
    for shape in plan.shapes:
        places = shape.positions_at(np.linspace(0, 1, 4001))
        for hole in holes:
            depth = (places - hole.center) @ hole.normal
            for k in np.flatnonzero(np.diff(np.sign(depth))):
                off = np.linalg.norm(places[k] - hole.center)
                assert off < hole.radius - WIRE.radius + 3e-4


def test_holes_that_are_alike_or_have_no_size_count_alike():
    for holes in (sized(0.03, 0.03, 0.03), [hole((0, 0, 1), radius=0.02), *HOLES[1:]]):
        one, other = (INVERSE.thread_sequence(holes, weights=weights, depths=DEPTHS[:20])
                      for weights in (None, np.ones(3)))
        assert one == other


def test_a_hole_whose_room_is_lost_counts_more_until_all_lose_alike():
    # neither weights alike nor by room leave room in all of them
    holes = sized(0.012, 0.021, 0.021)
    for weights in (np.ones(3), [1 / (hole.radius - WIRE.radius) for hole in holes]):
        assert least_room(weights, holes) == -np.inf
    assert INVERSE.thread_sequence(holes, depths=DEPTHS[:26]).clearance.min() > 0


def test_where_no_weights_were_found_none_do():
    holes = sized(0.0105, 0.018, 0.018)
    with pytest.raises(Infeasible) as refused:
        INVERSE.thread_sequence(holes, depths=DEPTHS[:26])
    assert refused.value.constraint == 'clearance'
    for second, third in itertools.product(np.geomspace(0.1, 10, 5), repeat=2):
        assert least_room((1, second, third), holes) == -np.inf
