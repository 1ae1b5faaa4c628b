# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Matplotlib: axes in space or from the side, primitives in them, what stands around a DLO."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import items, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Plane
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, means_to_touch
from dlo_planner.view.colors import ALERT, GRAY, ORANGE, SKY_BLUE
from dlo_planner.view.primitives import Primitive, cut_box, plate, room, tessellate
from dlo_planner.view.scene import (
    axes_primitives,
    cutout_primitives,
    cutouts_of,
    obstacle_primitives,
)

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
_ASIDE = 0.04          # of the width: what is seen makes room for the ticks of the upright axis
_ROOM = 0.76           # of axes that are given: for what is seen
_LETTER = 0.085        # inches, of a title: a wide letter of the mean
_UNIT = 1.03           # of its axes: a diagonal of the box without zoom


def matplotlib(module: str = '') -> Any:
    """Return matplotlib, or one of its modules ('.lines'); raise MissingExtra."""
    return extra(f'matplotlib{module}', 'figures', 'pictures')


@dataclass(frozen=True)
class Frame:
    """Axes to draw in."""

    figure: Any
    axes: Any
    own: bool = False    # whether the figure is ours: its size, color bar and title are
    titled: bool = True  # whether it has a title and a legend
    side: tuple[int, int] = SIDES['x']  # world axes that are seen in axes of two dimensions

    @classmethod
    def new(cls, points: Floats, width: float = _WIDE, managed: bool = True) -> 'Frame':
        """Return axes in a new figure for points (n, 3) m: from the side where these are flat."""
        new = (matplotlib('.pyplot').figure if managed
               else matplotlib('.figure').Figure)
        side = side_of(points)
        if side is None:
            figure = new(figsize=(width, width))
            with matplotlib().rc_context(_GRID):
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
        axes.computed_zorder = False  # lines over faces: a DLO on a table is not seen through it
        sizes = (high - low) / np.linalg.norm(high - low)
        for axis, size in zip((axes.xaxis, axes.yaxis, axes.zaxis), sizes / sizes.max(),
                              strict=True):
            axis.set_major_locator(matplotlib('.ticker').MaxNLocator(
                max(2, round(_TICKS * size))))
            axis.set_tick_params(labelsize=8, pad=4 if self.own else 2)
            axis.labelpad = 5.0 if self.own else 4.0
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        across, tall = self._seen(sizes)
        if self.own:
            self._fit(across, tall, 2 * _EDGES[0] + _BAR, 2 * _EDGES[1])
            width, height = self.figure.get_size_inches()
            room = ((width - 2 * _EDGES[0] - _BAR) / across, (height - 2 * _EDGES[1]) / tall)
            side = min(room) / _UNIT
            upright = _ASIDE if axes.azim % 180.0 < 90.0 else -_ASIDE  # where matplotlib has z
            middle = (0.5 + upright) * (width - _BAR), 0.48 * height
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

    def color_bar(self, top: float, label: str, low: float = 0.0) -> None:
        """Show what the colors mean: from `low` to `top`, what is beyond in ALERT."""
        colors = matplotlib().colormaps['viridis'].with_extremes(
            over=ALERT)
        scale = matplotlib('.colors').Normalize(low, top)
        mappable = matplotlib('.cm').ScalarMappable(scale, colors)
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
            most = int(self.figure.get_size_inches()[0] / _LETTER)
            whole = re.sub(r'(?<=\d) (?=[a-zA-Z])', '\N{NO-BREAK SPACE}', text)  # '5 mm'
            lines = [line for one in whole.splitlines() for line in wrap(one, most)]
            self.figure.suptitle('\n'.join(lines), fontsize=10)

    def settle(self) -> None:
        """Place all for good: a film's pictures need not be laid out again."""
        if not self.space:
            self.figure.draw_without_rendering()
            self.figure.set_layout_engine('none')

    def legend(self, tints: Mapping[str, object]) -> None:
        """Say what lines mean: name -> color."""
        line = matplotlib('.lines').Line2D
        handles = [line([], [], color=tint, label=name) for name, tint in tints.items()]
        options = {'handles': handles, 'fontsize': 8, 'frameon': False}
        if not self.own or not self.space:
            self.axes.legend(loc='lower left' if self.space else 'best', **options)
        elif self.titled:
            self.figure.legend(loc='lower left', **options)


def checked_axes(ax: Any) -> Any:
    """Return Axes of matplotlib; raise InvalidTask if they are none."""
    if not isinstance(ax, matplotlib('.axes').Axes):
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


_DLO, _LINE, _FINE, _GHOST = 2.6, 1.6, 0.7, 1.2  # points
_PLATE_LINE = 3.0  # points, of a plate from the side
_EDGE = 0.5   # points, of what is solid
_DOT_AREA = 8.0    # points^2


def draw(axes: Any, items: Iterable[Primitive],
         side: tuple[int, int] = SIDES['x']) -> list[Any]:
    """Draw Primitives without texts, which legends say; return the artists, for a film."""
    artists = []
    for item in items:
        if item.kind != 'text':
            artists += _drawn(axes, item, list(side))
    return artists


