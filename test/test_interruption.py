# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Deadlines and `interrupted_by` hold within a step: counted in looks, not by a clock."""

import asyncio
import os
import signal
from contextlib import nullcontext
from functools import cache
from inspect import signature
from threading import Event, Thread, Timer
from time import sleep

import numpy as np
import pytest

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Plane,
    PointLoad,
    Pose,
    Rod,
    Sphere,
    Uncertainty,
    fit_rod,
    progress,
    public,
    robustness,
    solve_many,
)
from dlo_planner.identify import Observation
from dlo_planner.kernels import kernel
from dlo_planner.kernels.interruption import interrupted
from dlo_planner.parallel import CellGrid, capability_map
from dlo_planner.penalties import PositionAt, minimize_penalty
from dlo_planner.progress import Progress, interrupted_by, uninterrupted
from dlo_planner.rods import GraspedInside
from dlo_planner.settings.parameters import PARAMETERS
from dlo_planner.settings.tasks import plan_task

SOFT = Rod(1.0, 0.1, 0.02, 0.014, radius=0.005)
WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
LEVEL = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
TILTED = Pose((0.0, 0.0, 1.0), (0.1, 0.6, 0.2, 1.0))
AMONG = (Plane((0, 0, 0.7), (0, 0, 1), 0.6), Sphere((0.4, 0.02, 0.85), 0.08, 0.5),
         Capsule((0.6, -1, 0.8), (0.6, 1, 0.8), 0.05, 0.4),
         Box(Pose((0.8, 0, 0.75), (0, 0, 0, 1)), (0.2, 0.3, 0.2), 0.5))
HOLE = CutOut(Pose.looking_along((0.6, 0, 1), (1, 0, 0)), radius=0.05)


TOWARDS = Pose.looking_along((-0.8, 0, 1), (1, 0, 0))
VALUES = {name: one.default for name, one in PARAMETERS.items()} | {
    'threading.standoff': 0.05, 'threading.deepest': 0.5}


class Stopped(Exception):
    """What a check raises."""


def fine(n, rod=SOFT, **options):
    return DirectSimulator(rod, n_elements=n, basis='local', **options)


def from_afar():
    return fine(100, obstacles=AMONG).solve(LEVEL)


def with_moments():
    loads = [PointLoad(moment=(0.02, 0.05, 0.08)), PointLoad(moment=(0.05, 0, -0.1), s=0.5)]
    return fine(20, obstacles=AMONG, point_loads=loads).solve(TILTED)


def hanging():
    return fine(2000).solve(Pose((0, 0, 1), (0.3, -1, 0.1, 1)))


def held():
    return fine(600).solve(LEVEL, far_end=FarEnd(Pose((0.3, 0.2, 0.9), (0, 0, 1, 0.2))))


def in_motion():
    return fine(200).simulate([LEVEL, TILTED], 0.5).shapes[-1]


def many():
    shapes = solve_many(fine(400), [LEVEL, TILTED] * 20)
    return shapes


def by_dfp():
    return DirectSimulator(SOFT, method='dfp').solve(TILTED)


@cache
def bearing():
    simulator = fine(1500, Rod(1.0, 0.1, 0.1, 0.07, radius=0.01),
                     obstacles=[Plane((0, 0, 0.7), (0, 0, 1), 0.3)])
    return simulator, simulator.solve(LEVEL)


def goes_on():
    simulator, shape = bearing()
    return simulator.solve(Pose((0.01, 0, 1), (0, 0, 0, 1)), shape)


# what is one compiled call, or nearly, and how often it looks at least
LONG = [(from_afar, 15), (goes_on, 8), (with_moments, 30), (hanging, 3), (held, 3),
        (in_motion, 30), (many, 8), (by_dfp, 10)]


class Looks:
    """A check that counts, and stops at a number."""

    def __init__(self, last=np.inf):
        self.count, self.last, self.error = 0, last, Stopped()

    def __call__(self):
        self.count += 1
        if self.count == self.last:
            raise self.error


def looks_of(call):
    """Return how often a computation looks whether it is to end."""
    with interrupted_by(looks := Looks()):
        call()
    return looks.count


