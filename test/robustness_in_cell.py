# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Compares the share of tasks that `robustness` predicts to pass with what passes in the cell.

python test/robustness_in_cell.py 24 5 12

One wire task per radius in mm: so many runs in open loop, of one motion, each with properties of
its own that are drawn from the same spread. A run passes if the DLO is threaded without a touch.
"""

import sys
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent.parent)]

from benchmarks.cell.drivers import OpenLoop, sampled, ways  # noqa: E402
from benchmarks.cell.run import run  # noqa: E402
from dlo_planner import DirectSimulator, Trajectory, Uncertainty, robustness  # noqa: E402
from dlo_planner.cell.tasks import draw_task  # noqa: E402
from dlo_planner.cell.truth import Unknowns  # noqa: E402
from dlo_planner.tasks import concatenate  # noqa: E402

TASK, SAMPLES, SIGMAS = 0, 400, 1.96
RADIUS = 5  # mm, of a hole for this spread; for wider holes it is in proportion
SPREAD = Uncertainty(bending_stiffness=5e-3, torsional_stiffness=5e-3, mass=2e-3,
                natural_curvature=5e-3, gripper_position=0.5e-3, gripper_rotation=1e-3)


def unknown(spread):
    """Return the same as the cell takes it."""
    return Unknowns(spread.bending_stiffness, spread.mass,
                    natural_curvature=(spread.natural_curvature,),
                    gripper_position=spread.gripper_position,
                    gripper_rotation=spread.gripper_rotation)


def wider(known, factor):
    return Uncertainty(**{item.name: factor * getattr(known, item.name) for item in fields(known)})


def interval(passed, count):
    """Return the bounds of a share with 95 % (Wilson 1927), of `passed` out of `count`."""
    share, z = passed / count, SIGMAS**2 / count
    half = SIGMAS * np.sqrt(share * (1 - share) / count + z / (4 * count))
    return (share + z / 2 - half) / (1 + z), (share + z / 2 + half) / (1 + z)


def _known(poses, _):
    return poses


def main(count, radii):
    for radius in radii:
        task = draw_task(TASK, 'wire 1.5', 1e-3 * radius)
        start, through = ways(task)
        motion = Trajectory(concatenate(start, through))
        spread = wider(SPREAD, radius / RADIUS)
        predicted = robustness(DirectSimulator(task.rod), through, spread, samples=SAMPLES, seed=1)
        driver = OpenLoop(partial(_known, sampled(motion)))
        outcomes = [run(task, driver, seed=seed, unknowns=unknown(spread))
                    for seed in range(count)]
        passed = sum(one.threaded and not one.touched for one in outcomes)
        low, high = interval(passed, count)
        print(f'radius {radius:g} mm: predicted {predicted.success:.3f} (the motion misses by '
              f'{1e3 * motion.motion.position_error:.2f} mm); in the cell {passed} of {count}, '
              f'{passed / count:.3f} ({low:.3f} to {high:.3f} with 95 %), '
              f'{motion.duration:.1f} s each', flush=True)


if __name__ == '__main__':
    main(int(sys.argv[1]), [float(one) for one in sys.argv[2:]])
