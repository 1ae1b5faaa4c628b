# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Both engines' shapes on each other, to one scale."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from benchmarks.cross.scenes import STATIC
from benchmarks.figures._drawing import held, side, views
from dlo_planner import Capsule, Plane, Sheet, Sphere

if TYPE_CHECKING:
    from benchmarks.cross_check import Compared

_AT_ONCE = 6  # instants of a motion in a picture
_GRAY = {'color': '0.6', 'zorder': 0}


def draw(folder: Path, found: Sequence['Compared']) -> None:
    """Draw one picture for each kind of scene, `cross_check_<kind>.png`."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind in dict.fromkeys(one.scene.kind for one in found):
        some = [one for one in found if one.scene.kind == kind]
        columns = min(3, len(some))
        rows = -(-len(some) // columns)
        figure, axes = views(rows, columns, (4.6, 4.0))
        for axis, one in zip(axes.flat, some, strict=False):
            _shapes(axis, one)
        for axis in list(axes.flat)[len(some):]:
            axis.remove()
        figure.legend(*axes.flat[0].get_legend_handles_labels(), loc='outside lower center',
                      ncols=2, fontsize=8)  # beside the shapes, some of which fill their axes
        what = {STATIC: 'Wires that hang freely'}.get(kind, f'Scenes in {kind}')
        figure.suptitle(f'{what}: this package (lines), limit of MuJoCo\'s chains (dots), seen '
                        'along y', fontsize=10)
        figure.savefig(folder / f'cross_check_{kind}.png', dpi=90)
        plt.close(figure)


def _shapes(axis: Axes, one: 'Compared') -> None:
    """Draw the shapes of a scene at a few instants."""
    for obstacle in one.scene.obstacles:
        _obstacle(axis, obstacle)
    instants = np.unique(np.linspace(0, len(one.package) - 1, _AT_ONCE).astype(int))
    for k in instants:
        label = k == instants[0]
        side(axis, one.package[k], color='C0', label='dlo_planner' if label else None)
        side(axis, one.chain[k], color='C3', ls='', marker='.', ms=3.5,
             label='MuJoCo' if label else None)
        at_rest = len(one.package) == 1
        held(axis, one.scene.way(one.scene.seconds if at_rest else k * one.scene.interval))
    axis.set_title(f'{one.scene.name}: {1e3 * one.apart:.2g} mm apart', fontsize=8)


def _obstacle(axis: Axes, obstacle: Plane | Sphere | Capsule | Sheet) -> None:
    """Draw an obstacle as a section at y = 0."""
    if isinstance(obstacle, Plane):
        axis.axhline(obstacle.point[2], **_GRAY)
    elif isinstance(obstacle, Sheet):
        hole = obstacle.cutouts[0]
        up, half = hole.pose.rotation[:, 2], hole.radius or 0.5 * hole.height
        for end in (-1, 1):
            edges = hole.center + end * np.outer((half, 0.5 * obstacle.height), up)
            axis.plot(edges[:, 0], edges[:, 2], lw=2, **_GRAY)
    else:
        center = obstacle.center if isinstance(obstacle, Sphere) else obstacle.start
        axis.add_patch(Circle((center[0], center[2]), obstacle.radius, **_GRAY))
