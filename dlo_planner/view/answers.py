# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tables and pictures of what was found out: fits, estimates, robustness, many shapes, motions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.extras import extra
from dlo_planner.identify.estimate import Estimate
from dlo_planner.identify.fitting import Fit
from dlo_planner.model.arrays import Floats
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.robustness import Robustness
from dlo_planner.view.axes import Frame, box_around, checked_axes
from dlo_planner.view.colors import VERMILION, viridis
from dlo_planner.view.drawing import draw
from dlo_planner.view.item import Item
from dlo_planner.view.report_plot import speeds
from dlo_planner.view.summaries import Row, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE = (8.0, 4.0)  # inches
_MOST = 25          # shapes that are drawn
_BLUE = '#21688e'
_PART = 0.95        # of the samples


def fit_rows(fit: Fit) -> list[Row]:
    """Return the rows of a Fit: each number with its standard deviation."""
    numbers, spread = (_flat(values) for values in (fit.values, fit.deviations))
    return [('converged', 'yes' if fit.converged else 'no', ''),
            ('misfit', figure(fit.misfit), 'm'), ('noise', figure(fit.noise), 'm'),
            *(_deviating(*row) for row in zip(fit.names, numbers, spread, strict=True))]


def estimate_rows(estimate: Estimate) -> list[Row]:
    """Return the rows of an Estimate; logarithms of factors, 1/m, rad, m."""
    return [('looks', str(estimate.looks), ''),
            ('last look could be used', 'yes' if estimate.converged else 'no', ''),
            ('misfit', figure(estimate.misfit), 'm'),
            ('outliers', figure(estimate.outliers), ''),
            ('surprise', figure(estimate.surprise), ''),
            *(_deviating(name, value, estimate.deviations[name])
              for name, value in estimate.values.items())]


def robustness_rows(robust: Robustness) -> list[Row]:
    """Return the rows of a Robustness: the worst of all waypoints."""
    rows = [('waypoints', str(robust.first_order.size), ''),
            ('miss by all, root mean square', figure(robust.first_order.max(initial=0)), 'm'),
            *((f'miss by {name.replace("_", " ")}', figure(values.max(initial=0)), 'm')
              for name, values in zip(robust.causes, robust.by_cause.T, strict=True)),
            ('samples', str(len(robust.sampled)), '')]
    if len(robust.sampled):
        rows.append((f'miss of {_PART:.0%} of them', figure(robust.quantile(_PART).max()), 'm'))
    return [*rows, ('part of them that gets through', figure(robust.success), '')]


def trajectory_rows(trajectory: Trajectory) -> list[Row]:
    """Return the rows of a Trajectory: what it keeps, and what the DLO does in it."""
    times = np.linspace(0.0, trajectory.duration, 1000)
    _, velocities, accelerations = trajectory.at(times)
    rows = [('status', trajectory.status, ''), ('duration', figure(trajectory.duration), 's'),
            ('legs between stops', str(len(trajectory.path.legs)), '')]
    for name, values, unit in (('speed', velocities, 's'), ('acceleration', accelerations, 's^2')):
        for kind, part, first in (('linear', values[:, :3], 'm'),
                                  ('angular', values[:, 3:], 'rad')):
            limit = getattr(trajectory.limits, f'{kind}_{name}')
            most = np.linalg.norm(part, axis=1).max()
            rows.append((f'{kind} {name}, largest and limit',
                         f'{figure(most)} of {figure(limit)}', f'{first}/{unit}'))
    if trajectory.motion is not None:
        rows += [('miss in motion', figure(trajectory.motion.position_error), 'm'),
                 ('clearance in motion', figure(trajectory.motion.clearance), 'm'),
                 ('swing', figure(trajectory.motion.swing), 'm')]
    return [*rows, ('tolerance', figure(trajectory.tolerance), 'm'),
            ('frequencies may be off by', figure(trajectory.mode_margin), '')]


def map_rows(capability: Any) -> list[Row]:
    """Return the rows of a CapabilityMap: how often there was which outcome."""
    outcomes, counts = np.unique(capability.outcome, return_counts=True)
    return [(str(outcome) or 'not looked at', str(count), 'cut-outs')
            for outcome, count in zip(outcomes, counts, strict=True)]


