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

SIDES = {'x': (0, 2), 'y': (1, 2)}  # what lies along that level axis, as it is seen from beside
_WIDE = 8.0            # inches
_LOW, _TALL = 3.0, 6.5
_ELEVATION = 18.0      # degrees above the level, from where space is seen
_TURNED = 35.0         # degrees beside the direction in which least is hidden: holes are open
_FLAT = 0.01           # of the largest extent: what is thinner is drawn from the side
_LEAST = 0.3           # of the largest extent: the others are shown no smaller
_MARGIN = 0.04         # of the largest extent
_TICKS = 5
_GRID = {'grid.color': '0.88', 'grid.linewidth': 0.6}
_EDGES = (0.75, 0.7)     # inches left and right, above and below of what is seen in space: labels
_BAR = 1.15            # inches, of the color bar with its label
_ROOM = 0.76           # of axes that are given: for what is seen
_UNIT = 1.03           # of its axes: a diagonal of the box without zoom


@dataclass(frozen=True)
class Frame:
    """Axes to draw in.

    Attributes
    ----------
    figure, axes : object
        Figure and axes of matplotlib.
    own : bool
        Whether the figure is ours: its size, color bar and title are.
    titled : bool
        Whether it has a title and a legend.
    side : (int, int)
        World axes that are seen where the axes have two dimensions.
    """

    figure: Any
    axes: Any
    own: bool = False
    titled: bool = True
    side: tuple[int, int] = SIDES['x']

    @classmethod
    def new(cls, points: Floats, width: float = _WIDE, managed: bool = True) -> 'Frame':
        """Return axes in a new figure for points (n, 3) m: from the side where these are flat."""
        new = (extra('matplotlib.pyplot', 'figures', 'pictures').figure if managed
               else extra('matplotlib.figure', 'figures', 'pictures').Figure)
        side = side_of(points)
        if side is None:
            figure = new(figsize=(width, width))
            with extra('matplotlib', 'figures', 'pictures').rc_context(_GRID):
                axes = figure.add_axes((0, 0, 1, 1), projection='3d', proj_type='ortho')
            axes.patch.set_visible(False)
            return cls(figure, axes, own=True)
        figure = new(figsize=(width, width), layout='constrained')
        return cls(figure, figure.add_subplot(), own=True, side=side)

    @classmethod
    def of(cls, ax: 'Axes | Frame | None', points: Floats) -> 'Frame':
        """Return the Frame of an argument: a new one for None."""
        if ax is None:
            return cls.new(points)
        if isinstance(ax, Frame):
            return ax
        return cls(checked_axes(ax).figure, ax)

    @property
    def space(self) -> bool:
        """Whether the axes have three dimensions."""
        return bool(self.axes.name == '3d')

    def show(self, low: Floats, high: Floats) -> None:
        """Show the box between two corners (3,) in m, with equal scales and units."""
        axes = self.axes
        if not self.space:
            (left, right), (bottom, top) = ((low[k], high[k]) for k in self.side)
            axes.set(xlabel=f'{"xyz"[self.side[0]]} [m]', ylabel='z [m]')
            axes.grid(alpha=0.3)
            if self.own:
                axes.set(xlim=(left, right), ylim=(bottom, top), aspect='equal')
                self._fit(right - left, top - bottom, 0.7 + _BAR, 1.2)
            else:
                axes.update_datalim([(left, bottom), (right, top)])
                axes.autoscale_view()
                axes.set_aspect('equal', adjustable='datalim')
            return
        axes.set(xlabel='x [m]', ylabel='y [m]', zlabel='z [m]', xlim=(low[0], high[0]),
                 ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        sizes = (high - low) / np.linalg.norm(high - low)
        for axis, size in zip((axes.xaxis, axes.yaxis, axes.zaxis), sizes / sizes.max(),
                              strict=True):
            axis.set_major_locator(extra('matplotlib.ticker', 'figures', 'pictures').MaxNLocator(
                max(2, round(_TICKS * size))))
            axis.set_tick_params(labelsize=8, pad=4 if self.own else 2)
            axis.labelpad = 5.0 if self.own else 4.0
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        across, tall = self._seen(sizes)
        if self.own:
            self._fit(across, tall, 2 * _EDGES[0] + _BAR, 2 * _EDGES[1])
            width, height = self.figure.get_size_inches()
            room = ((width - 2 * _EDGES[0] - _BAR) / across, (height - 2 * _EDGES[1]) / tall)
            side, middle = min(room) / _UNIT, (0.46 * (width - _BAR), 0.48 * height)
            axes.set_position(((middle[0] - side / 2) / width, (middle[1] - side / 2) / height,
                               side / width, side / height))
        else:
            place, inches = axes.get_position(), self.figure.get_size_inches()
            side = min(place.width * inches[0], place.height * inches[1])
            room = (_ROOM * side / across, _ROOM * side / tall)
        axes.set_box_aspect(sizes, zoom=float(min(room)) / (_UNIT * side))

    def _fit(self, across: float, tall: float, beside: float, above: float) -> None:
        """Make the figure as tall as what is seen needs, and narrower where that is very tall."""
        width = self.figure.get_size_inches()[0]
        scale = width / _WIDE
        height = (width - beside * scale) * tall / across + above * scale
        if height > _TALL * scale:
            height = _TALL * scale
            width = max(0.6 * width, (height - above * scale) * across / tall + beside * scale)
        self.figure.set_size_inches(width, max(height, _LOW * scale))

    def _seen(self, sizes: Floats) -> tuple[float, float]:
        """Return width and height of a box as it is seen."""
        turn, up = np.deg2rad([self.axes.azim, self.axes.elev])
        across = abs(np.sin(turn)) * sizes[0] + abs(np.cos(turn)) * sizes[1]
        depth = abs(np.cos(turn)) * sizes[0] + abs(np.sin(turn)) * sizes[1]
        return float(across), float(np.cos(up) * sizes[2] + np.sin(up) * depth)

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
        if self.own and self.space:
            width, height = self.figure.get_size_inches()
            bar = self.figure.add_axes((1 - _BAR / width, 0.2, 0.15 / width, 0.56))
            self.figure.colorbar(mappable, cax=bar, label=label)
            return
        self.figure.colorbar(mappable, ax=self.axes, label=label, shrink=1.0 if self.own else 0.62,
                             aspect=24, pad=0.12 if self.space else 0.03)

    def title(self, text: str) -> None:
        """Write a title, over a new figure only: axes that were given may have their own."""
        if self.own and self.titled:
            self.figure.suptitle(text, fontsize=10)

    def settle(self) -> None:
        """Place all for good: a film's pictures need not be laid out again."""
        if not self.space:
            self.figure.draw_without_rendering()
            self.figure.set_layout_engine('none')

    def legend(self, tints: Mapping[str, object]) -> None:
        """Say what lines mean: name -> color."""
        line = extra('matplotlib.lines', 'figures', 'pictures').Line2D
        handles = [line([], [], color=tint, label=name) for name, tint in tints.items()]
        options = {'handles': handles, 'fontsize': 8, 'frameon': False}
        if not self.own or not self.space:
            self.axes.legend(loc='best', **options)
        elif self.titled:
            self.figure.legend(loc='lower left', **options)


def checked_axes(ax: Any) -> Any:
    """Return Axes of matplotlib; raise InvalidTask if they are none."""
    if not isinstance(ax, extra('matplotlib.axes', 'figures', 'pictures').Axes):
        raise InvalidTask(f'ax = {shown(ax)}: expected Axes of matplotlib')
    return ax


def side_of(points: Floats) -> tuple[int, int] | None:
    """Return the world axes in whose plane points (n, 3) lie, upright; None if they do not."""
    extents = np.ptp(points, axis=0)
    flat = extents <= _FLAT * extents.max()
    return SIDES['x'] if flat[1] else SIDES['y'] if flat[0] else None


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
