# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
from threading import Event

import pytest

from dlo_planner.progress import Latest, Overtaken


@pytest.fixture
def worker():
    errors = []
    latest = Latest(errors.append)
    latest.errors = errors
    yield latest
    latest.close()


def test_those_in_between_are_dropped_and_the_running_one_is_told(worker):
    begun, go_on, done = Event(), Event(), []

    def first():
        begun.set()
        assert go_on.wait(60)
        worker.check(1, 2)
        done.append('first')

    worker.submit(first)
    assert begun.wait(60)
    for number in range(5):
        worker.submit(lambda number=number: done.append(number))
    go_on.set()
    assert worker.wait(60)
    assert done == [4] and worker.errors == []


def test_an_error_is_reported_and_work_goes_on(worker):
    done = []
    worker.submit(lambda: 1 / 0)
    assert worker.wait(60)
    worker.submit(lambda: done.append(1))
    assert worker.wait(60)
    assert done == [1] and isinstance(worker.errors[0], ZeroDivisionError)


def test_closed_it_ends_what_looks(worker):
    worker.check()
    worker.close()
    with pytest.raises(Overtaken):
        worker.check()
