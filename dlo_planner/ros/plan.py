# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tasks in, the gripper's trajectory out: one plan at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from threading import Lock
from time import monotonic
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Path
from nav_msgs.srv import GetPlan
from rclpy.node import NodeNameNonExistentError
from std_msgs.msg import String
from std_srvs.srv import Trigger

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DeadlineExceeded, DloPlannerError, Infeasible, InvalidTask
from dlo_planner.execute.causes import Cause, Refused, cause_of
from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.thread_sequence import cutouts_of, threading_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.holds import Holds, alike
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import OBLIQUE, Plan
from dlo_planner.plan.stage import arm_of
from dlo_planner.progress import Progress, interrupted_by
from dlo_planner.ros.arms import Arms
from dlo_planner.ros.inputs import goals_in, judge_distance, pose_in
from dlo_planner.ros.lifecycle import LATCHED, REQUEST
from dlo_planner.ros.scene import Scene
from dlo_planner.ros.state import PlanResult, Proof, State
from dlo_planner.ros.status import Outcome, Part, Shared, proof_figures
from dlo_planner.settings.tasks import (
    close_task,
    open_task,
    plan_task,
    poses_of,
)
from dlo_planner.view.scene import plan_primitives
from msg_helpers.poses import stamp_text
from msg_helpers.trajectories import plan_path

T = TypeVar('T')

# service -> type of the task that it plans; None: the last one, whatever it is
_SERVICES = {'plan': None, 'plan_threading': 'Thread', 'plan_insertion': 'Insert',
             'plan_hold_contact': 'HoldContact', 'plan_slide_contact': 'SlideContact',
             'plan_sequence': 'ThreadSequence'}
_ASKED = (*_SERVICES, 'plan_two_cutouts', 'replan', 'next_stage')
_HEARD = ('task', 'task_goal', 'task_goals')
_TERMINAL = 'a terminal'  # each command of ros2 is a node of its own
_BY_DEFAULT: Mapping[str, Any] = {'Thread': {'type': 'Thread'}, 'Insert': {'type': 'Insert'}}


