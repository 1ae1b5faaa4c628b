# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Many shapes at once are those that one after the other would give, whoever computes them."""

import os
import signal
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from wires import copper_wire

from dlo_planner import (
    Capsule,
    DeadlineExceeded,
    DirectSimulator,
    InvalidTask,
    Plane,
    Pose,
    parallel,
    solve_many,
)
from dlo_planner.model.pose import pose_of
from dlo_planner.progress import interrupted_by
from dlo_planner.results import Shapes

BAR = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
FIGURES = ('positions', 'frames', 'element_strains', 'gripper_wrench', 'energy', 'elastic_energy',
           'dissipated', 'residual', 'stability', 'violation', 'iterations', 'converged', 'jumped')


def processes():
    return ProcessPoolExecutor(2, mp_context=get_context('fork'))


def turned(degrees):
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def benchmark_c():
    return [turned(angle) for angle in [*range(0, 181, 10), *range(170, -1, -10)]]


def lowered(count, lowest=0.59):
    return [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(0.95, lowest, count)]


@pytest.fixture(scope='module')
def simulator():
    return DirectSimulator(copper_wire(), n_elements=32)


@pytest.fixture(scope='module')
def anywhere():
    rng = np.random.default_rng(7)
    back = Pose(rng.normal(size=3), rng.normal(size=4))
    transposed = pose_of(-back.position, back.rotation.T)  # in memory, too
    assert not transposed.rotation.flags.c_contiguous
    return [transposed, *(Pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(39))]


def assert_same(shapes, serial):
    assert len(shapes) == len(serial)
    for k, shape in enumerate(serial):
        for name in FIGURES:
            np.testing.assert_array_equal(getattr(shapes, name)[k], getattr(shape, name), name)
        assert shapes[k].gripper == shape.gripper
        assert shapes[k].contacts == shape.contacts


def test_each_by_itself_is_what_solve_gives(simulator, anywhere):
    serial = [simulator.solve(pose) for pose in anywhere]
    alone = solve_many(simulator, anywhere)
    assert_same(alone, serial)
    assert parallel.map(simulator, anywhere, chunk=7) == alone
    with ThreadPoolExecutor(2) as executor:
        assert parallel.map(simulator, anywhere, executor, chunk=7) == alone
    assert parallel.map(simulator, anywhere, processes, chunk=7) == alone


def test_the_last_pieces_are_small(simulator, anywhere):
    serial, shared = [], []
    parallel.map(simulator, 5 * anywhere, chunk=64, progress=lambda done, _: serial.append(done))
    with ThreadPoolExecutor(2) as executor:
        parallel.map(simulator, 5 * anywhere, executor, chunk=64,
                     progress=lambda done, _: shared.append(done))
    assert serial == [64, 128, 192, 200]
    assert len(shared) == 8 and shared[-1] == 200 and np.diff([0, *shared]).max() == 50
    assert np.diff([0, *shared]).min() == 16


def test_yielding_and_friction_too():
    yielding = DirectSimulator(copper_wire(yield_stress=60e6, hardening=0.01), n_elements=8)
    rough = DirectSimulator(copper_wire(), n_elements=8, obstacles=[
        Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02, 0.3)])
    for simulator, way in ((yielding, benchmark_c()[:5]), (rough, lowered(5, 0.7))):
        serial = [simulator.solve(pose) for pose in way]
        assert_same(parallel.map(simulator, way, processes, chunk=2), serial)
        assert_same(parallel.map(simulator, [way], processes, chunk=2)[0], simulator.track(way))


def test_short_motions_are_those_of_track(simulator):
    motions = [benchmark_c()[5 * k:5 * k + 5] for k in range(6)]
    for shapes, motion in zip(parallel.map(simulator, motions, processes), motions, strict=True):
        assert_same(shapes, simulator.track(motion))


def test_motions_are_those_of_track_in_other_processes():
    simulator = DirectSimulator(copper_wire(), n_elements=32,
                                obstacles=[BAR, Plane((0, 0, 0.3), (0, 0, 1))])
    motions, reported = [lowered(12), lowered(3)], []
    for shapes, motion in zip(parallel.map(
            simulator, motions, processes, progress=lambda *done: reported.append(done)),
            motions, strict=True):
        assert_same(shapes, simulator.track(motion))
    assert reported[-1] == (15, 15)


