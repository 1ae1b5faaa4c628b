# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion that is executed, as a machine without ROS: what is commanded now, and when it ends.

Time is that of a steady clock, in s. A machine does not change: `tick` returns the next one.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from dlo_planner.identify.steering import Steered
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.motion.timed_path import TimedPath
from dlo_planner.ros.causes import Cause
from dlo_planner.ros.stopping import Deceleration, decelerate

ACTIVE = ('running', 'settling', 'stopping')  # phases in which commands are sent


@dataclass(frozen=True)
class Guards:
    """When an execution has to end; 0 switches a guard off, as in joint_trajectory_controller.

    Attributes
    ----------
    path_position, path_angle : float
        Path position and path angle in m, rad: from the command to the gripper, on the way.
    path_shape : float
        Path shape in m: from the plan to the observed DLO, on the way.
    goal_position, goal_angle : float
        Goal position and goal angle in m, rad: from the last command to the gripper, at the end.
    goal_time : float
        Goal time in s after the end of the motion in which the gripper has to come there.
    cmd_timeout : float
        Cmd timeout in s after which the last command is not repeated any more; counts if it is more
        than goal_time.
    incoming_command_timeout : float
        Incoming command timeout in s: age of the last gripper pose.
    decelerate_on_cancel : bool
        Whether `cancel` lets the motion run out, or ends it at once.
    longest_pause : float
        Seconds between two commands: after a longer one the rest is another motion.
    """

    path_position: float = 0.02
    path_angle: float = 0.1
    path_shape: float = 0.0
    goal_position: float = 0.01
    goal_angle: float = 0.05
    goal_time: float = 2.0
    cmd_timeout: float = 0.0
    incoming_command_timeout: float = 0.1
    decelerate_on_cancel: bool = True
    longest_pause: float = 0.5

    @property
    def patience(self) -> float:
        """How long after the end of the motion the gripper is waited for, s; inf: for good."""
        given = [time for time in (self.goal_time, self.cmd_timeout) if time > 0]
        return given[0] if given else np.inf


@dataclass(frozen=True)
class Heard:
    """A gripper pose that came.

    Attributes
    ----------
    pose : Pose
        Pose of the tool frame.
    arrived : float
        Arrived in s, steady.
    age : float
        Age in s that it had then, by its stamp.
    deviation : float
        Deviation in m, of the observed DLO from the plan; nan: it is not observed.
    """

    pose: Pose
    arrived: float
    age: float = 0.0
    deviation: float = np.nan


