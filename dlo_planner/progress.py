# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Long computations: their progress and deadlines, and a thread for what was asked last."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Condition, Thread, local
from time import monotonic
from typing import Any, TypeVar

from dlo_planner.errors import DeadlineExceeded, InvalidTask
from dlo_planner.model.checks import callback, number, shown

OnProgress = Callable[[int, int], object] | None  # called as progress(done, total)
_T = TypeVar('_T')


class _Interrupt:
    """A check of `interrupted_by`; what it raises to a kernel is raised when that has ended."""

    def __init__(self, check: Callable[[], object]) -> None:
        self._check = check
        self._raised: BaseException | None = None

    def __call__(self) -> None:
        self.raise_kept()
        self._check()

    def raise_kept(self) -> None:
        """Raise what a kernel could not."""
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised

    def answers(self) -> Generator[bool, None, None]:
        """Yield to kernels whether they are to end.

        A generator waits inside its `try`: not even Ctrl-C, which Python raises as soon as it is
        called, gets lost in compiled code. What another task of the thread computes, which is not
        in the context of the check, goes on; a check that computes itself is not asked meanwhile.
        """
        while True:
            try:
                while True:
                    mine = INTERRUPT.get() is self
                    yield mine and self._raised is not None
                    if INTERRUPT.get() is self:
                        send, ASKED.send = ASKED.send, bool
                        try:
                            self()
                        finally:
                            ASKED.send = send
            except GeneratorExit:
                return
            except BaseException as error:
                self._raised = error


class _Asked(local):
    """What kernels ask in each thread whether they are to end: send(None)."""

    send: Callable[[Any], bool] = bool  # no, where nothing checks


INTERRUPT: ContextVar[_Interrupt | None] = ContextVar('interrupt', default=None)
ASKED = _Asked()


@contextmanager
def interrupted_by(check: Callable[[], object]) -> Iterator[None]:
    """Let `check` end all computations that begin inside the context.

    It is called between their steps and in long ones, as deadlines are; an exception that it raises
    ends the computation. Other threads are not affected.
    """
    if callback('check', check) is None:
        raise InvalidTask('check = None: expected a function')
    interrupt, before = _Interrupt(check), ASKED.send
    answers = interrupt.answers()
    next(answers)
    token, ASKED.send = INTERRUPT.set(interrupt), answers.send
    try:
        yield
        interrupt.raise_kept()
    finally:
        ASKED.send = before
        INTERRUPT.reset(token)


def uninterrupted(answer: _T) -> _T:
    """Return what a kernel returned; raise what has ended it early, or ends the computation now."""
    interrupt = INTERRUPT.get()
    if interrupt is not None:
        interrupt()
    return answer


class Progress:
    """Reports the steps of one computation and ends it at its deadline."""

    def __init__(self, report: OnProgress = None, deadline: float | None = None):
        self._report = callback('progress', report)
        self._seconds = None if deadline is None else number('deadline', deadline, above=0)
        self._begun = monotonic()
        self._interrupt = INTERRUPT.get()

    def begin(self) -> None:
        """Count the time until the deadline from now on."""
        self._begun = monotonic()

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

    def __reduce__(self) -> tuple[type[Progress], tuple[()]]:
        return Progress, ()  # in another process nobody hears of it, or waits

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


class Overtaken(Exception):
    """A newer job came; the present one ends."""


class Latest:
    """Runs jobs in one thread of its own, the newest next; those in between are dropped."""

    def __init__(self, failed: Callable[[Exception], object]) -> None:
        self._failed = failed
        self._changed = Condition()
        self._next: Callable[[], object] | None = None
        self._busy, self._closed = False, False
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def submit(self, job: Callable[[], object]) -> None:
        """Have `job` called; one that still waits is dropped, one that runs is overtaken."""
        with self._changed:
            self._next = job
            self._changed.notify_all()

    def check(self, *_: object) -> None:
        """Raise Overtaken if a newer job waits; a job calls it now and then, e.g. as `progress`."""
        if self._next is not None or self._closed:
            raise Overtaken

    def wait(self, timeout: float) -> bool:
        """Return whether nothing is left to do within `timeout` s."""
        with self._changed:
            return self._changed.wait_for(lambda: self._next is None and not self._busy, timeout)

    def close(self) -> None:
        """Take no more jobs; one that runs may end by itself."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._next is not None or self._closed)
                if self._closed or self._next is None:
                    return
                job, self._next, self._busy = self._next, None, True
            try:
                job()
            except Overtaken:
                continue
            except Exception as error:  # whatever it is, the thread has to go on
                self._failed(error)
