# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the shorthands of answers do (`dlo_planner.pictured`): one entry for each kind of value."""

from base64 import b64encode
from collections.abc import Callable
from dataclasses import replace
from html import escape
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DloPlannerError, MissingExtra
from dlo_planner.extras import extra
from dlo_planner.plan.plan import Plan
from dlo_planner.verify.report import ValidationReport
from dlo_planner.view.axes import Frame
from dlo_planner.view.films import film
from dlo_planner.view.plots import plot_motion, plot_plan, plot_shape
from dlo_planner.view.report_plot import plot_report
from dlo_planner.view.summaries import heading, rows_of, text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Drawable = Shape | Plan | Motion | ValidationReport
_PLOTS: dict[type[Any], Callable[..., 'Figure']] = {
    Shape: plot_shape, Plan: plot_plan, Motion: plot_motion, ValidationReport: plot_report}
_THUMBNAIL, _DPI = (4.6, 3.1), 72  # inches


def plot(value: Drawable, **options: Any) -> 'Figure':
    """Return the Figure of a value, see `Pictured.plot` and `Reported.plot`."""
    return _PLOTS[_kind(value)](value, **options)


def animate(value: Plan | Motion, path: str | PathLike[str], **options: Any) -> Path:
    """Write a film of a value, see `Filmed.animate`."""
    return film(value, path, **options)


def summary(value: Drawable) -> str:
    """Return the table of a value as text."""
    return text_table(heading(value), rows_of(value))


def html(value: Drawable) -> str:
    """Return a line and a thumbnail; the line alone where no picture can be made."""
    line = f'<code>{escape(repr(value))}</code>'
    try:
        picture = b64encode(_thumbnail(value)).decode()
    except (DloPlannerError, MissingExtra):
        return f'<div>{line}</div>'
    return (f'<div>{line}<br><img alt="{escape(_kind(value).__name__)}" '
            f'src="data:image/png;base64,{picture}"></div>')


def _thumbnail(value: Drawable) -> bytes:
    """Return the bytes of a PNG."""
    if isinstance(value, ValidationReport):
        figure = extra('matplotlib.figure', 'figures', 'pictures').Figure(
            figsize=_THUMBNAIL, layout='constrained')
        axes = figure.add_subplot()
    else:
        axes = replace(Frame.new(_THUMBNAIL, managed=False), titled=False)
        figure = axes.figure
    plot(value, ax=axes)
    file = BytesIO()
    figure.savefig(file, format='png', dpi=_DPI)
    return file.getvalue()


def _kind(value: Drawable) -> type[Drawable]:
    return next(kind for kind in _PLOTS if isinstance(value, kind))
