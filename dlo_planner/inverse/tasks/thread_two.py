# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through two cut-outs: their centers without orientation (paper, section 5.2, Fig. 14).

Until the free end reaches the second cut-out, the DLO passes the first one along one direction;
from then on it passes both centers at once. The direction is that of the DLO at the change, so that
the gripper's path is continuous. Gravity does not depend on the gripper's position: its rotation
and one arc length are solved for, x(s2) - x(s1) = P2 - P1, and the position follows. Each cut-out
is passed in its direction, possibly obliquely.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.continuation import (
    Ahead,
    Aligned,
    Condition,
    Passing,
    Step,
    TwoPoints,
    as_replayed,
    refusal_for_step,
    step_to,
)
from dlo_planner.inverse.equilibria import Crossings, HangingShapes, hanging_shapes, with_free_end
from dlo_planner.inverse.route import (
    Route,
    gets_there,
    grid_nodes,
    motion,
    picked,
    quick_simulator,
    sweep,
    thinned,
)
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.inverse.tasks.thread import NO_WAY, Threading, first_choice
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import instance
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanRequirements
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Holes, waypoint_of

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


_GUESSES = 9
_DEMANDED = 4  # changes that are tried where a demand refuses them
_FEW = 16  # waypoints at most where a way is only looked for


def thread_two(simulator: DirectSimulator, first: CutOut, second: CutOut, depths: Floats,
               start: Pose | None, demands: PlanRequirements) -> Plan:
    """Return the Plan; see `InverseSimulator.thread_two` for what the arguments mean.

    As in `thread`, the search uses a quick simulator; it first follows one shape, then it uses the
    sphere of all shapes.
    """
    task = Pair(first, second, depths, start, demands)
    if np.linalg.norm(task.chord) < 1e-6 * simulator.rod.length:
        raise InvalidTask('second: expected another center than the first cut-out\'s')
    quick = quick_simulator(simulator)
    plan, change = _search(quick, task if quick is simulator else
                           replace(task, demands=demands.silent(quick)))
    if quick is simulator:
        return plan
    refined = _refined(simulator, task, change)
    if refined is None:
        raise _unreached(simulator, task)
    return _thread_through(simulator, task, refined)


def _search(simulator: DirectSimulator, task: Pair) -> tuple[Plan, Change]:
    """Return a Plan and the Change that it makes."""
    # all hanging shapes take a while: they are made once, and only if they are needed
    shapes = cache(lambda: hanging_shapes(simulator.surroundings, grid_nodes(simulator)))
    few, best = task, None
    for number, change in enumerate(_changes(simulator, task, shapes)):
        task.demands.progress.check()
        if number >= _DEMANDED and best is not None and best[-1].constraint not in NO_WAY:
            break  # a demand that refuses so many refuses all
        tried = few
        try:
            if few is not task:
                _thread_through(simulator, few, change)
            tried = task
            return _thread_through(simulator, task, change), change
        except Infeasible as error:
            depth = tried.depths[error.waypoint]
            if best is None or depth > best[0]:
                best = depth, change, tried, error
        few = task.at_most(_FEW)
    if best is None:
        raise _unreached(simulator, task, shapes())
    _, change, tried, refused = best
    if tried is not task:  # the same at all depths, as evidence
        return _thread_through(simulator, task, change), change
    raise refused


def _changes(simulator: DirectSimulator, task: Pair,
             shapes: Callable[[], HangingShapes | None]) -> Iterator[Change]:
    """Yield Changes: first the one found by following a single shape, if there is one."""
    change = _straight_there(simulator, task)
    if change is not None:
        yield change
    sphere = shapes()
    if sphere is not None:
        yield from other_changes(simulator, task, sphere)


