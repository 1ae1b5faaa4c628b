# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How grips move: poses of grippers and far ends, and smooth motions through them."""

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import Value, put


@kernel
def along_spline(cubics: Floats, count: int, dt: float, places: Floats, frames: Floats,
                 centers: Floats) -> tuple[Floats, Floats, Floats]:
    """Return rotations (k, 3, 3), positions (k, 3), twists (k, 6) at `places` (k,).

    Args:
        cubics: (4, n - 1, 7) their coefficients, highest first, of position and quaternion; the
            latter has any size
        count: n poses, at the places 0, 1, 2 ...; dt: s between them
        frames, centers: (n, 3, 3), (n, 3) of the poses
    """
    rotations, positions = np.empty((places.size, 3, 3)), np.empty((places.size, 3))
    twists = np.empty((places.size, 6))
    value, rate = np.empty(7), np.empty(7)
    for k in range(places.size):
        nearest = int(np.rint(places[k]))
        _fill_cubic(cubics, count, places[k], dt, value, rate)
        _fill_twist(value, rate, twists[k])
        if places[k] == nearest and 0 <= nearest < count:
            for i in range(3):
                positions[k, i] = centers[nearest, i]
                for j in range(3):
                    rotations[k, i, j] = frames[nearest, i, j]
        else:
            for i in range(3):
                positions[k, i] = value[i]
            _fill_rotation(value, rotations[k])
    return rotations, positions, twists


@kernel
def _fill_cubic(cubics: Floats, count: int, place: float, dt: float, value: Floats,
                rate: Floats) -> None:
    """Fill value (7,) and rate (7,), 1/s, of the spline at a place, beyond its ends too."""
    piece = min(max(int(np.floor(place)), 0), count - 2)
    x = place - piece
    for i in range(7):
        a, b, c, d = (cubics[0, piece, i], cubics[1, piece, i], cubics[2, piece, i],
                      cubics[3, piece, i])
        value[i] = ((a * x + b) * x + c) * x + d
        rate[i] = ((3 * a * x + 2 * b) * x + c) / dt


@kernel
def _fill_twist(value: Floats, rate: Floats, twist: Floats) -> None:
    """Fill (6,) velocity and angular velocity, world, of a pose (7,) and its rate (7,)."""
    x, y, z, w = value[3], value[4], value[5], value[6]
    a, b, c, d = rate[3], rate[4], rate[5], rate[6]
    half = 0.5 * (x * x + y * y + z * z + w * w)
    for i in range(3):
        twist[i] = rate[i]
    twist[3] = (w * a - d * x + y * c - z * b) / half
    twist[4] = (w * b - d * y + z * a - x * c) / half
    twist[5] = (w * c - d * z + x * b - y * a) / half


@kernel
def _fill_rotation(value: Floats, rotation: Floats) -> None:
    """Fill (3, 3) of the quaternion, of any size, in a pose (7,) (Diebel 2006, eq. 125)."""
    x, y, z, w = value[3], value[4], value[5], value[6]
    s = 1 / (x * x + y * y + z * z + w * w)
    rotation[0, 0] = s * (x * x - y * y - z * z + w * w)
    rotation[1, 1] = s * (y * y - x * x - z * z + w * w)
    rotation[2, 2] = s * (z * z - x * x - y * y + w * w)
    rotation[0, 1], rotation[1, 0] = 2 * s * (x * y - z * w), 2 * s * (x * y + z * w)
    rotation[0, 2], rotation[2, 0] = 2 * s * (x * z + y * w), 2 * s * (x * z - y * w)
    rotation[1, 2], rotation[2, 1] = 2 * s * (y * z - x * w), 2 * s * (y * z + x * w)


