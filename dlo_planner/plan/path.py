# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The path of the gripper, without its timing: splines through the poses of a plan.

The parameter u of the path is the plan's own time. A time law (`plan.motion.trajectory`) says how
fast the gripper goes through it. The checks of a plan (`plan.between`) are made on this path.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value
from dlo_planner.plan.leg import Leg
from dlo_planner.plan.passing import held_after

if TYPE_CHECKING:
    from dlo_planner.plan.plan import Plan

_CORNER = 0.5     # cosine between directions: a sharper turn is a corner
_SAME = 1e-9      # rad, and of the length: nearer poses are one
_WAITING = 1e-6   # of the plan's time: as long in one pose is a dwell


@dataclass(frozen=True, eq=False)
class GripperPath(Value):
    """The whole path: legs from stop to stop, one after the other.

    Attributes
    ----------
    times : ndarray, shape (n,)
        The parameters of the waypoints it was made of.
    legs : tuple of Leg
        Legs; each begins with the pose and the parameter with which the one before ends.
    """

    times: Floats
    legs: tuple[Leg, ...]

    @classmethod
    def of(cls, plan: Plan) -> GripperPath:
        """Return the path through the poses of a Plan, in its order.

        The gripper stops at corners and where a bore takes the DLO; where a pose comes again later
        it stays.
        """
        if len(plan) < 2:
            raise InvalidTask(f'plan has {len(plan)} poses: expected two or more')
        bore = held_after(plan)
        stops = plan.stops if bore is None else (*plan.stops, bore)
        return cls.through(plan.grippers, plan.times, max(shape.s[-1] for shape in plan.shapes),
                           stops)

    @classmethod
    def through(cls, grippers: Sequence[Pose], times: ArrayLike, length: float,
                stops: Iterable[int] = ()) -> GripperPath:
        """Return the path through n Poses at parameters `times` (n,)."""
        times = array('plan.times', times, (len(grippers),))
        if (np.diff(times) < 0).any():
            k = int(np.argmax(np.diff(times) < 0)) + 1
            raise InvalidTask(f'plan.times[{k}] = {times[k]:g}: expected not less than the '
                              f'{times[k - 1]:g} s before')
        if not times[-1] > times[0]:
            raise InvalidTask(f'plan.times end at {times[-1]:g} s as they begin: expected poses at '
                              'different times')
        apart = np.linalg.norm(_chords(grippers, length), axis=1)
        legs, knots = [], [0]
        for k, distance in enumerate(apart, start=1):
            span = times[k] - times[k - 1]
            if distance > _SAME * length:
                if not span > 0:
                    raise InvalidTask(f'plan.times[{k}] = {times[k]:g}: expected more than the '
                                      f'{times[k - 1]:g} s of the pose before, which is another')
                knots.append(k)
            elif span > _WAITING * (times[-1] - times[0]):
                legs += _between_corners(knots, grippers, times, length, stops)
                legs.append(_leg(times[[knots[-1], k]], [grippers[knots[-1]]] * 2))
                knots = [k]
        return cls(times, tuple(legs + _between_corners(knots, grippers, times, length, stops)))

    def at(self, u: ArrayLike) -> tuple[Floats, Floats]:
        """Return the Poses' positions (n, 3) and rotations (n, 3, 3) at parameters `u` (n,)."""
        u = np.atleast_1d(np.asarray(u, dtype=float))
        which = np.clip(np.searchsorted([leg.knots[0] for leg in self.legs], u, side='right') - 1,
                        0, len(self.legs) - 1)
        positions, rotations = np.empty((u.size, 3)), np.empty((u.size, 3, 3))
        for k in np.unique(which):
            of_leg = which == k
            positions[of_leg], rotations[of_leg] = self.legs[k].poses(u[of_leg])
        return positions, rotations

    def goal(self, u: float) -> int:
        """Return the index of the waypoint to which the gripper is going at the parameter u."""
        return int(np.clip(np.searchsorted(self.times, u, side='left'), 1, self.times.size - 1))


def pose_at_arc_length(plan: Plan, known: Floats, s: float) -> Pose:
    """Return the Pose on a Plan's path at which the arc length `s`, m, first passes a cut-out.

    Shapes: known (n,).
    """
    between = np.flatnonzero((known[1:] - s) * (known[:-1] - s) <= 0)
    if not between.size:
        passing = known[np.isfinite(known)]
        raise InvalidTask(f's = {s:g}: expected an arc length that passes a cut-out, ' + (
            f'{passing.min():g} to {passing.max():g} m' if passing.size > 1 else 'none does'))
    one, other = between[0], between[0] + 1
    step = known[other] - known[one]
    share = (s - known[one]) / step if step else 0.0
    u = plan.times[one] + share * (plan.times[other] - plan.times[one])
    position, rotation = GripperPath.of(plan).at(u)
    return Pose.from_rotation(position[0], rotation[0])


def _chords(grippers: Sequence[Pose], length: float) -> Floats:
    """Return (n - 1, 6) the differences of n Poses in m, a turn of 1 rad counted as `length`."""
    positions = np.array([gripper.position for gripper in grippers])
    turns = Rotation.from_matrix([gripper.rotation for gripper in grippers])
    return np.hstack([np.diff(positions, axis=0),
                      length * (turns[1:] * turns[:-1].inv()).as_rotvec()])


def _between_corners(knots: Sequence[int], grippers: Sequence[Pose], times: Floats, length: float,
                     stopped: Iterable[int]) -> list[Leg]:
    """Return the Legs through those of n Poses with the indices `knots`, which all differ."""
    if len(knots) < 2:
        return []
    stopped = [index for index, k in enumerate(knots) if k in stopped and index > 0]
    grippers, times = [grippers[k] for k in knots], times[knots]
    chords = _chords(grippers, length)
    chords /= np.linalg.norm(chords, axis=1)[:, None]
    corners = np.flatnonzero((chords[1:] * chords[:-1]).sum(axis=1) < _CORNER) + 1
    stops = np.unique([0, *corners, *stopped, len(knots) - 1])
    return [_leg(times[a:b + 1], grippers[a:b + 1]) for a, b in zip(stops, stops[1:], strict=False)]


def _leg(times: Floats, grippers: Sequence[Pose]) -> Leg:
    return Leg(np.array(times), np.array([gripper.position for gripper in grippers]),
               np.array([gripper.rotation for gripper in grippers]))
