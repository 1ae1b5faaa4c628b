# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Position and orientation in the world frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, shown, vector
from dlo_planner.model.checks import direction as unit
from dlo_planner.model.value import Value, brief, figures, put

_UNIT = np.eye(3)
_HARDLY, _NEARLY = 1e-9, 1e-5  # off a rotation matrix: as computed; as it may be given
_ROUNDING = 1e-15              # of a unit quaternion's norm
WORLD_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False, repr=False)
class Pose(Value):
    """A right-handed frame in the world.

    The gripper's x axis is the DLO's tangent where it leaves the gripper; a cut-out's x axis is
    the direction in which the free end travels through it.

    Attributes
    ----------
    position : ndarray, shape (3,)
        Origin in m, world frame.
    quaternion : ndarray, shape (4,)
        Components x, y, z, w. It is normalized; its sign is kept.
    rotation : ndarray, shape (3, 3)
        Columns are the frame's x, y, z axes in the world.

    Raises
    ------
    InvalidTask
        A component is not finite, or the quaternion is (nearly) zero.
    """

    position: Floats
    quaternion: Floats
    rotation: Floats = field(init=False, compare=False)

    if TYPE_CHECKING:  # what may be given
        def __init__(self, position: ArrayLike, quaternion: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        position = vector('Pose.position', self.position, 3)
        quaternion = vector('Pose.quaternion', self.quaternion, 4)
        components = quaternion.tolist()
        size = max(map(abs, components))
        if size < 1e-6:
            raise InvalidTask(
                f'Pose.quaternion = {components}: expected a unit quaternion x, y, z, w')
        norm = size * math.hypot(*(one / size for one in components))
        if abs(norm - 1) > _ROUNDING:  # so that a pose made of a pose's parts is the same
            quaternion = quaternion / norm
        rotation = _rotation_of(*quaternion.tolist())
        for content in (position, quaternion, rotation):  # all new: nobody else has them
            content.flags.writeable = False
        put(self, position=position, quaternion=quaternion, rotation=rotation)

    def __repr__(self) -> str:
        return brief(self, figures(self.position), figures(self.quaternion))

    @property
    def matrix(self) -> Floats:
        """Homogeneous transform (4, 4) from this frame to the world."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.position
        return matrix

    @property
    def direction(self) -> Floats:
        """The x axis (3,), which is the DLO's tangent or the cut-out's normal, world frame."""
        return self.rotation[:, 0]

    @classmethod
    def identity(cls) -> Pose:
        """Return the world frame itself."""
        return cls((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))

    @classmethod
    def from_rotation(cls, position: ArrayLike, rotation: ArrayLike) -> Pose:
        """Return the pose with the given origin (3,) and axes (3, 3), made orthonormal.

        Raises
        ------
        InvalidTask
            The axes are not a rotation: orthonormal to 1e-5 and right-handed.
        """
        if type(rotation) is not np.ndarray or rotation.dtype != float or rotation.shape != (3, 3):
            rotation = array('rotation', rotation, (3, 3))
        drift = rotation.T @ rotation - _UNIT
        off = np.abs(drift).max()
        if not off < _NEARLY or _volume(rotation) < 0:
            raise InvalidTask(f'rotation = {shown(rotation.tolist())}: expected orthonormal, '
                              'right-handed axes')
        # Newton's method for the nearest rotation; the quaternion is made when it is asked for.
        rotation = rotation - 0.5 * rotation @ drift
        if off > _HARDLY:
            rotation = rotation - 0.5 * rotation @ (rotation.T @ rotation - _UNIT)
        return pose_of(vector('Pose.position', position, 3), rotation)

    def __getattr__(self, name: str) -> Floats:
        """Make the quaternion of a pose that came from axes."""
        if name != 'quaternion' or 'rotation' not in self.__dict__:
            raise AttributeError(f'{type(self).__name__} has no attribute {name!r}')
        quaternion = quaternions_of(self.rotation[None])[0]
        quaternion.flags.writeable = False
        put(self, quaternion=quaternion)
        result: Floats = quaternion
        return result

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Pose:
        """Return the pose of a (4, 4) homogeneous transform.

        Raises
        ------
        InvalidTask
            Not a rigid transform (rotation orthonormal to 1e-5, last row 0 0 0 1).
        """
        matrix = array('matrix', matrix, (4, 4))
        if not np.allclose(matrix[3], (0, 0, 0, 1), rtol=0, atol=1e-9):
            raise InvalidTask(f'matrix = {shown(matrix.tolist())}: expected a rigid transform, its '
                              'last row 0, 0, 0, 1')
        try:
            return cls.from_rotation(matrix[:3, 3], matrix[:3, :3])
        except InvalidTask as error:
            raise InvalidTask(f'matrix: expected a rigid transform; {error}') from None

    @classmethod
    def looking_along(cls, position: ArrayLike, direction: ArrayLike) -> Pose:
        """Return the pose whose x axis is `direction` and whose z axis points as far up as it can.

        For a vertical direction, the y axis is that of the world.

        Parameters
        ----------
        position : array_like, shape (3,)
            Position in m.
        direction : array_like, shape (3,)
            Direction, of any length but zero.
        """
        # in plain numbers: NumPy takes as long for vectors of three as a shape takes to be found
        a, b, c = unit('direction', direction).tolist()
        level = math.hypot(a, b)
        # near the vertical the level part is noise; world y is then the stable choice
        y = (-b / level, a / level, 0.0) if level > 1e-9 else (0.0, 1.0, 0.0)
        along = y[0] * a + y[1] * b
        y = (y[0] - along * a, y[1] - along * b, -along * c)
        norm = math.hypot(*y)
        d, e, f = (one / norm for one in y)
        rotation = 0.0 + np.array([  # of -0, which messages would show, 0
            [a, d, b * f - c * e], [b, e, c * d - a * f], [c, f, a * e - b * d]])
        return pose_of(vector('Pose.position', position, 3), rotation)

    def compose(self, other: Pose) -> Pose:
        """Return self * other: the pose `other`, given in this frame, in the world frame."""
        instance('other', other, Pose)
        return Pose.from_rotation(self.position + self.rotation @ other.position,
                                  self.rotation @ other.rotation)

    def inverse(self) -> Pose:
        """Return the pose of the world in this frame."""
        return Pose.from_rotation(-self.rotation.T @ self.position, self.rotation.T)


def pose_of(position: Floats, rotation: Floats) -> Pose:
    """Return the Pose of a position (3,), m, and a rotation (3, 3): nothing is to be judged."""
    pose = object.__new__(Pose)
    put(pose, position=position, rotation=rotation)
    position.flags.writeable = rotation.flags.writeable = False
    return pose


def shifted(pose: Pose, displacement: Floats) -> Pose:
    """Return a Pose with its origin displaced by (3,) m."""
    position, other = pose.position + displacement, object.__new__(Pose)
    position.flags.writeable = False
    object.__setattr__(other, '__dict__', pose.__dict__ | {'position': position})
    return other


def angle_between(one: Floats, other: Floats) -> float:
    """Return the angle in rad between two orientations (3, 3), as exact near 0 as near pi."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (one.T @ other).tolist()  # numbers are quicker
    return math.atan2(math.hypot(zy - yz, xz - zx, yx - xy), xx + yy + zz - 1)


def displaced(pose: Pose, twist: Floats) -> Pose:
    """Return a Pose turned about its origin and then shifted.

    Shapes: twist (6,).
    """
    return Pose.from_rotation(pose.position + twist[3:], turned_by(twist[:3]) @ pose.rotation)


def turned_by(vector: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) of a rotation vector (3,), rad, by its quaternion."""
    x, y, z = vector.tolist()
    angle = math.hypot(x, y, z)
    share = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return _rotation_of(share * x, share * y, share * z, math.cos(0.5 * angle))


def quaternions_of(rotations: Floats) -> Floats:
    """Return x, y, z, w (n, 4) of rotations (n, 3, 3), a third of the time that SciPy takes.

    4 q q^T of each is known by its rotation; its row with the largest diagonal is taken
    (Shepperd 1978).
    """
    trace = np.trace(rotations, axis1=1, axis2=2)
    products = np.empty((len(rotations), 4, 4))
    products[:, :3, :3] = rotations + rotations.swapaxes(1, 2)
    products[:, 3, :3] = products[:, :3, 3] = (
        rotations[:, (2, 0, 1), (1, 2, 0)] - rotations[:, (1, 2, 0), (2, 0, 1)])
    squares = products.diagonal(axis1=1, axis2=2).copy()
    squares[:, :3] += (1.0 - trace)[:, None]
    squares[:, 3] = 1.0 + trace
    products[:, range(4), range(4)] = squares
    rows = products[np.arange(len(rotations)), squares.argmax(axis=1)]
    result: Floats = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return result


def _rotation_of(x: float, y: float, z: float, w: float) -> Floats:
    """Return (3, 3) of a unit quaternion: SciPy's `Rotation` is ten times as slow for a single one.

    Diebel 2006, Representing attitude, eq. 125.
    """
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    return np.array([[xx - yy - zz + ww, 2 * (xy - zw), 2 * (xz + yw)],
                     [2 * (xy + zw), yy - xx - zz + ww, 2 * (yz - xw)],
                     [2 * (xz - yw), 2 * (yz + xw), zz - xx - yy + ww]])


def _volume(m: Floats) -> float:
    """Return the determinant of a 3 x 3 matrix."""
    (a, b, c), (d, e, f), (g, h, i) = m.tolist()
    return float(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))
