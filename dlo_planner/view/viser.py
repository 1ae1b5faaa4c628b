# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A page in the browser by viser: primitives, tables, a grid in meters and a color bar."""

import socket
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stdout
from html import escape
from io import StringIO
from itertools import product
from threading import Event, Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view.colors import viridis
from dlo_planner.view.primitives import Primitive, bars_between, round_bar
from dlo_planner.view.summary import plan_columns

_STEPS = 9
_MARGINS = ('miss [', 'miss in', 'clearance', 'margin', 'stability', 'force', 'duration', 'swing')
_TINY = 1e-6  # what is smaller is rounding
_SHOWN = {'m': ('mm', 1e3), '': ('-', 1.0)}  # unit -> that of the page, and how many make one
LEVELS = {0: ('ok', '#1b7837'), 1: ('warning', '#b35806'), 2: ('error', '#b2182b'),
          3: ('stale', '#666666')}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of texts; all but the first column are aligned to the right."""
    def line(cells: Sequence[str], tag: str) -> str:
        return '<tr>' + ''.join(
            f'<{tag} style="padding:1px 6px;text-align:{"right" if k else "left"};'
            f'font-weight:{600 if tag == "th" else 400}">{escape(str(cell))}</{tag}>'
            for k, cell in enumerate(cells)) + '</tr>'

    body = line(head, 'th') + ''.join(line(row, 'td') for row in rows)
    return ('<table style="font-size:12px;line-height:1.35;border-collapse:collapse;'
            f'width:calc(100% - 12px);margin:2px 6px">{body}</table>')


def margins(plan: Plan, index: int) -> str:
    """Return the table of a Plan's margins: at one waypoint, and the worst of all."""
    rows = []
    for name, values, worst, unit in plan_columns(plan):
        shown, scale = _SHOWN.get(unit, (unit, 1.0))
        rows.append((f'{name} [{shown}]', _figure(scale * values[index]), _figure(scale * worst)))
    return table((f'waypoint {index + 1} of {len(plan)}', 'here', 'worst'), rows)


def margin_values(values: Mapping[str, str]) -> dict[str, str]:
    """Return what diagnostics of the planner say of margins, as the page says it."""
    return {name: _spoken(text) for name, text in values.items()
            if any(word in name for word in _MARGINS)}


def message(text: str, level: int | None = None) -> str:
    """Return a line of text in the color of its level: 0 ok, 1 warning, 2 error, 3 stale; None."""
    word, color = LEVELS.get(3 if level is None else level, ('', LEVELS[3][1]))
    word = f'<b>{word}:</b> ' if word else ''
    return (f'<div style="font-size:13px;line-height:1.35;padding:2px 12px;color:{color}">'
            f'{word}{escape(text)}</div>')


def color_bar(caption: str) -> str:
    """Return the colors from low to high, with what they mean under them."""
    stops = ', '.join('rgb({:.0f},{:.0f},{:.0f})'.format(*(255 * color))
                      for color in viridis(np.linspace(0, 1, _STEPS)))
    return ('<div style="padding:4px 12px;font-size:12px">'
            f'<div style="height:12px;background:linear-gradient(to right,{stops})"></div>'
            f'{escape(caption)}</div>')


def _spoken(text: str) -> str:
    try:
        value = float(text)
    except ValueError:
        return text
    return 'not looked at' if np.isnan(value) else _figure(value)


def _figure(value: float) -> str:
    if 0 < abs(value) < _TINY:
        return f'< {_TINY:.0e}'
    return 'no limit' if np.isposinf(value) else f'{value:.3g}'


_LINE = 2.0       # pixels
_OVERLAP = 1.02   # of a bar: no gaps where a DLO bends; none where it is seen through
_BAR = round_bar()


