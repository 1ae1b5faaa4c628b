# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Work for any executor of `concurrent.futures`, with progress, cancellation and one retry.

Threads, processes, or a cluster's (`dask.distributed`: `Client(...).get_executor()`). A pool that
has lost a process is broken: where a function makes the executor, it makes another one, once in a
row, and only what the broken one had not finished is done again. Python's own pool does not notice
a process that is killed halfway through its answer: where that may be, a deadline ends the work.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from functools import lru_cache
from pickle import dumps, loads
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import shown
from dlo_planner.progress import interrupted_by

_LOOK = 0.02  # s between two looks at the deadline
_KNOWN = 8    # payloads that a worker keeps

Workers = Executor | Callable[[], Executor] | None


def checked(executor: object) -> Workers:
    """Return an executor, a function that makes one, or None; raise InvalidTask."""
    if executor is None or isinstance(executor, Executor) or callable(executor):
        return executor
    raise InvalidTask(f'executor = {shown(executor)}: expected an Executor of concurrent.futures, '
                      'a function that makes one, or None')


class CachedPayload:
    """Something that many tasks need: a worker unpacks it once and keeps it."""

    def __init__(self, content: Any) -> None:
        self.content = content
        self._packed: bytes | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        if self._packed is None:
            self._packed = dumps(self.content, protocol=5)
        return _unpacked, (self._packed,)


@lru_cache(maxsize=_KNOWN)
def _unpacked(packed: bytes) -> CachedPayload:
    return CachedPayload(loads(packed))


class Pool:
    """Gives tasks to an executor; a context manager.

    An Executor that is given stays open, one that a function makes is closed at the end; None: the
    tasks are done here. `check` is called often; an exception from it ends the work.
    """

    def __init__(self, executor: Workers, check: Callable[[], object]) -> None:
        self._make = None if executor is None or isinstance(executor, Executor) else executor
        self._executor: Any = executor if self._make is None else None  # an Executor, or None
        self._check = check
        self._vain = False  # whether the last executor broke, and no result has come since

    def __enter__(self) -> 'Pool':
        if self._make is not None:
            self._executor = _made(self._make)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._make is not None:
            self._executor.shutdown(wait=kind is None)

    @property
    def shares(self) -> bool:
        """Whether there is an executor."""
        return self._executor is not None

    def run(self, function: Callable[[Any], Any], tasks: Iterable[Any],
            finished: Callable[[int, Any], object]) -> None:
        """Call finished(index, function(task)) for each task, in the order in which they end."""
        if self._executor is None:
            for index, task in enumerate(tasks):
                self._check()
                with interrupted_by(self._check):
                    result = function(task)
                finished(index, result)
            return
        left = dict(enumerate(tasks))
        while left:
            futures: dict[Future[Any], int] = {}
            broken: BaseException | None = None
            try:
                try:
                    for index, task in left.items():
                        self._check()
                        futures[self._executor.submit(function, task)] = index
                except BrokenExecutor as error:
                    broken = error
                for future in self._as_completed(futures):
                    failure = future.exception()
                    if isinstance(failure, BrokenExecutor):
                        broken = failure
                    elif failure is not None:
                        raise failure
                    else:
                        self._vain = False
                        del left[futures[future]]
                        finished(futures[future], future.result())
            finally:
                for future in futures:
                    future.cancel()
            if broken is not None:
                self._renew(broken)

    def submit(self, function: Callable[[Any], Any], tasks: Iterable[Any]) -> list[Future[Any]]:
        """Give tasks to the executor; return Futures, for `gathered`, at once."""
        try:
            return [self._executor.submit(function, task) for task in tasks]
        except BrokenExecutor as error:
            self._renew(error)
            return []

    def gathered(self, futures: Sequence[Future[Any]]) -> list[Any]:
        """Return the results of Futures; those that were lost with a worker are None."""
        errors = {future: future.exception() for future in self._as_completed(futures)}
        for error in errors.values():
            if error is not None and not isinstance(error, BrokenExecutor):
                raise error
        if broken := next(filter(None, errors.values()), None):
            self._vain = False  # none of them is needed: it may go on so
            self._renew(broken)
        return [None if errors.get(future, broken) else future.result() for future in futures]

    def _as_completed(self, futures: Iterable[Future[Any]]) -> Iterable[Future[Any]]:
        """Yield Futures as they end, with a look at the deadline now and then.

        Where some have ended with their pool, those that do not end within a look never may:
        Python 3.11 forgets a task that is given to a pool while it finds that it is broken.
        """
        waiting, broken = set(futures), False
        while waiting:
            self._check()
            done, waiting = wait(waiting, _LOOK, FIRST_COMPLETED)
            yield from done
            if broken and not done:
                return
            broken = broken or any(isinstance(one.exception(), BrokenExecutor) for one in done)

    def _renew(self, error: BaseException) -> None:
        """Take a new executor; raise `error` where there is none, or the last one broke, too."""
        if self._make is None or self._vain:
            raise error
        self._vain = True
        self._executor.shutdown(wait=False)
        self._executor = _made(self._make)


def _made(make: Callable[[], Executor]) -> Executor:
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
