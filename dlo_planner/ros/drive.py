# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The last plan is executed: streamed in real time, watched, and ended with a reason."""

from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from dlo_planner.model.pose import Pose
from dlo_planner.ros.ahead import coming
from dlo_planner.ros.causes import Cause, Refused
from dlo_planner.ros.execution import Execution
from dlo_planner.ros.gate import Gate
from dlo_planner.ros.parts import Parts
from dlo_planner.ros.qos import LATCHED, REQUEST
from dlo_planner.ros.requests import Planning
from dlo_planner.ros.state import State
from msg_helpers.diagnostics import OK, WARN, status_msg
from msg_helpers.markers import command_markers
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
    clock : object
        Steady Clock.
    moving, canceling : object
        Callback groups: `cancel` waits for no command.
    """

    def __init__(self, node: Gate, parts: Parts, planning: Planning, clock: Any,
                 moving: Any, canceling: Any) -> None:
        self._node, self._store, self._planning = node, parts.store, planning
        self._reporter, self._health = parts.reporter, parts.health
        self._picture = parts.picture
        self._stamp, self._told = None, -1.0  # of the request; when ~/execution was published
        self._finished = True  # whether its end was told
        self._ahead: tuple[int, str] | None = None  # what of the coming time was told last
        self._command_out = node.create_publisher(PoseStamped, '~/gripper_command', REQUEST)
        self._ahead_out = node.create_publisher(MultiDOFJointTrajectory,
                                                '~/gripper_commands_ahead', REQUEST)
        self._out = node.create_publisher(DiagnosticStatus, '~/execution', LATCHED)
        node.create_service(Trigger, '~/execute', self._on_execute, callback_group=moving)
        node.create_service(Trigger, '~/cancel', self._on_cancel, callback_group=canceling)
        node.create_timer(parts.store.state.scene.period, self._command, callback_group=moving,
                          clock=clock)

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
        stamp = self._node.get_clock().now().to_msg()
        with self._reporter.answering('execute', stamp=stamp, answer=response) as outcome:
            state = self._store.change(lambda state: state.started(monotonic()))
            self._stamp, self._told, self._finished = stamp, -1.0, False
            self._ahead = None
            assert state.execution is not None  # it was started
            duration = state.execution.way.duration
            outcome.message = f'{duration:.1f} s on gripper_command'
            outcome.values = {'duration [s]': duration}
            speed, tolerance = state.scene.limits.linear_speed, state.scene.guards.path_position
            if tolerance and tolerance < speed * _LAG:
                self._reporter.warn('lag', f'constraints.path.position = {tolerance:g} m is less '
                                    f'than a robot lags that follows {_LAG:g} s late at '
                                    f'threading.linear_speed = {speed:g} m/s')
        return response

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
            execution = self._store.change(lambda state: state.ticked(
                monotonic(), 1e-9 * self._node.get_clock().now().nanoseconds)).execution
            if before is None or execution is None:
                return
            self._send_ahead(execution)
            if before.active and execution.command is not None:
                self._send(execution.command, execution.frame_id)
            if execution.phase != before.phase or monotonic() - self._told >= _TOLD:
                self._tell(execution)
            if not execution.active:
                self._end(execution)

    def _send_ahead(self, execution: Execution) -> None:
        """Tell the robot the coming time, if that is not what it was told last."""
        ahead = execution.tellings, execution.phase
        if not (execution.horizon and execution.active) or ahead == self._ahead:
            return
        self._ahead = ahead
        assert execution.stamp is not None  # there was a tick
        self._ahead_out.publish(poses_ahead(*coming(execution), execution.frame_id,
                                            execution.stamp))

    def _send(self, command: Pose, frame_id: str) -> None:
        stamp, tool = self._node.get_clock().now().to_msg(), self._store.state.scene.tool
        self._command_out.publish(pose_stamped_msg(command, frame_id, stamp))
        self._picture.show('command', lambda: (command_markers(command.compose(tool), frame_id,
                                                               stamp),))

    def _end(self, execution: Execution) -> None:
        self._finished = True
        if execution.ends_at_once:
            assert execution.command is not None and execution.stamp is not None  # it ran
            self._ahead_out.publish(poses_ahead([0.0], [execution.command], execution.frame_id,
                                                execution.stamp))
        self._picture.show('command')
        if execution.cause == Cause.DONE:
            reason = f'executed: {execution.way.duration:.1f} s'
            self._reporter.info(reason)
        else:
            reason = f'the execution stopped after {execution.done:.2f} s of its way: ' \
                     f'{execution.reason}'
            self._health.plan_void(execution.reason)
            self._reporter.failed('execute', execution.cause, reason)
        self._reporter.tell('execute', execution.cause, reason, self._stamp,
                            progress(execution))

    def _tell(self, execution: Execution | None) -> None:
        self._told = monotonic()
        name = f'{self._node.get_name()}: execution'
        level, message, values = described(execution)
        self._out.publish(status_msg(name, self._store.state.scene.name, level, message, values))


def described(execution: Execution | None) -> tuple[bytes, str, dict[str, Any]]:
    """Return level, message and values of an Execution for diagnostics."""
    if execution is None:
        return OK, 'nothing was executed yet', {'state': 'idle', 'code': 0, 'cause': 'DONE'}
    good = execution.cause in (Cause.DONE, Cause.CANCELED)
    return (OK if good else WARN, execution.reason or execution.phase, {
        'state': execution.phase, 'code': int(execution.cause), 'cause': execution.cause.name,
        'reason': execution.reason or 'none', **progress(execution)})


def progress(execution: Execution) -> dict[str, Any]:
    """Return how far an Execution has come."""
    duration = execution.way.duration
    return {'done [s]': execution.done, 'duration [s]': duration,
            'progress [%]': 100 * execution.done / duration if duration else 100.0}
