# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All that the node knows, as one value: callbacks read it once, and change it in one place."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time

from dlo_planner.arm.joint_stream import settling_time
from dlo_planner.direct.shape import Shape
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import EXACT, Execution, blend_from_current_pose, called
from dlo_planner.execute.guards import Enabled, Feedback
from dlo_planner.execute.limiter import used_by
from dlo_planner.execute.pull import Pull, pulls_borne
from dlo_planner.inverse.task import Task
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import BORE, FarEnd, Holds
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.stage import FAR_END, GRIPPER, Event, arm_of, moved_holds
from dlo_planner.ros.scene import Scene
from dlo_planner.trajectory.timed_path import TimedPath, standing
from dlo_planner.verify.report import ValidationReport
from msg_helpers.poses import stamp_text

DONE = ('held', 'refused')  # states of a proof that has no step left
_CHECKED = ('the plan is still being checked, which takes some seconds: ask again when ~/status '
            'says that it is safe')
_SAME = 1e-3, 5e-3  # m, rad: gripper poses that differ by less are the same
_SAME_LENGTH = 1e-9  # relative
_RECENT = 1.0  # s: an older force says nothing of now, where no parameter says how old it may be
_SEEN = 3  # periods before and after a motion, in which its jerk is seen
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')  # of an arm: part of the name of a topic


@dataclass(frozen=True)
class PlanResult:
    """A plan, and with what it was made."""

    scene: Scene
    plan: Plan
    before: Shape | None  # of the DLO before the first pose, None: any
    stamp: Time           # of the messages that carry it
    task: Task
    asked: Time           # of the request for it
    askers: frozenset[str] = frozenset()  # the nodes that may have asked for it
    whole: Plan | None = None  # of which the plan is a stage, where hands open and close between
    stage: int = 0             # its index

    @classmethod
    def of(cls, plan: Plan, scene: Scene, before: Shape | None, stamp: Time, task: Task,
           asked: Time, askers: frozenset[str]) -> PlanResult:
        """Return a Plan, or its first stage where hands open and close between its stages."""
        made = cls(scene, plan, before, stamp, task, asked, askers)
        return made if not plan.events else replace(made, whole=plan).in_stage(0)

    def in_stage(self, index: int) -> PlanResult:
        """Return another stage of the same plan."""
        assert self.whole is not None  # it has stages
        stage = self.whole.stage_plans[index]
        return replace(self, plan=stage, before=stage.shapes[0], stage=index)

    @property
    def following(self) -> int | None:
        """The index of the next stage in which anything moves; None: this is the last one."""
        stages = () if self.whole is None else self.whole.stage_plans
        return next((k for k in range(self.stage + 1, len(stages)) if _moves(stages[k])), None)

    @property
    def events(self) -> tuple[Event, ...]:
        """What opens and closes after this stage, in this order, before the following one."""
        if self.whole is None or self.following is None:
            return ()
        return tuple(event for event in self.whole.events
                     if self.stage < event.stage <= self.following)

    @property
    def hands(self) -> dict[str, Pose]:
        """Where each arm that moves in any stage holds the DLO as this one begins, by its name."""
        moved = (self.whole or self.plan).arms
        return {arm_of(hold): hold.pose for hold in self.plan.shapes[0].holds
                if arm_of(hold) in moved}

    @cached_property
    def pulls_borne(self) -> Floats:
        """(n,) forces of the gripper, N, from which on a fitting may be overloaded."""
        return pulls_borne(self.task, self.plan)

    @property
    def far_end(self) -> Pose | None:
        """Where the far end is held as this stage begins, by what has no name; None: it is not."""
        holds = self.plan.shapes[0].holds
        return holds[-1].pose if holds and arm_of(holds[-1]) == FAR_END else None

    def is_as(self, other: PlanResult) -> bool:
        """Whether another plan is as good as the same one: the same way, in the same scene."""
        return self.scene.keeps_plans(other.scene) and len(self.plan) == len(other.plan) and all(
            _nearly_same(*poses) for poses in zip(self.plan.grippers, other.plan.grippers,
                                                  strict=True))


def _moves(stage: Plan) -> bool:
    return bool(stage.arms) or any(
        (pose.matrix != stage.grippers[0].matrix).any() for pose in stage.grippers)


def _nearly_same(one: Pose, other: Pose) -> bool:
    return bool(np.linalg.norm(one.position - other.position) <= _SAME[0]
                and angle_between(one.rotation, other.rotation) <= _SAME[1])


