# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A thread that always works on what was asked last."""

from collections.abc import Callable
from threading import Condition, Thread


class Overtaken(Exception):
    """A newer job came; the present one ends."""


class Latest:
    """Runs jobs in one thread of its own, the newest next; those in between are dropped.

    Parameters
    ----------
    failed : callable
        Called with an exception that a job raised, in that thread.
    """

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
