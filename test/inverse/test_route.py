# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that is led through clips, forks and pegs."""

import sys
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.routes import board as random_board
from dlo_planner import (
    DirectSimulator,
    FarEnd,
    Infeasible,
    InvalidTask,
    InverseSimulator,
    Limits,
    Plan,
    Plane,
    Pose,
    Rod,
    Trajectory,
    Uncertainty,
    robustness,
)
from dlo_planner.direct.grips import Grips
from dlo_planner.inverse.tasks import route
from dlo_planner.inverse.tasks.move_to import led
from dlo_planner.inverse.tasks.route import _HARD, _NEARER, _Routing, hold_by
from dlo_planner.model.pose import displaced
from dlo_planner.plan.checks import Margin, PlanChecker
from dlo_planner.tasks import Clip, Fork, Peg, Route, task_from_yaml, task_to_yaml
from dlo_planner.uncertainty.state import UncertainState
from dlo_planner.verify.replay import replay
from dlo_planner.verify.route_robustness import RouteWork, entries_of, sampled

toward = Pose.looking_along
CABLE = Rod(0.8, 0.025, 4e-3, 2e-3, radius=0.003)
PLUG = FarEnd(toward((0, 0, 0.1), (-1, 0, 0)))
START = toward((0.78, 0, 0.2), (-1, 0, 0))
CLIP = Clip(toward((0.15, 0.0, 0.1), (-1, -0.1, 0)), push=0.1, room=0.8e-3)
FORK = Fork(toward((0.3, 0.03, 0.1), (-1, -0.2, 0)), push=0.08, room=0.8e-3, slip=0.2)


def simulator(n_elements=40):
    return DirectSimulator(CABLE, n_elements=n_elements, basis='local',
                           obstacles=[Plane((0, 0, 0), (0, 0, 1), name='board')])


def turned_by(angle):
    return Rotation.from_rotvec([0, 0, angle]).as_matrix()


def planned(task, start=START, n_elements=40):
    return InverseSimulator(simulator(n_elements)).plan(task, start=start)


@cache
def board():
    """Return the Plan through a clip and a fork."""
    return planned(Route([CLIP, FORK], far_end=PLUG))


def test_it_leads_through_a_clip_and_a_fork():
    plan = board()
    assert [stage.name for stage in plan.stages] == [
        f'{what} {name}' for name in ('clip 1', 'fork 2')
        for what in ('approach', 'enter', 'press')]
    assert [(event.kind, event.arm) for event in plan.events] == [('close', 'clip 1'),
                                                                   ('close', 'fork 2')]
    assert all(shape.converged and not shape.jumped for shape in plan.shapes)
    assert plan.clearance.min() > 0 and plan.fraction == 1
    last = {hold.by: hold for hold in plan.shapes[-1].holds}
    assert last['clip 1'].grip == 'aligned' and last['fork 2'].grip == 'ring'
    # about as far from the far end as the way is, by which it lies there
    assert last['clip 1'].s == pytest.approx(0.8 - 0.15, abs=5e-3)
    assert last['fork 2'].s == pytest.approx(last['clip 1'].s - np.hypot(0.15, 0.03), abs=5e-3)


def test_the_dlo_enters_in_the_middle_of_the_mouth():
    for fitting, stage in zip((CLIP, FORK), board().stages[1::3], strict=True):
        assert stage.name.startswith('enter')
        frame, seat = fitting.pose.rotation, fitting.pose.position
        for shape in stage.shapes:
            places = (shape.positions_at(np.linspace(0.2, 0.8, 2401)) - seat) @ frame
            beside = places[np.abs(places[:, 0]).argmin()]
            assert abs(beside[1]) < 0.05 * fitting.room
        assert beside[2] == pytest.approx(0, abs=2e-5)  # at last it is in the seat
        heights = np.array([place[2] for place in (
            (shape.positions_at(np.linspace(0.2, 0.8, 2401)) - seat) @ frame
            for shape in stage.shapes) for place in [place[np.abs(place[:, 0]).argmin()]]])
        assert heights[0] == pytest.approx(0.05, abs=1e-4) and (np.diff(heights) < 1e-6).all()