def shapes_rows(shapes: Any) -> list[Row]:
    """Return the rows of Shapes: the worst of all."""
    rows = [('shapes', str(len(shapes)), ''), ('converged', str(int(shapes.converged.sum())), ''),
            ('jumped', str(int(shapes.jumped.sum())), ''),
            ('contacts', str(len(shapes.contact_table)), '')]
    if not len(shapes):
        return rows
    force, moment = np.linalg.norm(shapes.gripper_wrench.reshape(-1, 2, 3), axis=2).max(axis=0)
    return [*rows, ('residual, largest', figure(shapes.residual.max()), ''),
            ('stability, least', figure(shapes.stability.min()), ''),
            ('gripper bears at most, force', figure(force), 'N'),
            ('gripper bears at most, moment', figure(moment), 'N m')]


def plot_fit(fit: Fit, ax: Axes | None = None) -> Figure:
    """Return the Figure of a Fit: how exactly each number is known, as a part of it."""
    numbers, spread = _flat(fit.values), _flat(fit.deviations)
    parts = np.where(numbers == 0, np.inf, spread / np.abs(np.where(numbers == 0, 1.0, numbers)))
    return _bars(ax, fit.names, 100 * parts, [_said(*row) for row in zip(
        numbers, spread, strict=True)], 'standard deviation [% of the value]')


def plot_estimate(estimate: Estimate, ax: Axes | None = None) -> Figure:
    """Return the Figure of an Estimate: how much of what was uncertain still is."""
    numbers, spread = _flat(estimate.values), _flat(estimate.deviations)
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
        axes.plot(waypoints, 1e3 * robust.quantile(_PART), 'k:', lw=2,
                  label=f'{_PART:.0%} of {len(robust.sampled)} samples')
    axes.set(xlabel='waypoint', ylabel='miss [mm]', ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return _figure(axes)


def plot_trajectory(trajectory: Trajectory, ax: Axes | None = None) -> Figure:
    """Return the Figure of a Trajectory: the gripper's speeds beside their limits."""
    axes = _axes(ax)
    speeds(axes, trajectory)
    return _figure(axes)


def plot_shapes(shapes: Any, ax: Axes | None = None) -> Figure:
    """Return the Figure of Shapes: some of them, dark the first, bright the last."""
    chosen = np.unique(np.linspace(0, len(shapes) - 1, min(len(shapes), _MOST)).astype(int))
    lines = [shapes.positions[k] for k in chosen] if len(shapes) else []
    points = np.concatenate(lines or [np.zeros((1, 3))])
    frame = Frame.of(ax, points)
    tints = viridis(chosen / max(len(shapes) - 1, 1))
    way = [] if len(lines) < 2 else [Item('way', 0, 'line', VERMILION, points=[
        line[0] for line in lines])]
    draw(frame.axes, [*(Item('dlo', k, 'line', tint, points=line) for k, (line, tint) in enumerate(
        zip(lines, tints, strict=True))), *way], frame.side)
    frame.show(*box_around(points))
    frame.color_bar(float(max(len(shapes) - 1, 1)), 'shape')
    frame.title(repr(shapes))
    figure_: Figure = frame.figure
    return figure_


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
    return _figure(axes)


def _axes(ax: Axes | None) -> Any:
    """Return the Axes that were given, or those of a new figure."""
    if ax is not None:
        return checked_axes(ax)
    return extra('matplotlib.pyplot', 'figures', 'pictures').figure(
        figsize=_SIZE, layout='constrained').add_subplot()


def _figure(axes: Any) -> Figure:
    found: Figure = axes.figure
    return found


def _flat(values: dict[str, Any]) -> Floats:
    return np.concatenate([np.ravel(one).astype(float) for one in values.values()])


def _said(number: float, deviation: float) -> str:
    return (f'{figure(number)} +- {deviation:.2g}' if np.isfinite(deviation)
            else f'{figure(number)}, not told by the observations')


def _deviating(name: str, number: float, deviation: float) -> Row:
    return name, figure(number), (f'+- {deviation:.2g}' if np.isfinite(deviation)
                                  else 'not told by the observations')
