# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is executed: streamed, alone or in a closed loop."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Lock
from time import monotonic
from typing import Any, cast

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.srv import GetPlan
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from dlo_planner.arm.joint_stream import JointPoints
from dlo_planner.errors import DeadlineExceeded, DloPlannerError, InvalidTask
from dlo_planner.execute.causes import Cause, Refused, cause_of
from dlo_planner.execute.execution import LEAD, Ahead, Execution
from dlo_planner.execute.guards import Enabled
from dlo_planner.execute.loop_motions import Entry, GripperMotion, LoopTask
from dlo_planner.execute.pull import Pull
from dlo_planner.execute.task_loop import TaskLoop
from dlo_planner.identify.closed_loop import Phase
from dlo_planner.identify.estimator import DloEstimator
from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.thread_sequence import cutouts_of
from dlo_planner.model.pose import Pose
from dlo_planner.plan.stage import arm_of
from dlo_planner.ros.arm import ArmDrive, ArmOutput
from dlo_planner.ros.arms import Arms
from dlo_planner.ros.lifecycle import LATCHED, REQUEST
from dlo_planner.ros.plan import (
    PlanningServer,
    deadline_refusal,
    of_stage,
    refuse_tolerance,
    stage_said,
    tool_path,
)
from dlo_planner.ros.state import Looking, PlanResult, State, Store
from dlo_planner.ros.status import Part, Shared, Statistics
from dlo_planner.ros.worker import Worker, persistent
from dlo_planner.settings.tasks import STANDOFF, held_as_stated
from dlo_planner.view.scene import axes_primitives
from msg_helpers.diagnostics import OK, WARN, status_msg
from msg_helpers.poses import pose_stamped_msg, stamp_text, wrench_in, wrench_msg
from msg_helpers.trajectories import joint_points_msg, poses_ahead

MISS_EXPECTED = 'miss expected at most [m]'  # of the cut-out in motion, 95 %


def loop_task_of(made: PlanResult) -> LoopTask | None:
    """Return the task of a plan for the closed loop, or None: it has none, or its room is unknown.

    One that a closed loop serves: cut-outs, a bore, a contact.
    """
    try:
        return _loop_task(made)
    except InvalidTask:
        return None


def _loop_task(made: PlanResult) -> LoopTask:
    """Return the task of a plan for the closed loop; raise InvalidTask, which says why not."""
    plan, scene = made.plan, made.scene
    if plan.shapes[0].holds:
        raise InvalidTask(f'the DLO is held by {", ".join(map(arm_of, plan.shapes[0].holds))} '
                          'besides the gripper: what is seen corrects a DLO that the gripper '
                          'alone holds')
    task = held_as_stated(made.task, scene['rod.grasped_at'])
    far, given = STANDOFF * scene.direct.rod.length, scene['threading.standoff']
    if task.outwards is not None:
        if not scene['contacts.tolerance']:
            raise InvalidTask('parameter contacts.tolerance = 0: expected by how much the DLO may '
                              f'miss the place that it touches in a {type(task).__name__}, m')
        return LoopTask(scene.inverse, task, given if given > 0 else far, scene.limits,
                        scene['contacts.tolerance'])
    passing = [bool(passes) for passes in plan.via_points]
    depths = np.unique(plan.depths[passing])  # a bore takes over a mass in several waypoints
    if task.deepest is None or not depths.size:
        raise InvalidTask(f'{type(task).__name__} passes no cut-out or bore, and touches nothing')
    if depths[0] > 0:  # the way to the entry ends there, where nothing passes yet
        depths = np.append(0.0, depths)
    first = cutouts_of(task)[0]
    stops = [first.normal @ (first.center - plan.shapes[k].positions[-1]) for k in plan.stops
             if not passing[k]]
    standoff = given if given > 0 else float(max(stops, default=0.0)) or far
    # refuses what has no room
    again: Task = replace(cast('Any', task), depths=depths, **task.replanned)
    return LoopTask(scene.inverse, again, standoff, scene.limits).of_plan(plan)