def test_fittings_are_pressed_into_until_they_snap():
    for name, fitting, stage in zip(('clip 1', 'fork 2'), (CLIP, FORK), board().stages[2::3],
                                    strict=True):
        pushes = [wrench[:3] @ fitting.pose.rotation[:, 2] for shape in stage.shapes
                  for hold, wrench in zip(shape.holds, shape.wrenches, strict=True)
                  if hold.by == name]
        assert max(pushes) >= fitting.push
        assert min(pushes) > -0.1 * fitting.push  # it does not lift off again


def test_spans_have_tensions():
    plan = board()
    tensions = plan.tensions
    assert tensions.shape == (len(plan), 4)
    assert np.isnan(tensions[0, 2:]).all() and np.isfinite(tensions[:, 0]).all()
    shape, k = plan.shapes[-1], len(plan) - 1
    at = [hold.s for hold in shape.holds if hold.s is not None]
    inner = (shape.s > at[0] + 1e-9) & (shape.s < at[1] - 1e-9)
    assert tensions[k, 1] >= shape.tension[inner].max() - 1e-9
    assert tensions[k, 1] == pytest.approx(shape.tension[inner].max(), abs=0.02)


def test_each_stage_is_replayed_on_finer_elements():
    plan, finer = board(), simulator(80).without_obstacles()
    for stage in plan.stage_plans[:3]:
        report = replay(finer, stage, initial=stage.shapes[0])
        assert report.converged and report.deviation < 1e-3


def test_what_holds_no_ring_is_timed_calmly_and_the_rest_within_limits():
    first, last = board().stage_plans[0], board().stage_plans[-1]
    limits = Limits(0.2, 1.0, 1.0, 5.0)
    assert Trajectory(last, limits, tolerance=np.inf).duration > 0
    with pytest.raises(InvalidTask, match='none that the DLO slides through'):
        Trajectory(last, limits, tolerance=0.01)
    assert not any(hold.is_ring for shape in first.shapes for hold in shape.holds)


def test_what_slides_is_known_at_rest_only():
    last, limits = board().stage_plans[-1], Limits(0.2, 1.0, 1.0, 5.0)
    report = replay(simulator(80).without_obstacles(), last, initial=last.shapes[0], limits=limits)
    assert report.converged and not report.safe
    assert report.reason == ('the DLO slides through fork 2: it is known at rest only, its motion '
                             'keeps the limits of the gripper alone')
    assert report.trajectory == Trajectory(last, limits, tolerance=np.inf)
    assert {'max_tracking_error', 'arrival', 'dynamic_clearance'} <= set(report.not_looked_at)


@pytest.mark.parametrize(('change', 'constraint', 'said'), [
    ({'fittings': [replace(CLIP, pose=toward((0.79, 0, 0.1), (-1, 0, 0)))]}, 'reach',
     'clip 1 cannot be reached: the way to it is 0.79 m, the DLO between the far end and the '
     'gripper 0.8 m'),
    ({'fittings': [replace(CLIP, push=50.0)]}, 'push',
     'clip 1 snaps at 50 N, the DLO presses'),
    ({'fittings': [CLIP], 'max_force': 0.05}, 'max_force', 'a grip would exert'),
    ({'fittings': [CLIP], 'clearance': 0.2}, 'clearance', 'nearer than clearance')])
def test_refusals_name_what_is_missing(change, constraint, said):
    with pytest.raises(Infeasible) as refused:
        planned(replace(Route([CLIP], far_end=PLUG), **change))
    assert refused.value.constraint == constraint
    assert said in str(refused.value)


def test_a_fitting_that_lets_go_is_named():
    plan = board()
    drawn = max(-(wrench[:3] @ CLIP.pose.rotation[:, 2]) for shape in plan.shapes
                for hold, wrench in zip(shape.holds, shape.wrenches, strict=True)
                if hold.by == 'clip 1')
    assert drawn > 1e-3
    with pytest.raises(Infeasible, match='is drawn out of clip 1 with') as refused:
        planned(Route([replace(CLIP, retains=0.3 * drawn), FORK], far_end=PLUG))
    assert refused.value.constraint == 'retains' and refused.value.plan.fraction < 1


