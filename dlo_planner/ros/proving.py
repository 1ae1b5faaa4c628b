# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Proof of plans in a process of its own, so that shapes and plans never wait for it.

Messages are pickles on the pipes of the process: keyword arguments of `replay` in, a
ValidationReport or an error out. It ends with its input, so it never outlives the node.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Mapping
from select import select
from subprocess import Popen
from threading import Lock, Thread
from time import monotonic, sleep
from typing import Any

from dlo_planner.errors import DeadlineExceeded, DloPlannerError
from dlo_planner.verify.replay import replay
from dlo_planner.verify.report import ValidationReport

_LOOK = 0.1      # s between looks whether an answer is still wanted
_WATCH = 0.5     # s between looks whether the node still runs
_PATIENCE = 120.0  # s beyond the deadline that was given, after which the process counts as lost


class ProcessLost(DloPlannerError):
    """The process that proves plans ended, or does not answer; another one can be started."""


class Prover:
    """Starts the process when it is first needed, and again if it has died."""

    def __init__(self) -> None:
        self._lock, self._asking = Lock(), Lock()
        self._process: Popen[bytes] | None = None
        self._closed = False

    def report(self, wanted: Callable[[], bool] = lambda: True,
               **arguments: Any) -> ValidationReport | None:
        """Return the ValidationReport of `replay(**arguments)`; blocks, but not the interpreter.

        None if the Prover is closed meanwhile, or the ValidationReport is not `wanted()` any more:
        a search for a calm motion may take long, and the next plan must not wait for it.

        Another question waits until the one before is answered.

        Raises
        ------
        DeadlineExceeded
            Of `replay`.
        ProcessLost
            The process ended, or it is long past the deadline.
        DloPlannerError
            It failed there.
        """
        while not self._asking.acquire(timeout=_LOOK):
            if not wanted():
                return None
        try:
            return self._answer(wanted, arguments)
        finally:
            self._asking.release()

    def _answer(self, wanted: Callable[[], bool],
                arguments: Mapping[str, Any]) -> ValidationReport | None:
        process = self._running()
        if process is None or process.stdin is None or process.stdout is None:
            return None
        end = monotonic() + _PATIENCE + (arguments.get('deadline') or 0.0)
        try:
            pickle.dump(arguments, process.stdin)
            process.stdin.flush()
            while not select([process.stdout], [], [], _LOOK)[0]:
                if not wanted():
                    self._end(process)
                    return None
                if monotonic() > end:
                    self._end(process)
                    raise ProcessLost('the process that proves plans does not answer')
            report: ValidationReport | None
            report, error = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as lost:
            if self._closed:
                return None
            self._end(process)
            raise ProcessLost('the process that proves plans has ended, status '
                              f'{process.returncode}: {lost}') from None
        if isinstance(error, DeadlineExceeded):
            raise error
        if error is not None:
            raise DloPlannerError(f'the plan could not be replayed: {error}')
        return report

    def _running(self) -> Popen[bytes] | None:
        with self._lock:
            if self._closed:
                return None
            if self._process is None or self._process.poll() is not None:
                # a session of its own: an interrupt from the keyboard is the node's business
                self._process = subprocess.Popen(
                    [sys.executable, '-m', __name__], stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE, start_new_session=True,
                    env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path)),
                         'OMP_NUM_THREADS': '1'})  # the other cores are the node's
            return self._process

    def close(self) -> None:
        """End the process, whatever it does."""
        with self._lock:
            self._closed = True
        if self._process is not None:
            self._end(self._process)

    def _end(self, process: Popen[bytes]) -> None:
        process.kill()
        process.wait()


def main() -> None:
    """Answer until the input ends, or the process that asks."""
    Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), 'wb')
    sys.stdout = sys.stderr  # whatever is printed must not get among the answers
    while True:
        try:
            arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            answer: tuple[ValidationReport | None, object] = replay(**arguments), None
        except DeadlineExceeded as error:
            answer = None, error
        except Exception as error:  # it has to be answered in any case
            answer = None, f'{type(error).__name__}: {error}'
        try:
            pickle.dump(answer, answers)
            answers.flush()
        except BrokenPipeError:  # nobody is there to read it
            return


def _end_with(parent: int) -> None:
    """End when the parent has ended, whatever is computed: nobody waits for it any more."""
    while os.getppid() == parent:
        sleep(_WATCH)
    os._exit(0)


if __name__ == '__main__':
    main()