def _unreached(simulator: DirectSimulator, task: Pair,
               shapes: HangingShapes | None = None) -> Infeasible:
    """Return Infeasible: both centers cannot be passed at once."""
    apart = float(np.linalg.norm(task.chord))
    missing = max(apart - simulator.rod.length, 0.0)
    if shapes is not None:
        begin = _no_beginning(simulator, task, shapes)
        if begin is not None:
            return PlanBuilder(task.depths, task.demands).refusal(
                begin.constraint, begin.amount, 'stable shapes pass both centers, but the DLO, set '
                'down in its natural shape, falls into none that leads to them')
        missing = TwoPoints(simulator, task.chord).least_miss(shapes)
    waypoint = min(int(np.searchsorted(task.depths, apart)), len(task.depths) - 1)
    return Infeasible(f'no stable shape was found that passes both centers, {apart:g} m apart, in '
                      'their directions as the free end reaches the second one', waypoint, 'reach',
                      missing, PlanBuilder(task.depths, task.demands).partial())


def _no_beginning(simulator: DirectSimulator, task: Pair,
                  shapes: HangingShapes) -> Infeasible | None:
    """Return why the DLO cannot begin along any direction that leads through both; None if it can.

    It is the Infeasible with the smallest amount, of the constraint 'start' if there is one.
    """
    _, depths, along = at_the_second(simulator, task, shapes)
    along, refusals = along[depths > task.depths[0]], []
    for direction in along[::max(1, len(along) // _GUESSES)]:
        begin = CutOut(Pose.looking_along(task.first.center, direction))
        try:
            first_choice(simulator, Threading(begin, task.depths[:1], task.start, None,
                                              PlanRequirements((1.0, 1.0))))
        except Infeasible as error:
            refusals.append(error)
        else:
            return None
    return min(refusals, default=None, key=lambda one: (one.constraint != 'start', one.amount))


def _straight_there(simulator: DirectSimulator, task: Pair) -> Change | None:
    """Return the Change found by a threading along the line to the second center, or None."""
    length, apart = simulator.rod.length, float(np.linalg.norm(task.chord))
    along = CutOut(Pose.looking_along(task.first.center, task.chord))
    for share in np.linspace(1.0, 1.4, _GUESSES):
        depth = share * apart
        if depth >= length:
            return None
        task.demands.progress.check()
        try:
            plan = first_choice(simulator, Threading(along, np.linspace(0, depth, 6), task.start,
                                                     None, PlanRequirements((1.0, 1.0))))
        except Infeasible:
            continue
        solved = TwoPoints(simulator, task.chord).from_end(plan.shapes[-1], depth)
        if solved is not None:
            return Change(*solved)
    return None


def _refined(simulator: DirectSimulator, task: Pair, change: Change) -> Change | None:
    """Return the same Change, found with another simulator, or None."""
    shape = simulator.solve(change.passing.shape.gripper, change.passing.shape)
    if not shape.converged:
        return None
    solved = TwoPoints(simulator, task.chord).from_end(shape, change.depth)
    return None if solved is None else replace(change, passing=solved[0], depth=solved[1])


def _thread_through(simulator: DirectSimulator, task: Pair, change: Change) -> Plan:
    """Return the Plan that goes through a Change, before and after it."""
    length, depths = simulator.rod.length, task.depths
    direction = change.passing.shape.frame_at(length - change.depth)[0][:, 0]
    along = float(direction @ task.first.normal)
    if along <= 0 and depths[0] < change.depth:  # it is passed along `direction` from the beginning
        raise _direction_refusal(PlanBuilder(depths, task.demands), 'first', along)
    steps: dict[int, _Followed] = {}
    conditions = Aligned(simulator, direction), TwoPoints(simulator, task.chord)
    parts: tuple[tuple[Condition, Route | None, Ints], ...] = (
        (conditions[0], change.back, np.flatnonzero(depths < change.depth)[::-1]),
        (conditions[1], change.on, np.flatnonzero(depths >= change.depth)))
    for condition, route, order in parts:
        passing, depth = change.passing, change.depth
        ahead = (Ahead(condition, depths[order]) if route is None and condition is conditions[0]
                 else None)
        for k, index in enumerate(order):
            task.demands.progress.check()
            found = None if ahead is None else ahead.passing(passing, k)
            step = (step_to(condition, passing, depth, depths[index], route) if found is None else
                    Step(found, float(depths[index]), 0.0, True))
            against = None if step.passing is None else _against(task, step.passing, step.depth)
            steps[int(index)] = _Followed(step, against)
            if step.passing is None or against is not None:
                break
            passing, depth = step.passing, step.depth
        if len(steps) < np.sum(depths < change.depth):
            break  # it is refused before the change
    return _judged(simulator, task, change, conditions, steps)


class _Followed(NamedTuple):
    """A Step, and what `_against` returns of its Passing."""

    step: Step
    against: tuple[str, float] | None


def _against(task: Pair, passing: Passing, depth: float) -> tuple[str, float] | None:
    """Return the name of a cut-out that a Passing passes against its direction, and its cosine."""
    shape = passing.shape
    axes = passing.axes if passing.axes is not None else shape.frame_at(shape.s[-1] - depth)[0]
    passes = [('first', task.first, axes)]
    if passing.second is not None:
        passes.append(('second', task.second, shape.frame_at(passing.second)[0]))
    for name, cutout, axes in passes:
        along = float(axes[:, 0] @ cutout.normal)
        if along <= 0:
            return name, along
    return None


def _direction_refusal(builder: PlanBuilder, name: str, along: float) -> Infeasible:
    return builder.refusal('direction', -along, f'the DLO would pass the {name} cut-out against '
                           'its direction')


def _judged(simulator: DirectSimulator, task: Pair, change: Change,
            conditions: tuple[Aligned, TwoPoints], steps: dict[int, _Followed]) -> Plan:
    """Return the Plan of all waypoints, or raise Infeasible at the first impossible one."""
    length, builder = simulator.rod.length, PlanBuilder(task.depths, task.demands)
    holes = Holes([task.first, task.second], length, task.demands.obstacles, task.demands.surface)
    before = None
    for index, depth in enumerate(task.depths):
        # without a step: those back from the change ended before this depth
        step = steps.get(index, _Followed(Step(None, change.depth, 0.0), None))
        refusal, passing = _refusal(simulator, task, builder, before, step), step.step.passing
        if refusal is not None or passing is None:
            assert refusal is not None  # else there is one
            raise refusal
        passing = as_replayed(simulator, conditions[int(depth >= change.depth)], builder.last,
                              passing, depth)
        second = passing.second if depth >= change.depth else None
        waypoint = waypoint_of(passing.shape, task.first.center, length - depth, None,
                               passing.known)
        if second is not None:
            waypoint = waypoint.with_via_point(task.second.center, second)
        builder.add(holes.passed(waypoint))
        before = passing
    return builder.finished()


def _refusal(simulator: DirectSimulator, task: Pair, builder: PlanBuilder, before: Passing | None,
             judged: _Followed) -> Infeasible | None:
    """Return why a Step does not lead to the next waypoint, or None."""
    step, against = judged
    passing, depth = step.passing, task.depths[len(builder.waypoints)]
    if passing is None and step.leap:
        return builder.refusal('continuity', step.leap, 'the gripper would have to leap: the '
                               'shapes that pass the centers turn back there')
    if passing is None:
        return builder.refusal('equilibrium', abs(depth - step.depth), 'no equilibrium that passes '
                               'the centers was found')
    shape = passing.shape
    if shape.stability < -NEUTRAL:
        return builder.refusal('stability', -shape.stability, 'the DLO would not stay there; '
                               f'stability {shape.stability:.3g} < 0')
    if against is not None:
        return _direction_refusal(builder, *against)
    return refusal_for_step(simulator, builder, before, passing)


@dataclass(frozen=True, eq=False, repr=False)
class ThreadTwo(Task):
    """Thread through two cut-outs, whose centers count; see `InverseSimulator.thread_two`.

    Attributes
    ----------
    first : CutOut
        The one that is passed first.
    second : CutOut
        The one that is passed after it.
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through the first one, m, or None.
    """

    first: CutOut
    second: CutOut
    depths: Floats | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, first: CutOut, second: CutOut,
                     depths: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('first', self.first, CutOut)
        instance('second', self.second, CutOut)
        put(self, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        return thread_two(context.without_obstacles, self.first, self.second,
                          depths_on(context.rod.length, self.depths), context.start,
                          context.demands)
