# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps that are begun with what was seen ahead end where serial ones do."""

from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
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
    Pose,
    Rod,
    parallel,
)
from dlo_planner.direct.simulator import motion_by
from dlo_planner.parallel.pool import Pool
from dlo_planner.progress import Progress
from dlo_planner.study import speculation
from dlo_planner.study.speculation import leads_to, lower

SMALL = {'n_elements': 16, 'n_terms': 3}
processes = partial(ProcessPoolExecutor, 1, mp_context=get_context('fork'))


class Here(Executor):
    """Does everything at once, here; counts what it is given."""

    def __init__(self):
        self.given = 0

    def submit(self, function, /, *arguments):
        self.given += 1
        future = Future()
        future.set_result(function(*arguments))
        return future


class FromTheShapeBefore(speculation.AheadStepper):
    """Begins where the DLO is, so that what is seen ahead is better."""

    def guess(self, before, dt):
        return before.row.bends[0].copy()


@pytest.fixture
def rounds(monkeypatch):
    """Return the list of all Rounds that are made."""
    made, real = [], speculation.Rounds

    def make(*arguments):
        made.append(real(*arguments))
        return made[-1]

    monkeypatch.setattr(speculation, 'Rounds', make)
    return made


def turned(degrees):
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def swung(count):
    return [turned(60 * (1 - np.cos(np.pi * k / 12))) for k in range(count)]


def there_and_back(step):
    return [turned(angle) for angle in [*range(0, 181, step), *range(180 - step, -1, -step)]]


def yielding(**options):
    rod = copper_wire(yield_stress=60e6, hardening=0.01)
    return DirectSimulator(rod, **{'n_elements': 24, 'n_terms': 4, **options})


def assert_alike(one, other, tolerance=1e-9):
    assert len(one) == len(other)
    for shape, wanted in zip(one, other, strict=True):
        np.testing.assert_allclose(shape.positions, wanted.positions, atol=tolerance)
        assert (shape.converged, shape.jumped) == (wanted.converged, wanted.jumped)


@pytest.mark.every(3)
@pytest.mark.parametrize('integrator', ['paper', 'generalized_alpha'])
@pytest.mark.parametrize(('method', 'count', 'tolerance'), [
    ('newton', 13, 1e-2), ('dfp', 9, 1e-2), ('downhill_simplex', 5, np.inf)])
def test_a_motion_is_that_of_simulate(method, count, tolerance, integrator, rounds):
    simulator = DirectSimulator(copper_wire(damping=(0.5, 0.0)), method=method, **SMALL)
    way, more = swung(count), {'integrator': integrator, 'tolerance': tolerance}
    serial = simulator.simulate(way, 0.05, **more)
    ahead = parallel.speculative(simulator, way, 0.05, Here(), tasks=3, **more)
    assert serial.converged and ahead.converged
    assert_alike(ahead.shapes, serial.shapes)
    np.testing.assert_allclose(ahead.velocities, serial.velocities, atol=1e-7)
    assert sum(len(one.ahead) for one in rounds[0].made) >= len(way)


def test_guesses_are_used_where_they_are_better(monkeypatch, rounds):
    # from the shape before (as in the paper), which is farther off than what is seen ahead
    monkeypatch.setattr(speculation, 'AheadStepper', FromTheShapeBefore)
    simulator = DirectSimulator(copper_wire(damping=(0.5, 0.0)), **SMALL)
    way, more = swung(25), {'integrator': 'paper', 'tolerance': np.inf}
    alone = speculation.Rounds(Pool(Here(), lambda: None), 1)
    serial = motion_by(partial(FromTheShapeBefore, alone, 24), simulator,
                       way, 0.05, Progress(), **more)
    ahead = parallel.speculative(simulator, way, 0.05, Here(), tasks=2, **more)
    assert_alike(ahead.shapes, serial.shapes)
    assert_alike(ahead.shapes, simulator.simulate(way, 0.05, **more).shapes)
    made = rounds[-1].made
    assert [one.guess for one in made].count('used') > 20
    assert made[0].guess == 'none' and made[-1].ahead == ()
    assert sum(one.work for one in made) < 0.8 * sum(one.work for one in alone.made)


@pytest.mark.sweep
@pytest.mark.parametrize(('method', 'step', 'tasks'), [
    ('newton', 10, 4), ('newton', 3, 3), ('dfp', 3, 4), ('dfp', 10, 8)])
