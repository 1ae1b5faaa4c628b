# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading with the most room: the DLO passes the center in any direction.

What counts is the margin: the clearance in the hole less the expected miss, or how much is lacking
(`plan.margin`). At some depths all shapes that the DLO can come to (`inverse.reachable`) are looked
at, turned about the vertical so that they pass as upright as they can; dynamic programming over the
depths (Bellman 1957) finds the way of the best ratings whose gripper turns least. A smooth curve
along its grippers (Whittaker 1923) is the way of the plan; the shapes on it are followed, as exact
as those of any plan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.gap import gap_at, node_range, radius_at, stretch, taper
from dlo_planner.energy.scene import AXIS, FACE, Scene, sheet_distance
from dlo_planner.errors import Infeasible
from dlo_planner.geometry.kinematics import point_inside, points_inside
from dlo_planner.geometry.so3 import (
    applied,
    inner,
    matrix,
    minus,
    plus,
    put_matrix,
    put_vector,
    rotation_and_chord,
    times,
    transposed_applied,
    vector,
)
from dlo_planner.inverse.equilibria import headings_to, is_axisymmetric, least_turn
from dlo_planner.inverse.reachable import Reachable, hanging_straight, reachable_shapes
from dlo_planner.inverse.route import Threading, gets_there, quick_simulator
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose, turned_by
from dlo_planner.plan.builder import PlanBuilder, refusal_for_leap
from dlo_planner.plan.checks import PlanChecker, violated
from dlo_planner.plan.clearance import scene_about, sheet_of
from dlo_planner.plan.margin import (
    DEVIATIONS,
    expected_misses,
    rating,
    uncertain_state,
    upright_room,
)
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import Plan, passages
from dlo_planner.plan.waypoint import Waypoint, waypoint_at
from dlo_planner.uncertainty.parameters import Uncertainty

_STEP = 0.2         # of the room of an upright DLO, between points looked at: off by half at most
_LEAST = 0.01       # of the room of an upright DLO: less is lost between grid and plan
_DEPTHS = 24        # that are looked at
_STEEPEST = 0.98    # of the largest angle that is allowed: smoothing turns a way a little
_TURN = 0.03        # per rad^2 between two depths, against the square of the part of room lost
# The same of a roll where looks are made: what they leave unknown of how the DLO is bent and held
# turns with the gripper. A soft wire misses by the room and more, rolled by 1 rad
_ROLL = 1.0
_FARTHEST = 0.5     # rad, about: the gripper turns no farther between two depths looked at,
_SHIFT = 0.3        # and shifts no farther, of the length
_MOST = 400         # shapes at a depth: those of the largest margin
_STARTS = 24        # shapes at the first depth that are tried as the beginning of a way
_AT_ONCE = 128      # shapes whose misses are found between two looks at the deadline: 10 ms
_FIRM = (3.0, 0.3, 0.0)  # weights of smoothness, in turn: features of 8 depths go, of 4, none


def best_rating(simulator: DirectSimulator, uncertainty: Uncertainty | None, room: float,
                depths: Floats) -> float:
    """Return an upper bound of the least rating at depths (k,), m, in a hole with a room in m.

    It is of the DLO that hangs straight down, whose weight stiffens it most, upright in the hole.
    """
    hanging = hanging_straight(simulator)
    if hanging is None:
        return 1.0
    uncertain = uncertain_state(simulator.surroundings, uncertainty)
    expected, = expected_misses(uncertain, [hanging], simulator.rod.length - depths)
    return float(rating(np.full(len(depths), room), room - DEVIATIONS * expected, room).min())


class Passage(NamedTuple):
    """The m ways in which reachable shapes pass a hole at one depth."""

    which: Ints        # (m,) indices of the shapes
    grippers: Floats   # (m, 3, 3) rotations of the gripper
    places: Floats     # (m, 3) the gripper's origin from the center, m
    rating: Floats     # (m,) of clearance and margin, see `plan.margin`

    def best(self) -> Passage:
        """Return those of the best ratings, so many as a search can look at."""
        some = np.argsort(-self.rating, kind='stable')[:_MOST]
        return Passage(self.which[some], *(one[some] for one in self[1:]))


