# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a cut-out may be in a cell, so that a wire can be threaded through it.

python examples/capability.py [folder]

A wire of 1.5 mm, a robot beside a machine, 60 cut-outs in walls across the cell. Parts are kept in
the folder: a run that was interrupted goes on where it was.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

import matplotlib
import numpy as np

matplotlib.use('Agg')

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    Box,
    DirectSimulator,
    InverseSimulator,
    Pose,
    Rod,
    Workspace,
    parallel,
)


def cell():
    """Return an InverseSimulator of the cell, and a grid of cut-outs in it."""
    wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
    machine = Box(Pose((0.2, 0.5, 0.4), (0, 0, 0, 1)), (0.4, 0.3, 0.8))
    robot = Workspace((-0.9, -0.6, 0.2), (0.9, 0.6, 1.6), keep_out=[machine], gripper_radius=0.05)
    places = np.stack(np.meshgrid(np.linspace(0.3, 1.2, 5), [-0.3, 0.0],
                                  np.linspace(0.6, 1.3, 3), indexing='ij'), axis=-1)
    directions = [(1, 0, 0), (1, 0, -1)]
    return (InverseSimulator(DirectSimulator(wire, obstacles=[machine]), workspace=robot),
            parallel.CellGrid(places.reshape(-1, 3), directions, [0.02]))


def main():
    """Make the map with two processes and save its pictures."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    inverse, grid = cell()
    starts = [Pose((-0.6, 0.0, 1.0), (0, 0, 0, 1))]

    def processes():
        return ProcessPoolExecutor(2, mp_context=get_context('forkserver'))

    begun = perf_counter()
    found = parallel.capability_map(
        inverse, grid, processes, starts=starts, folder=folder / 'capability', chunk=4,
        progress=lambda done, total: print(f'{done} of {total} cut-outs', end='\r'))
    print(f'{found!r}: {perf_counter() - begun:.1f} s, {found.seconds.sum():.1f} s of work')
    outcomes, counts = np.unique(found.outcome, return_counts=True)
    print(', '.join(f'{outcome} {count}' for outcome, count in zip(outcomes, counts, strict=True)))
    for quantity in ('share', 'stability'):
        picture = found.plot(axis='y', quantity=quantity)
        picture.savefig(folder / f'capability_{quantity}.png', dpi=100)


if __name__ == '__main__':
    main()
