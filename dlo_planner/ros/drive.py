# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The last plan is executed: streamed in real time, watched, and ended with a reason."""

from collections.abc import Callable
from time import monotonic
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from dlo_planner.execute.ahead import Ahead
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.execution import Execution
from dlo_planner.execute.guards import Enabled
from dlo_planner.identify.observing import Observing
from dlo_planner.model.pose import Pose
from dlo_planner.ros.closed import ClosedLoopDrive, closed_loop_of, not_looked_at
from dlo_planner.ros.gate import Gate
from dlo_planner.ros.health import stamp_text
from dlo_planner.ros.parts import Parts
from dlo_planner.ros.plan import Planning, refuse_tolerance
from dlo_planner.ros.qos import LATCHED, LATEST, REQUEST
from dlo_planner.ros.state import Looking, Made, State
from dlo_planner.ros.worker import Worker
from msg_helpers.diagnostics import OK, WARN, status_msg
from msg_helpers.markers import command_markers
from msg_helpers.paths import plan_path
from msg_helpers.poses import pose_stamped_msg
from msg_helpers.trajectories import poses_ahead

_TOLD = 0.2      # s between messages on ~/execution
_LAG = 0.1       # s by which a robot may follow late


class Drive:
    """Streams what is executed.

    Parameters
    ----------
    node : Gate
        Rclpy Node.
    parts : Parts
    planning : Planning
        Planning, which `cancel` ends as well.
    observing : callable
        Takes a Time, returns the Observing of the DLO if it was looked at shortly before; or None.
    worker : Worker
        Plans for a closed loop.
    clock : object
        Steady Clock.
    moving, canceling : object
        Callback groups: `cancel` waits for no command.
    """

    def __init__(self, node: Gate, parts: Parts, planning: Planning,
                 observing: Callable[[Time], Observing | None], worker: Worker, clock: Any,
                 moving: Any, canceling: Any) -> None:
        self._node, self._store, self._planning = node, parts.store, planning
        self._reporter, self._health = parts.reporter, parts.health
        self._picture = parts.picture
        self._observing, self._worker = observing, worker
        self._loop: ClosedLoopDrive | None = None  # that carries out what is executed
        # of the request; when ~/execution was published, and of which phase
        self._stamp, self._told, self._told_of = None, -1.0, ''
        self._finished = True  # whether its end was told
        self._ahead: Ahead | None = None  # what of the coming time was told last
        self._command_out = node.create_publisher(PoseStamped, '~/gripper_command', REQUEST)
        self._ahead_out = node.create_publisher(MultiDOFJointTrajectory,
                                                '~/gripper_commands_ahead', REQUEST)
        self._out = node.create_publisher(DiagnosticStatus, '~/execution', LATCHED)
        node.create_service(Trigger, '~/execute', self._on_execute, callback_group=moving)
        node.create_service(GetPlan, '~/execute_plan', self._on_execute_plan,
                            callback_group=moving)
        node.create_subscription(Bool, '~/enable', self._on_enable, LATEST,
                                 callback_group=canceling)
        node.create_service(Trigger, '~/cancel', self._on_cancel, callback_group=canceling)
        self._timer = node.create_timer(parts.store.state.scene.period, self._command,
                                        callback_group=moving, clock=clock)
        self._timer.cancel()  # it runs while something is executed

    def announce(self) -> None:
        """Publish how the execution stands: the node begins to act."""
        self._tell(self._store.state.execution)

    def stop(self, cause: Cause, reason: str) -> None:
        """Let what is executed come to rest, if anything is."""
        self._store.change(lambda state: state.stopped(cause, reason))

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
            back, plan = made.scene.tool.inverse(), made.plan
            response.plan = plan_path([pose.compose(back) for pose in plan.grippers], plan.times,
                                      made.scene.frame_id, made.stamp)
        return response

    def _execute(self, wanted: Time | None, answer: Any = None,
                 request: GetPlan.Request | None = None) -> Made | None:
        """Execute the last plan, if it is the one that is meant; return it, or None."""
        now, asked = self._node.get_clock().now().to_msg(), request and request.goal.header.stamp
        stamp = asked if asked and (asked.sec or asked.nanosec) else now
        with self._reporter.answering('execute', stamp=stamp, answer=answer) as outcome:
            if request is not None:
                refuse_tolerance(request, 'execute_plan')
            observing = self._observing(now)
            loops: list[ClosedLoopDrive | None] = []

            def started(now: State) -> State:
                now = now.started(monotonic(), wanted)
                loops[:] = [closed_loop_of(now, observing, self._worker)]
                return now if loops[0] is None else loops[0].begun(now)

            state = self._store.change(started)
            self._loop = loops[0]
            self._stamp, self._told, self._finished = stamp, -1.0, False
            self._ahead = None
            self._timer.reset()
            execution, scene = state.execution, state.scene
            assert execution is not None and state.running is not None  # it was started
            duration = execution.way.duration - execution.begin
            where = 'gripper_commands_ahead and ' if execution.horizon else ''
            outcome.message = f'{duration:.1f} s on {where}gripper_command' + (
                '' if self._loop is None else ', or longer: it looks before it goes')
            outcome.warning = not_looked_at(state, observing)
            outcome.values = {'duration [s]': duration,
                              'plan stamp': stamp_text(state.running.stamp)}
            speed, tolerance = scene.limits.linear_speed, scene.guards.path_position
            if tolerance and tolerance < speed * _LAG:
                self._reporter.warn('lag', f'constraints.path.position = {tolerance:g} m is less '
                                    f'than a robot lags that follows {_LAG:g} s late at '
                                    f'threading.linear_speed = {speed:g} m/s')
            return state.running
        return None

    def _on_enable(self, msg: Bool) -> None:
        with self._reporter.answering('enable', told=False):
            enabled = Enabled(msg.data, monotonic())
            self._store.change(lambda state: state.allowing(enabled))

    def _on_cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._reporter.answering('cancel', answer=response) as outcome:
            planning = self._planning.cancel('canceled')
            before = self._store.state
            executing, proving = before.executing, before.proving and not before.executing
            self._store.change(State.canceled)
            if not (planning or executing or proving):
                raise Refused(Cause.NOTHING_TO_CANCEL, 'nothing was planned, proved or executed')
            outcome.message = ' and '.join(
                ['the execution comes to rest'] * executing + ['the planning ends'] * planning
                + ['the proof ends'] * proving)
        return response

    def _command(self) -> None:
        with self._reporter.answering('command', told=False):
            if self._finished:
                return
            before = self._store.state.execution
            now, stamp = monotonic(), 1e-9 * self._node.get_clock().now().nanoseconds
            if self._loop is None:
                execution = self._store.change(lambda state: state.ticked(now, stamp)).execution
            else:
                execution = self._loop.tick(self._store, self._health, now, stamp)
            if before is None or execution is None:
                return
            self._send_ahead(execution)
            if execution.sending is not None and execution is not before:
                self._send(execution.sending, execution.frame_id)
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
        self._ahead_out.publish(poses_ahead(*execution.ahead, execution.frame_id,
                                            execution.stamp))

    def _send(self, command: Pose, frame_id: str) -> None:
        stamp, tool = self._node.get_clock().now().to_msg(), self._store.state.scene.tool
        self._command_out.publish(pose_stamped_msg(command, frame_id, stamp))
        self._picture.show('command', lambda: (command_markers(command.compose(tool), frame_id,
                                                               stamp),))

    def _end(self, execution: Execution) -> None:
        self._finished = True
        self._timer.cancel()
        if execution.ends_at_once:
            assert execution.command is not None and execution.stamp is not None  # it ran
            self._ahead_out.publish(poses_ahead([0.0], [execution.command], execution.frame_id,
                                                execution.stamp))
        self._picture.show('command')
        looking = self._store.state.looking
        self._loop = None
        if execution.cause == Cause.DONE:
            reason = f'executed: {execution.way.duration - execution.begin:.1f} s'
            if looking is not None:
                reason += f', expected to miss by {looking.promised:.3g} m at most (95 %)'
            self._reporter.info(reason)
        else:
            seconds = execution.done - execution.begin
            reason = f'the execution stopped after {seconds:.2f} s of its way: {execution.reason}'
            self._health.plan_void(execution.reason)
            self._reporter.failed('execute', execution.cause, reason)
        self._reporter.tell('execute', execution.cause, reason, self._stamp,
                            progress(execution))

    def _tell(self, execution: Execution | None) -> None:
        self._told, self._told_of = monotonic(), '' if execution is None else execution.phase
        name, state = f'{self._node.get_name()}: execution', self._store.state
        level, message, values = described(execution, state.looking)
        self._out.publish(status_msg(name, state.scene.name, level, message, values))


def described(execution: Execution | None,
              looking: Looking | None = None) -> tuple[bytes, str, dict[str, Any]]:
    """Return level, message and values of an Execution for diagnostics."""
    if execution is None:
        return OK, 'nothing was executed yet', {'state': 'idle', 'code': 0, 'cause': 'DONE'}
    loop = {} if looking is None else {
        'loop': looking.phase, 'tries': looking.tries, 'expected miss [m]': looking.promised}
    good = execution.cause in (Cause.DONE, Cause.CANCELED)
    return (OK if good else WARN, execution.reason or execution.phase, {
        'state': execution.phase, 'code': int(execution.cause), 'cause': execution.cause.name,
        'reason': execution.reason or 'none', **progress(execution), **loop})


def progress(execution: Execution) -> dict[str, Any]:
    """Return how far an Execution has come."""
    duration, done = (time - execution.begin for time in (execution.way.duration, execution.done))
    return {'done [s]': done, 'duration [s]': duration,
            'progress [%]': 100 * done / duration if duration else 100.0}
