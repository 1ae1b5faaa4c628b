# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random columns: straight DLOs that land on their tip, or are pushed on it.

Rods are copper wires, with damping and without, a steel wire, a hose, a cable and a strip; they
hang straight down from a gripper that is tilted by up to 0.01 rad and lowered onto a plane, a bar,
a box or a sphere that the tip touches at the beginning, or is above by up to 0.01 of the length.
The mean speed is drawn from 0.01 to 2 m/s; the way is at most a quarter of the length and at least
what closes the gap, so that the largest speeds are 0.022 to 4.3 m/s. Instants are 0.1 to 5 ms
apart. Of each motion the row that `benchmarks.halved` prints, and at the end how many of each
status there were.

    python -m benchmarks.columns                     64 columns
    python -m benchmarks.columns --first 17 --many 1 one of them
    python -m benchmarks.columns --draw 1            others
    python -m benchmarks.columns --alone             without the finer run
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from time import process_time

import numpy as np

from benchmarks.halved import Case, judge
from benchmarks.moving import gained
from dlo_planner import Box, Capsule, DeadlineExceeded, Plane, Pose, Rod, Sphere
from dlo_planner.model.obstacles import Obstacle

COPPER = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
RODS = {
    'copper wire': COPPER,
    'damped copper wire': replace(COPPER, damping=(0.0, 1e-3)),
    'steel wire': Rod.circular(0.5, 1e-3, 7850, 2e11, 0.3),
    'hose': Rod.circular(0.6, 0.012, 1100, 5e6, 0.45),
    'cable': Rod.circular(0.4, 0.006, 1600, 5e7, 0.4),
    'strip': Rod.rectangular(0.4, 0.02, 0.0005, 7850, 2e11, 0.3),
}
BODIES = 'plane', 'bar', 'box', 'sphere'


def at_random(draw: int, seed: int) -> Case:
    """Return the case of a seed in a draw."""
    rng = np.random.default_rng([4711, draw, seed])
    name = str(rng.choice(list(RODS)))
    rod = RODS[name]
    length, radius = rod.length, float(rod.radius or 0.0)
    tilt = float(rng.choice([0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2]) * rng.choice([-1, 1]))
    dt = float(np.exp(rng.uniform(np.log(1e-4), np.log(5e-3))))
    # (a strip may touch no sphere)
    what = str(rng.choice(BODIES[:-1] if name == 'strip' else BODIES))
    gap = length * float(rng.choice([0.0, 0.0, 1e-5, 1e-3, 1e-2]))
    friction = float(rng.choice([0.0, 0.4]))
    count = int(rng.integers(15, 41))
    speed = float(np.exp(rng.uniform(np.log(0.01), np.log(2.0))))
    way = max(min(speed * dt * (count - 1), 0.25 * length), 1.1 * gap)
    axis = np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    x, _, top = length * axis - (0, 0, gap + radius)
    size = 0.05 * length
    body: Obstacle = Plane((x, 0, top), (0, 0, 1), friction=friction)
    if what == 'bar':
        body = Capsule((x, -length, top - size), (x, length, top - size), size, friction=friction)
    elif what == 'box':
        body = Box(Pose((x, 0, top - size), (0, 0, 0, 1)), (6 * size, 6 * size, 2 * size),
                   friction=friction)
    elif what == 'sphere':
        body = Sphere((x, 0, top - 2 * size), 2 * size, friction=friction)
    t = np.linspace(0, 1, count)
    poses = [Pose.looking_along((0, 0, -z), axis)
             for z in way * (t - np.sin(2 * np.pi * t) / (2 * np.pi))]
    mesh = [{}, {'n_elements': 48, 'basis': 'local'}][int(rng.integers(2))]
    told = (f'{seed:3d} {name} on {what} tilt {tilt:.0e} dt {dt:.1e} gap {gap / length:.0e} L '
            f'way {way / length:.1e} L mu {friction:g}{" 48" if mesh else ""}')
    return Case(told, rod, [body], poses, None, dt, 1e-3 * length, mesh, True, None)


def alone(case: Case, cap: float) -> tuple[str, str]:
    """Return the status of a case, and its row without a finer run."""
    begin = process_time()
    try:
        motion = case.run(cap)
    except DeadlineExceeded:
        return 'late', f'{case.what} not within {cap:g} s'
    seconds = process_time() - begin
    shapes = motion.shapes if motion.status == 'complete' else motion.shapes[:-1]
    end = shapes[-1].positions - shapes[-1].positions[0]
    beside = np.linalg.norm(np.cross(end, case.poses[0].rotation[:, 0]), axis=1).max()
    bear = sum(bool(shape.contacts) for shape in shapes)
    steps = len(motion._estimate.args[2].steps) if motion._estimate else 0
    return motion.status, (
        f'{case.what} {motion.status} {seconds:.1f} s {steps} steps {len(motion)} of '
        f'{len(case.poses)} instants {bear} bear beside {beside / case.rod.length:.1e} L gain '
        f'{gained(motion, case.rod):.1e} work {motion.work.max():.1e} J {motion.message}')


def main() -> None:
    """Print the rows of the columns that are asked for."""
    parser = argparse.ArgumentParser(description='Random columns beside halved steps')
    parser.add_argument('--many', type=int, default=64)
    parser.add_argument('--first', type=int, default=0, help='seed of the first of them')
    parser.add_argument('--draw', type=int, default=0, help='which columns are drawn')
    parser.add_argument('--cap', type=float, default=30.0, help='s of computing for a motion')
    parser.add_argument('--alone', action='store_true', help='no finer runs')
    given = parser.parse_args()
    ends: Counter[str] = Counter()
    for seed in range(given.first, given.first + given.many):
        case = at_random(given.draw, seed)
        status, row = alone(case, given.cap)
        ends[status] += 1
        print(row if given.alone else judge(case, given.cap), flush=True)
    print(dict(ends))


if __name__ == '__main__':
    main()
