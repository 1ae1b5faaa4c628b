# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""When to look, plan anew, go and correct: the strategy of a threading with a camera.

A state machine without side effects: its inputs are the time and what has happened, its output is
the next phase. Look, plan anew for the estimated DLO, go to the standoff, look again there if the
predicted miss is too large a part of the room, and enter only if the miss is inside the room with
95 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import choice, flag, instance, integer, number
from dlo_planner.model.value import Value, put


class Phase(Enum):
    """What a driver has to do now."""

    LOOK = 'look'    # stand still and look
    PLAN = 'plan'    # make a plan, or at the standoff a correction, for the estimated DLO
    GO = 'go'        # go to the standoff, with corrections
    ENTER = 'enter'  # go through the cut-out, with corrections
    DONE = 'done'
    STOP = 'stop'    # stand still: the predicted miss is not inside the room with 95 %

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
        Duration of a LOOK, s; the DLO should swing a few times in it.
    period : float
        Time between two corrections on the way, s.
    share : float
        Part of the room: if the first bound at the standoff is larger, there is one more look;
        after that only a bound larger than the room asks for another.
    most_looks : int
        Number of looks at the standoff, at most; if the bound still exceeds the room, the phase is
        STOP.
    phase : Phase
    since : float or None
        Time at which the phase began, s. If None, it begins with the first `advanced`.
    corrected : float or None
        Time of the last correction, s. If None, there was none.
    looks : int
        Number of looks at the standoff so far.
    at_standoff : bool
        Whether the gripper has arrived there.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    room: float
    look: float = 2.0
    period: float = 0.5
    share: float = 0.25
    most_looks: int = 3
    phase: Phase = Phase.LOOK
    since: float | None = None
    corrected: float | None = None
    looks: int = 0
    at_standoff: bool = False

    def __post_init__(self) -> None:
        put(self, room=number('ClosedLoop.room', self.room, above=0),
            look=number('ClosedLoop.look', self.look, minimum=0),
            period=number('ClosedLoop.period', self.period, above=0),
            share=number('ClosedLoop.share', self.share, above=0, maximum=1),
            most_looks=integer('ClosedLoop.most_looks', self.most_looks, minimum=0, maximum=1000),
            looks=integer('ClosedLoop.looks', self.looks, minimum=0, maximum=1000),
            at_standoff=flag('ClosedLoop.at_standoff', self.at_standoff))
        instance('ClosedLoop.phase', self.phase, Phase)
        for name in ('since', 'corrected'):
            if getattr(self, name) is not None:
                put(self, **{name: number(f'ClosedLoop.{name}', getattr(self, name))})
        super().__post_init__()

    def correction_due(self, time: float) -> bool:
        """Return whether a correction is due at `time` (s): only in the phases GO and ENTER."""
        time = number('time', time)
        moving = self.phase in (Phase.GO, Phase.ENTER)
        return moving and (self.corrected is None or time - self.corrected >= self.period)

    def with_correction(self, time: float) -> ClosedLoop:
        """Return this state after a correction at `time` (s)."""
        return replace(self, corrected=number('time', time))

    def advanced(self, time: float, bound: float | None = None, *,
                 finished: bool = False) -> ClosedLoop:
        """Return the state at `time`: the same phase, or the next one.

        Parameters
        ----------
        time : float
            Present time, s.
        bound : float, optional
            95 % bound of the miss at the entry, m, of the corrected plan (`Estimate.miss`); may be
            infinite. Needed when GO is finished, and when PLAN is at the standoff.
        finished : bool, optional
            Whether the phase is done: the plan made, the standoff reached, the DLO at its depth (a
            LOOK ends by its duration).

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
        if state.phase is Phase.LOOK:
            over = time - since >= state.look
            return state._to(Phase.PLAN, time) if over else state
        if not finished or state.phase in (Phase.DONE, Phase.STOP):
            return state
        if state.phase is Phase.ENTER:
            return state._to(Phase.DONE, time)
        if state.phase is Phase.PLAN and not state.at_standoff:
            return state._to(Phase.GO, time)
        if bound is None:
            raise InvalidTask(f'bound = None: expected the predicted miss at the standoff, phase '
                              f'{state.phase.value!r}')
        return replace(state, at_standoff=True)._at_standoff(time, bound)

    def _at_standoff(self, time: float, bound: float) -> ClosedLoop:
        if bound > self.share * self.room and self.looks < self.most_looks and (
                self.looks == 0 or bound > self.room):
            return replace(self, looks=self.looks + 1)._to(Phase.LOOK, time)
        return self._to(Phase.ENTER if bound <= self.room else Phase.STOP, time)

    def _to(self, phase: Phase, time: float) -> ClosedLoop:
        return replace(self, phase=phase, since=time)