@dataclass(frozen=True)
class Execution:
    """One motion along a TimedPath, from its first command to rest.

    Attributes
    ----------
    way : TimedPath
        TimedPath of the gripper frame.
    back : Pose
        Pose of the tool frame in the gripper frame.
    frame_id : str
        In which commands are given.
    guards : Guards
    period : float
        Seconds between two ticks.
    phase : str
        'running', 'settling' (the end is commanded, the gripper is on its way there), 'stopping'
        (it decelerates), 'stopped', 'succeeded'.
    done : float
        Done in s along the way that are commanded.
    command : Pose or None
        Pose of the tool frame, the last command; None before the first one.
    cause : Cause
        Why it stops or has stopped.
    reason : str
        Why it stops or has stopped.
    """

    way: TimedPath | Steered
    back: Pose
    frame_id: str
    guards: Guards = field(default_factory=Guards)
    period: float = 0.02
    phase: str = 'running'
    done: float = 0.0
    command: Pose | None = None
    cause: Cause = Cause.DONE
    reason: str = ''
    deceleration: Deceleration | None = None
    since: float = 0.0        # s since it began to decelerate, or since the end
    last: float | None = None  # time of the last tick
    owed: float = 0.0         # s by which the motion is behind, at most a period
    heard: Heard | None = None
    silent: float = np.inf    # s, age of `heard`; in ticks that were late a period counts

    @property
    def active(self) -> bool:
        """Whether commands are sent."""
        return self.phase in ACTIVE

    def stop(self, cause: Cause, reason: str, at_once: bool = False) -> 'Execution':
        """Return the execution that decelerates, for the first reason that was given.

        Parameters
        ----------
        cause : Cause
        reason : str
            In words.
        at_once : bool, optional
            Whether the last command is the end.
        """
        if self.phase not in ('running', 'settling'):
            return self
        named = replace(self, cause=cause, reason=reason, since=0.0)
        if at_once or self.command is None or self.phase == 'settling':
            return replace(named, phase='stopped')
        return replace(named, phase='stopping',
                       deceleration=decelerate(self.way, self.done, 2 * self.period))

    def canceled(self) -> 'Execution':
        """Return the execution after `cancel`."""
        return self.stop(Cause.CANCELED, 'canceled', not self.guards.decelerate_on_cancel)

    def tick(self, now: float, heard: Heard | None = None) -> 'Execution':
        """Return the execution with its next command.

        However late it is called, the motion goes on by one period at most: it stands still
        meanwhile, and does not leap.

        Parameters
        ----------
        now : float
            Now in s.
        heard : Heard, optional
            The last gripper pose.
        """
        if not self.active:
            return self
        waited = 0.0 if self.last is None else max(now - self.last, 0.0)
        limit = self.guards.longest_pause
        if limit and waited > limit:
            paused = f'no command was sent for {waited:.3g} s: expected execute.longest_pause = ' \
                     f'{limit:g} s at most'
            return replace(self, phase='stopped', last=now,
                           cause=self.cause or Cause.PAUSED, reason=self.reason or paused)
        step = min(waited + self.owed, self.period)
        timed = replace(self, last=now, owed=min(waited + self.owed - step, self.period),
                        heard=heard, silent=self._silence(heard, now, min(waited, self.period)))
        fault = timed.fault()
        return (timed.stop(*fault) if fault else timed).advanced(step)

    def advanced(self, step: float) -> 'Execution':
        """Return the execution `step` s later."""
        if self.phase == 'stopping':
            since = self.since + step
            assert self.deceleration is not None  # `stop` made it
            done = float(self.deceleration.at(since))
            phase = 'stopped' if since >= self.deceleration.length else 'stopping'
            return replace(self, done=done, since=since, phase=phase, command=self._pose(done))
        if self.phase == 'settling':
            return replace(self, since=self.since + step).settled()
        if self.phase != 'running':
            return self
        done = self.done + (step if self.command is not None else 0.0)
        if done < self.way.duration:
            return replace(self, done=done, command=self._pose(done))
        end = self.way.duration
        return replace(self, done=end, command=self._pose(end), phase='settling',
                       since=done - end).settled()

    def settled(self) -> 'Execution':
        """Return the execution at the end of its way: succeeded, too late, or still waiting."""
        guards = self.guards
        if not (guards.goal_position or guards.goal_angle):
            return replace(self, phase='succeeded')
        away = self._off(guards.goal_position, guards.goal_angle, 'constraints.goal')
        if away is None and self.heard is not None:
            return replace(self, phase='succeeded')
        if self.since > guards.patience:
            late = f'{guards.patience:g} s after the end of the motion {away or "no pose came"}'
            return replace(self, phase='stopped', cause=Cause.GOAL_TOLERANCE, reason=late)
        return self

    def _pose(self, done: float) -> Pose:
        return self.way.at([done])[0][0].compose(self.back)

    def _silence(self, heard: Heard | None, now: float, step: float) -> float:
        """Return the age of a gripper pose, s.

        Where this machine is late, poses may be as late to be heard: a tick adds a period at most.
        """
        if heard is None:
            return np.inf
        if heard is not self.heard:
            return heard.age + min(max(now - heard.arrived, 0.0), self.period)
        return self.silent + step

    def fault(self) -> tuple[Cause, str] | None:
        """Return the cause and the reason to stop, or None."""
        guards, heard, age = self.guards, self.heard, self.silent
        limit = guards.incoming_command_timeout
        if limit and not age <= limit:
            came = 'none came' if heard is None else f'the last one is {age:.3g} s old'
            return (Cause.GRIPPER_POSE_LOST, f'gripper_pose: {came}: expected '
                    f'incoming_command_timeout = {limit:g} s at most, by its stamp')
        if self.phase != 'running' or heard is None or self.command is None:
            return None
        away = self._off(guards.path_position, guards.path_angle, 'constraints.path')
        if away is not None:
            return Cause.PATH_TOLERANCE, away
        if guards.path_shape and heard.deviation > guards.path_shape:
            return (Cause.SHAPE_TOLERANCE, f'the DLO is {heard.deviation:.3g} m from its plan: '
                    f'expected constraints.path.shape = {guards.path_shape:g} m at most')
        return None

    def _off(self, position: float, angle: float, name: str) -> str | None:
        """Return in words how the gripper is off the command; None: it is within tolerances."""
        heard = self.heard
        if heard is None or self.command is None:
            return None
        away = float(np.linalg.norm(heard.pose.position - self.command.position))
        if position and away > position:
            return (f'the gripper is {away:.3g} m from its command: expected {name}.position = '
                    f'{position:g} m at most')
        turned = angle_between(heard.pose.rotation, self.command.rotation)
        if angle and turned > angle:
            return (f'the gripper is turned by {turned:.3g} rad from its command: expected '
                    f'{name}.angle = {angle:g} rad at most')
        return None