@dataclass(frozen=True)
class RoomyWay:
    """A way of the gripper through K depths, found on the grid."""

    depths: Floats     # (K,) m
    grippers: Floats   # (K, 3, 3)

    def smoothed(self, firm: float, depths: Floats) -> Floats:
        """Return rotations (n, 3, 3) at depths (n,) on a smooth curve along the way."""
        k = len(self.depths)
        bends = np.diff(np.eye(k), 2, axis=0)
        rows = np.linalg.solve(np.eye(k) + firm * bends.T @ bends, self.grippers.reshape(k, 9))
        between = np.array([np.interp(depths, self.depths, row) for row in rows.T]).T
        left, _, right = np.linalg.svd(between.reshape(-1, 3, 3))
        rotations: Floats = left @ right
        return rotations


def search_of(simulator: DirectSimulator, task: Threading) -> RoomSearch:
    """Return the RoomSearch for plans of a Threading, or of others with its depths and demands."""
    return RoomSearch(quick_simulator(simulator), task.demands, np.unique(np.linspace(
        task.depths[0], task.depths[-1], _DEPTHS)))


def thread_with_most_room(simulator: DirectSimulator, task: Threading, most: float,
                          search: RoomSearch | None = None) -> Plan:
    """Return the Plan of a Threading through one cut-out with the largest margin that was found.

    The DLO passes obliquely by `most` at most, rad. `search`: one by `search_of`, where it is used
    again. Infeasible: none was found.
    """
    way = (search or search_of(simulator, task)).way(task, _STEEPEST * most)
    cutout, length = task.cutouts[0], simulator.rod.length
    holes = task.holes(length)

    def waypoint(shape: Shape, depth: float) -> Waypoint:
        s = length - depth
        axes, place = shape.frame_at(s)
        shape = carried(shape, cutout.center - place)
        made = waypoint_at(shape, cutout.center, s, axes[:, 0], (axes, cutout.center))
        across = float(np.linalg.norm(np.cross(axes[:, 0], cutout.normal)))
        return holes.passed(made._replace(misalignment=float(
            np.arctan2(across, axes[:, 0] @ cutout.normal))))

    return planned_along(simulator, task, way, waypoint, most)


def missed_between(simulator: DirectSimulator, plan: Plan) -> float:
    """Return by how much a Plan through one cut-out misses its center between waypoints, m.

    Half-way from each waypoint to the next, of the DLO that follows slowly: where waypoints are few
    and the gripper turns far, the DLO does not keep to the center on the way.
    """
    if len(plan) < 2 or not plan.times[-1] > plan.times[0]:
        return 0.0
    path, largest = GripperPath.of(plan), 0.0
    for k, shape in enumerate(plan.shapes[:-1]):
        (position,), (rotation,) = path.at(0.5 * (plan.times[k:k + 1] + plan.times[k + 1:k + 2]))
        between = simulator.track([Pose.from_rotation(position, rotation)], initial=shape)[0]
        goal, = passages(plan.via_points[k + 1], float(shape.s[-1]))
        if plan.depths[k + 1] > 0:  # else the free end has not come there
            largest = max(largest, float(np.linalg.norm(goal.residuals(between))))
    return largest


def planned_along(simulator: DirectSimulator, task: Threading, way: RoomyWay | NoRoom,
                  waypoint: Callable[[Shape, float], Waypoint], most: float = np.inf) -> Plan:
    """Return the Plan along the smoothest of some curves along a way that keeps the demands.

    `waypoint` puts a Shape in its place at a depth, m; the DLO passes obliquely by `most` at most,
    rad. Infeasible: the refusal of the curve that leads farthest.
    """
    if isinstance(way, NoRoom):
        raise way.refusal(task)
    refused: Infeasible | None = None
    for firm in _FIRM:
        try:
            return _along(simulator, task, way.smoothed(firm, task.depths), waypoint, most)
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    assert refused is not None  # one is tried at least
    raise refused


