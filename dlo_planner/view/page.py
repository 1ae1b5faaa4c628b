# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The page in the browser: the parts that all pages have."""

import socket
from collections.abc import Iterable
from contextlib import redirect_stdout
from io import StringIO
from itertools import product
from threading import Event, Lock
from typing import Any

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer
from dlo_planner.model.pose import Pose
from dlo_planner.view.canvas import Canvas
from dlo_planner.view.item import Item
from dlo_planner.view.tables import color_bar

LOCAL, PORT = 'localhost', 8080
_THINNEST = 0.006  # of the size of what is shown: a thin wire would not be seen
_VIEW = np.array([-0.45, -1.0, 0.5])  # from where it is seen, from its middle
_CELL = 0.1        # m, of the grid
_FIELD = np.deg2rad(50)  # of view, from top to bottom
_FRAMED = {'dlo', 'trajectory', 'cutout', 'obstacle'}  # what has to be seen when it first comes
_ASPECT = 0.95 # of the scene beside the panel, about


class Page:
    """A viser server with a canvas, a grid in meters and a color bar; thread-safe.

    Parameters
    ----------
    title : str
        Title of the panel.
    host : str, optional
        Host that it listens on; another one than localhost lets everybody in the network in.
    port : int, optional
        Port that it listens on, or the next free one.

    Raises
    ------
    MissingExtra
        Viser is not installed.
    """

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

    def show(self, items: Iterable[Item]) -> None:
        """Show these Items and no others; new ones move the camera."""
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
    """Return from where (3,) m a camera sees the box from `low` (3,) to `high` (3,) as a whole.

    It looks at the middle of the box, its field of view is `_FIELD`.
    """
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
