"""Position and orientation in the world frame."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import vector

_UNIT = np.eye(3)
_HARDLY = 1e-6  # off a rotation matrix
WORLD_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Pose:
    """A right-handed frame in the world.

    The gripper's x axis is the DLO's tangent where it leaves the gripper; a cut-out's x axis is
    the direction in which the free end travels through it. Copy an array before changing it.

    Attributes:
        position: (3,) origin, metres, world frame
        quaternion: (4,) x, y, z, w; normalised here; its sign is kept
        rotation: (3, 3) columns are the frame's x, y, z axes in the world

    Raises:
        InvalidTask: a component is not finite, or the quaternion is (nearly) zero
    """

    position: np.ndarray
    quaternion: np.ndarray
    rotation: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        position = vector('Pose.position', self.position, 3)
        quaternion = vector('Pose.quaternion', self.quaternion, 4)
        norm = np.linalg.norm(quaternion)
        if norm < 1e-6:
            raise InvalidTask(
                f'Pose.quaternion = {quaternion.tolist()}: expected a unit quaternion x, y, z, w')
        quaternion = quaternion / norm
        rotation = Rotation.from_quat(quaternion).as_matrix()
        for name, value in (('position', position), ('quaternion', quaternion),
                            ('rotation', rotation)):
            object.__setattr__(self, name, value)

    def __eq__(self, other):
        if not isinstance(other, Pose):
            return NotImplemented
        return (np.array_equal(self.position, other.position)
                and np.array_equal(self.quaternion, other.quaternion))

    def __hash__(self):
        return hash((self.position.tobytes(), self.quaternion.tobytes()))

    @property
    def matrix(self):
        """(4, 4) homogeneous transform from this frame to the world."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.position
        return matrix

    @property
    def direction(self):
        """(3,) the x axis: DLO tangent or cut-out normal, world frame."""
        return self.rotation[:, 0]

    @classmethod
    def identity(cls):
        """Return the world frame itself."""
        return cls((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))

    @classmethod
    def from_rotation(cls, position, rotation):
        """Return the pose with the given origin (3,) and axes (3, 3), made orthonormal."""
        rotation = np.asarray(rotation, dtype=float)
        square = rotation.T @ rotation if rotation.shape == (3, 3) else np.full((3, 3), np.inf)
        drift = square - _UNIT
        if not np.abs(drift).max() < _HARDLY or _volume(rotation) < 0:
            return cls(position, Rotation.from_matrix(rotation).as_quat())
        # Nearly a rotation, as all are that the simulators make: one step of Newton's method for
        # the nearest one, and the quaternion only when it is asked for.
        pose = object.__new__(cls)
        object.__setattr__(pose, 'position', vector('Pose.position', position, 3))
        object.__setattr__(pose, 'rotation', rotation - 0.5 * rotation @ drift)
        return pose

    def __getattr__(self, name):
        """Make the quaternion of a pose that came from axes."""
        if name != 'quaternion' or 'rotation' not in self.__dict__:
            raise AttributeError(name)
        quaternion = Rotation.from_matrix(self.rotation).as_quat()
        object.__setattr__(self, 'quaternion', quaternion)
        return quaternion

    @classmethod
    def from_matrix(cls, matrix):
        """Return the pose of a (4, 4) homogeneous transform.

        Raises:
            InvalidTask: not a rigid transform (rotation orthonormal to 1e-6, last row 0 0 0 1)
        """
        matrix = np.asarray(matrix, dtype=float)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise InvalidTask(f'matrix: expected 4 x 4 finite numbers, got shape {matrix.shape}')
        rotation = matrix[:3, :3]
        rigid = (np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-6)
                 and np.linalg.det(rotation) > 0
                 and np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-9))
        if not rigid:
            raise InvalidTask(f'matrix = {matrix.tolist()}: expected a rigid transform')
        return cls.from_rotation(matrix[:3, 3], rotation)

    @classmethod
    def looking_along(cls, position, direction):
        """Return the pose whose x axis is `direction` and whose z axis is as far up as it can be.

        For a vertical direction, where no roll is more level than another, y stays world y.

        Args:
            position: (3,) metres
            direction: (3,) any length but zero
        """
        direction = vector('direction', direction, 3)
        length = np.linalg.norm(direction)
        if length == 0:
            raise InvalidTask(
                f'direction = {direction.tolist()}: expected a vector that is not zero')
        x = direction / length
        y = np.cross(WORLD_UP, x)
        # Near the vertical the cross product is noise; world y is then the stable choice.
        y = y / np.linalg.norm(y) if np.linalg.norm(y) > 1e-9 else np.array([0.0, 1.0, 0.0])
        y = y - (y @ x) * x
        y /= np.linalg.norm(y)
        return cls.from_rotation(position, np.column_stack([x, y, np.cross(x, y)]))

    def compose(self, other):
        """Return self * other: the pose `other`, given in this frame, seen from the world."""
        return Pose.from_rotation(self.position + self.rotation @ other.position,
                                  self.rotation @ other.rotation)

    def inverse(self):
        """Return the pose of the world in this frame."""
        return Pose.from_rotation(-self.rotation.T @ self.position, self.rotation.T)


def _volume(m):
    """Return the determinant of a 3 x 3 matrix."""
    (a, b, c), (d, e, f), (g, h, i) = m.tolist()
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
