# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything that `dlo_planner` raises on purpose; each error carries its evidence.

The types of that evidence stand in the docstrings alone: they are made far above, from here no
import goes up.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isnan
from typing import Any


class DloPlannerError(Exception):
    """Base of all errors of this package; each keeps its evidence through pickle."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (type(self), self.args, self.__dict__)


def _rebuilt(kind: type[DloPlannerError], args: tuple[Any, ...],
             evidence: dict[str, Any]) -> DloPlannerError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(evidence)
    return error


class InvalidRod(DloPlannerError, ValueError):
    """A property of the DLO makes no sense; the message names it, its value and what is right."""


class InvalidTask(DloPlannerError, ValueError):
    """A pose, cut-out, option or request makes no sense; the message says which and why."""


class DoubtfulInput(UserWarning):
    """What was given is possible, but probably not meant: in another unit, or beyond the model.

    A warning, shown by Python's `warnings`, on the terminal and in the node's log.
    """


class MissingExtra(DloPlannerError, ModuleNotFoundError):
    """An optional package is not installed; the message names the extra that installs it."""


class NotConverged(DloPlannerError):
    """The minimizer found no equilibrium where one is needed.

    Attributes
    ----------
    shape : Shape or None
        The last shape, with `converged` False and its residual (None if there is none).
    """

    def __init__(self, message: str, shape: Any = None) -> None:
        super().__init__(message)
        self.shape = shape


class Infeasible(DloPlannerError):
    """The task has no admissible solution from some waypoint on.

    Attributes
    ----------
    waypoint : int
        Index of the first waypoint without an admissible solution.
    constraint : str
        Short name of what is violated, e.g. 'stability'.
    amount : float
        Size of the violation, in `unit`; the message ends with both. nan where none is known.
    unit : str
        SI unit of the amount, '' for a ratio. If None, m, and of stability a ratio.
    plan : Plan or None
        The plan up to that waypoint (`fraction` < 1), as evidence, or None.
    prove : callable or None
        Function () -> str, see `certificate`.
    advise : callable or None
        Function () -> str, see `advice`.
    """

    def __init__(self, message: str, waypoint: int, constraint: str, amount: float,
                 plan: Any = None, unit: str | None = None) -> None:
        if unit is None:
            unit = '' if constraint == 'stability' else 'm'
        size = '' if isnan(amount) else f', by {amount:.4g} {unit}'.rstrip()
        super().__init__(f'{message} ({constraint}{size})')
        self.waypoint = waypoint
        self.constraint = constraint
        self.amount = amount
        self.unit = unit
        self.plan = plan
        self.prove: Callable[[], str] | None = None
        self.advise: Callable[[], str] | None = None

    @property
    def certificate(self) -> str:
        """At which depths of a cut-out the DLO has stable shapes, and where their chain breaks.

        Of a threading through one cut-out that no shape does, or how many pass both of two: all
        shapes in which the DLO hangs are looked at, about 0.2 s; '' of another refusal, which
        nobody has looked at so.
        """
        return '' if self.prove is None else self.prove()

    @property
    def advice(self) -> str:
        """What would have to change, in words, where that was looked for; else ''.

        Of a threading through one cut-out that has a size: held how near to its end, with the
        sheet turned downwards how far, or through how large a hole the DLO would pass. Each is
        tried by a plan; that takes 0.3 to 1.5 s, of a naturally bent DLO 0.8 to 3 s.
        """
        return '' if self.advise is None else self.advise()


class DeadlineExceeded(DloPlannerError, TimeoutError):
    """A computation did not finish within its `deadline`; the task may still be feasible.

    Steps look at it every 5 to 50 ms, so it is raised by about 0.1 s too late. What is loaded or
    compiled when a kernel is first used in a process, which may take seconds, is not ended.

    Attributes
    ----------
    seconds : float
        Seconds that were allowed.
    elapsed : float
        Seconds that had passed when the computation was ended.
    """

    def __init__(self, message: str, seconds: float, elapsed: float) -> None:
        super().__init__(message)
        self.seconds = seconds
        self.elapsed = elapsed
