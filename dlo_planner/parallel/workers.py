# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Work for any executor of `concurrent.futures`: results in order, progress, cancellation.

Threads, processes, or a cluster's (`dask.distributed`: `Client(...).get_executor()`). A pool that
has lost a process is broken. Where a function makes the executor, it makes another one, once in a
row, and only what the broken one had not finished is done again.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import shown

_LOOK = 0.02  # s between two looks at the deadline

Workers = Executor | Callable[[], Executor] | None


def checked(executor: object) -> Workers:
    """Return an executor, a function that makes one, or None; raise InvalidTask."""
    if executor is None or isinstance(executor, Executor) or callable(executor):
        return executor
    raise InvalidTask(f'executor = {shown(executor)}: expected an Executor of concurrent.futures, '
                      'a function that makes one, or None')


class Crew:
    """Gives work to an executor; a context manager.

    Parameters
    ----------
    executor : Workers
        An Executor, which stays open; a function that makes one, which is closed at the end. If
        None, the work is done here.
    check : callable
        Called often; an exception from it ends the work.
    """

    def __init__(self, executor: Workers, check: Callable[[], object]) -> None:
        self._make = None if executor is None or isinstance(executor, Executor) else executor
        self._executor: Any = executor if self._make is None else None  # an Executor, or None
        self._check = check
        self._vain = False  # whether the last executor broke, and no result has come since

    def __enter__(self) -> 'Crew':
        if self._make is not None:
            self._executor = _executor_of(self._make)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._make is not None:
            self._executor.shutdown(wait=kind is None)

    @property
    def shares(self) -> bool:
        """Whether there is an executor."""
        return self._executor is not None

    def run(self, function: Callable[[Any], Any], tasks: Iterable[Any],
            finished: Callable[[int, Any], object]) -> list[Any]:
        """Return function(task) for all tasks, in their order."""
        results: dict[int, Any] = {}

        def done(index: int, result: Any) -> None:
            results[index] = result
            finished(index, result)

        if self._executor is None:
            for index, task in enumerate(tasks):
                self._check()
                done(index, function(task))
        else:
            self._share_out(function, tasks, done)
        return [results[index] for index in range(len(results))]

    def begin(self, function: Callable[[Any], Any], tasks: Iterable[Any]) -> list[Future[Any]]:
        """Give tasks to the executor; return Futures, for `gathered`, at once."""
        try:
            return [self._executor.submit(function, task) for task in tasks]
        except BrokenExecutor as error:
            self._renew(error)
            return []

    def gathered(self, futures: Sequence[Future[Any]]) -> list[Any]:
        """Return the results of Futures; those that were lost with a worker are None."""
        waiting: set[Future[Any]] = set(futures)
        while waiting:
            self._check()
            _, waiting = wait(waiting, _LOOK)
        results: list[Any] = []
        broken: BaseException | None = None
        for future in futures:
            error = future.exception()
            if error is not None and not isinstance(error, BrokenExecutor):
                raise error
            broken = broken or error
            results.append(None if error is not None else future.result())
        if broken is not None:
            self._vain = False  # none of them is needed: it may go on so
            self._renew(broken)
        return results

    def _share_out(self, function: Callable[[Any], Any], tasks: Iterable[Any],
                   done: Callable[[int, Any], object]) -> None:
        pending: Iterator[tuple[int, Any]] = enumerate(tasks)
        given: dict[Future[Any], tuple[int, Any]] = {}
        ended: SimpleQueue[Future[Any]] = SimpleQueue()
        lost: list[tuple[int, Any]] = []
        broken: list[BaseException] = []

        def collect(wait_: bool) -> None:
            """Take what has ended, after a while at most."""
            with suppress(Empty):
                while True:
                    future = ended.get(wait_, _LOOK)
                    index, task = given.pop(future)
                    error, wait_ = future.exception(), False
                    if error is None:
                        self._vain = False
                        done(index, future.result())
                    elif isinstance(error, BrokenExecutor):
                        lost.append((index, task))
                        broken.append(error)
                    else:
                        raise error

        try:
            while True:
                for index, task in pending:
                    self._check()
                    try:
                        future = None if broken else self._executor.submit(function, task)
                    except BrokenExecutor as error:
                        future = None
                        broken.append(error)
                    if future is None:
                        lost.append((index, task))
                    else:
                        given[future] = index, task
                        future.add_done_callback(ended.put)
                    collect(False)
                while given:
                    self._check()
                    collect(True)
                if not lost:
                    return
                self._renew(broken[0])
                pending = iter(sorted(lost, key=lambda one: one[0]))
                lost, broken = [], []
        finally:
            for future in given:  # there are none unless something was raised
                future.cancel()

    def _renew(self, error: BaseException) -> None:
        """Take a new executor; raise `error` where there is none, or the last one broke, too."""
        if self._make is None or self._vain:
            raise error
        self._vain = True
        self._executor.shutdown(wait=False)
        self._executor = _executor_of(self._make)


def _executor_of(make: Callable[[], Executor]) -> Executor:
    """Return the Executor that a user's function makes."""
    try:
        executor = make()
    except Exception as error:  # it is somebody else's function: any may come
        raise InvalidTask(f'executor = {shown(make)}: expected a function that makes an Executor, '
                          f'it raised {type(error).__name__}: {shown(str(error))}') from error
    if not isinstance(executor, Executor):
        raise InvalidTask(f'executor = {shown(make)}: expected a function that makes an Executor, '
                          f'it made {shown(executor)}')
    return executor
