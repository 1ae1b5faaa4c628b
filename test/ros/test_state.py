# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of the node, and what is kept of it when its scene changes; without a node."""

import threading
from dataclasses import fields, replace
from types import MappingProxyType

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from scipy.spatial.transform import Rotation

from dlo_planner import FarEnd, Hold, Infeasible, InvalidTask, Pose, Sphere, replay
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import Feedback
from dlo_planner.execute.guards import Enabled, Guards
from dlo_planner.execute.pull import Pull
from dlo_planner.identify.estimator import EstimatorConfig
from dlo_planner.plan.plan import PlanStatus, truncate
from dlo_planner.plan.requirements import Limits
from dlo_planner.ros.plan import explained, make_plan, through
from dlo_planner.ros.proof import proofs
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import PlanResult, Proof, State, Store, carried, ready
from dlo_planner.ros.streaming import unwatched
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.obstacles import Body

VALUES = {**{name: entry.default for name, entry in PARAMETERS.items()}, 'rod.diameter': 1.5e-3,
          'threading.waypoints': 8, 'threading.deepest': 0.3, 'rod.damping': [0.5, 0.0]}
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
HERE = Pose.looking_along((0.0, 0.1, 1.0), (1.0, 0.2, 0.0))
BALL = {('cell', 3): Body(Sphere((0, 5, 5), 0.1))}


def values(**changed):
    return {**VALUES, **{name.replace('__', '.'): value for name, value in changed.items()}}


def scene(bodies=MappingProxyType({}), **changed):
    return Scene.of(values(**changed), bodies)


@pytest.fixture(scope='module')
def proved():
    """Return a State whose plan is proved, with a gripper at its beginning at time 10."""
    state = State(scene())
    task = through(state.scene, [GOAL])
    plan, before = make_plan(state.scene, task, None, None)
    made = PlanResult(state.scene, plan, before, None, task, None)
    proof = list(proofs(replay, state.scene,
                        plan, before))[-1]
    assert proof.safe and proof.cause == Cause.DONE
    return state.with_plan(made).with_proof(proof).with_feedback(Feedback(plan.grippers[0], 10.0))


def hanging(state):
    shape = state.scene.direct.solve(HERE)
    return replace(state, shape=shape).with_feedback(Feedback(HERE, 0.0))


def changed(state, bodies=None, **parts):
    """Return the State after other parameters or obstacles."""
    if bodies is not None:
        return state.in_scene(scene(bodies, **parts), Cause.OBSTACLES_CHANGED, 'a ball')
    return state.in_scene(scene(**parts), Cause.PARAMETERS_CHANGED, 'a limit')


def test_a_parameter_that_does_not_change_the_dlo_touches_nothing_of_it():
    before = hanging(State(scene(rod__yield_stress=40e6)))
    after = changed(before, rod__yield_stress=40e6, threading__linear_speed=0.05)
    assert after.shape is before.shape and after.pose == HERE
    assert after.scene.limits.linear_speed == 0.05
    assert changed(before, bodies=BALL, rod__yield_stress=40e6).shape is before.shape
    # and the next shape goes on from it, with its set
    down = Pose.looking_along(HERE.position, (0, 0, -1))
    tips = [state.scene.direct.track([down], initial=state.shape)[0].positions[-1]
            for state in (before, after)]
    np.testing.assert_array_equal(*tips)
    natural = after.scene.direct.solve(down).positions[-1]
    assert np.linalg.norm(tips[0] - natural) > 0.01


@pytest.mark.parametrize(('parts', 'kept'), [
    ({'rod__tip_mass': 0.01}, 'shape'), ({'rod__length': 1.2}, 'nothing'),
    ({'simulator__n_elements': 32}, 'all'), ({'gravity': [0.0, 0.0, -5.0]}, 'all'),
    # (with hardening: else what its weight bends at the gripper is a plastic hinge)
    ({'rod__yield_stress': 40e6, 'rod__hardening': 0.1}, 'nothing')])
def test_what_can_be_kept_of_another_dlo_is_kept(parts, kept):
    before = hanging(State(scene()))
    after = changed(before, **parts)
    assert after.pose == HERE
    assert (after.shape is None) == (kept == 'nothing')
    assert (after.shape is before.shape) == (kept == 'all')
    shape = after.scene.direct.track([HERE], initial=after.shape)[0]
    assert shape.converged
    np.testing.assert_allclose(shape.positions[-1],
                               after.scene.direct.solve(HERE).positions[-1], atol=1e-6)