class Guide(Value):
    """The smooth motion of a grip through n poses at the times 0, dt, 2 dt, ...

    Position and quaternion are cubic splines with continuous second derivatives (the quaternion is
    normalized), so that velocities and accelerations are continuous: inertia feels no jerk that is
    not in the poses. Between two neighbors a grip turns the shorter way.

    Parameters
    ----------
    poses : sequence of Pose
        The n poses.
    dt : float
        Time step in s.
    at_rest : bool, optional
        Whether the velocity is zero at time 0; else it is what the poses say.
    """

    _PARTS = ('poses', 'dt', 'at_rest')

    poses: tuple[Pose, ...]
    dt: float
    at_rest: bool
    _spline: Any

    def __init__(self, poses: Sequence[Pose], dt: float, at_rest: bool = True):
        put(self, poses=tuple(poses), dt=dt, at_rest=at_rest, _spline=None)
        first = self.poses[0]
        if any(pose is not first and pose != first for pose in self.poses):
            put(self, _spline=_spline(self.poses, at_rest))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in self._PARTS)

    def at(self, place: float) -> Pose:
        """Return the Pose at `place` = time / dt."""
        nearest = round(place)
        if self._spline is None or place == nearest and 0 <= nearest < len(self.poses):
            return self.poses[0 if self._spline is None else nearest]
        values = self._spline(place)
        return Pose(values[:3], values[3:])

    def along(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """Return rotations (k, 3, 3), positions (k, 3), `twist`s (k, 6) at `places` (k,)."""
        if self._spline is None:
            first, many = self.poses[0], (len(places), 1)
            return (np.tile(first.rotation, (*many, 1)), np.tile(first.position, many),
                    np.zeros((len(places), 6)))
        return along_spline(self._cubics, len(self.poses), self.dt, places, *self._given)

    @cached_property
    def _cubics(self) -> Floats:
        """(4, n - 1, 7) coefficients of the spline."""
        spline: Any = self._spline  # there is one where the poses differ
        return np.ascontiguousarray(spline.c)

    @cached_property
    def _given(self) -> tuple[Floats, Floats]:
        """What `along` returns for the poses: not as the spline rounds them."""
        return (np.array([pose.rotation for pose in self.poses]),
                np.array([pose.position for pose in self.poses]))


def _spline(poses: Sequence[Pose], at_rest: bool) -> Any:
    values = np.empty((len(poses), 7))
    values[:, :3] = [pose.position for pose in poses]
    values[:, 3:] = [pose.quaternion for pose in poses]
    turned = np.sum(values[1:, 3:] * values[:-1, 3:], axis=1) < 0
    values[1:, 3:] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    n = len(values)
    ends: list[Any] = ['not-a-knot', 'not-a-knot']
    if at_rest:
        ends[0] = (1, np.zeros(7))
        if n == 2:  # constant acceleration, as not-a-knot would make it
            ends[1] = (1, 2 * (values[1] - values[0]))
    return scipy.interpolate.CubicSpline(np.arange(n), values, bc_type=tuple(ends))


class Grips(Value):
    """All that holds a DLO in motion.

    Parameters
    ----------
    gripper : Guide
        Motion of the gripper.
    far_end : Guide, optional
        Motion of the far end. None where it is free.
    grip : str, optional
        Grip of `FarEnd`; unused where it is free.
    """

    _PARTS = ('gripper', 'far_end', 'grip')

    gripper: Guide
    far_end: Guide | None
    grip: str

    def __init__(self, gripper: Guide, far_end: Guide | None = None, grip: str = 'clamped'):
        put(self, gripper=gripper, far_end=far_end, grip=grip)

    def at(self, place: float) -> tuple[Pose, FarEnd | None]:
        """Return the gripper's Pose and the FarEnd, or None, at `place` = time / dt."""
        end = None if self.far_end is None else FarEnd(self.far_end.at(place), self.grip)
        return self.gripper.at(place), end


def poses(grippers: Iterable[Pose], least: int = 0) -> tuple[Pose, ...]:
    """Return a sequence of Poses as a tuple of `least` or more; raise InvalidTask."""
    given = items('grippers', grippers, object, least=least)
    return tuple(instance(f'grippers[{index}]: gripper', gripper, Pose)
                 for index, gripper in enumerate(given))


def ends_of(far_ends: Iterable[Any] | None, count: int) -> list[FarEnd | None]:
    """Return a FarEnd, or None, for each of `count` gripper poses; raise InvalidTask."""
    if far_ends is None:
        return [None] * count
    given: tuple[Any, ...] = items('far_ends', far_ends, object)
    ends = [FarEnd.of(end) for end in given]
    if len(ends) != count:
        raise InvalidTask(f'far_ends has {len(ends)} entries: expected one per gripper pose, '
                          f'{count}')
    return ends


def moving_grips(grippers: Sequence[Pose], ends: Sequence[FarEnd | None], dt: float, at_rest: bool,
                 initial: Shape | None) -> Grips:
    """Return the smooth motion of what holds a DLO, at instants `dt` (s) apart."""
    if len({None if end is None else end.grip for end in ends}) > 1:
        raise InvalidTask('far_ends: expected the same grip from the beginning to the end of a '
                          'motion')
    if initial is not None and initial.far_end is not None and ends[0] is None:
        raise InvalidTask('initial is held at its far end: expected a Shape whose far end is '
                          'free, as it is in the motion, or far_ends')
    gripper = Guide(grippers, dt, at_rest)
    if ends[0] is None:
        return Grips(gripper)
    held = [end.pose for end in ends if end is not None]
    return Grips(gripper, Guide(held, dt, at_rest), ends[0].grip)