class PlanningServer(Part):
    """Answers planning requests, one at a time; `prove` is called when there is a plan to prove.

    `arms` has the topics of the arms that a plan moves.
    """

    def __init__(self, shared: Shared, prove: Callable[[], object], arms: Arms, tasks: Any,
                 planning: Any) -> None:
        super().__init__(shared)
        self._prove, self._arms = prove, arms
        self._turn = Lock()        # one plan after the other
        self._job: list[str] | None = None  # the plan that is made: why it is not wanted any more
        self._ended = ''           # why none may begin
        node = self.node
        self._out = node.add_publisher(Path, '~/gripper_trajectory', LATCHED)
        for kind, name, callback in ((String, 'task', self._on_task),
                                     (PoseStamped, 'task_goal', self._on_goal),
                                     (Goals, 'task_goals', self._on_goals)):
            node.add_subscription(kind, f'~/{name}', callback, REQUEST, tasks)
        for name, kind in _SERVICES.items():
            node.add_service(GetPlan, f'~/{name}', partial(self._on_plan, name, kind), planning)
        node.add_service(GetPlan, '~/plan_two_cutouts', self._on_plan_two_cutouts, planning)
        node.add_service(Trigger, '~/replan', self._on_replan, planning)
        node.add_service(Trigger, '~/next_stage', self._on_next_stage, planning)

    def cancel(self, reason: str, for_good: bool = False) -> bool:
        """End the plan that is being made; return whether there was one."""
        self._ended = reason if for_good else self._ended
        job = self._job
        if job is not None:
            job.append(reason)
        return job is not None

    def allow(self) -> None:
        """Let plans begin again."""
        self._ended = ''

    def askers(self) -> frozenset[str]:
        """Return the names of the other nodes that can ask for plans now: who does is not told."""
        node, found = self.node, set[str]()
        doors = {node.resolve_service_name(f'~/{name}') for name in _ASKED}
        doors |= {node.resolve_topic_name(f'~/{name}') for name in _HEARD}
        seen = Counter(node.get_node_names_and_namespaces())
        for (name, namespace), number in seen.items():
            full = f'{namespace.rstrip("/")}/{name}'
            with suppress(NodeNameNonExistentError):  # it has gone
                opened = {door for door, _ in (
                    *node.get_client_names_and_types_by_node(name, namespace),
                    *node.get_publisher_names_and_types_by_node(name, namespace))}
                if full != node.get_fully_qualified_name() and opened & doors:
                    called = _TERMINAL if name.startswith('_ros2cli') else full
                    found |= {f'{called} ({k + 1})' if k else called for k in range(number)}
        return frozenset(found)

    # ---- requests ---------------------------------------------------------------------------

    def _on_task(self, msg: String) -> None:
        with self._answering('task', None) as outcome:
            content = open_task(msg.data)
            state = self.store.change(lambda now: now.opened(content))
            self._plan(outcome, state, self._closed(state, content, None, 'task'), state.gripper)

    def _on_goal(self, msg: PoseStamped) -> None:
        with self._answering('task_goal', msg.header.stamp) as outcome:
            state = self.store.state
            goal = self._pose(state, msg, 'task_goal')
            content = state.open_task() or state.scene.task
            self._plan(outcome, state, self._closed(state, content, goal, 'task_goal'),
                       state.gripper)

    def _on_goals(self, msg: Goals) -> None:
        with self._answering('task_goals', msg.header.stamp) as outcome:
            state = self.store.state
            goals = goals_in(state.scene, msg, 'task_goals', self.frames)
            self._plan(outcome, state, through(state.scene, goals), state.gripper)

    def _on_plan(self, name: str, kind: str | None, request: GetPlan.Request,
                 response: GetPlan.Response) -> GetPlan.Response:
        """Plan a task; where the frame of `start` or `goal` is empty, it is left out."""
        with self._answering(name, stamp_of(request.goal, request.start)) as outcome:
            state = self.store.state
            start, goal = (self._pose(state, msg, f'{name}.{field}') if msg.header.frame_id
                           else None for field, msg in (('start', request.start),
                                                        ('goal', request.goal)))
            content = state.open_task(kind) or _BY_DEFAULT.get(kind or '')
            if content is None:
                raise Refused(Cause.NO_GOAL, f'{name}: no {kind} is known: expected one on ~/task, '
                              f'or as parameter task, {{type: {kind}, ...}}')
            response.plan = self._plan(
                outcome, state, self._closed(state, content, goal, name), state.gripper
                if start is None else start.compose(state.scene.tool), tolerance_of(request, name))
        return response

    def _on_plan_two_cutouts(self, request: GetPlan.Request,
                             response: GetPlan.Response) -> GetPlan.Response:
        name = 'plan_two_cutouts'
        with self._answering(name, stamp_of(request.start, request.goal)) as outcome:
            state = self.store.state
            goals = [self._pose(state, msg, f'{name}.{field}') for field, msg in (
                ('start', request.start), ('goal', request.goal))]
            response.plan = self._plan(outcome, state, through(state.scene, goals),
                                       state.gripper, tolerance_of(request, name))
        return response

    def _on_replan(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._answering('replan', answer=response) as outcome:
            state = self.store.state
            if state.task is None:
                raise Refused(Cause.NO_GOAL, 'there is no task yet: send one to ~/task, or its '
                              'pose to ~/task_goal')
            self._plan(outcome, state, state.task, state.gripper)
        return response

    def _on_next_stage(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go on to the next stage of a plan: whoever asks has carried out what comes before."""
        with self._answering('next_stage', answer=response) as outcome:
            state = self.store.state
            made, proof = state.planned, state.proof
            if state.executing:
                raise Refused(Cause.EXECUTING, 'next_stage: a plan is being executed: expected its '
                              'end')
            if made is None or made.whole is None:
                raise Refused(Cause.NO_PLAN, 'next_stage: expected a plan in stages, as of a '
                              'ThreadInGrasps; ' + (state.no_plan if made is None else
                                                    f'this one of a {type(made.task).__name__} '
                                                    'has one stage'))
            if proof is None or not proof.safe:
                raise Refused(Cause.PROOF_PENDING if proof is None else proof.cause,
                              f'next_stage: {made.whole.stages[made.stage].name} is not proved: '
                              f'{"" if proof is None else proof.reason}')
            if made.following is None:
                raise Refused(Cause.NO_PLAN, 'next_stage: expected nothing more, '
                              f'{made.whole.stages[made.stage].name} is the last stage')
            stamp = self.node.get_clock().now().to_msg()
            following = replace(made.in_stage(made.following), stamp=stamp, asked=outcome.stamp)
            self._take(following, grasped=True)
            self.statistics.note({'plan stamp': stamp_text(stamp),
                                  **proof_figures(Proof(following.plan))})
            self._prove()
            outcome.message = f'{len(following.plan)} gripper poses{stage_said(following)}'
            outcome.values = {'plan stamp': stamp_text(stamp), **of_stage(following)}
        return response

    @contextmanager
    def _answering(self, what: str, stamp: Time | None = None,
                   answer: Any = None) -> Iterator[Outcome]:
        with self._turn, self.status.answering(what, stamp=stamp, answer=answer,
                                                  counter='plans refused') as outcome:
            yield outcome

    def _pose(self, state: State, msg: PoseStamped, name: str) -> Pose:
        return pose_in(state.scene, msg, name, self.frames)

    def _closed(self, state: State, content: Mapping[str, Any], goal: Pose | None,
                name: str) -> Task:
        """Return an open task in its place, which has to be within reach."""
        task = close_task(content, goal, state.scene.cutout_radius, name)
        for pose in poses_of(task):
            judge_distance(pose.position, state.scene, f'{name}: pose')
        return task

    # ---- the plan ---------------------------------------------------------------------------

    def _plan(self, outcome: Outcome, state: State, task: Task, start: Pose | None,
              miss: float | None = None) -> Path:
        """Plan, publish and return the trajectory of the tool frame as a Path."""
        self.store.change(lambda now: replace(now, task=task))
        begun, askers = monotonic(), self.askers()
        state.scene.refuse_self_contact(f'the plan of a {type(task).__name__}')
        if state.scene.grasped is None and task.held_inside:
            raise Refused(Cause.INVALID_PARAMETER, 'parameter rod.grasped_at = 0: expected '
                          f'{task.held_inside:g}, where the task says that the gripper holds the '
                          'DLO')
        held = state.holds_at(begun)
        if held and not task.takes_held:
            raise Refused(Cause.FAR_END_HELD, (
                'far_end_pose: the far end is held: expected far_end.hold = free, or no pose'
                if state.held_at(begun) is not None else
                f'the DLO is held by {", ".join(map(arm_of, held))}, as the last plan says: '
                'expected ~/reset when the gripper alone holds it')
                + f', for the plan of a {type(task).__name__}')
        plan, before = self._interruptible(
            state.scene['threading.planning_deadline'],
            lambda: explained(partial(make_plan, state.scene, task, start, state.shape, miss,
                                      held)))
        seconds = monotonic() - begun
        scene, stamp = state.scene, self.node.get_clock().now().to_msg()
        made = PlanResult.of(plan, scene, before, stamp, task, outcome.stamp,
                             askers | self.askers())
        path = self._take(made)
        self.markers.show('plan', scene.frame_id, stamp,
                          lambda: plan_primitives(plan, cutouts_of(task)))
        oblique = float(plan.misalignment.max())
        said = (f', misaligned by up to {np.rad2deg(oblique):.2g} degrees' if oblique > OBLIQUE
                else '')
        if np.isfinite(plan.clearance).any():
            said += f', smallest clearance {plan.clearance.min():.2g} m'
        if not np.isnan(plan.margin).all():
            said += f', smallest margin {least_known(plan.margin):.2g} m'
        figures = {
            'waypoints': len(plan), 'largest miss [m]': float(plan.position_error.max()),
            'largest misalignment [rad]': oblique,
            'smallest clearance [m]': float(plan.clearance.min()),
            'smallest margin [m]': least_known(plan.margin),
            'smallest bend margin [1/m]': float(plan.bend_margin.min()),
            'yield limit used': float(plan.yield_utilization.max()),
            'largest residual': float(plan.residual.max()),
            'smallest stability': float(plan.stability.min())}
        self.statistics.count('plans made')
        self.statistics.note({
            'plan stamp': stamp_text(stamp), 'plan time [ms]': 1e3 * seconds,
            **{f'plan {name}': value for name, value in figures.items()},
            **proof_figures(Proof(plan))})  # what was said of the plan before is over
        self._prove()
        outcome.message = f'{len(plan)} gripper poses{stage_said(made)}'
        outcome.values = {'task': type(task).__name__, 'plan stamp': stamp_text(stamp),
                          'seconds': seconds, **figures, **_of_plug(plan), **of_stage(made)}
        self.status.info(f'planned {len(plan)} gripper poses in {1e3 * seconds:.0f} ms, '
                         f'largest miss {plan.position_error.max():.1e} m, '
                         f'smallest stability {plan.stability.min():.2f}{said}')
        return path

    def _take(self, made: PlanResult, grasped: bool = False) -> Path:
        """Keep a plan, and publish and return its Path; `grasped`: what it begins with holds."""
        self.store.change(lambda now: (
            now.grasped(made.plan.shapes[0]) if grasped else now).with_plan(made))
        self._arms.take(made)
        path = tool_path(made)
        self._out.publish(path)
        return path

    def _interruptible(self, deadline: float, make: Callable[[], T]) -> T:
        """Return what `make` does, unless it is canceled or takes too long, s.

        Time in which the kernels of plans may still have to be compiled does not count.
        """
        steps, job = Progress(deadline=deadline), list[str]()

        def check() -> None:
            if job or self._ended:
                raise Refused(Cause.PLANNING_CANCELED, (*job, self._ended)[0])
            if self.node.loading.is_set():
                steps.begin()
            steps.check()

        self._job = job
        try:
            with interrupted_by(check):
                check()
                return make()
        except DeadlineExceeded as error:
            raise deadline_refusal(error) from None
        finally:
            self._job = None


# What refuses a passage because of the hole; a workspace or a bend is another demand.
_OF_THE_HOLE = Cause.INFEASIBLE, Cause.UNSTABLE, Cause.COLLISION


def explained(make: Callable[[], T]) -> T:
    """Return what `make` does; where that is infeasible, say what is known of why."""
    try:
        return make()
    except Infeasible as error:
        found = list[str]()
        with suppress(DloPlannerError):  # whoever has no more time for it hears the rest
            found.append(error.certificate)
            found.append(error.advice)
        known = '; '.join(filter(None, found))
        if not known:
            raise
        cause = cause_of(error)
        if error.advise is not None and cause in _OF_THE_HOLE:
            cause = Cause.NO_ROOM
        raise Refused(cause, f'{error}: {known}') from error


def least_known(numbers: Floats) -> float:
    """Return the least of numbers (n,) that are not nan; nan if all are."""
    known = numbers[~np.isnan(numbers)]
    return float(known.min()) if known.size else np.nan


def deadline_refusal(error: DeadlineExceeded) -> Refused:
    """Return in words of the node that planning took too long."""
    return Refused(Cause.PLANNING_DEADLINE, f'no plan was found in {error.elapsed:.3g} s: expected '
                   f'threading.planning_deadline = {error.seconds:g} s at most')


def tool_path(made: PlanResult) -> Path:
    """Return the plan as poses of the tool frame, each stamped with its time."""
    back = made.scene.tool.inverse()
    return plan_path([pose.compose(back) for pose in made.plan.grippers], made.plan.times,
                     made.scene.frame_id, made.stamp)


def make_plan(scene: Scene, task: Task, start: Pose | None, shape: Shape | None,
              miss: float | None = None,
              held: Holds = ()) -> tuple[Plan, Shape | None]:
    """Return the Plan of a task, and the Shape that it begins with, None: any.

    `held`: what holds the DLO now beside the gripper.
    """
    here = shape if shape is not None and start is not None and _same(shape.gripper, start) and (
        _held_same(shape.holds, held)) else None
    if held and here is None and start is not None:
        here = scene.direct.without_obstacles().track([start], initial=shape, holds=held)[0]
    plan = plan_task(scene.inverse, task, scene.values, start=start, initial=here, miss=miss)
    if len(plan) == 1:
        raise InvalidTask('start = None: expected the pose of the gripper now, where a plan of '
                          f'one pose, as of this {type(task).__name__}, begins')
    return plan, here if start is not None and _same(plan.grippers[0], start) else None


def _held_same(some: Holds, others: Holds) -> bool:
    """Whether the DLO is held by both in the same way."""
    return alike(some, others) and all(
        _same(one.pose, other.pose) for one, other in zip(some, others, strict=True))


def stage_said(made: PlanResult) -> str:
    """Return in words which stage a plan is of, and what is to be done after it; '' of a whole."""
    if made.whole is None:
        return ''
    then = ', then '.join(map(str, made.events)) or 'nothing'
    return (f', {made.whole.stages[made.stage].name}, stage {made.stage + 1} of '
            f'{len(made.whole.stages)}; then {then}')


def of_stage(made: PlanResult) -> dict[str, str | int]:
    """Return which stage a plan is of, and what opens and closes after it; nothing of a whole."""
    if made.whole is None:
        return {}
    values: dict[str, str | int] = {'stage': made.whole.stages[made.stage].name, 'stage number':
                                    made.stage + 1, 'stages': len(made.whole.stages)}
    for k, event in enumerate(made.events, start=1):
        pose = event.hold.pose
        values |= {f'event {k}': event.kind, f'event {k} arm': event.arm,
                   f'event {k} s [m]': 'tip' if event.hold.s is None else f'{event.hold.s:.6g}',
                   f'event {k} pose': ' '.join(f'{one:.6g}' for one in (
                       *pose.position.tolist(), *pose.quaternion.tolist()))}
    return values


def _of_plug(plan: Plan) -> dict[str, float]:
    """Return what a hand gives at its plug's front at most; nothing without one."""
    return {} if plan.plug is None else {
        'plug force [N]': float(np.nanmax(plan.plug_force)),
        'plug moment [N m]': float(np.nanmax(plan.plug_moment))}


def _same(one: Pose, other: Pose) -> bool:
    return np.allclose(one.matrix, other.matrix, atol=1e-9)


def through(scene: Scene, poses: Sequence[Pose]) -> Task:
    """Return the task that threads through cut-outs at some Poses, in their order."""
    return threading_of([CutOut(pose, radius=scene.cutout_radius) for pose in poses])


def stamp_of(one: PoseStamped, other: PoseStamped) -> Time:
    """Return the stamp of a request with two poses: of the first that has one."""
    stamp: Time = one.header.stamp
    return stamp if stamp.sec or stamp.nanosec else other.header.stamp


def tolerance_of(request: GetPlan.Request, name: str) -> float | None:
    """Return the tolerance of a request, m; None for 0."""
    if not 0 <= request.tolerance < np.inf:
        raise Refused(Cause.INVALID_REQUEST, f'{name}.tolerance = {request.tolerance:g}: expected '
                      'by how much a waypoint may miss its place, m, or 0 for any amount')
    return request.tolerance or None


def refuse_tolerance(request: GetPlan.Request, name: str) -> None:
    """Refuse a tolerance of a request that has no use for one."""
    if request.tolerance != 0:
        raise Refused(Cause.INVALID_REQUEST, f'{name}.tolerance = {request.tolerance:g}: expected '
                      '0, nothing is planned')
