# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All that the node knows, as one value: callbacks read it once, and change it in one place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time

from dlo_planner.arm.joint_stream import settling_time
from dlo_planner.direct.shape import Shape
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import EXACT, Execution, blend_from_current_pose
from dlo_planner.execute.guards import Enabled, Feedback
from dlo_planner.execute.limiter import used
from dlo_planner.inverse.task import Task
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.path import held_after
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.stage import Event
from dlo_planner.ros.scene import Scene
from dlo_planner.trajectory.timed_path import TimedPath
from dlo_planner.verify.report import ValidationReport
from msg_helpers.poses import stamp_text

DONE = ('held', 'refused')  # states of a proof that has no step left
_CHECKED = ('the plan is still being checked, which takes some seconds: ask again when ~/status '
            'says that it is safe')
_SAME = 1e-3, 5e-3  # m, rad: gripper poses that differ by less are the same
_SAME_LENGTH = 1e-9  # relative
_SEEN = 3  # periods before and after a motion, in which its jerk is seen


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
        return next((k for k in range(self.stage + 1, len(stages)) if stages[k].arms), None)

    @property
    def events(self) -> tuple[Event, ...]:
        """What opens and closes after this stage, in this order, before the following one."""
        if self.whole is None or self.following is None:
            return ()
        return tuple(event for event in self.whole.events
                     if self.stage < event.stage <= self.following)

    def is_as(self, other: PlanResult) -> bool:
        """Whether another plan is as good as the same one: the same way, in the same scene."""
        return self.scene.keeps_plans(other.scene) and len(self.plan) == len(other.plan) and all(
            _nearly_same(*poses) for poses in zip(self.plan.grippers, other.plan.grippers,
                                                  strict=True))


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
        state = replace(self, scene=scene, shape=carried(self.shape, self.scene, scene))
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

    def with_enabled(self, enabled: Enabled) -> State:
        """Return the State after it was heard whether the gripper may move."""
        return replace(self, enabled=enabled)

    def with_shape(self, shape: Shape, before: State) -> State:
        """Return the State with a Shape that was found from the State `before`."""
        if self.resets != before.resets:
            return self
        return replace(self, shape=carried(shape, before.scene, self.scene))

    def reset(self) -> State:
        """Return the State in which the DLO begins with its natural shape."""
        return replace(self, shape=None, resets=self.resets + 1)

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
        scene = self.planned.scene
        way, begin = blend_from_current_pose(
            proved, self.feedback.pose.compose(scene.tool), self.planned.plan.shapes[0],
            scene.limits, scene.period)
        times = np.arange(-_SEEN, proved.duration / scene.period + _SEEN) * scene.period
        part = used(proved.frames(times), scene.limits, scene.period)
        if part > EXACT:
            raise Refused(Cause.LIMITS, f'the motion of the plan uses {part:.3g} of its limits of '
                          'speed, acceleration and jerk (threading.*): plan again')
        if self.scene.by_joints:  # the controller leads the arm to the beginning before
            begin -= settling_time(scene.limits)
        execution = Execution(way, scene.tool.inverse(), scene.frame_id, self.scene.guards,
                              scene.period, self.scene.horizon, scene.limits,
                              begin=begin, done=begin)
        return replace(self, execution=execution, running=self.planned, looking=None,
                       latest=None, others=0, askers=frozenset())

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
        return self._with_execution(self.execution.tick(now, self.feedback, stamp, self.enabled))

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
    if state.planned.plan.shapes[0].holds and held_after(state.planned.plan) is None:
        raise Refused(Cause.FAR_END_HELD, 'the plan is of a DLO that more than the gripper holds, '
                      'whose arms the node does not command: expected another one that executes '
                      '~/gripper_trajectory_timed' + ('' if state.planned.whole is None else
                                                      ', and ~/next_stage when that is done'))
    _heard_lately(state, now)
    assert proof.report is not None and state.feedback is not None
    way, scene = proof.report.trajectory, state.scene
    assert way is not None  # what is safe has one
    first = way.poses([0.0])[0].compose(state.planned.scene.tool.inverse())
    here = state.feedback.pose
    away = float(np.linalg.norm(here.position - first.position))
    if away > scene['execute.start_distance']:
        raise Refused(Cause.NOT_AT_START, f'the gripper is {away:.3g} m from where the plan '
                      'begins: expected execute.start_distance = '
                      f'{scene["execute.start_distance"]:g} m at most')
    angle = angle_between(here.rotation, first.rotation)
    if angle > scene['execute.start_angle']:
        raise Refused(Cause.NOT_AT_START, f'the gripper is turned by {angle:.3g} rad from where '
                      'the plan begins: expected execute.start_angle = '
                      f'{scene["execute.start_angle"]:g} rad at most')
    return way


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
    age = state.feedback.age + now - state.feedback.arrived
    if limit and age > limit:
        raise Refused(Cause.OLD_GRIPPER_POSE,
                      f'{heard}: the last one is {age:.3g} s old: {expected}')
    if state.held_at(now) is not None:
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
