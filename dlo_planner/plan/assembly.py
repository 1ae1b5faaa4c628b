# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans made of waypoints and of other plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import PER_WAYPOINT, Plan, PlanStatus
from dlo_planner.plan.waypoint import Waypoint


def times_at_speed(grippers: Sequence[Pose], linear_speed: float, angular_speed: float) -> Floats:
    """Return (n,) times in s: each leg takes as long as the slower of its two motions."""
    if len(grippers) < 2:
        return np.zeros(len(grippers))
    positions = np.array([pose.position for pose in grippers])
    rotations = Rotation.from_matrix([pose.rotation for pose in grippers])
    distance = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    angle = (rotations[1:] * rotations[:-1].inv()).magnitude()
    legs = np.maximum(distance / linear_speed, angle / angular_speed)
    return np.concatenate([[0.0], np.cumsum(legs)])


_SAME = 1e-6      # of the length, or of unit vectors: poses that are nearer are one
_STRAIGHT = np.cos(np.deg2rad(5))


def build_plan(waypoints: Sequence[Waypoint], depths: Floats, speeds: tuple[float, float],
               status: PlanStatus, stops: tuple[int, ...] = ()) -> Plan:
    """Return the Plan of Waypoints at the first of the `depths`; speeds: m/s, rad/s."""
    grippers = [waypoint.shape.gripper for waypoint in waypoints]
    return Plan(np.array(depths[:len(waypoints)]), tuple(grippers),
                tuple(waypoint.shape for waypoint in waypoints),
                np.array([waypoint.misalignment for waypoint in waypoints]),
                np.array([waypoint.position_error for waypoint in waypoints]),
                times_at_speed(grippers, *speeds),
                tuple(waypoint.via_points for waypoint in waypoints),
                _padded([waypoint.clearances for waypoint in waypoints]),
                waypoints[-1].sheets if waypoints else (),
                len(waypoints) / len(depths), status, stops)


def truncate(plan: Plan, count: int, status: PlanStatus) -> Plan:
    """Return the first `count` waypoints of a Plan, as a plan with another PlanStatus."""
    part = {name: getattr(plan, name)[:count] for name in PER_WAYPOINT}
    return replace(plan, **part, fraction=1.0 if status is PlanStatus.COMPLETE
                   else plan.fraction * count / len(plan), status=status,
                   stops=tuple(stop for stop in plan.stops if stop < count))


def concatenate(one: Plan, other: Plan) -> Plan:
    """Return one Plan that does a Plan and then another, which begins where the first ends.

    The gripper stops between them, unless it goes on in the same direction (within 5 degrees).

    Raises
    ------
    InvalidTask
        The second begins elsewhere than the first ends.
    """
    for name, plan in (('one', one), ('other', other)):
        if not len(instance(name, plan, Plan)):
            raise InvalidTask(f'{name} = {plan!r}: expected a Plan with a waypoint')
    apart = np.abs(one.grippers[-1].matrix - other.grippers[0].matrix).max()
    if apart > _SAME * max(1.0, one.shapes[-1].s[-1]):
        raise InvalidTask(f'other begins at {other.grippers[0]!r}: expected the end of one, '
                          f'{one.grippers[-1]!r}')
    depths, grippers, shapes, misalignment, errors, times, via_points, clearances, pushes = (
        [*getattr(one, name), *getattr(other, name)[1:]] for name in PER_WAYPOINT)
    end = len(one) - 1
    times[end + 1:] = one.times[-1] + other.times[1:] - other.times[0]
    stops = [*one.stops, *(stop + end for stop in other.stops if stop)]
    if _turns(grippers[max(end - 1, 0):end + 2], shapes[0].s[-1]):
        stops.append(end)
    return Plan(np.array(depths), tuple(grippers), tuple(shapes), np.array(misalignment),
                np.array(errors), np.array(times), tuple(via_points), _padded(clearances),
                other.sheets or one.sheets,
                min(one.fraction, other.fraction), other.status, tuple(sorted(set(stops))),
                np.array(pushes))


def _turns(grippers: Sequence[Pose], length: float) -> bool:
    """Whether the path through three Poses bends; a turn by 1 rad counts as `length`."""
    chords = [np.concatenate([after.position - before.position, length * Rotation.from_matrix(
        after.rotation @ before.rotation.T).as_rotvec()])
        for before, after in zip(grippers, grippers[1:], strict=False)]
    sizes = [np.linalg.norm(chord) for chord in chords]
    return len(chords) == 2 and bool(
        min(sizes) > 0 and chords[0] @ chords[1] < _STRAIGHT * sizes[0] * sizes[1])


def _padded(clearances: Sequence[Sequence[Sequence[float] | Floats] | Floats]) -> Floats:
    """Return (n, k, 3) of n sequences of at most k entries; infinite where there is none."""
    most = max((len(rooms) for rooms in clearances), default=0)
    out = np.full((len(clearances), most, 3), np.inf)
    for k, rooms in enumerate(clearances):
        if len(rooms):
            out[k, :len(rooms)] = rooms
    return out
