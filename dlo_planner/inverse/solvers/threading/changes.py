# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All shapes in which a threading through two cut-outs may reach the second one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.solvers.conditions import Aligned, TwoPoints
from dlo_planner.inverse.solvers.continuation.following import Passing
from dlo_planner.inverse.solvers.continuation.quick import gets_there, thinned
from dlo_planner.inverse.solvers.continuation.route import Route, motion, picked, sweep
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes
from dlo_planner.inverse.solvers.hanging.start_candidates import with_free_end
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.builder import PlanRequirements

_CURVES = 16        # depths at which a route is looked for, before the change and after it
_CHANGES = 8        # changes that are tried
_UNLIKE = 0.3       # rad: between the grippers of two that are tried
_BEGINNINGS = 12    # of a route back that are examined


@dataclass(frozen=True)
class Change:
    """The change of the motion: the free end is at the second center.

    Attributes
    ----------
    passing : Passing
    depth : float
        Depth in m, in the first cut-out.
    back : Route or None
        Route before it.
    on : Route or None
        Route after it.
    """

    passing: Passing
    depth: float
    back: Route | None = None
    on: Route | None = None


@dataclass(frozen=True)
class Pair:
    """A threading through two cut-outs.

    Attributes
    ----------
    first : CutOut
    second : CutOut
    depths : ndarray, shape (n,)
        Depths in the first one, m.
    start : Pose or None
        Pose whose roll is kept as far as possible.
    demands : PlanRequirements
    """

    first: CutOut
    second: CutOut
    depths: Floats
    start: Pose | None
    demands: PlanRequirements

    def at_most(self, most: int) -> Pair:
        """Return the same at `most` of its depths, its steps unreported; itself if that is all."""
        if len(self.depths) <= most:
            return self
        return replace(self, depths=thinned(self.depths, most), demands=self.demands.silent())

    @property
    def chord(self) -> Floats:
        """(3,) from the first center to the second, m."""
        return self.second.center - self.first.center


def other_changes(simulator: DirectSimulator, task: Pair,
                  shapes: HangingShapes) -> Iterator[Change]:
    """Yield Changes with their Routes, found among all HangingShapes, the best first."""
    condition = TwoPoints(simulator, task.chord)
    changes, depths, along = at_the_second(simulator, task, shapes)
    routes_on = _routes_on(condition, shapes, changes, depths, task)
    for k in _unlike(changes, np.array([cost for cost, _ in routes_on])):
        task.demands.progress.check()
        back = _route_back(simulator, shapes, changes.chosen([k]), depths[k], along[k], task)
        if back is None:
            continue
        guess = with_free_end(simulator, changes.ends[k])
        shape = simulator.solve(guess.gripper, guess)
        solved = condition.from_end(shape, depths[k]) if shape.converged else None
        if solved is not None:
            yield Change(*solved, back, routes_on[k][1])


def at_the_second(simulator: DirectSimulator, task: Pair,
                  shapes: HangingShapes) -> tuple[Crossings, Floats, Floats]:
    """Return all Crossings whose free end is at the second center, in the right directions.

    And their depths (m,) and directions (m, 3) in the first one.
    """
    changes, depths = TwoPoints(simulator, task.chord).last_crossings(shapes)
    along = _directions(shapes, changes, simulator.rod.length - depths)
    right = (along @ task.first.normal > 0) & (changes.ends[:, :, 0] @ task.second.normal > 0)
    return changes.chosen(right), depths[right], along[right]


def _directions(shapes: HangingShapes, changes: Crossings, s: Floats) -> Floats:
    """Return the tangents (m, 3) of Crossings at arc lengths s (m,), about."""
    a = changes.pairs[:, 0]
    turns = changes.grippers @ np.swapaxes(shapes.frames[a, 0], 1, 2)
    return np.array([turn @ shapes.frames[k, np.searchsorted(shapes.s, at), :, 0]
                     for turn, k, at in zip(turns, a, s, strict=True)]).reshape(-1, 3)


def _unlike(changes: Crossings, costs: Floats) -> Iterator[int]:
    """Yield indices of changes, the cheapest first, without those like one before."""
    taken: list[int] = []
    for k in np.argsort(costs):
        if not np.isfinite(costs[k]) or len(taken) == _CHANGES:
            return
        if all(angle_between(changes.grippers[k], changes.grippers[j]) > _UNLIKE for j in taken):
            taken.append(int(k))
            yield int(k)


def _routes_on(condition: TwoPoints, shapes: HangingShapes, changes: Crossings, depths: Floats,
               task: Pair) -> list[tuple[float, Route | None]]:
    """Return [(cost, Route or None)] of going on from each change to the deepest waypoint."""
    length, deepest = shapes.s[-1], task.depths[-1]
    if not len(changes):
        return []
    grid = np.linspace(depths.min(), deepest, _CURVES)[1:]
    if deepest <= depths.min():
        return [(0.0, None)] * len(changes)
    layers = [condition.crossings(shapes, depth) for depth in grid[::-1]]
    costs, origins = sweep(layers, np.zeros(len(layers[0])), length)
    routes: list[tuple[float, Route | None]] = []
    for k, depth in enumerate(depths):
        later = grid[::-1] > depth
        if not later.any():
            routes.append((0.0, None))
            continue
        last = int(later.sum()) - 1  # the curve right after the change, in the order of the sweep
        if last >= len(costs):
            routes.append((np.inf, None))
            continue
        total = motion(changes.chosen([k]), layers[last], length)[0] + costs[last]
        best = int(np.argmin(total)) if total.size else 0
        if not total.size or not np.isfinite(total[best]):
            routes.append((np.inf, None))
            continue
        picks = picked(origins[:last], best)[::-1]
        grippers = [changes.grippers[k], *(layers[last - i].grippers[pick]
                                           for i, pick in enumerate(picks))]
        route = Route(np.append(depth, grid[::-1][:last + 1][::-1]), np.array(grippers),
                      changes.ends[k], length, True)
        routes.append((float(total[best]), route))
    return routes


def _route_back(simulator: DirectSimulator, shapes: HangingShapes, change: Crossings, depth: float,
                direction: Floats, task: Pair) -> Route | None:
    """Return the Route from a change (Crossings of one) to where the DLO begins, or None."""
    length, first = simulator.rod.length, task.depths[0]
    if first >= depth:
        return Route(np.array([depth]), change.grippers, change.ends[0], length, True)
    condition = Aligned(simulator, direction)
    grid = np.linspace(depth, first, _CURVES)
    layers = [change, *(condition.crossings(shapes, one) for one in grid[1:])]
    costs, origins = sweep(layers, np.zeros(1), length)
    if len(costs) < len(layers):
        return None
    for best in np.argsort(costs[-1])[:_BEGINNINGS]:
        if not np.isfinite(costs[-1][best]):
            return None
        gripper = Pose.from_rotation(layers[-1].places[best], layers[-1].grippers[best])
        if gets_there(simulator, gripper, layers[-1].ends[best]):
            picks = picked(origins, int(best))
            return Route(grid, np.array([layer.grippers[pick] for layer, pick in
                                         zip(layers, picks, strict=True)]),
                         layers[-1].ends[best], length, True)
    return None
