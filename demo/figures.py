# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The demo's pictures: side views in the x-z plane, as in the paper's Fig. 7 and Fig. 13."""

from typing import NamedTuple

import matplotlib
import numpy as np

matplotlib.use('Agg')
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import pyplot as plt  # noqa: E402  the backend has to be chosen first

from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose

_TICK = 0.05  # m
_SHOWN = 9    # wires drawn in a threading
_LEFT, _RIGHT, _HEIGHT = (-1.05, 1.0), (-1.05, 0.1), (0.35, 1.2)  # m


def save_turning(path: Path, angles: Sequence[float], shapes: Sequence[Floats]) -> None:
    """Save benchmark C: the wire for every gripper angle, on the way there and on the way back.

    Parameters
    ----------
    path : Path
        Path of the PNG.
    angles : sequence of float
        n gripper angles in degrees, up to the largest and back.
    shapes : sequence of ndarray
        n (N + 1, 3) positions, m.
    """
    turn = int(np.argmax(angles)) + 1
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.9), sharex=True, sharey=True,
                                layout='constrained')
    colors = plt.get_cmap('viridis')
    legs = [(slice(0, turn), 'turned up and over'), (slice(turn - 1, None), 'turned back')]
    for axis, (part, title) in zip(axes, legs, strict=True):
        for angle, points in zip(angles[part], shapes[part], strict=True):
            axis.plot(points[:, 0], points[:, 2], color=colors(angle / max(angles)), lw=1.4)
        axis.plot(0, 1, 'ks', ms=7, label='gripper')
        _finish(axis, title)
    axes[0].legend(loc='lower center', fontsize=9)
    bar = plt.cm.ScalarMappable(plt.Normalize(min(angles), max(angles)), colors)
    figure.colorbar(bar, ax=axes, label='gripper angle [deg]')
    figure.suptitle('Benchmark C: copper wire, d = 1 mm, L = 1 m, as received from the node')
    figure.savefig(path, dpi=110)
    plt.close(figure)


def save_threading(path: Path, stiffness: float, goal: Pose, grippers: Sequence[Pose],
                   shapes: Sequence[Floats], inserting: Sequence[Pose]) -> None:
    """Save one row of Fig. 13: left the wire while it is threaded, right the gripper's way.

    Parameters
    ----------
    path : Path
        Path of the PNG.
    stiffness : float
        EI, N m^2.
    goal : Pose
        Pose of the cut-out.
    grippers : sequence of Pose
        The n poses.
    shapes : sequence of ndarray
        n (N + 1, 3) positions, m.
    inserting : sequence of Pose
        Poses of the gripper for the insertion into a bore, on the same wire.
    """
    widths = [high - low for low, high in (_LEFT, _RIGHT)]
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.4), sharey=True, width_ratios=widths,
                                         layout='constrained')
    colors = plt.get_cmap('viridis')
    for number in np.linspace(0, len(shapes) - 1, _SHOWN).round().astype(int):
        points = shapes[number]
        left.plot(points[:, 0], points[:, 2], color=colors(number / len(shapes)), lw=1.4)
        left.plot(*points[0, [0, 2]], 's', color=colors(number / len(shapes)), ms=5)
    _draw_sheet(left, goal)
    _finish(left, 'wire during threading (squares: gripper)')
    right.plot(shapes[0][:, 0], shapes[0][:, 2], color='0.7', lw=4, label='initial shape')
    for poses, color, label in ((inserting, 'tab:blue', 'gripper, insertion into a bore'),
                                 (grippers, 'tab:red', 'gripper, threading')):
        way = np.array([pose.position for pose in poses])
        right.plot(way[:, 0], way[:, 2], color=color, lw=1.2, label=label)
        for pose in poses:
            ends = np.array([pose.position, pose.position + _TICK * pose.direction])
            right.plot(ends[:, 0], ends[:, 2], color=color, lw=0.8)
    _draw_sheet(right, goal)
    _finish(right, 'ways of the gripper (ticks: its direction)')
    right.legend(loc='lower left', fontsize=9)
    # The same window for every stiffness, so that the pictures can be compared.
    left.set(xlim=_LEFT, ylim=_HEIGHT)
    right.set(xlim=_RIGHT)
    right.tick_params(labelleft=True)
    figure.suptitle(f'Threading a wire of 1 m, EI = {1e3 * stiffness:.1f} mN m$^2$')
    figure.savefig(path, dpi=110)
    plt.close(figure)


