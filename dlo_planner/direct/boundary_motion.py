# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How grips move: poses of grippers and of what else holds, and smooth motions through them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import scipy

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items
from dlo_planner.model.holds import Hold, Holds, alike, holds_of, posed, tip_held
from dlo_planner.model.pose import Pose
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
    """All that holds a DLO in motion: the gripper, and A holds of the same places all the time.

    `kinds` are the Holds at time 0, `paths` how each of them moves.
    """

    _PARTS = ('gripper', 'paths', 'kinds')

    gripper: GripTrajectory
    paths: tuple[GripTrajectory, ...]
    kinds: Holds

    def __init__(self, gripper: GripTrajectory, paths: Sequence[GripTrajectory] = (),
                 kinds: Holds = ()) -> None:
        put(self, gripper=gripper, paths=tuple(paths), kinds=kinds)

    def at(self, place: float) -> tuple[Pose, Holds]:
        """Return the gripper's Pose and the Holds at `place` = time / dt."""
        return self.gripper.at(place), tuple(
            posed(hold, path.at(place)) for hold, path in zip(self.kinds, self.paths, strict=True))


def poses(grippers: Iterable[Pose], least: int = 0) -> tuple[Pose, ...]:
    """Return a sequence of Poses as a tuple of `least` or more; raise InvalidTask."""
    given = items('grippers', grippers, object, least=least)
    return tuple(instance(f'grippers[{index}]: gripper', gripper, Pose)
                 for index, gripper in enumerate(given))


def held_by(far_ends: Iterable[Any] | None, holds: Iterable[Any], count: int,
            length: float) -> list[Holds]:
    """Return the Holds at each of `count` gripper poses; raise InvalidTask.

    `far_ends` has what `FarEnd.of` takes for each of them; `holds` Holds, which rest, or for each
    the Holds there.
    """
    given: tuple[Any, ...] = items('holds', holds, object)
    if far_ends is None and not given:
        return [()] * count
    ends = ends_of(far_ends, count)
    if all(isinstance(hold, Hold) for hold in given):  # they rest
        each = [given] * count
    else:
        each = [items(f'holds[{k}]', one, Hold) for k, one in enumerate(given)]
        if len(each) != count:
            raise InvalidTask(f'holds has {len(each)} entries: expected Holds, which rest, or '
                              f'those at each of the gripper poses, {count}')
    return [holds_of(end, one, length, 'holds' if len(each) < 2 else f'holds[{k}]')
            for k, (end, one) in enumerate(zip(ends, each, strict=True))]


def ends_of(far_ends: Iterable[Any] | None, count: int) -> list[Hold | None]:
    """Return a Hold of the tip, or None, for each of `count` gripper poses; raise InvalidTask."""
    if far_ends is None:
        return [None] * count
    given: tuple[Any, ...] = items('far_ends', far_ends, object)
    ends = [tip_held(end) for end in given]
    if len(ends) != count:
        raise InvalidTask(f'far_ends has {len(ends)} entries: expected one per gripper pose, '
                          f'{count}')
    return ends


def moving_grips(grippers: Sequence[Pose], held: Sequence[Holds], dt: float, at_rest: bool,
                 initial: Shape | None) -> BoundaryMotion:
    """Return the smooth motion of what holds a DLO, at instants `dt` (s) apart."""
    first = held[0]
    for k, holds in enumerate(held):
        if holds is not first and not alike(holds, first):
            inside = any(hold.s is not None for hold in (*holds, *first))
            raise InvalidTask(
                f'holds[{k}]: expected the same places and grips from the beginning to the end of '
                'a motion' if inside else 'far_ends: expected the same grip from the beginning to '
                'the end of a motion')
    if initial is not None:
        places = {hold.s for hold in first}
        if initial.far_end is not None and None not in places:
            raise InvalidTask('initial is held at its far end: expected a Shape whose far end is '
                              'free, as it is in the motion, or far_ends')
        if not {hold.s for hold in initial.holds} <= places:
            raise InvalidTask(f'initial is held by {initial.holds}: expected a Shape that is held '
                              'where it is in the motion, or `holds` of these places')
    paths = [GripTrajectory([holds[k].pose for holds in held], dt, at_rest)
             for k in range(len(first))]
    return BoundaryMotion(GripTrajectory(grippers, dt, at_rest), paths, first)
