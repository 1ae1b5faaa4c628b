# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The process of the node: it hears signals at any moment and ends with status 0.

The main thread only waits for signals; a second thread imports, compiles, makes the node and spins.
So SIGINT and SIGTERM are heard while kernels are compiled and while a plan is made. Neither can be
interrupted: what has not ended one second after the motion has stopped is abandoned with the
process. Only the standard library is imported here: a process is deaf while it imports.
"""

import ctypes
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from threading import enumerate as enumerate_threads
from typing import Any

from dlo_planner.blas import one_thread_of_blas
from dlo_planner.signals import NUMBERS, ignore

_IN_MEMORY = Path('/dev/shm')  # a container has it though all else is read-only
# M_ARENA_MAX; M_TRIM_THRESHOLD and M_MMAP_THRESHOLD, bytes: more than any array of a usual solve
_POOLS = {-8: 2, -1: 1 << 20, -3: 1 << 20}
_STOPPING = 5.0  # s for a motion to decelerate, at most
_GRACE = 1.0     # s for everything else
_HEAR = 0.2      # s between looks at signals that another thread took


def main(args: list[str] | None = None) -> int:
    """Run the planner node until SIGINT or SIGTERM; return the exit status.

    The status is 0 after a signal, 1 where the node cannot start, or an error ended it.
    """
    one_thread_of_blas()
    give_memory_back()
    return Process(_planner, sys.argv if args is None else args).run()


def give_memory_back() -> None:
    """Let glibc share few pools of memory between threads, and return what a large message took.

    Of itself it has a pool for each of thirty threads, and keeps in each what was used there once.
    """
    with suppress(AttributeError, OSError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for option, value in _POOLS.items():
            mallopt(option, value)


def _planner() -> tuple[Any, Any]:
    from dlo_planner.ros.lifecycle import PatientExecutor  # noqa: PLC0415
    from dlo_planner.ros.node import THREADS, PlannerNode  # noqa: PLC0415
    return PlannerNode(), PatientExecutor(num_threads=THREADS)


def _computes_on() -> bool:
    """Whether a thread is left that does not wait for anybody."""
    return any(one.daemon and one.is_alive() for one in enumerate_threads())


class Process:
    """One node, its executor, and the thread that runs both."""

    def __init__(self, make: Callable[[], tuple[Any, Any]], args: list[str]) -> None:
        self._make, self._args = make, args
        # signals, and the end of the worker; safe in a signal handler
        self._news: SimpleQueue[Any] = SimpleQueue()
        self._worker = Thread(target=self._work, daemon=True)
        self._stopped = Event()
        self._node = self._executor = None
        self._error: BaseException | None = None

    def run(self) -> int:
        """Run until a signal or an error; call it in the main thread."""
        for number in NUMBERS:
            signal.signal(number, lambda number, _: self._news.put(number))
        self._worker.start()
        asked = self._next() is not None
        ended = self._end()
        ignore()
        status = 0 if asked or self._error is None else self._explain(self._error)
        sys.stdout.flush()
        sys.stderr.flush()
        if not ended or _computes_on():
            os._exit(status)  # the interpreter would wait for that thread, or abort in its midst
        return status

    def _next(self) -> Any:
        """Wait for news. A signal may come to any thread; this one hears of it where it runs."""
        while True:
            with suppress(Empty):
                return self._news.get(timeout=_HEAR)

    def _work(self) -> None:
        try:
            find_temporary()
            import rclpy  # noqa: PLC0415
            from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
            rclpy.init(args=self._args + log_arguments(),
                       signal_handler_options=SignalHandlerOptions.NO)
            self._node, executor = self._make()
            executor.add_node(self._node)
            self._executor = executor
            executor.spin()
        except BaseException as error:
            self._error = error
        self._news.put(None)

    def _end(self) -> bool:
        """Stop the motion, then everything; return whether all has ended in time."""
        closer = Thread(target=self._close, daemon=True)
        closer.start()
        self._stopped.wait(_STOPPING)
        closer.join(_GRACE)
        return not closer.is_alive()

    def _close(self) -> None:
        try:
            if self._executor is not None and self._error is None:
                self._node.end()
        finally:
            self._stopped.set()
        if self._executor is not None:
            self._executor.shutdown()
        self._worker.join()
        if self._executor is not None:
            self._executor.wait_for_callbacks()
        if self._node is not None:
            self._node.destroy_node()
        if 'rclpy' in sys.modules:
            sys.modules['rclpy'].try_shutdown()

    def _explain(self, error: BaseException) -> int:
        """Print why the process ends by itself; return its status."""
        from rclpy.exceptions import ParameterException  # noqa: PLC0415
        from rclpy.executors import ExternalShutdownException  # noqa: PLC0415
        from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415

        from dlo_planner.errors import DloPlannerError  # noqa: PLC0415
        if isinstance(error, ExternalShutdownException):
            return 0
        if self._executor is None and isinstance(
                error, (DloPlannerError, ParameterException, rclpy_implementation.RCLError)):
            print(f'dlo_planner: cannot start: {error}', file=sys.stderr)
        else:
            traceback.print_exception(error)
        return 1


def find_temporary() -> None:
    """Take the folder in memory for temporary files, where there is no other one.

    Child processes take it as well. Libraries write there what they keep from one start to the
    next, if there is no home; some do not load where they cannot.
    """
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        if _can_be_written(_IN_MEMORY):
            os.environ['TMPDIR'] = tempfile.tempdir = str(_IN_MEMORY)


def log_arguments() -> list[str]:
    """Choose the folder of the ROS log; return the arguments that `rclpy.init` needs for it.

    ROS takes ROS_LOG_DIR, ROS_HOME/log or HOME/.ros/log and refuses to start if it cannot write
    there. Then ROS_LOG_DIR becomes a folder among temporary files; where there is none either, the
    log goes to the console only.
    """
    from rclpy.logging import get_logging_directory  # noqa: PLC0415
    with suppress(RuntimeError):  # none is named
        if _can_be_written(Path(get_logging_directory())):
            return []
    with suppress(OSError):
        folder = Path(tempfile.gettempdir()) / f'dlo_planner-log-{os.getuid()}'
        if _can_be_written(folder):
            os.environ['ROS_LOG_DIR'] = str(folder)
            return []
    return ['--ros-args', '--disable-external-lib-logs']


def _can_be_written(folder: Path) -> bool:
    try:
        folder = folder.expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError):  # ~ without a home
        return False
    return True


if __name__ == '__main__':
    sys.exit(main())