def closed_loop_of(state: State, observing: DloEstimator | None, worker: Worker,
                   arm: ArmDrive | None = None) -> ClosedLoopDrive | None:
    """Return what carries out the plan that was started in a closed loop, or None: it cannot.

    `observing` is of the DLO as stated, None where nobody looks; `worker` plans; `arm` is what
    leads the joints, None where poses are commanded.
    """
    made, execution, scene = state.running, state.execution, state.scene
    if observing is None or not observing.seeing.correct or made is None or execution is None:
        return None
    task = loop_task_of(made)
    if task is None or state.feedback is None:
        return None
    tool = made.scene.tool
    loop = TaskLoop(task, observing, state.feedback.pose.compose(tool), tool=tool,
                         guards=execution.guards, limits=execution.limits,
                         period=execution.period, horizon=execution.horizon,
                         frame_id=execution.frame_id, heard_after=LEAD if arm else 0.0)
    return ClosedLoopDrive(loop, worker, scene['threading.planning_deadline'], arm)


def open_loop_warning(state: State, observing: DloEstimator | None) -> str:
    """Return in words why what is seen of the DLO does not correct what is executed, '' if it does.

    `observing` as for `closed_loop_of`.
    """
    made = state.running
    if not state.scene.seeing.correct or made is None:
        return ''
    try:
        _loop_task(made)
    except InvalidTask as error:
        return '' if observing is None else (
            f'in open loop: what is seen of the DLO does not correct it: {error}')
    return '' if observing is not None else (
        'in open loop: no cloud of the DLO was taken in on ~/observed_points shortly before, so '
        'that it is neither observed before the cut-out nor corrected')


def unwatched(state: State) -> str:
    """Return in words that nobody measures what the fittings of a plan are to bear; '' if one does.

    Or if they say nothing of it.
    """
    watches = state.scene.guards.pull_time > 0.0
    if (state.running is None or watches and state.pull is not None
            or np.isinf(state.running.pulls_borne).all()):
        return ''
    why = 'no force came on ~/measured_wrench lately' if watches else 'constraints.pull_time = 0'
    return f'{why}: that no fitting is overloaded is known of the plan alone'