def test_the_set_of_one_dlo_is_not_that_of_another():
    yielding = scene(rod__yield_stress=40e6)
    shape = yielding.direct.solve(HERE)
    assert carried(shape, yielding, yielding) is shape
    kept = carried(shape, yielding, scene())
    assert kept is not None
    down = Pose.looking_along(HERE.position, (0, 0, -1))
    np.testing.assert_allclose(scene().direct.track([down], initial=kept)[0].positions[-1],
                               down.position - (0, 0, 1.0), atol=1e-6)


def test_a_shape_found_for_a_scene_that_is_gone_is_carried_over_or_forgotten():
    before = State(scene())
    shape = before.scene.direct.solve(HERE)
    assert before.with_shape(shape, before).shape is shape
    assert before.reset().with_shape(shape, before).shape is None
    assert changed(before, rod__length=1.2).with_shape(shape, before).shape is None
    assert changed(before, bodies=BALL).with_shape(shape, before).shape is shape


def test_a_proved_plan_is_executed_and_only_once(proved):
    state = proved.started(10.05)
    assert state.executing and state.running is proved.planned
    with pytest.raises(Refused) as refused:
        state.started(10.05)
    assert refused.value.cause == Cause.EXECUTING
    assert state.after_tick(10.06).execution.command is not None
    assert state.scene.guards == state.execution.guards


def test_an_execution_begins_where_the_gripper_is(proved):
    pose = proved.pose
    turn = Rotation.from_rotvec([0, 0.03, 0])
    here = Pose.from_rotation(pose.position + (0.0, 0.012, -0.005),
                              turn.as_matrix() @ pose.rotation)
    execution = proved.with_feedback(Feedback(here, 10.0)).started(10.02).execution
    way, planned, begin = execution.way, proved.proof.report.trajectory, execution.begin
    assert execution.done == begin < 0
    first = way.at([begin])[0][0]
    np.testing.assert_allclose(first.position, here.position, atol=1e-12)
    np.testing.assert_allclose(first.rotation, here.rotation, atol=1e-12)
    # it goes to the beginning smoothly, stands still, and then keeps to the plan as it was proved
    assert {round(float(period), 6) for period in way.windows[:2]} <= {
        round(1 / float(one), 6) for one in proved.planned.plan.shapes[0].modes(4).frequencies}
    times = np.linspace(begin, 0.0, 200)
    away = np.array([np.linalg.norm(one.position - pose.position) for one in way.at(times)[0]])
    assert np.diff(away).max() < 1e-12 and np.abs(np.diff(away)).max() < 0.013 * 3 / 200
    late = np.linspace(0.0, planned.duration, 20)
    for one, other in zip(way.at(late)[0], planned.at(late)[0], strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-12)


def test_what_a_robot_makes_up_for_is_not_blended(proved):
    here = Pose(proved.pose.position + (0.0, 0.0, 0.9e-3), proved.pose.quaternion)
    way = proved.with_feedback(Feedback(here, 10.0)).started(10.02).execution.way
    assert way is proved.proof.report.trajectory


def test_cancel_ends_a_proof(proved):
    proving = replace(proved, proof=Proof(proved.planned.plan))
    assert proving.proving and not proved.proving
    after = proving.canceled()
    assert after.planned is None and 'canceled' in after.no_plan
    assert after.with_proof(proved.proof).proof is None  # it comes too late
    assert proved.canceled() is proved  # nothing is to be canceled


def of_a_held_dlo(state):
    """Return the State with the same plan of a DLO whose far end something holds, too."""
    plan, direct = state.planned.plan, state.scene.direct
    shapes = [direct.solve(one.gripper, one, far_end=Pose.from_rotation(
        one.positions[-1], one.frames[-1])) for one in plan.shapes]
    return replace(state, planned=replace(state.planned, plan=replace(plan, shapes=shapes)))


def with_far_end(state, age=0.0, off=0.0):
    """Return the State with a plan of a held DLO, and a pose of its far end, `off` m off."""
    state = of_a_held_dlo(state)
    there = state.planned.plan.far_end_poses[0]
    heard = Feedback(Pose(there.position + (0, 0, off), there.quaternion), 10.0, age)
    return replace(state, far_end=heard)


