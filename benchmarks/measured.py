# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows that are no plain medians: a slope, an exponent, the start of a process."""

import subprocess
import sys
from time import perf_counter

import numpy as np

from benchmarks import floor
from benchmarks.cases import local, rotations, turned
from benchmarks.timing import Timed, Work, duration, exponent, measure, slope

_SIZES = (64, 128, 256, 512, 1024, 2048, 4096)
_STARTS = 5


def iteration(budget: float) -> Timed:
    """Return what one more Newton iteration costs: the slope of times over counts.

    Of cold solves from the gripper that points down, where nothing is left to do, to the level
    one: no trial is given up, no Hessian shifted. All that a solve costs once drops out.
    """
    simulator = local()
    poses = [turned(angle - 90.0) for angle in np.geomspace(1e-6, 90.0, 30)]
    wire, work, bases = floor.copper_wire(), floor.new_work(64), rotations(poses)

    def of_floor(base):
        work.q[:] = 0.0
        return floor.search(wire, base, work)[2]

    counts = [simulator.solve(pose).iterations for pose in poses]
    floor_counts = [of_floor(base) for base in bases]
    ended, own, ratios = perf_counter() + budget, [], []
    while len(own) < 5 or perf_counter() < ended:
        own.append(slope(counts, [_quickest(lambda p=pose: simulator.solve(p))
                                  for pose in poses]))
        ratios.append(own[-1] / slope(floor_counts, [_quickest(lambda b=base: of_floor(b))
                                                     for base in bases]))
    return Timed(float(np.median(own)), min(own), max(own), {'floor': float(np.median(ratios))},
                 len(own))


def _quickest(call):
    return min(duration(call) for _ in range(5))


def times_by_size(budget: float, basis: str = 'local') -> dict[int, float]:
    """Return number of elements -> s of a cold solve of benchmark A."""
    found = {}
    for n in _SIZES:
        simulator = local(n)
        found[n] = measure([Work(lambda s=simulator: s.solve(turned(0)))], {},
                           budget / len(_SIZES)).least
    return found


def growth(budget: float) -> Timed:
    """Return the exponent with which a cold solve grows with the number of elements."""
    times = times_by_size(budget)
    found = exponent(list(times), list(times.values()))
    return Timed(found, found, found, {}, 1)


def start_of_python(code: str) -> Timed:
    """Return the wall-clock time that a new process takes to run `code`."""
    times = []
    for _ in range(_STARTS + 1):
        started = perf_counter()
        subprocess.run([sys.executable, '-c', code], check=True)
        times.append(perf_counter() - started)
    times = times[1:]  # the first one may compile
    return Timed(float(np.median(times)), min(times), max(times), {}, len(times))
