# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By how much a DLO on its route misses the mouths of fittings, when things differ."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dlo_planner import (
    DirectSimulator,
    FarEnd,
    InvalidTask,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sphere,
    Uncertainty,
    robustness,
)
from dlo_planner.model.pose import displaced
from dlo_planner.tasks import Clip, Fork, Route
from dlo_planner.uncertainty.state import UncertainState
from dlo_planner.verify.route_robustness import RouteWork, _led, entries_of, sampled

toward = Pose.looking_along
CABLE = Rod(0.5, 0.025, 4e-3, 2e-3, radius=0.003)
DIRECT = DirectSimulator(CABLE, n_elements=24, basis='local',
                         obstacles=[Plane((0, 0, 0), (0, 0, 1), name='board')])
PLUG = FarEnd(toward((0, 0, 0.1), (-1, 0, 0)))
CLIP = Clip(toward((0.12, 0.0, 0.1), (-1, -0.1, 0)), room=0.8e-3)
FORK = Fork(toward((0.24, 0.03, 0.1), (-1, -0.2, 0)), room=0.8e-3, slip=0.05)
FITTINGS = CLIP, FORK
NO_LOOKS = np.zeros((1, 2, 0, 2))
CAUSES = ('bending_stiffness', 'torsional_stiffness', 'mass', 'mass_gradient', 'length',
          'natural_curvature', 'curvature_variation', 'gripper_rotation', 'gripper_position')


@cache
def plan():
    route = Route(FITTINGS, far_end=PLUG, standoff=0.03)
    return InverseSimulator(DIRECT).plan(route, start=toward((0.48, 0, 0.17), (-1, 0, 0)))


def entry(name):
    """Return the index of the waypoint at which a fitting is about to close."""
    return next(stage.first + len(stage) - 1 for stage in plan().stages
                if stage.name == f'enter {name}')


def aside(shape, fitting):
    """Return how far aside a Shape passes a fitting, m, by a close row of its places."""
    places = shape.positions_at(np.linspace(0.1, 0.45, 20001)) - fitting.pose.position
    place = places[np.abs(places @ fitting.pose.rotation[:, 0]).argmin()]
    return place @ fitting.aside


@pytest.mark.every(2)
@pytest.mark.parametrize('name, fitting', [('clip 1', CLIP), ('fork 2', FORK)])
def test_a_miss_of_a_mouth_to_first_order_is_that_of_other_solutions(name, fitting):
    spread = Uncertainty(bending_stiffness=0.02, gripper_rotation=1e-3, gripper_position=1e-5)
    at = entry(name)
    found = robustness(DIRECT, plan(), spread, fittings=FITTINGS)
    causes = dict(zip(found.causes, found.by_cause[at], strict=True))
    shape, free = plan().shapes[at], DIRECT.without_obstacles()
    squares = {'gripper_rotation': 0.0, 'gripper_position': (1e-5)**2}  # the fitting's own
    for grip in range(1 + len(shape.holds)):
        for axis in range(6):
            cause = 'gripper_rotation' if axis < 3 else 'gripper_position'
            twist = getattr(spread, cause) * np.eye(6)[axis]
            ends = []
            for sign in (-1, 1):
                holds = [replace(hold, pose=displaced(hold.pose, sign * twist)) if k == grip
                         else hold for k, hold in enumerate(shape.holds, 1)]
                gripper = shape.gripper if grip else displaced(shape.gripper, sign * twist)
                ends.append(aside(free.solve(gripper, shape, holds=holds), fitting))
            squares[cause] += ((ends[1] - ends[0]) / 2)**2
    for cause, square in squares.items():
        assert causes[cause] == pytest.approx(np.sqrt(square), rel=0.03)
    ends = [aside(free.with_rod(replace(CABLE, bending_stiffness=4e-3 * by)).solve(
        shape.gripper, shape, holds=shape.holds), fitting) for by in (0.98, 1.02)]
    assert causes['bending_stiffness'] == pytest.approx(abs(ends[1] - ends[0]) / 2, rel=0.05,
                                                        abs=1e-8)


def test_samples_scatter_in_mouths_as_the_first_order_says():
    spread = Uncertainty(gripper_rotation=2e-3)
    found = robustness(DIRECT, plan(), spread, fittings=FITTINGS, samples=8)
    for at in (entry('clip 1'), entry('fork 2')):
        spreads = np.sqrt((found.sampled[:, at]**2).mean()) / found.first_order[at]
        assert 0.6 < spreads < 1.4
    assert found.success == 1.0
    # the same draws, and only what is asked of them is another
    for one in (robustness(DIRECT, plan(), spread, samples=8, fittings=[
            CLIP, replace(FORK, room=1.2 * float(found.sampled[:, entry('fork 2')].min()))]),):
        np.testing.assert_array_equal(one.sampled, found.sampled)
        assert 0 < one.success < 1