def held_by(state, name):
    """Return the State whose plan is of a DLO that an arm of this name moves."""
    state = of_a_held_dlo(state)
    plan = state.planned.plan
    shapes = [replace(shape, holds=(Hold(shape.far_end.pose, by=name),)) for shape in plan.shapes]
    return replace(state, planned=replace(state.planned, plan=replace(plan, shapes=shapes,
                                                                      starts=())))


def by_joints(state):
    return replace(state, scene=scene(execute__through='joints', arm__tool_link='tool'))


@pytest.mark.parametrize(('spoil', 'cause', 'named'), [
    (of_a_held_dlo, Cause.NO_GRIPPER_POSE, 'no pose of the arm far_end is known'),
    (lambda s: with_far_end(s, age=0.3), Cause.OLD_GRIPPER_POSE, 'far_end_pose: the last'),
    (lambda s: with_far_end(s, age=-5.0), Cause.NO_GRIPPER_POSE, 'no pose of the arm far_end'),
    (lambda s: with_far_end(s, off=0.03), Cause.NOT_AT_START, 'the arm far_end is 0.03 m from'),
    (lambda s: by_joints(with_far_end(s)), Cause.ARM, 'the plan moves far_end as well'),
    (lambda s: held_by(s, 'hold at 1 m'), Cause.INVALID_REQUEST, "an arm is called 'hold at 1 m'"),
    (lambda s: replace(s, scene=scene(far_end__hold='clamped'), far_end=Feedback(
        HERE, 10.0)), Cause.FAR_END_HELD, 'which this plan is not made for'),
    (lambda s: replace(s, planned=None, no_plan='a box came'), Cause.NO_PLAN, 'a box came'),
    (lambda s: replace(s, proof=Proof(s.planned.plan)), Cause.PROOF_PENDING, 'ask again'),
    (lambda s: replace(s, proof=replace(s.proof, reason='it swings', cause=Cause.NOT_CALM)),
     Cause.NOT_CALM, 'it swings'),
    (lambda s: replace(s, pose=None, feedback=None), Cause.NO_GRIPPER_POSE, 'gripper_pose'),
    (lambda s: replace(s, feedback=None), Cause.OLD_GRIPPER_POSE, 'incoming_command_timeout = 0.1'),
    (lambda s: s.with_feedback(Feedback(s.pose, 9.9, 0.0)), Cause.OLD_GRIPPER_POSE, '0.15 s old'),
    (lambda s: s.with_feedback(Feedback(s.pose, 10.0, 0.08)), Cause.OLD_GRIPPER_POSE, '0.13 s old'),
    (lambda s: s.with_feedback(Feedback(Pose(s.pose.position + (0, 0.03, 0), s.pose.quaternion),
                                     10.0)),
     Cause.NOT_AT_START, 'execute.start_distance = 0.02'),
    (lambda s: s.with_feedback(Feedback(Pose(s.pose.position, (0, 0, 0, 1)), 10.0)),
     Cause.NOT_AT_START, 'execute.start_angle = 0.1')])
def test_what_is_missing_is_named(proved, spoil, cause, named):
    assert ready(proved, 10.05) is proved.proof.report.trajectory
    with pytest.raises(Refused, match=named) as refused:
        ready(spoil(proved), 10.05)
    assert refused.value.cause == cause


def test_all_arms_that_hold_the_dlo_begin_where_they_are(proved):
    state = with_far_end(proved, off=0.01)
    execution = state.started(10.02).execution
    assert [one.name for one in execution.arms] == ['gripper', 'far_end']
    far = execution.others[0]
    assert far.guards.heard == 'far_end_pose' and far.begin == execution.begin < 0
    np.testing.assert_allclose(far.way.poses([far.begin])[0].matrix, state.far_end.pose.matrix,
                               atol=1e-12)
    after = replace(state, execution=execution).after_tick(10.02, 10.02).execution
    assert after.others[0].feedback is state.far_end
    lost = replace(state, execution=after, far_end=None).after_tick(10.04, 10.04).execution
    assert lost.cause == Cause.GRIPPER_POSE_LOST and 'far_end_pose: none came' in lost.reason
    # a far end that stands still is watched where its poses are to come, and only there
    plan = state.planned.plan
    still = replace(state.planned, plan=replace(plan, shapes=[replace(
        plan.shapes[0], gripper=one.gripper) for one in plan.shapes]))
    watched = replace(state, planned=still, scene=scene(far_end__hold='clamped'))
    assert list(watched.hands) == ['far_end'] and not replace(state, planned=still).hands


