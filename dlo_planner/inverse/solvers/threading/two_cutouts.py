# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through two cut-outs: their centers without orientation (paper, section 5.2, Fig. 14).

Until the free end reaches the second cut-out, the DLO passes the first one along one direction;
from then on it passes both centers at once. The direction is that of the DLO at the change, so that
the gripper's path is continuous. Gravity does not depend on the gripper's position: its rotation
and one arc length are solved for, x(s2) - x(s1) = P2 - P1, and the position follows. Each cut-out
is passed in its direction, possibly obliquely.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.solvers.conditions import Aligned, TwoPoints
from dlo_planner.inverse.solvers.continuation.ahead import Ahead
from dlo_planner.inverse.solvers.continuation.following import (
    Condition,
    Passing,
    Step,
    as_replayed,
    follow,
    refusal_for_step,
)
from dlo_planner.inverse.solvers.continuation.quick import grid_nodes, quick_simulator
from dlo_planner.inverse.solvers.continuation.route import Route
from dlo_planner.inverse.solvers.hanging.sphere import HangingShapes, hanging_shapes
from dlo_planner.inverse.solvers.threading.changes import Change, Pair, at_the_second, other_changes
from dlo_planner.inverse.solvers.threading.one_cutout import NO_WAY, first_choice
from dlo_planner.inverse.solvers.threading.through_depths import Threading
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Holes, waypoint_of

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
    """Yield Changes: first the one found by following a single shape, if there is one.

    Parameters
    ----------
    shapes : callable
        Function () -> HangingShapes, or None where there is no such sphere.
    """
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
            step = (follow(condition, passing, depth, depths[index], route) if found is None else
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
    """Return the Plan of all waypoints, or raise Infeasible at the first impossible one.

    Parameters
    ----------
    conditions : tuple
        What is kept before the change, and after it.
    steps : dict of int to _Followed
        The Step to each waypoint, by its index.
    """
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
    """Return why a Step does not lead to the next waypoint, or None.

    Parameters
    ----------
    before : Passing or None
        Passing of the waypoint before. If None, it is the first one.
    """
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
