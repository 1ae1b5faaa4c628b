# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random cables held at both ends, slack to nearly taut: `python test/random_holds.py [poses]`.

For each weight and torsion: how many converge, CPU time from the natural shape and for a small
step. SciPy judges those that hang freely: its boundary value solver on the Kirchhoff equations
finds an equilibrium next to the answer, within ten times the error estimate, or it is wrong.
"""

import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent / 'direct'), str(Path(__file__).parent.parent)]
from kirchhoff import true_held_rod  # noqa: E402
from test_held import cable, poses  # noqa: E402

from dlo_planner import Capsule, DirectSimulator, Pose  # noqa: E402

PEG = Capsule((0.4, -1, -0.25), (0.4, 1, -0.25), 0.05)
SPANS = {'slack': (0.65, 0.95), 'tight': (0.95, 0.99), 'taut': (0.99, 0.999)}  # of the length


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


def verdict(rod, shape):
    """Return 'right', 'refused' or 'wrong', and the error over the error estimate."""
    if not shape.converged:
        return 'refused', 0.0
    try:
        true = true_held_rod(rod, shape, tol=1e-6)
    except AssertionError:
        return 'wrong', np.inf
    share = np.linalg.norm(true - shape.positions, axis=1).max() / shape.error_estimate
    return ('right' if share < 10 else 'wrong'), share


def against_scipy(count, name):
    """Print how many of some spans are right, and how large errors are."""
    said, largest = Counter(), 0.0
    for load in (30.0, 1e3, 1e4, 1e5):
        rod = cable(load)
        direct = DirectSimulator(rod, accuracy=1e-3)
        for gripper, end in poses(count, spans=SPANS[name]):
            what, share = verdict(rod, direct.solve(gripper, far_end=end))
            said[what] += 1
            largest = max(largest, share)
    low, high = SPANS[name]
    print(f'{name}, span {low} to {high}: {said["right"]} right, {said["refused"]} refused '
          f'({100 * said["refused"] / said.total():.0f} %), {said["wrong"]} wrong; error / '
          f'estimate at most {largest:.2f}', flush=True)


if __name__ == '__main__':
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 24
    for name in SPANS:
        against_scipy(2 * count, name)
    for load in (1e3, 3.5e3, 1e4, 1e5):
        for basis in ('local', 'chebyshev'):
            for obstacles in ((), (PEG,)):
                table(count, load, None, basis, obstacles)
    for load in (1.0, 1e3, 1e5):
        table(count, load, 1e-4, 'local', ())
