# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Goals, or penalties: what a shape should be like. The sum of the squares of residuals counts.

Each has  residuals(shape) -> (k,)  and  slopes(shape, sensitivity) -> (k, 6), derivatives by
rotation (rad) and displacement (m) of the gripper, with the `Sensitivity` of the shape. Where
`ARC_LENGTHS` names attributes, they may not be beyond the DLO's length. `Plan.goals` says them for
each waypoint.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.energy.scene import Scene, build_scene
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.kinematics import nearest_place
from dlo_planner.geometry.so3 import left_jacobian, turn_between
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import direction, instance, items, number, shown, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put
from dlo_planner.plan.clearance import nearest, nearest_in_hole

_ENDLESS = 1e6  # times a hole: the sheet around it
_POINTS = 9  # of a stretch, at which its tangent is looked at, evenly


class Residuals(Protocol):
    """A penalty: the sum of the squares of its residuals."""

    def residuals(self, shape: Shape) -> Floats:
        """Return (k,)."""

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        """Return (k, 6), derivatives by rotation (rad) and displacement (m) of the gripper."""


class Goal(Value, ABC):
    """Base of what follows: a weight, and residuals and slopes per unit of it."""

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ()
    weight: float

    def __post_init__(self) -> None:
        """Check weight and arc lengths."""
        name = type(self).__name__
        put(self, weight=number(f'{name}.weight', self.weight, above=0), **{
            one: number(f'{name}.{one}', getattr(self, one), minimum=0)
            for one in self.ARC_LENGTHS})
        super().__post_init__()

    def residuals(self, shape: Shape) -> Floats:
        """Return (k,): by how much a shape misses it, times the weight."""
        return self.weight * self._residuals(instance('shape', shape, Shape))

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        """Return (k, 6), derivatives by rotation (rad) and displacement (m) of the gripper."""
        instance('shape', shape, Shape)
        if instance('sensitivity', sensitivity, Sensitivity).shape.s.size != shape.s.size:
            raise InvalidTask(f'shape = {shape!r}: expected the one of the sensitivity')
        return self.weight * self._slopes(shape, sensitivity)

    @abstractmethod
    def _residuals(self, shape: Shape) -> Floats:
        """Return (k,) at a weight of 1."""

    @abstractmethod
    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        """Return (k, 6) at a weight of 1."""


def cross_matrix(v: Floats) -> Floats:
    """Return the matrix (3, 3) of turn x v, the change of a vector v (3,) by a rotation `turn`."""
    x, y, z = v.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


@dataclass(frozen=True, eq=False, repr=False)
class PositionAt(Goal):
    """The DLO's point at arc length s (m) lies at `target` (3,) m; weight 1/m."""

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('s',)

    s: float
    target: Floats
    weight: float = 1.0

    if TYPE_CHECKING:  # what may be given, here and below
        def __init__(self, s: float, target: ArrayLike, weight: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, target=vector('PositionAt.target', self.target, 3))
        super().__post_init__()

    def _residuals(self, shape: Shape) -> Floats:
        off: Floats = shape.frame_at(self.s)[1] - self.target
        return off

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        return sensitivity.at(self.s)[3:]


@dataclass(frozen=True, eq=False, repr=False)
class DirectionAt(Goal):
    """The DLO's tangent at arc length s (m) is along `direction` (3,); weight 1/rad.

    The residuals are the difference of two unit vectors.
    """

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('s',)

    s: float
    direction: Floats
    weight: float = 1.0

    if TYPE_CHECKING:
        def __init__(self, s: float, direction: ArrayLike,
                     weight: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, direction=direction('DirectionAt.direction', self.direction))
        super().__post_init__()

    def _residuals(self, shape: Shape) -> Floats:
        off: Floats = shape.frame_at(self.s)[0][:, 0] - self.direction
        return off

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        return cross_matrix(shape.frame_at(self.s)[0][:, 0]) @ sensitivity.at(self.s)[:3]


@dataclass(frozen=True, eq=False, repr=False)
class FrameAt(Goal):
    """The DLO's frame at arc length s (m) is a pose, as that of a plug in its socket.

    The residuals (6,) are a rotation vector before a displacement.

    Attributes
    ----------
    s : float
        Arc length, m.
    pose : Pose
        Where the frame should be: the x axis along the DLO.
    weight : float
        Weight in 1/m of displacement and 1/rad of rotation.
    """

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('s',)

    s: float
    pose: Pose
    weight: float = 1.0

    def __post_init__(self) -> None:
        instance('FrameAt.pose', self.pose, Pose)
        super().__post_init__()

    def _residuals(self, shape: Shape) -> Floats:
        axes, position = shape.frame_at(self.s)
        return np.concatenate([turn_between(self.pose.rotation, axes),
                               position - self.pose.position])

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        slopes = np.array(sensitivity.at(self.s))
        turn = turn_between(self.pose.rotation, shape.frame_at(self.s)[0])
        slopes[:3] = np.linalg.solve(left_jacobian(turn), slopes[:3])
        return slopes


