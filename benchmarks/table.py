# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The rows: all that is timed."""

from dataclasses import replace

import numpy as np

from benchmarks.cases import (
    ANGLES,
    BAR,
    IDLE,
    SMOOTH,
    chebyshev,
    held,
    hole,
    level,
    local,
    random_ends,
    random_poses,
    scenes,
    swinging,
    turned,
    wire,
)
from benchmarks.measured import growth, iteration, start_of_python
from benchmarks.rows import Goal, Row, row
from benchmarks.rulers import FLOORS
from benchmarks.timing import Work
from dlo_planner import (
    Box,
    DirectSimulator,
    FarEnd,
    Hold,
    InverseSimulator,
    Plane,
    Pose,
    Trajectory,
    parallel,
)
from dlo_planner.direct.sensitivity import Sensitivity

_DEPTHS = np.linspace(0, 0.95, 100)
_FEW = np.linspace(0, 0.9, 31)
_STEPS = 100


def rows() -> list[Row]:
    """Return all rows, in the order in which they are printed."""
    return [*_floors(), *_solves(), *_motions(), *_tasks(), *_contacts(), *_held(),
            *_idle(), *_others()]


def _floors():
    for name, what in (('warm', 'warm solve'), ('warm 32', 'warm solve, 32 elements'),
                       ('cold', 'cold solve of A'), ('random', 'random pose, cold'),
                       ('C', 'benchmark C, jumps not proved')):
        yield replace(row(f'floor: {what}', FLOORS[name], floor=name), guarded=False)


def _warm(simulator):
    known, gripper = simulator.solve(turned(10)), turned(20)
    return Work(lambda: simulator.solve(gripper, known))


def _cold(simulator, pose=None):
    gripper = pose or turned(0)
    return Work(lambda: simulator.solve(gripper))


def _random(simulator, count=50):
    poses = random_poses(count)
    return Work(lambda: [simulator.solve(pose) for pose in poses], count)


def _solves():
    yield row('warm solve, local', lambda: _warm(local()), Goal(0.08, 'ms'))
    yield row('warm solve, Chebyshev', lambda: _warm(chebyshev()), Goal(0.12, 'ms'))
    yield row('warm solve, local, 32 elements', lambda: _warm(local(32)), Goal(0.05, 'ms'),
              floor='warm 32')
    yield row('warm solve, Chebyshev, 32 elements', lambda: _warm(chebyshev(32)), floor='warm 32')
    yield row('cold solve of A, local', lambda: _cold(local()), Goal(0.15, 'ms'), floor='cold')
    yield row('cold solve of A, Chebyshev', lambda: _cold(chebyshev()), floor='cold')
    yield row('cold solve of B, local', lambda: _cold(local(rod=wire(tip_mass=1.0))), floor='cold')
    yield row('random pose, cold, local', lambda: _random(local()), Goal(0.15, 'ms'),
              floor='random')
    yield row('random pose, cold, Chebyshev', lambda: _random(chebyshev()), floor='random')
    yield Row('Newton iteration, local', (Goal(14, 'us'),), iteration, 'us')


def _track(simulator, angles):
    poses = [turned(angle) for angle in angles]
    return Work(lambda: simulator.track(poses))


def _loop(simulator, angles):
    poses = [turned(angle) for angle in angles]

    def follow():
        shape = None
        for pose in poses:
            shape = simulator.solve(pose, shape)

    return Work(follow)


def _motions():
    yield row('benchmark C, track, local', lambda: _track(local(), ANGLES), Goal(8, 'ms'),
              floor='C')
    yield row('benchmark C, track, Chebyshev', lambda: _track(chebyshev(), ANGLES), floor='C')
    yield row('smooth way of 37 poses, track, local', lambda: _track(local(), SMOOTH),
              Goal(1.2, 'loops of solve'), floor='C',
              others={'loops of solve': lambda: _loop(local(), SMOOTH)})


def _inverse(simulate=local):
    return InverseSimulator(simulate(rod=wire(1.5e-3)))


