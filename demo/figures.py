# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The demo's pictures: side views in the x-z plane, as in the paper's Fig. 7, 13 and 14."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose

_TICK = 0.05  # m
_SHOWN = 9    # wires drawn in a threading
_EDGE = 0.16  # m, from the middle of the hole to beyond the sheet that is drawn
_HOLE = 3.4       # inches: the picture of a hole
_WIDE, _TALL, _AROUND = 5.0, 6.8, 1.0  # inches: the largest picture of a cell, and labels around it
_COLORS = mpl.colormaps['viridis']


def save_turning(path: Path, angles: Sequence[float], shapes: Sequence[Floats]) -> None:
    """Save benchmark C: the wire (N + 1, 3) m at each gripper angle, up and on the way back."""
    turn = int(np.argmax(angles)) + 1
    figure = Figure(figsize=(11, 3.9), layout='constrained')
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    legs = [(slice(0, turn), 'turned up and over'), (slice(turn - 1, None), 'turned back')]
    for axis, (part, title) in zip(axes, legs, strict=True):
        for angle, points in zip(angles[part], shapes[part], strict=True):
            axis.plot(points[:, 0], points[:, 2], color=_COLORS(angle / max(angles)), lw=1.4)
        axis.plot(0, 1, 'ks', ms=7, label='gripper')
        _finish(axis, title)
    axes[0].legend(loc='lower center', fontsize=9)
    bar = mpl.cm.ScalarMappable(mpl.colors.Normalize(min(angles), max(angles)), _COLORS)
    figure.colorbar(bar, ax=axes, label='gripper angle [deg]')
    figure.suptitle('Benchmark C: copper wire, d = 1 mm, L = 1 m, as received from the node')
    figure.savefig(path, dpi=110)


def save_threading(path: Path, title: str, goals: Sequence[Pose], grippers: Sequence[Pose],
                   shapes: Sequence[Floats], inserting: Sequence[Pose] = ()) -> None:
    """Save a threading: left the wire (N + 1, 3) m, right the gripper's way.

    Beside it, where it is given, its way for the insertion into a bore.
    """
    seen = np.concatenate([*shapes, *(goal.position + _EDGE * np.array([[0, 0, 1], [0, 0, -1]])
                                      for goal in goals)])
    x, z = _span(seen[:, 0]), _span(seen[:, 2])
    tall = _WIDE * (z[1] - z[0]) / (x[1] - x[0])
    figure = Figure(figsize=(2 * (_WIDE + _AROUND), tall + 1.5 * _AROUND), layout='constrained')
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    left.set(xlim=x, ylim=z)
    for number in np.linspace(0, len(shapes) - 1, _SHOWN).round().astype(int):
        points, color = shapes[number], _COLORS(number / len(shapes))
        left.plot(points[:, 0], points[:, 2], color=color, lw=1.4)
        left.plot(*points[0, [0, 2]], 's', color=color, ms=5)
    right.plot(shapes[0][:, 0], shapes[0][:, 2], color='0.7', lw=4, label='initial shape')
    for poses, color, label in ((inserting, 'tab:blue', 'gripper, insertion into a bore'),
                                (grippers, 'tab:red', 'gripper, threading')):
        if poses:
            way = np.array([pose.position for pose in poses])
            right.plot(way[:, 0], way[:, 2], color=color, lw=1.2, label=label)
            ticks = way + _TICK * np.array([pose.direction for pose in poses])
            right.plot(*np.stack([way, ticks])[..., [0, 2]].transpose(2, 0, 1), color=color, lw=0.8)
    for axis, text in ((left, 'wire while it is threaded (squares: gripper)'),
                       (right, 'path of the gripper (ticks: its direction)')):
        for goal in goals:
            across = np.array([-goal.direction[2], goal.direction[0]])
            _gap(axis, goal.position[[0, 2]], across, 0.03)
        _finish(axis, text)
    right.legend(loc='lower right', fontsize=8)  # where no gripper comes
    figure.suptitle(title)
    figure.savefig(path, dpi=110)


