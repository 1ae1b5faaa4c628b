"""Timings of the core on one machine, printed as a table; ratios within one run are what counts.

make bench
"""

import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent.parent))

from dlo_planner import (  # noqa: E402
    Capsule,
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Pose,
    Rod,
    modes_along,
)

ANGLES = [*range(0, 181, 10), *range(170, -1, -10)]


def wire(**more):
    """Return the paper's copper wire."""
    return Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, **more)


def gripper(degrees):
    """Return the gripper of benchmark C, turned up by an angle."""
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def level(height):
    """Return a level gripper at a height."""
    return Pose((0, 0, height), (0, 0, 0, 1))


def median_time(function, repeats):
    """Return the median duration of a call in s, after one that warms up."""
    function()
    times = []
    for _ in range(repeats):
        started = perf_counter()
        function()
        times.append(perf_counter() - started)
    return float(np.median(times))


def rows():
    """Yield (what, seconds, remark)."""
    for basis in ('local', 'chebyshev'):
        for elements in (32, 64, 128, 256):
            simulator = DirectSimulator(wire(), basis=basis, n_elements=elements)
            known = simulator.solve(gripper(10))
            seconds = median_time(lambda s=simulator, k=known: s.solve(gripper(20), k), 200)
            yield f'{basis}: warm solve after 10 deg, {elements} elements', seconds, ''
    for basis in ('local', 'chebyshev'):
        simulator = DirectSimulator(wire(), basis=basis)
        yield (f'{basis}: cold solve of A',
               median_time(lambda s=simulator: s.solve(gripper(0)), 100), '')
        loaded = DirectSimulator(wire(tip_mass=1.0), basis=basis)
        yield (f'{basis}: cold solve of B',
               median_time(lambda s=loaded: s.solve(gripper(0)), 100), '')
        path = [gripper(angle) for angle in ANGLES]
        yield (f'{basis}: benchmark C, track, 37 poses',
               median_time(lambda s=simulator, p=path: s.track(p), 5), 'two jumps are resolved')
        yield (f'{basis}: error estimate',
               median_time(lambda s=simulator: s.solve(gripper(0))._estimate(), 100)
               - median_time(lambda s=simulator: s.solve(gripper(0)), 100), 'when first read')
    for name, rod in (('A', wire()), ('B', wire(tip_mass=1.0))):
        for accuracy in (1e-4, 1e-6):
            simulator = DirectSimulator(rod, accuracy=accuracy)
            shape = simulator.solve(gripper(0))
            yield (f'accuracy {accuracy:g} m, cold solve of {name}',
                   median_time(lambda s=simulator: s.solve(gripper(0)), 20),
                   f'{len(shape.s) - 1} elements')
    bar = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
    touching = DirectSimulator(wire(), obstacles=[bar])
    known = touching.track([level(0.95), level(0.8)])[-1]
    yield ('chebyshev: contact step, gripper lowered by 10 mm onto a bar',
           median_time(lambda: touching.solve(level(0.79), known), 100), '')
    moving = DirectSimulator(wire())
    yield ('chebyshev: dynamic step, gripper turning, of 50',
           median_time(lambda: moving.simulate([gripper(k) for k in range(51)], 0.02), 5) / 50, '')
    for basis in ('chebyshev', 'local'):
        shape = DirectSimulator(wire(), basis=basis).solve(gripper(0))
        yield (f'{basis}: 4 modes', median_time(lambda s=shape: s.modes(4), 50), '64 elements')
    path = DirectSimulator(wire()).track([gripper(k) for k in range(30)])
    yield ('chebyshev: 4 modes along a path, a shape',
           median_time(lambda p=path: modes_along(p, 4), 5) / len(path), '64 elements')
    yielding = DirectSimulator(wire(yield_stress=60e6, hardening=0.01))
    known = yielding.solve(gripper(10))
    yield ('chebyshev: plastic step after 10 deg, fibers',
           median_time(lambda: yielding.solve(gripper(20), known), 100), '')
    goal = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
    stiffer = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
    for basis in ('local', 'chebyshev'):
        inverse = InverseSimulator(DirectSimulator(stiffer, basis=basis))
        depths = np.linspace(0, 0.95, 100)
        yield (f'{basis}: threading, 100 waypoints',
               median_time(lambda i=inverse, d=depths: i.thread(goal, depths=d), 10), '')
        second = CutOut(Pose.looking_along((0.3, 0.05, 0.95), (1, 0, 0)))
        yield (f'{basis}: two cut-outs, 100 waypoints',
               median_time(lambda i=inverse, d=depths, b=second: i.thread_two(goal, b, depths=d),
                           5), '')
        few = depths[::10]
        yield (f'{basis}: threading, 10 waypoints, the paper\'s nested method',
               median_time(lambda i=inverse, d=few: i.thread(goal, depths=d, method='nested'), 3),
               '')


def main():
    """Print the table."""
    for what, seconds, remark in rows():
        print(f'{what:62s} {1e3 * seconds:9.3f} ms  {remark}')


if __name__ == '__main__':
    main()