def test_what_follows_a_failure_goes_on_from_the_last_shape_that_did_not_fail():
    floor = Plane((0, 0, 1.2), (0, 0, 1))  # the gripper has to be above it
    blocked = DirectSimulator(copper_wire(), n_elements=8, obstacles=[floor])
    way = [Pose((0, 0, z), (0, 0, 0, 1)) for z in [2.5, 2.4, 1.1, 2.4, 2.5]]
    shapes, = parallel.map(blocked, [way])
    assert shapes.converged.tolist() == [True, True, False, True, True]
    np.testing.assert_array_equal(shapes.positions,
                                  [shape.positions for shape in blocked.track(way)])


def test_a_pinned_gripper():
    simulator = DirectSimulator(copper_wire(natural_curvature=(0.0, 1.0)), n_elements=16,
                                grip='pinned')
    poses = [turned(angle) for angle in (0, 40, 80)]
    shapes = parallel.map(simulator, poses)
    for shape, serial in zip(shapes, map(simulator.solve, poses), strict=True):
        np.testing.assert_array_equal(shape.positions, serial.positions)
        np.testing.assert_allclose(shape.gripper.rotation, serial.gripper.rotation, atol=1e-14)


def test_a_graded_mesh_is_given_on_the_common_nodes():
    simulator = DirectSimulator(copper_wire(tip_mass=1.0), accuracy=1e-5)
    serial = [simulator.solve(turned(angle)) for angle in (0, 30)]
    shapes = solve_many(simulator, [shape.gripper for shape in serial])
    assert {shape.s.size for shape in serial} != {shapes.s.size}
    for k, shape in enumerate(serial):
        np.testing.assert_allclose(shapes.positions[k], shape.positions_at(shapes.s), atol=1e-12)
        assert shapes.converged[k] and shapes.residual[k] == shape.residual


class _Dying(ProcessPoolExecutor):
    """A pool of which a process is killed while it works on the 3rd piece, and on the 15th."""

    killed = 0

    def submit(self, function, /, *args, **kwargs):
        future = super().submit(function, *args, **kwargs)
        type(self).killed += 1
        if self.killed in (3, 15):
            os.kill(next(iter(self._processes)), signal.SIGKILL)
        return future


class _Broken(Executor):
    """A pool that is broken from the beginning; counts how many were made."""

    made = 0

    def __init__(self):
        type(self).made += 1
        assert self.made < 5

    def submit(self, *_, **__):
        future = Future()
        future.set_exception(BrokenExecutor('gone'))
        return future


class _Forgetful(_Broken):
    """As that of Python 3.11: what is submitted while it finds that it is broken never ends."""

    made = given = 0

    def submit(self, function, /, *args, **kwargs):
        self.given += 1
        future = Future()
        if self.made > 1:
            future.set_result(function(*args, **kwargs))
        elif self.given < 3:
            future.set_exception(BrokenExecutor('gone'))
        return future


def test_what_a_broken_pool_forgets_is_done_by_the_next(simulator, anywhere):
    _Forgetful.made = 0
    assert parallel.map(simulator, anywhere, _Forgetful, chunk=7) == solve_many(simulator, anywhere)
    assert _Forgetful.made == 2


def test_a_pool_is_made_anew_once_in_a_row(simulator, anywhere):
    _Broken.made = 0
    with pytest.raises(BrokenExecutor):
        parallel.map(simulator, anywhere, _Broken, chunk=7)
    assert _Broken.made == 2
    with _Broken() as given, pytest.raises(BrokenExecutor):
        parallel.map(simulator, anywhere, given, chunk=7)
    assert _Broken.made == 3


def test_a_killed_worker_costs_nothing(simulator, anywhere):
    _Dying.killed = 0
    make = partial(_Dying, 2, mp_context=get_context('fork'))
    reported = []
    shapes = parallel.map(simulator, anywhere, make, chunk=2,
                          progress=lambda *both: reported.append(both))
    assert shapes == solve_many(simulator, anywhere)
    assert _Dying.killed > 15
    assert reported[-1] == (40, 40)
    assert reported == sorted(set(reported))
    _Dying.killed = 0
    with make() as executor, pytest.raises(BrokenProcessPool):  # who gave it has to make another
        parallel.map(simulator, anywhere, executor, chunk=2)


def _die(_):
    os.kill(os.getpid(), signal.SIGKILL)


def test_work_that_kills_its_workers_is_given_up(simulator, anywhere, monkeypatch):
    monkeypatch.setattr('dlo_planner.parallel.batch.columns_of', _die)
    with pytest.raises(BrokenProcessPool):
        parallel.map(simulator, anywhere, processes)


class _Never(Executor):
    """Its futures never end."""

    def __init__(self):
        self.given = []

    def submit(self, function, /, *args, **kwargs):
        self.given.append(Future())
        return self.given[-1]


class _CancelledError(Exception):
    pass