@pytest.mark.parametrize(('call', 'least'), LONG, ids=lambda one: getattr(one, '__name__', None))
def test_whatever_a_look_raises_comes_out_at_once_and_nothing_else_changes(call, least):
    before, looks = call(), looks_of(call)
    assert looks >= least
    for last in {1, looks // 2, looks}:
        stop = Looks(last)
        with pytest.raises(Stopped) as caught, interrupted_by(stop):
            call()
        assert caught.value is stop.error
        assert stop.count == last  # it is over: nobody asks again
    after = call()
    np.testing.assert_array_equal(after.positions, before.positions)
    np.testing.assert_array_equal(after.residual, before.residual)


def seen():
    shape = fine(32).solve(LEVEL)
    return [Observation(LEVEL, shape.positions[1:], shape.s[1:])]


def planned():
    return InverseSimulator(fine(32, WIRE)).thread(HOLE)


def on_a_fine_mesh(at):
    return InverseSimulator(fine(1000, WIRE)).plan(public.Thread(HOLE, depths=(0.0, 0.1)),
                                                   deadline=at)


# how often a public call looks at its own deadline at least, where none of its steps has ended
DEADLINES = [
    ('solve', lambda at: fine(100, obstacles=AMONG).solve(LEVEL, deadline=at), 15),
    ('grasped once', lambda at: GraspedInside(SOFT, 0.4, n_elements=60, basis='local',
                                              obstacles=AMONG).solve(LEVEL, deadline=at), 8),
    ('plan', lambda at: InverseSimulator(fine(32, WIRE)).plan(public.Thread(HOLE), deadline=at),
     80),
    ('waypoints', on_a_fine_mesh, 25),
    ('task', lambda at: plan_task(InverseSimulator(fine(32, WIRE)), public.Thread(HOLE), VALUES,
                                  start=TOWARDS, deadline=at), 180),
    ('track', lambda at: fine(100, obstacles=AMONG).track([LEVEL], deadline=at), 15),
    ('simulate', lambda at: fine(100, obstacles=AMONG).simulate([LEVEL], 0.01, deadline=at), 15),
    ('grasped', lambda at: GraspedInside(SOFT, 0.4, n_elements=60, basis='local',
                                         obstacles=AMONG).track([LEVEL], deadline=at), 8),
    ('many', lambda at: solve_many(fine(100, obstacles=AMONG), [LEVEL], deadline=at), 15),
    ('free', lambda at: solve_many(fine(400), [LEVEL, TILTED] * 20, deadline=at), 8),
    ('rods', lambda at: solve_many(fine(400), LEVEL, rods=[SOFT] * 40, deadline=at), 8),
    ('penalty', lambda at: minimize_penalty(fine(32), PositionAt(1.0, (0.5, 0, 0.6)), LEVEL,
                                            max_iterations=3, deadline=at), 5),
    ('map', lambda at: capability_map(InverseSimulator(fine(32, WIRE)), CellGrid(
        [[0.6, 0, 1]], [[1, 0, 0]], [0.05]), patience=1e9, deadline=at), 130),
    ('fit', lambda at: fit_rod(SOFT, seen(), n_elements=32, basis='local', deadline=at), 40),
    ('robust', lambda at: robustness(fine(32, WIRE), planned(), Uncertainty(length=0.01),
                                     samples=40, deadline=at), 3000),
    ('insert', lambda at: InverseSimulator(fine(32, WIRE)).insert(HOLE, friction=0.2,
                                                                  deadline=at), 160),
]



@pytest.mark.parametrize(('call', 'least'), [one[1:] for one in DEADLINES],
                         ids=[one[0] for one in DEADLINES])
def test_a_deadline_holds_within_a_step(call, least, monkeypatch):
    now = 0.0

    def clock():  # that goes on by 1 s whenever it is looked at
        nonlocal now
        now += 1.0
        return now
    monkeypatch.setattr(progress, 'monotonic', clock)
    call(1e9)
    assert now >= least
    for share in (0.3, 0.9):
        seconds = share * least
        with pytest.raises(DeadlineExceeded) as late:
            call(seconds)
        assert late.value.seconds == pytest.approx(seconds, abs=3.0)
        assert late.value.elapsed < seconds + 5.0


@kernel
def _counted(most, each):
    """Return how many steps are made until it is to end, `most` at most."""
    for step in range(most):
        if step % each == 0 and interrupted():
            return step
    return most


def test_what_a_kernel_keeps_is_raised_at_the_latest_at_the_end():
    def stop():
        raise Stopped
    assert _counted(100, 1) == 100 and not interrupted()
    with pytest.raises(Stopped), interrupted_by(stop):
        assert _counted(100, 1) == 0
        assert _counted(100, 1) == 0  # nor does anything else begin
    assert _counted(100, 1) == 100  # and it is forgotten
    with interrupted_by(stop):
        assert _counted(100, 1) == 0
        with pytest.raises(Stopped):
            uninterrupted(None)
        with interrupted_by(lambda: None):
            assert _counted(100, 1) == 100
        assert _counted(100, 1) == 0
        with pytest.raises(Stopped):
            uninterrupted(None)


def test_other_threads_go_on():
    def stop():
        raise Stopped
    made = []
    with pytest.raises(Stopped), interrupted_by(stop):
        thread = Thread(target=lambda: made.append(_counted(100, 1)))
        thread.start()
        thread.join()
        uninterrupted(None)
    assert made == [100]


def test_the_first_reason_is_the_one():
    steps = Progress(deadline=1e-9)
    with pytest.raises(DeadlineExceeded), interrupted_by(steps.check):
        uninterrupted(_counted(100, 1))


@pytest.fixture
def heard():
    """Raise KeyboardInterrupt at Control-C, which a shell lets its background jobs ignore."""
    known = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, known)