def _along(simulator: DirectSimulator, task: Threading, grippers: Floats,
           waypoint: Callable[[Shape, float], Waypoint], most: float) -> Plan:
    """Return the Plan in which the gripper has rotations (n, 3, 3) at the depths."""
    builder = PlanBuilder(task.depths, task.demands, initial=task.initial)
    for depth, rotation in zip(task.depths.tolist(), grippers, strict=True):
        builder.check()
        pose = Pose.from_rotation((0.0, 0.0, 0.0), rotation)
        shape = simulator.solve(pose) if builder.last is None else simulator.track(
            [pose], initial=builder.last)[0]
        if not shape.converged:
            raise builder.refusal('equilibrium', 0.0, 'no stable shape is found')
        made = waypoint(shape, depth)
        if shape.jumped and builder.waypoints:
            refused = refusal_for_leap(simulator, builder, made.shape)
            raise refused or builder.refusal('continuity', 0.0, 'the DLO would fall into another '
                                             'shape on the way there')
        if made.misalignment > most:
            raise builder.refusal('max_misalignment', made.misalignment - most, 'the DLO would '
                                  f'pass at {made.misalignment:.4g} rad, max_misalignment = '
                                  f'{most:.4g} rad', 'rad')
        builder.add(made)
    return builder.finished()


class NoRoom(NamedTuple):
    """Why no way leads through a hole."""

    depth: float  # m, where none does
    why: str
    constraint: str = 'room'

    def refusal(self, task: Threading) -> Infeasible:
        """Return it as the refusal of a Threading."""
        index = min(int(np.searchsorted(task.depths, self.depth)), len(task.depths) - 1)
        return Infeasible(f'waypoint {index} (depth {self.depth:.4g} m): {self.why}', index,
                          self.constraint, np.nan,  # by how much, nobody has looked
                          PlanBuilder(task.depths, task.demands).partial(), 'm')


