# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Matplotlib axes for pictures of DLOs: in space or from the side, equal, in meters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.view.colors import ALERT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE = (0, 2)          # x and z: what is seen from the side
_SIZE = (8.0, 5.6)     # inches
_ELEVATION = 18.0      # degrees above the level, from where space is seen
_TURNED = 25.0         # degrees beside the direction in which least is hidden
_LEAST = 0.3           # of the largest extent: the others are shown no smaller
_MARGIN = 0.04         # of the largest extent
_TICKS = 5
_GRID = {'grid.color': '0.88', 'grid.linewidth': 0.6}
_HALF = 0.42           # of the figure's width: half the side of the square that space is drawn in
_MIDDLE = (0.42, 0.47)             # of the figure: where its middle is
_BAR = (0.86, 0.2, 0.018, 0.56)    # left, bottom, width, height of the color bar
_ROOM, _ROOM_ALONE = 0.76, (0.66, 0.70)  # of the axes given; of the figure: for what is seen
_UNIT = 1.03           # of its axes: a diagonal of the box without zoom


@dataclass(frozen=True)
class Frame:
    """Axes to draw in.

    Attributes
    ----------
    figure, axes : object
        Figure and axes of matplotlib.
    bar : object
        Axes of the color bar, None: it is taken from `axes`.
    titled : bool
        Whether it has a title and a legend.
    """

    figure: Any
    axes: Any
    bar: Any = None
    titled: bool = True

    @classmethod
    def new(cls, size: tuple[float, float] = _SIZE, managed: bool = True) -> 'Frame':
        """Return axes in space that fill a new figure.

        Parameters
        ----------
        size : (float, float), optional
            Inches.
        managed : bool, optional
            By pyplot, so that `pyplot.show()` shows it; else it is gone with its last use.
        """
        if managed:
            figure = extra('matplotlib.pyplot', 'figures', 'pictures').figure(figsize=size)
        else:
            figure = extra('matplotlib.figure', 'figures', 'pictures').Figure(figsize=size)
        tall = _HALF * size[0] / size[1]
        square = (_MIDDLE[0] - _HALF, _MIDDLE[1] - tall, 2 * _HALF, 2 * tall)
        with extra('matplotlib', 'figures', 'pictures').rc_context(_GRID):
            axes = figure.add_axes(square, projection='3d')
        axes.patch.set_visible(False)
        return cls(figure, axes, figure.add_axes(_BAR))

    @classmethod
    def of(cls, ax: 'Axes | Frame | None') -> 'Frame':
        """Return the Frame of an argument: a new one for None.

        Raises
        ------
        InvalidTask
            It is not an Axes of matplotlib.
        """
        if ax is None:
            return cls.new()
        if isinstance(ax, Frame):
            return ax
        if not isinstance(ax, extra('matplotlib.axes', 'figures', 'pictures').Axes):
            raise InvalidTask(f'ax = {shown(ax)}: expected Axes of matplotlib')
        return cls(ax.figure, ax)

    @property
    def space(self) -> bool:
        """Whether the axes have three dimensions."""
        return bool(self.axes.name == '3d')

    def show(self, low: Floats, high: Floats) -> None:
        """Show the box between two corners (3,) in m, with equal scales and units."""
        axes = self.axes
        if not self.space:
            axes.set(xlabel='x [m]', ylabel='z [m]')
            axes.update_datalim(np.array([low, high])[:, SIDE])
            axes.autoscale_view()
            axes.set_aspect('equal', adjustable='datalim')
            axes.grid(alpha=0.3)
            return
        axes.set(xlabel='x [m]', ylabel='y [m]', zlabel='z [m]', xlim=(low[0], high[0]),
                 ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        sizes = (high - low) / np.linalg.norm(high - low)
        for axis, size in zip((axes.xaxis, axes.yaxis, axes.zaxis), sizes / sizes.max(),
                              strict=True):
            axis.set_major_locator(extra('matplotlib.ticker', 'figures', 'pictures').MaxNLocator(
                max(2, round(_TICKS * size))))
            axis.set_tick_params(labelsize=8, pad=2 if self.bar is None else 5)
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axes.zaxis.labelpad = 4.0 if self.bar is None else 8.0
        axes.set_box_aspect(sizes, zoom=self._zoom(sizes))

    def look(self, azimuth: float) -> None:
        """See space from a direction, degrees about z; do so before `show`."""
        if self.space:
            self.axes.view_init(_ELEVATION, azimuth)

    def color_bar(self, top: float, label: str) -> None:
        """Show what the colors mean: from 0 to `top`, what is beyond in ALERT."""
        colors = extra('matplotlib', 'figures', 'pictures').colormaps['viridis'].with_extremes(
            over=ALERT)
        scale = extra('matplotlib.colors', 'figures', 'pictures').Normalize(0.0, top)
        mappable = extra('matplotlib.cm', 'figures', 'pictures').ScalarMappable(scale, colors)
        if self.bar is not None:
            self.figure.colorbar(mappable, cax=self.bar, label=label)
            return
        self.figure.colorbar(mappable, ax=self.axes, label=label, shrink=0.62, aspect=24,
                             pad=0.12 if self.space else 0.03)

    def title(self, text: str) -> None:
        """Write a title, over a new figure only: axes that were given may have their own."""
        if self.bar is not None and self.titled:
            self.figure.suptitle(text, fontsize=10)

    def legend(self, tints: Mapping[str, object]) -> None:
        """Say what lines mean: name -> color."""
        line = extra('matplotlib.lines', 'figures', 'pictures').Line2D
        handles = [line([], [], color=tint, label=name) for name, tint in tints.items()]
        where = {'loc': 'upper left', 'fontsize': 8, 'frameon': False}
        if self.bar is None:
            self.axes.legend(handles=handles, **where)
        elif self.titled:
            self.figure.legend(handles=handles, bbox_to_anchor=(0.02, 0.93), **where)

    def _zoom(self, sizes: Floats) -> float:
        """Return by how much the box, its diagonal 1, is enlarged to fill what room there is."""
        turn, up = np.deg2rad([self.axes.azim, self.axes.elev])
        across = abs(np.sin(turn)) * sizes[0] + abs(np.cos(turn)) * sizes[1]
        depth = abs(np.cos(turn)) * sizes[0] + abs(np.sin(turn)) * sizes[1]
        tall = np.cos(up) * sizes[2] + np.sin(up) * depth
        place = self.axes.get_position()
        width, height = self.figure.get_size_inches()
        side = min(place.width * width, place.height * height)
        room = (_ROOM * side,) * 2 if self.bar is None else (
            _ROOM_ALONE[0] * width, _ROOM_ALONE[1] * height)
        return float(min(room[0] / across, room[1] / tall) / (_UNIT * side))


def box_around(points: Floats) -> tuple[Floats, Floats]:
    """Return the corners (3,) in m of a box around points (n, 3) that is flat in no direction."""
    low, high = points.min(axis=0), points.max(axis=0)
    most = max(float((high - low).max()), 1e-9)
    margin = _MARGIN * most + 0.5 * np.maximum(_LEAST * most - (high - low), 0.0)
    return low - margin, high + margin


def azimuth(points: Floats) -> float:
    """Return from where (degrees about z) points (n, 3) are seen best.

    Across the level direction in which they extend most, a little turned, so that depth is seen.
    """
    level = points[:, :2] - points[:, :2].mean(axis=0)
    values, vectors = np.linalg.eigh(level.T @ level)
    along = vectors[:, 1] if values[1] > 0 else np.array([1.0, 0.0])
    along = along if along[0] >= 0 else -along
    return float(np.rad2deg(np.arctan2(along[1], along[0])) - 90.0 + _TURNED)
