# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a grip moves between the instants at which its poses are given."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from dlo_planner.direct.spline import along_spline
from dlo_planner.model.arrays import Floats
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put


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

    PARTS = ('poses', 'dt', 'at_rest')

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
        return type(self), tuple(getattr(self, name) for name in self.PARTS)

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

    def twist(self, place: float) -> Floats:
        """Return (6,) velocity (m/s) and angular velocity (rad/s) at `place` = time / dt, world."""
        if self._spline is None:
            return np.zeros(6)
        twist: Floats = self.along(np.array([float(place)]))[2][0]
        return twist


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

    PARTS = ('gripper', 'far_end', 'grip')

    gripper: Guide
    far_end: Guide | None
    grip: str

    def __init__(self, gripper: Guide, far_end: Guide | None = None, grip: str = 'clamped'):
        put(self, gripper=gripper, far_end=far_end, grip=grip)

    def at(self, place: float) -> tuple[Pose, FarEnd | None]:
        """Return the gripper's Pose and the FarEnd, or None, at `place` = time / dt."""
        end = None if self.far_end is None else FarEnd(self.far_end.at(place), self.grip)
        return self.gripper.at(place), end

    def power(self, place: float, wrench: Floats, far_wrench: Floats,
              end: Floats) -> float:
        """Return the power in W of the wrenches (6,) that the gripper and the far end exert.

        Parameters
        ----------
        place : float
            Time / dt.
        end : ndarray, shape (3,)
            Position of the DLO's end, m; in a sleeve it is not where the sleeve's pose is.
        """
        power = wrench @ self.gripper.twist(place)
        if self.far_end is not None:
            twist = self.far_end.twist(place)
            lever = end - self.far_end.at(place).position if self.grip == 'sleeve' else np.zeros(3)
            power += far_wrench @ twist + far_wrench[:3] @ np.cross(twist[3:], lever)
        return float(power)
