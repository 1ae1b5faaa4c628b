"""When to look, to plan anew, to go and to correct: the strategy of a threading with a camera.

A state machine without side effects: it is told the time and what has happened, and says what to do
next. Look, plan anew for the DLO as it is, go to the standoff, look again there if the predicted
miss is too large a part of the room, go in only if it is inside the room with 95 %.
"""

from dataclasses import dataclass, replace
from enum import Enum

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import choice, flag, instance, integer, number
from dlo_planner.model.value import Value, put


class Phase(Enum):
    """What to do."""

    LOOK = 'look'    # stand still, take looks in
    PLAN = 'plan'    # make a plan, or a correction at the standoff, for the DLO as it is estimated
    GO = 'go'        # to the standoff, with corrections
    ENTER = 'enter'  # through the cut-out, with corrections
    DONE = 'done'
    STOP = 'stop'    # stand still: the cut-out is not sure to be hit

    @classmethod
    def _missing_(cls, value):
        choice('Phase', value, [one.value for one in cls])


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop(Value):
    """The strategy, and where in it a threading is.

    Attributes:
        room: m that the DLO may be off the centre
        look: s of standing still for looks; the DLO should swing a few times meanwhile
        period: s between two corrections on the way
        share: part of the room, beyond which the predicted miss asks for another look
        most_looks: at the standoff, before it stops
        phase: Phase
        since: time at which it began, s; None: at the first `advanced`
        corrected: time of the last correction, s; None: there was none
        looks: at the standoff so far
        at_standoff: whether the gripper has arrived there
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

    def __post_init__(self):
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
        """Return whether a correction should be made at `time` (s), on the way."""
        time = number('time', time)
        moving = self.phase in (Phase.GO, Phase.ENTER)
        return moving and (self.corrected is None or time - self.corrected >= self.period)

    def with_correction(self, time: float) -> 'ClosedLoop':
        """Return the same after a correction at `time` (s)."""
        return replace(self, corrected=number('time', time))

    def advanced(self, time: float, bound: float | None = None, *,
                 finished: bool = False) -> 'ClosedLoop':
        """Return what comes next.

        Args:
            time: s
            bound: m, the predicted miss with 95 % at the entry, of the plan as it is corrected;
                needed where `phase` is PLAN, and on arrival at the standoff
            finished: whether what the phase asks for is done: the plan made, the standoff
                reached, the threading at its depth (a LOOK ends by itself)

        Raises:
            InvalidTask: an argument makes no sense, or the bound is needed
        """
        time, finished = number('time', time), flag('finished', finished)
        if bound is not None and not (isinstance(bound, float) and bound == float('inf')):
            bound = number('bound', bound, minimum=0)
        here = self if self.since is not None else replace(self, since=time)
        if here.phase is Phase.LOOK:
            over = time - here.since >= here.look
            return here._to(Phase.PLAN, time) if over else here
        if not finished or here.phase in (Phase.DONE, Phase.STOP):
            return here
        if here.phase is Phase.ENTER:
            return here._to(Phase.DONE, time)
        if here.phase is Phase.PLAN and not here.at_standoff:
            return here._to(Phase.GO, time)
        if bound is None:
            raise InvalidTask(f'bound = None: expected the predicted miss at the standoff, phase '
                              f'{here.phase.value!r}')
        return replace(here, at_standoff=True)._at_standoff(time, bound)

    def _at_standoff(self, time, bound):
        if bound > self.share * self.room and self.looks < self.most_looks and (
                self.looks == 0 or bound > self.room):
            return replace(self, looks=self.looks + 1)._to(Phase.LOOK, time)
        return self._to(Phase.ENTER if bound <= self.room else Phase.STOP, time)

    def _to(self, phase, time):
        return replace(self, phase=phase, since=time)
