# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How much two workers gain: 2,000 shapes of the paper's wire by one, two threads, two processes.

python benchmarks/parallel.py [poses]
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

from dlo_planner import Capsule, DirectSimulator, Pose, Rod, parallel  # noqa: E402


def timed(call):
    """Return what a call returns, wall-clock seconds and CPU seconds of this process."""
    wall, cpu = perf_counter(), process_time()
    result = call()
    return result, perf_counter() - wall, process_time() - cpu


def main():
    """Print times, speedups, and what the work itself costs."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    rng = np.random.default_rng(0)
    poses = [Pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(count)]
    bar = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)
    way = [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(0.95, 0.59, count)]
    for what, simulator, work in (
            ('each by itself', DirectSimulator(wire), poses),
            ('lowered onto a bar, followed', DirectSimulator(wire, obstacles=[bar]), [way])):
        parallel.map(simulator, work)  # compiles, and warms up
        serial, wall, cpu = timed(lambda s=simulator, w=work: parallel.map(s, w))
        print(f'{what}: {count} shapes, load {os.getloadavg()[0]:.1f}: {wall:.2f} s, '
              f'CPU {cpu:.2f} s, {1e3 * cpu / count:.3f} ms a shape')
        for name, make in (('threads', lambda: ThreadPoolExecutor(2)),
                           ('processes', lambda: ProcessPoolExecutor(
                               2, mp_context=get_context('fork')))):
            before = getrusage(RUSAGE_CHILDREN)
            found, two, own = timed(lambda s=simulator, w=work, m=make: parallel.map(s, w, m))
            after = getrusage(RUSAGE_CHILDREN)
            others = (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)
            print(f'  two {name}: {two:.2f} s, {wall / two:.2f} times as fast, CPU {own:.2f} s '
                  f'here and {others:.2f} s in others, same: {found == serial}')


if __name__ == '__main__':
    main()