def test_what_a_plan_says_holds_the_dlo_holds_it_until_a_reset(proved):
    first = Hold(Pose((0.0, 0.0, 0.5), (0, 0, 0, 1)), s=0.5, by='first')
    fixed = FarEnd(Pose((0.3, 0.0, 0.5), (0, 0, 0, 1)))
    shape = replace(proved.planned.plan.shapes[0], holds=(first, fixed))
    state = proved.grasped(shape)
    assert state.shape is shape
    assert state.holds_at(10.0) == (first, fixed)
    there = Pose((0.0, 0.1, 0.5), (0, 0, 0, 1))
    moved = state.with_arm('first', Feedback(there, 10.0))
    assert moved.holds_at(99.0)[0] == Hold(there, s=0.5, by='first')
    assert not moved.reset().holds_at(10.0)
    # where poses of the far end are to come, they alone tell
    told = replace(proved, scene=scene(far_end__hold='pinned')).grasped(shape)
    assert told.holds_at(10.0) == (first,)
    heard = replace(told, far_end=Feedback(HERE, 10.0))
    assert heard.holds_at(10.1) == (first, FarEnd(HERE, 'pinned'))
    assert heard.holds_at(11.0) == (first,)
    assert changed(moved, bodies=BALL).grasps and not changed(moved, rod__length=1.2).grasps


def test_a_plan_of_a_held_dlo_begins_with_its_own_shape(proved):
    state = with_far_end(proved)
    begun = state.started(10.02)
    assert begun.shape is state.planned.plan.shapes[0] and begun.grasps
    assert proved.started(10.02).shape is proved.shape  # what was predicted stays


def test_a_pose_of_an_arm_from_the_future_is_no_news(proved):
    heard = Feedback(HERE, 10.0, 0.05)
    state = proved.with_arm('second', heard)
    assert state.heard == {'second': heard}
    assert state.with_arm('second', Feedback(HERE, 11.0, -5.0)).heard == {'second': heard}


def test_the_plan_that_is_meant_is_executed_or_none(proved):
    made = replace(proved.planned, stamp=Time(sec=7))
    state = proved.with_plan(made).with_proof(proved.proof)
    assert ready(state, 10.0) is ready(state, 10.0, Time(sec=7))
    with pytest.raises(Refused, match='stamped 6.0'):
        ready(state, 10.0, Time(sec=6))
    other = replace(made, plan=truncate(made.plan, 4, PlanStatus.PARTIAL), stamp=Time(sec=6))
    between = state.with_plan(other).with_plan(made).with_proof(proved.proof)
    with pytest.raises(Refused, match='execute_plan') as refused:
        ready(between, 10.0)
    assert refused.value.cause == Cause.OTHER_PLAN
    assert ready(between, 10.0, Time(sec=7)) is ready(state, 10.0)


def test_one_who_asks_alone_gets_the_last_of_many_plans(proved):
    def planned(*names):
        state = proved
        for k in range(8):
            askers = frozenset({names[k % len(names)]})
            state = state.with_plan(replace(
                proved.planned, stamp=Time(sec=k), askers=askers, plan=proved.planned.plan
                if k % 2 else truncate(proved.planned.plan, 4, PlanStatus.PARTIAL)))
        return state.with_proof(replace(proved.proof, plan=state.planned.plan))

    alone = frozenset({'/one'})
    assert ready(planned('/one'), 10.0, askers=alone) is proved.proof.report.trajectory
    assert planned('/one').started(10.0, askers=alone).askers == frozenset()
    for state, now in ((planned('/one', '/other'), alone), (planned('/one'), alone | {'/other'})):
        with pytest.raises(Refused, match='by one of /one, /other') as refused:
            ready(state, 10.0, askers=now)
        assert refused.value.cause == Cause.OTHER_PLAN


@pytest.mark.parametrize(('enabled', 'named'), [
    (None, 'nothing came'), (Enabled(False, 10.0), 'it is false'), (Enabled(True, 9.4), '0.6 s')])
