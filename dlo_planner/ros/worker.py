# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What takes long is computed in a process of its own: shapes and commands never wait for it.

It is no Process of multiprocessing: that would import the node's main program once more, which
starts a node where it has no guard.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from subprocess import Popen
from threading import Lock, Thread
from time import monotonic, sleep
from typing import Any, TypeVar

from dlo_planner.errors import DloPlannerError
from dlo_planner.progress import Progress, interrupted_by
from dlo_planner.signals import held_back, let_through

T = TypeVar('T')

ATTEMPTS = 4     # at what a process has to compute that ends: the first one, and three more
_LOOK = 0.05     # s between looks whether an answer is still wanted
_PATIENCE = 120.0  # s beyond the deadline that was given, after which the process counts as lost
_YIELDING = 2.0  # s in which it may leave what is not wanted any more, before it is ended
_WATCH = 0.5     # s between looks whether the node still runs


class ProcessLost(DloPlannerError):
    """The process ended, or does not answer; another one can be started."""


class _NotWanted(Exception):
    """Nobody waits for the result any more."""


class Worker:
    """Starts a process when it is first needed, and again if it has died; it ends with the node."""

    def __init__(self, does: str) -> None:
        self._does, self._lock, self._asking = does, Lock(), Lock()
        self._process: Popen[bytes] | None = None
        self._pipe: Connection[Any, Any] | None = None
        self._closed = False

    def result(self, call: Callable[[], T], wanted: Callable[[], bool] = lambda: True,
               deadline: float | None = None, patience: float = 0.0) -> T | None:
        """Return what `call()` does there; blocks, but not the interpreter.

        None if the Worker is closed meanwhile, or it is not `wanted()` any more: the computation
        ends within a step, and the process stays. One call after the other.
        """
        while not self._asking.acquire(timeout=_LOOK):
            if not wanted():
                return None
        try:
            return self._answer(call, wanted, deadline, (deadline or 0.0) + patience)
        finally:
            self._asking.release()

    def _answer(self, call: Callable[[], T], wanted: Callable[[], bool], deadline: float | None,
                patience: float) -> T | None:
        self._start()
        process, pipe = self._process, self._pipe
        if process is None or pipe is None:
            return None
        end, unwanted = monotonic() + _PATIENCE + patience, False
        try:
            pipe.send((deadline, call))
            while not pipe.poll(_LOOK):
                if not unwanted and not wanted():
                    process.send_signal(signal.SIGINT)
                    unwanted, end = True, monotonic() + _YIELDING
                if monotonic() > end:
                    _kill(process)
                    if unwanted:
                        return None
                    raise ProcessLost(f'the process that {self._does} does not answer')
            result: T | None
            result, error = pipe.recv()
        except (OSError, EOFError, pickle.UnpicklingError) as lost:
            _kill(process)
            if self._closed or unwanted:
                return None
            raise ProcessLost(f'the process that {self._does} has ended, status '
                              f'{process.returncode}: {lost}') from None
        if unwanted:
            return None
        if error is not None:
            raise error
        return result

    def _start(self) -> None:
        """Start the process if it does not run."""
        with self._lock:
            if self._closed:
                self._process = None
            elif self._process is None or self._process.poll() is not None:
                self._pipe, theirs = Pipe()
                # a session of its own: an interrupt from the keyboard is the node's business
                with held_back():  # while it imports it could not hear that it is not wanted
                    self._process = Popen(
                        [sys.executable, '-m', __name__, str(theirs.fileno())],
                        pass_fds=[theirs.fileno()], start_new_session=True,
                        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
                theirs.close()

    def close(self) -> None:
        """End the process, whatever it does."""
        with self._lock:
            self._closed, process = True, self._process
        if process is not None:
            _kill(process)


def _kill(process: Popen[bytes]) -> None:
    process.kill()
    process.wait()


def persistent(attempt: Callable[[], T]) -> T:
    """Return what `attempt()` does, after some attempts if its process ends."""
    for _ in range(ATTEMPTS - 1):
        with suppress(ProcessLost):
            return attempt()
    return attempt()


class _Calls:
    """Computes one call after another; a signal says that the present one is not wanted."""

    def __init__(self) -> None:
        self._unwanted = False

    def interrupt(self, *_: object) -> None:
        """Let the present call end within a step."""
        self._unwanted = True

    def answer(self, pipe: Connection[Any, Any]) -> tuple[object, object]:
        """Return the result of the next call and None, or None and its error."""
        data = pipe.recv_bytes()
        self._unwanted = False  # before the call is read: what it imports may take seconds
        deadline, call = pickle.loads(data)
        steps = Progress(deadline=deadline)

        def check() -> None:
            if self._unwanted:
                raise _NotWanted
            steps.check()

        try:
            with interrupted_by(check):
                return call(), None
        except _NotWanted:
            return None, None
        except Exception as error:  # it has to be answered in any case
            return None, _told(error)


def _told(error: Exception, what: str = '') -> DloPlannerError:
    """Return an error that its receiver knows."""
    return error if isinstance(error, DloPlannerError) else DloPlannerError(
        f'{what}{type(error).__name__}: {error}')


def main() -> None:
    """Answer calls until the pipe, or the process at its other end, ends."""
    calls, pipe = _Calls(), Connection(int(sys.argv[1]))
    signal.signal(signal.SIGINT, calls.interrupt)
    let_through()
    Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            answer = calls.answer(pipe)
            try:
                pipe.send(answer)
            except OSError:
                raise
            except Exception as error:  # of pickle
                pipe.send((None, _told(error, 'the answer cannot be sent: ')))


def _end_with(parent: int) -> None:
    """End when the parent has ended, whatever is computed: nobody waits for it any more."""
    while os.getppid() == parent:
        sleep(_WATCH)
    os._exit(0)


if __name__ == '__main__':
    main()
