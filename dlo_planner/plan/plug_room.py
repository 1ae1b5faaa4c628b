# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a plug in the hand is from what stands around, at a pose and all along a path."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from dlo_planner.energy.scene import Scene, build_scene
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.obstacles import Obstacle, called
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.plan.path import GripperPath, Leg
from dlo_planner.plan.workspace import distances_from

_CLOSE = 0.01  # of its radius: with less room the plug counts as touching
_PARTS = 17    # places along the plug that are looked at where it stands, ends included
_ROUNDS = 40   # of halvings; each halves what is to be shown, so that 40 are never needed


class PlugRoom:
    """Distances of a Plug from obstacles; exact to `_CLOSE` of its radius."""

    def __init__(self, plug: Plug, obstacles: Iterable[Obstacle]) -> None:
        self._plug, self._obstacles = plug, tuple(obstacles)
        self._scene: Scene = build_scene(self._obstacles, plug.radius, sharp=True)
        back = plug.grasp.inverse()
        self._origin, self._axis = back.position, back.rotation[:, 0]  # in the gripper's axes

    def at(self, gripper: Pose) -> tuple[float, str]:
        """Return the least distance where the gripper stands, m, and from what; inf: nothing.

        Places between those that are looked at may be nearer, by 1/32 of its length at most.
        """
        x = np.linspace(*self._plug.ends, _PARTS)
        rooms, bodies = self._rooms(np.tile(gripper.position, (x.size, 1)),
                                    np.tile(gripper.rotation, (x.size, 1, 1)), x)
        least = int(rooms.argmin())
        return float(rooms[least]), self._called(bodies[least])

    def first_touch(self, path: GripperPath) -> tuple[int, float, str] | None:
        """Return where the plug first touches something on a path, None if it never does.

        That is proved: the plug and the path are halved until no place of a part can come as far
        as it is away, by the bounds of the path's rates.

        Returns
        -------
        (int, float, str) or None
            Index of the waypoint to which the gripper is going, how far the plug is in it (m, at
            least), and what that is called.
        """
        for leg in path.legs if self._obstacles else ():
            found = None if leg.still else self._on_leg(leg)
            if found is not None:
                u, room, body = found
                return path.goal(u), max(_CLOSE * self._plug.radius - room, 0.0), self._called(body)
        return None

    def _on_leg(self, leg: Leg) -> tuple[float, float, int] | None:
        """Return the parameter, the room (m) and the body where it is touched first, or None."""
        a, b = leg.pieces()
        back, front = self._plug.ends
        ends = np.tile([back, front], (a.size, 1))
        lever = max(float(np.linalg.norm(self._origin + x * self._axis)) for x in (back, front))
        close, first = _CLOSE * self._plug.radius, None
        for _ in range(_ROUNDS):
            u, x = 0.5 * (a + b), ends.mean(axis=1)
            rates = leg.bounds(a, b)[:, :, 0]
            moved = 0.5 * (b - a) * (rates[:, 0] + rates[:, 1] * lever)
            apart = 0.5 * (ends[:, 1] - ends[:, 0])
            rooms, bodies = self._rooms(*leg.poses(u), x)
            touched = np.flatnonzero(rooms < close)
            if touched.size:
                k = touched[u[touched].argmin()]
                if first is None or u[k] < first[0]:
                    first = float(u[k]), float(rooms[k]), int(bodies[k])
            # what is shown to be free, and what comes after a touch, is done with
            open_ = (rooms >= close) & (rooms - moved - apart < close)
            if first is not None:
                open_ &= a < first[0]
            # what lies between `close` and twice that is as good as free: its half is too small
            open_ &= moved + apart > 0.5 * close
            if not open_.any():
                break
            by_path = moved[open_] > apart[open_]
            a, b, ends = _halved(a[open_], b[open_], ends[open_], by_path)
        return first

    def _rooms(self, positions: Floats, rotations: Floats, x: Floats) -> tuple[Floats, Ints]:
        """Return rooms (n,), m, of places x (n,) along the plug, and the nearest bodies (n,)."""
        places = positions + np.einsum('nij,nj->ni', rotations,
                                       self._origin + x[:, None] * self._axis)
        rooms, bodies = np.full(x.size, np.inf), np.zeros(x.size, dtype=int)
        for o in range(len(self._scene.source)):
            away = distances_from(self._scene, o, places)[0] - self._scene.radius
            nearer = away < rooms
            rooms[nearer], bodies[nearer] = away[nearer], o
        return rooms, bodies

    def _called(self, body: int) -> str:
        """Return the name of what a body of the scene is of."""
        if not self._obstacles:
            return ''
        source = int(self._scene.source[body])
        return called(self._obstacles[source], source)


def _halved(a: Floats, b: Floats, ends: Floats,
            by_path: Sequence[bool] | Floats) -> tuple[Floats, Floats, Floats]:
    """Return parts of path and plug halved, the longer way of each: a, b (2 n,), ends (2 n, 2)."""
    along, u, x = np.asarray(by_path, dtype=bool), 0.5 * (a + b), ends.mean(axis=1)
    first = np.where(along, u, b), np.stack([ends[:, 0], np.where(along, ends[:, 1], x)], axis=1)
    second = np.where(along, u, a), np.stack([np.where(along, ends[:, 0], x), ends[:, 1]], axis=1)
    return (np.concatenate([a, second[0]]), np.concatenate([first[0], b]),
            np.concatenate([first[1], second[1]]))
