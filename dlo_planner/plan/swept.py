# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks between the waypoints of a plan, on the path that the gripper really takes.

The gripper is checked everywhere on the path (`Workspace.first_beyond`). The DLO is known at the
waypoints; in between, its distance from them is bounded. Where the bound is not sufficient, the DLO
is simulated in the middle, and so on.

The bound. A plan draws the DLO along itself and sideways, so shapes are compared as curves, each
prolonged straight by as much as its ends have moved: delta is the distance of a point of one
shape from the other curve, however far it went along. If the DLO went evenly from one curve to the
other, no point of it would be farther than delta / 2 from the nearer of both. It does not go quite
evenly: the gripper leaves the straight line by h^2/8 times the path's second derivative, which is
bounded, and a point that turns about the gripper by an angle goes along an arc of a height of
lever angle^2/8. The lever is the point's distance from the gripper or, if that is larger, its
motion per angle between both shapes: a DLO that is softer than stiff answers a turn by more. Then
the point turns by its motion over its distance, which may be more than the gripper turns, and that
angle counts. And where the DLO is drawn along itself by d, its points go straight and not along the
curve: d^2/8 times the largest curvature more. A distance from obstacles changes no more than the
place does, so if it exceeds delta / 2 and these bulges at each point of both shapes, nothing is
touched between. Where other arms move holds of the DLO, each adds the bulges of its own path and
turn, its levers measured from its hold. It is assumed, not proved, that the DLO responds alike
between both ends: a jump is noticed where the DLO is simulated, and `plan.continuity` checks the
straight motion.

Forces and moments at the grips, where they are limited, are looked at in the middle too, and in the
middles of halves where the parabola through three places comes near to the limit.

Between two instants of a motion in time (`least_between`) the nodes go along cubic polynomials that
keep their places and velocities (Hermite). A point leaves the even way by at most h^2/8 times its
largest acceleration in h seconds, which of a cubic is that at an end; a cubic's own error is
estimated from those over two intervals, which are 16 times as far off in the middle, where the DLO
is known. The rest is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.grasp import Simulator
from dlo_planner.direct.shape import Shape, kernel_arrays
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.checks import (
    Margin,
    PlanChecker,
    largest_wrench,
    nearer,
    verbatim,
    violated,
    wrench_margins,
)
from dlo_planner.plan.clearance import Bodies, SheetSide
from dlo_planner.plan.continuity import followed
from dlo_planner.plan.path import GripperPath, Leg
from dlo_planner.plan.stage import arm_of, moved_holds

_HALVINGS = 7   # of the way between two waypoints
_CLOSER = 4     # looks for where the DLO is deepest in something
_TINY = 1e-12   # of the length: a node in the gripper
_DOUBTED = 2.0  # times what a parabola says, for what it is not
_LEAP = 3.0     # motion of the DLO per lever and turn of the gripper: more is no continuation


def violation_between(path: GripperPath, shapes: Sequence[Shape], sheets: Sequence[SheetSide],
                      demands: PlanChecker,
                      known: Sequence[float] | None = None) -> Margin | None:
    """Return the first Margin that is broken between the waypoints of a plan, or None.

    known: rooms of the shapes beside everything, m, where they are.
    """
    outside = None
    if demands.workspace is not None:
        beyond = demands.workspace.first_beyond(path)
        if beyond is not None:
            place, name, amount = beyond
            outside = Margin(name, -amount, 'on the way there the gripper comes {over:.3g} m '
                             f'beyond {name}', place=place)
    touched = None if demands.plug_room is None else demands.plug_room.first_touch(path)
    if touched is not None and (outside is None or outside.place is None
                                or touched[0] < outside.place):
        place, amount, body = touched
        outside = Margin('plug', -amount, 'on the way there the plug comes {over:.3g} m into '
                         + verbatim(body), place=place)
    limited = demands.wrench_limits != (None, None)
    if demands.simulator is None or not (sheets or demands.obstacles or limited) or any(
            shape.s[-1] != demands.simulator.rod.length for shape in shapes):
        return outside
    bodies = Bodies(sheets, demands.obstacles, demands.surface, demands.progress.check,
                    demands.clearance)
    return _Sweep(path, bodies, demands, demands.simulator).broken(
        shapes, known, outside) or outside