class Canvas:
    """Shows Primitives in a scene of viser; not thread-safe."""

    def __init__(self, scene: Any) -> None:
        self._scene, self.least_radius = scene, 0.0
        self._shown: dict[tuple[str, int], Primitive] = {}    # name -> Primitive
        self._handles: dict[tuple[str, int], Any] = {}  # name -> handle in the scene

    @property
    def items(self) -> dict[tuple[str, int], Primitive]:
        """The Primitives that are shown, by name."""
        return dict(self._shown)

    def show(self, items: Iterable[Primitive]) -> None:
        """Show these Primitives and no others."""
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
        """Lowest and highest corner (3,) m of the shown Primitives; None if there are none."""
        corners = np.concatenate([np.zeros((0, 3)), *(
            item.corners for item in self._shown.values() if item.kind != 'text')])
        return (corners.min(axis=0), corners.max(axis=0)) if len(corners) else None

    def _draw(self, item: Primitive, before: Primitive | None) -> None:
        handle = self._handles.get(item.name)
        bars = _barred(item), item.alpha
        if handle is not None and before is not None and bars[0] and (
                bars == (_barred(before), before.alpha)):
            for name, value in self._bars(item).items():
                setattr(handle, name, value)
            handle.position, handle.wxyz = item.pose.position, _wxyz(item.pose)
            return
        if handle is not None:
            handle.remove()
        self._handles[item.name] = self._added(item)

    def _added(self, item: Primitive) -> Any:
        name = f'/{item.group}/{item.index}'
        where = {'wxyz': _wxyz(item.pose), 'position': item.pose.position}
        color, solid = _bytes(item.color), {'color': _bytes(item.color), 'opacity': item.alpha}
        if _barred(item):
            return self._scene.add_batched_meshes_simple(name, *_BAR, **self._bars(item),
                                                         opacity=item.alpha, cast_shadow=False,
                                                         lod='off', **where)
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
            return self._scene.add_icosphere(name, radius=0.5, scale=tuple(item.size), **solid,
                                             **where)
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

    def _bars(self, item: Primitive) -> dict[str, NDArray[Any]]:
        """Return the arguments of batched meshes: one bar between two points."""
        turns, middles, lengths = bars_between(item.points)
        solid = item.alpha == 1
        radius = max(item.size[0] / 2, self.least_radius if solid else self.least_radius / 2)
        colors = np.tile(item.color, (len(item.points), 1)) if item.colors is None else item.colors
        return {'batched_wxyzs': turns, 'batched_positions': middles,
                'batched_scales': np.column_stack([
                    (_OVERLAP if solid else 1.0) * lengths, np.full((len(lengths), 2), radius)]),
                'batched_colors': (255 * 0.5 * (colors[1:] + colors[:-1])).astype(np.uint8)}


def _barred(item: Primitive) -> int:
    """Return of how many points a line is that is drawn as bars: a DLO, not a fine line; else 0."""
    thick = item.kind == 'line' and (item.colors is not None or item.alpha < 1)
    return len(item.points) if thick and len(item.points) > 1 else 0


def _wxyz(pose: Pose) -> Floats:
    return np.roll(pose.quaternion, 1)


def _bytes(color: Iterable[float]) -> tuple[int, ...]:
    return tuple(int(round(255 * channel)) for channel in color)


LOCAL, PORT = 'localhost', 8080
_THINNEST = 0.006  # of the size of what is shown: a thin wire would not be seen
_VIEW = np.array([-0.45, -1.0, 0.5])  # from where it is seen, from its middle
_CELL = 0.1        # m, of the grid
_FIELD = np.deg2rad(50)  # of view, from top to bottom
_FRAMED = {'dlo', 'trajectory', 'cutout', 'obstacle'}  # what has to be seen when it first comes
_ASPECT = 0.95 # of the scene beside the panel, about