def test_cancel_and_deadline(simulator, anywhere):
    looks = []

    def enough():
        looks.append(1)
        if len(looks) > 8:
            raise _CancelledError

    never = _Never()
    with interrupted_by(enough), pytest.raises(_CancelledError):
        parallel.map(simulator, anywhere, never, chunk=8)
    assert len(never.given) == 5 and all(future.cancelled() for future in never.given)
    never = _Never()
    with pytest.raises(DeadlineExceeded):
        parallel.map(simulator, anywhere, never, deadline=0.05)
    assert all(future.cancelled() for future in never.given)
    with pytest.raises(DeadlineExceeded):
        solve_many(simulator, anywhere, deadline=1e-6)


def _unlucky(piece):
    raise ArithmeticError(len(piece.positions))


def test_errors_of_workers_are_raised(simulator, anywhere, monkeypatch):
    monkeypatch.setattr('dlo_planner.parallel.batch.columns_of', _unlucky)
    with pytest.raises(ArithmeticError, match='8'):
        parallel.map(simulator, anywhere, processes, chunk=8)


def test_what_is_no_work_is_refused(simulator, anywhere):
    with pytest.raises(InvalidTask, match=r'work\[1\]'):
        parallel.map(simulator, [anywhere[0], anywhere])
    with pytest.raises(InvalidTask, match=r'work\[0\]'):
        parallel.map(simulator, [[]])
    with pytest.raises(InvalidTask, match='executor'):
        parallel.map(simulator, anywhere, lambda: 3)
    assert len(parallel.map(simulator, [])) == 0


# ---- shapes as arrays -----------------------------------------------------------------------


@pytest.fixture(scope='module')
def tracked():
    simulator = DirectSimulator(copper_wire(), n_elements=16, obstacles=[BAR])
    return simulator.track([Pose((0, 0, z), (0, 0, 0, 1)) for z in (0.9, 0.75, 0.7, 0.65)])


def test_shapes_one_by_one(tracked):
    shapes = Shapes.of(tracked)
    assert len(shapes) == 4 and len(shapes.contact_table)
    for shape, other in zip(shapes, tracked, strict=True):
        for name in ('positions', 'frames', 'element_strains', 'gripper_wrench', 'energy',
                     'stability', 'converged', 'contacts', 'gripper', 'dissipated'):
            np.testing.assert_equal(getattr(shape, name), getattr(other, name))
        assert np.isnan(shape.error_estimate)  # not known, and not 0
    np.testing.assert_array_equal(shapes.tangents[2], tracked[2].tangents)
    assert shapes[-1].contacts == tracked[-1].contacts
    with pytest.raises(IndexError):
        shapes[4]


def test_slices_and_joining(tracked):
    shapes = Shapes.of(tracked)
    assert Shapes.joined([shapes[:1], shapes[1:3], shapes[3:]]) == shapes
    assert Shapes.of(tracked[::-1]) == shapes[::-1]
    assert len(shapes[4:]) == 0
    assert Shapes.joined([shapes[4:], shapes]) == shapes


def test_a_shape_of_them_starts_a_search(tracked):
    simulator = DirectSimulator(copper_wire(), n_elements=16, obstacles=[BAR])
    again = simulator.solve(tracked[2].gripper, Shapes.of(tracked)[2])
    np.testing.assert_allclose(again.positions, tracked[2].positions, atol=1e-7)


def test_on_other_nodes(tracked):
    s = np.array([0.0, 0.21, 0.5, 1.0])
    shapes = Shapes.of(tracked, s)
    for k, shape in enumerate(tracked):
        np.testing.assert_allclose(shapes.positions[k], shape.positions_at(s), atol=1e-15)
        # their mean turns as far as the strains do
        np.testing.assert_allclose(np.diff(s) @ shapes.element_strains[k],
                                   np.diff(shape.s) @ shape.element_strains, atol=1e-12)


def test_what_does_not_fit_is_refused(tracked):
    shapes = Shapes.of(tracked)
    with pytest.raises(InvalidTask, match=r'parts\[1\]'):
        Shapes.joined([shapes, Shapes.of(tracked, [0.0, 1.0])])
    with pytest.raises(InvalidTask, match=r'shapes\[0\]'):
        Shapes.of(tracked, [0.0, 2.0])
    held = DirectSimulator(copper_wire(), n_elements=8).solve(Pose.identity(), far_end=(0.8, 0, 0))
    assert Shapes.of([held])[0].holds == held.holds
    with pytest.raises(InvalidTask, match=r'shapes\[1\]'):
        Shapes.of([tracked[0], held])