@dataclass(frozen=True)
class _Look:
    """A Shape at a parameter of the path, and how much room it has."""

    u: float  # parameter; of a motion: time in intervals
    shape: Shape
    # vectors (N + 1, 3) in m from the gripper, and from each hold that moves, to the nodes
    arms: tuple[Floats, ...]
    levers: tuple[Floats, ...]  # (N + 1,) lengths of the arms, m
    frames: tuple[Pose, ...]  # of the gripper and those holds
    rooms: Floats  # (N,) lower bounds of the room of each element, m
    least: float  # least room of all in m, exact


def _look(bodies: Bodies, u: float, shape: Shape, least: float,
          moved: Sequence[str] = ()) -> _Look:
    """Return the _Look at a Shape; `moved`: names of the arms that move its holds."""
    frames = (shape.gripper, *(hold.pose for hold in shape.holds if arm_of(hold) in moved))
    arms = tuple(shape.positions - frame.position for frame in frames)
    levers = tuple(np.sqrt(np.einsum('ij,ij->i', one, one)) for one in arms)
    return _Look(u, shape, arms, levers, frames, bodies.rooms(shape, least), least)


class _Sweep:
    """Checks a path, leg by leg, between the waypoints."""

    def __init__(self, path: GripperPath, bodies: Bodies, demands: PlanChecker,
                 simulator: Simulator) -> None:
        self._path, self._bodies, self._simulator = path, bodies, simulator
        self._demands, self._limited = demands, demands.wrench_limits != (None, None)

    def broken(self, shapes: Sequence[Shape], known: Sequence[float] | None,
               outside: Margin | None) -> Margin | None:
        """Return the first Margin that is broken before n Shapes, earlier than `outside`."""
        known = [*map(self._bodies.exact, shapes)] if known is None else (
            [room - self._bodies.apart for room in known])
        arms = self._path.arms
        for leg in self._path.legs:
            if leg.still:
                continue
            before, pieces = None, leg.pieces()
            bounds = np.stack([one.bounds(*pieces)[:, :, 1]
                               for one in _in_order(leg, shapes, arms)], axis=1)
            for a, b, bends in zip(*pieces, bounds, strict=True):
                goal = self._path.goal(b)
                if outside is not None and outside.place is not None and goal > outside.place:
                    return None
                if before is None:
                    start = np.searchsorted(self._path.times, a, side='right') - 1
                    before = _look(self._bodies, a, shapes[start], known[start], arms)
                after = _look(self._bodies, b, shapes[goal], known[goal], arms)
                what = self._between(leg, before, after, bends, _HALVINGS)
                if what is None and self._limited:
                    what = self._strained(leg, before, after, _HALVINGS)
                if what is not None:
                    return what._replace(place=goal)
                before = after
        return None

    def _between(self, leg: Leg, one: _Look, other: _Look, bends: Floats,
                 halvings: int) -> Margin | None:
        """Return the Margin that is broken between two Looks, or None.

        Shapes: bends (1 + A, 2), of the gripper and each hold that moves.
        """
        short, far = _short(one, other, bends)
        if short <= 0:
            return None
        if not halvings:
            if far:
                return Margin('continuity', -far, 'on the way there the DLO goes {over:.3g} m to '
                              'where the gripper does not bring it')
            return Margin('clearance', -short, 'on the way there the DLO has {found:.3g} m of room '
                          'at the waypoints, and {over:.3g} m more are needed to show that it '
                          'touches nothing between: closer waypoints, or more room, may help',
                          min(one.least, other.least))
        middle, jumped = self._middle(leg, one, other)
        if middle is None:
            return jumped
        if middle.least < 0:
            deepest = (self._deepest(leg, one, middle, other) if self._demands.says_how_deep
                       else middle)
            return Margin('clearance', deepest.least, 'on the way there the DLO is {over:.3g} m '
                          + nearer(self._bodies.apart)
                          + verbatim(self._bodies.called_at(deepest.shape)))
        return (self._between(leg, one, middle, bends, halvings - 1)
                or self._between(leg, middle, other, bends, halvings - 1))

    def _strained(self, leg: Leg, one: _Look, other: _Look, halvings: int) -> Margin | None:
        """Return the Margin of a force or moment that is broken between two Looks, or None."""
        middle, jumped = self._middle(leg, one, other)
        if middle is None:
            return jumped
        ends, there = [largest_wrench(look.shape) for look in (one, other)], largest_wrench(
            middle.shape)
        limits = self._demands.wrench_limits
        broken = violated(wrench_margins(limits, there))
        if broken is not None:
            return broken._replace(words='on the way there ' + broken.words)
        bulge = np.abs(ends[0] + ends[1] - 2 * there) / 8  # of each half, of a parabola
        most = np.max([*ends, there], axis=0) + _DOUBTED * bulge
        if not halvings or violated(wrench_margins(limits, most)) is None:
            return None
        return (self._strained(leg, one, middle, halvings - 1)
                or self._strained(leg, middle, other, halvings - 1))

    def _middle(self, leg: Leg, one: _Look, other: _Look) -> tuple[_Look | None, Margin | None]:
        """Return the Look half way between two and None, or None and what a jump breaks."""
        u = 0.5 * (one.u + other.u)
        gripper, *others = (_pose_on(arm, u) for arm in leg.all_arms)
        holds = moved_holds(one.shape.holds, dict(zip(self._path.arms, others, strict=True)))
        shape = followed(self._simulator, one.shape, gripper, holds)
        if shape.converged and not shape.jumped:
            return _look(self._bodies, u, shape, self._bodies.exact(shape), self._path.arms), None
        away = float(np.linalg.norm(shape.positions[-1] - one.shape.positions[-1]))
        return None, Margin('continuity', -away, 'on the way there the DLO snaps into another '
                            'shape: its free end comes {over:.3g} m away')

    def _deepest(self, leg: Leg, before: _Look, deep: _Look, after: _Look) -> _Look:
        """Return the Look, near one where the DLO is in something, where it is deepest in it."""
        for _ in range(_CLOSER):
            looks = [look for look in (before, self._middle(leg, before, deep)[0], deep,
                                       self._middle(leg, deep, after)[0], after)
                     if look is not None]
            k = min(range(1, len(looks) - 1), key=lambda k: looks[k].least)
            before, deep, after = looks[k - 1:k + 2]
        return deep


