# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What happens between the waypoints of a plan, on the path that the gripper really takes.

The gripper is looked at everywhere on the path (`Workspace.first_beyond`). The DLO is known at the
waypoints; how far it can be elsewhere is bounded, and where that is not enough it is simulated
in the middle, and so on.

The bound. A plan draws the DLO along itself and sideways, so shapes are compared as curves, each
prolonged straight by as much as its ends have moved: delta is the distance of a point of one
shape from the other curve, however far it went along. If the DLO went evenly from one curve to the
other, no point of it would be farther than delta / 2 from the nearer of both. It does not go quite
evenly: the gripper leaves the straight way by h^2/8 times the path's second derivative, which is
bounded, and a point that turns about the gripper by an angle goes along an arc of a height of
lever angle^2/8. The lever is the point's distance from the gripper or, if that is larger, its
motion per angle between both shapes: a DLO that is softer than stiff answers a turn by more. A
distance from obstacles changes no more than the place does, so if it exceeds delta / 2 and both
bulges at each point of both shapes, nothing is touched between. What is assumed, not proved, is
that the DLO answers as it does between both ends: a jump in between is noticed where the DLO is
simulated, and the straight way is looked at by `plan.continuity`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.outline import node_gap, nodes_of, stretch, taper
from dlo_planner.energy.scene import NODE_FACE, Scene, build_scene
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.clearance import clearance, hole_clearances
from dlo_planner.plan.path import GripperPath, Leg
from dlo_planner.ritz.kinematics import point_inside

if TYPE_CHECKING:
    from dlo_planner.plan.builder import PlanRequirements

SheetSide: TypeAlias = tuple[Sheet, Floats]      # and the normal (3,) from before it to behind it
Violation: TypeAlias = tuple[str, float, str]    # constraint, by how much, in words

_HALVINGS = 7   # of the way between two waypoints
_CLOSER = 4     # looks for where the DLO is deepest in something
_LEAP = 3.0     # motion of the DLO per lever and turn of the gripper: more is no continuation


@dataclass(frozen=True, eq=False)
class Broken:
    """What is broken on the way to a waypoint: its index, the constraint, by how much, in words."""

    waypoint: int
    constraint: str
    amount: float
    why: str


def violation_between(path: GripperPath, shapes: Sequence[Shape], sheets: Sequence[SheetSide],
                      brief: PlanRequirements,
                      known: Sequence[float | None] | None = None) -> Broken | None:
    """Return what a plan breaks between its waypoints as a Broken, None if nothing.

    Parameters
    ----------
    path : GripperPath
        GripperPath through the gripper poses of the plan.
    shapes : sequence of Shape
        The n shapes at its waypoints.
    sheets : sequence of SheetSide
        (Sheet, normal (3,)) around the cut-outs.
    brief : PlanRequirements
        Workspace, obstacles, surface; its simulator finds the shapes between the waypoints; without
        one, and for shapes that are parts of its rod, the DLO is not looked at.
    known : sequence of float or None, optional
        Least room in the sheets at each waypoint, m; what is None is computed.
    """
    outside = None
    if brief.workspace is not None:
        beyond = brief.workspace.first_beyond(path)
        if beyond is not None:
            outside = Broken(*beyond, 'on the way there the gripper comes '
                             f'{beyond[2]:.3g} m beyond {beyond[1]}')
    if brief.simulator is None or not (sheets or brief.obstacles) or any(
            shape.s[-1] != brief.simulator.rod.length for shape in shapes):
        return outside
    return _Sweep(path, sheets, brief).broken(shapes, known, outside) or outside


@dataclass(frozen=True)
class _Look:
    """A Shape at a parameter of the path, and how much room it has.

    Attributes
    ----------
    u : float
        Parameter.
    shape : Shape
    arms : ndarray, shape (N + 1, 3)
        Vectors in m from the gripper to the nodes.
    levers : ndarray, shape (N + 1,)
        Lengths of the arms, m.
    rooms : ndarray, shape (N,)
        Lower bounds of the room of each element, m.
    least : float
        Least room of all in m, exact.
    """

    u: float
    shape: Shape
    arms: Floats
    levers: Floats
    rooms: Floats
    least: float


