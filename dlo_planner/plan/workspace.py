# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the gripper may be: a cell is not empty."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.energy.scene import Scene, build_scene, is_convex, signed_distance
from dlo_planner.errors import InvalidTask
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, items, number
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put
from dlo_planner.plan.path import GripperPath, Leg

# Rooms (n,) of places (n, 3), m, and their slopes (n, 3).
Rooms: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]

_CLOSE = 1e-6        # of the way's extent: to within this the rooms on the way are known
_CLOSE_SHEET = 1e-5  # the same beside sheets with holes, which take more looks
_ROUNDING = 1e-13    # of places and rooms
_ROUNDS = 40


@dataclass(frozen=True, eq=False, repr=False)
class Workspace(Value):
    """A box that the gripper stays inside, and bodies that it stays outside.

    Attributes
    ----------
    lower : ndarray, shape (3,)
        Corner of the box with the least coordinates, m, world axes; -inf: no limit.
    upper : ndarray, shape (3,)
        Opposite corner, m; inf: no limit.
    keep_out : tuple of obstacle
        Plane, Sphere, Capsule, Cylinder, Box, Ellipsoid, Sheet, Mesh, Hull, in any number.
    gripper_radius : float
        Radius in m of the sphere about the gripper's origin that stands for it.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    lower: Floats = (-np.inf,) * 3  # type: ignore[assignment]  # an array from then on
    upper: Floats = (np.inf,) * 3  # type: ignore[assignment]
    keep_out: tuple[Obstacle, ...] = ()
    gripper_radius: float = 0.0

    if TYPE_CHECKING:  # what may be given
        def __init__(self, lower: ArrayLike = ..., upper: ArrayLike = ...,
                     keep_out: Iterable[Obstacle] = (), gripper_radius: float = 0.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, **{name: array(f'Workspace.{name}', getattr(self, name), (3,), finite=False)
                     for name in ('lower', 'upper')})
        if not (self.lower < self.upper).all():
            raise InvalidTask(f'Workspace.upper = {self.upper.tolist()}: expected more than lower '
                              f'= {self.lower.tolist()}')
        put(self, keep_out=items('Workspace.keep_out', self.keep_out, OBSTACLES),
            gripper_radius=number('Workspace.gripper_radius', self.gripper_radius, minimum=0))
        super().__post_init__()

    def __getstate__(self) -> dict[str, Any]:
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @cached_property
    def _scene(self) -> Scene:
        result: Scene = build_scene(self.keep_out, self.gripper_radius, sharp=True)
        return result

    def _limits(self) -> list[tuple[str, Rooms, bool]]:
        """Return [(name, rooms, whether of a sheet)] of all limits.

        rooms: function of places (n, 3) -> (rooms (n,), slopes (n, 3))
        """
        limits = []
        for sign, name, corner in ((1.0, 'lower', self.lower), (-1.0, 'upper', self.upper)):
            limits += [(f'workspace.{name}.{axis}', _side(k, sign, corner[k] + sign *
                                                          self.gripper_radius), False)
                       for k, axis in enumerate('xyz') if np.isfinite(corner[k])]
        scene = self._scene
        limits += [(f'workspace.keep_out[{self.keep_out[source].name or source}]',
                    _body(scene, o), not is_convex(scene, o))
                   for o, source in enumerate(scene.source)]
        return limits

    def min_margin(self, gripper: Pose) -> tuple[str, float]:
        """Return name and distance (m) of the limit nearest to a gripper Pose; < 0 beyond it."""
        place = instance('gripper', gripper, Pose).position[None]
        rooms = [(name, float(room(place)[0][0]))
                 for name, room, _ in self._limits()]
        return min(rooms, key=lambda one: one[1], default=('', np.inf))

    def first_beyond(self, path: GripperPath) -> tuple[int, str, float] | None:
        """Return where a gripper on a path first exceeds a limit, None if it never does.

        All of the path is checked, not samples of it: a piece of it is halved until it is proved
        to keep its room, or a place beyond the limit is found. The sides of the box, and the
        distance from a convex body, lie above their tangent planes, and the path within its
        control points; outside of a sheet its distance changes no more than the place does.

        Parameters
        ----------
        path : GripperPath

        Returns
        -------
        (int, str, float) or None
            Index of the waypoint to which the gripper is going, name of the limit, and the largest
            distance in m beyond it before that waypoint.
        """
        instance('path', path, GripperPath)
        limits, crossings = self._limits(), []
        for leg in path.legs:
            for name, rooms, sheet in limits:
                places, least = _least_on(leg, rooms, sheet)
                beyond = np.flatnonzero(least < 0)
                if beyond.size:
                    crossings.append((path.goal(places[beyond[0]]), name, -float(least[beyond[0]])))
            if crossings:
                return min(crossings, key=lambda one: (one[0], -one[2]))
        return None


def _least_on(leg: Leg, rooms: Rooms, sheet: bool) -> tuple[Floats, Floats]:
    """Return parameters (m,) within the pieces of a Leg, and the least room (m,) of each piece.

    Exact for pieces on which it is negative, else any room that is not; see `first_beyond`.
    """
    a, b = leg.pieces()
    middles, piece = 0.5 * (a + b), np.arange(a.size)
    least = np.full(a.size, np.inf)
    close = (_CLOSE_SHEET if sheet else _CLOSE) * np.ptp(leg.positions, axis=0).max()
    for _ in range(_ROUNDS):
        points = leg.control_points(a, b)
        (first, slope), (last, other) = rooms(points[:, 0]), rooms(points[:, 3])
        close = max(close, _ROUNDING * max(np.abs(first).max(), np.abs(points).max()))
        if sheet:  # it may be without thickness: what comes this near is in it
            first, last = first - 2 * close, last - 2 * close
        np.minimum.at(least, piece, np.minimum(first, last))
        length = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
        bound = 0.5 * (first + last - length)
        if not sheet:
            for room, away, place in ((first, slope, points[:, 0]), (last, other, points[:, 3])):
                tangent = np.einsum('nij,nj->ni', points - place[:, None], away)
                bound = np.maximum(bound, room + tangent.min(axis=1))
        wide = bound < np.minimum(least[piece], 0) - close
        if not wide.any():
            break
        a, b, piece, middle = a[wide], b[wide], piece[wide], 0.5 * (a + b)[wide]
        a, b, piece = np.append(a, middle), np.append(middle, b), np.append(piece, piece)
    return middles, least


def _side(axis: int, sign: float, limit: float) -> Rooms:
    """Return the rooms' function of one side of the box."""
    slope = sign * np.eye(3)[axis]

    def rooms(places: Floats) -> tuple[Floats, Floats]:
        return sign * (places[:, axis] - limit), np.tile(slope, (len(places), 1))
    return rooms


def _body(scene: Scene, o: int) -> Rooms:
    """Return the rooms' function of a body of a Scene."""
    def rooms(places: Floats) -> tuple[Floats, Floats]:
        distances, slopes = distances_from(scene, o, np.array(places))
        return distances - scene.radius, slopes
    return rooms


@kernel
def distances_from(scene: Scene, o: int, places: Floats) -> tuple[Floats, Floats]:
    """Return signed distances (n,) of places (n, 3) from the body `o`, and their slopes (n, 3)."""
    rooms, slopes = np.empty(places.shape[0]), np.empty(places.shape)
    bend = np.empty((3, 3))
    for k in range(places.shape[0]):
        rooms[k] = signed_distance(scene, o, places[k], slopes[k], bend)
    return rooms, slopes
