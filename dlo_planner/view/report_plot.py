# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a ValidationReport: distances beside the tolerance, and the gripper's motion."""

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.extras import extra
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.axes import checked_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# name of the attribute -> (what it says, whether it should be small)
_DISTANCES = {
    'position_error': ('position error, at rest', True),
    'deviation': ('deviation from the plan', True),
    'max_tracking_error': ('position error, in motion', True), 'swing': ('swing', True),
    'arrival': ('swing at the arrival', True), 'departure': ('swing after the end', True),
    'clearance': ('clearance, at rest', False),
    'dynamic_clearance': ('clearance, in motion', False),
    'workspace_margin': ('room to the workspace', False)}
_SMALL, _LARGE, _BAD = '#21688e', '#5ec962', '#d81b60'  # two of viridis, and ALERT
_LEAST = 1e-3   # mm, where the scale begins
_INSTANTS = 400
_SIZE, _ALONE = (8.0, 6.2), (8.0, 4.0)  # inches


def plot_report(report: ValidationReport, ax: 'Axes | None' = None) -> 'Figure':
    """Return the Figure of a ValidationReport, see `ValidationReport.plot`.

    Bars of its distances, blue those that should be small, green those that should be large; and,
    in a new figure, the speeds of its trajectory with their limits.
    """
    if ax is not None:
        figure: Figure = checked_axes(ax).figure
        _bars(ax, report)
        return figure
    trajectory = report.trajectory
    figure = extra('matplotlib.pyplot', 'figures', 'pictures').figure(
        figsize=_ALONE if trajectory is None else _SIZE, layout='constrained')
    if trajectory is None:
        _bars(figure.add_subplot(), report)
        return figure
    bars, below = figure.subplots(2, 1, height_ratios=(1.7, 1.0))
    _bars(bars, report)
    speeds(below, trajectory)
    return figure


def _bars(axes: Any, report: ValidationReport) -> None:
    values = {label: (1e3 * getattr(report, name), small)
              for name, (label, small) in _DISTANCES.items()}
    finite = [abs(value) for value, _ in values.values() if np.isfinite(value)]
    most = 10 * max([10 * _LEAST, *finite])
    for row, (value, small) in enumerate(values.values()):
        text, length, color = _bar(value, small, most)
        axes.barh(row, max(length, _LEAST) - _LEAST, left=_LEAST, color=color, height=0.6)
        axes.annotate(text, (max(length, _LEAST), row), (4, 0), textcoords='offset points',
                      va='center', fontsize=8, color='0.55' if np.isnan(value) else '0.1',
                      bbox={'facecolor': 'w', 'edgecolor': 'none', 'alpha': 0.8, 'pad': 0.5})
    axes.set(xscale='log', xlim=(_LEAST, 3 * most), yticks=range(len(values)), xlabel='mm')
    axes.set_yticklabels(list(values), fontsize=8)
    axes.invert_yaxis()
    axes.grid(axis='x', alpha=0.3)
    if np.isfinite(report.tolerance):
        axes.axvline(1e3 * report.tolerance, color='k', ls='--', lw=1,
                     label=f'tolerance in motion, {1e3 * report.tolerance:.3g} mm')
        axes.legend(loc='lower right', fontsize=8)
    label = 'safe to execute' if report.safe else f'not safe: {report.reason}'
    axes.set_title(label, fontsize=10, color='0.1' if report.safe else _BAD, wrap=True)


def _bar(value: float, small: bool, most: float) -> tuple[str, float, str]:
    """Return the text, length and color of a bar of `value` mm."""
    if np.isnan(value):
        return 'not looked at', 0.0, _SMALL
    if np.isinf(value):
        return ('could not be simulated' if small == (value > 0) else 'nothing is near',
                most, _BAD if small == (value > 0) else _LARGE)
    if value < 0:
        return f'{value:.3g} mm: inside', -value, _BAD
    text = f'{value:.3g} mm' if value >= _LEAST else f'below {_LEAST:g} mm'
    return text, value, _SMALL if small else _LARGE


def speeds(axes: Any, trajectory: Trajectory) -> None:
    """Draw the speeds of a Trajectory, and their limits where these are near."""
    times = np.linspace(0.0, trajectory.duration, _INSTANTS)
    linear, angular = np.linalg.norm(trajectory.at(times)[1].reshape(-1, 2, 3), axis=2).T
    other = axes.twinx()
    for one, values, limit, color, scale, label in (
            (axes, linear, trajectory.limits.linear_speed, '#21688e', 1e3, 'speed [mm/s]'),
            (other, angular, trajectory.limits.angular_speed, '#b35806', 180 / np.pi,
             'turning [deg/s]')):
        one.plot(times, scale * values, color=color, lw=1.4)
        one.set_ylabel(label, color=color)
        most = scale * max(float(values.max()), 1e-9)
        if np.isfinite(limit) and scale * limit < 4 * most:
            one.axhline(scale * limit, color=color, ls=':', lw=1.2)
            most = max(most, scale * limit)
        one.set_ylim(0.0, 1.1 * most)
    axes.set(xlabel='time [s]', xlim=(0.0, trajectory.duration),
             title='gripper (dotted: limits of speed)')
    axes.title.set_fontsize(10)
    axes.grid(alpha=0.3)
