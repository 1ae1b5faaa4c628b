# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What holds and loads a DLO besides the gripper: a far end, point loads."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put

# ------------------------------------------------------------------------------------------------
# A second grip: how the free end may be held.


GRIPS = ('clamped', 'pinned', 'sleeve', 'aligned')
_SLACK = 1e-9  # of the length
_SHARES = {'pinned': (0.0, 0.0, 0.0), 'aligned': (1.0, 0.0, 0.0)}
_ALL = np.eye(6)


@dataclass(frozen=True, eq=False, repr=False)
class FarEnd(Value):
    """A second grip that holds the far end of a DLO.

    Attributes
    ----------
    pose : Pose
        Pose of the DLO's end frame (x axis = tangent); only its position counts if pinned.
    grip : str
        'clamped': position and orientation; 'pinned': position; 'sleeve': clamped, but free to
        slide along the pose's x axis; 'aligned': position and tangent, free to turn about its
        tangent.
    """

    pose: Pose
    grip: str = 'clamped'

    def __post_init__(self) -> None:
        instance('FarEnd.pose', self.pose, Pose)
        choice('FarEnd.grip', self.grip, GRIPS)
        super().__post_init__()

    @classmethod
    def of(cls, value: FarEnd | Pose | ArrayLike | None) -> FarEnd | None:
        """Return a FarEnd from one, a Pose (clamped), a position (3,) (pinned), or None."""
        if value is None or isinstance(value, FarEnd):
            return value
        if isinstance(value, Pose):
            return cls(value)
        return cls(Pose(vector('far_end', value, 3), (0.0, 0.0, 0.0, 1.0)), 'pinned')

    @property
    def held(self) -> Floats:
        """Unit vectors (K, 6) of rotation, then of displacement, that the grip does not allow."""
        return held_rows(self.grip, self.pose.rotation)

    @property
    def share(self) -> Floats:
        """Weights (3,) of the end's axes in its rotation; 0 for an axis that is free."""
        return np.array(_SHARES.get(self.grip, (0.5, 0.5, 0.5)))


def held_rows(grip: str, rotation: Floats) -> Floats:
    """Return (K, 6) unit vectors of rotation, then of displacement, that a grip does not allow.

    World axes. If the grip allows one about or along the pose's x axis, its y and z axes remain.

    Shapes: rotation (3, 3).
    """
    if grip == 'clamped':
        return _ALL.copy()
    if grip == 'pinned':
        return _ALL[3:].copy()
    rows = np.zeros((5, 6))
    if grip == 'aligned':
        rows[:2, :3], rows[2:, 3:] = rotation.T[1:], _ALL[3:, 3:]
    else:
        rows[:3, :3], rows[3:, 3:] = _ALL[:3, :3], rotation.T[1:]
    return rows


def distance(far_end: FarEnd, gripper: Pose) -> float:
    """Return the least distance in m that a DLO has to span from a gripper."""
    away = far_end.pose.position - gripper.position
    if far_end.grip == 'sleeve':  # it may slide to where this is shortest
        away = away - (away @ far_end.pose.direction) * far_end.pose.direction
    return sqrt(away @ away)


def within_reach(far_end: FarEnd | None, gripper: Pose, length: float,
                 loaded: bool = True) -> bool:
    """Return whether a DLO of `length` (m) spans the distance with finite tension.

    It hardly stretches: where less than 1e-9 of it is left to sag, its weight decides nothing
    that could be computed. Without any load it may be just as long.
    """
    return far_end is None or spans(distance(far_end, gripper), length, loaded)


def spans(distance: Any, length: float, loaded: bool) -> Any:
    """Return whether a DLO of `length` (m) spans distances (m), see `within_reach`."""
    return distance < (1.0 - (_SLACK if loaded else -_SLACK)) * length


# ------------------------------------------------------------------------------------------------
# A dead load at one point of a DLO.


@dataclass(frozen=True, eq=False, repr=False)
class PointLoad(Value):
    """A force and a moment of constant size and direction at a point of the DLO.

    Attributes
    ----------
    force : ndarray, shape (3,)
        Force in N, world axes.
    moment : ndarray, shape (3,)
        Moment in N m, world axes.
    s : float or None
        Arc length of the point, m. If None, the tip.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    force: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # an array from then on
    moment: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    s: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, force: ArrayLike = (0.0, 0.0, 0.0), moment: ArrayLike = (0.0, 0.0, 0.0),
                     s: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, force=vector('PointLoad.force', self.force, 3),
            moment=vector('PointLoad.moment', self.moment, 3))
        if self.s is not None:
            put(self, s=number('PointLoad.s', self.s, minimum=0))
        super().__post_init__()