@pytest.mark.usefixtures('heard')
@pytest.mark.parametrize('checked', [True, False])
def test_control_c_is_not_lost_in_a_kernel(checked):
    def run():
        return uninterrupted(_counted(200_000_000, 1000))  # a second
    run_in = interrupted_by(lambda: None) if checked else nullcontext()
    with pytest.raises(KeyboardInterrupt), run_in:
        Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
        run()
        Event().wait(10.0)  # a quick machine had done it


def test_what_another_task_of_the_thread_computes_goes_on():
    """A check is of its context, kernels are of a thread."""
    whole = from_afar()

    def stop():
        raise Stopped

    async def waits():
        with interrupted_by(stop):
            await asyncio.sleep(0.05)

    async def computes():
        await asyncio.sleep(0.01)
        return from_afar()

    async def both():
        return await asyncio.gather(waits(), computes())

    _, shape = asyncio.run(both())
    assert shape.converged
    np.testing.assert_array_equal(shape.positions, whole.positions)


def test_a_check_may_compute_itself(capfd):
    looks, whole = [], from_afar()

    def check():
        looks.append(len(looks))
        if len(looks) == 3:
            from_afar()

    with interrupted_by(check):
        shape = from_afar()
    np.testing.assert_array_equal(shape.positions, whole.positions)
    assert len(looks) > 3 and 'Error' not in capfd.readouterr().err


@pytest.mark.usefixtures('heard')
def test_control_c_in_a_plain_solve_is_no_error_of_numba():
    strip = DirectSimulator(
        Rod.rectangular(1, 0.02, 0.004, 1000.0, 1e7, 0.3),
        obstacles=[Plane((0, 0, 0.7), (0, 0, 1), 0.6),
                   Capsule((0.6, -1, 0.8), (0.6, 1, 0.8), 0.05)])
    strip.solve(TILTED)  # kernels are loaded
    Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        strip.solve(TILTED)
        sleep(60)  # it was quicker than the signal


def test_each_public_call_that_reports_its_progress_takes_a_deadline():
    known = {name: getattr(public, name) for name in public.__all__}
    calls = [*known.items(), *(item for one in known.values() if isinstance(one, type)
                               for item in vars(one).items())]
    taking = {name: set(signature(call).parameters) for name, call in calls if callable(call)
              and not name.startswith('_') and not (
                  isinstance(call, type) and issubclass(call, BaseException))}
    long = {name for name, known in taking.items() if 'progress' in known} - {
        'demands', 'PlanContext'}  # which take one that has a deadline
    assert {'plan', 'thread', 'track', 'simulate', 'replay', 'fit_rod'} <= long
    assert {name for name in long if 'deadline' not in taking[name]} == set()
