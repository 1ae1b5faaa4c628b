# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The motion that is executed, as a machine without ROS: what is commanded now, and when it ends.

Time is that of a steady clock, in s. A machine does not change: `tick` returns the next one.

Commands are the poses of the motion at even times, a period apart, whenever a tick comes: a robot
that takes them one by one, or by their stamps, follows the motion as it was proved.

With a horizon the motion goes on by the clock of the stamps, whether the machine is late or not: a
robot that has a preview with stamps (`Ahead`) does not wait for this machine.
Without one, a robot follows each command as it comes, and a late command delays the motion.

Where other arms hold the DLO as well, all go by the same time along their ways: one that is late,
or is not heard of, stops all, and they come to rest together.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.guards import Enabled, Feedback, Guards
from dlo_planner.execute.limiter import (
    Limiter,
    Rising,
    accelerate,
    decelerate,
    used,
    used_by,
)
from dlo_planner.identify.online_trajectory import NARROWEST, WIDEST, Change, CorrectedTrajectory
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.stage import GRIPPER
from dlo_planner.trajectory.modal_response import slowest_period
from dlo_planner.trajectory.timed_path import TimedPath

_UNWATCHED = Guards(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True, 0.0)
# The phases of an execution that has not ended.
ACTIVE = ('running', 'settling', 'stopping', 'waiting')
_OFTEN = 0.2  # The next preview is sent after this fraction of the horizon.
LEAD = 0.1    # s; a robot has heard by then what it was told.
_REMEMBERED = 1.0  # s; for so long it is known when something was commanded.
_LATE = 0.25  # s; a robot that waits for a command for longer stands still.
_LONGER = 1.0, 1.4, 2.0, 2.8  # A correction is blended in over so many times its time, in turn.
_CORRECTED = 0.98  # A motion that is corrected may use this fraction of the limits.
_COARSE = 4   # periods; what is blended in changes little in them.
_SAMPLES, _SAME_TIME = 25, 1e-9  # s
_SEEN = 3     # The jerk of a command follows from it and so many before it.
_NOTICED = 1e-3, 5e-3  # m, rad; a robot that is nearer to the beginning goes there by itself.
_AGO = -1e6    # s
_LEAST_WINDOW, _NEXT = 0.1, 1.1  # s; each duration that is tried is so many times the last one.
EXACT = 1 + 1e-3  # of a limit: differences of rounded numbers
# what all arms of a motion have in common: how far it is, and why it ends
_IN_STEP = ('phase', 'done', 'cause', 'reason', 'pace', 'rising', 'since', 'last', 'deadline',
            'stamp', 'past', 'trail', 'published_until')


class Ahead(NamedTuple):
    """The preview: commands of the coming time, so that a machine that is late does no harm.

    All of the coming motion: the horizon, and `LEAD` after it a way to rest along the path, which
    the next message replaces. So a robot comes to rest within its limits where the messages end. A
    controller that takes trajectories with stamps, and replaces what it had from the first point on
    (as joint_trajectory_controller does), needs no more.
    """

    times: Floats      # (n,) s since `Execution.stamp`, ascending from 0, a period apart
    poses: list[Pose]  # n, of the tool frame; after the last the robot rests

    @classmethod
    def of(cls, execution: 'Execution', positions: Floats, rotations: Floats) -> 'Ahead':
        """Return the commands (n,) that lead the gripper frame through n frames."""
        back = execution.back
        return cls(execution.period * np.arange(len(positions), dtype=float), [
            Pose.from_rotation(*frame) for frame in zip(
                positions + rotations @ back.position, rotations @ back.rotation, strict=True)])


def places_ahead(execution: 'Execution') -> Floats:
    """Return the times along the way, s, of the coming commands."""
    way, period, done = execution.way, execution.period, execution.done
    if execution.phase == 'stopping':
        return np.array([done, *execution.places(len(execution.pace))])
    steps = max(int(np.ceil((execution.published_until - done) / period - 1e-9)), 0)
    places = np.array([done, *execution.places(steps)])
    if execution.published_until < way.duration:
        places = np.append(places, decelerate(execution.ways, execution.published_until,
                                              execution.kept, period, execution.lead))
    return places


