# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a shape should be like, as penalties: the sum of the squares of their residuals counts.

Each has  residuals(shape) -> (k,)  and  slopes(shape, sensitivity) -> (k, 6), derivatives by
rotation (rad) and displacement (m) of the gripper, with the `Sensitivity` of the shape. Where
`ARC_LENGTHS` names attributes, they may not be beyond the DLO's length.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.scene import build_scene
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import direction, instance, items, number, vector
from dlo_planner.model.obstacles import OBSTACLES
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put
from dlo_planner.plan.clearance import nearest
from dlo_planner.ritz.nearest_place import nearest_place
from dlo_planner.ritz.rotation import turn_between


def _length(penalty, name):
    return number(f'{type(penalty).__name__}.{name}', getattr(penalty, name), minimum=0)


def _weight(penalty):
    return number(f'{type(penalty).__name__}.weight', penalty.weight, above=0)


def judged(shape: object, *sensitivity: object) -> None:
    """Raise InvalidTask for what is no Shape, or a Sensitivity of another one."""
    instance('shape', shape, Shape)
    for one in sensitivity:
        if instance('sensitivity', one, Sensitivity).shape.s.size != shape.s.size:
            raise InvalidTask(f'shape = {shape!r}: expected the one of the sensitivity')


def _across(v):
    """Return the matrix (3, 3) that makes the change of a vector (3,) of a rotation: turn x v."""
    x, y, z = v.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


@dataclass(frozen=True, eq=False, repr=False)
class PositionAt(Value):
    """The DLO's point at arc length s (m) lies at `target` (3,) m; weight 1/m."""

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('s',)

    s: float
    target: np.ndarray
    weight: float = 1.0

    def __post_init__(self):
        put(self, s=_length(self, 's'), target=vector('PositionAt.target', self.target, 3),
            weight=_weight(self))
        super().__post_init__()

    def residuals(self, shape: Shape) -> np.ndarray:
        """Return (3,)."""
        judged(shape)
        return self.weight * (shape.frame_at(self.s)[1] - self.target)

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> np.ndarray:
        """Return (3, 6)."""
        judged(shape, sensitivity)
        return self.weight * sensitivity.at(self.s)[3:]


@dataclass(frozen=True, eq=False, repr=False)
class DirectionAt(Value):
    """The DLO's tangent at arc length s (m) is along `direction` (3,); weight 1/rad."""

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('s',)

    s: float
    direction: np.ndarray
    weight: float = 1.0

    def __post_init__(self):
        put(self, s=_length(self, 's'), weight=_weight(self),
            direction=direction('DirectionAt.direction', self.direction))
        super().__post_init__()

    def residuals(self, shape: Shape) -> np.ndarray:
        """Return (3,): the difference of two unit vectors."""
        judged(shape)
        return self.weight * (shape.frame_at(self.s)[0][:, 0] - self.direction)

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> np.ndarray:
        """Return (3, 6)."""
        judged(shape, sensitivity)
        tangent = shape.frame_at(self.s)[0][:, 0]
        return self.weight * (_across(tangent) @ sensitivity.at(self.s)[:3])


@dataclass(frozen=True, eq=False, repr=False)
class GripperNear(Value):
    """The gripper stays near a pose: weak, it makes an answer unique that is not.

    Attributes
    ----------
    pose : Pose
    weight : float
        Weight in 1/m of displacement and 1/rad of rotation.
    """

    pose: Pose
    weight: float = 1e-3

    def __post_init__(self):
        instance('GripperNear.pose', self.pose, Pose)
        put(self, weight=_weight(self))
        super().__post_init__()

    def residuals(self, shape: Shape) -> np.ndarray:
        """Return (6,)."""
        judged(shape)
        turn = turn_between(self.pose.rotation, shape.gripper.rotation)
        away = shape.gripper.position - self.pose.position
        return self.weight * np.concatenate([turn, away])

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> np.ndarray:
        """Return (6, 6); the rotation's to first order about the pose."""
        judged(shape, sensitivity)
        return self.weight * np.eye(6)


