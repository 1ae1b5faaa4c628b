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
simulated, and the straight way is looked at by `inverse.continuity`.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dlo_planner.energy.distance import build_scene, signed_distance
from dlo_planner.inverse.clearance import clearance, room_in
from dlo_planner.model.pose import Pose
from dlo_planner.ritz.kinematics import point_inside

_HALVINGS = 7   # of the way between two waypoints
_LEAP = 3.0     # motion of the DLO per lever and turn of the gripper: more is no continuation


@dataclass(frozen=True, eq=False)
class Broken:
    """What is broken on the way to a waypoint: its index, the constraint, by how much, in words."""

    waypoint: int
    constraint: str
    amount: float
    why: str


def broken_between(path, shapes, sheets, brief):
    """Return what a plan breaks between its waypoints as a Broken, None if nothing.

    Args:
        path: GripperPath through the gripper poses of the plan
        shapes: n Shape at its waypoints
        sheets: (Sheet, normal (3,)) around the cut-outs
        brief: Brief: workspace, obstacles, radius; its simulator tells the shapes between the
            waypoints; without one, and for shapes that are parts of its rod, the DLO is not
            looked at
    """
    found = None
    if brief.workspace is not None:
        beyond = brief.workspace.first_beyond(path)
        if beyond is not None:
            found = Broken(*beyond, f'on the way there the gripper comes {beyond[2]:.3g} m beyond '
                           f'{beyond[1]}')
    if brief.simulator is None or not (sheets or brief.obstacles) or any(
            shape.s[-1] != brief.simulator.rod.length for shape in shapes):
        return found
    return _Sweep(path, sheets, brief).broken(shapes, found) or found


@dataclass(frozen=True)
class _Look:
    """A Shape at a parameter of the path, and its room: (N,) of each element, least of all, m."""

    u: float
    shape: object
    rooms: np.ndarray
    least: float


class _Sweep:
    """Goes along a path and keeps what is around the DLO."""

    def __init__(self, path, sheets, brief):
        self._path, self._sheets, self._brief = path, sheets, brief
        around = [sheet for sheet, _ in sheets]
        self._others = [obstacle for obstacle in brief.obstacles
                        if not any(obstacle is sheet for sheet in around)]
        self._scene = build_scene([*around, *self._others], brief.radius)

    def broken(self, shapes, found):
        """Return the first Broken on the way to n Shapes, before the one that is `found`."""
        for leg in self._path.legs:
            if leg.still:
                continue
            before = None
            for a, b in zip(*leg.pieces(), strict=True):
                goal = self._path.goal(b)
                if found is not None and goal > found.waypoint:
                    return None
                self._brief.progress.check()
                if before is None:
                    start = np.searchsorted(self._path.times, a, side='right') - 1
                    before = self._look(a, shapes[start])
                after = self._look(b, shapes[goal])
                what = self._between(leg, before, after, _HALVINGS)
                if what is not None:
                    return Broken(goal, *what)
                before = after
        return None

    def _look(self, u, shape):
        rooms = [room_in(*sheet, self._brief.radius, shape).min() for sheet in self._sheets]
        if self._others:
            rooms.append(clearance(self._others, self._brief.radius, shape))
        least = float(min(rooms))
        return _Look(u, shape, _element_rooms(self._scene, np.diff(shape.s), shape.positions,
                                              least), least)

    def _between(self, leg, one, other, halvings):
        """Return constraint, amount and words of what is broken between two Looks, or None."""
        short, far = self._short(leg, one, other)
        if short <= 0:
            return None
        if not halvings:
            if far:
                return 'continuity', far, (f'on the way there the DLO goes {far:.3g} m to where '
                                           'the gripper does not bring it')
            return 'clearance', short, (f'on the way there {short:.3g} m are missing to show that '
                                        'the DLO touches nothing; closer waypoints may help')
        u = 0.5 * (one.u + other.u)
        (position,), (rotation,) = leg.poses(np.array([u]))
        shape = self._brief.simulator.track([Pose.from_rotation(position, rotation)],
                                            initial=one.shape)[0]
        if not shape.converged or shape.jumped:
            away = np.linalg.norm(shape.positions - one.shape.positions, axis=1).max()
            return 'continuity', float(away), 'on the way there the DLO falls into another shape'
        middle = self._look(u, shape)
        if middle.least < 0:
            return 'clearance', -middle.least, (f'on the way there the DLO is {-middle.least:.3g} m '
                                                'in the sheet or an obstacle')
        return (self._between(leg, one, middle, halvings - 1)
                or self._between(leg, middle, other, halvings - 1))

    def _short(self, leg, one, other):
        """Return by how much (m) room is missing to prove that nothing is touched between.

        Also how far (m) the DLO moves, if that is more than a turn of the gripper can cause, or 0.
        """
        shapes = one.shape, other.shape
        bulge, bend = (other.u - one.u) ** 2 / 8 * leg.bounds(
            np.array([one.u]), np.array([other.u]))[0, :, 1]
        cosine = 0.5 * (np.vdot(*(shape.gripper.rotation for shape in shapes)) - 1)
        turn = float(np.arccos(min(max(cosine, -1.0), 1.0)))
        arms = [shape.positions - shape.gripper.position for shape in shapes]
        short, far = -np.inf, 0.0
        answer = np.zeros(1)
        if shapes[0].s.size == shapes[1].s.size:
            answer = np.linalg.norm(arms[1] - arms[0], axis=1)
            far = float(answer.max()) if answer.max() > _LEAP * shapes[0].s[-1] * turn else 0.0
        for this, that, arm, rooms in ((*shapes, arms[0], one.rooms),
                                       (*shapes[::-1], arms[1], other.rooms)):
            lever = np.maximum(np.linalg.norm(arm, axis=1), answer.max() / max(turn, 1e-9)
                               if answer.max() > 1e-12 * this.s[-1] else 0.0)
            away = 0.5 * _apart(this, that) + bulge + lever * (bend + turn**2 / 8)
            short = max(short, float((np.maximum(away[1:], away[:-1]) - rooms).max()))
        return short, far