@dataclass(frozen=True)
class Proof:
    """How far the proof of a plan has come, and what it says."""

    plan: Plan
    report: ValidationReport | None = None  # of the last step that was done
    reason: str = _CHECKED  # why its trajectory must not be executed; empty: it may be
    done: bool = False      # whether no step is left
    cause: Cause = Cause.PROOF_PENDING

    @property
    def safe(self) -> bool:
        """Whether `report.trajectory` may be executed."""
        return not self.reason

    @property
    def state(self) -> str:
        """One of 'not ready', 'held slowly', and those of DONE: 'held', 'refused'."""
        if self.done:
            return DONE[0] if self.safe else DONE[1]
        return 'not ready' if self.report is None else 'held slowly'


class Looking(NamedTuple):
    """How a threading in a closed loop stands, see `TaskLoop`."""

    phase: str = 'look'
    tries: int = 0
    miss_bound_95: float = np.nan


@dataclass(frozen=True)
class State:
    """What the node knows; its methods return the next State."""

    scene: Scene
    shape: Shape | None = None  # the last one, None: the DLO begins with its natural one
    resets: int = 0             # how often the shape was forgotten
    pose: Pose | None = None    # of the tool frame, the last one that came
    feedback: Feedback | None = None  # the last one that was not too old when it came
    far_end: Feedback | None = None   # the last pose of the far end's grip
    # the last pose of each other arm, of the DLO's frame where it holds it, by its name
    arms: Mapping[str, Feedback] = field(default_factory=dict)
    grasps: Holds = ()  # what holds it as well since a plan of such a DLO, or its stage, began
    # the last task of each type that came on ~/task, as `open_task` returns it, the newest last
    tasks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    task: Task | None = None    # the last one that a plan was asked for
    planned: PlanResult | None = None  # the last plan, None: there is none, `no_plan` says why
    no_plan: str = 'there is no plan yet'
    proof: Proof | None = None  # of that plan, as far as it has come
    execution: Execution | None = None  # the last one
    running: PlanResult | None = None   # the plan that it executes
    looking: Looking | None = None      # how that stands, if it is in a closed loop
    latest: PlanResult | None = None    # the last plan that was made, valid or not
    others: int = 0  # plans made since an execution began that differ from the one before
    askers: frozenset[str] = frozenset()  # the nodes that may have asked for them
    enabled: Enabled | None = None      # what was heard last of whether the gripper may move
    pull: Pull | None = None            # the last one that was measured
    overload_since: float | None = None  # s, steady, since when a fitting may be overloaded

    @property
    def gripper(self) -> Pose | None:
        """The last Pose of the gripper frame, or None."""
        return None if self.pose is None else self.pose.compose(self.scene.tool)

    @property
    def executing(self) -> bool:
        """Whether what is executed is not at its end."""
        return self.execution is not None and self.execution.active

    # ---- scene ------------------------------------------------------------------------------

    def in_scene(self, scene: Scene, cause: Cause, reason: str) -> State:
        """Return the State in another Scene, in which is kept what can be kept."""
        state = replace(self, scene=scene, shape=carried(self.shape, self.scene, scene),
                        grasps=self.grasps if self.scene.direct.rod == scene.direct.rod else ())
        if scene.task != self.scene.task:
            state = state.opened(scene.task)
        return state if self.scene.keeps_plans(scene) else state.without_plan(cause, reason)

    def without_plan(self, cause: Cause, reason: str) -> State:
        """Return the State in which the plan is void, and what is executed comes to rest."""
        state = self.stopped(cause, reason)
        if state.planned is None:
            return state
        return replace(state, planned=None, proof=None, no_plan=reason)

    # ---- shapes -----------------------------------------------------------------------------

    def with_feedback(self, heard: Feedback) -> State:
        """Return the State after a gripper pose; one that is too old is no news of the gripper."""
        limit = self.scene.guards.incoming_command_timeout
        fresh = not limit or abs(heard.age) <= limit
        return replace(self, pose=heard.pose, feedback=replace(heard, age=max(heard.age, 0.0))
                       if fresh else self.feedback)

    def held_at(self, now: float) -> FarEnd | None:
        """Return what holds the far end at `now` s, steady; None: it is free."""
        heard, hold, limit = self.far_end, self.scene['far_end.hold'], self.scene['far_end.timeout']
        if hold == 'free' or heard is None or (
                limit and heard.age + now - heard.arrived > limit):
            return None
        return FarEnd(heard.pose, hold)

    @property
    def heard(self) -> Mapping[str, Feedback]:
        """What was heard last of each arm besides the gripper, and is not from the future."""
        far, limit = self.far_end, self.scene.guards.incoming_command_timeout
        if far is None or limit and far.age < -limit:
            return self.arms
        return {**self.arms, FAR_END: far}

    @property
    def hands(self) -> dict[str, Pose]:
        """Where the arms begin that the last plan moves, or whose poses say that they hold."""
        if self.planned is None:
            return {}
        hands, there = self.planned.hands, self.planned.far_end
        told = there is not None and self.scene['far_end.hold'] != 'free'
        return {**hands, FAR_END: there} if told and there is not None else hands

    def holds_at(self, now: float) -> Holds:
        """Return what holds the DLO beside the gripper at `now` s, steady, where that is heard."""
        far = self.held_at(now)
        held = moved_holds(self.grasps, {name: one.pose for name, one in self.heard.items()})
        return held if far is None else (*(hold for hold in held if hold.s is not None), far)

    def grasped(self, shape: Shape) -> State:
        """Return the State in which the DLO is held as in a Shape of a plan.

        But for a far end that is heard of. Where it was not held so it is as in the plan.
        """
        told = self.scene['far_end.hold'] != 'free'
        grasps = tuple(hold for hold in shape.holds if not told or arm_of(hold) != FAR_END)
        return replace(self, grasps=grasps, shape=self.shape if grasps == self.grasps else shape)

    def with_arm(self, name: str, heard: Feedback) -> State:
        """Return the State after a pose of an arm; one that is from the future is no news of it."""
        limit = self.scene.guards.incoming_command_timeout
        if limit and heard.age < -limit:
            return self
        return replace(self, arms={**self.arms, name: heard})

    def with_enabled(self, enabled: Enabled) -> State:
        """Return the State after it was heard whether the gripper may move."""
        return replace(self, enabled=enabled)

    def with_pull(self, heard: Pull) -> State:
        """Return the State after a Pull was measured; one that lasts ends what is executed."""
        state, most = replace(self, pull=heard), self._pull_borne()
        limit = self.scene.guards.pull_time
        if not limit or heard.force <= most:
            return replace(state, overload_since=None)
        since = self.overload_since
        if since is None or self._recent_pull(heard.arrived) is None:
            since = heard.arrived  # (between two that are far apart nobody knows what it pulled)
        state = replace(state, overload_since=since)
        if heard.arrived - since < limit:
            return state
        return state.stopped(Cause.PULL, 'measured_wrench: the gripper pulls with '
                             f'{heard.force:.3g} N, for constraints.pull_time = {limit:g} s: '
                             f'from {most:.3g} N on a fitting may be overloaded')

    def _pull_borne(self) -> float:
        """Return from which force of the gripper on, N, a fitting may be overloaded now."""
        if self.execution is None or self.running is None or not self.executing:
            return np.inf
        at = self.execution.way.progress([max(self.execution.done, 0.0)])
        borne = self.running.pulls_borne
        after = min(int(np.searchsorted(self.running.plan.times, at)[0]), borne.size - 1)
        return float(borne[max(after - 1, 0):after + 1].min())

    def _pull_lost(self, now: float) -> str:
        """Return in words that a pull was measured and is not any more, '' if nothing is wrong."""
        guards = self.scene.guards
        limit = guards.incoming_command_timeout
        if self.pull is None or not limit or not guards.pull_time or (
                now - self.pull.arrived <= limit or self._pull_borne() == np.inf):
            return ''
        return (f'measured_wrench: the last one is {now - self.pull.arrived:.3g} s old: expected '
                f'incoming_command_timeout = {limit:g} s at most, so that no fitting is '
                'overloaded')

    def with_shape(self, shape: Shape, before: State) -> State:
        """Return the State with a Shape that was found from the State `before`."""
        if self.resets != before.resets:
            return self
        return replace(self, shape=carried(shape, before.scene, self.scene))

    def reset(self) -> State:
        """Return the State in which the DLO begins with its natural shape, in the gripper alone."""
        return replace(self, shape=None, grasps=(), resets=self.resets + 1)

    # ---- plans ------------------------------------------------------------------------------

    def opened(self, content: Mapping[str, Any]) -> State:
        """Return the State with another task that is meant from now on, see `open_task`."""
        others = {kind: known for kind, known in self.tasks.items() if kind != content['type']}
        return replace(self, tasks={**others, content['type']: content})

    def open_task(self, kind: str | None = None) -> Mapping[str, Any] | None:
        """Return the newest task, or that of a type; None: there is none."""
        known = [self.scene.task, *self.tasks.values()]
        return next((one for one in reversed(known) if kind in (None, one['type'])), None)

    def with_plan(self, made: PlanResult) -> State:
        """Return the State with a plan; raise Refused if it was made for another scene."""
        if not made.scene.keeps_plans(self.scene):
            raise Refused(Cause.SCENE_CHANGED, 'obstacles or parameters changed while the plan was '
                          'made: ask again')
        others = self.others + (self.latest is None or not made.is_as(self.latest))
        return replace(self, planned=made, proof=Proof(made.plan), latest=made, others=others,
                       askers=self.askers | made.askers)

    def with_proof(self, proof: Proof) -> State:
        """Return the State with a Proof, if it is of the last plan."""
        if self.planned is None or proof.plan is not self.planned.plan:
            return self
        return replace(self, proof=proof)

    # ---- execution --------------------------------------------------------------------------

    def started(self, now: float, wanted: Time | None = None,
                askers: frozenset[str] = frozenset()) -> State:
        """Return the State in which the last plan is executed, from `now` s on; see `ready`."""
        proved = ready(self, now, wanted, askers)
        assert self.planned is not None and self.feedback is not None  # `ready` looks at both
        scene, hands = self.planned.scene, self.hands
        ways = [proved, *(proved.arm(name) if name in proved.path.arms
                          else standing(pose, proved.duration, scene.limits)
                          for name, pose in hands.items())]
        (way, *others), begin = blend_from_current_pose(
            ways, [self.feedback.pose.compose(scene.tool),
                   *(self.heard[name].pose for name in hands)], self.planned.plan.shapes[0],
            scene.limits, scene.period)
        times = np.arange(-_SEEN, proved.duration / scene.period + _SEEN) * scene.period
        part = used_by(ways, times, scene.limits, scene.period)
        if part > EXACT:
            raise Refused(Cause.LIMITS, f'the motion of the plan uses {part:.3g} of its limits of '
                          'speed, acceleration and jerk (threading.*): plan again')
        if self.scene.by_joints:  # the controller leads the arm to the beginning before
            begin -= settling_time(scene.limits)
        guards = self.scene.guards
        execution = Execution(way, scene.tool.inverse(), scene.frame_id, guards,
                              scene.period, self.scene.horizon, scene.limits,
                              begin=begin, done=begin)
        execution = replace(execution, others=tuple(
            replace(execution, way=other, back=Pose.identity(), name=name,
                    guards=replace(guards, heard=pose_topic(name)))
            for name, other in zip(hands, others, strict=True)))
        return replace(self.grasped(self.planned.plan.shapes[0]), execution=execution,
                       running=self.planned, looking=None, latest=None, others=0,
                       askers=frozenset(), pull=self._recent_pull(now), overload_since=None)

    def _recent_pull(self, now: float) -> Pull | None:
        """Return the Pull that was measured lately at `now` s, steady; None: nobody measures."""
        limit = self.scene.guards.incoming_command_timeout or _RECENT
        fresh = self.pull is not None and now - self.pull.arrived <= limit
        return self.pull if fresh else None

    def after_loop_tick(self, before: Execution | None, execution: Execution,
                        looking: Looking) -> State:
        """Return the State after a tick of a closed loop, `before` which it was another Execution.

        What was stopped meanwhile stays so: the next tick hears it.
        """
        if self.execution is not before:
            return self
        return replace(self._with_execution(execution), looking=looking)

    def after_tick(self, now: float, stamp: float | None = None) -> State:
        """Return the State with the next command, at `now` s, `stamp` s on the stamps' clock."""
        if self.execution is None:
            return self
        lost = self._pull_lost(now)
        state = self.stopped(Cause.PULL, lost) if lost else self
        assert state.execution is not None  # as before
        return state._with_execution(state.execution.tick(
            now, self.feedback, stamp, self.enabled, self.heard))

    @property
    def proving(self) -> bool:
        """Whether the last plan is still being proved."""
        return self.proof is not None and not self.proof.done

    def canceled(self) -> State:
        """Return the State after `cancel`: what is executed comes to rest, or the proof ends."""
        if self.execution is not None and self.executing:
            return self._with_execution(self.execution.canceled())
        if self.proving:
            return self.without_plan(Cause.CANCELED, 'canceled while the plan was proved')
        return self

    def stopped(self, cause: Cause, reason: str) -> State:
        """Return the State in which what is executed comes to rest, if anything is."""
        if self.execution is None or not self.executing:
            return self
        return self._with_execution(self.execution.stop(cause, reason))

    def with_detail(self, cause: Cause, reason: str) -> State:
        """Return the State that says more of why the plan is void, if that is the cause."""
        execution = self.execution
        if execution is None or execution.cause != cause:
            return self
        return replace(self, execution=replace(execution, reason=reason),
                       no_plan=reason if self.planned is None else self.no_plan)

    def _with_execution(self, execution: Execution) -> State:
        """Return the State with another Execution; a plan that was not finished is void."""
        state = replace(self, execution=execution)
        if execution.phase in ('stopping', 'stopped') and self.planned is self.running:
            return replace(state, planned=None, proof=None, no_plan=execution.reason)
        return state