class Samples:
    """Poses of a way at multiples of a period, evaluated many at once: one alone costs as much."""

    def __init__(self, way: TimedPath | CorrectedTrajectory, period: float) -> None:
        self.way, self._period = way, period
        self._known: dict[int, Pose] = {}

    def pose(self, time: float) -> Pose:
        """Return the Pose of the way at a time, s."""
        k = round(time / self._period)
        if abs(time - k * self._period) > _SAME_TIME:
            return self.way.poses([time])[0]
        if k not in self._known:
            if len(self._known) > 2 * _SAMPLES:
                self._known.clear()
            some = range(k, k + _SAMPLES)
            self._known.update(zip(some, self.way.poses(self._period * np.array(some)),
                                   strict=True))
        return self._known[k]


@dataclass(frozen=True)
class Execution:
    """One motion along a TimedPath, from its first command to rest.

    Phases: 'running'; 'settling': the end is commanded, the gripper on its way there; 'stopping':
    it decelerates; 'stopped'; 'succeeded'; 'waiting': others go on with it (`TaskLoop`).
    """

    way: TimedPath | CorrectedTrajectory  # of the gripper frame
    back: Pose                # of the tool frame in the gripper frame
    frame_id: str             # in which commands are given
    guards: Guards = field(default_factory=Guards)
    period: float = 0.02      # s between two ticks
    horizon: float = 0.0      # s of the coming motion in a preview; 0: single commands
    limits: Limits | None = None  # of all that goes out; None: those of the way
    phase: str = 'running'
    done: float = 0.0         # s along the way that are commanded; negative before its beginning
    command: Pose | None = None  # of the tool frame, now; None before the first one
    sending: Pose | None = None  # of the tool frame, goes out by itself after this tick
    ahead: Ahead | None = None   # the last preview, with a horizon
    cause: Cause = Cause.DONE    # why it stops or has stopped
    reason: str = ''
    begin: float = 0.0        # s, `done` at its first command
    refusal: str = ''         # why the last correction is not executed
    limiter: Limiter | None = None  # None before the first command
    pace: tuple[float, ...] = ()    # `done` in the coming periods, where time does not run evenly
    rising: Rising | None = None    # where it begins to
    lasting: float = 0.0      # s that its stop takes at least
    since: float = 0.0        # s since the end, by ticks: one that is late counts a period
    last: float | None = None  # time of the last tick
    deadline: float | None = None  # time at which the last command was due
    feedback: Feedback | None = None
    feedback_age: float = np.inf  # s; in ticks that were late a period counts
    enabled: Enabled | None = None
    stamp: float | None = None  # s on the clock of the stamps, at which `done` is reached
    past: tuple[tuple[float, float], ...] = ()  # (`stamp`, `done`) of the last ticks
    trail: tuple[float, ...] = ()  # `done` of the last commands, whose jerk the next one tells
    single: 'Execution | None' = None  # with a horizon: the same motion without one
    published_until: float = 0.0  # s of the path that previews hold so far, with a horizon
    last_published: float = -np.inf  # stamp of the last preview
    published_phase: str = ''  # that the last preview was of
    stall_displacement: float = 0.0  # m that late commands moved the gripper against its motion
    name: str = GRIPPER       # of the arm that goes this way
    others: tuple['Execution', ...] = ()  # of the other arms, each on a way of its own
    samples: 'Samples' = field(default=None, compare=False)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.samples is None or self.samples.way is not self.way:
            object.__setattr__(self, 'samples', Samples(self.way, self.period))

    @property
    def kept(self) -> Limits:
        """Limits of all that goes out."""
        return self.way.limits if self.limits is None else self.limits

    @property
    def active(self) -> bool:
        """Whether it is not at its end."""
        return self.phase in ACTIVE

    @property
    def arms(self) -> tuple['Execution', ...]:
        """The execution itself, of the gripper, and those of the other arms."""
        return (self, *self.others)

    @property
    def ways(self) -> list[TimedPath | CorrectedTrajectory]:
        """The ways of all arms."""
        return [one.way for one in self.arms]

    def _each(self, change: Callable[['Execution'], 'Execution']) -> 'Execution':
        """Return the execution after a change that each arm undergoes by itself."""
        out = change(self)
        return replace(out, others=tuple(map(change, self.others))) if self.others else out

    def _in_step(self) -> 'Execution':
        """Return the execution whose other arms are as far on their ways."""
        if not self.others:
            return self
        common = {name: getattr(self, name) for name in _IN_STEP}
        return replace(self, others=tuple(replace(one, **common) for one in self.others))

    def stop(self, cause: Cause, reason: str, at_once: bool = False,
             lasting: float = 0.0) -> 'Execution':
        """Return the execution that decelerates, for the first reason that was given.

        A robot that does not follow its stop has not heard of it: that counts more than the reason.
        """
        if self.phase == 'stopping' and cause is Cause.PATH_TOLERANCE is not self.cause:
            return replace(self, cause=cause, reason=f'{self.reason}; the stop is not followed: '
                                                     f'{reason}')
        if self.phase not in ('running', 'settling', 'waiting'):
            return self
        named = replace(self, cause=cause, reason=reason, since=0.0, lasting=lasting)
        ended = self.phase == 'waiting' or self.phase == 'settling' and self.alone
        if at_once or self.command is None or ended:
            return replace(named, phase='stopped')
        if self.phase == 'settling':  # single commands, which are behind, come to rest
            return replace(named, phase='stopping', pace=())
        return replace(named, phase='stopping', pace=tuple(map(float, decelerate(
            self.ways, self.done, self.kept, self.period, self.lead, self.rising, lasting))))

    @property
    def lead(self) -> int:
        """In how many periods a robot has heard of what is told: until then the motion goes on."""
        return int(np.ceil(LEAD / self.period - 1e-9)) if self.horizon else 0

    @property
    def alone(self) -> bool:
        """Whether single commands, which may be behind the preview, have ended."""
        return self.single is None or not self.single.active

    @property
    def led(self) -> list[Pose]:
        """Poses of the gripper frame to which a robot is led now, empty before the first command.

        With a horizon, one that follows the coming time, and one that follows single commands: that
        stops earlier. Where a command was held back by the limits, that is not where `command` is.
        """
        if self.command is None:
            return []
        command = self.command.compose(self.back.inverse())
        if self.horizon:
            return [command, *([] if self.single is None else self.single.led)]
        return [command if self.limiter is None or self.limiter.pose is None else self.limiter.pose]

    @property
    def ends_at_once(self) -> bool:
        """Whether a robot that has a preview has to hear that there is none any more."""
        canceled = self.phase == 'stopped' and self.cause == Cause.CANCELED
        return canceled and not self.pace and self.published_until > self.done

    @property
    def _unheard(self) -> bool:
        """Whether a robot follows a preview in which the motion does not stop yet."""
        return self.phase == 'stopping' and self.published_phase == 'running'

    def _going_on(self, steps: int) -> 'Execution':
        """Return the execution that stops so many commands later: until then the robot went on."""
        there = replace(self, phase='running', pace=(), cause=Cause.DONE, reason='')
        return there.advanced(steps).stop(self.cause, self.reason, lasting=self.lasting)

    def canceled(self) -> 'Execution':
        """Return the execution after `cancel`."""
        return self.stop(Cause.CANCELED, 'canceled', not self.guards.decelerate_on_cancel)

    def tick(self, now: float, feedback: Feedback | None = None, stamp: float | None = None,
             enabled: Enabled | None = None,
             others: Mapping[str, Feedback] = MappingProxyType({})) -> 'Execution':
        """Return the execution with its next command; `others`: what is heard of the other arms.

        However late it is called, without a horizon the motion goes on by one period at most: it
        stands still meanwhile, and does not jump. Where the gripper has come to rest by that, it
        begins again from rest. With a horizon the motion goes on by what has passed, if the robot
        has a preview of so much.
        """
        if not self.active:
            return self
        stamp = now if stamp is None else stamp
        waited = 0.0 if self.last is None else max(now - self.last, 0.0)
        timed, steps, turned_back = self._due(stamp if self.horizon else now)
        paused = self._paused(steps * self.period if self.horizon else waited)
        if paused:
            return replace(self, phase='stopped', last=now, sending=None,
                           cause=self.cause or Cause.PAUSED, reason=self.reason or paused)
        heard = {**others, self.name: feedback}
        timed = replace(timed, last=now)._in_step()._each(
            lambda one: replace(one, sending=None, enabled=enabled, feedback=heard.get(one.name),
                                feedback_age=one._feedback_age(heard.get(one.name), now,
                                                               min(waited, self.period))))
        fault = timed.fault(stamp)
        next_one = timed.stop(*fault) if fault else timed
        if not self.horizon and waited > max(_LATE, 2.5 * self.period):
            next_one = next_one._from_rest()
        next_one = next_one._going_on(steps) if next_one._unheard else next_one.advanced(steps)
        if steps or self.stamp is None or turned_back:
            due = timed.deadline if self.horizon else None
            next_one = next_one._remembered(stamp if due is None else due)
        return next_one._published(turned_back)._sent(now)._in_step()

    def _due(self, clock: float) -> tuple['Execution', int, bool]:
        """Return how many commands are due at a time (s), and whether time was turned back.

        Without a horizon one at most: what is late moves the beat, but for a period that the next
        ticks catch up.
        """
        if self.deadline is None:
            return replace(self, deadline=clock), 0, False
        behind = (clock - self.deadline) / self.period
        if behind < -1:
            return replace(self, deadline=clock), 0, True
        steps = max(int(np.floor(behind + 0.5)), 0)
        if self.horizon or steps < 2:
            return replace(self, deadline=self.deadline + steps * self.period), steps, False
        deadline = max(self.deadline + self.period, clock - self.period)
        lost = deadline - self.deadline - self.period
        stalled = self.stall_displacement + self._moves(lost)
        return replace(self, deadline=deadline, stall_displacement=stalled), 1, False

    def _from_rest(self) -> 'Execution':
        """Return the execution of a gripper that has come to rest, because no command came."""
        if self.limiter is None or self.phase == 'settling':
            return self
        if self.phase == 'stopping':
            return replace(self, phase='stopped')
        pace = accelerate(self.ways, self.done, self.kept, self.period)
        return replace(self._each(lambda one: replace(
            one, limiter=one.limiter and one.limiter.at_rest())),
            pace=tuple(map(float, pace)), rising=(0, len(pace)))

    def _paused(self, passed: float) -> str:
        """Return in words why the rest is another motion after so many s, '' if it is not."""
        limit, name = self.guards.longest_pause, 'longest_pause'
        if self.horizon:
            goes_on = self.phase == 'running' or self._unheard
            knows_all = not goes_on or self.published_until >= self.way.duration
            limit, name = 0.0 if knows_all else self.published_until - self.done, 'horizon'
        if not limit or passed <= limit + 1e-9:
            return ''
        return (f'no command was sent for {passed:.3g} s: expected execute.{name} = {limit:g} s at '
                'most')

    def _moves(self, lost: float) -> float:
        """Return the way in m that the motion goes in `lost` s."""
        if self.phase != 'running' or lost <= 0:
            return 0.0
        return lost * float(np.linalg.norm(self.way.at([self.done])[1][0, :3]))

    def _published(self, anew: bool) -> 'Execution':
        """Return the execution with its next preview, if that is due, or a new one."""
        if not self.horizon or self.phase not in ('running', 'stopping') or self.stamp is None:
            return self
        news = anew or self.phase != self.published_phase
        if self.stamp - self.last_published < _OFTEN * self.horizon and not news:
            return self
        previewed = replace(self, last_published=self.stamp, published_phase=self.phase)
        if self.phase == 'running':
            steps = int(np.ceil(self.horizon / self.period - 1e-9))
            previewed = replace(previewed, published_until=min(self.done + steps * self.period,
                                                     self.way.duration))
        before, places = len(self.trail[:-1]), [*self.trail[:-1], *places_ahead(previewed)]
        frames = [way.frames(places) for way in self.ways]
        if max(used(one, self.kept, self.period) for one in frames) <= EXACT:
            ahead = [Ahead.of(one, *(part[before:] for part in way))
                     for one, way in zip(self.arms, frames, strict=True)]
            return replace(previewed, ahead=ahead[0], others=tuple(
                replace(one, ahead=other) for one, other in zip(
                    previewed.others, ahead[1:], strict=True)))
        if self.phase == 'running':  # the preview before ends at rest
            return self.stop(Cause.LIMITS, 'the coming motion exceeds its limits')._published(True)
        return replace(self, phase='stopped')

    def _sent(self, now: float) -> 'Execution':
        """Return the execution with what goes out by itself now, within the limits.

        With a horizon that is the motion as it is without one: where this machine is late it is
        behind, and it comes to rest when this does.
        """
        if self.horizon:
            return self._sent_beside(now)
        if self.sending is None or self.limiter is None:
            return self
        out = self._each(Execution._limited)
        if all(one.limiter is None or one.limiter.rest is None for one in out.arms):
            return out
        out = out._each(lambda one: replace(one, limiter=one.limiter and one.limiter.stopping()))
        left = max(len(one.limiter.rest or ()) for one in out.arms if one.limiter is not None)
        return replace(out, phase='stopping' if left else 'stopped',
                       pace=(out.done,) * left, cause=self.cause or Cause.LIMITS,
                       reason=self.reason or 'a command exceeds the limits')

    def _limited(self) -> 'Execution':
        """Return the execution of one arm that sends what its limits let through."""
        assert self.sending is not None and self.limiter is not None  # all arms are commanded
        limiter = self.limiter.after(self.sending.compose(self.back.inverse()))
        assert limiter.pose is not None  # it was given one
        return replace(self, limiter=limiter, sending=limiter.pose.compose(self.back))

    def _sent_beside(self, now: float) -> 'Execution':
        single = self.single or replace(self._without_horizon(), others=tuple(
            one._without_horizon() for one in self.others))
        if not single.active:  # it is at rest: at the end that is said again
            return self if self.phase in ('settling', 'succeeded') else self._each(
                lambda one: replace(one, sending=None))
        single = replace(single, way=self.way, samples=self.samples)
        if self.phase in ('stopping', 'stopped'):
            single = single.stop(self.cause, self.reason, self.phase == 'stopped')
        single = single.tick(now)
        return replace(self, single=single, sending=single.sending, others=tuple(
            replace(one, single=beside, sending=beside.sending)
            for one, beside in zip(self.others, single.others, strict=True)))

    def _without_horizon(self) -> 'Execution':
        """Return the same motion of this arm alone, by single commands and without guards."""
        return Execution(self.way, self.back, self.frame_id, _UNWATCHED, self.period,
                         limits=self.kept, begin=self.begin, done=self.begin, name=self.name)

    def _remembered(self, stamp: float) -> 'Execution':
        """Return the execution that has done what it has at a time (s) of the stamps' clock."""
        kept = (one for one in self.past if stamp - _REMEMBERED < one[0] < stamp)
        return replace(self, stamp=stamp, past=(*kept, (stamp, self.done)))

    def corrected(self, way: CorrectedTrajectory) -> 'Execution':
        """Return the execution of another way from `free` on, if it leaves room for a stop.

        If it does not, it is blended in over a longer time, where nothing else is being blended in;
        else the way stays, and `refusal` says why.
        """
        last = max((change.since for change in way.changes[:-1]), default=-np.inf)
        longest = way.trajectory.duration - self.free
        part = np.inf
        for longer in _LONGER:
            windows = longer * way.windows
            # What was changed before must have ended by these windows too, or the pose would jump.
            if longer > 1 and (windows.sum() > longest or windows.max() > WIDEST
                               or last + windows.sum() > self.free):
                break
            slower = way if longer == 1 else replace(way, windows=windows)
            part = self._part(slower)
            if part <= _CORRECTED:
                return replace(self, way=slower, refusal='')
        return replace(self, refusal=f'it uses {part:.3g} of the limits of speed, acceleration and '
                       f'jerk: expected {_CORRECTED:g} at most, which leaves room for a stop')

    def _part(self, way: CorrectedTrajectory) -> float:
        """Return the part of the limits that a way uses from `free` on."""
        blended, period = self.free + way.windows.sum(), self.period
        soon = np.arange(self.free - _SEEN * period, blended + _SEEN * period, period)
        later = np.arange(blended, way.duration + _SEEN * period, _COARSE * period)
        return max(used(way.frames(times), self.kept, step) for times, step in (
            (soon, period), (later, _COARSE * period)) if len(times) > 1)

    def done_at(self, stamp: float) -> float:
        """Return s of the way that are done at a time (s) of the stamps' clock, now or before."""
        if not self.past:
            return self.done
        stamps, done = zip(*self.past, strict=True)
        before = max(float(stamps[0]) - stamp, 0.0)  # what is remembered
        return max(float(np.interp(stamp, stamps, done)) - before, min(float(done[0]), 0.0))

    @property
    def free(self) -> float:
        """From which time of its way on the motion may be changed, s."""
        return max(self.done, self.published_until)

    def advanced(self, steps: int) -> 'Execution':
        """Return the execution so many commands later."""
        if self.command is None:
            first = self._each(lambda one: replace(
                one, limiter=Limiter(self.kept, self.period), published_until=self.done))
            return first._commanded([self.done]).settled()
        if self.phase == 'settling':
            # Where this machine is late, the gripper may be late too, or what is heard of it.
            passed = self.period if steps and self.alone else 0.0
            out = replace(self, since=self.since + passed)
            return (out._each(lambda one: replace(one, sending=one.command))
                    if steps else out).settled()
        if self.phase not in ('running', 'stopping') or not steps:
            return self
        places = self.places(steps)
        rising = self.rising and (self.rising[0] + steps, self.rising[1])
        out = replace(self, pace=self.pace[steps:], done=places[-1],
                      rising=rising if rising and rising[0] < rising[1] else None)
        return out._commanded(places).settled()

    def places(self, steps: int) -> list[float]:
        """Return `done` after each of the coming periods."""
        known = list(self.pace[:steps])
        last = known[-1] if known else self.done
        even = self.period if self.phase == 'running' else 0.0
        # A clock that jumps ahead asks for more than there is.
        left = int(np.ceil(max(self.way.duration - last, 0.0) / self.period)) + 1 if even else 1
        more = [last + even * k for k in range(1, min(steps - len(known), left) + 1)]
        return [min(place, self.way.duration) for place in known + more]

    def _commanded(self, places: list[float]) -> 'Execution':
        """Return the execution with commands at times along its way, which are due now."""
        if not places:
            return self
        trail = (*self.trail, *places)[-_SEEN - 1:]
        return replace(self._each(lambda one: one._at(places[-1])), trail=trail)

    def _at(self, place: float) -> 'Execution':
        """Return the execution of one arm that is commanded to a time of its way, s."""
        command = self._pose(place)
        return replace(self, command=command, sending=command)

    def settled(self) -> 'Execution':
        """Return the execution at the end of its way: succeeded, too late, or still waiting.

        Or stopped, where it has come to rest before.
        """
        alone = self.alone
        if self.phase == 'stopping' and not self.pace and alone:
            return replace(self, phase='stopped')
        if self.phase == 'running' and self.done >= self.way.duration:
            return replace(self, phase='settling', since=0.0).settled()
        if self.phase != 'settling':
            return self
        guards = self.guards
        if not (guards.goal_position or guards.goal_angle):
            return replace(self, phase='succeeded') if alone else self
        away = next(filter(None, (one._off(
            guards.goal_position, guards.goal_angle, 'constraints.goal') for one in self.arms)),
            None)
        if away is None and alone and all(one.feedback is not None for one in self.arms):
            return replace(self, phase='succeeded')
        if self.since > guards.patience:
            late = f'{guards.patience:g} s after the end of the motion {away or "no pose came"}'
            return replace(self, phase='stopped', cause=Cause.GOAL_TOLERANCE, reason=late)
        return self

    def _pose(self, done: float) -> Pose:
        return self.samples.pose(done).compose(self.back)

    def _feedback_age(self, feedback: Feedback | None, now: float, step: float) -> float:
        """Return the age of a gripper pose, s.

        Where this machine is late, poses may be as late to be heard: a tick adds a period at most.
        """
        if feedback is None:
            return np.inf
        if feedback is not self.feedback:
            return feedback.age + min(max(now - feedback.arrived, 0.0), self.period)
        return self.feedback_age + step

    def fault(self, stamp: float) -> tuple[Cause, str] | None:
        """Return the cause and the reason to stop at a time (s) of the stamps' clock, or None.

        Of any arm.
        """
        return next(filter(None, (one._fault(stamp) for one in self.arms)), None)

    def _fault(self, stamp: float) -> tuple[Cause, str] | None:
        """Return the same of one arm."""
        guards, feedback, age = self.guards, self.feedback, self.feedback_age
        limit = guards.incoming_command_timeout
        if limit and not age <= limit:
            came = 'none came' if feedback is None else f'the last one is {age:.3g} s old'
            return (Cause.GRIPPER_POSE_LOST, f'{guards.heard}: {came}: expected '
                    f'incoming_command_timeout = {limit:g} s at most, by its stamp')
        barred = guards.barred(self.enabled, self.last or 0.0)
        if barred:
            return Cause.NOT_ENABLED, barred
        stops = self.phase == 'stopping' and self.horizon > 0  # by a message that may be lost
        behind = self.phase == 'settling' and not self.alone  # a robot may be, with what it is sent
        moves = self.phase == 'running' or stops or behind
        if not moves or feedback is None or self.command is None:
            return None
        away = self._left(feedback, stamp)
        if away is not None:
            return Cause.PATH_TOLERANCE, away
        if not stops and guards.path_shape and feedback.deviation > guards.path_shape:
            return (Cause.SHAPE_TOLERANCE, f'the DLO is {feedback.deviation:.3g} m from its plan: '
                    f'expected constraints.path.shape = {guards.path_shape:g} m at most')
        return None

    def _left(self, feedback: Feedback, stamp: float) -> str | None:
        """Return in words how the gripper has left its commands; None: it follows them.

        With a horizon a robot follows the coming time, or single commands, which are behind where
        this machine is late: whichever it is nearer to is what it follows.
        """
        commands = [self._then(feedback, stamp)]
        if self.single is not None:
            heard = feedback.arrived - feedback.age
            commands.append(self.single._pose(self.single.done_at(heard)))
        guards, here = self.guards, feedback.pose.position
        found = [(np.inf if one is None else float(np.linalg.norm(one.position - here)), self._off(
            guards.path_position, guards.path_angle, 'constraints.path', one)) for one in commands]
        return None if None in (away for _, away in found) else min(found)[1]

    def _then(self, feedback: Feedback, now: float) -> Pose | None:
        """Return the command of the time at which the gripper was where it was heard.

        So a message that is late is not taken for a robot that is. Without a horizon the last
        command stands; it counts as far back as `incoming_command_timeout` lets poses be old, and
        not at all without that guard.
        """
        if feedback.stamp is None or self.stamp is None or now < self.stamp:
            return self.command
        if not self.horizon:
            oldest = self.stamp - self.guards.incoming_command_timeout
            return self._pose(self.done_at(max(feedback.stamp, oldest)))
        since = min(feedback.stamp, now) - self.stamp  # a robot that knows the coming time went on
        return self._pose(min(self.done + since, max(self.published_until, self.done)) if since > 0
                          else self.done_at(feedback.stamp))

    def _off(self, position: float, angle: float, name: str,
             command: Pose | None = None) -> str | None:
        """Return in words how the gripper is off the command; None: it is within tolerances."""
        feedback, command = self.feedback, command or self.command
        if feedback is None or command is None:
            return None
        away = float(np.linalg.norm(feedback.pose.position - command.position))
        if position and away > position:
            return (f'{self._called} is {away:.3g} m from its command: expected '
                    f'{name}.position = {position:g} m at most')
        turned = angle_between(feedback.pose.rotation, command.rotation)
        if angle and turned > angle:
            return (f'{self._called} is turned by {turned:.3g} rad from its command: expected '
                    f'{name}.angle = {angle:g} rad at most')
        return None

    @property
    def _called(self) -> str:
        return called(self.name)