def test_a_sample_that_touches_something_does_not_succeed():
    middle = plan().shapes[entry('clip 1')].positions_at([0.3])[0]
    beside = Sphere(middle + (0, 0.013001, 0), 0.01)  # 1 um away
    found = robustness(DirectSimulator(CABLE, n_elements=24, basis='local', obstacles=[beside]),
                       plan(), Uncertainty(gripper_position=2e-5), fittings=FITTINGS, samples=3)
    assert found.success < 1 and np.isfinite(found.sampled).all()


def test_a_hand_that_gives_way_balances_what_pulls_more():
    # at the waypoint where it presses most; the clip has closed 3 mm nearer to the gripper
    press, stiffness = plan().stages[2], 500.0
    pulls = [shape.gripper_wrench[:3] @ (shape.gripper.position - CLIP.pose.position)
             for shape in press.shapes]
    planned, free = press.shapes[int(np.argmax(pulls))], DIRECT.without_obstacles()
    fed, (clip, far_end) = planned.gripper_wrench[:3], planned.holds
    holds = replace(clip, s=clip.s - 3e-3), far_end
    way = planned.gripper.position - CLIP.pose.position
    slack = Pose(CLIP.pose.position + 0.98 * way, planned.gripper.quaternion)
    begin = free.solve(slack, holds=holds)
    assert begin.converged and not free.solve(planned.gripper, begin, holds=holds).converged
    shape, by = _led(free, planned.gripper, holds, begin, fed, stiffness, 0.0)
    along = planned.gripper.position - CLIP.pose.position
    along /= np.linalg.norm(along)
    np.testing.assert_allclose(shape.gripper.position, planned.gripper.position + by * along,
                               atol=1e-9)
    more = (shape.gripper_wrench[:3] - fed) @ along
    assert -4e-3 < by < -1e-3 and more > 0.5
    assert more == pytest.approx(-stiffness * by, abs=2e-5 * stiffness * CABLE.length)
    # from a guess beside it, from one out of reach, and one that is nearly right
    for guess in (-4e-3, 1e-3, by):
        assert _led(free, planned.gripper, holds, begin, fed, stiffness,
                    guess)[1] == pytest.approx(by, abs=2e-5 * CABLE.length)
    assert _led(free, planned.gripper, holds, begin, fed, np.inf, 0.0) == (None, 0.0)


def test_errors_that_a_stiff_hand_tears_at_a_compliant_one_takes():
    draws = np.zeros((1, 4, 1))
    draws[0, 0, 0] = -0.8e-3  # of the length
    rooms = {}
    for stiffness in (np.inf, 500.0):
        uncertain = UncertainState(DIRECT.without_obstacles(), Uncertainty(length=1e-3), 1)
        (misses,), (rooms[stiffness],) = sampled(RouteWork(
            uncertain, plan().shapes, FITTINGS, entries_of(plan(), FITTINGS), (), stiffness, draws,
            NO_LOOKS))
        assert np.isfinite(misses).all() == (stiffness == 500.0)
    assert rooms[500.0] == np.inf  # nothing is around


def test_a_fitting_that_stands_aside_is_missed_by_as_much():
    uncertain = UncertainState(DIRECT.without_obstacles(), Uncertainty(gripper_position=1e-3), 1)
    draws = np.zeros((2, 4, 3))  # of the gripper, the far end, the clip, the fork; along y: aside
    draws[0, 2, 1] = draws[1, 3, 1] = 3e-4
    misses, _ = sampled(RouteWork(uncertain, plan().shapes, FITTINGS, entries_of(plan(), FITTINGS),
                                  (), np.inf, draws,
                                  [*NO_LOOKS, *NO_LOOKS]))
    clip, fork = entry('clip 1'), entry('fork 2')
    np.testing.assert_allclose(misses[:, clip], [3e-4, 0], atol=1e-6)
    assert misses[1, fork] == pytest.approx(3e-4, rel=0.02)
    assert 1e-4 < misses[0, fork] < 1e-3  # what lies in the clip goes with it, and is as slack


@pytest.mark.parametrize('fittings, says', [
    ([CLIP], 'expected those that close in this plan, in their order: clip 1, fork 2'),
    ([FORK, CLIP], 'fittings are fork 1, clip 2: expected'),
    ([CLIP, 3], 'fittings')])
def test_fittings_are_those_of_the_route(fittings, says):
    with pytest.raises(InvalidTask, match=says):
        robustness(DIRECT, plan(), Uncertainty(length=1e-3), fittings=fittings)
    with pytest.raises(InvalidTask, match='the fittings of its Route'):
        robustness(DIRECT, plan(), Uncertainty(length=1e-3))


@pytest.mark.parametrize('given', [{'hand_stiffness': 500.0}, {'seen': 1e-4}])
def test_what_only_samples_of_a_route_know_is_refused_of_other_plans(given):
    stage = plan().stage_plans[0]
    assert robustness(DIRECT, stage, Uncertainty(length=1e-4)).first_order.size == len(stage)
    with pytest.raises(InvalidTask, match='expected None without the fittings'):
        robustness(DIRECT, stage, Uncertainty(length=1e-4), **given)