def _short(one: _Look, other: _Look, bends: Floats) -> tuple[float, float]:
    """Return by how much (m) room is missing to prove that nothing is touched between two Looks.

    Also how far (m) the DLO moves, if that is more than a turn of the gripper can cause, or 0.
    """
    length = one.shape.s[-1]
    curved = max(float(np.hypot(*look.shape.element_strains[:, 1:].T).max())
                 for look in (one, other))
    drawn = max(abs(float(look.shape.tangents[k] @ (
        other.shape.positions[k] - one.shape.positions[k])))
        for look in (one, other) for k in (0, -1))
    bulges = [np.full(look.shape.s.size, 0.125 * drawn**2 * curved) for look in (one, other)]
    far = 0.0
    for arm, (shift, bend) in enumerate(0.125 * (other.u - one.u) ** 2 * bends):
        turn = angle_between(one.frames[arm].rotation, other.frames[arm].rotation)
        motions = _motion(one, other, arm), _motion(other, one, arm)
        moved = float(max(motion.max() for motion in motions))
        moved = moved if moved > _TINY * length else 0.0  # what rounding moves a DLO that is led on
        lever = moved / max(turn, 1e-9)
        for k, (look, motion) in enumerate(zip((one, other), motions, strict=True)):
            levers = look.levers[arm]
            angles = np.maximum(turn, motion / np.maximum(levers, _TINY * length))
            bulges[k] += shift + np.maximum(levers, lever) * bend + levers * angles**2 / 8
        far = max(far, moved if moved > _LEAP * length * turn else 0.0)
    return _missing(one, other, *bulges), far


def _motion(one: _Look, other: _Look, arm: int) -> Floats:
    """Return (N + 1,) how far the nodes of one Look are in the other, seen from an arm, m."""
    shape, arms = other.shape, other.arms[arm]
    if not np.array_equal(one.shape.s, shape.s):  # of two meshes, points of the same arc lengths
        arms = shape.positions_at(one.shape.s) - other.frames[arm].position
    moved: Floats = np.sqrt(((arms - one.arms[arm])**2).sum(axis=1))
    return moved


def _in_order(leg: Leg, shapes: Sequence[Shape], arms: Sequence[str]) -> list[Leg]:
    """Return the paths of all arms on a Leg: the gripper's, then as the holds of Shapes go."""
    known = dict(zip(arms, leg.others, strict=True))
    return [leg, *(known[name] for hold in shapes[0].holds if (name := arm_of(hold)) in known)]


