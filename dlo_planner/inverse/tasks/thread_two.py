# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through two cut-outs: their centers without orientation (paper, section 5.2, Fig. 14).

Until the free end reaches the second cut-out, the DLO passes the first one along one direction;
from then on it passes both centers at once. A plan that begins deeper may do so in any shape that
passes both. The direction is that of the DLO at the change, so that
the gripper's path is continuous. Gravity does not depend on the gripper's position: its rotation
and one arc length are solved for, x(s2) - x(s1) = P2 - P1, and the position follows. Each cut-out
is passed in its direction, possibly obliquely.

Where the DLO takes no such shape it passes beside the centers, within the cut-outs
(`inverse.room_of_two`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.continuation import (
    Aligned,
    BranchPoint,
    Follower,
    SolutionBranch,
    Step,
    TwoPoints,
)
from dlo_planner.inverse.equilibria import (
    Crossings,
    HangingShapes,
    hanging_shapes,
    shape_with_end,
)
from dlo_planner.inverse.room_of_two import thread_two_with_room
from dlo_planner.inverse.route import (
    NO_WAY,
    Route,
    Threading,
    gets_there,
    grid_nodes,
    motion,
    picked,
    plan_branch,
    quick_simulator,
    sweep,
    with_certificate,
)
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.inverse.tasks.thread import first_choice
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import instance
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.margin import upright_room
from dlo_planner.plan.plan import Plan

_CURVES = 16        # depths at which a route is looked for, before the change and after it
_CHANGES = 8        # changes that are tried
_UNLIKE = 0.3       # rad: between the grippers of two that are tried
_BEGINNINGS = 12    # of a route back that are examined
_GUESSES = 9
_DEMANDED = 4       # changes that are tried where a demand refuses them
_FEW = 16           # waypoints at most where a way is only looked for


@dataclass(frozen=True)
class Change:
    """The change of the motion: the free end is at the second center; routes before and after.

    Or, `deep`, where a motion begins of which no waypoint is before any change.
    """

    point: BranchPoint
    back: Route | None = None
    on: Route | None = None
    deep: bool = False

    def unsmoothed(self) -> Change:
        """Return the same, each roll of its routes followed as it is."""
        return replace(self, back=self.back and replace(self.back, ahead=0.0),
                       on=self.on and replace(self.on, ahead=0.0))


def _chord(task: Threading) -> Floats:
    """Return (3,) from the first center to the second, m."""
    first, second = task.cutouts
    return second.center - first.center


def _both(simulator: DirectSimulator, task: Threading) -> TwoPoints:
    """Return the shapes that pass both centers."""
    return TwoPoints(simulator, _chord(task), task.cutouts[0].center)


def thread_two(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading; see `InverseSimulator.thread_two`.

    As in `thread`, the search uses a quick simulator; it first follows one shape, then it uses the
    sphere of all shapes, which takes a while: it is made once, and only if it is needed.
    """
    if np.linalg.norm(_chord(task)) < 1e-6 * simulator.rod.length:
        raise InvalidTask('second: expected another center than the first cut-out\'s')
    quick = quick_simulator(simulator)
    own = quick is simulator
    trial = task if own else task.tried_with(quick)
    shapes = cache(lambda: hanging_shapes(quick.surroundings, grid_nodes(quick)))

    def others(refused: Infeasible | None) -> Iterator[Change]:
        del refused
        sphere, tried = shapes(), list[Change]()
        if sphere is not None:
            for change in chain(other_changes(quick, trial, sphere),
                                deep_beginnings(quick, trial, sphere)):
                tried.append(change)
                yield change
        # smoothed rolls may come too late where a fold has to be gone around
        yield from (change.unsmoothed() for change in tried)

    def planned(task: Threading, change: Change) -> Plan:
        return _thread_through(quick, task, change)

    try:
        plan, change = plan_branch(trial, planned, _straight_there(quick, trial), others, _FEW,
                                   _DEMANDED)
    except LookupError:
        raise _unreached(quick, trial, shapes()) from None
    if own:
        return plan
    shape = simulator.solve(change.point.shape.gripper, change.point.shape)
    refined = _at_both(_both(simulator, task), shape, change.point.depth, change.deep)
    if refined is None:
        raise _unreached(simulator, task)
    return _thread_through(simulator, task, replace(change, point=refined))


def _at_both(condition: TwoPoints, shape: Shape, depth: float, deep: bool) -> BranchPoint | None:
    """Return the BranchPoint near a Shape: at a depth (m) if `deep`, else where its free end is."""
    if not shape.converged:
        return None
    return condition.at(BranchPoint(shape, depth=depth), depth) if deep else condition.from_end(
        shape, depth)


def _thread_through(simulator: DirectSimulator, task: Threading, change: Change) -> Plan:
    """Return the Plan that goes through a Change, before and after it; raise Infeasible."""
    length, depths, at = simulator.rod.length, task.depths, change.point.depth
    (first, second), builder = task.cutouts, PlanBuilder(task.depths, task.demands)
    aligned = Aligned(simulator, change.point.shape.frame_at(length - at)[0][:, 0], first.center)
    aligned.normals = (first.normal,)
    two = _both(simulator, task)
    two.normals = (first.normal, second.normal)
    if depths[0] < at and aligned.normal @ first.normal <= 0:  # so it is from the beginning
        raise builder.refusal('direction', -float(aligned.normal @ first.normal), 'the DLO would '
                              'pass cut-out 0 against its direction', '')
    before = depths < at
    steps: dict[int, Step] = {}
    parts: tuple[tuple[SolutionBranch, Route | None, Ints], ...] = (
        (aligned, change.back, np.flatnonzero(before)[::-1]),
        (two, change.on, np.flatnonzero(~before)))
    for branch, route, order in parts:
        follower = Follower(branch, change.point, at, depths[order], route)
        for k, index in enumerate(order):
            task.demands.progress.check()
            steps[int(index)] = step = follower.step(k)
            if step.point is None or branch.against(step.point):
                break
        if len(steps) < before.sum():
            break  # it is refused before the change
    holes, last = task.holes(length), None
    for index, depth in enumerate(depths):
        branch = aligned if before[index] else two
        step = steps.get(index, Step(None, at))  # none: those back from the change ended before
        refusal = branch.refusal(builder, last, step)
        if refusal is not None or step.point is None:
            assert refusal is not None  # else there is one
            raise refusal
        last = branch.replayed(builder.last, step.point)
        waypoint = last.waypoint(first.center, length - depth, None)
        for s in last.further if branch is two else ():
            waypoint = waypoint.with_via_point(second.center, s)
        builder.add(holes.passed(waypoint))
    return builder.finished()


def _unreached(simulator: DirectSimulator, task: Threading,
               shapes: HangingShapes | None = None) -> Infeasible:
    """Return Infeasible: both centers cannot be passed at once."""
    apart = float(np.linalg.norm(_chord(task)))
    missing = max(apart - simulator.rod.length, 0.0)
    builder = PlanBuilder(task.depths, task.demands)
    if shapes is not None:
        begin = _no_beginning(simulator, task, shapes)
        if begin is not None:
            return builder.refusal(
                begin.constraint, begin.amount, 'stable shapes pass both centers, but the DLO, set '
                'down in its natural shape, snaps into none that leads to them', begin.unit)
        missing = _both(simulator, task).least_miss(shapes)
    waypoint = min(int(np.searchsorted(task.depths, apart)), len(task.depths) - 1)
    first = float(task.depths[0])
    where = 'as the free end reaches the second one'
    if first >= apart:  # the motion may begin beyond
        where = f'{where}, nor {first:g} m deep in the first one, where the motion begins'
    return Infeasible(f'no stable shape was found that passes both centers, {apart:g} m apart, in '
                      f'their directions {where}', waypoint, 'reach', missing, builder.partial())


def certificate(simulator: DirectSimulator, task: Threading) -> str:
    """Return in words how many stable shapes pass both centers at once, as `Infeasible` does."""
    quick = quick_simulator(simulator)
    shapes = hanging_shapes(quick.surroundings, grid_nodes(quick))
    if shapes is None:
        return ''
    _, depths, _ = at_the_second(quick, task, shapes)
    begin = f'of {len(shapes.stability)} shapes in which the DLO hangs, '
    if depths.size:
        return (f'{begin}about {depths.size} stable ones pass both centers in their directions as '
                f'the free end comes to the second, {depths.min():.4g} to {depths.max():.4g} m '
                'deep in the first')
    least = _both(quick, task).least_miss(shapes)
    return (f'{begin}no stable one passes both centers in their directions as the free end comes '
            f'to the second; it is missed by {least:.3g} m at least')


def _no_beginning(simulator: DirectSimulator, task: Threading,
                  shapes: HangingShapes) -> Infeasible | None:
    """Return why the DLO cannot begin along any direction through both, or None if it can.

    It is the Infeasible with the smallest amount, of the constraint 'start' if there is one.
    """
    _, depths, along = at_the_second(simulator, task, shapes)
    along, refusals = along[depths > task.depths[0]], []
    for direction in along[::max(1, len(along) // _GUESSES)]:
        try:
            first_choice(simulator, _alone(task, direction, task.depths[:1]))
        except Infeasible as error:
            refusals.append(error)
        else:
            return None
    return min(refusals, default=None, key=lambda one: (one.constraint != 'start', one.amount))


def _alone(task: Threading, direction: Floats, depths: Floats) -> Threading:
    """Return the threading through the first center alone, along a direction (3,)."""
    cutout = CutOut(Pose.looking_along(task.cutouts[0].center, direction))
    return Threading((cutout,), depths, task.start, PlanChecker((1.0, 1.0)))


def _straight_there(simulator: DirectSimulator, task: Threading) -> Change | None:
    """Return the Change found by a threading along the line to the second center, or None."""
    chord = _chord(task)
    for share in np.linspace(1.0, 1.4, _GUESSES):
        depth = share * float(np.linalg.norm(chord))
        if depth >= simulator.rod.length:
            return None
        task.demands.progress.check()
        try:
            plan = first_choice(simulator, _alone(task, chord, np.linspace(0, depth, 6)))
        except Infeasible:
            continue
        found = _both(simulator, task).from_end(plan.shapes[-1], depth)
        if found is not None:
            return Change(found)
    return None


def other_changes(simulator: DirectSimulator, task: Threading,
                  shapes: HangingShapes) -> Iterator[Change]:
    """Yield Changes with their Routes, found among all HangingShapes, the best first."""
    condition = _both(simulator, task)
    changes, depths, along = at_the_second(simulator, task, shapes)
    routes_on = _routes_on(condition, shapes, changes, depths, task)
    for k in _unlike(changes, np.array([cost for cost, _ in routes_on])):
        task.demands.progress.check()
        back = _route_back(simulator, shapes, changes.chosen([k]), depths[k], along[k], task)
        if back is None:
            continue
        guess = shape_with_end(simulator.mesh, changes.ends[k])
        shape = simulator.solve(guess.gripper, guess)
        solved = _at_both(condition, shape, depths[k], deep=False)
        if solved is not None:
            yield Change(solved, back, routes_on[k][1])


def deep_beginnings(simulator: DirectSimulator, task: Threading,
                    shapes: HangingShapes) -> Iterator[Change]:
    """Yield Changes at the first depth, if it is beyond any change: how it came there is not asked.

    A free end that has gone less far than the centers are apart cannot have come to the second.
    """
    depth, condition = float(task.depths[0]), _both(simulator, task)
    if depth < np.linalg.norm(_chord(task)):
        return
    begins = condition.crossings(shapes, depth)
    routes = _routes_on(condition, shapes, begins, np.full(len(begins), depth), task)
    ways = [(begins.ends[k], routes[k][1]) for k in _unlike(
        begins, np.array([cost for cost, _ in routes]))]
    # a DLO that hangs nearly straight through both may be between the nodes of the grid
    ways += [(end, None) for end in condition.nearest(shapes, depth, _GUESSES)]
    for end, route in ways:
        task.demands.progress.check()
        guess = shape_with_end(simulator.mesh, end)
        solved = _at_both(condition, simulator.solve(guess.gripper, guess), depth, deep=True)
        if solved is not None and gets_there(simulator, solved.shape.gripper,
                                             solved.shape.frames[-1]):
            yield Change(solved, on=route, deep=True)


def at_the_second(simulator: DirectSimulator, task: Threading,
                  shapes: HangingShapes) -> tuple[Crossings, Floats, Floats]:
    """Return the Crossings in the second, and their depths (m,), directions (m, 3) in the first."""
    changes, depths = _both(simulator, task).last_crossings(shapes)
    first, second = task.cutouts
    hung = changes.pairs[:, 0]
    turns = changes.grippers @ np.swapaxes(shapes.frames[hung, 0], 1, 2)
    along = np.array([
        turn @ shapes.frames[k, np.searchsorted(shapes.s, shapes.s[-1] - depth), :, 0]
        for turn, k, depth in zip(turns, hung, depths, strict=True)]).reshape(-1, 3)
    right = (along @ first.normal > 0) & (changes.ends[:, :, 0] @ second.normal > 0)
    return changes.chosen(right), depths[right], along[right]


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
               task: Threading) -> list[tuple[float, Route | None]]:
    """Return [(cost, Route or None)] of going on from each change to the deepest waypoint."""
    length, deepest = shapes.s[-1], task.depths[-1]
    if not len(changes):
        return []
    if deepest <= depths.min():
        return [(0.0, None)] * len(changes)
    grid = np.linspace(deepest, depths.min(), _CURVES)[:-1]
    layers = [condition.crossings(shapes, depth) for depth in grid]
    costs, origins = sweep(layers, np.zeros(len(layers[0])), length)
    routes: list[tuple[float, Route | None]] = []
    for k, depth in enumerate(depths):
        last = int((grid > depth).sum()) - 1  # the curve right after the change, in the sweep
        found: tuple[float, Route | None] = (0.0 if last < 0 else np.inf), None
        if 0 <= last < len(costs):
            total = motion(changes.chosen([k]), layers[last], length)[0] + costs[last]
            if np.isfinite(total).any():
                best = int(np.argmin(total))
                curves = zip(layers[last::-1], picked(origins[:last], best)[::-1], strict=True)
                found = float(total[best]), Route(
                    np.append(depth, grid[last::-1]),
                    np.array([changes.grippers[k], *(one.grippers[pick] for one, pick in curves)]),
                    changes.ends[k], length, True)
        routes.append(found)
    return routes


def _route_back(simulator: DirectSimulator, shapes: HangingShapes, change: Crossings, depth: float,
                direction: Floats, task: Threading) -> Route | None:
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


@dataclass(frozen=True, eq=False, repr=False)
class ThreadTwo(Task):
    """Thread through two cut-outs, whose centers count; see `InverseSimulator.thread_two`.

    Where no shape of the DLO hits both, and they have a size, it passes beside their centers.

    Attributes
    ----------
    first : CutOut
        The one that is passed first.
    second : CutOut
        The one that is passed after it.
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through the first one, m, or None.
    """

    threads: ClassVar[bool] = True
    deepest: ClassVar[float | None] = 1.0

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

    @property
    def passed(self) -> tuple[CutOut, ...]:
        """The cut-outs that the DLO passes, in their order."""
        return self.first, self.second

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan: through both centers if the DLO can, else beside them if it has room."""
        instance('context', context, PlanContext)
        task = Threading((self.first, self.second), depths_on(context.rod.length, self.depths),
                         context.start, context.demands)
        free = context.without_obstacles
        try:
            return with_certificate(partial(thread_two, free, task),
                                    partial(certificate, free, task))
        except Infeasible as error:
            rooms = [upright_room(one, task.demands.surface) for one in task.cutouts]
            if error.constraint not in NO_WAY or not all(0 < room < np.inf for room in rooms):
                raise
            try:
                return thread_two_with_room(free, task)
            except Infeasible as other:
                error.args = (f'{error}; beside the centers: {other}',)
                raise error from None