def _drawn(axes: Any, item: Primitive, side: list[int]) -> list[Any]:
    lines, faces, dots = tessellate(item)
    artists = []
    if faces:
        artists.append(_faces(axes, faces, item, side))
    if lines and item.colors is not None and len(item.points) > 1:
        pairs = np.stack([lines[0][:-1], lines[0][1:]], axis=1)
        colors = 0.5 * (item.colors[1:] + item.colors[:-1])
        artists.append(_lines(axes, pairs, colors, _DLO, 1.0, side))
    elif lines:
        color = [0.6 * channel for channel in item.color] if faces else item.color
        artists.append(_lines(axes, lines, [color], _width(item, faces), item.alpha, side))
    if len(dots):
        columns = dots.T if axes.name == '3d' else dots[:, side].T
        artists.append(axes.scatter(*columns, s=_DOT_AREA, color=[item.color], alpha=item.alpha))
    return artists


def _width(item: Primitive, faces: Sequence[Floats]) -> float:
    if faces or item.kind == 'segments':
        return _EDGE if faces else _PLATE_LINE if item.group == 'plate' else _FINE
    return _GHOST if item.alpha < 1 else _LINE


def _lines(axes: Any, lines: Iterable[Floats], colors: ArrayLike, width: float,
           alpha: float, side: list[int]) -> Any:
    options = {'colors': colors, 'linewidths': width, 'alpha': alpha, 'capstyle': 'round'}
    if axes.name == '3d':
        kind = extra('mpl_toolkits.mplot3d.art3d', 'figures', 'pictures').Line3DCollection
        return axes.add_collection3d(kind(list(lines), **options))
    kind = matplotlib('.collections').LineCollection
    return axes.add_collection(kind([np.asarray(line)[:, side] for line in lines], **options))


def _faces(axes: Any, faces: Sequence[Floats], item: Primitive, side: list[int]) -> Any:
    options = {'facecolors': [(*item.color, item.alpha)], 'edgecolors': 'none'}
    if axes.name == '3d':
        kind = extra('mpl_toolkits.mplot3d.art3d', 'figures', 'pictures').Poly3DCollection
        return axes.add_collection3d(kind(faces, **options))
    kind = matplotlib('.collections').PolyCollection
    return axes.add_collection(kind([face[:, side] for face in faces], **options))


_AXIS = 0.09     # of the DLO's length: axes of the gripper, a normal
_PLATE = 0.14    # the same: half a plate around a hole
_HIDDEN = 0.02   # the same: a hole without a size, seen from the side
_DOT = 0.035     # the same: a center that the DLO passes in any direction
_ALPHA, _GLASS = 0.45, 0.25
_BLACK = (0.0, 0.0, 0.0)
_AT_MOUTH = 1e-6  # of the length: what is held so near to the entrance of a bore is held there


