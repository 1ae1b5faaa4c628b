# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Work is not lost with a worker, at whatever moment it is killed."""

import os
import signal
import threading
import time
from concurrent.futures import Future, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import pytest

from dlo_planner.parallel.workers import Crew

DEADLINE = 120.0  # s; nothing here takes that long, however busy the machine is
FORK = get_context('fork')
LARGE = 20_000_000  # bytes: it takes a while to send them


class Deadline:
    """Ends the work of a Crew that hangs."""

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


def dies_as_it_answers(task):
    if task[0] % 4 == 1 and marked(task):
        delay = 1e-3 * (task[0] // 4)
        threading.Thread(target=lambda: (time.sleep(delay), os.kill(os.getpid(), signal.SIGKILL)),
                         daemon=True).start()
        return bytes(LARGE)
    return task[0]


def number_of(task):
    return task[0]


def pool():
    return ProcessPoolExecutor(2, mp_context=FORK)


def done(function, tasks, make=pool):
    with Crew(make, Deadline()) as crew:
        return crew.run(function, tasks, lambda *_: None)


def test_a_worker_that_dies_when_it_has_taken_its_work(tmp_path):
    tasks = [(k, tmp_path) for k in range(60)]
    assert done(dies_with_it, tasks) == list(range(60))
    assert len(list(tmp_path.iterdir())) == 15


def test_a_worker_that_dies_while_it_answers(tmp_path):
    tasks = [(k, tmp_path) for k in range(32)]
    results = done(dies_as_it_answers, tasks)
    # a large result that came in time stays
    assert [k if one == bytes(LARGE) else one for k, one in enumerate(results)] == list(range(32))
    assert len(list(tmp_path.iterdir())) == 8


class Halved(ProcessPoolExecutor):
    """A pool of which a worker is killed when half of its answer is on its way."""

    halved = 0

    def submit(self, function, /, *arguments):
        future = super().submit(function, *arguments)
        if type(self).halved < 2 and len(self._pending_work_items) > 1:
            type(self).halved += 1
            self._result_queue._writer._send((1000).to_bytes(4, 'big') + b'half')
            os.kill(next(iter(self._processes)), signal.SIGKILL)
        return future


def test_half_of_an_answer_is_not_waited_for(tmp_path):
    Halved.halved = 0
    tasks = [(k, tmp_path) for k in range(8)]
    assert done(number_of, tasks, partial(Halved, 2, mp_context=FORK)) == list(range(8))
    assert Halved.halved == 2


class Forgetful(ProcessPoolExecutor):
    """A pool that breaks while it is given work, and never says what became of that."""

    forgotten = 0

    def submit(self, function, /, *arguments):
        future = super().submit(function, *arguments)
        if arguments[0][0] % 3 == 2 and type(self).forgotten < 3:
            type(self).forgotten += 1
            os.kill(next(iter(self._processes)), signal.SIGKILL)
            while not self._broken:
                time.sleep(1e-3)
            return Future()
        return future


@pytest.mark.parametrize('own', [True, False])
def test_a_broken_pool_that_forgets_is_left(tmp_path, own):
    Forgetful.forgotten = 0
    make = partial(Forgetful, 2, mp_context=FORK)
    tasks = [(k, tmp_path) for k in range(12)]
    if own:
        assert done(number_of, tasks, make) == list(range(12))
        assert Forgetful.forgotten == 3
    else:
        with make() as given:
            assert done(number_of, tasks, given) == list(range(12))
        assert Forgetful.forgotten == 1  # the next one is a pool like any other


def test_what_was_begun_and_is_forgotten_is_said(tmp_path):
    Forgetful.forgotten = 0
    tasks = [(k, tmp_path) for k in range(4)]
    with Crew(partial(Forgetful, 2, mp_context=FORK), Deadline()) as crew:
        results = crew.gathered(crew.begin(number_of, tasks[:3]))
        assert results[2] is None
        assert crew.gathered(crew.begin(number_of, tasks[3:])) == [3]