def _tasks():
    first, second = hole((0, 0, 1)), hole((0.3, 0.05, 0.95))
    several = [hole((0, 0, 1)), hole((0.2, 0.02, 0.99)), hole((0.4, 0.0, 0.93))]

    def one(simulate):
        inverse = _inverse(simulate)
        return Work(lambda: inverse.thread(first, depths=_DEPTHS), len(_DEPTHS))

    def two():
        inverse = _inverse()
        return Work(lambda: inverse.thread_two(first, second, depths=_DEPTHS), len(_DEPTHS))

    def sequence():
        inverse = _inverse()
        return Work(lambda: inverse.thread_sequence(several, depths=_FEW), len(_FEW))

    yield row('thread, a waypoint, local', lambda: one(local), Goal(2, 'solves'))
    yield row('thread, a waypoint, Chebyshev', lambda: one(chebyshev), Goal(2, 'solves'))
    yield row('thread_two, a waypoint', two, Goal(4, 'solves'))
    yield row('thread_sequence of three, a waypoint', sequence, Goal(20, 'solves'))


def _contact_step():
    simulator = DirectSimulator(wire(), obstacles=[BAR])
    known = simulator.track([level(0.95), level(0.8)])[-1]
    gripper = level(0.79)
    return Work(lambda: simulator.solve(gripper, known))


def _each_step(simulator, poses):
    shapes = simulator.track(poses)
    touching = [(pose, before) for pose, before, after in zip(poses[1:], shapes, shapes[1:],
                                                              strict=False) if after.contacts]
    if not touching:
        raise ValueError('the wire touches nothing in this scene')
    return [Work(lambda p=pose, b=before: simulator.solve(p, b)) for pose, before in touching]


def _on_a_table(friction, along, others=()):
    """Return steps of 1 mm of a wire of which a fifth lies on a table: some ten contacts."""
    simulator = local(obstacles=[Plane((0, 0, 0), (0, 0, 1), friction), *others])
    start = simulator.track([level(z) for z in np.arange(0.3, 0.095, -0.01)])[-1]
    ways = [Pose(start.gripper.position + 1e-3 * k * np.array(along), (0, 0, 0, 1))
            for k in range(1, 6)]
    shapes = [start, *simulator.track(ways, initial=start)[:-1]]
    return [Work(lambda p=pose, b=known: simulator.solve(p, b))
            for pose, known in zip(ways, shapes, strict=True)]


def _above_boxes():
    """Return a step on a table above 1,000 boxes that no wire there can reach."""
    places = np.random.default_rng(0).uniform((-1, -1, -7), (1, 1, -6), (1000, 3))
    boxes = [Box(Pose(place, (0, 0, 0, 1)), (0.1, 0.1, 0.1)) for place in places]
    return _on_a_table(0.0, (0, 0, -1), boxes)


def _contacts():
    yield row('contact step of 10 mm, copper wire on a bar', _contact_step, Goal(10, 'solves'))
    for name, (simulator, poses) in scenes().items():
        yield row(f'contact step of 10 mm, {name}, friction',
                  lambda s=simulator, p=poses: _each_step(s, p), Goal(5, 'ms'),
                  Goal(50, 'ms at worst'))
    for what, friction, goal in (('', 0.0, 8), (', friction', 0.3, 14)):
        for how, along in (('down', (0, 0, -1)), ('along', (1, 0, 0)), ('across', (0, 1, 0))):
            yield row(f'step of 1 mm {how}, wire on a table{what}',
                      lambda f=friction, a=along: _on_a_table(f, a), Goal(goal, 'solves'))
    yield row('step of 1 mm down, wire on a table above 1,000 boxes', _above_boxes,
              Goal(3, 'without boxes'),
              others={'without boxes': lambda: _on_a_table(0.0, (0, 0, -1))[0]})


def _held():
    simulator, end = chebyshev(), held()
    moved = FarEnd(level(1.001, 0.802))

    gripper = turned(0)

    def warm():
        known = simulator.solve(gripper, far_end=end)
        return Work(lambda: simulator.solve(gripper, known, far_end=moved))

    yield row('far end held, step of 2 mm', warm, Goal(3, 'solves'))
    yield row('far end held, from the natural shape',
              lambda: Work(lambda: simulator.solve(gripper, far_end=end)), Goal(100, 'solves'))
    yield row('random clamped ends, cold, local', _random_ends, Goal(1, 'ms'), floor='random')
    yield row('step of a wire in two clips, its end clamped', _chain, Goal(20, 'ms'))
    yield row('Sensitivity of 12 columns, local', _sensitivity, Goal(0.2, 'ms'))


def _random_ends(count=40):
    simulator = local()
    pairs = [(gripper, FarEnd(end)) for gripper, end in random_ends(count)]

    def solve_all():
        for gripper, end in pairs:
            simulator.solve(gripper, far_end=end)

    return Work(solve_all, count)