def test_who_is_not_enabled_does_not_start(proved, enabled, named):
    scene_ = scene(execute__enable_timeout=0.5)
    state = replace(proved, scene=scene_, planned=replace(proved.planned, scene=scene_))
    assert state.with_enabled(Enabled(True, 9.6)).started(10.0).executing
    with pytest.raises(Refused, match=named) as refused:
        state.with_enabled(enabled).started(10.0)
    assert refused.value.cause == Cause.NOT_ENABLED


@pytest.fixture
def pulled(proved, monkeypatch):
    """Return a State that executes a plan whose fitting bears a pull of 2 N, and is measured."""
    monkeypatch.setattr('dlo_planner.ros.state.pulls_borne',
                        lambda task, plan: np.full(len(plan), 2.0))
    state = replace(proved, planned=replace(proved.planned))  # which knows nothing yet
    return state.with_pull(Pull(1.0, 9.95)).started(10.0)


def test_a_pull_that_a_fitting_may_not_bear_stops_the_gripper_when_it_lasts(pulled):
    assert pulled.scene.guards.pull_time == 0.1 and unwatched(pulled) == ''
    swings = pulled.with_pull(Pull(3.0, 10.0)).with_pull(Pull(3.0, 10.09))
    assert swings.with_pull(Pull(1.9, 10.11)).with_pull(Pull(3.0, 10.12)).execution.cause == 0
    stopped = swings.with_pull(Pull(3.0, 10.11))
    assert stopped.execution.cause == Cause.PULL and not stopped.planned
    assert 'pulls with 3 N, for constraints.pull_time = 0.1 s: from 2 N on' in (
        stopped.execution.reason)
    seldom = replace(pulled, scene=scene(incoming_command_timeout=0.0)).with_pull(Pull(3.0, 10.0))
    assert seldom.with_pull(Pull(3.0, 15.0)).executing  # of the time between nobody knows
    off = replace(swings, scene=scene(constraints__pull_time=0.0))
    assert off.with_pull(Pull(3.0, 10.11)).execution.cause == Cause.DONE
    assert pulled.stopped(Cause.CANCELED, '').with_pull(Pull(3.0, 11.0)).with_pull(
        Pull(3.0, 12.0)).execution.cause == Cause.CANCELED


def test_what_a_fitting_bears_is_the_least_of_both_waypoints_between_which_the_gripper_is(
        proved, monkeypatch):
    bears = np.array([9.0, 2.0, 7.0, 3.0, 8.0, 8.0, 1.0, 9.0])
    monkeypatch.setattr('dlo_planner.ros.state.pulls_borne', lambda task, plan: bears)
    state = replace(proved, planned=replace(proved.planned)).with_pull(Pull(0.5, 9.95)).started(
        10.0)
    times, way = state.running.plan.times, state.execution.way
    assert times.size == bears.size
    for done in np.linspace(0.0, way.duration, 60)[1:-1].tolist():
        k = np.flatnonzero(times < way.progress([done])[0])[-1]  # it is between this one and next
        least = min(bears[k], bears[k + 1])
        there = replace(state, execution=replace(state.execution, done=done))
        assert there.with_pull(Pull(0.99 * least, 10.0)).overload_since is None
        assert there.with_pull(Pull(1.01 * least, 10.0)).overload_since == 10.0
    # before it begins, and at its end
    for done, least in ((-0.5, 9.0), (0.0, 9.0), (way.duration, 1.0)):
        there = replace(state, execution=replace(state.execution, done=done))
        assert there.with_pull(Pull(0.99 * least, 10.0)).overload_since is None
        assert there.with_pull(Pull(1.01 * least, 10.0)).overload_since == 10.0


def test_a_pull_that_is_not_heard_of_any_more_stops_the_gripper(proved, pulled):
    assert pulled.after_tick(10.04).execution.cause == Cause.DONE
    lost = pulled.after_tick(10.06).execution
    assert lost.cause == Cause.PULL and 'measured_wrench: the last one is 0.11 s old' in lost.reason
    never = replace(pulled, pull=None)
    assert never.after_tick(10.06).execution.cause == Cause.DONE
    assert 'no force came on ~/measured_wrench' in unwatched(never)
    assert 'constraints.pull_time = 0' in unwatched(replace(pulled, scene=scene(
        constraints__pull_time=0.0)))
    late = replace(pulled.stopped(Cause.CANCELED, ''), execution=None, planned=pulled.running,
                   proof=proved.proof).started(10.1 - 1e-3)
    assert late.pull is None  # what was measured long before an execution is nothing to it