@dataclass(frozen=True)
class Stage:
    """Shapes and what is around them."""

    shapes: tuple[Shape, ...]      # all that the picture has to hold
    cutouts: tuple[CutOut, ...]    # that the DLO passes
    centers: tuple[Floats, ...]    # (3,) m each, points that it passes in any direction
    obstacles: tuple[Obstacle, ...]  # of the shapes, and further ones
    length: float                  # of the DLO, m
    bore: float = 0.0              # m, how deep the last cut-out is that the DLO is pushed into

    @classmethod
    def of(cls, shapes: tuple[Shape, ...], obstacles: Iterable[Obstacle],
           plan: Plan | None = None) -> 'Stage':
        """Return the stage of Shapes, and of the Plan that they belong to."""
        own = list(shapes[0].obstacles)
        own += [one for one in items('obstacles', obstacles, OBSTACLES) if one not in own]
        cutouts: tuple[CutOut, ...] = ()
        centers: tuple[Floats, ...] = ()
        if plan is not None and not _in_contact(plan):
            cutouts = tuple(cutouts_of(plan))
            centers = tuple(center for center, _, normal in plan.via_points[-1] if normal is None)
        bore = 0.0 if plan is None or not cutouts else _bore(plan, cutouts[-1])
        length = max(float(shape.s[-1]) for shape in shapes)
        return cls(shapes, cutouts, centers, tuple(own), length, bore)

    def set(self, frame: Frame, more: Iterable[Primitive] = (),
            around: Iterable[Floats] = ()) -> None:
        """Draw all that stands still, and further Primitives, and choose what is seen.

        `around`: places (n, 3), m, that the picture has to hold as well.
        """
        drawn = self._still(frame)
        solid = [item.corners for item in (*drawn, *more) if item.kind != 'text']
        points = np.concatenate([*self._around_shapes(), *solid, *around])
        low, high = box_around(points)
        draw(frame.axes, [*drawn, *self._planes(low, high), *more], frame.side)
        frame.look(azimuth(points))
        frame.show(low, high)

    @property
    def points(self) -> Floats:
        """(n, 3) m: of the DLO in all its shapes, and the holes it passes."""
        passed = [cutout.center for cutout in self.cutouts] + [*self.centers]
        return np.concatenate([*(shape.positions for shape in self.shapes),
                               np.reshape(passed, (-1, 3))])

    def gripper(self, pose: Pose, index: int = 0) -> list[Primitive]:
        """Return the axes of a gripper."""
        return axes_primitives(f'gripper {index}', pose, _AXIS * self.length)

    def _still(self, frame: Frame) -> list[Primitive]:
        """Return what stands still but planes; from the side, holes are gaps in a line."""
        drawn = obstacle_primitives(one for one in self.obstacles if not isinstance(one, Plane))
        drawn += [Primitive('center', index, 'ball', ORANGE, size=(_DOT * self.length,) * 3,
                            pose=Pose(center, (0.0, 0.0, 0.0, 1.0)))
                  for index, center in enumerate(self.centers)]
        if not frame.space:
            return drawn + [self._gap(k, cutout, frame.side[0])
                            for k, cutout in enumerate(self.cutouts)] + self._walls(frame.side[0])
        if self.bore:
            drawn.append(self._bored())
        drawn += [Primitive('plate', index, 'triangles', GRAY, _ALPHA,
                            plate(cutout, _PLATE * self.length), pose=cutout.pose)
                  for index, cutout in enumerate(self.cutouts) if room(cutout) is not None]
        return drawn + cutout_primitives(self.cutouts, _AXIS * self.length)

    def _planes(self, low: Floats, high: Floats) -> list[Primitive]:
        """Return what is seen of the planes in a box."""
        drawn = []
        planes = [one for one in self.obstacles if isinstance(one, Plane)]
        for index, plane in enumerate(planes):
            corners = cut_box(plane.point, plane.normal, low, high)
            if len(corners) > 2:
                fan = np.concatenate([corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)])
                edge = corners[[*range(len(corners)), 0]]
                drawn += [Primitive('plane', index, 'triangles', SKY_BLUE, _GLASS, fan),
                          Primitive('border', index, 'line', SKY_BLUE, 0.8, points=edge)]
        return drawn

    def _around_shapes(self) -> list[Floats]:
        tips = [shape.gripper.position + sign * _AXIS * self.length * shape.gripper.rotation[:, k]
                for shape in self.shapes for k in range(3) for sign in (0, 1)]
        return [*(shape.positions for shape in self.shapes), np.reshape(tips, (-1, 3))]

    def _bored(self) -> Primitive:
        """Return the wall of the bore, in space."""
        mouth, wide = self.cutouts[-1], 2 * self._inner(self.cutouts[-1])
        along = mouth.pose.rotation[:, [1, 2, 0]]  # a cylinder stands along z
        return Primitive('bore', 0, 'cylinder', GRAY, _GLASS, size=(wide, wide, self.bore),
                         pose=Pose.from_rotation(mouth.center + 0.5 * self.bore * mouth.normal,
                                                 along))

    def _walls(self, level: int) -> list[Primitive]:
        """Return the bore cut along its axis, and the DLO in it, in an upright plane."""
        if not self.bore:
            return []
        mouth, end = self.cutouts[-1], self.bore * self.cutouts[-1].normal
        inner = self._inner(mouth) * _across(mouth, level)
        walls = [place for side in (inner, -inner)
                 for place in (mouth.center + side, mouth.center + side + end)]
        inside = [mouth.center, mouth.center + end]
        return [Primitive('plate', len(self.cutouts), 'segments', _BLACK, points=walls),
                Primitive('inside', 0, 'line', GRAY, 0.8, points=inside)]

    def _inner(self, cutout: CutOut) -> float:
        """Return half the width of a cut-out in m, as it is drawn."""
        return room(cutout) or _HIDDEN * self.length

    def _gap(self, index: int, cutout: CutOut, level: int) -> Primitive:
        """Return a plate cut through its hole, in the upright plane through its center."""
        across, inner = _across(cutout, level), self._inner(cutout)
        outer = max(_PLATE * self.length, 2 * inner)
        ends = [cutout.center + distance * across for distance in (inner, outer, -inner, -outer)]
        return Primitive('plate', index, 'segments', _BLACK, points=ends)


def _across(cutout: CutOut, level: int) -> Floats:
    """Return the unit vector (3,) across the normal in the upright plane along axis `level`."""
    across = np.zeros(3)
    across[[level, 2]] = -cutout.normal[2], cutout.normal[level]
    size = np.linalg.norm(across)
    return across / size if size > 0 else np.array([0.0, 0.0, 1.0])


def _bore(plan: Plan, mouth: CutOut) -> float:
    """Return how deep in m the DLO is pushed into a bore with this entrance; 0 without one."""
    held = [shape.far_end for shape in plan.shapes if shape.far_end is not None]
    near = [np.abs(end.pose.position - mouth.center).max() < _AT_MOUTH * plan.shapes[0].s[-1]
            for end in held]
    return float(plan.depths[-1]) if near and all(near) else 0.0


def _in_contact(plan: Plan) -> bool:
    return means_to_touch(plan) and all(not shape.holds for shape in plan.shapes)