class RoomSearch:
    """Looks for ways of a DLO through any hole, at depths (K,), m: its shapes are found once."""

    def __init__(self, simulator: DirectSimulator, demands: PlanChecker, depths: Floats) -> None:
        self.simulator, self.demands, self.depths = simulator, demands, depths
        self.round = is_axisymmetric(simulator.rod)  # a roll of the gripper makes no difference
        found = reachable_shapes(simulator, max(demands.stability, 0.0), demands.progress.check)
        self.shapes = None if found is None else found.chosen(np.array([
            violated(demands.bend_margins(shape)) is None for shape in found.shapes]))
        self._uncertain = uncertain_state(simulator.surroundings, demands.uncertainty)
        self._misses: dict[int, Floats] = {}

    def misses(self, which: Ints, index: int) -> Floats:
        """Return the expected misses (m,) of some shapes at one of the depths, m."""
        if not self._uncertain.size or self.shapes is None:
            return np.zeros(len(which))
        missing = [k for k in dict.fromkeys(which.tolist()) if k not in self._misses]
        for begin in range(0, len(missing), _AT_ONCE):
            self.demands.progress.check()
            some = missing[begin:begin + _AT_ONCE]
            self._misses.update(zip(some, expected_misses(
                self._uncertain, [self.shapes.shapes[k] for k in some],
                self.simulator.rod.length - self.depths), strict=True))
        return np.array([self._misses[k][index] for k in which.tolist()])

    def misses_at(self, which: Ints, s: Floats) -> Floats:
        """Return the expected misses (m,) of some shapes at arc lengths s (m,), m.

        They are between those at the depths, the deepest and the first one at most.
        """
        self.misses(which, 0)
        arcs = self.simulator.rod.length - self.depths[::-1]
        return np.array([np.interp(one, arcs, self._misses[k][::-1]) if k in self._misses else 0.0
                         for k, one in zip(which.tolist(), s.tolist(), strict=True)])

    def way(self, task: Threading, most: float, rated: bool = True) -> RoomyWay | NoRoom:
        """Return the way of the largest margins through the hole of a Threading, or why not.

        `most`: largest angle at which the DLO may pass, rad. Unless `rated`, no miss is expected:
        that is quicker where only whether there is a way counts.
        """
        if upright_room(task.cutouts[0], self.demands.surface) <= 0:
            return NoRoom(float(self.depths[0]), 'the hole is no wider than the DLO')
        return self.through(task, lambda shapes: _passages(self, shapes, task, most, rated),
                            'this hole' if most >= 0.5 * np.pi else
                            'this hole within max_misalignment')

    def through(self, task: Threading, passed: Callable[[Reachable], Iterable[Passage]],
                where: str) -> RoomyWay | NoRoom:
        """Return the way of the best ratings through the Passages at each depth, or why not.

        `where`: the hole, in words.
        """
        shapes, depths = self.shapes, self.depths
        if shapes is None:
            return NoRoom(float(depths[0]), 'the DLO does not hang stably straight down, or its '
                          'loads are not along one axis')
        if not shapes.shapes:
            return NoRoom(float(depths[0]), 'no shape that the DLO can come to is bent as little '
                          'as it has to be')
        passages = list(passed(shapes))
        empty = next((k for k, one in enumerate(passages) if not one.which.size), None)
        if empty is not None:
            return NoRoom(float(depths[empty]), 'no shape that the DLO can come to has room in '
                          f'{where}')
        costs, choices = _costs_to_go(passages, self.simulator.rod.length, 1 if self.round else 3,
                                     _ROLL if task.seen else 0.0)
        if task.seen and task.start is not None and not self.round:
            costs[0] = costs[0] + _ROLL * _rolls(task.start.rotation, passages[0].grippers)**2
        if not np.isfinite(costs[0]).any():
            last = max(k for k in range(len(costs)) if not np.isfinite(costs[k]).any())
            return NoRoom(float(depths[last]), f'no shapes with room in {where} lead on')
        first = passages[0]
        for k in np.argsort(costs[0])[:_STARTS].tolist():
            self.demands.progress.check()
            if not np.isfinite(costs[0][k]):
                break
            turn = first.grippers[k] @ shapes.frames[first.which[k], 0].T
            if gets_there(self.simulator, Pose.from_rotation((0.0, 0.0, 0.0), first.grippers[k]),
                          turn @ shapes.frames[first.which[k], -1], task.initial):
                picks = [k]
                for step in reversed(choices):
                    picks.append(int(step[picks[-1]]))
                grippers = np.array([one.grippers[p]
                                     for one, p in zip(passages, picks, strict=True)])
                return RoomyWay(depths, _without_roll(grippers, task) if self.round else grippers)
        return NoRoom(float(depths[0]), f'shapes with room in {where} lead through all depths, '
                      'but the DLO, set down there in its natural shape, snaps into another',
                      'start')


def _without_roll(grippers: Floats, task: Threading) -> Floats:
    """Return rotations (k, 3, 3) with the same axes, rolled as `start` and not on the way."""
    start = (Pose.looking_along((0.0, 0.0, 0.0), grippers[0, :, 0]) if task.start is None
             else task.start).rotation
    rolled = []
    for axis in grippers[:, :, 0]:
        start = least_turn(start[:, 0], axis) @ start
        rolled.append(start)
    return np.array(rolled)


def _rolls(start: Floats, grippers: Floats) -> Floats:
    """Return by how much rotations (k, 3, 3) are rolled from that at the start (3, 3), rad."""
    straight = np.array([least_turn(start[:, 0], axis) @ start for axis in grippers[:, :, 0]])
    sines, cosines = (np.einsum('ki,ki->k', grippers[:, :, 1], straight[:, :, b]) for b in (2, 1))
    result: Floats = np.abs(np.arctan2(sines, cosines))
    return result