def save_two(path: Path, goals: Sequence[Pose], grippers: Sequence[Pose],
             shapes: Sequence[Floats]) -> None:
    """Save Fig. 14: the wire while it is threaded through two cut-outs, and the gripper's way.

    Parameters
    ----------
    path : Path
        Path of the PNG.
    goals : sequence of Pose
        Two Poses.
    grippers : sequence of Pose
        The n poses.
    shapes : sequence of ndarray
        n (N + 1, 3) positions, m.
    """
    figure, axis = plt.subplots(figsize=(8, 4.4), layout='constrained')
    colors = plt.get_cmap('viridis')
    for number in np.linspace(0, len(shapes) - 1, _SHOWN).round().astype(int):
        points = shapes[number]
        axis.plot(points[:, 0], points[:, 2], color=colors(number / len(shapes)), lw=1.4)
    way = np.array([pose.position for pose in grippers])
    axis.plot(way[:, 0], way[:, 2], color='tab:red', lw=1.2, label='gripper')
    for goal in goals:
        _draw_sheet(axis, goal)
    _finish(axis, 'Threading through two cut-outs: both centers at once')
    axis.legend(loc='lower left', fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)


class Executed(NamedTuple):
    """A motion as it was executed, at n times.

    Attributes
    ----------
    times : ndarray, shape (n,)
    grippers : sequence of Pose
        The n poses.
    shapes : sequence of ndarray
        n (N + 1, 3) positions, m.
    misses : sequence of float
        n, m, nan before the free end is at the hole.
    """

    times: Floats
    grippers: Sequence[Pose]
    shapes: Sequence[Floats]
    misses: Sequence[float]


def save_moving(path: Path, goal: Pose, tolerance: float, executed: Executed) -> None:
    """Save an executed motion: the wire from the side and from above, speed and miss in time.

    Parameters
    ----------
    path : Path
        Path of the picture.
    goal : Pose
        Pose of the cut-out.
    tolerance : float
        Tolerance in m.
    executed : Executed
        What was measured.
    """
    times, grippers, shapes, misses = executed
    figure, axes = plt.subplots(2, 2, figsize=(12, 6.4), layout='constrained',
                                width_ratios=(1.4, 1))
    colors = plt.get_cmap('viridis')
    way = np.array([pose.position for pose in grippers])
    for axis, (across, name) in zip(axes[:, 0], ((2, 'z'), (1, 'y')), strict=True):
        for number in np.linspace(0, len(shapes) - 1, 2 * _SHOWN).round().astype(int):
            points, color = shapes[number], colors(number / len(shapes))
            axis.plot(points[:, 0], points[:, across], color=color, lw=1.2)
        axis.plot(way[:, 0], way[:, across], color='tab:red', lw=1.2, label='gripper')
        for side in (-1, 1):
            axis.plot([goal.position[0]] * 2, goal.position[across] + side * np.array([0.03, 0.15]),
                      color='k', lw=3)
        _finish(axis, f'wire in motion, from {"the side" if name == "z" else "above"}')
        axis.set_ylabel(f'{name} [m]')
    axes[0, 0].legend(loc='lower left', fontsize=9)
    speeds = np.linalg.norm(np.gradient(way, times, axis=0), axis=1)
    axes[0, 1].plot(times, 1e3 * speeds, color='tab:red')
    axes[0, 1].set(ylabel='gripper [mm/s]', title='How the gripper goes')
    axes[1, 1].plot(times, 1e3 * np.array(misses), label='simulated')
    axes[1, 1].axhline(1e3 * tolerance, color='k', ls='--', lw=1, label='tolerance')
    axes[1, 1].set(ylabel='miss of the center [mm]', title='How calm the wire is', ylim=(0, None))
    axes[1, 1].legend(loc='upper left', fontsize=9)
    for axis in axes[:, 1]:
        axis.set(xlabel='time [s]', xlim=(0, times[-1]))
        axis.grid(alpha=0.3)
    figure.suptitle('From where the gripper is to the hole and through it, as executed')
    figure.savefig(path, dpi=110)
    plt.close(figure)


class Watched(NamedTuple):
    """What a wire did in the cell.

    Attributes
    ----------
    shapes : sequence of ndarray
        n (N + 1, 3) positions in time, m.
    way : ndarray, shape (k, 3)
        Way of the gripper, m.
    worst : ndarray, shape (2,)
        Where the wire passed the hole with the largest miss, in its axes, m: hardly ever in one of
        the shapes, which are seldom taken. Nan: nowhere.
    """

    shapes: Sequence[Floats]
    way: Floats
    worst: Floats