def _pose_on(leg: Leg, u: float) -> Pose:
    """Return the Pose of an arm at the parameter u."""
    (position,), (rotation,) = leg.poses(np.array([u]))
    return Pose.from_rotation(position, rotation)


def _missing(one: _Look, other: _Look, bulges: Floats, others: Floats) -> float:
    """Return by how much (m) the bulges (N + 1,) of the nodes of two Looks exceed their rooms."""
    these, those = kernel_arrays(one.shape), kernel_arrays(other.shape)
    return max(_exceeded(these[0], these[3], one.rooms, bulges, *those),
               _exceeded(those[0], those[3], other.rooms, others, *these))


@kernel
def _exceeded(lengths: Floats, points: Floats, rooms: Floats, bulge: Floats, others: Floats,
              strains: Floats, rotations: Floats, positions: Floats) -> float:
    """Return by how much (m) the nodes exceed the rooms (N,) on their way to another curve.

    Args:
        lengths: (N,) of the elements, m; points: (N + 1, 3) m, the nodes; bulge: (N + 1,) m
        others: (M,) of the other curve, m, and what it is like
    """
    reach = 0.0  # by how much the ends have moved
    for one, other in ((0, 0), (lengths.size, others.size)):
        square = 0.0
        for i in range(3):
            square += (points[one, i] - positions[other, i]) ** 2
        reach = max(reach, np.sqrt(square))
    at, s = np.zeros(lengths.size + 1), np.zeros(others.size + 1)
    at[1:], s[1:] = np.cumsum(lengths), np.cumsum(others)
    away = 0.5 * _distances(at, points, s, strains, rotations, positions, reach) + bulge
    short = -np.inf
    for e in range(lengths.size):
        short = max(short, max(away[e], away[e + 1]) - rooms[e])
    return short


@kernel
def _distances(at: Floats, points: Floats, s: Floats, strains: Floats, rotations: Floats,
               positions: Floats, reach: float) -> Floats:
    """Return distances (n,) in m, none too small, of points from a DLO prolonged by `reach`.

    The nearest place is sought on the chords of the elements whose arc length is within twice
    `reach` of the point's own, the distance is from the arc there.

    Args:
        at: (n,) arc lengths of the points, m; points: (n, 3) m
        s: (N + 1,) of the DLO's nodes, m; reach: m
    """
    n = s.size - 1
    lengths = np.diff(s)
    out = np.empty(points.shape[0])
    frame, x = np.empty((3, 3)), np.empty(3)
    first = 0
    for k in range(points.shape[0]):
        while first < n - 1 and s[first + 1] < at[k] - 2.0 * reach:
            first += 1
        nearest, element, share = np.inf, first, 0.0
        for e in range(first, n):
            if s[e] > at[k] + 2.0 * reach and e > first:
                break
            along = square = size = 0.0
            for i in range(3):
                way = positions[e + 1, i] - positions[e, i]
                away = points[k, i] - positions[e, i]
                along += way * away
                square += away * away
                size += way * way
            part = min(max(along / size, 0.0), 1.0)
            square += part * (part * size - 2.0 * along)
            if square < nearest:
                nearest, element, share = square, e, part
        point_inside(lengths, strains, rotations, positions, element, share, frame, x)
        square = 0.0
        for i in range(3):
            square += (points[k, i] - x[i]) ** 2
        for end, sign in ((0, -1.0), (n, 1.0)):
            square = min(square, _from_ray(points[k], positions[end], rotations[end], sign, reach))
        out[k] = np.sqrt(square)
    return out


@kernel
def _from_ray(point: Floats, end: Floats, rotation: Floats, sign: float, reach: float) -> float:
    """Return the squared distance of a point from where an end is prolonged to by `reach`."""
    along = away = 0.0
    for i in range(3):
        along += sign * rotation[i, 0] * (point[i] - end[i])
    along = min(max(along, 0.0), reach)
    for i in range(3):
        away += (point[i] - end[i] - sign * along * rotation[i, 0]) ** 2
    return away


_INTERVAL_HALVINGS = 10   # of an interval between two instants
_SURE = 2.0     # times what the error of a cubic seems to be


