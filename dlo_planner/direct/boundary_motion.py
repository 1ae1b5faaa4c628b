# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How grips move: poses of grippers and far ends, and smooth motions through them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import scipy

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd
from dlo_planner.model.value import Value, put


class GripTrajectory(Value):
    """The smooth motion of a grip through n poses at the times 0, dt, 2 dt, ...

    Position and quaternion are cubic splines with continuous second derivatives (the quaternion is
    normalized), so that velocities and accelerations are continuous: inertia feels no jerk that is
    not in the poses. Between two neighbors a grip turns the shorter way.

    `at_rest`: whether the velocity is zero at time 0; else it is what the poses say. dt in s.
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

    def along(self, places: Floats) -> tuple[Floats, Floats]:
        """Return rotations (k, 3, 3) and positions (k, 3) at `places` (k,)."""
        if self._spline is None:
            first, many = self.poses[0], (len(places), 1)
            return np.tile(first.rotation, (*many, 1)), np.tile(first.position, many)
        values = self._spline(places)
        positions = values[:, :3].copy()
        rotations = scipy.spatial.transform.Rotation.from_quat(values[:, 3:]).as_matrix()
        nearest = np.rint(places).astype(int)
        given = (places == nearest) & (nearest >= 0) & (nearest < len(self.poses))
        for k in np.flatnonzero(given):  # not as the spline rounds them
            pose = self.poses[nearest[k]]
            rotations[k], positions[k] = pose.rotation, pose.position
        return rotations, positions


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


class BoundaryMotion(Value):
    """All that holds a DLO in motion; `grip` is that of `FarEnd`, unused where the end is free."""

    _PARTS = ('gripper', 'far_end', 'grip')

    gripper: GripTrajectory
    far_end: GripTrajectory | None
    grip: str

    def __init__(self, gripper: GripTrajectory, far_end: GripTrajectory | None = None,
                 grip: str = 'clamped'):
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
                 initial: Shape | None) -> BoundaryMotion:
    """Return the smooth motion of what holds a DLO, at instants `dt` (s) apart."""
    if len({None if end is None else end.grip for end in ends}) > 1:
        raise InvalidTask('far_ends: expected the same grip from the beginning to the end of a '
                          'motion')
    if initial is not None and initial.far_end is not None and ends[0] is None:
        raise InvalidTask('initial is held at its far end: expected a Shape whose far end is '
                          'free, as it is in the motion, or far_ends')
    gripper = GripTrajectory(grippers, dt, at_rest)
    if ends[0] is None:
        return BoundaryMotion(gripper)
    held = [end.pose for end in ends if end is not None]
    return BoundaryMotion(gripper, GripTrajectory(held, dt, at_rest), ends[0].grip)