def _chain():
    simulator = local()

    def held_at(height):
        return [Hold(level(height, 0.3), 'sleeve', 0.32), Hold(level(height, 0.6), 'sleeve', 0.65),
                FarEnd(level(1.0, 0.85))]

    known = simulator.solve(turned(0), holds=held_at(1.0))
    return Work(lambda: simulator.solve(turned(0), known, holds=held_at(1.002)))


def _sensitivity():
    shape = local().solve(turned(0), far_end=held())
    return Work(lambda: Sensitivity(shape).by_grips(0.5))


def _second(simulator):
    poses = swinging()
    return Work(lambda: simulator.simulate(poses, 0.01))


_IDLE = {  # how a DLO is asked for on which nothing acts but its weight
    'warm solve': lambda **around: _warm(chebyshev(**around)),
    'warm solve, local': lambda **around: _warm(local(**around)),
    'warm solve, accuracy 1e-5 m': lambda **around: _warm(
        DirectSimulator(around.pop('rod', None) or wire(), accuracy=1e-5, **around)),
    'benchmark C, track, local': lambda **around: _track(local(**around), ANGLES),
    'smooth way of 37 poses, track': lambda **around: _track(chebyshev(**around), SMOOTH),
    '1 s of a motion': lambda **around: _second(local(**around)),
}


def _idle():
    for what, around in IDLE.items():
        for name, make in _IDLE.items():
            yield row(f'{name}, {what}', lambda m=make, a=around: m(**a()),
                      Goal(2.0 if 'table' in what else 1.5, 'free'), others={'free': make})


def _dynamic():
    simulator = local(40)
    poses = [turned(0.2 * k) for k in range(_STEPS + 1)]
    return Work(lambda: simulator.simulate(poses, 0.005, tolerance=np.inf), _STEPS)


def _accurate(rod):
    simulator, gripper = DirectSimulator(rod, accuracy=1e-6), turned(0)
    return Work(lambda: simulator.solve(gripper))


def _many(n, count=500):
    simulator, poses = local(n), random_poses(count)
    own = getattr(simulator, 'solve_many', None)
    solve = own or (lambda given: parallel.solve_many(simulator, given))
    return Work(lambda: solve(poses), count)


def _many_rods(n, count=500):
    simulator, poses = local(n), random_poses(count)
    rods = [wire(1e-3 * (1 + 1e-4 * k)) for k in range(count)]
    return Work(lambda: parallel.solve_many(simulator, poses, rods=rods), count)


def _timed():
    plan = _inverse().thread(hole((0, 0, 1)), depths=_FEW)
    return Work(lambda: Trajectory(plan))


def _others():
    yield row('Pose.looking_along',
              lambda: Work(lambda: Pose.looking_along((0, 0, 1), (1, 0.2, 0.1))), Goal(0.02, 'ms'))
    yield row('Trajectory of 31 waypoints', _timed, Goal(1.0, 's'), unit='s')
    yield row('dynamic step, 40 elements', _dynamic, Goal(0.1, 'ms'))
    yield row('accuracy 1e-6 m, cold solve of A', lambda: _accurate(wire()), Goal(10, 'solves'))
    yield row('accuracy 1e-6 m, cold solve of B', lambda: _accurate(wire(tip_mass=1.0)),
              Goal(10, 'solves'))
    yield row('solve_many, a shape, 64 elements', lambda: _many(64), Goal(1e4, 'per s'),
              floor='random')
    yield row('solve_many, a shape, 32 elements', lambda: _many(32), Goal(2.5e4, 'per s'),
              floor='random 32')
    yield row('solve_many of many rods, a shape, 64 elements', lambda: _many_rods(64),
              floor='random')
    yield Row('growth of a cold solve up to 4096 elements (exponent)', (Goal(1.05, ''),), growth,
              '', guarded=False)
    yield Row('first shape after the start of Python', (Goal(1.5, 's'),),
              lambda budget: start_of_python(_FIRST), 's', guarded=False)
    yield Row('import dlo_planner', (Goal(0.5, 's'),),
              lambda budget: start_of_python('import dlo_planner'), 's', guarded=False)


_FIRST = """
from dlo_planner import DirectSimulator, Pose, Rod
wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
assert DirectSimulator(wire, n_elements=64).solve(Pose((0, 0, 1), (0, 0, 0, 1))).converged
"""
