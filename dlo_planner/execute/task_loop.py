# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A task with a camera: the strategy of `identify.closed_loop`, carried out.

It looks at rest, plans for the estimated DLO, goes calmly to the standoff, looks again and enters.
As long as the DLO hangs freely it looks and corrects a few times a second. Where looks come to
disagree it stops, goes back to the standoff and tries again. Where the DLO swings it takes that
away. It knows no clock, no message and no thread: who drives it hands in what is measured, does its
`work` (plans, which take seconds) wherever that suits, and asks for the command of each period
(`tick`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dlo_planner.execute.causes import Cause, cause_of
from dlo_planner.execute.correction_checks import (
    Aimed,
    lag_of,
    misfit_reason,
    motion_bound,
    obstacles_around,
    retargeted,
)
from dlo_planner.execute.execution import Execution
from dlo_planner.execute.guards import Enabled, Feedback, Guards
from dlo_planner.execute.loop_motions import (
    FARTHEST,
    Calming,
    Entry,
    GripperMotion,
    LoopTask,
    way_back,
    way_in,
    way_to_standoff,
)
from dlo_planner.identify.closed_loop import ClosedLoop, Phase
from dlo_planner.identify.correction import Correction
from dlo_planner.identify.estimator import DloEstimator
from dlo_planner.identify.online_trajectory import CorrectedTrajectory
from dlo_planner.identify.vibration import ONE_PERIOD, STATED, FreeVibration
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.clearance import clearance
from dlo_planner.plan.requirements import Limits

_MOVED = 1e-4       # m, or of unit vectors; a gripper that moved by more has left the standoff.
_TRIED = 200        # times at which it is looked where on its way the gripper stands
_ASIDE = 0.02, 0.1  # m, rad; a gripper that is farther from where it stood was moved.
_CALM_STOP = 2.0    # slowest periods; a motion comes to rest in them, where it can.
_OF_THE_WAY = 0.3   # It comes to rest on this fraction of the path to the entry, where it can.
_FOLLOWED = 0.3     # s; the gripper is at rest so long after the last command.
_SWINGS = 0.6       # A vibration above this fraction of the tolerated one is taken away.
_CLEAR = 2.0        # A vibration that is so many times larger shows the delay as well.
_SEEING, _AGAIN = 1.5, 0.25  # s, in which a swing is looked at, until it is tried again
_LOOK_LONGER = 2.0  # A look goes on until a whole period is seen, so many times as long at most.
_LONGEST_SEEING = 6.0  # s; what was not seen to vibrate until then is believed to be at rest.
_SURE = 2.0         # A vibration has to exceed noise by so many standard deviations.
_OF_STANDOFF = 0.2  # To take a vibration away the gripper may move by this fraction of it.
_CALMINGS = 6       # So often a vibration is taken away in one look.
_CLOSELY = 1.5      # s before the entry, in which each cloud is looked at: a slip has to be seen
_PLANNED = 1e-4     # m, by which a plan misses centers and says so
_MUCH = 1.5         # times as far off as stated: a camera that is said to be the cause
_UNSEEN = 2.0       # s without a look that agrees: the estimate may be of the past


class TaskLoop:
    """One task in a closed loop: it looks, plans, goes, corrects and enters, or stops and says why.

    It knows no clock, no message and no thread. What is seen goes to its `observing`, whoever hands
    it in; what is measured of the gripper to `gripper` and to `observing`; `tick` returns what to
    command. Stamps and times are of one clock, in s.

    Parameters
    ----------
    task : LoopTask
        The task, among its obstacles.
    observing : DloEstimator
        What is seen of the DLO.
    here : Pose
        Where the gripper stands, measured.
    tool : Pose, optional
        Pose of the gripper in the robot's tool frame, whose poses are commanded. If None, they are
        the same.
    guards : Guards, optional
        What stops a motion. If None, nothing but the loop itself does.
    limits : Limits, optional
        Limits of commands. If None, those of the task.
    look : float, optional
        Duration of a look at rest, s: the DLO should swing a few times in it.
    period : float, optional
        Between two commands, s.
    horizon : float, optional
        Preview: how much of the coming motion each message holds, s.
    frame_id : str, optional
        Frame of the poses, for messages.
    heard_after : float, optional
        How long each motion stands still at its beginning, until a robot has heard of it, s.

    Attributes
    ----------
    miss_bound_95 : float
        Largest miss that is expected, m, with 95 %; nan before the entry is planned.
    cause, reason : Cause and str
        Why it stopped, once `phase` is STOP.
    execution : Execution or None
        The motion under way; None: the gripper stands.
    """

    def __init__(self, task: LoopTask, observing: DloEstimator, here: Pose, *,
                 tool: Pose | None = None, guards: Guards | None = None,
                 limits: Limits | None = None, look: float = 2.0, period: float = 0.02,
                 horizon: float = 0.0, frame_id: str = '', heard_after: float = 0.0) -> None:
        self._task, self.observing, self._here = task, observing, here
        self._tool = Pose.identity() if tool is None else tool
        self._loop = ClosedLoop(task.room, look, period=observing.seeing.correction_period)
        self._guards = guards or Guards(path_position=0.0, path_angle=0.0, goal_position=0.0,
                                        goal_angle=0.0, incoming_command_timeout=0.0)
        self._execution_of = partial(
            Execution, limits=limits or task.limits, back=self._tool.inverse(), frame_id=frame_id,
            period=period, horizon=horizon, guards=self._guards, begin=-heard_after,
            done=-heard_after)
        self._heard_after = heard_after
        self._lag = lag_of(observing.seeing, horizon)
        self._feedback: Feedback | None = None
        self._enabled: Enabled | None = None
        self.execution: Execution | None = None  # the motion under way; None: the gripper stands
        self.last: Execution | None = None  # the last motion, which may have ended
        self.aimed: Aimed | None = None  # the last correction that was made
        self.refusal = ''                # why it is not executed
        self._work: Callable[[], Any] | None = None
        self._done: Any = None
        self._entry: Entry | None = None
        self._correction: Correction | None = None
        self._ended = np.inf  # stamp at which the last motion began, had it gone on evenly
        self._departure = 0.0  # m of swing that the motion to the standoff leaves, as simulated
        self._left = 0.0  # m of swing that is expected at the standoff
        self._stands = here  # where the gripper does while nothing is executed
        self._may_swing = False  # whether the DLO may swing, so that it is no use to look at it
        self._rests = self._sees = -np.inf  # stamps: since it does, and when that is looked at
        self._factor = STATED  # what is known of the frequencies of the DLO
        self._delay = 0.0  # s, from a command until the DLO is seen to answer
        self._calmed: Calming | None = None  # the last calming of this look
        self._calmings = 0
        self._misses = False  # whether that is why it last turned back
        # the largest miss that is expected, m: the 95 % bound of the estimate, what the simulated
        # motion adds, and what the DLO still swings from the one to the standoff
        self.miss_bound_95 = np.nan
        self.cause, self.reason = Cause.DONE, ''  # why it stopped

    @property
    def promised(self) -> float:
        """The earlier name of `miss_bound_95`, for one release."""
        return self.miss_bound_95

    @property
    def phase(self) -> Phase:
        """What it does now."""
        return self._loop.phase

    @property
    def tries(self) -> int:
        """How often looks came to disagree, or the miss to exceed the room, so far."""
        return self._loop.tries

    def gripper(self, feedback: Feedback) -> None:
        """Take in where the tool frame was measured; `observing` needs it as well."""
        self._feedback = feedback
        self._here = self._led()

    @property
    def _measured(self) -> Pose:
        return self._here if self._feedback is None else self._feedback.pose.compose(self._tool)

    def _led(self) -> Pose:
        """Return where the gripper was led to: measured before the first command, no jump after."""
        measured = self._measured
        return min([] if self.last is None else self.last.led, default=measured, key=lambda pose: (
            float(np.linalg.norm(pose.position - measured.position))))

    # ---- what takes time ------------------------------------------------------------------------

    @property
    def work(self) -> Callable[[], Any] | None:
        """What has to be computed now: a function without side effects, or None.

        It, and its result or what it raises, belong to `finish`.
        """
        return self._work

    @property
    def waits(self) -> bool:
        """Whether the gripper stands still until `work` is done; else that is a correction."""
        return self._work is not None and self.execution is None

    def finish(self, work: Callable[[], Any], result: Any) -> None:
        """Take in the result of a `work`, or the exception that it raised; not if it is over."""
        if work is self._work:
            self._work, self._done = None, result

    # ---- commands -------------------------------------------------------------------------------

    def tick(self, time: float, now: float | None = None,
             enabled: Enabled | None = None) -> Pose | None:
        """Return the Pose of the tool frame to be commanded now; None: it has ended."""
        done, self._enabled = self._done, enabled
        if isinstance(done, Exception):  # in motion: a correction, without which it comes to rest
            self._done = None
            self.stop(time, cause_of(done), str(done))
        if self.execution is None and self.phase not in (Phase.DONE, Phase.STOP):
            self._stand(time, time if now is None else now)
        if not self.waits:
            self._advance(time, time if now is None else now)
        ended = self.phase in (Phase.DONE, Phase.STOP)
        return None if ended else self._here.compose(self._tool.inverse())

    def stop(self, time: float, cause: Cause, reason: str, at_once: bool = False) -> None:
        """Come to rest, and end there; `at_once`: with the last command."""
        self.cause, self.reason = self.cause or cause, self.reason or reason
        if self.execution is None:
            self._end(self.cause, self.reason, time)
        else:
            self.execution = self.execution.stop(cause, reason, at_once)

    def end(self, time: float, cause: Cause, reason: str) -> None:
        """End at once, whatever is executed: nothing is commanded any more."""
        self._end(self.cause or cause, self.reason or reason, time)

    def _stand(self, time: float, now: float) -> None:
        """End where a gripper that stands must not move any more, or has been moved."""
        barred = self._guards.barred(self._enabled, now)
        if barred:
            self._end(Cause.NOT_ENABLED, barred, time)
            return
        if self._feedback is None:
            return
        here, (position, angle) = self._measured, _ASIDE
        away = float(np.linalg.norm(here.position - self._stands.position))
        turned = angle_between(here.rotation, self._stands.rotation)
        if away > position or turned > angle:
            self._end(Cause.NOT_AT_START, f'the gripper is {away:.3g} m and {turned:.3g} rad from '
                      f'where it stood: expected {position:g} m and {angle:g} rad at most', time)

    def _end(self, cause: Cause, reason: str, time: float) -> None:
        self.cause, self.reason, self.execution, self._work = cause, reason, None, None
        self._loop = replace(self._loop, phase=Phase.STOP, since=time)

    def _advance(self, time: float, now: float) -> None:
        phase = self.phase
        if phase is Phase.LOOK:
            self._look(time)
            if self.phase is Phase.CALM:  # what was computed is for now
                self._move(time, now)
        elif phase is Phase.PLAN:
            self._plan(time, self._done)
        elif phase in (Phase.GO, Phase.ENTER, Phase.CALM, Phase.RETREAT):
            self._move(time, now)

    def _look(self, time: float) -> None:
        """Go on looking, anew where looks disagree, it swings, or nothing was seen all the time."""
        loop, observing = self._loop, self.observing
        if self._may_swing:
            self._to(self._swinging(time), time)
            return
        since = loop.calm if loop.since is not None else time
        unseen = time - since >= loop.look and observing.seen < since
        swings, looked = False, time - since >= loop.look
        if looked and not (observing.inconsistent or unseen):
            if time < self._sees:
                return
            seen = observing.vibration(self._measured, since, self._factor, ONE_PERIOD)
            if seen is None and time - since < _LOOK_LONGER * loop.look:  # of a slow one too little
                self._sees = time + _AGAIN
                return
            swings = self._swings(seen)
        doubted = observing.inconsistent or swings
        loop = loop.advanced(time, doubted=doubted or unseen)
        if doubted:
            self._rest(time)
        self._to(loop, time)

    def _swings(self, seen: FreeVibration | None) -> bool:
        """Take in how the DLO swings at rest, and return whether that is too much.

        What is left by the motion to here, as it was simulated, counts as far as looks allow for
        it. What was seen in an earlier look does not count any more: a swing decays.
        """
        if seen is None:
            least = self.observing.swing
            self._left = max(self._departure, least)
        else:
            least, most = seen.between
            self._left = float(np.clip(self._departure, least, most))
        return least > self._task.tolerance

    def _rest(self, since: float) -> None:
        """Look only at how the DLO swings, from a time (s) on, since which the gripper stands."""
        self._may_swing, self._rests, self._sees = True, since, since + _SEEING
        self.observing.inflate_covariance(np.inf)

    def _swinging(self, time: float) -> ClosedLoop:
        """Return the state in which the swing of the DLO is seen, taken away, or over."""
        loop, most = self._loop.advanced(time, doubted=True), self._task.tolerance
        if loop.phase is Phase.STOP or time < self._sees:
            return loop
        seen = self.observing.vibration(self._measured, self._rests, self._factor)
        if seen is None and time < self._rests + _LONGEST_SEEING:  # not enough of it is seen
            self._sees = time + _AGAIN
            return loop
        if seen is not None:
            self._factor = seen.factor
            sure = _SURE * seen.deviation
            if seen.amplitude > max(_SWINGS * most, sure) and self._calmings < _CALMINGS:
                way = self._calming(seen, time)
                if way is not None:
                    self.execution = self._execution_of(way)
                    return loop.calming(time)
            if seen.amplitude > max(most, sure):  # it has to come to rest by itself
                self._rests, self._sees = time, time + _SEEING
                return loop
        self._may_swing = False
        self.observing.inflate_covariance(time)
        return replace(loop, doubted=time)

    def _calming(self, seen: FreeVibration, time: float) -> CorrectedTrajectory | None:
        """Return the motion that takes a vibration away, None where there is no room for it.

        The last one tells of the delay.
        """
        task, farthest = self._task, min(FARTHEST, _OF_STANDOFF * self._task.standoff)
        last = self._calmed
        if last is not None and last.before.amplitude > _CLEAR * _SWINGS * self._task.tolerance:
            self._delay = last.delay(seen)
        period = self._execution_of.keywords['period']
        found = Calming.of(seen, time + self._heard_after, self._delay, self._here,
                           task.motion_limits, period, farthest)
        workspace = task.inverse.workspace
        poses = found.way.poses(np.arange(0.0, found.way.duration + period, period))
        shapes = task.hanging(self.observing.estimate, self._here)
        free = all(clearance([body], surface, shape) > farthest + seen.amplitude
                   for shape, surface in shapes for body in obstacles_around(task.inverse))
        inside = workspace is None or min(workspace.min_margin(pose)[1] for pose in poses) >= 0
        if not (free and inside):
            return None
        self._calmed, self._calmings = found, self._calmings + 1
        return found.way

    def _plan(self, time: float, done: Any) -> None:
        task, estimate = self._task, self.observing.estimate
        self._done = None
        if not isinstance(done, Entry | GripperMotion):
            self._work = (partial(way_in, task, estimate, self._here, None, self._lag, self._left)
                          if self._loop.at_standoff else
                          partial(way_to_standoff, task, estimate, self._here))
            return
        bound = None
        # it is judged by the room of the plan that is executed
        self._task = (task.of_plan(done.whole) if isinstance(done, Entry) else
                      replace(task, planned_room=done.planned_room, obliquely=done.obliquely))
        self._loop = replace(self._loop, room=self._task.room)
        if isinstance(done, Entry):
            self._entry, self._correction = done, None
            moves = done.moves if done.motion is not None else self._kept(done.bound)
            bound = done.bound + self._left + moves
        loop = self._loop.advanced(time, bound, finished=True, doubted=self.observing.inconsistent)
        if isinstance(done, GripperMotion) and loop.phase is Phase.GO:
            self._departure = done.departure
            self._go(done)
        elif loop.phase is Phase.ENTER and isinstance(done, Entry) and bound is not None:
            assert done.motion is not None  # its bound would be infinite
            self.miss_bound_95 = bound
            self._go(done.motion)
        self._to(loop, time)

    def _kept(self, bound: float) -> float:
        """Return what is kept for motion, m, beside a bound at rest that leaves no room for it."""
        task = self._task
        return max(task.room - task.room_at_rest, float(np.nextafter(task.room, np.inf)) - bound)

    # ---- motion ---------------------------------------------------------------------------------

    def _go(self, motion: GripperMotion) -> None:
        """Begin a motion."""
        self.execution = self._execution_of(motion.corrected_trajectory)
        self.observing.moves(motion.swing, self._time_at)

    def _time_at(self, stamp: float) -> float:
        """Return the time of the motion, s, at a stamp; beyond its end where it has ended."""
        execution = self.execution  # which another thread may end meanwhile
        return stamp - self._ended if execution is None else execution.done_at(stamp)

    def _move(self, time: float, now: float) -> None:
        if self.execution is None:  # back: there is no way back, or it is found
            done, self._done = self._done, None
            if not isinstance(done, GripperMotion):
                self._to(self._loop.advanced(time, finished=True), time)
                return
            self._go(done)
        if self.phase in (Phase.GO, Phase.ENTER):
            self._watch(time)
        assert self.execution is not None  # it was begun
        execution = self.execution.tick(now, self._feedback, time, self._enabled)
        self.execution = self.last = execution
        self._here = self._led()
        if execution.phase == 'stopped':
            self._stopped(time, execution)
        elif execution.phase == 'succeeded':
            self._ended, self.execution = time - execution.way.duration, None
            self._stands = self._here
            # what matters at the standoff is looked at anew
            self._to(self._loop.advanced(time, np.inf if self.phase is Phase.GO else None,
                                         finished=True), time)

    def _watch(self, time: float) -> None:
        """Correct if it is time, and turn back where looks disagree or the miss has grown."""
        execution = self.execution
        if execution is None or execution.phase != 'running':
            return
        bound, doubted = None, self.observing.inconsistent
        if self.phase is Phase.ENTER:
            bound = self._corrected_bound(time, execution)
            unseen = time - max(self.observing.seen, self._loop.since or 0.0)
            late = 0.0 if self._work is None else time - (self._loop.corrected or time)
            left = self._to_entry(execution)
            doubted = doubted or (max(unseen, late) > _UNSEEN and left > 0)
            self.observing.closely = 0 < left < _CLOSELY
            if left <= 0 and not self._task.hangs:  # a look says nothing of the entry any more
                self.observing.ignore()
                doubted = False
        loop = self._loop.advanced(time, bound, doubted=doubted)
        if loop.phase is Phase.RETREAT:
            self._misses = not doubted
            self._to(loop, time)
            self._work = self._done = None
            assert self.execution is not None
            self.execution = self.execution.stop(Cause.MISS_EXPECTED, 'it goes back',
                                                 lasting=self._gently(self.execution))

    def _gently(self, execution: Execution) -> float:
        """Return in how many s it may come to rest: the DLO swings the less, the longer it takes.

        Before the hole on a part of the way there, in it at once.
        """
        way = execution.way
        assert isinstance(way, CorrectedTrajectory)
        longest = _CALM_STOP * float(way.windows[0])
        if self.phase is Phase.RETREAT and not self._loop.at_standoff:
            return longest
        # it goes half as far as it would
        return min(longest, 2 * _OF_THE_WAY * max(self._to_entry(execution), 0.0))

    def _stopped(self, time: float, execution: Execution) -> None:
        """Find the way back to the standoff, or look where the gripper is; or that is the end."""
        self.execution, self._stands = None, self._here
        if self.cause or execution.cause is not Cause.MISS_EXPECTED:  # from outside, or by a guard
            self._end(self.cause or execution.cause, self.reason or execution.reason, time)
        elif self._loop.at_standoff and self._entry is not None:
            assert isinstance(execution.way, CorrectedTrajectory)
            times = np.linspace(0.0, execution.done, _TRIED)
            off = [np.linalg.norm(pose.position - self._here.position)
                   for pose in execution.way.poses(times)]
            since = float(times[int(np.argmin(off))])  # it may be held back by the limits
            poses = [self._here, *execution.way.poses(np.linspace(since, 0.0, _TRIED))[1:]]
            progress = float(execution.way.progress([execution.done])[0])
            whole, motion = self._entry.whole, self._entry.motion
            assert motion is not None  # it was executed
            # beyond the last shape that hangs freely the plan's are parts of a DLO, or touch
            known = next((shape for time, shape in zip(whole.times, whole.shapes, strict=True)
                          if time >= progress or shape is motion.there), motion.there)
            if max(np.abs(poses[0].matrix - pose.matrix).max() for pose in poses) > _MOVED:
                self._work = partial(way_back, self._task, self._entry.estimate, poses, known)

    def _to(self, loop: ClosedLoop, time: float) -> None:
        """Take the next state of the strategy."""
        before, self._loop = self._loop, loop
        # at the standoff a swing that is lost in noise costs room: more looks tell it sooner
        self.observing.closely = loop.phase is Phase.LOOK and loop.at_standoff
        if loop.phase is Phase.LOOK and before.phase is Phase.PLAN:
            self._calmed, self._calmings = None, 0
            if loop.tries > before.tries:
                self._rest(time)
        elif loop.phase is Phase.LOOK and before.phase is Phase.RETREAT:
            if self._misses:
                self._task = replace(self._task, given_up=self._task.given_up + 1)
                self._misses = False
            self._calmed, self._calmings = None, 0
            self._rest(time + _FOLLOWED)
        elif loop.phase is Phase.LOOK and before.phase is Phase.CALM:
            self._rest(time + _FOLLOWED)
        if loop.phase is not Phase.STOP or before.phase is Phase.STOP:
            return
        if before.phase is Phase.LOOK:
            hole = ('; the cut-out is seen farther off than observe.cutout allows, or it moves'
                    if self.observing.cutout_suspect else '')
            self._end(Cause.LOOKS_DISAGREE, 'looks at the DLO do not agree with each other, or '
                      f'there are none, for {loop.patience:g} s: it swings, or touches something, '
                      f'or the robot is elsewhere than it says{hole}', time)
        elif loop.tries > loop.most_tries and not self._misses:
            self._end(Cause.LOOKS_DISAGREE, 'looks at the DLO do not agree with what was expected '
                      f'of it, {loop.tries} times: it slips, swings or touches something, or the '
                      'robot is elsewhere than it says', time)
        elif self._entry is not None:
            entry, moves, planned = self._entry, '', ''
            most = f'the room of {self._task.room:.3g} m'  # what was judged
            if self._task.given_up:
                most += f', smaller after {self._task.given_up} entries that were given up'
            place = 'the place that it touches' if self._task.touches else 'the center'
            bound = self.miss_bound_95 if self._misses else entry.bound
            if entry.motion is not None:
                added = self._left + entry.moves
                bound += 0.0 if self._misses else added
                moves = f', {added:.3g} m of it by motion'
            elif not self._misses:
                most = f'{self._task.room_at_rest:.3g} m at rest, of {most}'
            if entry.planned > _PLANNED:
                planned = (f'; as planned it misses by {entry.planned:.3g} m, no pose of the '
                           'gripper leads it through all centers')
            self._end(Cause.MISS_EXPECTED, f'the DLO may miss {place} by {bound:.3g} m (95 %'
                      f'{moves}): expected at most {most}{planned}{self._camera_reason()}', time)

    def _camera_reason(self) -> str:
        """Return in words what is wrong with the camera, '' if nothing is known to be."""
        scale = self.observing.estimate.camera_scale
        if scale < _MUCH:
            return ''
        return (f'; as looks tell, the camera is {scale:.2g} times as far off as observe.bias and '
                'observe.camera_rotation state: calibrate it, or let it see the cut-out as well')

    # ---- corrections ----------------------------------------------------------------------------

    def _to_entry(self, execution: Execution) -> float:
        """Return the seconds of its motion until the entry, below 0 after it."""
        assert self._entry is not None
        return float(self._entry.reached[0]) - execution.done

    def _corrected_bound(self, time: float, execution: Execution) -> float | None:
        """Have the rest aimed anew if that is due; return the bound of the miss, before the entry.

        Where the correction must not be executed, that of what is executed.
        """
        way, entry, aimed = execution.way, self._entry, self._done
        assert isinstance(way, CorrectedTrajectory) and entry is not None
        if isinstance(aimed, Aimed):
            self._done = None
            reached = entry.reached
            corrected, refusal = execution, aimed.doubts
            if not refusal and execution.free + way.windows.sum() > way.trajectory.duration:
                refusal = 'it comes too late to be blended in'
            if not refusal:
                corrected = self.execution = execution.corrected(way.corrected(
                    execution.free, aimed.correction, reached[aimed.correction.first:]))
                self._correction, refusal = aimed.correction, corrected.refusal
            self.aimed, self.refusal = aimed, refusal
            if self._to_entry(execution) <= 0:
                return None
            bound = self._left + motion_bound(execution) - entry.planned + (
                aimed.bound if corrected.way is not way else aimed.bound_before)
            self.miss_bound_95 = max(self.miss_bound_95, bound)
            return bound
        seen = self.observing.seen > (self._loop.corrected or -np.inf)
        if self._work is None and seen and self._loop.correction_due(time):
            self._loop = self._loop.with_correction(time)
            first = int(np.searchsorted(entry.reached, execution.free))
            if first < len(entry.commanded):
                observing = self.observing
                self._work = partial(
                    retargeted, self._task.front, observing.estimate, entry.commanded, way,
                    execution.free, entry.reached, self._correction,
                    observing.seeing.largest_correction, self._lag,
                    misfit_reason(observing, self._task.limits.linear_speed),
                    self._task.behind)
        return None