def test_a_fitting_is_pressed_no_harder_than_it_bears(monkeypatch):
    def pushes(plan):
        return max(wrench[:3] @ CLIP.outwards for shape in plan.shapes
                   for hold, wrench in zip(shape.holds, shape.wrenches, strict=True)
                   if hold.by == 'clip 1')
    with pytest.raises(InvalidTask, match='Clip.bears = 0.05: expected no less than Clip.push'):
        replace(CLIP, bears=0.05)
    firmly = replace(CLIP, push=0.5)
    freely = pushes(planned(Route([firmly], far_end=PLUG)))
    careful = replace(firmly, bears=0.5 + 0.3 * (freely - 0.5))
    assert 0.5 <= pushes(planned(Route([careful], far_end=PLUG))) <= careful.bears < freely
    monkeypatch.setattr(_Routing, '_presses', lambda self, begin, fitting, *rest, press=(
        _Routing._presses): press(self, begin, replace(fitting, bears=None), *rest))
    with pytest.raises(Infeasible, match='is pressed into clip 1 with .* it bears') as refused:
        planned(Route([careful], far_end=PLUG))
    assert refused.value.constraint == 'bears' and refused.value.plan.fraction < 1


STEEP = toward((0.647, 0, 0.543), (-0.647, 0, -0.443))
SIZE = (6e-3, 0.016, 0.016)
# two in a line: what presses into the first would lie on the prongs of the second
IN_LINE = [Fork(toward((x, 0.0, 0.1), (-1, 0, 0)), push=0.06, room=0.8e-3, size=SIZE, slip=0.05)
           for x in (0.15, 0.32)]


@cache
def in_line():
    """Return the Plan through two forks that stand in a line."""
    return planned(Route(IN_LINE, far_end=PLUG, clearance=1e-3),
                   start=STEEP, n_elements=24)


def room_beside(shape, fitting):
    """Return the distance of a Shape's surface from the box of a fitting, m."""
    places = (shape.positions_at(np.linspace(0, 0.8, 3201)) - fitting.pose.position
              ) @ np.stack([fitting.pose.rotation[:, 0], fitting.aside, fitting.outwards], axis=1)
    beyond = np.maximum(np.abs(places) - 0.5 * np.array(SIZE), 0.0)
    return np.linalg.norm(beyond, axis=1).min() - CABLE.radius


def test_the_dlo_stays_out_of_the_fittings_ahead():
    plan = in_line()
    for stage in plan.stages:
        ahead = [fork for k, fork in enumerate(IN_LINE, start=1)
                 if not (stage.name.endswith(f'fork {k}') and not stage.name.startswith('approach'))
                 and not any(hold.by == f'fork {k}' for hold in stage.shapes[0].holds)]
        for fork in ahead:
            assert min(room_beside(shape, fork) for shape in stage.shapes) > 0.9e-3
    pressing = next(stage for stage in plan.stages if stage.name == 'press fork 1')
    pushes = [wrench[:3] @ IN_LINE[0].outwards for shape in pressing.shapes
              for hold, wrench in zip(shape.holds, shape.wrenches, strict=True)
              if hold.by == 'fork 1']
    assert max(pushes) >= 0.06


@pytest.mark.sweep
def test_a_little_bow_leads_over_what_stands_ahead():
    direct, task, start = random_board('clips', 16)
    plan = InverseSimulator(direct).plan(replace(task, fittings=task.fittings[:2]), start=start)
    assert plan.fraction == 1 and plan.clearance.min() > task.clearance


def turning(shape, back):
    """Return a routing of which nothing is checked but its ways, and a goal half a rad aside."""
    routing = object.__new__(_Routing)
    routing._context, routing._silent, routing._back = SimpleNamespace(rod=CABLE), None, back
    routing._bow, routing._pressed_by = 0.0, 0.0
    routing._simulator, routing._length = simulator(), CABLE.length
    routing._added, routing._check_fittings = lambda plan, name: plan, lambda _: None
    pivot, turn = shape.holds[0].pose.position, turned_by(0.5)
    return routing, Pose.from_rotation(pivot + turn @ (shape.gripper.position - pivot),
                                       turn @ shape.gripper.rotation)


