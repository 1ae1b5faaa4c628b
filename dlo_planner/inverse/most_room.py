# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading with the most room: the DLO passes the center in any direction.

What counts is the margin, the clearance in the hole less the miss that is to be expected. At each
of some depths all shapes that the DLO can come to (`inverse.reachable`) are looked at, turned about
the vertical so that they pass as upright as they can; dynamic programming over the depths (Bellman
1957) finds the way whose margins are largest and whose gripper turns least. A smooth curve along
its grippers (Whittaker 1923) is the plan's way; the shapes on it are followed, exact as any.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.shape import carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.scene import Scene
from dlo_planner.errors import Infeasible
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.so3 import (
    applied,
    inner,
    matrix,
    minus,
    put_matrix,
    put_vector,
    times,
    vector,
)
from dlo_planner.inverse.equilibria import headings_to, is_axisymmetric, least_turn
from dlo_planner.inverse.reachable import Reachable, hanging_straight, reachable_shapes
from dlo_planner.inverse.route import Threading, gets_there, quick_simulator
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.pose import Pose, turned_by
from dlo_planner.plan.builder import PlanBuilder, refusal_for_leap
from dlo_planner.plan.clearance import scene_about, sheet_of, smallest_gaps
from dlo_planner.plan.margin import DEVIATIONS, expected_misses, uncertain_state, upright_room
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import waypoint_at
from dlo_planner.uncertainty.parameters import Uncertainty
from dlo_planner.uncertainty.state import UncertainState

_KNOWN = 1e-4       # of the length: how exactly a search has to know the room
_LEAST = 0.05       # of the room of an upright DLO: less is lost between grid and plan
_DEPTHS = 24        # that are looked at
_TURN = 0.03        # per rad^2 between two depths, against the square of the part of room lost
_FARTHEST = 0.5     # rad of the gripper, and the sine of it, between two depths looked at
_SHIFT = 0.3        # of the length, the same
_MOST = 700         # shapes at a depth: those of the largest margin
_STARTS = 24        # shapes with which a way may begin that are tried
_FIRM = (3.0, 0.3, 0.0)  # how much smoothness counts, tried in turn: features of 8, 4, no depths go
_WORST = -10.0      # of the room: margins below this are alike, so that their squares stay finite


def largest_margins(simulator: DirectSimulator, uncertainty: Uncertainty | None, room: float,
                    depths: Floats) -> Floats:
    """Return (k,) margins (m) that no shape exceeds at depths (k,), m, in a hole with this room, m.

    They are of the DLO that hangs straight down, whose weight stiffens it most; where the loads are
    not along one axis, the room.
    """
    hanging = hanging_straight(simulator)
    if hanging is None:
        return np.full(len(depths), room)
    uncertain = uncertain_state(simulator.surroundings, uncertainty)
    return room - DEVIATIONS * expected_misses(uncertain, hanging, simulator.rod.length - depths)


class Passage(NamedTuple):
    """The m ways in which reachable shapes pass a hole at one depth."""

    which: Ints        # (m,) indices of the shapes
    grippers: Floats   # (m, 3, 3) rotations of the gripper
    places: Floats     # (m, 3) the gripper's origin from the center, m
    clearance: Floats  # (m,) m
    margin: Floats     # (m,) m

    def chosen(self, some: Bools | Ints) -> Passage:
        """Return some of them (a mask or indices)."""
        return Passage(self.which[some], *(one[some] for one in self[1:]))


@dataclass(frozen=True)
class RoomyWay:
    """A way of the gripper through K depths, found on the grid."""

    depths: Floats     # (K,) m
    grippers: Floats   # (K, 3, 3)
    margin: float      # the least on the way, m

    def smoothed(self, firm: float, depths: Floats) -> Floats:
        """Return rotations (n, 3, 3) at depths (n,) on a smooth curve along the way."""
        k = len(self.depths)
        bends = np.diff(np.eye(k), 2, axis=0)
        rows = np.linalg.solve(np.eye(k) + firm * bends.T @ bends, self.grippers.reshape(k, 9))
        between = np.array([np.interp(depths, self.depths, row) for row in rows.T]).T
        left, _, right = np.linalg.svd(between.reshape(-1, 3, 3))
        rotations: Floats = left @ right
        return rotations


def thread_with_most_room(simulator: DirectSimulator, task: Threading, most: float) -> Plan:
    """Return the Plan of a Threading through one cut-out with the largest margin that was found.

    The DLO passes obliquely by `most` at most, rad. Infeasible: none was found.
    """
    way = roomiest_way(quick_simulator(simulator), task, most)
    refused: Infeasible | None = None
    for firm in _FIRM:
        try:
            return _along(simulator, task, way.smoothed(firm, task.depths))
        except Infeasible as error:
            if refused is None or error.waypoint > refused.waypoint:
                refused = error
    assert refused is not None  # one is tried at least
    raise refused