def called(name: str) -> str:
    """Return what messages call an arm."""
    return 'the gripper' if name == GRIPPER else f'the arm {name}'


def blend_from_current_pose(ways: Sequence[TimedPath], here: Sequence[Pose], shape: Shape,
                            limits: Limits,
                            period: float) -> tuple[list[TimedPath | CorrectedTrajectory], float]:
    """Return motions of k arms that begin at a pose each, and their time there, s: 0, or negative.

    The arms go to the beginnings of their ways without swinging the DLO, within the limits, and
    stand still; then they go their ways as those were proved: they are hardly ever exactly where
    the plan begins. The gripper's way is the first.
    """
    away = [_away(way.poses([0.0])[0], pose) for way, pose in zip(ways, here, strict=True)]
    leaving = [np.linalg.norm(one[3:]) > _NOTICED[0] or np.linalg.norm(one[:3]) > _NOTICED[1]
               for one in away]
    if not any(leaving):
        return list(ways), 0.0
    periods, least = _periods(ways[0], shape), _LEAST_WINDOW
    while least <= WIDEST:
        # a window of several periods excites the vibration no more than one of one period
        windows = np.append(periods * np.maximum(np.ceil(least / periods - 1e-9), 1), least)
        if windows.max() > WIDEST:
            break
        steps = int(np.ceil(windows.sum() / period))
        begin = -steps * period
        begun: list[TimedPath | CorrectedTrajectory] = [
            CorrectedTrajectory(way, windows, (Change(_AGO, np.zeros(1), one[None]),
                                   Change(begin, np.zeros(1), -one[None]))) if leaves else way
            for way, one, leaves in zip(ways, away, leaving, strict=True)]
        times = begin + period * np.arange(-3, steps + 1)
        if used_by(begun, times, limits, period) <= 1:
            return begun, begin
        least *= _NEXT
    far = np.max([[np.linalg.norm(one[3:]), np.linalg.norm(one[:3])] for one in away], axis=0)
    who = called(GRIPPER) if len(ways) == 1 else 'an arm'
    raise Refused(Cause.NOT_AT_START, f'{who} is {far[0]:.3g} m and {far[1]:.3g} rad from where '
                  f'the plan begins, which it cannot reach calmly in {3 * WIDEST:g} s within its '
                  'limits of speed, acceleration and jerk (threading.*): expected it to be nearer')


def _away(first: Pose, here: Pose) -> Floats:
    """Return the rotation vector, rad, and displacement, m, (6,) from a Pose to another one."""
    turn = Rotation.from_matrix(here.rotation @ first.rotation.T).as_rotvec()
    return np.concatenate([turn, here.position - first.position])


def _periods(way: TimedPath, shape: Shape) -> Floats:
    """Return (2,) the periods, s, of the DLO in a Shape that must not be excited."""
    try:
        return CorrectedTrajectory.of(way, shape).windows[:2]
    except InvalidTask:  # modes are not defined for all shapes
        rod: Any = shape.rod  # a plan's shapes know it
        return np.repeat(np.clip(slowest_period(rod), NARROWEST, WIDEST), 2)