def save_cell(path: Path, hole: CutOut, shapes: Sequence[Floats], way: Floats, worst: Floats,
              promised: float) -> None:
    """Save what a wire did in the cell: from the side, from above, and in the plane of the hole.

    Shapes: shapes (N + 1, 3), the gripper's path `way` (k, 3), m; worst (2,) where the largest miss
    was, m by the hole's axes: hardly ever in one of the shapes, which are seldom taken. `promised`
    is what it was expected to be at most, m.
    """
    goal, radius = hole.pose, 1e3 * float(hole.radius or 0.0)
    level = np.array([*goal.direction[:2], 0.0]) / np.hypot(*goal.direction[:2])
    views = {'side': (np.array([0.0, 0.0, 1.0]), goal.rotation[:, 2], 'height above the hole [m]'),
             'above': (np.array([-level[1], level[0], 0.0]), goal.rotation[:, 1], 'aside [m]')}
    places = np.concatenate([*shapes, way]) - goal.position
    along = _span(places @ level)
    across = {name: _span(np.append(places @ up, [-_EDGE, _EDGE]))
              for name, (up, _, _) in views.items()}
    # both views have one scale: the figure is as large as they are
    scale = min(_WIDE / (along[1] - along[0]), _TALL / (across['side'][1] - across['side'][0]))
    wide = scale * (along[1] - along[0])
    tall = {name: scale * (span[1] - span[0]) for name, span in across.items()}
    right = max(wide, _HOLE)
    figure = Figure(figsize=(wide + right + 2 * _AROUND,
                             max(tall['side'], _HOLE + tall['above'] + 1.3 * _AROUND) + _AROUND),
                    layout='constrained')
    axes = figure.subplot_mosaic([['side', 'hole'], ['side', 'above']],
                                 width_ratios=(wide, right),
                                 height_ratios=(_HOLE, tall['above'] + 0.3 * _AROUND))
    for name, (up, edge, label) in views.items():
        axis = axes[name]
        for number in np.linspace(0, len(shapes) - 1, 2 * _SHOWN).round().astype(int):
            points = shapes[number] - goal.position
            axis.plot(points @ level, points @ up, color=_COLORS(number / len(shapes)), lw=1.2)
        off = way - goal.position
        axis.plot(off @ level, off @ up, color='tab:red', lw=1.2, label='gripper')
        _gap(axis, np.zeros(2), np.array([edge @ level, edge @ up]), 0.02)
        axis.set(aspect='equal', xlim=along, ylim=across[name], ylabel=label,
                 xlabel='horizontal distance from the hole [m]')
        axis.set_title('from the side' if name == 'side' else 'from above', fontsize=10)
        axis.grid(alpha=0.3)
    axes['side'].legend(loc='lower left', fontsize=9)
    pierced = np.array([one for one in (_pierced(points, goal) for points in shapes)
                        if one is not None]).reshape(-1, 2)
    axis = axes['hole']
    axis.add_patch(Circle((0, 0), radius, fill=False, color='k', lw=3, label='rim of the hole'))
    axis.add_patch(Circle((0, 0), 1e3 * promised, fill=False, color='tab:green', ls='--',
                          label=f'bound of the miss: {1e3 * promised:.1f} mm (95 %)'))
    axis.plot(*1e3 * pierced.T, 'o', ms=3, color='tab:blue', label='axis of the wire')
    axis.plot(*1e3 * worst, 'X', ms=8, color='tab:red',
              label=f'largest miss: {1e3 * np.linalg.norm(worst):.1f} mm')
    axis.set(aspect='equal', xlabel='across, horizontal [mm]', ylabel='across, upright [mm]',
             xlim=(-1.2 * radius, 1.2 * radius), ylim=(-1.2 * radius, 1.2 * radius))
    axis.set_title('in the plane of the hole', fontsize=10)
    axis.legend(loc='lower center', bbox_to_anchor=(0.5, 0.12), fontsize=8, frameon=False)
    axis.grid(alpha=0.3)
    figure.suptitle('A wire that the planner did not know: seen, identified, threaded, corrected\n'
                    '(dark: early, bright: late)', fontsize=11)
    figure.savefig(path, dpi=110)


def _span(values: Floats) -> tuple[float, float]:
    """Return the least and the largest value, a little apart from them."""
    room = 0.05 * float(np.ptp(values))
    return float(values.min()) - room, float(values.max()) + room


def _pierced(points: Floats, goal: Pose) -> Floats | None:
    """Return where a DLO passes the plane of a cut-out, (2,) m in its axes, or None."""
    depth = (points - goal.position) @ goal.direction
    if depth[-1] <= 0 or depth.min() >= 0:
        return None
    last = np.flatnonzero(depth[:-1] < 0)[-1]
    share = -depth[last] / (depth[last + 1] - depth[last])
    place = points[last] + share * (points[last + 1] - points[last]) - goal.position
    result: Floats = place @ goal.rotation[:, 1:]
    return result


def _gap(axis: Any, center: Floats, along: Floats, radius: float) -> None:
    """Draw a sheet as a line with a gap where the cut-out is."""
    for side in (-1, 1):
        ends = np.array([center + side * radius * along, center + side * 0.15 * along])
        axis.plot(ends[:, 0], ends[:, 1], color='k', lw=3)


def _finish(axis: Any, title: str) -> None:
    axis.set(aspect='equal', xlabel='x [m]', ylabel='z [m]')
    axis.grid(alpha=0.3)
    axis.set_title(title, fontsize=10)