def _costs_to_go(passages: list[Passage], length: float, columns: int,
                 roll: float) -> tuple[list[Floats], list[Ints]]:
    """Return costs [(m,)] of the best ways on from each depth, and the next [(m,)], the last first.

    columns: how many axes of the gripper count; 1: a roll makes no difference. roll: what one costs
    beside a turn, per rad^2.
    """
    costs, choices = [(1 - passages[-1].rating)**2], list[Ints]()
    for one, other in zip(passages[-2::-1], passages[:0:-1], strict=True):
        cost, best = _cheapest(one.grippers, one.places / length, other.grippers,
                               other.places / length, costs[0], columns, roll)
        choices.append(best)
        costs.insert(0, cost + (1 - one.rating)**2)
    return costs, choices


@kernel
def _cheapest(grippers: Floats, places: Floats, others: Floats, there: Floats, costs: Floats,
              columns: int, roll: float) -> tuple[Floats, Ints]:
    """Return the least costs (m,) of going on, and to which of the others (k,) at these costs.

    Places are (m, 3) and (k, 3), of the length. See `_costs_to_go`.
    """
    out, best = np.full(grippers.shape[0], np.inf), np.zeros(grippers.shape[0], np.int64)
    for i in range(grippers.shape[0]):
        for j in range(others.shape[0]):
            if costs[j] >= out[i]:
                continue
            # about the squares of the turn, rad^2, and of the shift
            turn = swing = shift = 0.0
            for a in range(3):
                swing += (grippers[i, a, 0] - others[j, a, 0])**2
                for b in range(columns):
                    turn += (grippers[i, a, b] - others[j, a, b])**2
                shift += (places[i, a] - there[j, a])**2
            if columns > 1:
                turn *= 0.5
            if turn > _FARTHEST**2 or shift > _SHIFT**2:
                continue
            cost = costs[j] + _TURN * (turn + shift) + roll * max(turn - swing, 0.0)
            if cost < out[i]:
                out[i], best[i] = cost, j
    return out, best


def _passages(search: RoomSearch, shapes: Reachable, task: Threading, most: float,
              rated: bool) -> Iterator[Passage]:
    """Yield the Passage at each depth, obliquely by `most` at most, rad; see `RoomSearch.way`."""
    cutout, demands, lengths = task.cutouts[0], task.demands, np.diff(shapes.s)
    sheet = sheet_of(cutout, float(shapes.s[-1]), demands.obstacles)
    assert sheet is not None  # it has a size
    scene, normal = scene_about(sheet, demands.surface, shapes.s), np.array(cutout.normal)
    center = np.array(cutout.center - sheet.pose.position)
    full = upright_room(cutout, demands.surface)
    for index, s in enumerate((shapes.s[-1] - search.depths).tolist()):
        demands.progress.check()
        element = min(int(shapes.s.searchsorted(s, side='right')) - 1, lengths.size - 1)
        fraction = float((s - shapes.s[element]) / lengths[element])
        axes, places = (found[:, 0] for found in points_inside(
            lengths, shapes.strains, shapes.frames, shapes.positions, np.array([element]),
            np.array([fraction])))
        turns = _turns(axes[:, :, 0], normal, shapes.up, search.round)
        rooms = _rooms(scene, normal, center, lengths, shapes.strains, shapes.frames,
                       shapes.positions, element, fraction, axes, places, turns,
                       np.cos(most) if most < 0.5 * np.pi else 0.0, _LEAST * full, _STEP * full)
        which, heading = np.nonzero(rooms > 0)
        turned, room = turns[which, heading], rooms[which, heading]
        misses = search.misses(which, index) if rated else np.zeros(len(which))
        passage = Passage(which, turned @ shapes.frames[which, 0],
                          -np.einsum('kij,kj->ki', turned, places[which]),
                          rating(room, room - DEVIATIONS * misses, full))
        yield passage.best()


def _turns(tangents: Floats, normal: Floats, up: Floats, round_: bool) -> Floats:
    """Return (n, h, 3, 3) turns about `up` with which tangents (n, 3) are looked at.

    That which brings one as near to the normal as it can, and the opposite; all around where the
    normal is along `up`, of which one is enough for a round straight DLO.
    """
    turns = headings_to(tangents, normal, up).reshape(len(tangents), -1, 3, 3)
    if turns.shape[1] > 1:
        return turns[:, :1] if round_ else turns
    return np.concatenate([turns, turned_by(np.pi * up) @ turns], axis=1)