def _along(simulator: DirectSimulator, task: Threading, grippers: Floats) -> Plan:
    """Return the Plan in which the gripper has rotations (n, 3, 3) at the depths."""
    cutout, length = task.cutouts[0], simulator.rod.length
    holes, builder = task.holes(length), PlanBuilder(task.depths, task.demands,
                                                     initial=task.initial)
    for depth, rotation in zip(task.depths.tolist(), grippers, strict=True):
        builder.check()
        pose, s = Pose.from_rotation((0.0, 0.0, 0.0), rotation), length - depth
        shape = simulator.solve(pose) if builder.last is None else simulator.track(
            [pose], initial=builder.last)[0]
        if not shape.converged:
            raise builder.refusal('equilibrium', 0.0, 'no stable shape is found')
        axes, place = shape.frame_at(s)
        shape = carried(shape, cutout.center - place)
        if shape.jumped and builder.waypoints:
            refused = refusal_for_leap(simulator, builder, shape)
            raise refused or builder.refusal('continuity', 0.0, 'the DLO would fall into another '
                                             'shape on the way there')
        waypoint = waypoint_at(shape, cutout.center, s, axes[:, 0], (axes, cutout.center))
        across = float(np.linalg.norm(np.cross(axes[:, 0], cutout.normal)))
        builder.add(holes.passed(waypoint._replace(misalignment=float(
            np.arctan2(across, axes[:, 0] @ cutout.normal)))))
    return builder.finished()


def roomiest_way(simulator: DirectSimulator, task: Threading, most: float) -> RoomyWay:
    """Return the way of the largest margins through one cut-out; Infeasible if there is none."""
    cutout, demands, length = task.cutouts[0], task.demands, simulator.rod.length
    builder = PlanBuilder(task.depths, demands)
    shapes = reachable_shapes(simulator, max(demands.stability, 0.0), demands.progress.check)
    if shapes is None:
        raise builder.refusal('room', 0.0, 'the loads on the DLO are not along one axis')
    depths = np.unique(np.linspace(task.depths[0], task.depths[-1], _DEPTHS))
    uncertain = uncertain_state(simulator.surroundings, demands.uncertainty)
    round_ = is_axisymmetric(simulator.rod)
    passages = list(passages_through(shapes, task, depths, uncertain, most, round_))
    full = upright_room(cutout, demands.surface)
    empty = next((k for k, one in enumerate(passages) if not one.which.size), None)
    if empty is not None:
        raise _no_room(builder, task, depths[empty], 'no shape that the DLO can come to has room '
                       'in this hole')
    costs, onward = _costs_to_go(passages, full, length, round_)
    if not np.isfinite(costs[0]).any():
        last = next(k for k in range(len(costs))[::-1] if not np.isfinite(costs[k]).any())
        raise _no_room(builder, task, depths[last], 'no shapes with room in this hole lead on')
    for k in np.argsort(costs[0])[:_STARTS].tolist():
        if not np.isfinite(costs[0][k]):
            break
        demands.progress.check()
        one = passages[0]
        turn = one.grippers[k] @ shapes.frames[one.which[k], 0].T
        if gets_there(simulator, Pose.from_rotation((0.0, 0.0, 0.0), one.grippers[k]),
                      turn @ shapes.frames[one.which[k], -1], task.initial):
            picks = [k]
            for step in onward:
                picks.append(int(step[picks[-1]]))
            grippers = np.array([one.grippers[p] for one, p in zip(passages, picks, strict=True)])
            if round_:
                grippers = _without_roll(grippers, task)
            return RoomyWay(depths, grippers, min(float(one.margin[p]) for one, p in zip(
                passages, picks, strict=True)))
    raise builder.refusal('start', 0.0, 'shapes with room in this hole lead through all depths, '
                          'but the DLO, set down there in its natural shape, falls into another')


def _no_room(builder: PlanBuilder, task: Threading, depth: float, why: str) -> Infeasible:
    """Return Infeasible for a depth, m."""
    index = min(int(np.searchsorted(task.depths, depth)), len(task.depths) - 1)
    return Infeasible(f'waypoint {index} (depth {depth:.4g} m): {why}', index, 'room', 0.0,
                      builder.partial(), 'm')


def _without_roll(grippers: Floats, task: Threading) -> Floats:
    """Return rotations (k, 3, 3) with the same axes, rolled as `start` and not on the way."""
    start = (Pose.looking_along((0.0, 0.0, 0.0), grippers[0, :, 0]) if task.start is None
             else task.start).rotation
    rolled = []
    for axis in grippers[:, :, 0]:
        start = least_turn(start[:, 0], axis) @ start
        rolled.append(start)
    return np.array(rolled)


