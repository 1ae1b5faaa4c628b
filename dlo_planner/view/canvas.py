# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Draws Items into a scene of viser, and only what has changed."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.view.item import Item
from dlo_planner.view.triangles import bars_between, round_bar, tube

_LINE = 2.0       # pixels
_OVERLAP = 1.02   # of a bar: no gaps where a tube bends
_BAR = round_bar()


class Canvas:
    """Shows Items in a scene of viser; not thread-safe.

    Parameters
    ----------
    scene : object
        viser.SceneApi.
    least_radius : float, optional
        Least radius in m, a DLO is drawn no thinner than this (a transparent one, than half of it).
    """

    def __init__(self, scene: Any, least_radius: float = 0.0) -> None:
        self._scene = scene
        self.least_radius = least_radius
        self._shown: dict[tuple[str, int], Item] = {}    # name -> Item
        self._handles: dict[tuple[str, int], Any] = {}  # name -> handle in the scene

    @property
    def items(self) -> dict[tuple[str, int], Item]:
        """The Items that are shown, by name."""
        return dict(self._shown)

    def show(self, items: Iterable[Item]) -> None:
        """Show these Items and no others."""
        new = {item.name: item for item in items}
        for name in self._shown.keys() - new.keys():
            self._handles.pop(name).remove()
            del self._shown[name]
        for name, item in new.items():
            if self._shown.get(name) != item:
                self._draw(item, self._shown.get(name))
                self._shown[name] = item

    def redraw(self) -> None:
        """Draw all of them anew, after `least_radius` was changed."""
        known, self._shown = self._shown, {}
        self.show(known.values())

    @property
    def bounds(self) -> tuple[Floats, Floats] | None:
        """Lowest and highest corner (3,) m of the shown Items; None if there are none."""
        corners = np.concatenate([np.zeros((0, 3)), *(
            item.corners for item in self._shown.values() if item.kind != 'text')])
        return (corners.min(axis=0), corners.max(axis=0)) if len(corners) else None

    def _draw(self, item: Item, before: Item | None) -> None:
        handle = self._handles.get(item.name)
        if handle is not None and before is not None and _barred(item) == _barred(before) != 0:
            for name, value in self._bars(item).items():
                setattr(handle, name, value)
            handle.position, handle.wxyz = item.pose.position, _wxyz(item.pose)
            return
        if handle is not None:
            handle.remove()
        self._handles[item.name] = self._added(item)

    def _added(self, item: Item) -> Any:
        name = f'/{item.group}/{item.index}'
        where = {'wxyz': _wxyz(item.pose), 'position': item.pose.position}
        color, solid = _bytes(item.color), {'color': _bytes(item.color), 'opacity': item.alpha}
        if _barred(item):
            return self._scene.add_batched_meshes_simple(name, *_BAR, **self._bars(item),
                                                         lod='off', **where)
        if item.kind == 'line' and item.alpha < 1 and len(item.points) > 1:
            mesh = tube(item.points, max(item.size[0] / 2, self.least_radius / 2))
            return self._scene.add_mesh_simple(name, *mesh, cast_shadow=False, **solid, **where)
        if item.kind == 'line':
            pairs = np.stack([item.points[:-1], item.points[1:]], axis=1)
            return self._lines(name, pairs, color, where)
        if item.kind == 'segments':
            return self._lines(name, item.points.reshape(-1, 2, 3), color, where)
        if item.kind == 'arrow':
            shaft, head, length = item.size
            return self._scene.add_arrows(name, item.points[None], color, shaft_radius=shaft / 2,
                                          head_radius=head / 2, head_length=length, **where)
        if item.kind == 'box':
            return self._scene.add_box(name, dimensions=tuple(item.size), **solid, **where)
        if item.kind == 'ball':
            return self._scene.add_icosphere(name, radius=item.size[0] / 2, **solid, **where)
        if item.kind == 'cylinder':
            return self._scene.add_cylinder(name, radius=item.size[0] / 2, height=item.size[2],
                                            **solid, **where)
        if item.kind == 'text':
            return self._scene.add_label(name, item.text, anchor='bottom-center', **where)
        if item.kind == 'points':
            return self._scene.add_point_cloud(name, item.points, color, point_size=item.size[0],
                                               point_shape='circle', **where)
        faces = np.arange(len(item.points)).reshape(-1, 3)
        return self._scene.add_mesh_simple(name, item.points, faces, side='double',
                                           flat_shading=True, cast_shadow=False, **solid, **where)

    def _lines(self, name: str, pairs: Floats, color: tuple[int, ...],
               where: dict[str, Floats]) -> Any:
        return self._scene.add_line_segments(name, pairs, color, thickness=_LINE,
                                             thickness_units='screen', **where)

    def _bars(self, item: Item) -> dict[str, NDArray[Any]]:
        """Return the arguments of batched meshes: one bar between two points."""
        turns, middles, lengths = bars_between(item.points)
        radius = max(item.size[0] / 2, self.least_radius)
        colors = np.zeros((0, 3)) if item.colors is None else item.colors
        return {'batched_wxyzs': turns, 'batched_positions': middles,
                'batched_scales': np.column_stack(
                    [_OVERLAP * lengths, np.full((len(lengths), 2), radius)]),
                'batched_colors': (255 * 0.5 * (colors[1:] + colors[:-1])).astype(np.uint8)}


def _barred(item: Item) -> int:
    """Return of how many points a line in several colors is, which is drawn as bars; else 0."""
    colored = item.kind == 'line' and item.colors is not None and len(item.points) > 1
    return len(item.points) if colored else 0


def _wxyz(pose: Pose) -> Floats:
    return np.roll(pose.quaternion, 1)


def _bytes(color: Iterable[float]) -> tuple[int, ...]:
    return tuple(int(round(255 * channel)) for channel in color)