def test_what_no_fitting_says_it_bears_is_not_watched(proved):
    started = proved.started(10.0)
    assert unwatched(started) == ''
    assert started.with_pull(Pull(1e3, 10.0)).with_pull(Pull(1e3, 10.2)).executing


def test_a_motion_beyond_its_limits_is_not_executed(proved):
    limits = Limits(*(0.9 * proved.scene.motion_limits.sizes).ravel())
    slower = replace(proved.scene, limits=limits)
    with pytest.raises(Refused, match='of its limits') as refused:
        replace(proved, planned=replace(proved.planned, scene=slower)).started(10.0)
    assert refused.value.cause == Cause.LIMITS


@pytest.mark.parametrize('age', [0.2, 5.0, -0.2, -60.0, 1.7e9])
def test_a_pose_that_is_too_old_or_from_the_future_is_no_news_of_the_gripper(proved, age):
    after = proved.with_feedback(Feedback(HERE, 10.04, age))
    assert after.pose is HERE and after.feedback is proved.feedback
    assert proved.with_feedback(Feedback(HERE, 10.04, np.sign(age) * 0.05)).feedback.pose is HERE


def test_what_changes_the_scene_voids_the_plan_and_stops_what_runs(proved):
    running = proved.started(10.0).after_tick(10.0).after_tick(10.02)
    for after, cause, reason in (
            (changed(running, bodies=BALL), Cause.OBSTACLES_CHANGED, 'a ball'),
            (changed(running, rod__tip_mass=0.01), Cause.PARAMETERS_CHANGED, 'a limit'),
            (changed(running, threading__linear_jerk=4.0), Cause.PARAMETERS_CHANGED, 'a limit'),
            (changed(running, tool__position=[0.0, 0.0, 0.1]), Cause.PARAMETERS_CHANGED,
             'a limit')):
        assert (after.planned, after.proof, after.no_plan) == (None, None, reason)
        assert after.execution.phase == 'stopping' and after.execution.cause == cause
        assert after.with_detail(cause, 'more').execution.reason == 'more'
        assert after.with_detail(Cause.SHUTDOWN, 'more') is after
    for name, value in (('rod__name', 'w'), ('constraints__path__position', 0.5),
                        ('threading__waypoints', 20), ('execute__start_angle', 0.2)):
        kept = changed(running, **{name: value})
        assert kept.planned is running.planned and kept.execution is running.execution


def test_a_plan_that_was_not_finished_is_void(proved):
    running = proved.started(10.0).after_tick(10.0).after_tick(10.02)
    after = running.canceled()
    assert after.planned is None and after.no_plan == 'canceled'
    newer = replace(running, planned=replace(running.planned))  # planned while it runs
    assert newer.canceled().planned is newer.planned
    assert proved.canceled() is proved and proved.stopped(Cause.SHUTDOWN, 'end') is proved


def test_a_plan_of_a_scene_that_is_gone_is_refused(proved):
    with pytest.raises(Refused) as refused:
        changed(proved, bodies=BALL).with_plan(proved.planned)
    assert refused.value.cause == Cause.SCENE_CHANGED
    assert changed(proved, rod__name='w').with_plan(proved.planned).planned is proved.planned
    other = Proof(None)  # of another plan
    assert proved.with_proof(other) is proved


def test_each_guard_and_figure_of_seeing_is_that_of_its_parameter():
    guards = {'path_position': 'constraints.path.position', 'path_angle': 'constraints.path.angle',
              'path_shape': 'constraints.path.shape', 'goal_position': 'constraints.goal.position',
              'goal_angle': 'constraints.goal.angle', 'goal_time': 'constraints.goal_time',
              'longest_pause': 'execute.longest_pause', 'enable_timeout': 'execute.enable_timeout',
              'pull_time': 'constraints.pull_time'}
    named = {**{item.name: guards.get(item.name, item.name) for item in fields(Guards)
                if item.name != 'heard'},
             **{item.name: f'observe.{item.name}' for item in fields(EstimatorConfig)
                if item.name != 'spread'}}
    given = {name: 0.01 * k for k, name in enumerate(named.values(), start=1)}
    given |= {'decelerate_on_cancel': False, 'observe.correct': False}
    made = Scene.of({**VALUES, **given})
    assert {name: getattr(made.guards if hasattr(made.guards, one) else made.seeing, one)
            for one, name in named.items()} == given
    assert Scene.of({**VALUES, 'observe.robot_time': 0.0}).seeing.robot_time == np.inf
    assert scene(BALL).solid.keep_out == tuple(body.obstacle for body in BALL.values())