@dataclass(frozen=True, eq=False, repr=False)
class GripperNear(Goal):
    """The gripper stays near a pose. With a small weight it makes an ambiguous answer unique.

    The slopes of the rotation are to first order about the pose.

    Attributes
    ----------
    pose : Pose
    weight : float
        Weight in 1/m of displacement and 1/rad of rotation.
    """

    pose: Pose
    weight: float = 1e-3

    def __post_init__(self) -> None:
        instance('GripperNear.pose', self.pose, Pose)
        super().__post_init__()

    def _residuals(self, shape: Shape) -> Floats:
        return np.concatenate([turn_between(self.pose.rotation, shape.gripper.rotation),
                               shape.gripper.position - self.pose.position])

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        return np.eye(6)


@dataclass(frozen=True, eq=False, repr=False)
class Through(Goal):
    """The DLO passes a point at any arc length; a DLO that ends before it is extended straight.

    Attributes
    ----------
    point : ndarray, shape (3,)
        Point in m.
    after : float
        Arc length beyond which it should pass there, m.
    weight : float
        Weight in 1/m.
    """

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('after',)

    point: Floats
    after: float = 0.0
    weight: float = 1.0

    if TYPE_CHECKING:
        def __init__(self, point: ArrayLike, after: float = 0.0,
                     weight: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, point=vector('Through.point', self.point, 3))
        super().__post_init__()

    def passage(self, shape: Shape) -> float:
        """Return the arc length nearest to the point, m; beyond L where the DLO ends before it."""
        return self.nearest(instance('shape', shape, Shape))[0]

    def _residuals(self, shape: Shape) -> Floats:
        off: Floats = self.nearest(shape)[1][0]
        return off

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        s, (off, tangent, turn) = self.nearest(shape)
        beyond = max(s - float(shape.s[-1]), 0.0)
        by_twist = sensitivity.at(s - beyond)
        turned = cross_matrix(tangent) @ by_twist[:3]        # change of the tangent, (3, 6)
        moved: Floats = by_twist[3:] + beyond * turned
        if self.after < s:  # the nearest arc length changes too
            along = (tangent @ moved + off @ turned) / (1 + off @ turn)
            moved = moved - np.outer(tangent, along)
        return moved

    def nearest(self, shape: Shape) -> tuple[float, Floats]:
        """Return the arc length of the passage, m; the DLO there less the point, its tangent, turn.

        The latter are rows (3, 3) in m, 1 and 1/m.
        """
        instance('shape', shape, Shape)
        place = np.empty((3, 3))
        s = nearest_place(shape.s, *kernel_arrays(shape), np.array(self.point), self.after, place)
        return float(s), place


@dataclass(frozen=True, eq=False, repr=False)
class AwayFrom(Goal):
    """The DLO's surface keeps a distance from obstacles (of the simulator or not).

    The residuals are by how much the distance is too small, one number per body.

    Attributes
    ----------
    obstacles : tuple of obstacle
        Plane, Sphere, Capsule, Cylinder, Box or Sheet, in any number.
    distance : float
        Distance in m.
    radius : float
        Radius of the DLO, m.
    weight : float
        Weight in 1/m.
    """

    obstacles: tuple[Obstacle, ...]
    distance: float
    radius: float = 0.0
    weight: float = 1.0

    if TYPE_CHECKING:
        def __init__(self, obstacles: Iterable[Obstacle], distance: float,
                     radius: float = 0.0, weight: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, obstacles=items('AwayFrom.obstacles', self.obstacles, OBSTACLES, least=1),
            **{name: number(f'AwayFrom.{name}', getattr(self, name), minimum=0)
               for name in ('distance', 'radius')})
        super().__post_init__()

    @cached_property
    def _scene(self) -> Scene:
        scene: Scene = build_scene(self.obstacles, self.radius, sharp=True)
        return scene

    def _residuals(self, shape: Shape) -> Floats:
        gaps = np.array([gap for gap, _, _ in nearest(self._scene, shape)])
        return np.maximum(self.distance - gaps, 0.0)

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        # to first order the same point stays the nearest
        return np.array([-(normal @ sensitivity.at(s)[3:]) * (gap < self.distance)
                         for gap, s, normal in nearest(self._scene, shape)]).reshape(-1, 6)