def save_cell(path: Path, hole: CutOut, watched: Watched) -> None:
    """Save what a wire did in the cell: from the side, from above, and in the plane of the hole.

    Parameters
    ----------
    path : Path
        Path of the PNG.
    hole : CutOut
        A round one.
    watched : Watched
    """
    goal, radius, (shapes, way, worst) = hole.pose, hole.radius, watched
    assert radius is not None  # it is round
    figure, axes = plt.subplot_mosaic([['side', 'hole'], ['above', 'hole']], figsize=(12, 6.4),
                                      width_ratios=(1.6, 1), layout='constrained')
    colors, normal = plt.get_cmap('viridis'), goal.direction
    level = np.array([normal[0], normal[1], 0.0]) / np.hypot(*normal[:2])
    aside, up = np.array([-level[1], level[0], 0.0]), np.array([0.0, 0.0, 1.0])
    for name, across, label in (('side', up, 'height'), ('above', aside, 'aside')):
        axis = axes[name]
        for number in np.linspace(0, len(shapes) - 1, 2 * _SHOWN).round().astype(int):
            points = shapes[number] - goal.position
            axis.plot(points @ level, points @ across, color=colors(number / len(shapes)), lw=1.2)
        off = way - goal.position
        axis.plot(off @ level, off @ across, color='tab:red', lw=1.2, label='gripper')
        edge = np.cross(goal.rotation[:, 2] if across is aside else goal.rotation[:, 1], normal)
        for side in (-1, 1):
            ends = np.array([side * 0.02 * edge, side * 0.15 * edge])
            axis.plot(ends @ level, ends @ across, color='k', lw=3)
        axis.set(aspect='equal', xlabel='along the way through, level [m]', ylabel=f'{label} [m]',
                 title=f'wire in the cell, from {"the side" if across is up else name}')
        axis.grid(alpha=0.3)
    axes['side'].legend(loc='lower right', fontsize=9)
    pierced = np.array([one for one in (_pierced(points, goal) for points in shapes)
                        if one is not None]).reshape(-1, 2)
    axis = axes['hole']
    axis.add_patch(plt.Circle((0, 0), 1e3 * radius, fill=False, color='k', lw=3, label='hole'))
    axis.plot(*1e3 * pierced.T, 'o-', ms=4, color='tab:blue', label='where the wire passes')
    axis.plot(*1e3 * worst, 'X', ms=9, color='tab:red',
              label=f'largest miss, {1e3 * np.linalg.norm(worst):.1f} mm')
    axis.set(aspect='equal', xlabel='across [mm]', ylabel='across [mm]',
             xlim=1.3e3 * radius * np.array([-1, 1]), ylim=1.3e3 * radius * np.array([-1, 1]),
             title='in the plane of the hole')
    axis.legend(loc='upper right', fontsize=9)
    axis.grid(alpha=0.3)
    figure.suptitle('A wire that the planner did not know: seen, identified, threaded, corrected')
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _pierced(points: Floats, goal: Pose) -> Floats | None:
    """Return where a DLO passes the plane of a cut-out, (2,) m in its axes, or None."""
    depth = (points - goal.position) @ goal.direction
    if depth[-1] <= 0 or depth.min() >= 0:
        return None
    last = np.flatnonzero(depth[:-1] < 0)[-1]
    share = -depth[last] / (depth[last + 1] - depth[last])
    place = points[last] + share * (points[last + 1] - points[last]) - goal.position
    result: Floats | None = place @ goal.rotation[:, 1:]
    return result


def _draw_sheet(axis: Any, goal: Pose) -> None:
    """Draw the sheet as a line across the normal with a gap where the cut-out is."""
    along = np.array([-goal.direction[2], goal.direction[0]])
    center = goal.position[[0, 2]]
    for side in (-1, 1):
        ends = np.array([center + side * 0.03 * along, center + side * 0.15 * along])
        axis.plot(ends[:, 0], ends[:, 1], color='k', lw=3)


def _finish(axis: Any, title: str) -> None:
    axis.set_aspect('equal')
    axis.set_xlabel('x [m]')
    axis.set_ylabel('z [m]')
    axis.grid(alpha=0.3)
    axis.set_title(title, fontsize=10)
