# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Work for any executor: results in order, dead workers replaced, progress, cancellation.

An executor is one of `concurrent.futures`: threads, processes, or a cluster's (`dask.distributed`:
`Client(...).get_executor()`).
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from threading import Event
from time import monotonic
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import shown
from dlo_planner.parallel.pools import has_lost_a_worker, leave, like

_LOOK = 0.02  # s between two looks at what has ended, and at the deadline
_GRACE = 1.0  # s in which a broken executor says so of all that it had
_VAIN = 3     # executors that break one after the other without a result: the work breaks them

Workers = Executor | Callable[[], Executor] | None


def checked(executor: object) -> Workers:
    """Return an executor, a function that makes one, or None; raise InvalidTask."""
    if executor is None or isinstance(executor, Executor) or callable(executor):
        return executor
    raise InvalidTask(f'executor = {shown(executor)}: expected an Executor of concurrent.futures, '
                      'a function that makes one, or None')


class _Waiting(dict[Future[Any], tuple[int, Any, Executor | None]]):
    """What has been given and not taken: of each Future index, task, and who has it.

    To wake up for each that ends, and to ask all of them then, would take more than some of them
    do: it is looked at now and then, and when all have ended.
    """

    def __init__(self) -> None:
        super().__init__()
        self._ended: deque[Future[Any]] = deque()
        self._all = Event()

    def __setitem__(self, future: Future[Any], task: tuple[int, Any, Executor | None]) -> None:
        super().__setitem__(future, task)
        future.add_done_callback(self._note)

    def _note(self, future: Future[Any]) -> None:
        """Note that a Future has ended; whoever ended it calls this."""
        self._ended.append(future)
        if len(self._ended) >= len(self):
            self._all.set()

    def ended(self, seconds: float) -> list[Future[Any]]:
        """Return those that have ended after so many seconds, or as soon as all have."""
        if seconds:
            self._all.clear()
            if len(self._ended) < len(self):
                self._all.wait(seconds)
        ended = [self._ended.popleft() for _ in range(len(self._ended))]
        return [future for future in ended if future in self]


class Crew:
    """Gives work to an executor, and to the next one where that breaks; a context manager.

    A pool of processes that has lost one is broken: what it had not finished is done again by a
    new one, made by the function, or like the ProcessPoolExecutor that was given. Some that break
    forget what they had (a pool whose worker is killed while it takes or gives): that is done again
    as well.

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
        self._own = False
        self._since: dict[int, float] = {}  # s, when executors (`id`) were seen to have broken

    def __enter__(self) -> 'Crew':
        if self._make is not None:
            self._renew()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._own:
            self._executor.shutdown(wait=kind is None)  # what is left was canceled

    @property
    def shares(self) -> bool:
        """Whether there is an executor."""
        return self._executor is not None

    @property
    def elsewhere(self) -> bool:
        """Whether workers may be in other processes."""
        return not isinstance(self._executor, ThreadPoolExecutor | None)

    def run(self, function: Callable[[Any], Any], tasks: Iterable[Any],
            finished: Callable[[int, Any], object]) -> list[Any]:
        """Return function(task) for all tasks, in their order.

        Parameters
        ----------
        function : callable
            Function of one task; it can be pickled, where the executor has to.
        tasks : iterable of object
            May be computed one by one, while others are worked on.
        finished : callable
            Called as finished(index, result), in the order in which they end.
        """
        results = {}

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
        broken: BaseException | None = None
        while waiting:
            self._check()
            ended, waiting = wait(waiting, _LOOK)
            if not ended and self._forgets(self._executor):
                broken = BrokenExecutor('a worker is lost, and what it had')
                break
        results: list[Any] = []
        for future in futures:
            if future in waiting:
                results.append(None)
                continue
            error = future.exception()
            if error is not None and not isinstance(error, BrokenExecutor):
                raise error
            results.append(None if error is not None else future.result())
            broken = broken or error
        if broken is not None:
            self._renew(broken)
        return results

    def _share_out(self, function: Callable[[Any], Any], tasks: Iterable[Any],
                   done: Callable[[int, Any], object]) -> None:
        waiting = _Waiting()
        vain = 0
        try:
            for index, task in enumerate(tasks):
                self._check()
                vain = self._collect(function, waiting, done, 0, vain)
                self._submit(function, waiting, index, task)
            while waiting:
                self._check()
                vain = self._collect(function, waiting, done, _LOOK, vain)
        finally:
            for future in waiting:  # there are none unless something was raised
                future.cancel()

    def _submit(self, function: Callable[[Any], Any], waiting: _Waiting, index: int,
                task: Any) -> None:
        try:
            future = self._executor.submit(function, task)
        except BrokenExecutor as error:  # what it had is not forgotten: those futures say so
            self._renew(error)
            future = self._executor.submit(function, task)
        waiting[future] = index, task, self._executor

    def _collect(self, function: Callable[[Any], Any], waiting: _Waiting,
                 done: Callable[[int, Any], object], seconds: float, vain: int) -> int:
        """Take what has ended, give again what was lost; return how often that was in vain."""
        ended = waiting.ended(seconds)
        lost: list[tuple[int, Any]] = []
        broken: BaseException | None = None
        for future in ended:
            error = future.exception()
            if error is not None and not isinstance(error, BrokenExecutor):
                raise error
            index, task, executor = waiting.pop(future)
            if error is None:
                done(index, future.result())
                vain = 0
                continue
            lost.append((index, task))
            if executor is self._executor:
                broken = error
        if not ended:
            for future in [one for one, (*_, executor) in waiting.items()
                           if self._forgets(executor)]:
                index, task, executor = waiting.pop(future)
                lost.append((index, task))
                if executor is self._executor:
                    broken = BrokenExecutor('a worker is lost, and what it had')
        if broken is not None:
            vain += 1
            if vain > _VAIN:
                broken.add_note(f'{vain} executors in a row broke without a result')
                raise broken
            self._renew(broken)
        for index, task in sorted(lost, key=lambda one: one[0]):
            self._submit(function, waiting, index, task)
        return vain

    def _forgets(self, executor: Executor | None) -> bool:
        """Return whether an executor broke so long ago that what it has not answered is lost."""
        if executor is self._executor and not has_lost_a_worker(executor):
            self._since.pop(id(executor), None)
            return False
        return monotonic() - self._since.setdefault(id(executor), monotonic()) > _GRACE

    def _renew(self, error: BaseException | None = None) -> None:
        """Take a new executor; raise `error` where there is no telling how to make one."""
        broken = self._executor
        if self._make is not None:
            self._executor = _executor_of(self._make)
        elif isinstance(broken, ProcessPoolExecutor):
            self._executor = like(broken)
        else:
            raise error or BrokenExecutor('the executor broke')
        if isinstance(broken, ProcessPoolExecutor):
            leave(broken)
        if self._own:
            broken.shutdown(wait=False)
        self._own = True


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
