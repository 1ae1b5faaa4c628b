# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""When to look, plan anew, go and correct: the strategy of a threading with a camera.

A state machine without side effects: its inputs are the time and what has happened, its output is
the next phase. Look, plan anew for the estimated DLO, go to the standoff, look again there if the
predicted miss is too large a part of the room, and enter only if the miss is inside the room with
95 %. Where looks do not agree with each other, or the miss grows beyond the room before the entry,
stop, go back before the sheet, and try again a few times. A look at rest begins anew as long as
what is seen does not agree: the DLO swings, or has slipped. A swing is taken away by the gripper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import choice, flag, instance, integer, number
from dlo_planner.model.value import Value, put

_NEARLY = 1.15  # of the room: a bound that further looks may bring inside, they lower it by some %
_PATIENT = 2    # times as many looks then


class Phase(Enum):
    """What a driver has to do now."""

    LOOK = 'look'    # stand still and look
    PLAN = 'plan'    # make a plan, or at the standoff a correction, for the estimated DLO
    GO = 'go'        # go to the standoff, with corrections
    ENTER = 'enter'  # go through the cut-out, with corrections
    CALM = 'calm'    # move a little, so that the DLO swings no more
    RETREAT = 'retreat'  # stop, and from behind the standoff go back to it
    DONE = 'done'
    STOP = 'stop'    # stand still: the miss is not inside the room with 95 %, or looks disagree

    @classmethod
    def _missing_(cls, value: object) -> None:
        choice('Phase', value, [one.value for one in cls])


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop(Value):
    """Strategy of a threading with a camera, and the state that one threading has reached in it.

    Attributes
    ----------
    room : float
        Distance by which the DLO may miss the center, m.
    look : float
        Duration of a LOOK without a doubt, s; the DLO should swing a few times in it.
    pause : float
        Time from a doubt in a LOOK until it begins anew, s: what swings takes long to come to rest.
    patience : float
        Duration of a LOOK with doubts after which the phase is STOP, s.
    period : float
        Time between two corrections on the way, s.
    share : float
        Part of the room: if the first bound at the standoff is larger, there is one more look;
        after that only a bound larger than the room asks for another.
    most_looks : int
        Number of looks at the standoff, at most, and twice as many where the bound exceeds the room
        by less than 15 %: what swings decays, and noise is averaged. If it still exceeds the room
        then, the phase is STOP.
    most_tries : int
        How often it tries again after looks disagreed, or the bound exceeded the room before the
        entry; the next time the phase is STOP. Each entry may miss with 5 %: the more are tried,
        the more will.
    phase : Phase
    since : float or None
        Time at which the phase began, s. If None, it begins with the first `advanced`.
    corrected : float or None
        Time of the last correction, s. If None, there was none.
    looks : int
        Number of looks at the standoff so far.
    at_standoff : bool
        Whether the gripper has arrived there.
    tries : int
        How often looks came to disagree, or the bound to exceed the room, so far.
    doubted : float or None
        Time at which a LOOK last begins anew, s. If None, it did not.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    room: float
    look: float = 2.0
    pause: float = 1.0
    patience: float = 90.0
    period: float = 0.5
    share: float = 0.25
    most_looks: int = 3
    most_tries: int = 2
    phase: Phase = Phase.LOOK
    since: float | None = None
    corrected: float | None = None
    looks: int = 0
    at_standoff: bool = False
    tries: int = 0
    doubted: float | None = None

    def __post_init__(self) -> None:
        put(self, room=number('ClosedLoop.room', self.room, above=0),
            share=number('ClosedLoop.share', self.share, above=0, maximum=1),
            tries=integer('ClosedLoop.tries', self.tries, minimum=0, maximum=1001),
            at_standoff=flag('ClosedLoop.at_standoff', self.at_standoff),
            **{name: number(f'ClosedLoop.{name}', getattr(self, name), minimum=0)
               for name in ('look', 'pause', 'patience', 'period')},
            **{name: integer(f'ClosedLoop.{name}', getattr(self, name), minimum=0, maximum=1000)
               for name in ('most_looks', 'looks', 'most_tries')})
        instance('ClosedLoop.phase', self.phase, Phase)
        for name in ('since', 'corrected', 'doubted'):
            if getattr(self, name) is not None:
                put(self, **{name: number(f'ClosedLoop.{name}', getattr(self, name))})
        super().__post_init__()

    @property
    def calm(self) -> float:
        """Time since which there was no doubt in a LOOK that has begun, s; it may be to come."""
        assert self.since is not None
        return self.since if self.doubted is None else max(self.since, self.doubted)

    def correction_due(self, time: float) -> bool:
        """Return whether a correction is due at `time` (s): only in the phases GO and ENTER."""
        time = number('time', time)
        moving = self.phase in (Phase.GO, Phase.ENTER)
        return moving and (self.corrected is None or time - self.corrected >= self.period)

    def with_correction(self, time: float) -> ClosedLoop:
        """Return this state after a correction at `time` (s)."""
        return replace(self, corrected=number('time', time))

    def advanced(self, time: float, bound: float | None = None, *, finished: bool = False,
                 doubted: bool = False) -> ClosedLoop:
        """Return the state at `time`: the same phase, or the next one.

        Parameters
        ----------
        time : float
            Present time, s.
        bound : float, optional
            95 % bound of the miss at the entry, m, of the corrected plan (`Estimate.miss`); may be
            infinite. Needed when GO is finished, and when PLAN is at the standoff. In ENTER: before
            the entry, where it may still turn back.
        finished : bool, optional
            Whether the phase is done: the plan made, the standoff reached, the DLO at its depth,
            the gripper back, or at rest again (a LOOK ends by its duration).
        doubted : bool, optional
            Whether the last looks do not agree with the estimate (`Estimate.agrees`), or nothing
            was seen. What they came to disagree about has to be open again in what follows.

        Raises
        ------
        InvalidTask
            An argument makes no sense, or the bound is needed.
        """
        time, finished = number('time', time), flag('finished', finished)
        if bound is not None and not (isinstance(bound, float) and bound == float('inf')):
            bound = number('bound', bound, minimum=0)
        since = time if self.since is None else self.since
        state = replace(self, since=since)
        if state.phase in (Phase.DONE, Phase.STOP):
            return state
        doubted = flag('doubted', doubted)
        if state.phase is Phase.LOOK:
            if doubted and time - since >= state.patience:
                return state._to(Phase.STOP, time)
            if doubted:
                return replace(state, doubted=time + state.pause)
            return state._to(Phase.PLAN, time) if time - state.calm >= state.look else state
        if state.phase is Phase.CALM:  # `since` stays: patience is of all looks together
            return replace(state, phase=Phase.LOOK, doubted=time) if finished else state
        if doubted and state.phase is not Phase.RETREAT:
            return state._doubting(time)
        if state.phase is Phase.ENTER:
            if bound is not None and bound > state.room:
                return state._doubting(time)
            return state._to(Phase.DONE, time) if finished else state
        if not finished:
            return state
        if state.phase is Phase.RETREAT:
            return state._to(Phase.STOP if state.tries > state.most_tries else Phase.LOOK, time)
        if state.phase is Phase.PLAN and not state.at_standoff:
            return state._to(Phase.GO, time)
        if bound is None:
            raise InvalidTask(f'bound = None: expected the predicted miss at the standoff, phase '
                              f'{state.phase.value!r}')
        return replace(state, at_standoff=True)._at_standoff(time, bound)

    def calming(self, time: float) -> ClosedLoop:
        """Return the state that takes a swing away from `time` (s) on, and then looks anew.

        Raises
        ------
        InvalidTask
            The phase is not LOOK.
        """
        time = number('time', time)
        if self.phase is not Phase.LOOK:
            raise InvalidTask(f'phase = {self.phase.value!r}: expected {Phase.LOOK.value!r}, in '
                              'which the gripper stands')
        return replace(self, phase=Phase.CALM, since=time if self.since is None else self.since,
                       doubted=time)

    def _doubting(self, time: float) -> ClosedLoop:
        """Return the state that tries again: in motion it stops and goes back first."""
        state = replace(self, tries=self.tries + 1, looks=0)
        if state.phase in (Phase.GO, Phase.ENTER):
            return state._to(Phase.RETREAT, time)
        return state._to(Phase.STOP if state.tries > state.most_tries else Phase.LOOK, time)

    def _at_standoff(self, time: float, bound: float) -> ClosedLoop:
        nearly = self.room < bound <= _NEARLY * self.room
        most = _PATIENT * self.most_looks if nearly else self.most_looks
        if bound > self.share * self.room and self.looks < most and (
                self.looks == 0 or bound > self.room):
            return replace(self, looks=self.looks + 1)._to(Phase.LOOK, time)
        return self._to(Phase.ENTER if bound <= self.room else Phase.STOP, time)

    def _to(self, phase: Phase, time: float) -> ClosedLoop:
        return replace(self, phase=phase, since=time)
