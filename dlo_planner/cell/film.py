# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A film of a run. Matplotlib draws it, which needs no display."""

from os import PathLike
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dlo_planner.cell.plant import Plant
from dlo_planner.cell.tasks import Task
from dlo_planner.model.arrays import Floats
from dlo_planner.view.plots import checked_path, write_film

_POINTS = 81     # on the DLO
_EVERY = 0.1     # s between two pictures
_SPEED = 2       # times as fast as the run
_JAW = 0.04      # m, size of the gripper in the picture
_MARGIN = 0.1    # m around what moves


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