def test_a_dlo_that_yields_is_that_of_track(method, step, tasks, rounds):
    # it falls over, and beyond that leans at each step: where another way leads to a minimum
    # that lies near, 1e-2 of the length, the guess has to be refused
    simulator, way = yielding(method=method), there_and_back(step)
    serial = simulator.track(way)
    ahead = parallel.speculative(simulator, way, None, Here(), tasks=tasks)
    fallen = next(k for k, shape in enumerate(serial) if shape.jumped)
    assert_alike(ahead[:fallen + 1], serial[:fallen + 1], 1e-8)
    # beyond, each search leans, and what rounding leaves of one step is 1e-6 in the next
    assert_alike(ahead, serial, 1e-5)
    np.testing.assert_allclose([shape.dissipated for shape in ahead],
                               [shape.dissipated for shape in serial], rtol=1e-6, atol=1e-12)
    made = rounds[0].made
    used = [one.guess for one in made].count('used')
    assert used > len(made) / 2
    assert sum(one.work for one in made) < 0.9 * sum(
        shape.evaluations or shape.iterations for shape in serial)


@pytest.mark.sweep
def test_it_does_not_matter_who_computes():
    simulator, way = yielding(method='dfp'), there_and_back(10)[:12]
    rough = {'tolerance': np.inf, 'integrator': 'paper'}
    wanted = parallel.speculative(simulator, way, None, Here(), tasks=3)
    moved = parallel.speculative(simulator, swung(7), 0.05, Here(), tasks=3, **rough)
    for make in (partial(ThreadPoolExecutor, 2), processes):
        assert parallel.speculative(simulator, way, None, make, tasks=3) == wanted
        assert parallel.speculative(simulator, swung(7), 0.05, make, tasks=3, **rough) == moved


def test_it_goes_on_from_shapes_and_motions():
    simulator, way = DirectSimulator(copper_wire(), method='dfp', **SMALL), swung(9)
    first = simulator.simulate(way[:5], 0.05)
    ahead = parallel.speculative(simulator, way[4:], 0.05, Here(), tasks=2, initial=first)
    assert_alike(ahead.shapes, simulator.simulate(way[4:], 0.05, first).shapes)
    known, way = simulator.solve(turned(10)), there_and_back(10)[2:8]
    assert_alike(parallel.speculative(simulator, way, None, Here(), tasks=2, initial=known),
                 simulator.track(way, initial=known))
    newton = DirectSimulator(copper_wire(), **SMALL).solve(turned(10))  # of another simulator
    assert_alike(parallel.speculative(simulator, way, None, Here(), tasks=2, initial=newton),
                 simulator.track(way, initial=newton))


@pytest.mark.parametrize('simulator', [
    DirectSimulator(copper_wire(), n_elements=8, obstacles=[
        Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)]),
    DirectSimulator(copper_wire(), accuracy=1e-3),
    DirectSimulator(copper_wire(), method='dfp', strains='paper', n_elements=16),
    DirectSimulator(copper_wire(), n_elements=8, grip='pinned')])
def test_what_cannot_be_looked_at_is_done_one_by_one(simulator):
    executor, way = Here(), [turned(-angle) for angle in (0, 10, 20)]
    shapes = parallel.speculative(simulator, way, None, executor, tasks=3)
    assert shapes == simulator.track(way)
    assert executor.given == 0


def test_by_default_nothing_is_looked_at():
    executor, simulator = Here(), DirectSimulator(copper_wire(), method='dfp', **SMALL)
    assert parallel.speculative(simulator, swung(5), 0.05, executor) == simulator.simulate(
        swung(5), 0.05)
    assert parallel.speculative(simulator, swung(5), 0.05, tasks=4) == simulator.simulate(
        swung(5), 0.05)
    assert executor.given == 0


def test_a_guess_must_lead_where_the_serial_search_does():
    # a column too high to stand: leaning one way is as good as the other
    rod = Rod(1.0, 20 / 9.81, (1.0, 2.0), 0.75)
    simulator = DirectSimulator(rod, **SMALL)
    shape = simulator.solve(Pose.looking_along((0, 0, 0), (0, 0, 1)))
    mesh = simulator.mesh
    system = mesh.system(shape.gripper.rotation)
    here = mesh.unknowns(shape.element_strains)
    assert leads_to(system, 0.9 * here, here)[0]
    assert not leads_to(system, -0.9 * here, here)[0]
    assert lower(system, here, 0.9 * here) and not lower(system, 0.9 * here, here)


class _Dying(Executor):
    """Of its workers one is gone each time."""

    def submit(self, function, /, *arguments):
        future = Future()
        future.set_exception(BrokenExecutor('gone'))
        return future


def test_a_worker_that_dies_takes_its_guesses_alone():
    simulator, way = yielding(method='dfp'), there_and_back(10)[:8]
    found = parallel.speculative(simulator, way, None, _Dying, tasks=3)
    assert found == simulator.track(way)


def test_progress_and_deadline():
    simulator, way, seen = yielding(method='dfp'), there_and_back(10)[:5], []
    for dt in (None, 0.05):
        seen.clear()
        parallel.speculative(simulator, way, dt, Here(), tasks=2, tolerance=np.inf,
                             progress=lambda *both: seen.append(both))
        assert seen[-1] == (5, 5)
        with pytest.raises(DeadlineExceeded):
            parallel.speculative(simulator, way, dt, Here(), tasks=2, deadline=1e-9)