def _apart(this, that):
    """Return (N + 1,) distances in m of the nodes of a Shape from another, prolonged, as curves."""
    reach = max(np.linalg.norm(this.positions[k] - that.positions[k]) for k in (0, -1))
    return _distances(this.positions, np.diff(that.s), that.element_strains, that.frames,
                      that.positions, reach)


@njit(cache=True)
def _element_rooms(scene, lengths, positions, least):
    """Return (N,) a lower bound in m of the room of each element, none below the `least` of all."""
    x, slope, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    rooms = np.full(lengths.size, np.inf)
    for o in range(scene.kind.size):
        last = 0.0
        for k in range(positions.shape[0]):
            for i in range(3):
                x[i] = positions[k, i]
            gap = signed_distance(scene, o, x, slope, bend) - scene.radius
            if k:
                rooms[k - 1] = min(rooms[k - 1], 0.5 * (gap + last - lengths[k - 1]))
            last = gap
    return np.maximum(rooms, least)


@njit(cache=True)
def _distances(points, lengths, strains, rotations, positions, reach):
    """Return distances (n,) in m, none too small, of points (n, 3) from a DLO prolonged by reach.

    The nearest place is sought on the chords of the elements, the distance is from the arc there.
    """
    n = lengths.size
    out = np.empty(points.shape[0])
    frame, x = np.empty((3, 3)), np.empty(3)
    for k in range(points.shape[0]):
        nearest, element, share = np.inf, 0, 0.0
        for e in range(n):
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
            along = away = 0.0
            for i in range(3):
                gap = points[k, i] - positions[end, i]
                along += sign * rotations[end, i, 0] * gap
                away += gap * gap
            along = min(max(along, 0.0), reach)
            beyond = 0.0
            for i in range(3):
                gap = points[k, i] - positions[end, i]
                beyond += (gap - sign * along * rotations[end, i, 0]) ** 2
            square = min(square, beyond)
        out[k] = np.sqrt(square)
    return out
