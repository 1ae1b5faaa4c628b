# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures beside what they may be: reports, fits, estimates, robustness, motions, shapes, maps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.section_forces import SectionForces
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.fit import Fit
from dlo_planner.model.arrays import Floats
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.report import ValidationReport
from dlo_planner.verify.robustness import Robustness
from dlo_planner.view.colors import VERMILION, viridis
from dlo_planner.view.mpl import (
    SIDES,
    Frame,
    azimuth,
    box_around,
    checked_axes,
    draw,
    matplotlib,
    side_of,
)
from dlo_planner.view.primitives import Primitive
from dlo_planner.view.summary import PART, figure, flat, unit_of

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
_BLUE, _GREEN, _BAD, _BROWN = '#21688e', '#5ec962', '#d81b60', '#b35806'
_LEAST = 1e-3   # mm, where the scale begins
_INSTANTS = 400
_REPORT_SIZE, _SIZE = (8.0, 6.2), (8.0, 4.0)  # inches
_MOST = 25      # shapes that are drawn
_SLICES = 12    # of a map
_ALIKE = 1e-6   # m: positions in one slice


def plot_report(report: ValidationReport, ax: Axes | None = None) -> Figure:
    """Return the Figure of `ValidationReport.plot`: blue what should be small, green what large."""
    trajectory = report.trajectory
    if ax is not None or trajectory is None:
        axes = _axes(ax)
        _report_bars(axes, report)
        return axes.figure
    figure: Figure = matplotlib('.pyplot').figure(figsize=_REPORT_SIZE, layout='constrained')
    bars, below = figure.subplots(2, 1, height_ratios=(1.7, 1.0))
    _report_bars(bars, report)
    speeds(below, trajectory)
    return figure


def _report_bars(axes: Any, report: ValidationReport) -> None:
    values = {label: (1e3 * getattr(report, name), small)
              for name, (label, small) in _DISTANCES.items()}
    said = [1e3 * report.tolerance, *(abs(value) for value, _ in values.values())]
    most = max([10 * _LEAST, *(one for one in said if np.isfinite(one))])
    for row, (value, small) in enumerate(values.values()):
        text, length, color = _bar(value, small)
        axes.barh(row, max(length, _LEAST) - _LEAST, left=_LEAST, color=color, height=0.6)
        axes.annotate(text, (max(length, _LEAST), row), (4, 0), textcoords='offset points',
                      va='center', fontsize=8, color='0.1' if length > 0 else '0.45',
                      bbox={'facecolor': 'w', 'edgecolor': 'none', 'pad': 0.5})
    # a text beside the longest bar ends within the axes: it is a third of their width at most
    decades = 1.5 * np.log10(most / _LEAST)
    axes.set(xscale='log', xlim=(_LEAST, _LEAST * 10**decades), yticks=range(len(values)),
             xlabel='distance [mm]', ylim=(len(values) - 0.4, -0.6))
    axes.set_yticklabels(list(values), fontsize=8)
    axes.grid(axis='x', alpha=0.3)
    if np.isfinite(report.tolerance):
        row = [*_DISTANCES].index('max_tracking_error')  # of the motion: what it is the limit of
        at = 1e3 * report.tolerance
        axes.plot([at, at], [row - 0.45, row + 0.45], color='k', ls='--', lw=1.2)
        axes.annotate(f'tolerance {at:.3g} mm', (at, row - 0.5), (4, 0), fontsize=8,
                      textcoords='offset points', va='center')
    label = 'safe to execute' if report.safe else f'not safe: {report.reason}'
    axes.set_title(label, fontsize=10, color='0.1' if report.safe else _BAD, wrap=True)


def _bar(value: float, small: bool) -> tuple[str, float, str]:
    """Return the text, length and color of a bar of `value` mm; no bar of what is no number."""
    if np.isnan(value):
        return 'not looked at', 0.0, _BLUE
    if np.isinf(value):
        return ('could not be simulated' if small == (value > 0) else 'nothing is near'), 0.0, _BLUE
    if value < 0:
        return f'{value:.3g} mm: inside', -value, _BAD
    text = f'{value:.3g} mm' if value >= _LEAST else f'below {_LEAST:g} mm'
    return text, value, _BLUE if small else _GREEN