def carried(shape: Shape | None, before: Scene, after: Scene) -> Shape | None:
    """Return what is left of the last Shape in another Scene.

    The same DLO keeps its shape and its permanent set. Another one begins with the shape, without
    the set, if it is as long and does not yield: of one that yields it is not known what the way
    to that shape has left in it.
    """
    rod, other = before.direct.rod, after.direct.rod
    if shape is not None and (before.grasped or after.grasped) and before.grasped != after.grasped:
        return None
    if shape is None or rod == other:
        return shape
    if other.yields or abs(rod.length - other.length) > _SAME_LENGTH * rod.length:
        return None
    return replace(shape, state=replace(shape.state, history=None))


def ready(state: State, now: float, wanted: Time | None = None,
          askers: frozenset[str] = frozenset()) -> TimedPath:
    """Return the Trajectory to be executed: the one that was proved.

    `wanted` is the stamp of the plan that is meant, None: the last one; `askers` are the nodes that
    can ask for plans now.
    """
    if state.executing:
        raise Refused(Cause.EXECUTING, 'a plan is being executed: expected its end, or ~/cancel')
    if state.planned is None:
        raise Refused(Cause.NO_PLAN, f'there is no plan: {state.no_plan}')
    _meant(state, state.planned, wanted, askers)
    proof = state.proof
    assert proof is not None  # every plan has one
    if not proof.safe:
        raise Refused(proof.cause, proof.reason)
    _feeds(state.planned)
    _heard_lately(state, now)
    assert proof.report is not None and state.feedback is not None
    way, hands = proof.report.trajectory, state.hands
    assert way is not None  # what is safe has one
    if hands and state.scene.by_joints:
        raise Refused(Cause.ARM, f'the plan moves {", ".join(hands)} as well: expected '
                      'execute.through = ahead or pose: joints are those of one arm')
    first = way.poses([0.0])[0].compose(state.planned.scene.tool.inverse())
    _at_start(state, GRIPPER, state.feedback, first)
    for name, pose in hands.items():
        _at_start(state, name, _heard_of(state, name, now), pose)
    return way