def least_between(bodies: Bodies, shapes: Sequence[Shape], velocities: Floats,
                  dt: float) -> float:
    """Return a lower bound of the distance at and between the instants of a motion, m.

    It is the smallest distance at all shapes that are looked at where they are shown to be
    clear of the bodies in between; else it is not above 0, or at most what was found between.

    Shapes: velocities (n, N + 1, 3).
    """
    best = bodies.least(shapes)
    if not bodies or len(shapes) < 2 or best <= 0:
        return best
    cubics = _Cubics(shapes, velocities, dt)
    bounds = np.array([bodies.rooms(shape) for shape in shapes])
    ways = cubics.ways
    short = np.maximum(ways[:, 1:], ways[:, :-1]) - np.minimum(bounds[1:], bounds[:-1])
    known: dict[int, _Look] = {}
    for k in map(int, np.flatnonzero(short.max(axis=1) > 0)):
        for at in (k, k + 1):
            if at not in known:
                known[at] = _look(bodies, float(at), shapes[at], bodies.exact(shapes[at]))
        best = min(best, _inside(bodies, cubics, known[k], known[k + 1], _INTERVAL_HALVINGS))
        if best <= 0:
            break
    return best


def _inside(bodies: Bodies, cubics: _Cubics, one: _Look, other: _Look, halvings: int) -> float:
    """Return a lower bound of the distance between two Looks of a motion, inf if clear.

    That is: not above 0, or the distances that were found between.
    """
    bulges = cubics.bulges(one.u, other.u)
    short = _missing(one, other, bulges, bulges)
    if short < 0:
        return np.inf
    if not halvings:
        return -short
    u = 0.5 * (one.u + other.u)
    shape = cubics.shape(u)
    middle = _look(bodies, u, shape, bodies.exact(shape))
    if middle.least <= 0:
        return middle.least
    return min(middle.least, _inside(bodies, cubics, one, middle, halvings - 1),
               _inside(bodies, cubics, middle, other, halvings - 1))


class _Cubics:
    """The cubic polynomials of time along which the nodes of n Shapes go, every `dt` seconds one.

    `ways` (n - 1, N + 1): how far a node may be from where it is at the nearer instant, m.
    """

    def __init__(self, shapes: Sequence[Shape], velocities: Floats, dt: float) -> None:
        self._shapes, self._velocities, self._dt = shapes, np.asarray(velocities), dt
        x, v = np.array([shape.positions for shape in shapes]), self._velocities
        moved = np.diff(x, axis=0)
        ends = np.stack([6 * moved / dt - 4 * v[:-1] - 2 * v[1:],
                         -6 * moved / dt + 2 * v[:-1] + 4 * v[1:]]) / dt
        self._accelerations = np.linalg.norm(ends, axis=3).max(axis=0)
        errors = np.zeros(len(x))
        if len(x) > 2:
            off = 0.5 * (x[2:] + x[:-2]) + 0.25 * dt * (v[:-2] - v[2:]) - x[1:-1]
            errors[1:-1] = _SURE / 16 * np.linalg.norm(off, axis=2).max(axis=1)
            errors[0], errors[-1] = errors[1], errors[-2]
        self._errors = np.maximum(errors[1:], errors[:-1])
        self.ways: Floats = (0.5 * np.linalg.norm(moved, axis=2)
                             + dt * dt / 8 * self._accelerations + self._errors[:, None])

    def bulges(self, begin: float, end: float) -> Floats:
        """Return (N + 1,) by how much nodes leave an even way in a part of one interval, m."""
        k, part = int(begin), end - begin
        result: Floats = (part * self._dt) ** 2 / 8 * self._accelerations[k] + self._errors[k]
        return result

    def shape(self, u: float) -> Shape:
        """Return the Shape at a time in intervals, between two instants."""
        k = int(u)
        one, other, h, t = self._shapes[k], self._shapes[k + 1], self._dt, u - k
        positions = ((1 + 2 * t) * (1 - t) ** 2 * one.positions + t * t * (3 - 2 * t)
                     * other.positions + h * t * (1 - t) * (
                         (1 - t) * self._velocities[k] - t * self._velocities[k + 1]))
        turns = Rotation.from_matrix(other.frames @ np.swapaxes(one.frames, 1, 2)).as_rotvec()
        frames = Rotation.from_rotvec(t * turns).as_matrix() @ one.frames
        strains = (1 - t) * one.element_strains + t * other.element_strains
        return replace(one, positions=positions, frames=frames, element_strains=strains)