class ClosedLoopDrive:
    """Ticks a TaskLoop, has its work done, and keeps the State as it stands.

    Who ends what is executed does so in the State; the next tick tells the loop.
    """

    def __init__(self, loop: TaskLoop, worker: Worker, deadline: float,
                 arm: ArmDrive | None = None) -> None:
        self._loop, self._worker, self._deadline, self._arm = loop, worker, deadline, arm
        self._lock = Lock()  # around the loop
        self._known: Execution | None = None  # what the State was told
        self._last: Execution | None = None   # of the loop, whose command went out
        self._computing: Callable[[], Any] | None = None
        self._aimed: Any = None
        self._failed = False  # whether a tick has

    def begun(self, state: State) -> State:
        """Return the State in which it waits for the first look."""
        assert state.execution is not None  # it was started
        self._known = replace(state.execution, phase='waiting',
                              published_until=state.execution.done)
        return replace(state, execution=self._known, looking=Looking())

    def tick(self, store: Store, statistics: Statistics, now: float,
             stamp: float) -> Execution | None:
        """Go on, at `now` s, `stamp` s on the stamps' clock; return what the State knows of it."""
        state = store.state
        with self._lock:
            execution = self._ticked(state, now, stamp)
            loop = self._loop
            looking = Looking(loop.phase.value, loop.tries, loop.miss_bound_95)
            work = loop.work
            if loop.aimed is not None and loop.aimed is not self._aimed:
                self._aimed = loop.aimed
                statistics.corrected(loop.aimed.correction, loop.refusal)
        if np.isfinite(looking.miss_bound_95):
            statistics.note({MISS_EXPECTED: looking.miss_bound_95})
        if work is not None and work is not self._computing:
            self._computing = work
            threading.Thread(target=self._compute, args=(work,), name='closed loop',
                             daemon=True).start()
        self._known = execution
        known = store.change(
            lambda now: now.after_loop_tick(state.execution, execution, looking)).execution
        # what was stopped meanwhile has the command before: out goes what the loop knows to go out
        return known and replace(known, sending=execution.sending, ahead=execution.ahead)

    def _ticked(self, state: State, now: float, stamp: float) -> Execution:
        loop, known = self._loop, state.execution
        assert known is not None and self._known is not None  # it was begun
        if known is not self._known and known.cause:
            loop.stop(stamp, known.cause, known.reason, known.phase == 'stopped')
            if loop.cause == known.cause:  # of which more may be known by now
                loop.reason = known.reason
        if state.feedback is not None:
            loop.gripper(state.feedback)
        try:
            loop.tick(stamp, now, state.enabled)
        except Exception as error:
            if self._failed:  # not even coming to rest works: what was sent ahead ends at rest
                loop.end(stamp, cause_of(error), str(error))
            loop.stop(stamp, cause_of(error), str(error))
            self._failed = True
            if not isinstance(error, DloPlannerError):
                raise
        execution = loop.execution or loop.last or self._known
        if execution is self._last:  # nothing new goes out
            execution = replace(execution, sending=None)
        self._last = loop.last
        if loop.phase is Phase.DONE:
            return replace(execution, phase='succeeded', cause=Cause.DONE, reason='')
        if loop.phase is Phase.STOP:
            return replace(execution, phase='stopped', cause=loop.cause, reason=loop.reason)
        if loop.execution is None:  # it stands, and will go on
            return replace(execution, phase='waiting', cause=Cause.DONE, reason='')
        if execution.phase == 'stopping' and not loop.cause:  # to go back: what cancels it stops it
            return replace(execution, phase='running', cause=Cause.DONE, reason='')
        if loop.cause:  # of several reasons the first one
            return replace(execution, cause=loop.cause, reason=loop.reason)
        return execution

    def _compute(self, work: Callable[[], Any]) -> None:
        def wanted() -> bool:
            return self._loop.work is work

        try:
            result = persistent(partial(self._worker.result, work, wanted, self._deadline))
            self._judge(result)
        except DeadlineExceeded as error:
            result = deadline_refusal(error)
        except Exception as error:  # whatever it is, the loop has to end by it
            result = error
        if result is not None:  # it is still wanted
            with self._lock:
                self._loop.finish(work, result)


    def _judge(self, result: Any) -> None:
        """Refuse a motion that the joints of the arm cannot follow."""
        motion = result.motion if isinstance(result, Entry) else result
        if self._arm is not None and isinstance(motion, GripperMotion):
            self._arm.judge(motion.corrected_trajectory)


_TOLD = 0.2      # s between messages on ~/execution
_LAG = 0.1       # s by which a robot may follow late
_COMMAND = 0.1   # m, axes of the command: longer than those of the gripper


