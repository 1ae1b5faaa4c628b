# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a long computation has come, and when it has to end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import monotonic

from dlo_planner.errors import DeadlineExceeded, InvalidTask
from dlo_planner.model.checks import callback, number, shown

OnProgress = Callable[[int, int], object] | None  # called as progress(done, total)


_INTERRUPT: ContextVar[Callable[[], object] | None] = ContextVar('interrupt', default=None)


@contextmanager
def interrupted_by(check: Callable[[], object]) -> Iterator[None]:
    """Let `check` end all computations that begin inside the context.

    It is called between their steps, as deadlines are; an exception that it raises ends the
    computation. Other threads are not affected.

    Parameters
    ----------
    check : callable
        Function without arguments.

    Raises
    ------
    InvalidTask
        It is not a function.
    """
    if callback('check', check) is None:
        raise InvalidTask('check = None: expected a function')
    token = _INTERRUPT.set(check)
    try:
        yield
    finally:
        _INTERRUPT.reset(token)


class Progress:
    """Reports the steps of one computation and ends it at its deadline.

    Parameters
    ----------
    report : callable, optional
        Called as report(done, total) after each step, or None.
    deadline : float, optional
        Seconds from now, after which the next step raises DeadlineExceeded. If None, there is no
        limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    def __init__(self, report: OnProgress = None, deadline: float | None = None):
        self._report = callback('progress', report)
        self._seconds = None if deadline is None else number('deadline', deadline, above=0)
        self._begun = monotonic()
        self._interrupt = _INTERRUPT.get()

    def done(self, done: int, total: int) -> None:
        """Report that `done` of `total` steps are finished; raises DeadlineExceeded."""
        if self._report is not None:
            try:
                self._report(done, total)
            except (TypeError, ValueError) as error:
                if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                    raise  # it is the function's own
                raise InvalidTask(f'progress = {shown(self._report)}: expected a function '
                                  f'of (done, total): {error}') from error
        self.check()

    def silent(self) -> Progress:
        """Return one with the same end that reports nothing: for parts of the computation."""
        other = Progress()
        other._seconds, other._begun = self._seconds, self._begun
        other._interrupt = self._interrupt
        return other

    def left(self) -> float | None:
        """Return the seconds until the deadline, more than 0; None if there is none."""
        return None if self._seconds is None else max(
            self._seconds - (monotonic() - self._begun), 1e-9)

    def check(self) -> None:
        """Raise DeadlineExceeded if the time is over: called in loops that may be long.

        An exception of a check of `interrupted_by` ends them too.
        """
        if self._interrupt is not None:
            self._interrupt()
        if self._seconds is None:
            return
        elapsed = monotonic() - self._begun
        if elapsed > self._seconds:
            raise DeadlineExceeded(f'deadline = {self._seconds:g} s: not finished after '
                                   f'{elapsed:.3g} s', self._seconds, elapsed)