def test_a_way_that_draws_the_dlo_taut_gives_way_to_one_nearer_to_what_holds_it(monkeypatch):
    shape = next(stage for stage in board().stages if stage.name == 'press clip 1').shapes[-1]
    pivot, asked = shape.holds[0].pose.position, []

    def pulls(_, grips, *__, **___):
        away = [np.linalg.norm(one.gripper.position - pivot) for one in grips]
        asked.append(away[len(away) // 2] / np.mean([away[0], away[-1]]))
        force = np.zeros((3, 1, 6))
        force[:, 0, 0] = 1.0, 1.0 + 1e3 * max(0.0, asked[-1] - 0.993), 1.0
        return SimpleNamespace(wrenches=force)
    monkeypatch.setattr(route, 'led', pulls)
    routing, goal = turning(shape, [])
    found = routing._way(shape, goal, 'approach')
    np.testing.assert_allclose(asked, 1 - np.array(_NEARER), atol=5e-4)
    assert found.wrenches[:, 0, 0].max() < _HARD
    nothing = SimpleNamespace(wrenches=np.zeros((3, 1, 6)))  # without weight, unbent
    monkeypatch.setattr(route, 'led', lambda *_, **__: nothing)
    assert routing._way(shape, goal, 'approach') is nothing


@pytest.mark.parametrize('hard', [False, True])
def test_it_goes_back_no_farther_than_it_has_to(monkeypatch, hard):
    """Until it is out of the way; or until a way does not pull the DLO taut."""
    shape = next(stage for stage in board().stages if stage.name == 'press clip 1').shapes[-1]
    counts = []
    back = [Pose(shape.gripper.position + (0, 0, 0.01 * k), shape.gripper.quaternion)
            for k in range(1, 9)]

    def needs_half(_, grips, *__, **___):
        counts.append(sum(one.gripper in back for one in grips))
        force = np.ones((3, 1, 6))
        if counts[-1] < 4:
            if not hard:
                raise Infeasible('in the way', 0, 'clearance', 1e-3, None)
            force[1] *= 30.0
        return SimpleNamespace(wrenches=force)
    monkeypatch.setattr(route, 'led', needs_half)
    routing, goal = turning(shape, back)
    found = routing._way(shape, goal, 'approach')
    assert found.wrenches.max() == 1.0
    assert list(dict.fromkeys(counts)) == [0, 2, 4]


@pytest.mark.parametrize(('pulls', 'nearest'), [(0.0, 0.97), (1e3, 0.5)])
def test_what_lifts_off_is_not_made_slacker_and_slacker(monkeypatch, pulls, nearest):
    tried = []

    def pull(_, shape, seat):
        tried.append(np.linalg.norm(shape.gripper.position - seat) / shape.holds[0].s)
        return pulls
    monkeypatch.setattr(_Routing, '_push', lambda *_: -1e4)
    with pytest.raises(Infeasible, match='^press clip 1: clip 1 snaps at') as refused:
        monkeypatch.setattr(_Routing, '_presses', lambda *asked, press=_Routing._presses: (
            monkeypatch.setattr(_Routing, '_pull', pull), press(*asked))[1])
        planned(Route([CLIP], far_end=PLUG))
    assert refused.value.constraint == 'push' and min(tried) > nearest


def tracked_to_press(monkeypatch):
    """Return a list of the steps, as they are asked for, by which a DLO is to be pressed in."""
    asked = []

    def track(self, grippers, *rest, known=DirectSimulator.track, **how):
        if sys._getframe(1).f_code.co_name == 'pressed':
            asked.append((how['initial'], grippers[0]))  # kept, so that no other has its id
        return known(self, grippers, *rest, **how)
    monkeypatch.setattr(DirectSimulator, 'track', track)
    return asked


def test_how_hard_the_gripper_pulls_is_found_in_few_trials(monkeypatch):
    asked = tracked_to_press(monkeypatch)
    plan = planned(Route([replace(CLIP, push=0.5), replace(FORK, push=0.5)], far_end=PLUG))
    shapes = sum(len(stage.shapes) // 2 for stage in plan.stages[2::3])
    assert len(asked) < 3.9 * shapes  # of which some cannot be


def test_what_is_known_of_a_way_is_not_tracked_again(monkeypatch):
    first, direct = board().stages[2].shapes[0], simulator()
    poses = [Pose(first.gripper.position + (0, 0, 1e-3 * k), first.gripper.quaternion)
             for k in range(4)]
    known, asked = [first], []
    for pose in poses[1:]:
        known += direct.track([pose], initial=known[-1], holds=[known[-1].holds])
    track = DirectSimulator.track
    monkeypatch.setattr(DirectSimulator, 'track', lambda *given, **how: (
        asked.append(1), track(*given, **how))[1])
    context, grips = SimpleNamespace(simulator=direct), [Grips(pose, first.holds) for pose in poses]
    for count, left in ((4, 0), (2, 2)):
        asked.clear()
        plan = led(context, grips, PlanChecker((0.1, 0.5)), known=known[:count])
        assert len(asked) == left and plan.shapes[:count] == tuple(known[:count])
        np.testing.assert_allclose(plan.shapes[-1].positions, known[-1].positions, atol=1e-8)


def test_ways_aside_that_begin_alike_are_gone_once(monkeypatch):
    asked, fork = tracked_to_press(monkeypatch), IN_LINE[0]

    def aside(_, one, other):  # nothing but a step aside can be
        ways = [shape.gripper.position - fork.pose.position for shape in (one, other)]
        return abs(np.cross(*ways) @ fork.outwards) > 1e-3
    monkeypatch.setattr(_Routing, '_leads_to', aside)
    monkeypatch.setattr(route, '_BOWS', (0.0,))
    with pytest.raises(Infeasible, match='fork 1 snaps at'):
        planned(Route(IN_LINE, far_end=PLUG), start=STEEP, n_elements=24)
    assert len({(id(one), pose.position.tobytes(), pose.quaternion.tobytes())
                for one, pose in asked}) == len(asked) > 30


def test_a_way_whose_corners_are_rounded_into_what_stands_ahead_has_closer_waypoints(monkeypatch):
    asked, tops = [], []

    def refuses(context, grips, demands, stops=(), known=(), ends=None, led=route.led):
        if stops:
            asked.append([one.gripper for one in grips])
            tops.append(asked[-1][stops[0]])
            assert len(known) == (3 if len(asked) > 1 else stops[0] + 1)
            if len(asked) < 3:
                # one waypoint more on the way to the third of the grips: the fifth is meant
                ends += [1, 2, *range(4, len(grips) + 2)]
                raise Infeasible('on the way there', 5, 'clearance', 1e-5, None)
        return led(context, grips, demands, stops, known=known, ends=ends)
    monkeypatch.setattr(route, 'led', refuses)
    plan = planned(Route([replace(CLIP, push=0.5)], far_end=PLUG))
    first, second, third = map(len, asked)
    assert (second, third) == (first + 3, first + 6) and tops == [tops[0]] * 3
    assert plan.stages[-1].name == 'press clip 1' and len(plan.stages[-1].shapes) == third


def test_where_a_closing_clip_brings_the_dlo_onto_the_next_one_it_is_not_pressed(monkeypatch):
    over = Margin('clearance', -1e-3, 'the DLO is {over:.3g} m nearer than it may be to clip 2')
    monkeypatch.setattr(PlanChecker, 'violation', lambda _, waypoint: (
        over if waypoint.shape.holds[0].by == 'clip 1' else None))
    with pytest.raises(Infeasible, match='^press clip 1: where clip 1 closes') as refused:
        planned(Route([CLIP], far_end=PLUG))
    assert refused.value.constraint == 'clearance' and refused.value.amount == 1e-3


@pytest.mark.sweep
def test_what_is_bowed_is_drawn_straighter_before_it_goes_aside():
    direct, task, start = random_board('clips', 3)
    plan = InverseSimulator(direct).plan(replace(task, fittings=[
        replace(one, grip='clamped', push=1.5 * one.push) for one in task.fittings[:4]]),
        start=start)
    assert plan.fraction == 1 and plan.clearance.min() > task.clearance


def test_without_a_push_nothing_is_pressed_for_ever_where_the_way_in_is_blocked(monkeypatch):
    levels = []

    def presses(self, begin, *asked, press=_Routing._presses):
        levels.append(begin.gripper.position[2] - 1e-5)
        return press(self, begin, *asked)
    monkeypatch.setattr(_Routing, '_presses', presses)
    monkeypatch.setattr(_Routing, '_leads_to',
                        lambda _, __, shape: shape.gripper.position[2] > levels[-1])
    with pytest.raises(Infeasible, match='snaps at 0 N'):
        planned(Route([replace(CLIP, push=0.0)], far_end=PLUG))


def test_what_is_bowed_rises_before_it_goes_aside_over_what_stands_ahead(monkeypatch):
    class Pressed(Exception):
        pass

    def added(self, plan, name, add=_Routing._added):
        if name == 'press fork 1':
            assert plan.clearance.min() > self._task.clearance
            raise Pressed
        return add(self, plan, name)
    monkeypatch.setattr(_Routing, '_added', added)
    direct, task, start = random_board('forks', 24)
    with pytest.raises(Pressed):
        InverseSimulator(direct).plan(replace(task, fittings=[
            replace(one, push=0.05) for one in task.fittings[:2]]), start=start)


def test_a_refusal_is_that_of_the_bow_that_came_farthest(monkeypatch):
    fractions, whole = iter([0.1, 0.5, 0.9, *[0.5] * 4]), board().stage_plans[0]

    def refuses(self, *_):
        raise Infeasible(f'bowed by {self._bow:g}', 0, 'clearance', 1e-3,
                         replace(whole, fraction=next(fractions)))
    monkeypatch.setattr(_Routing, '_entered', refuses)
    with pytest.raises(Infeasible, match='^bowed by 0.15'):
        planned(Route(IN_LINE, far_end=PLUG), start=STEEP)
    assert not list(fractions)


def test_where_it_comes_to_beside_a_mouth_it_is_led_to_the_middle_first(monkeypatch):
    found = _Routing._gripper_for

    def beside(*asked):
        return displaced(found(*asked), np.array([0, 0, 0, 0, 8e-3, 0]))
    monkeypatch.setattr(_Routing, '_gripper_for', beside)
    plan = planned(Route([CLIP], far_end=PLUG))
    entering = next(stage for stage in plan.stages if stage.name == 'enter clip 1')
    aside = [(shape.positions_at(np.linspace(0, 0.8, 3201)) - CLIP.pose.position)
             for shape in entering.shapes]
    missed = [abs(away[np.argmin(abs(away @ CLIP.pose.rotation[:, 0]))] @ CLIP.aside)
              for away in aside]
    assert missed[0] > CLIP.room and max(missed[1:]) < 0.1 * CLIP.room


def test_what_is_seen_above_a_mouth_is_taken_away_as_deep_as_the_seat():
    # a DLO bows over the prongs of what stands ahead, and is drawn straight as it goes in
    made, direct = in_line(), simulator().without_obstacles()
    stops = [stage.first + stop for stage, part in zip(made.stages, made.stage_plans, strict=True)
             if stage.name.startswith('enter') for stop in part.stops]
    entries = entries_of(made, IN_LINE)
    assert stops and [k for k, one in enumerate(entries) if one.below is not None] == stops
    uncertain = UncertainState(direct, Uncertainty(gripper_rotation=1e-3), 1)
    draws, worst = np.zeros((1, 4, 3)), {}
    draws[0, 0] = 4e-3  # of the gripper, about each axis
    inside = [k for k, one in enumerate(entries) if one.inside is not None]
    assert {entries[k].inside for k in inside} == {0, 1}
    for looks in (0, 2):
        (misses,), _ = sampled(RouteWork(uncertain, made.shapes, IN_LINE, entries, (), np.inf,
                                         draws, np.zeros((1, 2, looks, 2))))
        worst[looks] = misses[inside].max()
    assert worst[2] < 0.3 * worst[0]


@pytest.mark.sweep
def test_a_bad_camera_above_a_mouth_harms():
    made = in_line()
    inside = [k for k, one in enumerate(entries_of(made, IN_LINE)) if one.inside is not None]
    found = robustness(simulator().without_obstacles(), made, Uncertainty(bending_stiffness=0.1),
                       fittings=IN_LINE, samples=2, seen=0.01)
    assert found.success == 0.0 and found.sampled[:, inside].max() > 1e-3  # a bad camera harms


def test_it_stops_above_a_mouth_where_the_dlo_can_be_looked_at():
    tops = [0.5 * SIZE[2] + CABLE.radius + 1e-3] * 2
    entering = [stage for stage in in_line().stage_plans
                if stage.stages[0].name.startswith('enter')]
    assert len(entering) == 2
    for fork, top, stage in zip(IN_LINE, tops, entering, strict=True):
        places = [shape.positions_at(np.linspace(0.2, 0.8, 2401)) - fork.pose.position
                  for shape in stage.shapes]
        heights = [one[np.abs(one @ fork.pose.rotation[:, 0]).argmin()] @ fork.outwards
                   for one in places]
        at, = stage.stops
        assert heights[at] > 1.2 * top > top > heights[at + 1]
        assert heights[1] == pytest.approx(2.5 * top, abs=1e-4)  # at first it is at the standoff
    assert not any(stage.stops for stage in board().stage_plans  # what has no size has no top
                   if stage.stages[0].name.startswith('enter'))


def test_the_gripper_goes_back_until_it_pulls_as_little_as_before():
    plan = planned(Route([replace(CLIP, push=0.5)], far_end=PLUG))
    stage = plan.stage_plans[-1]
    pulls, (at,) = np.linalg.norm(stage.wrenches[:, 0, :3], axis=1), stage.stops
    assert pulls[at] == pulls.max() > 1.3 * pulls[-1] and pulls[-1] < 2 * pulls[0]
    # no farther: it has swung in, and stays there
    heights = [stage.grippers[k].position[2] for k in (0, at, -1)]
    assert heights[0] - heights[2] > 0.5 * (heights[0] - heights[1]) > 0


def test_stages_in_which_friction_is_at_its_limit_are_plans_of_their_own():
    plan = in_line()
    assert any(any(shape.state.feed.slides) for shape in plan.shapes if shape.state.feed)
    assert [len(stage) for stage in plan.stage_plans] == [len(one.shapes) for one in plan.stages]
    assert np.isnan(plan.margin).all()  # it passes no cut-out


def test_a_free_far_end_leaves_a_tail():
    high = replace(FORK, pose=toward((0.15, 0.0, 0.9), (-1, 0, 0)), push=0.0, slip=0.5)
    plan = planned(Route([high], tail=0.2), start=toward((0.7, 0, 1.0), (-1, 0, 0)))
    assert plan.shapes[-1].holds[0].s == pytest.approx(0.6, abs=1e-6)
    assert plan.shapes[-1].far_end is None


def test_a_peg_has_the_friction_of_a_capstan():
    # Euler, Eytelwein: T2 / T1 = e^(mu angle)
    peg = Peg(CLIP.pose, friction=0.3, angle=np.pi / 2, tension=2.0)
    assert peg.slip == pytest.approx(2.0 * (np.exp(0.3 * np.pi / 2) - 1))
    hold = hold_by(peg, 0.4, np.eye(3), 'peg 1')
    assert (hold.grip, hold.s, hold.slip, hold.by) == ('ring', 0.4, peg.slip, 'peg 1')


def test_a_clamp_takes_the_dlo_as_it_is_turned():
    turned = Pose((0.15, 0, 0.1), (np.sin(0.3), 0, 0, np.cos(0.3))).rotation
    clip = Clip(Pose((0.15, 0, 0.1), (0, 0, 0, 1)), grip='clamped')
    hold = hold_by(clip, 0.4, turned, 'clip 1')
    np.testing.assert_allclose(hold.pose.rotation, turned, atol=1e-12)


def test_it_is_read_from_yaml_and_stored(tmp_path):
    task = Route([CLIP, replace(FORK, size=SIZE), Peg(CLIP.pose, friction=0.1)], far_end=PLUG,
                 slack=0.02)
    again = task_from_yaml(task_to_yaml(task))
    assert again == task
    board().save(tmp_path / 'plan.npz')
    plan = Plan.load(tmp_path / 'plan.npz')
    assert plan.starts == board().starts and plan.shapes[-1].holds == board().shapes[-1].holds


@pytest.mark.parametrize(('make', 'said'), [
    (lambda: Clip(CLIP.pose, mouth=(1, 0, 0)), 'Clip.mouth'),
    (lambda: Clip(CLIP.pose, grip='ring'), 'Clip.grip'),
    (lambda: Fork(CLIP.pose, slip=-1.0), 'Fork.slip'),
    (lambda: Fork(CLIP.pose, room=0.0), 'Fork.room'),
    (lambda: Fork(CLIP.pose, size=(0.01, 0.0, 0.01)), 'Fork.size'),
    (lambda: Peg(CLIP.pose, friction=-0.1), 'Peg.friction'),
    (lambda: Route([]), 'fittings'),
    (lambda: Route([CLIP.pose]), 'fittings'),
    (lambda: Route([CLIP], slack=1.0), 'slack'),
    (lambda: planned(Route([CLIP], tail=0.79)), 'tail = 0.79')])
def test_what_makes_no_sense_is_named(make, said):
    with pytest.raises(InvalidTask, match=said):
        make()