def _feeds(made: PlanResult) -> None:
    """Refuse to command a hand twice, by its own name and as the gripper that feeds nothing."""
    gripper = made.plan.shapes[0].gripper
    for name, pose in made.hands.items():
        if np.array_equal(pose.matrix, gripper.matrix):
            raise Refused(Cause.FAR_END_HELD, f'nothing feeds the DLO of this plan, its gripper is '
                          f'the hand {name}: expected each stage to be executed by '
                          '~/gripper_trajectory_timed, and ~/next_stage when that is done')


def pose_topic(name: str) -> str:
    """Return the topic, below the node's, on which it is heard where an arm is."""
    return 'far_end_pose' if name == FAR_END else f'gripper_pose/{name}'


def is_arm(name: str) -> bool:
    """Whether a name of an arm can be part of a topic's."""
    return _NAME.fullmatch(name) is not None


def _at_start(state: State, name: str, heard: Feedback, first: Pose) -> None:
    """Refuse to begin where an arm is not where the plan begins."""
    scene, here = state.scene, heard.pose
    away = float(np.linalg.norm(here.position - first.position))
    if away > scene['execute.start_distance']:
        raise Refused(Cause.NOT_AT_START, f'{called(name)} is {away:.3g} m from where the plan '
                      'begins: expected execute.start_distance = '
                      f'{scene["execute.start_distance"]:g} m at most')
    angle = angle_between(here.rotation, first.rotation)
    if angle > scene['execute.start_angle']:
        raise Refused(Cause.NOT_AT_START, f'{called(name)} is turned by {angle:.3g} rad from where '
                      'the plan begins: expected execute.start_angle = '
                      f'{scene["execute.start_angle"]:g} rad at most')


