# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The path of the gripper, without its timing: splines through the poses of a plan.

Where other arms move what else holds the DLO, their paths go by the same parameter, in legs that
begin and end together. The parameter u of the path is the plan's own time. A time law
(`trajectory.trajectory`) says how fast the gripper goes through it. The checks of a plan
(`plan.swept`) are made on this path. A leg of it has no corners, or is a dwell.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.checks import array, choice
from dlo_planner.model.holds import BORE
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put
from dlo_planner.plan.stage import GRIPPER

if TYPE_CHECKING:
    from dlo_planner.plan.plan import Plan


class LegPoints(NamedTuple):
    """A leg at n parameters u.

    Derivatives are by u; the linear ones before the angular ones, world axes: of the rotation
    vector that turns the gripper, not of coordinates of its rotation.
    """

    positions: Floats  # (n, 3) positions in m
    rotations: Floats  # (n, 3, 3)
    first: Floats  # (n, 6) first derivatives, m and rad
    second: Floats  # (n, 6) second derivatives


@dataclass(frozen=True, eq=False)
class Leg(Value):
    """A path without corners, or a dwell: twice continuously differentiable within.

    SciPy's cubic spline of the positions and its rotation spline.
    """

    knots: Floats  # (m,) parameters of the poses, increasing, m >= 2
    positions: Floats  # (m, 3) positions in m
    rotations: Floats  # (m, 3, 3)
    others: tuple[Leg, ...] = ()  # of the other arms that move, with the same knots
    _position: CubicSpline = field(init=False, repr=False, compare=False)
    _turn: RotationSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        since = self.knots - self.knots[0]
        put(self, _position=CubicSpline(since, self.positions),
            _turn=RotationSpline(since, Rotation.from_matrix(self.rotations)))
        super().__post_init__()

    @property
    def still(self) -> bool:
        """Whether it is a dwell, of all arms."""
        return all((leg.positions == leg.positions[0]).all()
                   and (leg.rotations == leg.rotations[0]).all() for leg in self.all_arms)

    @property
    def all_arms(self) -> tuple[Leg, ...]:
        """The leg of the gripper, and those of the other arms."""
        return (self, *self.others)

    def poses(self, u: Floats) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and rotations (n, 3, 3) at parameters `u` (n,)."""
        since = np.clip(u, *self.knots[[0, -1]]) - self.knots[0]
        return self._position(since), self._turn(since).as_matrix()

    def at(self, u: Floats) -> LegPoints:
        """Return the LegPoints at parameters u; u (n,)."""
        positions, rotations = self.poses(u)
        since = np.clip(u, *self.knots[[0, -1]]) - self.knots[0]
        # the rotation spline's own are in the gripper's axes; turned as they are, because the
        # turning of those axes adds the cross product of the rate with itself
        first, second = (np.hstack([self._position(since, order), np.einsum(
            'nij,nj->ni', rotations, self._turn(since, order))]) for order in (1, 2))
        return LegPoints(positions, rotations, first, second)

    def control_points(self, a: Floats, b: Floats) -> Floats:
        """Return (n, 4, 3) m: the path of the origin from a to b is in the convex hull of the four.

        They are those of a Bezier curve, so their polygon is no shorter than the path.

        Shapes: a, b (n,).
        """
        from_a, from_b, middle = a - self.knots[0], b - self.knots[0], self._middle(a, b)
        third = (b - a)[:, None] / 3
        c = self._position.c[:, middle]
        slopes = [(3 * c[0] * x + 2 * c[1]) * x + c[2]
                  for x in ((t - self._position.x[middle])[:, None] for t in (from_a, from_b))]
        first, last = self._position(from_a), self._position(from_b)
        return np.stack([first, first + third * slopes[0], last - third * slopes[1], last], axis=1)

    def bounds(self, a: Floats, b: Floats) -> Floats:
        """Return (n, 2, 3) bounds of derivatives by u between parameters a and b.

        [:, 0]: of the sizes of the position's first to third derivative. [:, 1]: of the angular
        rate and of its first two derivatives. Polynomials are bounded by their control points. The
        rate is J phi' of the rotation vector phi since the last knot, a cubic polynomial, and
        J = integral of exp(-s phi) over s = 0...1: |J| <= 1, |J'| <= |phi'| / 2,
        |J''| <= |phi''| / 2 + |phi'|^2 / 3.

        Shapes: a, b (n,).
        """
        middle = self._middle(a, b)
        place, turn = (_polynomial_bounds(spline.c[:, middle], a - self.knots[0] - spline.x[middle],
                                          b - self.knots[0] - spline.x[middle])
                       for spline in (self._position, self._turn.interpolator))
        first, second, third = turn.T
        return np.stack([place, np.stack([
            first, second + 0.5 * first**2, third + 1.5 * first * second + first**3 / 3], axis=1)],
            axis=1)

    def pieces(self, least: int = 1) -> tuple[Floats, Floats]:
        """Return parameters a, b (n,) of the pieces between knots, each cut in `least` parts."""
        count = self.knots.size
        edges = np.interp(np.arange((count - 1) * least + 1) / least, np.arange(count), self.knots)
        return edges[:-1], edges[1:]

    def _middle(self, a: Floats, b: Floats) -> Ints:
        """Return the indices (n,) of the pieces between knots in which [a, b] lie."""
        index = np.searchsorted(self.knots, 0.5 * (a + b), side='right') - 1
        return np.clip(index, 0, self.knots.size - 2)


def _polynomial_bounds(c: Floats, a: Floats, b: Floats) -> Floats:
    """Return (n, 3) bounds of the sizes of a cubic's first to third derivatives within [a, b].

    Shapes: c (4, n, 3), a, b (n,).
    """
    a, b = a[:, None], b[:, None]
    slopes = [(3 * c[0] * x + 2 * c[1]) * x + c[2] for x in (a, b)]
    bends = [6 * c[0] * x + 2 * c[1] for x in (a, b)]
    between = slopes[0] + 0.5 * (b - a) * bends[0]  # the control point in the middle
    return np.stack([np.max([np.linalg.norm(v, axis=1) for v in vectors], axis=0)
                     for vectors in ((*slopes, between), bends, (6 * c[0],))], axis=1)


_CORNER = 0.5     # cosine between directions: a sharper turn is a corner
_SAME = 1e-9      # rad, and of the length: nearer poses are one
_WAITING = 1e-6   # of the plan's time: as long in one pose is a dwell


@dataclass(frozen=True, eq=False)
class GripperPath(Value):
    """The whole path: legs from stop to stop, one after the other."""

    times: Floats  # (n,) the parameters of the waypoints it was made of
    # legs; each begins with the pose and the parameter with which the one before ends
    legs: tuple[Leg, ...]
    arms: tuple[str, ...] = ()  # names of the other arms, in the order of `Leg.others`

    @classmethod
    def of(cls, plan: Plan) -> GripperPath:
        """Return the path through the poses of a Plan, in its order.

        The arms stop at corners of any of them, and where a bore takes the DLO; where all poses
        come again later they stay.
        """
        if len(plan) < 2:
            raise InvalidTask(f'plan has {len(plan)} poses: expected two or more')
        bore = held_after(plan)
        stops = plan.stops if bore is None else (*plan.stops, bore)
        return cls.through(plan.grippers, plan.times, max(shape.s[-1] for shape in plan.shapes),
                           stops, plan.arms)

    @classmethod
    def through(cls, grippers: Sequence[Pose], times: ArrayLike, length: float,
                stops: Iterable[int] = (),
                arms: Mapping[str, Sequence[Pose]] | None = None) -> GripperPath:
        """Return the path through n Poses at parameters `times` (n,); `arms`: n of each other."""
        times = array('plan.times', times, (len(grippers),))
        if (np.diff(times) < 0).any():
            k = int(np.argmax(np.diff(times) < 0)) + 1
            raise InvalidTask(f'plan.times[{k}] = {times[k]:g}: expected not less than the '
                              f'{times[k - 1]:g} s before')
        if not times[-1] > times[0]:
            raise InvalidTask(f'plan.times end at {times[-1]:g} s as they begin: expected poses at '
                              'different times')
        ways = [grippers, *(arms or {}).values()]
        apart = np.max([np.linalg.norm(_chords(way, length), axis=1) for way in ways], axis=0)
        legs, knots = [], [0]
        for k, distance in enumerate(apart, start=1):
            span = times[k] - times[k - 1]
            if distance > _SAME * length:
                if not span > 0:
                    raise InvalidTask(f'plan.times[{k}] = {times[k]:g}: expected more than the '
                                      f'{times[k - 1]:g} s of the pose before, which is another')
                knots.append(k)
            elif span > _WAITING * (times[-1] - times[0]):
                legs += _between_corners(knots, ways, times, length, stops)
                legs.append(_leg(times[[knots[-1], k]], [[way[knots[-1]]] * 2 for way in ways]))
                knots = [k]
        return cls(times, tuple(legs + _between_corners(knots, ways, times, length, stops)),
                   tuple(arms or ()))

    def arm(self, name: str) -> GripperPath:
        """Return the path of the 'gripper', or one of the other `arms`, alone, in the same legs."""
        choice('name', name, (GRIPPER, *self.arms))
        if not self.arms:
            return self
        if name == GRIPPER:
            return GripperPath(self.times, tuple(replace(leg, others=()) for leg in self.legs))
        k = self.arms.index(name)
        return GripperPath(self.times, tuple(leg.others[k] for leg in self.legs))

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
        after = int(np.searchsorted(self.times, u, side='left'))
        return min(max(after, 1), self.times.size - 1)


def _chords(grippers: Sequence[Pose], length: float) -> Floats:
    """Return (n - 1, 6) the differences of n Poses in m, a turn of 1 rad counted as `length`."""
    positions = np.array([gripper.position for gripper in grippers])
    turns = Rotation.from_matrix([gripper.rotation for gripper in grippers])
    return np.hstack([np.diff(positions, axis=0),
                      length * (turns[1:] * turns[:-1].inv()).as_rotvec()])


def _between_corners(knots: Sequence[int], ways: Sequence[Sequence[Pose]], times: Floats,
                     length: float, stopped: Iterable[int]) -> list[Leg]:
    """Return the Legs through those of n Poses of each arm with the indices `knots`.

    From one to the next an arm moves.
    """
    if len(knots) < 2:
        return []
    stopped = [index for index, k in enumerate(knots) if k in stopped and index > 0]
    ways, times = [[way[k] for k in knots] for way in ways], times[knots]
    corners = np.flatnonzero(np.any([_turns_sharply(way, length) for way in ways], axis=0)) + 1
    stops = np.unique([0, *corners, *stopped, len(knots) - 1])
    return [_leg(times[a:b + 1], [way[a:b + 1] for way in ways])
            for a, b in zip(stops, stops[1:], strict=False)]


def _turns_sharply(way: Sequence[Pose], length: float) -> Bools:
    """Return (n - 2,) whether an arm turns sharply between n Poses, begins to move or ends to.

    A spline through a place where it begins to move would move back before.
    """
    chords = _chords(way, length)
    sizes = np.linalg.norm(chords, axis=1)
    moves = sizes > _SAME * length
    chords /= np.where(moves, sizes, 1.0)[:, None]
    sharp: Bools = (chords[1:] * chords[:-1]).sum(axis=1) < _CORNER
    return np.where(moves[1:] & moves[:-1], sharp, moves[1:] != moves[:-1])


def _leg(times: Floats, ways: Sequence[Sequence[Pose]]) -> Leg:
    """Return the Leg through n Poses of the gripper, and of each other arm."""
    own, *others = (
        (np.array([pose.position for pose in way]), np.array([pose.rotation for pose in way]))
        for way in ways)
    return Leg(np.array(times), *own, tuple(Leg(np.array(times), *one) for one in others))


def held_after(plan: Plan) -> int | None:
    """Return the index of the waypoint after which a bore holds the DLO of a Plan; None: none."""
    held = [any(hold.by == BORE for hold in shape.holds) for shape in plan.shapes]
    return max(held.index(True) - 1, 0) if any(held) else None
