# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Work is not lost with a worker that is killed."""

import os
import signal
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from dlo_planner.parallel.pool import Pool

DEADLINE = 120.0  # s; nothing here takes that long, however busy the machine is
FORK = get_context('fork')


class Deadline:
    """Ends the work of a Pool that hangs."""

    def __init__(self):
        self._end = time.monotonic() + DEADLINE

    def __call__(self):
        if time.monotonic() > self._end:
            raise TimeoutError('work was lost')


def marked(task):
    """Return whether this is done the first time; task: number, and where a mark is left."""
    number, folder = task
    try:
        os.close(os.open(folder / str(number), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return False
    return True


def dies_with_it(task):
    if task[0] % 4 == 1 and marked(task):
        os.kill(os.getpid(), signal.SIGKILL)
    return task[0]


def number_of(task):
    return task[0]


def pool():
    return ProcessPoolExecutor(2, mp_context=FORK)


def done(function, tasks, make=pool):
    results = {}
    with Pool(make, Deadline()) as working:
        working.run(function, tasks, results.__setitem__)
    return [results[k] for k in range(len(tasks))]


def test_a_worker_that_dies_when_it_has_taken_its_work(tmp_path):
    tasks = [(k, tmp_path) for k in range(60)]
    assert done(dies_with_it, tasks) == list(range(60))
    assert len(list(tmp_path.iterdir())) == 15


class Broken(ProcessPoolExecutor):
    """A pool whose worker is killed as soon as it has work; counts how many were made."""

    made = 0

    def __init__(self):
        type(self).made += 1
        super().__init__(1, mp_context=FORK)

    def submit(self, function, /, *arguments):
        future = super().submit(function, *arguments)
        os.kill(next(iter(self._processes)), signal.SIGKILL)
        return future


def sleeps(_):
    time.sleep(60)


def test_a_pool_is_made_anew_once_in_a_row():
    Broken.made = 0
    with pytest.raises(BrokenExecutor), Pool(Broken, Deadline()) as working:
        working.run(sleeps, [(0, None)], lambda *_: None)
    assert Broken.made == 2
    with pytest.raises(BrokenExecutor), Broken() as given, Pool(given, Deadline()) as working:
        working.run(sleeps, [(0, None)], lambda *_: None)
    assert Broken.made == 3


def test_what_was_begun_and_is_lost_is_said():
    with Pool(pool, Deadline()) as working:
        futures = working.submit(sleeps, [(0, None)])
        os.kill(next(iter(working._executor._processes)), signal.SIGKILL)
        assert working.gathered(futures) == [None]
        assert working.gathered(working.submit(number_of, [(3, None)])) == [3]
