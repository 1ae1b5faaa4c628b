# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a step leaves to the next one, besides the shape that can be seen."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, shown
from dlo_planner.model.value import Constant, Value

_NOT_KNOWN = Constant(float('nan'))


@dataclass(frozen=True, eq=False, repr=False)
class State(Value):
    """What a Shape carries along, opaque to users: it goes on where the Shape ends.

    Two are equal if the next step begins with the same past.

    Attributes
    ----------
    mesh : Discretization or None
        Mesh and surroundings for which the Shape was computed. If None, not known: it is from a
        file, or was changed by hand.
    history : History or None
        What it leaves to the next step. If None, nothing is known.
    before : History or None
        What the step began with.
    estimate : callable
        Returns how far, in m, a node is from the true rod's at most; see `Shape.error_estimate`.
    """

    mesh: Discretization | None = field(default=None, compare=False)
    history: History | None = None
    before: History | None = field(default=None, compare=False)
    estimate: Callable[[], float] = field(default=_NOT_KNOWN, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.mesh, Discretization):  # else a simulator made it
            self._judge()

    def _judge(self) -> None:
        """Check what comes from elsewhere; its parts are values, nothing is to be frozen."""
        instance('State.mesh', self.mesh, Discretization, optional=True)
        for name in ('history', 'before'):
            instance(f'State.{name}', getattr(self, name), History, optional=True)
        if not callable(self.estimate):
            raise InvalidTask(f'State.estimate = {shown(self.estimate)}: expected a function')

    @classmethod
    def made(cls, mesh: Discretization, history: History, before: History,
             estimate: Callable[[], float]) -> 'State':
        """Return the State of a Shape that a simulator makes: quicker, nothing is to be judged."""
        state = object.__new__(cls)
        state.__dict__.update(mesh=mesh, history=history, before=before, estimate=estimate)
        return state

    @property
    def made_on(self) -> Discretization:
        """The mesh, of a Shape from a simulator.

        Raises
        ------
        InvalidTask
            It is from elsewhere.
        """
        if self.mesh is None:
            raise InvalidTask('Shape.mesh = None: expected a shape that comes from a simulator')
        return self.mesh

    @property
    def left(self) -> History:
        """The history, of a Shape from a simulator; raises as `made_on`."""
        if self.history is None:
            raise InvalidTask('Shape.history = None: expected a shape that comes from a simulator')
        return self.history

    @property
    def held(self) -> History:
        """What the step began with, under the forces after it; raises as `made_on`."""
        if self.before is None:
            raise InvalidTask('Shape.state: expected a shape that comes from a simulator')
        return self.before.with_contacts(self.left)

    @property
    def kept(self) -> bool:
        """Whether it is that of a Shape from a file, with the past that it had."""
        return self.mesh is None and self.history is not None and self.history.of is None

    def forgotten(self) -> 'State':
        """Return what is left of it where the Shape was changed by hand: its error estimate."""
        return State(estimate=self.estimate)

    def estimating(self, estimate: Callable[[], float]) -> 'State':
        """Return the same with another error estimate."""
        return replace(self, estimate=estimate)

    def resampled(self, s: Floats, error: float) -> 'State':
        """Return the past on other nodes `s` (n + 1,), m, of a Shape with a known error, m."""
        history = None if self.history is None else self.history.resampled(s)
        return State(history=history, estimate=Constant(error))


UNKNOWN = State()