def _heard_of(state: State, name: str, now: float) -> Feedback:
    """Return what was heard lately of an arm besides the gripper; refuse if nothing was."""
    if not is_arm(name):
        raise Refused(Cause.INVALID_REQUEST, f'an arm is called {name!r}: expected letters, '
                      'digits and underscores, as of a topic: `Hold.by` names it')
    heard, topic = state.heard.get(name), pose_topic(name)
    if heard is None:
        raise Refused(Cause.NO_GRIPPER_POSE, f'no pose of the arm {name} is known: send '
                      f'~/{topic}, the frame of the DLO where it holds it')
    _not_too_old(state, heard, topic, now)
    return heard


def _not_too_old(state: State, heard: Feedback, topic: str, now: float) -> None:
    limit, age = state.scene.guards.incoming_command_timeout, heard.age + now - heard.arrived
    if limit and age > limit:
        raise Refused(Cause.OLD_GRIPPER_POSE, f'{topic}: the last one is {age:.3g} s old: '
                      f'expected incoming_command_timeout = {limit:g} s at most, by its stamp')


def _meant(state: State, made: PlanResult, wanted: Time | None, askers: frozenset[str]) -> None:
    """Refuse to execute a plan that may be another one than is meant.

    Who calls a service ROS does not tell. Where one node alone could ask since an execution began,
    the last plan is the one that it was answered with.
    """
    known = state.askers | askers
    if wanted is None and state.others > 1 and len(known) != 1:
        who = f'by one of {", ".join(sorted(known))}' if known else 'and it is not known by whom'
        raise Refused(Cause.OTHER_PLAN, f'{state.others} different plans were made since an '
                      f'execution began, {who}; the last one is stamped {stamp_text(made.stamp)}: '
                      'expected the one that is meant to be named, by ~/execute_plan')
    if wanted is not None and wanted != made.stamp:
        raise Refused(Cause.OTHER_PLAN, f'the plan stamped {stamp_text(wanted)} is not the last '
                      f'one, that is stamped {stamp_text(made.stamp)}: plan again')


