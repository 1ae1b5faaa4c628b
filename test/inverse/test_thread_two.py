# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through two cut-outs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sweeps.cutouts import distance, random_pair, threaded_two

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
)

STIFF = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
CURVED = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2), tip_mass=0.01)


def hole(position):
    return CutOut(Pose.looking_along(position, (1, 0, 0)))


@pytest.mark.every(3)
@pytest.mark.parametrize('rod', [STIFF, CURVED], ids=['round', 'curved'])
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_both_centers_are_hit(rod, basis):
    first, second = hole((0.1, -0.2, 1.0)), hole((0.4, -0.15, 0.95))
    direct = DirectSimulator(rod, basis=basis)
    plan = InverseSimulator(direct).thread_two(first, second, depths=np.linspace(0, 0.9, 60))
    assert plan.fraction == 1 and plan.position_error.max() < 1e-8
    assert plan.stability.min() > 0
    replayed = direct.track(plan.grippers)
    apart = np.linalg.norm(second.center - first.center)
    for depth, shape in zip(plan.depths, replayed, strict=True):
        assert shape.converged and not shape.jumped
        assert distance(shape, first.center) < 1e-6
        assert np.linalg.norm(shape.at(1 - depth).position - first.center) < 1e-8
        if depth > 1.05 * apart:
            assert distance(shape, second.center) < 1e-6