@dataclass(frozen=True, eq=False, repr=False)
class Through(Value):
    """The DLO passes a point, wherever along it; a DLO that ends before aims at it, straight on.

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

    point: np.ndarray
    after: float = 0.0
    weight: float = 1.0

    def __post_init__(self):
        put(self, point=vector('Through.point', self.point, 3), after=_length(self, 'after'),
            weight=_weight(self))
        super().__post_init__()

    def passage(self, shape: Shape) -> float:
        """Return the arc length that is nearest to the point, m; beyond L if it only aims."""
        judged(shape)
        return self._nearest(shape)[0]

    def residuals(self, shape: Shape) -> np.ndarray:
        """Return (3,)."""
        judged(shape)
        return self.weight * self._nearest(shape)[1][0]

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> np.ndarray:
        """Return (3, 6); the nearest arc length gives way."""
        judged(shape, sensitivity)
        s, (off, tangent, turn) = self._nearest(shape)
        beyond = max(s - float(shape.s[-1]), 0.0)
        by_twist = sensitivity.at(s - beyond)
        turned = _across(tangent) @ by_twist[:3]        # change of the tangent, (3, 6)
        moved = by_twist[3:] + beyond * turned
        if self.after < s:
            along = (tangent @ moved + off @ turned) / (1 + off @ turn)
            moved = moved - np.outer(tangent, along)
        return self.weight * moved

    def _nearest(self, shape):
        """Return the arc length of the passage, and what `nearest_place` fills, (3, 3)."""
        place = np.empty((3, 3))
        s = nearest_place(shape.s, *shape.for_kernels, self.point, self.after, place)
        return float(s), place


@dataclass(frozen=True, eq=False, repr=False)
class AwayFrom(Value):
    """The DLO's surface keeps a distance from obstacles (of the simulator or not).

    Attributes
    ----------
    obstacles : tuple
        Plane, Sphere, Capsule, Cylinder, Box or Sheet, in any number.
    distance : float
        Distance in m.
    radius : float
        Radius of the DLO, m.
    weight : float
        Weight in 1/m.
    """

    obstacles: tuple
    distance: float
    radius: float = 0.0
    weight: float = 1.0

    def __post_init__(self):
        put(self, obstacles=items('AwayFrom.obstacles', self.obstacles, OBSTACLES, least=1),
            distance=_length(self, 'distance'), radius=_length(self, 'radius'),
            weight=_weight(self))
        super().__post_init__()

    @cached_property
    def _scene(self):
        return build_scene(self.obstacles, self.radius)

    def residuals(self, shape: Shape) -> np.ndarray:
        """Return what is missing of the distance, one number per body."""
        judged(shape)
        gaps = np.array([gap for gap, _, _ in nearest(self._scene, shape)])
        return self.weight * np.maximum(self.distance - gaps, 0.0)

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> np.ndarray:
        """Return (bodies, 6): the nearest point stays the nearest to first order."""
        judged(shape, sensitivity)
        return np.array([-self.weight * (normal @ sensitivity.at(s)[3:]) * (gap < self.distance)
                         for gap, s, normal in nearest(self._scene, shape)]).reshape(-1, 6)


@dataclass(frozen=True, eq=False, repr=False)
class BentAtMost(Value):
    """The DLO is nowhere bent more sharply than this.

    Attributes
    ----------
    curvature : float
        Curvature in 1/m, the inverse of the bend radius.
    weight : float
        Weight in m.
    """

    curvature: float
    weight: float = 1.0

    def __post_init__(self):
        put(self, curvature=_length(self, 'curvature'), weight=_weight(self))
        super().__post_init__()

    def residuals(self, shape: Shape) -> np.ndarray:
        """Return (N,): the excess of each element, so that squares add up to the mean square."""
        judged(shape)
        excess = np.hypot(*shape.element_strains[:, 1:].T) - self.curvature
        return self.weight * np.sqrt(np.diff(shape.s) / shape.s[-1]) * np.maximum(excess, 0.0)

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> np.ndarray:
        """Return (N, 6)."""
        judged(shape, sensitivity)
        bend = shape.element_strains[:, 1:]
        size = np.hypot(*bend.T)
        share = np.sqrt(np.diff(shape.s) / shape.s[-1]) * (size > self.curvature)
        rows = np.einsum('ej,ejk->ek', bend, sensitivity.strains[:, 1:])
        return self.weight * (share / np.maximum(size, 1e-300))[:, None] * rows