@kernel
def _rooms(scene: Scene, normal: Floats, center: Floats, lengths: Floats, strains: Floats,
           frames: Floats, positions: Floats, element: int, fraction: float, axes: Floats,
           places: Floats, turns: Floats, steepest: float, least: float, step: float) -> Floats:
    """Return the room (n, h), m, of n shapes turned by (n, h, 3, 3), a point of each in the hole.

    It is exact to half a step (m). -inf: the shape does not pass, comes back to the sheet, passes
    at a cosine below `steepest`, or has less room than the `least`, m.

    Args:
        center: (3,) of the hole, m
        axes, places: (n, 3, 3) and (n, 3) of the points, at a fraction of an element
    """
    n, nodes, count = strains.shape[0], positions.shape[1], turns.shape[1]
    rooms, across = np.full((n, count), -np.inf), np.empty(3)
    for i in range(n):
        for h in range(count):
            # heights are along the normal in the frame of the shape as it is
            put_vector(transposed_applied(matrix(turns[i, h]), vector(normal)), across)
            if inner(across, axes[i, :, 0]) <= steepest:
                continue
            passes = True
            for k in range(nodes):
                height = 0.0
                for a in range(3):
                    height += across[a] * (positions[i, k, a] - places[i, a])
                if k <= element and height > 0.0 or k > element + 1 and height < 0.0:
                    passes = False
                    break
            if passes:
                room = _least_room(scene, lengths, strains[i], frames[i], positions[i], element,
                                   fraction, places[i], turns[i, h], center, least, step)
                rooms[i, h] = room if room > least else -np.inf
    return rooms


@kernel
def _least_room(scene: Scene, lengths: Floats, strains: Floats, frames: Floats, positions: Floats,
                element: int, fraction: float, place: Floats, turn: Floats, center: Floats,
                enough: float, step: float) -> float:
    """Return the least gap (m) of a DLO that is turned, its `place` (3,) in the center of the hole.

    Along the DLO a gap changes no faster than the arc length: the next point that may have a
    smaller one is as far ahead as this gap exceeds the least. Faces of strips are not looked at.
    """
    room, turned = np.inf, matrix(turn)
    shift, held = minus(vector(center), applied(turned, vector(place))), np.empty((3, 3))
    there = plus(shift, vector(scene.origin))
    x, frame, offset = np.empty(3), np.empty((3, 3)), np.empty(2)
    point, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        if scene.feature[o] >= FACE:
            continue
        first, last = node_range(scene, o, lengths.size)
        # in the hole first: where the gap is small, far points need no look
        e, share, ahead = min(max(element, first), last - 1), fraction, -1.0
        while room > enough:
            radius = radius_at(scene, o, e, share)
            if scene.feature[o] == AXIS:
                h, bent, begin = share * lengths[e], strains[e], vector(positions[e])
                _, chord = rotation_and_chord(h * bent[0], h * bent[1], h * bent[2], h)
                inside = plus(begin, applied(matrix(frames[e]), chord))
                put_vector(plus(applied(turned, inside), there), x)
                gap = sheet_distance(scene, o, x) - radius
            else:
                point_inside(lengths, strains, frames, positions, e, share, held, x)
                put_vector(plus(applied(turned, vector(x)), shift), x)
                put_matrix(times(turned, matrix(held)), frame)
                gap = gap_at(scene, o, frame, x, radius, offset, point, normal, hessian)
            room = min(room, gap)
            if ahead < 0.0:
                e, ahead = first, 0.0
            elif e == last - 1 and share == 1.0:
                break
            else:
                ahead += step + (gap - room) / (stretch(scene, o, strains[e]) + abs(
                    taper(scene, o, e)) / lengths[e])
            while ahead > lengths[e] and e < last - 1:
                ahead -= lengths[e]
                e += 1
            share = min(ahead / lengths[e], 1.0)
    return room
