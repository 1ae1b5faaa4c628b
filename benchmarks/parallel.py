# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How much two workers gain: 2,000 shapes of the paper's wire by one, two threads, two processes.

python benchmarks/parallel.py [poses [turns]]

The hand-written loop of floor.py, halved by two workers that exist already, says what two cores of
this machine can give: virtual cores may share the parts of one. Both are measured by turns.
"""

import os
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from time import perf_counter, process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks import floor  # noqa: E402
from benchmarks.cases import local, rotations  # noqa: E402
from dlo_planner import Capsule, DirectSimulator, Pose, Rod, parallel  # noqa: E402

POOLS = {'threads': lambda: ThreadPoolExecutor(2),
         'processes': lambda: ProcessPoolExecutor(2, mp_context=get_context('fork'))}


def timed(call):
    """Return what a call returns, wall-clock seconds and CPU seconds of this process."""
    wall, cpu = perf_counter(), process_time()
    result = call()
    return result, perf_counter() - wall, process_time() - cpu


def by_the_floor(bases):
    """Solve for gripper rotations (n, 3, 3) by the hand-written loop; return how many. Workers."""
    floor.solved(floor.copper_wire(), bases)
    return len(bases)


def halved(executor, bases):
    """Do the same with two workers."""
    return sum(executor.map(by_the_floor, np.array_split(bases, 2)))


def started_in(make):
    """Return s until two workers of a new pool have answered a question that costs nothing."""
    begun = perf_counter()
    with make() as executor:
        list(executor.map(abs, (1, 2)))
        return perf_counter() - begun


def by_turns(calls, turns):
    """Return for each name the median s, and the median of how much quicker than the first."""
    times = {name: [] for name in calls}
    for turn in range(turns + 1):
        for name, call in calls.items():
            wall = timed(call)[1]
            if turn:  # the first one starts workers and compiles
                times[name].append(wall)
    first = np.array(next(iter(times.values())))
    return {name: (float(np.median(row)), float(np.median(first / row)))
            for name, row in times.items()}


def ceiling(simulator, poses, turns):
    """Print how much two workers gain, here and by the hand-written loop, measured by turns."""
    bases = rotations(poses)
    begun = os.getloadavg()[0]
    with POOLS['threads']() as threads, POOLS['processes']() as processes:
        ours, loop = (by_turns(calls, turns) for calls in (
            {'alone': lambda: parallel.map(simulator, poses),
             'threads': lambda: parallel.map(simulator, poses, threads),
             'processes': lambda: parallel.map(simulator, poses, processes)},
            {'alone': lambda: by_the_floor(bases),
             'threads': lambda: halved(threads, bases),
             'processes': lambda: halved(processes, bases)}))
    print(f'{len(poses)} shapes, medians of {turns} turns, load {begun:.1f}: alone '
          f'{ours["alone"][0]:.3f} s, hand-written loop {loop["alone"][0]:.3f} s')
    for name, make in POOLS.items():
        print(f'  two {name}: {ours[name][1]:.2f} times as fast, the loop {loop[name][1]:.2f}: '
              f'{ours[name][1] / loop[name][1]:.2f} of it; to start them '
              f'{1e3 * started_in(make):.0f} ms')


def main():
    """Print times, speedups, and what the work itself costs."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    turns = int(sys.argv[2]) if len(sys.argv) > 2 else 15
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    rng = np.random.default_rng(0)
    poses = [Pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(count)]
    ceiling(local(rod=wire), poses, turns)
    bar = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
    way = [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(0.95, 0.59, count)]
    for what, simulator, work in (
            ('each by itself', DirectSimulator(wire), poses),
            ('lowered onto a bar, followed', DirectSimulator(wire, obstacles=[bar]), [way])):
        parallel.map(simulator, work)  # compiles, and warms up
        serial, wall, cpu = timed(lambda s=simulator, w=work: parallel.map(s, w))
        print(f'{what}: {count} shapes, load {os.getloadavg()[0]:.1f}: {wall:.2f} s, '
              f'CPU {cpu:.2f} s, {1e3 * cpu / count:.3f} ms a shape')
        for name, make in POOLS.items():
            before = getrusage(RUSAGE_CHILDREN)
            found, two, own = timed(lambda s=simulator, w=work, m=make: parallel.map(s, w, m))
            after = getrusage(RUSAGE_CHILDREN)
            others = (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)
            print(f'  two {name}: {two:.2f} s, {wall / two:.2f} times as fast, CPU {own:.2f} s '
                  f'here and {others:.2f} s in others, same: {found == serial}')


if __name__ == '__main__':
    main()
