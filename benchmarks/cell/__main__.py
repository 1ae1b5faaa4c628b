# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs tasks in the cell, prints the table, and writes it with a film of one.

python -m benchmarks.cell --tasks 20 --output cell_output
"""

import argparse
import json
import sys
from argparse import ArgumentParser
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.cell.drivers import Looking, OpenLoop, planned
from benchmarks.cell.run import run
from benchmarks.cell_trust import said, table
from dlo_planner.cell.cases import UNKNOWNS
from dlo_planner.cell.plant import STEP, Plant
from dlo_planner.cell.tasks import RODS, Task, draw_task
from dlo_planner.model.arrays import Floats
from dlo_planner.view.plots import checked_path, write_film

_POINTS = 81     # on the DLO
_EVERY = 0.1     # s between two pictures
_SPEED = 2       # times as fast as the run
_JAW = 0.04      # m, size of the gripper in the picture
_MARGIN = 0.1    # m around what moves


def main(args: list[str] | None = None) -> int:
    """Run it; return 0."""
    options = _parser().parse_args(args)
    options.output.mkdir(parents=True, exist_ok=True)
    radius = None if options.radius is None else 1e-3 * options.radius
    tasks = [draw_task(options.seed + k, options.dlo, radius) for k in range(options.tasks)]
    unknowns, camera = UNKNOWNS[options.unknown]
    open_loop = options.loop == 'open' or options.loop is None and options.unknown == 'nothing'
    settings = {'unknowns': unknowns, 'camera': None if open_loop else camera,
                'damping': options.damping, 'step': options.step}
    print(f'{len(tasks)} tasks, some seconds each', flush=True)
    driver = OpenLoop(planned) if open_loop else Looking.knowing(unknowns, camera)
    # a fresh start: a fork could take over locks of threads that it has not
    with ProcessPoolExecutor(options.workers, get_context('spawn')) as executor:
        works = [executor.submit(run, task, driver, seed=seed, **settings)
                 for seed, task in enumerate(tasks)]
        outcomes = [work.result() for work in works]
    found = [{'case': task.name, 'seed': seed, 'happened': False, 'cpu_s': 0.0, 'error': '',
              **said(outcome)} for seed, (task, outcome) in enumerate(
                  zip(tasks, outcomes, strict=True))]
    print(table(found))
    (options.output / 'cell.jsonl').write_text(''.join(json.dumps(one) + '\n' for one in found))
    shown = max((k for k, one in enumerate(outcomes) if not one.refused), default=None,
                key=lambda k: outcomes[k].threaded)
    if shown is not None and options.film:
        film = Film()
        run(tasks[shown], driver, seed=shown, watch=film, **settings)
        film.save(options.output / 'cell.gif', tasks[shown])
    print(f'Written to {options.output}: '
          f'{", ".join(sorted(path.name for path in options.output.glob("cell.*")))}')
    return 0


def _parser() -> ArgumentParser:
    parser = argparse.ArgumentParser(prog='python -m benchmarks.cell', description=__doc__)
    parser.add_argument('--tasks', type=int, default=20)
    parser.add_argument('--seed', type=int, default=0, help='of the first task')
    parser.add_argument('--dlo', choices=list(RODS), help='default: all in turn')
    parser.add_argument('--radius', type=float, help='of the holes in mm; default: 4 to 20')
    parser.add_argument('--unknown', choices=list(UNKNOWNS), default='nothing',
                        help='how much the planner does not know (default: %(default)s)')
    parser.add_argument('--loop', choices=['open', 'closed'],
                        help='whether the driver looks (default: where something is unknown)')
    parser.add_argument('--damping', type=float, default=0.005, help='ratio (default: %(default)s)')
    parser.add_argument('--step', type=float, default=STEP,
                        help='of the plant in s; shorter ones allow less damping (default: '
                             '%(default)s)')
    parser.add_argument('--workers', type=int, default=2, help='processes (default: %(default)s)')
    parser.add_argument('--no-film', dest='film', action='store_false')
    parser.add_argument('--output', type=Path, default=Path('cell_output'),
                        help='folder (default: %(default)s)')
    return parser


class Film:
    """Takes pictures of a Plant; give it to `run` as `watch`."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._curves: list[Floats] = []
        self._grippers: list[Floats] = []
        self._forces: list[float] = []

    def __call__(self, plant: Plant) -> None:
        """Take a picture if the last one is 0.1 s old."""
        if self._times and plant.time < self._times[-1] + _EVERY - 1e-9:
            return
        self._times.append(plant.time)
        self._curves.append(plant.points(np.linspace(0, plant.length, _POINTS)))
        self._grippers.append(plant.measured.matrix)
        self._forces.append(plant.largest_forces.max(initial=0.0))

    def save(self, path: str | PathLike[str], task: Task) -> None:
        """Write the GIF or MP4: from the side and from above, the hole's normal to the right."""
        axes = self._axes(task)
        curves = (np.array(self._curves) - task.cutout.center) @ axes.T
        figure = Figure(figsize=(6.4, 5.6), layout='constrained')
        panels = figure.subplots(2, 1)
        lines = [self._panel(panel, task, curves, k) for k, panel in zip((2, 1), panels,
                                                                        strict=True)]

        def draw(number: int) -> None:
            for k, (line, jaw) in zip((2, 1), lines, strict=True):
                line.set_data(curves[number][:, 0], curves[number][:, k])
                matrix = self._grippers[number]
                jaws = matrix[:3, 3] + _JAW * np.array([-1, 0])[:, None] * matrix[:3, 0]
                jaw.set_data(*((jaws - task.cutout.center) @ axes[[0, k]].T).T)
            panels[0].set_title(f'{task.name}, hole of {2e3 * task.radius:.1f} mm: '
                                f'{self._times[number]:.1f} s, force so far '
                                f'{self._forces[number]:.2g} N', fontsize=10)

        write_film(figure, draw, len(curves), checked_path(path), rate=round(_SPEED / _EVERY))

    @staticmethod
    def _axes(task: Task) -> Floats:
        """Return rows: along the normal in the plane, across it, up (3, 3)."""
        along = task.cutout.normal * (1, 1, 0)
        along = along / np.linalg.norm(along)
        return np.array([along, np.cross((0, 0, 1), along), (0, 0, 1)])

    def _panel(self, panel: Any, task: Task, curves: Floats, k: int) -> tuple[Any, Any]:
        """Draw what stands still; return the lines of the DLO and of the gripper."""
        axes = self._axes(task)
        sheet = task.sheet
        # as the axes of the hole that is best seen in this view
        across = task.cutout.pose.rotation[:, 2 if k == 2 else 1]
        for side in (-1, 1):
            ends = side * np.array([task.radius, 0.5 * sheet.height])[:, None] * across
            panel.plot(*(ends @ axes[[0, k]].T).T, color='k', lw=3)
        low, high = curves.min(axis=(0, 1)), curves.max(axis=(0, 1))
        panel.set(aspect='equal', xlim=(low[0] - _MARGIN, high[0] + _MARGIN),
                  ylim=(min(low[k], -0.2) - _MARGIN, max(high[k], 0.2) + _MARGIN),
                  xlabel='along the way through the hole [m]',
                  ylabel='up [m]' if k == 2 else 'across [m]')
        panel.grid(alpha=0.3)
        jaw, = panel.plot([], [], color='tab:red', lw=5, solid_capstyle='butt')
        line, = panel.plot([], [], color='tab:blue', lw=2)
        return line, jaw


if __name__ == '__main__':
    sys.exit(main())
