# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions from pose to pose of a DLO whose far end is held, in the cell's engine, in open loop.

`python test/moves_in_cell.py [tasks] [first seed]` plans and proves each, lets SciPy solve
Kirchhoff's equations between both grips at its waypoints, moves the gripper of the plant, and
prints how far the DLO is there from where it was planned: on the way and at rest at the end.
"""

import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

from references.kirchhoff import true_held_rod  # noqa: E402

from dlo_planner import (  # noqa: E402
    DirectSimulator,
    FarEnd,
    Infeasible,
    InverseSimulator,
    Pose,
    Trajectory,
    replay,
)
from dlo_planner.cell.plant import STEP, Plant  # noqa: E402
from dlo_planner.cell.tasks import RODS  # noqa: E402
from dlo_planner.tasks import MoveTo  # noqa: E402

PERIOD, WAIT = 0.02, 3.0  # s
CELLS = 40
ROUND = 'wire 1.5', 'wire 2'  # the two-point solver knows even sections


def drawn(seed):
    """Return rod, start pose and the task of a seed: two poses, the far end clamped or pinned."""
    rng = np.random.default_rng([seed, 82])
    rod = RODS[ROUND[seed % 2]]
    length = rod.length
    start = Pose.looking_along((0, 0, 1), (1, rng.uniform(-0.3, 0.3), rng.uniform(-0.8, -0.2)))
    far = Pose.looking_along((length * rng.uniform(0.5, 0.8), length * rng.uniform(-0.15, 0.15),
                              1 + length * rng.uniform(-0.1, 0.1)),
                             (1, rng.uniform(-0.3, 0.3), rng.uniform(0.2, 0.8)))
    poses = [Pose.looking_along(start.position + length * rng.uniform(-0.1, 0.1, 3),
                                start.direction + rng.uniform(-0.4, 0.4, 3)) for _ in range(2)]
    return rod, start, MoveTo(poses, FarEnd(far, 'clamped' if seed % 4 < 2 else 'pinned'))


def moved(seed):
    """Return what came of a task: a word, and distances in m."""
    rod, start, task = drawn(seed)
    direct = DirectSimulator(rod, accuracy=1e-4)
    try:
        plan = InverseSimulator(direct).plan(task, start=start)
    except Infeasible as error:
        return f'refused: {error}', {}
    way, report = Trajectory(plan, tolerance=np.inf), replay(direct, plan)
    if not (report.converged and report.deviation < 1e-4):
        return f'not proved: {report!r}', {}
    solver = max(np.linalg.norm(plan.shapes[k].positions - true_held_rod(
        rod, plan.shapes[k], far_pinned=task.far_end.grip == 'pinned'), axis=1).max()
        for k in (0, len(plan) // 2, len(plan) - 1))
    plant = Plant(rod, start, cells=CELLS, step=STEP, damping=0.02, far_end=task.far_end)
    times = PERIOD * np.arange(1, int((way.duration + WAIT) / PERIOD) + 1)
    reached, off, k = way.progress(times), [], 0
    for pose, done in zip(way.poses(times), reached, strict=True):
        plant.move(pose, PERIOD)
        while k < len(plan) and plan.times[k] <= done:
            off.append(away(plant, plan.shapes[k]))
            k += 1
    return 'moved', {'solver': solver, 'on the way': max(off), 'at rest': away(
        plant, plan.shapes[-1]), 'seconds': way.duration}


def away(plant, shape):
    """Return the largest distance of the plant's DLO from a Shape, m."""
    s = np.linspace(0, shape.s[-1], 41)
    return float(np.linalg.norm(plant.points(s) - shape.positions_at(s), axis=1).max())


def main(tasks=20, first=0):
    found = []
    for seed in range(first, first + tasks):
        word, numbers = moved(seed)
        found += [numbers] if numbers else []
        print(seed, word, ', '.join(f'{name} {value:.3g}' for name, value in numbers.items()),
              flush=True)
    print(f'{len(found)} of {tasks} moved; at most, in mm:', *(
        f'{name} {1e3 * max(one[name] for one in found):.2f},' for name in (
            'solver', 'on the way', 'at rest')) if found else ())


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
