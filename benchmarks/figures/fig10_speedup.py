# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 10: how much independent computation gains from more workers."""

import os
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from time import perf_counter

import numpy as np

from benchmarks.cases import chebyshev, random_poses
from benchmarks.figures._drawing import axes, run, save
from dlo_planner import parallel

_POSES, _TURNS = 2000, 15
_SPELL, _SPELLS = 0.5, 8  # s in which work is counted, and how often


def pools(workers):
    """Return name -> executor of as many workers."""
    return {'threads': ThreadPoolExecutor(workers),
            'processes': ProcessPoolExecutor(workers, mp_context=get_context('forkserver'))}


def speedup(simulator, poses, executor):
    """Return how much quicker all poses are with workers, the median of turns; and the serial s.

    The speed of a machine changes: each turn compares a run without workers and one with them.
    """
    parallel.map(simulator, poses, executor)  # starts the workers
    ratios, serial = [], []
    for _ in range(_TURNS):
        started = perf_counter()
        parallel.map(simulator, poses)
        between = perf_counter()
        parallel.map(simulator, poses, executor)
        serial.append(between - started)
        ratios.append(serial[-1] / (perf_counter() - between))
    return float(np.median(ratios)), float(np.median(serial))


def counted(seconds):
    """Return how often per second this process computes 64 shapes; workers call it."""
    simulator, poses = chebyshev(), random_poses(64)
    parallel.map(simulator, poses)
    begun, rounds = perf_counter(), 0
    while perf_counter() - begun < seconds:
        parallel.map(simulator, poses)
        rounds += 1
    return rounds / (perf_counter() - begun)


def of_machine(workers):
    """Return how much more processes that share nothing compute than one: what can be gained."""
    ratios = []
    with ProcessPoolExecutor(workers, mp_context=get_context('forkserver')) as pool:
        list(pool.map(counted, [_SPELL] * workers))  # starts the workers
        for _ in range(_SPELLS):
            alone = pool.submit(counted, _SPELL).result()
            ratios.append(sum(pool.map(counted, [_SPELL] * workers)) / alone)
    return float(np.median(ratios))


def main(folder):
    """Make table and picture."""
    simulator, poses = chebyshev(), random_poses(_POSES)
    counts = sorted({1, 2, os.cpu_count() or 1} & set(range(1, (os.cpu_count() or 1) + 1)))
    found, alone = {'threads': {}, 'processes': {}, 'unconnected': {}}, np.nan
    for count in counts:
        for name, executor in pools(count).items():
            with executor:
                found[name][count], alone = speedup(simulator, poses, executor)
        found['unconnected'][count] = of_machine(count)
    figure, (axis,) = axes()
    axis.plot([1, max(counts)], [1, max(counts)], 'k:', lw=1, label='linear')
    for name, row in found.items():
        axis.plot(list(row), list(row.values()), 'o-', label=name)
    axis.set_xlabel('workers $N_p$')
    axis.set_ylabel('speedup over one without workers')
    axis.set_xticks(counts)
    axis.set_ylim(0, None)
    axis.legend(fontsize=8)
    lines = [[str(count), *(f'{row[count]:.2f}' for row in found.values())] for count in counts]
    save(figure, folder, 'fig10', f'Fig. 10: speedup of {_POSES} independent shapes',
         ['workers', *found], lines, {'serial_s': alone, **found})


if __name__ == '__main__':
    run(main)
