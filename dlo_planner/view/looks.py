# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the shorthands of answers do (`dlo_planner.pictured`): one entry for each kind of value."""

from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import replace
from html import escape
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError, MissingExtra
from dlo_planner.extras import extra
from dlo_planner.model.value import Value
from dlo_planner.plan.plan import Plan
from dlo_planner.view import answers
from dlo_planner.view.axes import Frame
from dlo_planner.view.films import film
from dlo_planner.view.plots import plot_motion, plot_plan, plot_shape
from dlo_planner.view.report_plot import plot_report
from dlo_planner.view.summaries import Row, heading, rows_of, text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# By the names of classes: those of `parallel` stand beside this room.
_PLOTS: dict[str, Callable[..., 'Figure']] = {
    'Shape': plot_shape, 'Plan': plot_plan, 'Motion': plot_motion,
    'ValidationReport': plot_report, 'Fit': answers.plot_fit, 'Estimate': answers.plot_estimate,
    'Robustness': answers.plot_robustness, 'Trajectory': answers.plot_trajectory,
    'Shapes': answers.plot_shapes}
_ROWS: dict[str, Callable[[Any], list[Row]]] = {
    'Shape': rows_of, 'Plan': rows_of, 'Motion': rows_of, 'ValidationReport': rows_of,
    'Fit': answers.fit_rows, 'Estimate': answers.estimate_rows,
    'Robustness': answers.robustness_rows, 'Trajectory': answers.trajectory_rows,
    'CapabilityMap': answers.map_rows, 'Shapes': answers.shapes_rows}
_THUMBNAIL, _DPI = (4.6, 3.1), 72  # inches


def plot(value: Value, **options: Any) -> 'Figure':
    """Return the Figure of a value, see `Pictured.plot` and `Reported.plot`."""
    return _PLOTS[_kind(value, _PLOTS)](value, **options)


def animate(value: Plan | Motion, path: str | PathLike[str], **options: Any) -> Path:
    """Write a film of a value, see `Filmed.animate`."""
    return film(value, path, **options)


def summary(value: Value) -> str:
    """Return the table of a value as text."""
    return text_table(heading(value), _ROWS[_kind(value, _ROWS)](value))


def html(value: Value) -> str:
    """Return a line and a thumbnail; the line alone where no picture can be made."""
    line = f'<code>{escape(repr(value))}</code>'
    try:
        picture = b64encode(_thumbnail(value)).decode()
    except (DloPlannerError, MissingExtra, KeyError):  # KeyError: has no picture of this size
        return f'<div>{line}</div>'
    return (f'<div>{line}<br><img alt="{escape(type(value).__name__)}" '
            f'src="data:image/png;base64,{picture}"></div>')


def _thumbnail(value: Any) -> bytes:
    """Return the bytes of a PNG."""
    if not isinstance(value, Shape | Plan | Motion):
        figure = extra('matplotlib.figure', 'figures', 'pictures').Figure(
            figsize=_THUMBNAIL, layout='constrained')
        axes = figure.add_subplot()
    else:
        shapes = (value,) if isinstance(value, Shape) else value.shapes
        points = np.concatenate([shape.positions for shape in shapes] or [np.zeros((1, 3))])
        axes = replace(Frame.new(points, _THUMBNAIL[0], managed=False), titled=False)
        figure = axes.figure
    plot(value, ax=axes)
    file = BytesIO()
    figure.savefig(file, format='png', dpi=_DPI)
    return file.getvalue()


def _kind(value: Value, known: Mapping[str, object]) -> str:
    return next((cls.__name__ for cls in type(value).__mro__ if cls.__name__ in known), '')