def test_the_way_is_continuous_where_the_motion_changes():
    depths = np.linspace(0.2, 0.45, 251)  # 1 mm steps over the change
    plan = InverseSimulator(DirectSimulator(STIFF)).thread_two(
        hole((0, 0, 1)), hole((0.3, 0.05, 0.95)), depths=depths)
    way = np.array([pose.position for pose in plan.grippers])
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    turns = [Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude()
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    assert steps.max() < 1.5 * np.median(steps)
    assert max(turns) < 5e-3
    assert np.linalg.norm(plan.velocities[:-1, :3], axis=1).max() <= 0.1 * (1 + 1e-9)


def test_too_far_apart_is_refused():
    with pytest.raises(Infeasible, match='apart') as caught:
        InverseSimulator(DirectSimulator(STIFF)).thread_two(hole((0, 0, 0)), hole((1.2, 0, 0)))
    assert caught.value.constraint == 'reach'


def test_two_that_are_one_are_refused():
    with pytest.raises(InvalidTask, match='second'):
        InverseSimulator(DirectSimulator(STIFF)).thread_two(hole((1, 0, 0)), hole((1, 0, 0)))


def test_a_roll_is_made_along_the_way_whatever_the_step():
    rng = np.random.default_rng(0)
    pairs = [random_pair(rng) for _ in range(155)]
    for index in (132, 154):  # rolled alone, without the way, these would fall over
        assert threaded_two(*pairs[index], 'local').what == 'replayed'


@pytest.mark.every(2)
@pytest.mark.parametrize(('seed', 'index', 'basis', 'depths'), [
    (0, 4, 'local', 20),       # a finer mesh is left again once the DLO stands well
    (0, 4, 'chebyshev', 80),
    (7, 57, 'chebyshev', 20)])  # between two hardly stable shapes the first way falls over
def test_a_replay_is_on_the_meshes_of_the_plan_and_does_not_fall(seed, index, basis, depths):
    rng = np.random.default_rng(seed)
    pair = [random_pair(rng) for _ in range(index + 1)][-1]
    assert threaded_two(*pair, basis, depths).what == 'replayed'


@pytest.mark.every(2)
@pytest.mark.parametrize('elements', [64, 256])
def test_a_roll_that_has_to_go_around_a_fold_is_found_on_any_mesh(elements):
    # smoothed, the rolls of all eight routes come too late at a depth of 0.25 m
    spring = Rod(0.6455, 0.0203, (0.00308, 4.27), 0.00467)
    first = CutOut(Pose.looking_along((0, 0, 0), (0.196, 0.791, -0.58)))
    second = CutOut(Pose.looking_along((-0.014, 0.0641, -0.0534), (0.061, 0.735, -0.675)))
    plan = InverseSimulator(DirectSimulator(spring, basis='local', n_elements=elements)).thread_two(
        first, second)
    assert len(plan) == 40 and plan.position_error.max() < 1e-9 and plan.stability.min() > 0.4


@pytest.mark.every(2)
@pytest.mark.parametrize('seed', [6, 18, 22])
def test_a_plan_that_begins_deep_asks_nothing_of_the_free_end_before(seed):
    # both centers are on a shape in which a soft DLO hangs; no shape ends in the second one
    rng = np.random.default_rng(seed)
    bends = 10 ** rng.uniform(-2.6, -1.2)
    rod = Rod(1.0, 0.05, (bends, bends * rng.uniform(1, 1.5)), 0.7 * bends,
              natural_curvature=tuple(rng.uniform(-1, 1, 2)))
    simulator = DirectSimulator(rod)
    hangs = simulator.solve(Pose((0, 0, 1), Rotation.random(random_state=seed).as_quat()))
    assert hangs.converged
    depth = rng.uniform(0.3, 0.8)
    second = rng.uniform(1 - depth + 0.15, 0.95)
    holes = [CutOut(hangs.at(s)) for s in (1 - depth, second)]
    plan = InverseSimulator(simulator).thread_two(*holes, depths=[depth])
    shape = simulator.solve(plan.grippers[0])  # set down there
    assert shape.converged and np.linalg.norm(shape.at(1 - depth).position - holes[0].center) < 1e-6
    near = [np.linalg.norm(shape.at(s).position - holes[1].center)
            for s in np.linspace(1 - depth, 1, 2001)]
    assert min(near) < 5e-4  # half a step of these


SOFT = Rod(1.0, 0.1, 0.00981, 0.0078, radius=2e-3)  # w L^3/EI = 100
WAY = np.linspace(0, 0.8, 33)


def beside_each_other(first=0.012, second=0.02):
    """Return two holes of such radii, m, that no stable shape of the soft DLO hits both."""
    sizes = ({} if radius is None else {'radius': radius} for radius in (first, second))
    poses = (Pose.looking_along((0, 0, 1), (0.3, 0, -1)),
             Pose.looking_along((0.02, 0.01, 0.75), (0.1, 0, -1)))
    return [CutOut(pose, **size) for pose, size in zip(poses, sizes, strict=True)]


@pytest.fixture(scope='module')
def missing_both():
    return InverseSimulator(DirectSimulator(SOFT, n_elements=32)).thread_two(
        *beside_each_other(), depths=WAY)


def test_a_soft_dlo_that_hits_no_two_centers_passes_beside_them(missing_both):
    # on a finer mesh than the plan's, by samples: both holes are passed, where the plan says
    assert missing_both.position_error.max() > 0.01
    assert missing_both.position_errors[0][0] < 1e-9  # it aims at the second where that is near
    replayed = DirectSimulator(SOFT, n_elements=90).track(missing_both.grippers)
    for depth, rooms, shape in zip(WAY, missing_both.clearances, replayed, strict=True):
        assert shape.converged and not shape.jumped
        places = shape.positions_at(np.linspace(0, 1, 8001))
        for k, hole in enumerate(beside_each_other()):
            heights = (places - hole.center) @ hole.normal
            through = np.flatnonzero(np.diff(np.sign(heights)))
            assert len(through) == (k == 0 or depth > 0.262)  # the tip is at 0.75, the tilt small
            aside = np.linalg.norm(places - hole.center - heights[:, None] * hole.normal, axis=1)
            gap = np.hypot(heights, np.maximum(hole.radius - aside, 0))
            if len(through):
                assert aside[through].max() < hole.radius - SOFT.radius
                assert gap.min() - SOFT.radius == pytest.approx(min(rooms[k]), abs=4e-4)


def test_both_holes_lose_the_same_part_of_their_room(missing_both):
    both = [misses for misses in missing_both.position_errors if len(misses) == 2]
    assert len(both) == 22
    for one, other in both:
        assert one / (0.012 - 0.002) == pytest.approx(other / (0.02 - 0.002), rel=0.03)


def test_a_round_dlo_hangs_in_the_plane_of_both_centers(missing_both):
    # by symmetry: out of it, both would be missed by more
    sideways = np.array([-0.01, 0.02, 0]) / np.hypot(0.01, 0.02)
    for gripper in missing_both.grippers:
        assert abs(gripper.direction @ sideways) < 2e-3


def test_the_way_beside_two_centers_is_continuous(missing_both):
    fine = InverseSimulator(DirectSimulator(SOFT, n_elements=32)).thread_two(
        *beside_each_other(), depths=np.linspace(0, 0.8, 161))
    for plan, most in ((missing_both, 0.4), (fine, 0.08)):
        turns = [Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude()
                 for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
        assert max(turns) < most


def test_what_passes_both_centers_does_so_whatever_their_sizes():
    direct = InverseSimulator(DirectSimulator(STIFF))
    ways = [(1, 0, 0), (1, 0.1, 0)]
    exact, sized = (direct.thread_two(*(
        CutOut(Pose.looking_along(center, way), radius=radius)
        for center, way in zip(((0, 0, 1), (0.3, 0.05, 0.95)), ways, strict=True)), depths=WAY)
        for radius in (None, 0.05))
    assert exact.grippers == sized.grippers


@pytest.mark.parametrize(('radii', 'said'), [
    ((0.005, 0.006), 'beside the centers: .* room in both holes'),
    ((0.012, None), 'both centers, 0.25[0-9]* m apart'), ((0.001, 0.02), 'both centers')])
def test_two_holes_without_room_for_both_are_refused(radii, said):
    with pytest.raises(Infeasible, match=said) as refused:
        InverseSimulator(DirectSimulator(SOFT, n_elements=32)).thread_two(
            *beside_each_other(*radii), depths=WAY)
    assert refused.value.constraint == 'reach'
    assert ('beside' in str(refused.value)) == ('beside' in said)
    assert refused.value.certificate


def test_a_soft_wire_that_hangs_below_is_refused_for_the_depth_that_is_asked():
    """No hanging shape comes near: all pitches of the gripper, from both sides, tell it."""
    depth, first = 0.54, CutOut(Pose.looking_along((0, 0, 1), (0.954, 0.2, 0.222)))
    way = np.array([0.8, 0.1, 0.592])
    second = CutOut(Pose.looking_along(first.center + 0.205 * way / np.linalg.norm(way), way))
    direct = DirectSimulator(Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34), basis='local',
                             n_elements=48)
    chord, pitches, least = second.center - first.center, np.arange(-90, 271, 5), np.inf
    for order in (pitches, pitches[::-1]):
        for shape in direct.track([Pose((0, 0, 0), Rotation.from_euler(
                'y', -angle, degrees=True).as_quat()) for angle in order]):
            away = shape.positions_at(np.linspace(1 - depth, 1, 100))
            away -= away[0]
            least = min(least, np.hypot(away[:, 2] - chord[2], np.hypot(away[:, 0], away[:, 1])
                                        - np.hypot(chord[0], chord[1])).min())
    assert least > 0.05
    with pytest.raises(Infeasible, match=f'nor {depth:g} m deep in the first one') as refused:
        InverseSimulator(direct).thread_two(first, second, depths=[depth])
    assert refused.value.constraint == 'reach'