def speeds(axes: Any, trajectory: Trajectory) -> None:
    """Draw the speeds of a Trajectory, and their limits where these are near."""
    times = np.linspace(0.0, trajectory.duration, _INSTANTS)
    linear, angular = np.linalg.norm(trajectory.at(times)[1].reshape(-1, 2, 3), axis=2).T
    other = axes.twinx()
    for one, values, limit, color, scale, label in (
            (axes, linear, trajectory.limits.linear_speed, _BLUE, 1e3, 'speed [mm/s]'),
            (other, angular, trajectory.limits.angular_speed, _BROWN, 180 / np.pi,
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


_DIAGRAMS_SIZE = (8.0, 5.4)  # inches


def plot_section_forces(inside: SectionForces, ax: Axes | None = None) -> Figure:
    """Return the Figure of SectionForces along the DLO; in axes that are given, tension alone."""
    lines = (('tension [N]', {'': inside.tension}),
             ('shear [N]', {'along n': inside.shear[:, 0], 'along b': inside.shear[:, 1]}),
             ('moment [N m]', {'torque': inside.torque, 'bending about n': inside.moment[:, 1],
                               'bending about b': inside.moment[:, 2]}))
    if ax is not None:
        places = [checked_axes(ax)]
    else:
        places = matplotlib('.pyplot').figure(
            figsize=_DIAGRAMS_SIZE, layout='constrained').subplots(3, 1, sharex=True)
    for axes, (label, values) in zip(places, lines, strict=False):
        axes.axhline(0.0, color='0.6', lw=0.8)
        for (name, one), color in zip(values.items(), (_BLUE, _BROWN, _GREEN), strict=False):
            axes.plot(inside.s, one, color=color, lw=1.4, label=name)
        most = max(float(np.abs(one).max()) for one in values.values())
        if most < _NO_FORCE:
            axes.set_ylim(-1.0, 1.0)  # else the picture is one of rounding errors
        axes.set(ylabel=label, xlim=(0.0, inside.s[-1]))
        axes.grid(alpha=0.3)
        if len(values) > 1:
            axes.legend(fontsize=8, loc='best')
    places[-1].set_xlabel('s, from the gripper [m]')
    return places[0].figure


_NO_FORCE = 1e-12  # N, N m


_FIT_SIZE = (10.0, 4.2)  # inches
_SHOWN_PART = 1e-4  # of the value: what is known better is drawn there


def plot_fit(fit: Fit, ax: Axes | None = None) -> Figure:
    """Return the Figure of a Fit: the DLO found among the points, how exactly each number is known.

    In axes that are given, the numbers alone.
    """
    if ax is not None or not fit.observed:
        return _fit_numbers(_axes(ax), fit)
    figure = matplotlib('.pyplot').figure(figsize=_FIT_SIZE, layout='constrained')
    points = np.concatenate([*fit.observed, *fit.found])
    side = side_of(np.concatenate(fit.found))  # noise of the points has no side
    places = figure.add_subplot(1, 2, 1, projection=None if side else '3d')
    frame = Frame(figure, places, side=side or SIDES['x'])
    tints = viridis(np.linspace(0.0, 0.85, len(fit.found)))
    draw(places, [one for k, (seen, line, tint) in enumerate(zip(
        fit.observed, fit.found, tints, strict=True)) for one in (
            Primitive('observed', k, 'points', tint, points=seen),
            Primitive('found', k, 'line', VERMILION, points=line))], frame.side)
    frame.look(azimuth(points))
    frame.show(*box_around(points))
    places.set_title('points seen, and the DLO found (lines), which is off them by '
                     f'{1e3 * fit.misfit:.3g} mm', fontsize=10, wrap=True)
    return _fit_numbers(figure.add_subplot(1, 2, 2), fit)


def _fit_numbers(axes: Any, fit: Fit) -> Figure:
    """Draw the standard deviation of each number as a part of it, and write both beside it."""
    numbers, spread = flat(fit.values), flat(fit.deviations)
    with np.errstate(divide='ignore', invalid='ignore'):
        parts = np.where(numbers == 0.0, np.inf, spread / np.abs(numbers))
    known = np.isfinite(parts)
    shown = np.maximum(parts, _SHOWN_PART)
    most = max(1.0, float(shown[known].max(initial=0.0)))
    rows = np.arange(len(fit.names))
    axes.hlines(rows[known], _SHOWN_PART, shown[known], color=_BLUE, lw=2)
    axes.plot(shown[known], rows[known], 'o', color=_BLUE, ms=5)
    for row, name in enumerate(fit.names):
        unit = unit_of(name)
        text = (f'{figure(numbers[row])} ± {spread[row]:.2g} {unit}' if np.isfinite(spread[row])
                else f'{figure(numbers[row])} {unit}, not resolvable from the observations')
        axes.annotate(text, (_SHOWN_PART, row), (4, 7), textcoords='offset points', fontsize=8)
    axes.set(yticks=rows, xscale='log', xlim=(_SHOWN_PART, 3 * most), ylim=(len(rows) - 0.4, -0.6),
             xlabel='standard deviation / value')
    axes.set_yticklabels([name.replace('_', ' ') for name in fit.names], fontsize=8)
    axes.grid(axis='x', alpha=0.3)
    result: Figure = axes.figure
    return result


def plot_estimate(estimate: Estimate, ax: Axes | None = None) -> Figure:
    """Return the Figure of an Estimate: how much of what was uncertain still is."""
    numbers, spread = flat(estimate.values), flat(estimate.deviations)
    return _bars(ax, estimate.names, 100 * spread / estimate.uncertain.deviations, [
        _said(*row) for row in zip(numbers, spread, strict=True)],
                 'standard deviation [% of that before the first look]')


def plot_robustness(robust: Robustness, ax: Axes | None = None) -> Figure:
    """Return the Figure of a Robustness: misses along the plan, by cause and together."""
    axes = _axes(ax)
    waypoints = np.arange(1, robust.first_order.size + 1)
    for name, values in zip(robust.causes, robust.by_cause.T, strict=True):
        if values.any():
            axes.plot(waypoints, 1e3 * values, lw=1.2, label=name.replace('_', ' '))
    axes.plot(waypoints, 1e3 * robust.first_order, 'k', lw=2, label='all, root mean square')
    if len(robust.sampled):
        axes.plot(waypoints, 1e3 * robust.quantile(PART), 'k:', lw=2,
                  label=f'{PART:.0%} of {len(robust.sampled)} samples')
    axes.set(xlabel='waypoint', ylabel='miss [mm]', ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return axes.figure


def plot_trajectory(trajectory: Trajectory, ax: Axes | None = None) -> Figure:
    """Return the Figure of a Trajectory: the gripper's speeds beside their limits."""
    axes = _axes(ax)
    speeds(axes, trajectory)
    return axes.figure


def plot_shapes(shapes: Any, ax: Axes | None = None) -> Figure:
    """Return the Figure of Shapes: some of them, dark the first, bright the last."""
    chosen = np.unique(np.linspace(0, len(shapes) - 1, min(len(shapes), _MOST)).astype(int))
    lines = [shapes.positions[k] for k in chosen] if len(shapes) else []
    points = np.concatenate(lines or [np.zeros((1, 3))])
    frame = Frame.of(ax, points)
    tints = viridis(chosen / max(len(shapes) - 1, 1))
    drawn = [Primitive('dlo', k, 'line', tint, points=line)
             for k, (line, tint) in enumerate(zip(lines, tints, strict=True))]
    if len(lines) > 1:
        grippers = [line[0] for line in lines]
        drawn.append(Primitive('way', 0, 'line', VERMILION, points=grippers))
    draw(frame.axes, drawn, frame.side)
    frame.show(*box_around(points))
    frame.color_bar(float(max(len(shapes) - 1, 1)), 'shape')
    frame.title(repr(shapes))
    return frame.figure


def _bars(ax: Axes | None, names: tuple[str, ...], values: Floats, texts: list[str],
          label: str) -> Figure:
    axes = _axes(ax)
    known = np.isfinite(values)
    most = max(float(values[known].max(initial=0.0)), 1e-9)
    rows = range(len(names))
    axes.barh(rows, np.where(known, values, 1.5 * most),
              color=[_BLUE if one else '0.85' for one in known], height=0.6)
    for row, (one, text) in enumerate(zip(known, texts, strict=True)):
        axes.annotate(text, (values[row] if one else 0.0, row), (4, 0),
                      textcoords='offset points', va='center', fontsize=8)
    axes.set(yticks=list(rows), xlabel=label, xlim=(0, 1.5 * most))
    axes.set_yticklabels([name.replace('_', ' ') for name in names], fontsize=8)
    axes.invert_yaxis()
    axes.grid(axis='x', alpha=0.3)
    return axes.figure


def _axes(ax: Axes | None) -> Any:
    """Return the Axes that were given, or those of a new figure."""
    if ax is not None:
        return checked_axes(ax)
    return matplotlib('.pyplot').figure(
        figsize=_SIZE, layout='constrained').add_subplot()


def _said(number: float, deviation: float) -> str:
    return (f'{figure(number)} +- {deviation:.2g}' if np.isfinite(deviation)
            else f'{figure(number)}, not resolvable from the observations')


def plot_map(capability: Any, across: int, quantity: str, label: str) -> Figure:
    """Return the Figure of a CapabilityMap, see `CapabilityMap.plot`; `across`: which axis."""
    first, second = (k for k in range(3) if k != across)
    places = capability.grid.positions
    levels = np.unique(np.round(places[:, across] / _ALIKE)) * _ALIKE
    levels = levels[np.unique(np.linspace(
        0, levels.size - 1, min(levels.size, _SLICES)).astype(int))]
    values, known = _best(capability, quantity), (capability.outcome != '').any(axis=(1, 2))
    low, high = 0.0, 1.0
    if quantity != 'share' and np.isfinite(values).any():
        low, high = np.nanmin(values), np.nanmax(values)
    columns = min(levels.size, 4)
    figure: Figure = matplotlib('.figure').Figure(
        figsize=(1.5 + 3.2 * columns, 1.5 + 3.0 * -(-levels.size // columns)),
        layout='constrained')
    axes = figure.subplots(-(-levels.size // columns), columns, squeeze=False, sharex=True,
                           sharey=True).ravel()
    for axis_, level in zip(axes, levels, strict=False):
        in_slice = np.abs(places[:, across] - level) <= _ALIKE
        some = in_slice & np.isfinite(values)
        drawn = axis_.scatter(*places[some][:, [first, second]].T, c=values[some], s=60,
                              vmin=low, vmax=max(high, low + 1e-12), cmap='viridis', marker='s')
        empty, unknown = in_slice & known & ~some, in_slice & ~known
        axis_.plot(*places[empty][:, [first, second]].T, 'x', color='tab:red', ms=5)
        axis_.plot(*places[unknown][:, [first, second]].T, '.', color='0.7', ms=3)
        axis_.set(title=f'{"xyz"[across]} = {level:.3g} m', aspect='equal',
                  xlabel=f'{"xyz"[first]} [m]', ylabel=f'{"xyz"[second]} [m]')
        axis_.grid(alpha=0.3)
    for axis_ in axes[levels.size:]:
        axis_.set_visible(False)
    figure.colorbar(drawn, ax=list(axes[:levels.size]), label=label)
    figure.suptitle(repr(capability), fontsize=10)
    return figure


def plot_grasps(found: Any) -> Figure:
    """Return the Figure of a GraspMap, see `GraspMap.plot`."""
    rows, columns = found.outcome.shape
    figure: Figure = matplotlib('.figure').Figure(
        figsize=(3.0 + 1.4 * columns, 1.5 + 0.5 * rows), layout='constrained')
    axes = figure.add_subplot()
    drawn = axes.imshow(np.where(found.planned, found.margin, np.nan), cmap='viridis', vmin=0.0,
                        aspect='auto', origin='lower')
    for (g, f), outcome in np.ndenumerate(found.outcome):
        if not found.planned[g, f]:
            axes.text(f, g, outcome or 'not looked at', ha='center', va='center', fontsize=8)
    if found.best is not None:
        axes.plot(*found.best[::-1], '*', color='tab:red', ms=12)
    held = [f'{one:.3g} m' if isinstance(one, float) else f'{k}'
            for k, one in enumerate(found.grasps)]
    axes.set(xticks=range(columns), yticks=range(rows), yticklabels=held, xlabel='far end',
             ylabel='grasp')
    figure.colorbar(drawn, ax=axes, label='margin')
    figure.suptitle(repr(found), fontsize=9)
    return figure


def _best(capability: Any, quantity: str) -> Floats:
    """Return (P,) the quantity of a picture at each position; nan where nothing can be threaded."""
    threaded = capability.threaded
    some = threaded.any(axis=(1, 2))
    if quantity == 'share':
        return np.where(some, threaded.mean(axis=(1, 2)), np.nan)
    if quantity == 'radius':
        return np.where(some, capability.least_radius.min(axis=1), np.nan)
    values = np.where(threaded, getattr(capability, quantity), -np.inf).max(axis=(1, 2))
    return np.where(some, values, np.nan)
