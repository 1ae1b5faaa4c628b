# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random cables held at both ends: `python test/random_holds.py [poses] [with SciPy: 0 or 1]`.

For each weight and torsion: how many converge, CPU time from the natural shape and for a small
step, and with SciPy the distance from its solution of the Kirchhoff equations (`accuracy=1e-3`).
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent / 'direct'), str(Path(__file__).parent.parent)]
from kirchhoff import true_held_rod  # noqa: E402
from test_held import cable, poses  # noqa: E402

from dlo_planner import Capsule, DirectSimulator, Pose  # noqa: E402

PEG = Capsule((0.4, -1, -0.25), (0.4, 1, -0.25), 0.05)


def timed(compute):
    """Return what `compute` returns, and its CPU time in ms."""
    begin = time.process_time()
    found = compute()
    return found, 1e3 * (time.process_time() - begin)


def table(count, load, torsion, basis, obstacles):
    """Print a row: converged, median and maximum of the times."""
    direct = DirectSimulator(cable(load, torsion), basis=basis, obstacles=obstacles)
    gripper, end = next(iter(poses(1)))
    direct.solve(gripper, direct.solve(gripper, far_end=end), far_end=end)  # compiled
    cold, warm, good, touching = [], [], [0, 0], 0
    for gripper, end in poses(count):
        shape, spent = timed(lambda g=gripper, e=end: direct.solve(g, far_end=e))
        cold.append(spent)
        moved = Pose(end.position + np.array([0.002, 0.001, 0]), end.quaternion)
        again, spent = timed(lambda g=gripper, s=shape, e=moved: direct.solve(g, s, far_end=e))
        warm.append(spent)
        good[0] += shape.converged
        good[1] += again.converged
        touching += len(shape.contacts) > 0
    print(f'{load:8.0f} {torsion or "":8} {basis:10} {"peg" if obstacles else "":4}'
          f' converged {good[0]}, {good[1]} of {count}; ms {np.median(cold):.1f} (max '
          f'{max(cold):.1f}), step {np.median(warm):.1f} (max {max(warm):.1f}); {touching} touch',
          flush=True)


def against_scipy(count, load):
    """Print the largest distance from SciPy's solution."""
    rod = cable(load)
    direct = DirectSimulator(rod, accuracy=1e-3)
    for gripper, end in poses(count):
        shape = direct.solve(gripper, far_end=end)
        off = np.abs(true_held_rod(rod, shape) - shape.positions).max()
        print(f'{load:8.0f} {len(shape.element_strains)} elements, converged {shape.converged}, '
              f'estimate {shape.error_estimate:.1e}, off {off:.1e} m', flush=True)


if __name__ == '__main__':
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 24
    for load in (1e3, 3.5e3, 1e4, 1e5):
        for basis in ('local', 'chebyshev'):
            for obstacles in ((), (PEG,)):
                table(count, load, None, basis, obstacles)
    for load in (1.0, 1e3, 1e5):
        table(count, load, 1e-4, 'local', ())
    if len(sys.argv) > 2 and int(sys.argv[2]):
        for load in (1e3, 1e4):
            against_scipy(4, load)