class TrajectoryStreamer(Part):
    """Streams what is executed.

    `cancel` ends the `planning` as well. `observing` takes a Time and returns the DloEstimator of
    the DLO if it was looked at shortly before, or None; `worker` plans for a closed loop; `arm`
    knows the arm whose joints may be told, `arms` tells those besides the gripper.
    """

    def __init__(self, shared: Shared, planning: PlanningServer,
                 observing: Callable[[Time], DloEstimator | None], worker: Worker, arm: ArmOutput,
                 arms: Arms, commands: Any, control: Any) -> None:
        super().__init__(shared)
        node = self.node
        self._arms = arms
        self._planning, self._observing, self._worker = planning, observing, worker
        self._arm = arm
        self._drive: ArmDrive | None = None  # what leads its joints, where they are told
        self._loop: ClosedLoopDrive | None = None  # that carries out what is executed
        # of the request; when ~/execution was published, and of which phase
        self._stamp, self._told, self._told_of = None, -1.0, ''
        self._finished = True  # whether its end was told
        self._ahead: Ahead | None = None  # what of the coming time was told last
        self._command_out = node.add_publisher(PoseStamped, '~/gripper_command', REQUEST)
        self._ahead_out = node.add_publisher(MultiDOFJointTrajectory, '~/gripper_commands_ahead',
                                             REQUEST)
        self._joints_out = node.add_publisher(JointTrajectory, '~/joint_commands_ahead', REQUEST)
        self._wrench_out = node.add_publisher(WrenchStamped, '~/gripper_command_wrench', REQUEST)
        self._out = node.add_publisher(DiagnosticStatus, '~/execution', LATCHED)
        node.add_newest(Bool, '~/enable', self._on_enable)
        node.add_newest(WrenchStamped, '~/measured_wrench', self._on_wrench)
        node.add_service(Trigger, '~/execute', self._on_execute, commands)
        node.add_service(GetPlan, '~/execute_plan', self._on_execute_plan, commands)
        node.add_service(Trigger, '~/cancel', self._on_cancel, control)
        self._timer = node.add_timer(self.store.state.scene.period, self._command, commands)
        self._timer.cancel()  # it runs while something is executed

    def announce(self) -> None:
        """Publish how the execution stands: the node begins to act."""
        self._tell(self.store.state.execution)

    def stop(self, cause: Cause, reason: str) -> None:
        """Let what is executed come to rest, if anything is."""
        self.store.change(lambda state: state.stopped(cause, reason))

    @property
    def at_rest(self) -> bool:
        """Whether nothing is executed, and the end of what was is told."""
        return self._finished

    def _on_execute(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._execute(None, response)
        return response

    def _on_execute_plan(self, request: GetPlan.Request,
                         response: GetPlan.Response) -> GetPlan.Response:
        made = self._execute(request.start.header.stamp, request=request)
        if made is not None:
            response.plan = tool_path(made)
        return response

    def _execute(self, wanted: Time | None, answer: Any = None,
                 request: GetPlan.Request | None = None) -> PlanResult | None:
        """Execute the last plan, if it is the one that is meant; return it, or None."""
        now, asked = self.node.get_clock().now().to_msg(), request and request.goal.header.stamp
        stamp = asked if asked and (asked.sec or asked.nanosec) else now
        with self.status.answering('execute', stamp=stamp, answer=answer) as outcome:
            if request is not None:
                refuse_tolerance(request, 'execute_plan')
            observing = self._observing(now)
            loops: list[ClosedLoopDrive | None] = []
            askers, scene = self._planning.askers(), self.store.state.scene
            by_joints = scene.by_joints and not self.store.state.executing
            drive = self._arm.drive(scene) if by_joints else None
            if drive is not None and not self._joints_out.get_subscription_count():
                raise Refused(Cause.ARM, f'nobody hears {self._joints_out.topic_name}: expected '
                              'it to be remapped to the topic of the joint_trajectory_controller, '
                              'as planner.launch.py does by controller:=')

            def started(now: State) -> State:
                now = now.started(monotonic(), wanted, askers)
                assert now.execution is not None  # it was started
                loops[:] = [closed_loop_of(now, observing, self._worker, drive)]
                if drive is not None:
                    drive.judge(now.execution.way, now.execution.begin)
                return now if loops[0] is None else loops[0].begun(now)

            state = self.store.change(started)
            self._loop, self._drive = loops[0], drive
            if drive is not None and self._loop is not None:  # it looks first, at rest
                self._lead(drive, drive.stream.resting(1e-9 * self._now))
            self._stamp, self._told, self._finished = stamp, -1.0, False
            self._ahead = None
            self._timer.reset()
            execution, scene = state.execution, state.scene
            assert execution is not None and state.running is not None  # it was started
            duration = execution.way.duration - execution.begin
            where = 'gripper_commands_ahead and ' if execution.horizon else ''
            where = f'{where}gripper_command' if drive is None else 'joint_commands_ahead'
            outcome.message = f'{duration:.1f} s on {where}' + (
                '' if self._loop is None else ', or longer: it observes the DLO before it goes')
            assert state.proof is not None and state.proof.report is not None  # it was proved
            outcome.warning = '; '.join(filter(None, (
                open_loop_warning(state, observing), unwatched(state), state.proof.report.reason)))
            outcome.values = {'duration [s]': duration, 'arms': ', '.join(
                one.name for one in execution.arms), 'plan stamp': stamp_text(state.running.stamp)}
            speed, tolerance = scene.limits.linear_speed, scene.guards.path_position
            if tolerance and tolerance < speed * _LAG:
                self.status.warn('lag', f'constraints.path.position = {tolerance:g} m is less '
                                    f'than a robot lags that follows {_LAG:g} s late at '
                                    f'threading.linear_speed = {speed:g} m/s')
            return state.running
        return None

    def _on_enable(self, msg: Bool) -> None:
        with self.status.answering('enable', told=False):
            enabled = Enabled(msg.data, monotonic())
            self.store.change(lambda state: state.with_enabled(enabled))

    def _on_wrench(self, msg: WrenchStamped) -> None:
        with self.status.answering('measured_wrench', told=False):
            force = msg.wrench.force
            heard = Pull(float(np.linalg.norm((force.x, force.y, force.z))), monotonic())
            if not np.isfinite(heard.force):
                raise Refused(Cause.INVALID_REQUEST, 'measured_wrench.wrench.force = '
                              f'{[force.x, force.y, force.z]}: expected finite numbers, N')
            self.store.change(lambda state: state.with_pull(heard))

    def _on_cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self.status.answering('cancel', answer=response) as outcome:
            planning = self._planning.cancel('canceled')
            before = self.store.state
            executing, proving = before.executing, before.proving and not before.executing
            self.store.change(State.canceled)
            if not (planning or executing or proving):
                raise Refused(Cause.NOTHING_TO_CANCEL, 'nothing was planned, proved or executed')
            outcome.message = ' and '.join(
                ['the execution comes to rest'] * executing + ['the planning ends'] * planning
                + ['the proof ends'] * proving)
        return response

    def _command(self) -> None:
        with self.status.answering('command', told=False):
            if self._finished:
                return
            before = self.store.state.execution
            now, stamp = monotonic(), 1e-9 * self._now
            if self._loop is None:
                execution = self.store.change(lambda state: state.after_tick(now, stamp)).execution
            else:
                execution = self._loop.tick(self.store, self.statistics, now, stamp)
            if before is None or execution is None:
                return
            self._send_ahead(execution)
            if execution.sending is not None and execution is not before:
                self._send(execution, execution.sending)
            if execution.phase != self._told_of or monotonic() - self._told >= _TOLD:
                self._tell(execution)
            if not execution.active:
                self._end(execution)

    def _send_ahead(self, execution: Execution) -> None:
        """Tell the robot the coming time, if that is not what it was told last."""
        if execution.ahead is None or execution.ahead is self._ahead or not execution.active:
            return
        self._ahead = execution.ahead
        assert execution.stamp is not None  # there was a tick
        if self._drive is not None:
            try:
                points = self._drive.told(execution)
            except Refused as refused:  # what was told before holds, and ends at rest
                self.stop(refused.cause, str(refused))
            else:
                self._lead(self._drive, points)
            return
        self._ahead_out.publish(poses_ahead(
            *execution.ahead, execution.frame_id, execution.stamp, {
                one.name: one.ahead.poses for one in execution.others if one.ahead is not None}))

    @property
    def _now(self) -> int:
        nanoseconds: int = self.node.get_clock().now().nanoseconds
        return nanoseconds

    def _lead(self, drive: ArmDrive, points: JointPoints | None) -> None:
        """Tell the joints of the arm, if there is anything new."""
        if points is not None:
            self._joints_out.publish(joint_points_msg(drive.arm.joints, points))

    def _send(self, execution: Execution, command: Pose) -> None:
        stamp, tool = self.node.get_clock().now().to_msg(), self.store.state.scene.tool
        if self._drive is None:
            self._command_out.publish(pose_stamped_msg(command, execution.frame_id, stamp))
        self._arms.send(execution, stamp)
        self._send_wrench(execution, command, stamp)
        self.markers.show('command', execution.frame_id, stamp, lambda: axes_primitives(
            'command', command.compose(tool), _COMMAND))

    def _send_wrench(self, execution: Execution, command: Pose, stamp: Time) -> None:
        """Publish what the DLO does to the gripper there by the plan; a loop goes its own way."""
        made, scene = self.store.state.running, self.store.state.scene
        if made is None or self._loop is not None:
            return
        led = execution if execution.single is None else execution.single
        planned, = made.plan.gripper_wrench_at(execution.way.progress([max(led.done, 0.0)]))
        self._wrench_out.publish(wrench_msg(wrench_in(
            command, command.compose(scene.tool), -planned), scene['tool.frame_id'], stamp))

    def _end(self, execution: Execution) -> None:
        self._finished = True
        self._timer.cancel()
        if execution.ends_at_once:
            assert execution.command is not None and execution.stamp is not None  # it ran
            if self._drive is not None:
                self._lead(self._drive, self._drive.halted(execution))
            else:
                self._ahead_out.publish(poses_ahead(
                    [0.0], [execution.command], execution.frame_id, execution.stamp, {
                        one.name: [one.command] for one in execution.others
                        if one.command is not None}))
        self.markers.hide('command')
        looking, made = self.store.state.looking, self.store.state.running
        self._loop, values = None, progress(execution)
        if execution.cause == Cause.DONE:
            reason = f'executed: {execution.way.duration - execution.begin:.1f} s'
            if made is not None:
                self._arms.show(made.plan.shapes[-1].holds, made.scene.frame_id,
                                self.node.get_clock().now().to_msg())
                reason, values = reason + stage_said(made), values | of_stage(made)
            if looking is not None:
                reason += f', expected to miss by {looking.miss_bound_95:.3g} m at most (95 %)'
            self.status.info(reason)
        else:
            seconds = execution.done - execution.begin
            reason = f'the execution stopped after {seconds:.2f} s of its way: {execution.reason}'
            self.statistics.note({'report': 'void', 'report reason': execution.reason})
            self.status.failed('execute', execution.cause, reason)
        self.status.tell('execute', execution.cause, reason, self._stamp, values)

    def _tell(self, execution: Execution | None) -> None:
        self._told, self._told_of = monotonic(), '' if execution is None else execution.phase
        name, state = f'{self.node.known_as}: execution', self.store.state
        level, message, values = described(execution, state.looking)
        self._out.publish(status_msg(name, state.scene['rod.name'], level, message, values))


def described(execution: Execution | None,
              looking: Looking | None = None) -> tuple[bytes, str, dict[str, Any]]:
    """Return level, message and values of an Execution for diagnostics."""
    if execution is None:
        return OK, 'nothing was executed yet', {'state': 'idle', 'code': 0, 'cause': 'DONE'}
    loop = {} if looking is None else {
        'loop': looking.phase, 'tries': looking.tries, 'expected miss [m]': looking.miss_bound_95}
    good = execution.cause in (Cause.DONE, Cause.CANCELED)
    return (OK if good else WARN, execution.reason or execution.phase, {
        'state': execution.phase, 'code': int(execution.cause), 'cause': execution.cause.name,
        'reason': execution.reason or 'none', **progress(execution), **loop})


def progress(execution: Execution) -> dict[str, Any]:
    """Return how far an Execution has come."""
    duration, done = (time - execution.begin for time in (execution.way.duration, execution.done))
    return {'done [s]': done, 'duration [s]': duration,
            'progress [%]': 100 * done / duration if duration else 100.0}