class Page:
    """A viser server with a canvas, a grid in meters and a color bar; thread-safe."""

    def __init__(self, title: str, host: str = LOCAL, port: int = PORT) -> None:
        instance('host', host, str)
        port = integer('port', port, minimum=1, maximum=65_535)
        self.server = _server(host, port, title)
        self.gui, self.scene = self.server.gui, self.server.scene
        self.gui.configure_theme(control_width='large', show_logo=False, show_share_button=False,
                                 brand_color=(33, 104, 142))
        self.gui.main_panel.dock_right()
        self.canvas = Canvas(self.scene)
        self._lock, self._closed = Lock(), Event()
        self._framed: set[str] = set()  # of _FRAMED, what has been shown
        self._bar = self.gui.add_html('', visible=False)
        self.gui.add_button('Show everything').on_click(lambda _: self.frame())

    @property
    def url(self) -> str:
        """Where the page is."""
        return f'http://{self.server.get_host()}:{self.server.get_port()}'

    def show(self, items: Iterable[Primitive]) -> None:
        """Show these Primitives and no others; new ones move the camera."""
        items = list(items)
        caption = next((item.text for item in items if item.group == 'scale'), '')
        with self._lock, self.server.atomic():
            self.canvas.show(item for item in items if item.group != 'scale')
            if self._bar.content != color_bar(caption):
                self._bar.content, self._bar.visible = color_bar(caption), bool(caption)
        new = {item.group for item in items} & _FRAMED - self._framed
        if new:
            self._framed |= new
            self.frame()

    def frame(self) -> None:
        """Place the camera, of those who look already too, and the grid so that all is seen."""
        with self._lock:
            bounds = self.canvas.bounds
            if bounds is None:
                return
            low, high = bounds
            self.canvas.least_radius = 0.5 * _THINNEST * float(np.linalg.norm(high - low))
            self.canvas.redraw()
            low = np.floor(low / _CELL - (1, 1, 0)) * _CELL
            high = np.ceil(high / _CELL + (1, 1, 0)) * _CELL
            middle, place = 0.5 * (low + high), eye(low, high)
            cameras = [self.server.initial_camera,
                       *(client.camera for client in self.server.get_clients().values())]
            for camera in cameras:
                camera.fov = _FIELD
                camera.position = place  # takes along where it looks
                camera.look_at = middle
            self._ground(low, high)

    def control(self, name: str, pose: Pose, scale: float) -> Any:
        """Return a handle with which a Pose can be dragged: arrows and arcs."""
        return self.scene.add_transform_controls(
            f'/controls/{name}', scale=scale, line_width=3.0, depth_test=False,
            position=pose.position, wxyz=np.roll(pose.quaternion, 1))

    def wait(self) -> None:
        """Return when the page is closed, or at Ctrl-C."""
        try:
            while not self._closed.wait(0.2):
                pass
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """End the server."""
        self._closed.set()
        with redirect_stdout(StringIO()):
            self.server.stop()

    def _ground(self, low: Floats, high: Floats) -> None:
        """Put the grid under what is shown, and say how high that is."""
        width, height = (high - low)[:2]
        self.scene.add_grid(
            '/ground', width=width, height=height, cell_size=_CELL, section_size=_CELL,
            cell_color=(200, 200, 200), section_color=(200, 200, 200),
            position=low + (width / 2, height / 2, 0.0))
        self.scene.add_frame('/axes', axes_length=_CELL, axes_radius=_CELL / 30, position=low)
        for name, place in zip('xyz', 1.15 * _CELL * np.eye(3), strict=True):
            self.scene.add_label(f'/axes/{name}', name, position=place, anchor='center-center')
        self.scene.add_label('/axes/grid', f'grid {_CELL:g} m, at z = {low[2]:.3g} m',
                             anchor='top-left', font_screen_scale=0.8)


def eye(low: Floats, high: Floats) -> Floats:
    """Return from where (3,), m, a camera sees the box from `low` to `high` (3,) as a whole."""
    back = _VIEW / np.linalg.norm(_VIEW)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    corners = 0.5 * (high - low) * np.array(list(product((-1, 1), repeat=3)))
    up_slope = np.tan(0.5 * _FIELD)
    across = np.abs(corners @ right) / (_ASPECT * up_slope)
    upward = np.abs(corners @ np.cross(back, right)) / up_slope
    result: Floats = 0.5 * (low + high) + (np.maximum(across, upward) + corners @ back).max() * back
    return result


def pose_of(handle: Any) -> Pose:
    """Return the Pose of a handle of viser, whose quaternion is w, x, y, z."""
    return Pose(handle.position, np.roll(handle.wxyz, -1))


def put_at(handle: Any, pose: Pose) -> None:
    """Move a handle of viser to a Pose."""
    handle.position, handle.wxyz = pose.position, np.roll(pose.quaternion, 1)


def _server(host: str, port: int, title: str) -> Any:
    """Return a viser server that no page can have shared through a tunnel."""
    viser = extra('viser', 'view', 'pages in the browser')
    try:
        with socket.create_server((host, 0)):
            pass  # viser would look for a free port for ever
    except OSError as error:
        raise InvalidTask(f'host = {host!r}: expected a name or address of this machine '
                          f'({error})') from error

    class LocalServer(viser.ViserServer):  # type: ignore[name-defined, misc]
        def request_share_url(self, verbose: bool = True) -> None:
            return None

    with redirect_stdout(StringIO()):  # it announces itself whatever it is told
        return LocalServer(host=host, port=port, label=title, verbose=False)