def _costs_to_go(passages: list[Passage], full: float, length: float,
                 round_: bool) -> tuple[list[Floats], list[Ints]]:
    """Return costs [(m,)] of the best ways from each passage on, and the next on it [(m,)].

    round_: a roll of the gripper makes no difference.
    """
    def lost(one: Passage) -> Floats:
        part: Floats = (1 - np.maximum(one.margin / full, _WORST))**2
        return part

    costs, onward = [lost(passages[-1])], list[Ints]()
    for one, other in zip(passages[-2::-1], passages[:0:-1], strict=True):
        axes = (one.grippers[:, :, :1 if round_ else 3], other.grippers[:, :, :1 if round_ else 3])
        rows = [axis.reshape(len(axis), -1) for axis in axes]
        alike = rows[0] @ rows[1].T  # 1 or 3 without a turn
        turn = 2 * (1 - alike) if round_ else 3 - alike  # about its square, rad^2
        shift = ((one.places**2).sum(axis=1)[:, None] + (other.places**2).sum(axis=1)
                 - 2 * one.places @ other.places.T) / length**2
        far = (turn > _FARTHEST**2) | (shift > _SHIFT**2)
        total = np.where(far, np.inf, _TURN * (turn + np.maximum(shift, 0.0))) + costs[0]
        best = total.argmin(axis=1)
        onward.insert(0, best)
        costs.insert(0, total[np.arange(len(best)), best] + lost(one))
    return costs, onward


def passages_through(shapes: Reachable, task: Threading, depths: Floats, uncertain: UncertainState,
                     most: float, round_: bool) -> Iterator[Passage]:
    """Yield the Passage at each depth (K,), m.

    `most`: largest angle at which it passes, rad; round_: a roll of the gripper does not matter.
    """
    cutout, arcs = task.cutouts[0], shapes.s[-1] - depths
    sheet = sheet_of(cutout, shapes.s[-1], task.demands.obstacles)
    assert sheet is not None  # it has a size
    scene, center = scene_about(sheet, task.demands.surface, shapes.s), np.array(
        cutout.center - sheet.pose.position)
    lengths, misses = np.diff(shapes.s), dict[int, Floats]()
    for index, s in enumerate(arcs.tolist()):
        task.demands.progress.check()
        element = min(int(shapes.s.searchsorted(s, side='right')) - 1, lengths.size - 1)
        fraction = float((s - shapes.s[element]) / lengths[element])
        axes, places = _points(lengths, shapes.strains, shapes.frames, shapes.positions, element,
                               fraction)
        turns = _turns(axes[:, :, 0], np.array(cutout.normal), shapes.up, round_)
        rooms = _rooms(scene, np.array(cutout.normal), 0.5 * sheet.thickness, center, lengths,
                       shapes.strains, shapes.frames, shapes.positions, element, axes, places,
                       turns, np.cos(most) if most < 0.5 * np.pi else 0.0)
        which, heading = np.nonzero(rooms > _LEAST * upright_room(cutout, task.demands.surface))
        for k in set(which.tolist()) - misses.keys():
            misses[k] = expected_misses(uncertain, shapes.shapes[k], arcs)
        turned, room = turns[which, heading], rooms[which, heading]
        expected = np.array([misses[k][index] for k in which.tolist()])
        passage = Passage(which, turned @ shapes.frames[which, 0],
                          -np.einsum('kij,kj->ki', turned, places[which]), room,
                          room - DEVIATIONS * expected)
        yield passage.chosen(np.argsort(-passage.margin, kind='stable')[:_MOST])


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
def _points(lengths: Floats, strains: Floats, frames: Floats, positions: Floats, element: int,
            fraction: float) -> tuple[Floats, Floats]:
    """Return axes (n, 3, 3) and places (n, 3), m, in an element of n shapes."""
    n = strains.shape[0]
    axes, places = np.empty((n, 3, 3)), np.empty((n, 3))
    for i in range(n):
        point_inside(lengths, strains[i], frames[i], positions[i], element, fraction, axes[i],
                     places[i])
    return axes, places


@kernel
def _rooms(scene: Scene, normal: Floats, half: float, center: Floats, lengths: Floats,
           strains: Floats, frames: Floats, positions: Floats, element: int, axes: Floats,
           places: Floats, turns: Floats, steepest: float) -> Floats:
    """Return the room (n, h), m, of n shapes turned by (n, h, 3, 3), a point of each in the hole.

    -inf: it does not pass, comes back to the sheet, or passes at a cosine below `steepest`.

    Args:
        center: (3,) from the scene's origin; half: of the sheet's thickness, m
        axes, places: (n, 3, 3) and (n, 3) of the points, in an element
    """
    n, nodes, count = strains.shape[0], positions.shape[1], turns.shape[1]
    rooms = np.full((n, count), -np.inf)
    rotations, points = np.empty((nodes, 3, 3)), np.empty((nodes, 3))
    for i in range(n):
        for h in range(count):
            turn = matrix(turns[i, h])
            if inner(normal, applied(turn, vector(axes[i, :, 0]))) <= steepest:
                continue
            passes = True
            for k in range(nodes):
                put_vector(applied(turn, minus(vector(positions[i, k]), vector(places[i]))),
                           points[k])
                height = inner(normal, points[k])
                points[k] += center
                if k <= element and height > 0.0 or k > element + 1 and height < 0.0:
                    passes = False
                    break
            if passes:
                for k in range(nodes):
                    put_matrix(times(turn, matrix(frames[i, k])), rotations[k])
                rooms[i, h] = np.min(smallest_gaps(scene, lengths, strains[i], rotations, points,
                                                   normal, half, _KNOWN))
    return rooms
