# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion that is executed, as a machine without ROS: what is commanded now, and when it ends.

Time is that of a steady clock, in s. A machine does not change: `tick` returns the next one.

With a horizon the motion goes on by the clock of the stamps, whether the machine is late or not: a
robot that was told the coming time with stamps (`ahead.told`) does not wait for this machine.
Without one, a robot follows each command as it comes, and a late command delays the motion.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from dlo_planner.identify.steering import Steered
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.motion.timed_path import TimedPath
from dlo_planner.ros.causes import Cause
from dlo_planner.ros.guards import Guards, Heard
from dlo_planner.ros.stopping import Deceleration, decelerate

ACTIVE = ('running', 'settling', 'stopping')  # phases in which commands are sent
_OFTEN = 0.2  # of the horizon, after which a robot is told the coming time again
_LEAD = 0.1   # s until a robot hears that it has to stop
_REMEMBERED = 1.0  # s, for which it is known what was commanded when


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
    horizon : float
        Seconds of the coming motion that a robot is told; 0: each command as it comes.
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
    horizon: float = 0.0
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
    stamp: float | None = None  # s on the clock of the stamps, at which `done` is reached
    past: tuple[tuple[float, float], ...] = ()  # (`stamp`, `done`) of the last ticks
    sent: float = 0.0         # s of the way that a robot was told, with a horizon
    told: float = -np.inf     # stamp at which it was told last
    tellings: int = 0         # how often it was told
    shaken: float = 0.0       # m by which late commands have moved the gripper against its motion

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
        lead = _LEAD if self.horizon else 0.0
        return replace(named, phase='stopping', since=-lead,
                       deceleration=decelerate(self.way, self.done + lead, 2 * self.period))

    @property
    def ends_at_once(self) -> bool:
        """Whether a robot that was told the coming time has to be told that there is none."""
        canceled = self.phase == 'stopped' and self.cause == Cause.CANCELED
        return canceled and self.deceleration is None and self.sent > self.done

    def canceled(self) -> 'Execution':
        """Return the execution after `cancel`."""
        return self.stop(Cause.CANCELED, 'canceled', not self.guards.decelerate_on_cancel)

    def tick(self, now: float, heard: Heard | None = None,
             stamp: float | None = None) -> 'Execution':
        """Return the execution with its next command.

        However late it is called, without a horizon the motion goes on by one period at most: it
        stands still meanwhile, and does not leap. With one it goes on by what has passed, if the
        robot was told so much.

        Parameters
        ----------
        now : float
            Now in s.
        heard : Heard, optional
            The last gripper pose.
        stamp : float, optional
            Now in s on the clock of the stamps. If None, that is the steady clock.
        """
        if not self.active:
            return self
        stamp = now if stamp is None else stamp
        waited = 0.0 if self.last is None else max(now - self.last, 0.0)
        passed = waited
        if self.horizon:
            passed = 0.0 if self.stamp is None else max(stamp - self.stamp, 0.0)
        paused = self._paused(passed)
        if paused:
            return replace(self, phase='stopped', last=now,
                           cause=self.cause or Cause.PAUSED, reason=self.reason or paused)
        step = passed if self.horizon else min(waited + self.owed, self.period)
        owed = 0.0 if self.horizon else min(waited + self.owed - step, self.period)
        lost = 0.0 if self.horizon else waited + self.owed - step - owed
        timed = replace(self, last=now, owed=owed, heard=heard,
                        shaken=self.shaken + self._moves(lost),
                        silent=self._silence(heard, now, min(waited, self.period)))
        fault = timed.fault(stamp)
        turned_back = self.stamp is not None and stamp < self.stamp
        next_one = (timed.stop(*fault) if fault else timed).advanced(step)
        return next_one._remembered(stamp)._told(turned_back)

    def _paused(self, passed: float) -> str:
        """Return in words why the rest is another motion after so many s, '' if it is not."""
        limit, name = self.guards.longest_pause, 'longest_pause'
        if self.horizon:
            knows_all = self.phase != 'running' or self.sent >= self.way.duration
            limit, name = 0.0 if knows_all else self.sent - self.done, 'horizon'
        if not limit or passed <= limit:
            return ''
        return (f'no command was sent for {passed:.3g} s: expected execute.{name} = {limit:g} s at '
                'most')

    def _moves(self, lost: float) -> float:
        """Return the way in m that the motion goes in `lost` s."""
        if self.phase != 'running' or lost <= 0:
            return 0.0
        return lost * float(np.linalg.norm(self.way.at([self.done])[1][0, :3]))

    def _told(self, anew: bool) -> 'Execution':
        """Return the execution of which the robot is told more, if it is time to, or anew."""
        if not self.horizon or self.phase not in ('running', 'stopping') or self.stamp is None:
            return self
        if self.stamp - self.told < _OFTEN * self.horizon and not anew:
            return self
        ahead = min(self.done + self.horizon, self.way.duration)
        return replace(self, sent=ahead if self.phase == 'running' else self.sent,
                       told=self.stamp, tellings=self.tellings + 1)

    def _remembered(self, stamp: float) -> 'Execution':
        """Return the execution that has done what it has at a time (s) of the stamps' clock."""
        kept = (one for one in self.past if stamp - _REMEMBERED < one[0] < stamp)
        return replace(self, stamp=stamp, past=(*kept, (stamp, self.done)))

    def done_at(self, stamp: float) -> float:
        """Return s of the way that are done at a time (s) of the stamps' clock, now or before."""
        if not self.past:
            return self.done
        stamps, done = zip(*self.past, strict=True)
        before = max(float(stamps[0]) - stamp, 0.0)  # what is remembered
        return max(float(np.interp(stamp, stamps, done)) - before, 0.0)

    @property
    def free(self) -> float:
        """From which time of its way on the motion may be changed, s."""
        return max(self.done, self.sent)

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

    def fault(self, stamp: float) -> tuple[Cause, str] | None:
        """Return the cause and the reason to stop at a time (s) of the stamps' clock, or None."""
        guards, heard, age = self.guards, self.heard, self.silent
        limit = guards.incoming_command_timeout
        if limit and not age <= limit:
            came = 'none came' if heard is None else f'the last one is {age:.3g} s old'
            return (Cause.GRIPPER_POSE_LOST, f'gripper_pose: {came}: expected '
                    f'incoming_command_timeout = {limit:g} s at most, by its stamp')
        if self.phase != 'running' or heard is None or self.command is None:
            return None
        away = self._off(guards.path_position, guards.path_angle, 'constraints.path',
                         self._then(heard, stamp))
        if away is not None:
            return Cause.PATH_TOLERANCE, away
        if guards.path_shape and heard.deviation > guards.path_shape:
            return (Cause.SHAPE_TOLERANCE, f'the DLO is {heard.deviation:.3g} m from its plan: '
                    f'expected constraints.path.shape = {guards.path_shape:g} m at most')
        return None

    def _then(self, heard: Heard, now: float) -> Pose | None:
        """Return the command of the time at which the gripper was where it was heard.

        So a message that is late is not taken for a robot that is. Without a horizon the last
        command stands; it counts as far back as `incoming_command_timeout` lets poses be old, and
        not at all without that guard.
        """
        if heard.stamp is None or self.stamp is None or now < self.stamp:
            return self.command
        if not self.horizon:
            oldest = self.stamp - self.guards.incoming_command_timeout
            return self._pose(self.done_at(max(heard.stamp, oldest)))
        since = min(heard.stamp, now) - self.stamp  # a robot that knows the coming time went on
        return self._pose(min(self.done + since, max(self.sent, self.done)) if since > 0
                          else self.done_at(heard.stamp))

    def _off(self, position: float, angle: float, name: str,
             command: Pose | None = None) -> str | None:
        """Return in words how the gripper is off the command; None: it is within tolerances."""
        heard, command = self.heard, command or self.command
        if heard is None or command is None:
            return None
        away = float(np.linalg.norm(heard.pose.position - command.position))
        if position and away > position:
            return (f'the gripper is {away:.3g} m from its command: expected {name}.position = '
                    f'{position:g} m at most')
        turned = angle_between(heard.pose.rotation, command.rotation)
        if angle and turned > angle:
            return (f'the gripper is turned by {turned:.3g} rad from its command: expected '
                    f'{name}.angle = {angle:g} rad at most')
        return None
