# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One second of a moving wire, beside MuJoCo's chain of 40 pieces with steps of 2 ms.

python -m benchmarks.motions

The paper's wire goes aside and down by 0.1 m and back: freely, over a floor that it does not
touch, and onto floors. Both are timed in turns in one process, the motion alone: CPU time, the
least of several. Errors are distances of nodes from what the own engine's meshes and steps lead to
in the limit (ours 160 elements, tolerance 1e-5 m; MuJoCo's by Richardson from 40 and 80 pieces),
and how far these limits are apart is said: contacts of MuJoCo are soft.
"""

from time import process_time

import numpy as np

from benchmarks import report
from benchmarks.cases import level, wire
from dlo_planner import DirectSimulator, Plane
from dlo_planner.cell.plant import Plant

FLOORS = {'free': None, 'floor in reach, never touched': 0.05, 'touching': 0.195}
DAMPING, S = 5e-4, np.linspace(0, 1, 41)
_DT, _STEP = 0.01, 2e-3


def way(time):
    """Return the gripper at a time in s."""
    moved = 0.1 * np.sin(np.pi * time) ** 2
    return level(1.0 - moved, moved)


def ours(height, elements=40, tolerance=None):
    """Return (CPU s, places (101, 41, 3)) of this package."""
    floor = [] if height is None else [Plane((0, 0, height), (0, 0, 1))]
    simulator = DirectSimulator(wire(damping=(0.0, DAMPING)), basis='local', n_elements=elements,
                                obstacles=floor)
    grippers = [way(_DT * k) for k in range(101)]
    start = simulator.solve(grippers[0])
    began = process_time()
    motion = simulator.simulate(grippers, _DT, start, tolerance=tolerance)
    seconds = process_time() - began
    assert motion.converged, motion.message
    return seconds, np.array([shape.positions_at(S) for shape in motion.shapes])


def theirs(height, cells=40, step=_STEP):
    """Return the same of MuJoCo's chain."""
    floor = [] if height is None else [Plane((0, 0, height), (0, 0, 1))]
    plant = Plant(wire(), way(0.0), floor, cells=cells, step=step)
    plant = Plant(wire(), way(0.0), floor, cells=cells, step=step,
                  damping=np.pi * plant.frequencies[0] * DAMPING)
    places, parts, seconds = [plant.points(S)], round(_DT / step), 0.0
    for k in range(100):
        poses = [way(_DT * (k + part / parts)) for part in range(1, parts + 1)]
        began = process_time()
        for pose in poses:
            plant.move(pose, step)
        seconds += process_time() - began
        places.append(plant.points(S))
    return seconds, np.array(places)


def apart(one, other):
    """Return the largest distance of places (k, n, 3), m."""
    return float(np.linalg.norm(one - other, axis=2).max())


def line(name, height):
    """Return the cells of a row."""
    both = [(ours(height), theirs(height)) for _ in range(4)][1:]
    own, other = both[0][0][1], both[0][1][1]
    limit = ours(height, 160, 1e-5)[1]
    finer = theirs(height, 80, _STEP / 2)[1]
    other_limit = finer + (finer - other) / 3
    seconds = [min(pair[which][0] for pair in both) for which in (0, 1)]
    return [name, *(f'{1e3 * one:.0f} ms' for one in seconds), f'{seconds[0] / seconds[1]:.2f}',
            *(f'{1e3 * one:.2f} mm' for one in (apart(own, limit), apart(other, other_limit),
                                                apart(limit, other_limit)))]


def main():
    """Print the table."""
    heads = ['1 s of the wire', 'ours', 'MuJoCo', 'ours / MuJoCo', 'our error', 'its error',
             'limits apart']
    print(report.markdown(heads, [line(*one) for one in FLOORS.items()]))


if __name__ == '__main__':
    main()