def _heard_lately(state: State, now: float) -> None:
    if state.pose is None:
        wanted = 'send ~/gripper_pose'
        if state.scene.by_joints:
            wanted = 'expected joint_states and robot_description of the arm, as arm.* say'
        raise Refused(Cause.NO_GRIPPER_POSE, f'no gripper pose is known: {wanted}')
    guards = state.scene.guards
    limit, heard = guards.incoming_command_timeout, guards.heard
    expected = f'expected incoming_command_timeout = {limit:g} s at most, by its stamp'
    if state.feedback is None:
        raise Refused(Cause.OLD_GRIPPER_POSE, f'{heard}: each one that came was too old, or '
                      f'from the future: {expected}')
    _not_too_old(state, state.feedback, heard, now)
    assert state.planned is not None  # `ready` has looked
    first = state.planned.plan.shapes[0]
    if state.held_at(now) is not None and not any(
            hold.s is None and hold.by != BORE for hold in first.holds):
        raise Refused(Cause.FAR_END_HELD, 'far_end_pose: the far end is held, which this plan is '
                      'not made for: expected far_end.hold = free, or no pose')
    barred = state.scene.guards.barred(state.enabled, now)
    if barred:
        raise Refused(Cause.NOT_ENABLED, barred)


class Store:
    """Holds the State; every change of it goes through one lock."""

    def __init__(self, state: State) -> None:
        self._lock = Lock()
        self._state = state

    @property
    def state(self) -> State:
        """The State now."""
        return self._state

    def change(self, change: Callable[[State], State]) -> State:
        """Replace the State by what `change` returns of it, and return that."""
        with self._lock:
            self._state = change(self._state)
            return self._state