class _Sweep:
    """Goes along a path and keeps what is around the DLO."""

    def __init__(self, path: GripperPath, sheets: Sequence[SheetSide],
                 brief: PlanRequirements) -> None:
        self._path, self._sheets, self._brief = path, sheets, brief
        around = [sheet for sheet, _ in sheets]
        self._others = [obstacle for obstacle in brief.obstacles
                        if not any(obstacle is sheet for sheet in around)]
        self._bodies = [*around, *self._others]
        self._scene = build_scene(self._bodies, brief.surface, sharp=True)

    def broken(self, shapes: Sequence[Shape], known: Sequence[float | None] | None,
               found: Broken | None) -> Broken | None:
        """Return the first Broken on the way to n Shapes, before the one that is `found`."""
        known = [None] * len(shapes) if known is None else known
        for leg in self._path.legs:
            if leg.still:
                continue
            before, pieces = None, leg.pieces()
            for a, b, bends in zip(*pieces, leg.bounds(*pieces)[:, :, 1], strict=True):
                goal = self._path.goal(b)
                if found is not None and goal > found.waypoint:
                    return None
                self._brief.progress.check()
                if before is None:
                    start = np.searchsorted(self._path.times, a, side='right') - 1
                    before = self._look(a, shapes[start], known[start])
                after = self._look(b, shapes[goal], known[goal])
                what = self._between(leg, before, after, bends, _HALVINGS)
                if what is not None:
                    return Broken(goal, *what)
                before = after
        return None

    def _look(self, u: float, shape: Shape, known: float | None = None) -> _Look:
        rooms = [hole_clearances(*sheet, self._brief.surface, shape).min()
                 for sheet in self._sheets] if known is None else [known]
        if self._others:
            rooms.append(clearance(self._others, self._brief.surface, shape))
        least = float(min(rooms))
        arms = shape.positions - shape.gripper.position
        scene, surface = self._scene, self._brief.surface
        if surface.rod is not None:  # on each mesh another one
            scene = build_scene(self._bodies, surface, shape.s, sharp=True)
        return _Look(u, shape, arms, np.sqrt(np.einsum('ij,ij->i', arms, arms)), _element_rooms(
            scene, *shape.for_kernels, least), least)

    def _between(self, leg: Leg, one: _Look, other: _Look, bends: Floats,
                 halvings: int) -> Violation | None:
        """Return constraint, amount and words of what is broken between two Looks, or None.

        Parameters
        ----------
        bends : ndarray, shape (2,)
            Bounds of the path's second derivatives in between, linear and angular.
        """
        short, far = _short(one, other, bends)
        if short <= 0:
            return None
        if not halvings:
            if far:
                return 'continuity', far, (f'on the way there the DLO goes {far:.3g} m to where '
                                           'the gripper does not bring it')
            return 'clearance', short, (f'on the way there {short:.3g} m are missing to show that '
                                        'the DLO touches nothing; closer waypoints may help')
        middle, jumped = self._middle(leg, one, other)
        if middle is None:
            return jumped
        if middle.least < 0:
            deepest = self._deepest(leg, one, middle, other)
            return 'clearance', deepest, (f'on the way there the DLO is {deepest:.3g} m in the '
                                          'sheet or an obstacle')
        return (self._between(leg, one, middle, bends, halvings - 1)
                or self._between(leg, middle, other, bends, halvings - 1))

    def _middle(self, leg: Leg, one: _Look, other: _Look) -> tuple[_Look | None, Violation | None]:
        """Return the Look half way between two, and None or what `_between` says of a jump."""
        assert self._brief.simulator is not None  # else nothing is looked at between waypoints
        u = 0.5 * (one.u + other.u)
        (position,), (rotation,) = leg.poses(np.array([u]))
        shape = self._brief.simulator.track([Pose.from_rotation(position, rotation)],
                                            initial=one.shape)[0]
        if shape.converged and not shape.jumped:
            return self._look(u, shape), None
        away = float(np.linalg.norm(shape.positions[-1] - one.shape.positions[-1]))
        return None, ('continuity', away, 'on the way there the DLO falls into another shape: its '
                      f'free end comes {away:.3g} m away')

    def _deepest(self, leg: Leg, before: _Look, deep: _Look, after: _Look) -> float:
        """Return how deep (m) the DLO is in something near a Look where it is, at the worst."""
        for _ in range(_CLOSER):
            looks = [look for look in (before, self._middle(leg, before, deep)[0], deep,
                                       self._middle(leg, deep, after)[0], after)
                     if look is not None]
            k = min(range(1, len(looks) - 1), key=lambda k: looks[k].least)
            before, deep, after = looks[k - 1:k + 2]
        return -deep.least


def _short(one: _Look, other: _Look, bends: Floats) -> tuple[float, float]:
    """Return by how much (m) room is missing to prove that nothing is touched between two Looks.

    Also how far (m) the DLO moves, if that is more than a turn of the gripper can cause, or 0.
    """
    shift, bend = 0.125 * (other.u - one.u) ** 2 * bends
    turn = angle_between(one.shape.gripper.rotation, other.shape.gripper.rotation)
    length = one.shape.s[-1]
    moved = 0.0  # seen from the gripper
    if len(one.arms) == len(other.arms):
        moved = float(np.sqrt(((other.arms - one.arms) ** 2).sum(axis=1).max()))
    lever = moved / max(turn, 1e-9) if moved > 1e-12 * length else 0.0
    short = -np.inf
    for this, that in ((one, other), (other, one)):
        away = (0.5 * _curve_distances(this.shape, that.shape) + shift
                + np.maximum(this.levers, lever) * (bend + turn**2 / 8))
        short = max(short, float((np.maximum(away[1:], away[:-1]) - this.rooms).max()))
    return short, moved if moved > _LEAP * length * turn else 0.0


def _curve_distances(this: Shape, that: Shape) -> Floats:
    """Return (N + 1,) distances in m of the nodes of a Shape from another, prolonged, as curves."""
    ends = this.positions[[0, -1]] - that.positions[[0, -1]]
    reach = float(np.sqrt((ends**2).sum(axis=1).max()))
    result: Floats = _distances(np.array(this.s), this.for_kernels[3], np.array(that.s),
                                *that.for_kernels[1:], reach)
    return result


@kernel
def _element_rooms(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats,
                   positions: Floats, least: float) -> Floats:
    """Return (N,) a lower bound in m of the room of each element, none below the `least` of all."""
    x, slope, bend, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    rooms = np.full(lengths.size, np.inf)
    for o in range(scene.kind.size):
        if scene.feature[o] == NODE_FACE:
            continue
        last = 0.0
        begin, end = nodes_of(scene, o, lengths.size)
        for k in range(begin, end + 1):
            gap = node_gap(scene, o, k, rotations, positions, offset, x, slope, bend)
            if k > begin:
                e = k - 1
                reach = lengths[e] * stretch(scene, o, strains[e]) + abs(taper(scene, o, e))
                rooms[e] = min(rooms[e], 0.5 * (gap + last - reach))
            last = gap
    return np.maximum(rooms, least)  # type: ignore[no-any-return]


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
