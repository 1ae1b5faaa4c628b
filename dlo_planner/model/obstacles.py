"""What a DLO may touch: plane, sphere, capsule, box, and sheet with cut-outs."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import number, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose

_FLUSH = 1e-6  # of the sheet's size, and rad: how far a cut-out may lie off its middle plane


@dataclass(frozen=True)
class Plane:
    """A floor or wall that fills everything behind it.

    Attributes:
        point: (3,) m, on the surface
        normal: (3,) any length but zero, pointing away from the solid
        friction: Coulomb's coefficient, >= 0
    """

    point: np.ndarray
    normal: np.ndarray
    friction: float = 0.0

    def __post_init__(self):
        _put(self, point=vector('Plane.point', self.point, 3),
             normal=_direction('Plane.normal', self.normal), friction=_friction(self))


@dataclass(frozen=True)
class Sphere:
    """A ball; centre (3,) m, radius m, friction: Coulomb's coefficient."""

    centre: np.ndarray
    radius: float
    friction: float = 0.0

    def __post_init__(self):
        _put(self, centre=vector('Sphere.centre', self.centre, 3),
             radius=number('Sphere.radius', self.radius, above=0), friction=_friction(self))


@dataclass(frozen=True)
class Capsule:
    """A round bar with round ends: all that is within `radius` of the line from start to end.

    Attributes:
        start, end: (3,) m, different
        radius: m
        friction: Coulomb's coefficient
    """

    start: np.ndarray
    end: np.ndarray
    radius: float
    friction: float = 0.0

    def __post_init__(self):
        _put(self, start=vector('Capsule.start', self.start, 3),
             end=vector('Capsule.end', self.end, 3),
             radius=number('Capsule.radius', self.radius, above=0), friction=_friction(self))
        if np.linalg.norm(self.end - self.start) < 1e-9 * self.radius:
            raise InvalidTask(f'Capsule.end = {self.end.tolist()}: expected another point than '
                              'start (a Sphere has one centre)')


@dataclass(frozen=True)
class Box:
    """A block; pose of its centre, full sizes (3,) m along the pose's axes, friction."""

    pose: Pose
    size: np.ndarray
    friction: float = 0.0

    def __post_init__(self):
        _pose(self)
        size = vector('Box.size', self.size, 3)
        if (size <= 0).any():
            raise InvalidTask(f'Box.size = {size.tolist()}: expected three lengths > 0')
        _put(self, size=size, friction=_friction(self))


@dataclass(frozen=True)
class Sheet:
    """A flat plate with cut-outs; its pose is that of its centre, x axis = normal.

    Attributes:
        pose: Pose of the middle of the plate
        width, height: m along the pose's y and z axes
        thickness: m, may be 0
        cutouts: CutOuts with a size, centred in the middle plane, normal to it
        friction: Coulomb's coefficient

    Raises:
        InvalidTask: a cut-out without size, or one that does not lie in the sheet
    """

    pose: Pose
    width: float
    height: float
    thickness: float = 1e-3
    cutouts: tuple[CutOut, ...] = ()
    friction: float = 0.0

    def __post_init__(self):
        _pose(self)
        cutouts = (self.cutouts,) if isinstance(self.cutouts, CutOut) else tuple(self.cutouts)
        _put(self, width=number('Sheet.width', self.width, above=0),
             height=number('Sheet.height', self.height, above=0),
             thickness=number('Sheet.thickness', self.thickness, minimum=0),
             cutouts=cutouts, friction=_friction(self))
        for index, cutout in enumerate(cutouts):
            self._check(f'Sheet.cutouts[{index}]', cutout)

    @classmethod
    def around(cls, cutout, width=0.4, height=0.4, thickness=1e-3, friction=0.0):
        """Return a sheet centred at the one cut-out that it has."""
        return cls(cutout.pose, width, height, thickness, (cutout,), friction)

    def _check(self, name, cutout):
        if not isinstance(cutout, CutOut) or (cutout.radius is None and cutout.width is None):
            raise InvalidTask(f'{name} = {cutout!r}: expected a CutOut with radius or width')
        local = self.pose.rotation.T @ (cutout.centre - self.pose.position)
        tilt = np.linalg.norm(np.cross(self.pose.direction, cutout.normal))
        if abs(local[0]) > _FLUSH * max(self.width, self.height) or tilt > _FLUSH:
            raise InvalidTask(f'{name}: expected its centre in the sheet\'s middle plane and its '
                              f'normal along the sheet\'s, got {local[0]:.3g} m and {tilt:.3g} off')
        reach = cutout.radius if cutout.radius is not None else min(cutout.width,
                                                                    cutout.height) / 2
        if (np.abs(local[1:]) + reach > np.array([self.width, self.height]) / 2).any():
            raise InvalidTask(f'{name}: expected to lie within the sheet of {self.width:g} m by '
                              f'{self.height:g} m')


OBSTACLES = (Plane, Sphere, Capsule, Box, Sheet)


def _put(self, **values):
    for name, value in values.items():
        object.__setattr__(self, name, value)


def _friction(self):
    return number(f'{type(self).__name__}.friction', self.friction, minimum=0)


def _pose(self):
    if not isinstance(self.pose, Pose):
        raise InvalidTask(f'{type(self).__name__}.pose = {self.pose!r}: expected a Pose')


def _direction(name, value):
    value = vector(name, value, 3)
    size = np.linalg.norm(value)
    if size == 0:
        raise InvalidTask(f'{name} = {value.tolist()}: expected a vector that is not zero')
    return value / size
