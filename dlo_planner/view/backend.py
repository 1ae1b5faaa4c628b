# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the shorthands of answers do (`dlo_planner.pictured`): one entry for each kind of value."""

from base64 import b64encode
from collections.abc import Callable
from dataclasses import replace
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError, MissingExtra
from dlo_planner.model.value import Value
from dlo_planner.plan.plan import Plan
from dlo_planner.view import charts
from dlo_planner.view.mpl import Frame, matplotlib
from dlo_planner.view.plots import film, plot_over_time, plot_shape
from dlo_planner.view.summary import heading, kind_of, rows_of, text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PLOTS: dict[str, Callable[..., 'Figure']] = {
    'Shape': plot_shape, 'SectionForces': charts.plot_section_forces, 'Plan': plot_over_time,
    'Motion': plot_over_time,
    'ValidationReport': charts.plot_report, 'Fit': charts.plot_fit,
    'Estimate': charts.plot_estimate, 'Robustness': charts.plot_robustness,
    'Trajectory': charts.plot_trajectory, 'Shapes': charts.plot_shapes}
_THUMBNAIL, _DPI = (4.6, 3.1), 72  # inches
plot_map = charts.plot_map  # see `CapabilityMap.plot`
plot_grasps = charts.plot_grasps  # see `GraspMap.plot`
animate = film  # see `Filmed.animate`


def plot(value: Value, **options: Any) -> 'Figure':
    """Return the Figure of a value, see `Pictured.plot` and `Reported.plot`."""
    return _PLOTS[kind_of(value, _PLOTS)](value, **options)


def summary(value: Value) -> str:
    """Return the table of a value as text."""
    return text_table(heading(value), rows_of(value))


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
        figure = matplotlib('.figure').Figure(
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