@dataclass(frozen=True, eq=False, repr=False)
class InHole(Goal):
    """The DLO's surface keeps a distance from the sheet around a cut-out, through which it passes.

    The residual is by how much the clearance in the hole is too small, the smallest one of the rim
    and of what is before the sheet and behind it. A DLO that meets the sheet beside the hole has a
    negative one and is drawn to the hole; one that does not reach the sheet keeps away from it.

    Attributes
    ----------
    cutout : CutOut
        With a size.
    distance : float
        Distance in m.
    radius : float
        Radius of the DLO, m.
    thickness : float
        Thickness of the sheet, which has no end, m.
    weight : float
        Weight in 1/m.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    cutout: CutOut
    distance: float
    radius: float = 0.0
    thickness: float = 0.0
    weight: float = 1.0

    def __post_init__(self) -> None:
        instance('InHole.cutout', self.cutout, CutOut)
        if self.cutout.radius is None and self.cutout.width is None:
            raise InvalidTask(f'InHole.cutout = {shown(self.cutout)}: expected a CutOut with '
                              'radius or width')
        put(self, **{name: number(f'InHole.{name}', getattr(self, name), minimum=0)
                     for name in ('distance', 'radius', 'thickness')})
        super().__post_init__()

    @cached_property
    def _scene(self) -> Scene:
        cutout = self.cutout
        size = cutout.radius or max(cutout.width or 0.0, cutout.height or 0.0)
        wide = _ENDLESS * size
        scene: Scene = build_scene((Sheet(cutout.pose, wide, wide, self.thickness, (cutout,)),),
                                   self.radius, sharp=True)
        return scene

    def _nearest(self, shape: Shape) -> tuple[float, float, Floats]:
        return nearest_in_hole(self._scene, np.array(self.cutout.normal), shape)

    def _residuals(self, shape: Shape) -> Floats:
        return np.array([max(self.distance - self._nearest(shape)[0], 0.0)])

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        # to first order the same point stays the nearest
        gap, s, slope = self._nearest(shape)
        rows: Floats = -(slope @ sensitivity.at(s)[3:])[None] * (gap < self.distance)
        return rows


@dataclass(frozen=True, eq=False, repr=False)
class BentAtMost(Goal):
    """The DLO is nowhere bent more sharply than this.

    The residuals are the excess of each element; their squares add up to the mean square.

    Attributes
    ----------
    curvature : float
        Curvature in 1/m, the inverse of the bend radius.
    weight : float
        Weight in m.
    """

    curvature: float
    weight: float = 1.0

    def __post_init__(self) -> None:
        put(self, curvature=number('BentAtMost.curvature', self.curvature, minimum=0))
        super().__post_init__()

    def _residuals(self, shape: Shape) -> Floats:
        excess = np.hypot(*shape.element_strains[:, 1:].T) - self.curvature
        residuals: Floats = np.sqrt(np.diff(shape.s) / shape.s[-1]) * np.maximum(excess, 0.0)
        return residuals

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        bend = shape.element_strains[:, 1:]
        size = np.hypot(*bend.T)
        share = np.sqrt(np.diff(shape.s) / shape.s[-1]) * (size > self.curvature)
        rows = np.einsum('ej,ejk->ek', bend, sensitivity.strains[:, 1:])
        slopes: Floats = (share / np.maximum(size, 1e-300))[:, None] * rows
        return slopes


@dataclass(frozen=True, eq=False, repr=False)
class KeepTangent(Goal):
    """The DLO's tangent keeps a direction on a stretch: the root mean square of its deviation.

    The residuals are differences of unit vectors, 3 at each of 9 points.

    Attributes
    ----------
    begin : float
        Arc length where the stretch begins, m.
    end : float
        Arc length where the stretch ends, m.
    direction : ndarray, shape (3,)
        Direction of the tangent, of any length but zero.
    weight : float
        Weight in 1/rad.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('begin', 'end')

    begin: float
    end: float
    direction: Floats
    weight: float = 1.0

    if TYPE_CHECKING:
        def __init__(self, begin: float, end: float, direction: ArrayLike,
                     weight: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        put(self, direction=direction('KeepTangent.direction', self.direction))
        super().__post_init__()
        if self.end < self.begin:
            raise InvalidTask(f'KeepTangent.end = {self.end:g}: expected at least begin = '
                              f'{self.begin:g}')

    def _residuals(self, shape: Shape) -> Floats:
        return np.concatenate([one.residuals(shape) for one in self._tangents])

    def _slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        return np.vstack([one.slopes(shape, sensitivity) for one in self._tangents])

    @property
    def _tangents(self) -> list[DirectionAt]:
        return [DirectionAt(s, self.direction, _POINTS**-0.5)
                for s in np.linspace(self.begin, self.end, _POINTS)]