def test_what_the_file_of_the_cell_says_stands_before_the_bodies(tmp_path):
    path = tmp_path / 'cell.yaml'
    path.write_text('- sphere: {name: lamp, center: [0, 5, 0], radius: 0.1}\n'
                    '- sphere: {center: [0, 5, 1], radius: 0.1, friction: 0}\n')
    nameless = scene({('', 4): BALL['cell', 3], ('two\nlines', 5): BALL['cell', 3]})
    assert [one.name for one in nameless.direct.obstacles] == ['marker 4', 'two?lines/5']
    made = scene(BALL, scene__file=str(path), obstacles__friction=0.3)
    assert [one.name for one in made.direct.obstacles] == ['lamp', 'sphere 1', 'cell/3']
    assert [one.friction for one in made.direct.obstacles] == [0.3, 0.0, 0.3]
    assert made.workspace.keep_out == made.direct.obstacles
    assert not made.keeps_plans(scene(BALL, obstacles__friction=0.3))
    (tmp_path / 'bad.stl').write_text('x')
    for name, said in (('no.xml', 'expected a file, there is none'),
                       ('bad.stl', 'expected triangles')):
        with pytest.raises(InvalidTask, match=f'parameter scene.file: .*{name}.*{said}'):
            scene(scene__file=str(tmp_path / name))


def test_nothing_is_lost_when_several_threads_change_it():
    store = Store(State(scene()))
    numbers = range(500)

    def count():
        for _ in numbers:
            store.change(State.reset)

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.state.resets == 4 * len(numbers)


def test_what_a_change_raises_leaves_the_state_as_it_is(proved):
    store = Store(proved)
    with pytest.raises(Refused):
        store.change(lambda state: state.started(99.0))
    assert store.state is proved
    assert store.change(State.reset) is store.state  # the lock is free again


def test_the_gripper_is_at_the_start_where_its_tool_frame_is(proved):
    # the DLO leaves the tool 0.1 m beside its frame, and turned
    tool = Pose.from_rotation((0.0, 0.1, 0.02), Rotation.from_rotvec((0.3, 0.0, 0.7)).as_matrix())
    turned = replace(proved.scene, tool=tool)
    state = replace(proved, scene=turned, planned=replace(proved.planned, scene=turned))
    there = proved.planned.plan.grippers[0].compose(tool.inverse())
    assert ready(state.with_feedback(Feedback(there, 10.0)), 10.0) is proved.proof.report.trajectory
    for wrong in (proved.planned.plan.grippers[0], proved.planned.plan.grippers[0].compose(tool)):
        with pytest.raises(Refused) as refused:
            ready(state.with_feedback(Feedback(wrong, 10.0)), 10.0)
        assert refused.value.cause == Cause.NOT_AT_START


def test_bodies_are_for_whom_they_say_and_rub_as_they_say():
    balls = [Sphere((0, 5, z), 0.1, mu) for z, mu in ((0, 0.0), (1, 0.7), (2, 0.0))]
    bodies = {('cell', 0): Body(balls[0]), ('cell', 1): Body(balls[1], 0.7),
              ('cell', 2): Body(balls[2], role='workspace only')}
    made = Scene.of(values(obstacles__friction=0.2), bodies)
    assert made.direct.obstacles == (replace(balls[0], friction=0.2), balls[1])
    assert [one.center[2] for one in made.workspace.keep_out] == [0, 1, 2]


@pytest.mark.parametrize(('constraint', 'cause'), [
    ('stability', Cause.NO_ROOM), ('clearance', Cause.NO_ROOM), ('margin', Cause.NO_ROOM),
    ('workspace.lower.x', Cause.WORKSPACE), ('max_bend_curvature', Cause.OVERBENT)])
def test_the_cause_of_a_refusal_is_the_demand_that_refuses(constraint, cause):
    def refuse():
        error = Infeasible('waypoint 0: refused', 0, constraint, 0.1)
        error.advise = lambda: 'it would pass if held at most 0.5 m from its end'
        raise error

    with pytest.raises(Refused, match='refused .*: it would pass if held') as caught:
        explained(refuse)
    assert caught.value.cause == cause
