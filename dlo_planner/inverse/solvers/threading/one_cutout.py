# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through one cut-out: at every depth the DLO passes the center along the normal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.solvers.continuation.even_rolls import EvenRolls, even_rolls
from dlo_planner.inverse.solvers.continuation.following import (
    Passing,
    Rolls,
    Step,
    follow,
    refusal_for_step,
)
from dlo_planner.inverse.solvers.continuation.quick import (
    gets_there,
    grid_nodes,
    quick_simulator,
    thinned,
)
from dlo_planner.inverse.solvers.continuation.route import Route, find_route
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes, hanging_shapes
from dlo_planner.inverse.solvers.hanging.start_candidates import (
    Candidate,
    is_axisymmetric,
    start_candidates,
    with_free_end,
)
from dlo_planner.inverse.solvers.points.one_point import Aligned
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.clearance import sheet_of
from dlo_planner.plan.continuity import largest_turn
from dlo_planner.plan.plan import Plan, PlanStatus, truncate
from dlo_planner.plan.waypoint import waypoint_of

_ROLLS = (0.2, -0.2, 0.5, -0.5, 1.0, -1.0)  # of the largest turn, tried between two waypoints
_DOUBTFUL = 0.05    # stability below which another roll is looked for
_AS_STABLE = 0.8    # of that, or of what there is: rolled evenly it may be less
_FEW = 60           # waypoints at most where a way is only looked for
_CURVES = 32        # depths at which a route is looked for
_STARTS = 80, 24    # shapes looked at: set down in the natural shape, brought from an initial one
_AHEAD = 0.0, 0.15  # of the length: other smoothings of a route
_PREFERENCE = 0.01  # for a start without a turn, per rad^2, against rad^2 of motion on the way
NO_WAY = ('equilibrium', 'stability', 'start', 'continuity', 'direction', 'reach')


@dataclass(frozen=True)
class Threading:
    """What is asked of a threading.

    Attributes
    ----------
    cutout : CutOut
    depths : ndarray, shape (n,)
        Depths in m.
    start : Pose or None
        Pose whose roll is kept as far as possible.
    initial : Shape or None
        Shape before.
    brief : PlanRequirements
    """

    cutout: CutOut
    depths: Floats
    start: Pose | None
    initial: Shape | None
    brief: PlanRequirements

    def at_most(self, most: int) -> Threading:
        """Return the same at `most` of its depths, its steps unreported; itself if that is all."""
        if len(self.depths) <= most:
            return self
        return replace(self, depths=thinned(self.depths, most), brief=self.brief.silent())


def thread(simulator: DirectSimulator, cutout: CutOut, depths: Floats, start: Pose | None,
           initial: Shape | None, method: str, brief: PlanRequirements) -> Plan:
    """Return the Plan; see `InverseSimulator.thread` for what the arguments mean.

    Which roll of the DLO the threading begins with is free, and how it rolls on the way. The plan
    that begins with the first choice and rolls only where it has to is tried first. If it is
    refused, the sphere of all hanging shapes shows a better way, or that there is none. A way is
    looked for with a simulator that is quick, whatever the accuracy asked for.
    """
    asked = Threading(cutout, depths, start, initial, brief.made_with(simulator))
    quick = quick_simulator(simulator)
    if quick is simulator:
        return _search(simulator, asked, method)[0]
    silent = replace(asked, brief=brief.silent(quick))
    _, begin, route = _search(quick, silent, 'coupled')
    if begin is None:  # the first choice will do
        begin = next(start_candidates(simulator, cutout, start))
    return _thread_from(simulator, asked, begin, route, method)


def first_choice(simulator: DirectSimulator, asked: Threading) -> Plan:
    """Return the Plan of a Threading that begins with the first choice and is followed as it is."""
    return _thread_from(simulator, asked, next(start_candidates(simulator, asked.cutout,
                                                                asked.start)),
                        None, 'coupled')


def _search(simulator: DirectSimulator, asked: Threading,
            method: str) -> tuple[Plan, Candidate | None, Rolls | None]:
    """Return a Plan, what it begins with (None: the first choice), and its Route or None."""
    begins = start_candidates(simulator, asked.cutout, asked.start)
    try:
        return _thread_from(simulator, asked, next(begins), None, method), None, None
    except Infeasible as error:
        refused = error
    few = asked.at_most(_FEW)
    deepest = _depth(asked, refused)
    best: tuple[Candidate, Route | None] | None = None
    for begin, route in _other_ways(simulator, asked, begins, refused):
        asked.brief.progress.check()
        try:
            if few is not asked:
                _thread_from(simulator, few, begin, route, 'coupled')
            return _thread_from(simulator, asked, begin, route, method), begin, route
        except Infeasible as error:
            depth = _depth(few if few is not asked else asked, error)
            if depth > deepest:
                deepest, best, refused = depth, (begin, route), error
    if few is not asked and best is not None:  # the same at all depths, as evidence
        begin, route = best
        return _thread_from(simulator, asked, begin, route, method), begin, route
    raise refused


def _other_ways(simulator: DirectSimulator, asked: Threading, begins: Iterator[Candidate],
                refused: Infeasible) -> Iterator[tuple[Candidate, Route | None]]:
    """Yield what else a threading may begin with, and a Route or None, after a refusal."""
    if refused.constraint not in NO_WAY:  # a demand: another roll may keep it
        yield from ((begin, None) for begin in begins)
        return
    if is_axisymmetric(simulator.rod):
        return
    shapes = hanging_shapes(simulator.surroundings, grid_nodes(simulator))
    if shapes is None:
        yield from ((begin, None) for begin in begins)
        return
    route = _route(simulator, shapes, asked)
    if route is not None:
        guess = with_free_end(simulator, route.end)
        begin = Candidate(guess, guess.gripper.rotation, float(route.depths[0]))
        yield begin, route
        if route.complete:  # rolls that are averaged may miss a narrow way, or leap on a rough one
            yield from ((begin, replace(route, ahead=ahead)) for ahead in _AHEAD)
    # what the grid tells may not be enough: where the DLO hardly stands, the stable shapes can be a
    # strip narrower than its mesh
    if route is None or route.complete:
        yield from ((begin, None) for begin in begins)


def _route(simulator: DirectSimulator, shapes: HangingShapes, asked: Threading) -> Route | None:
    """Return the Route through the curves of all depths, or of some where there are many."""
    task = Aligned(simulator, asked.cutout.normal)
    depths = np.unique(np.linspace(asked.depths[0], asked.depths[-1], _CURVES))
    layers = [task.crossings(shapes, depth) for depth in depths]
    return find_route(layers, depths, _starts(simulator, layers[0], asked), simulator.rod.length)


def _starts(simulator: DirectSimulator, curve: Crossings, asked: Threading) -> Floats:
    """Return the cost (m,) of beginning at each of the Crossings; infinite where it cannot.

    The DLO has to come into the shape by itself; of those it does, the gripper prefers the one in
    which it is turned least against `start`.
    """
    cost = np.full(len(curve), np.inf)
    most = _STARTS[asked.initial is not None]
    for k in np.unique(np.linspace(0, len(curve) - 1, min(len(curve), most)).astype(int)):
        gripper = Pose.from_rotation(asked.cutout.center + curve.places[k], curve.grippers[k])
        if gets_there(simulator, gripper, curve.ends[k], asked.initial):
            turn = 0.0 if asked.start is None else angle_between(
                gripper.rotation, asked.start.rotation)
            cost[k] = _PREFERENCE * turn**2
    return cost


def _depth(asked: Threading, refused: Infeasible) -> tuple[float, bool]:
    """Return a number by which refusals compare: how far they come."""
    return asked.depths[refused.waypoint], refused.constraint == 'start'


def trim_to_clearance(plan: Plan, cutout: CutOut, wanted: float, may_end: bool) -> Plan:
    """Return the part of a Plan in which the gripper is `wanted` m before the sheet.

    Parameters
    ----------
    may_end : bool
        Whether the plan may end earlier than it does.

    Raises
    ------
    Infeasible
        It may not, or the first waypoint is too near already.
    """
    rooms = np.array([(cutout.center - gripper.position) @ cutout.normal
                      for gripper in plan.grippers])
    if (rooms >= wanted).all():
        return plan
    index = int(np.argmax(rooms < wanted))
    if may_end and index:
        return truncate(plan, index, PlanStatus.COMPLETE)
    raise Infeasible(f'waypoint {index} (depth {plan.depths[index]:g} m): the gripper is '
                     f'{rooms[index]:.3g} m before the sheet, gripper_clearance = {wanted:g} m',
                     index, 'gripper_clearance', float(wanted - rooms[index]),
                     truncate(plan, index, PlanStatus.PARTIAL))


def _thread_from(simulator: DirectSimulator, asked: Threading, begin: Candidate,
                 route: Rolls | None, method: str) -> Plan:
    """Return the Plan that continues a beginning through all depths.

    Parameters
    ----------
    begin : Candidate
        Shape, reference (3, 3) for its roll, and its depth, m.
    route : Rolls or None
        Route that gives the rolls, or None.
    """
    length, cutout, brief = simulator.rod.length, asked.cutout, asked.brief
    draft = PlanBuilder(asked.depths, brief, initial=asked.initial)
    sheet = sheet_of(cutout, length, brief.obstacles)
    task = Aligned(simulator, cutout.normal, method)
    alike = is_axisymmetric(simulator.rod)
    guess, reference, depth = begin
    here, jerks = task.from_guess(guess, depth, reference), False
    passings: list[Passing] = []
    for wanted in asked.depths:
        brief.progress.check()
        found, reached, too_far = Step(None, depth, 0.0) if here is None else follow(
            task, here, depth, wanted, route)
        before = here if draft.waypoints else None
        refusal = _refusal(simulator, draft, before, found, wanted, reached, too_far)
        if refusal is not None:
            found = None
        if before is not None and not alike and not isinstance(route, EvenRolls) and (
                found is None or found.shape.stability < _DOUBTFUL):
            jerks = True
            found = _rolled(simulator, draft, task, before, depth, wanted, found)
        if found is None:
            assert refusal is not None  # else it was found
            raise refusal
        here, depth = found, wanted
        passings.append(here)
        draft.add(waypoint_of(here.shape, cutout.center, length - wanted,
                              cutout.normal).with_clearances(
            [cutout], [sheet], brief.surface))
    plan = draft.finished()
    return _evenly(simulator, asked, begin, method, plan, passings) if jerks else plan


def _evenly(simulator: DirectSimulator, asked: Threading, begin: Candidate, method: str, plan: Plan,
            passings: Sequence[Passing]) -> Plan:
    """Return a Plan that rolls as a whole like `plan` but evenly; that one if none will do.

    Parameters
    ----------
    passings : sequence of Passing
        Passings of its n waypoints.
    """
    silent = replace(asked, brief=asked.brief.silent())
    for route in even_rolls(Aligned(simulator, asked.cutout.normal, method), asked.depths,
                            passings):
        try:
            even = _thread_from(simulator, silent, begin, route, method)
        except Infeasible:
            continue
        if even.stability.min() >= _AS_STABLE * min(_DOUBTFUL, plan.stability.min()):
            return even
    return plan


def _refusal(simulator: DirectSimulator, draft: PlanBuilder, before: Passing | None,
             found: Passing | None, wanted: float, reached: float,
             too_far: float) -> Infeasible | None:
    """Return why a Passing, or None, cannot be the next waypoint, or None.

    Parameters
    ----------
    before : Passing or None
        Passing of the waypoint before, None at the first.
    wanted, reached : float
        Depth of the waypoint, and how far the DLO could be followed, m.
    too_far : float
        Distance in m that the gripper would have to leap there.
    """
    if found is None and too_far:
        return draft.refusal('continuity', too_far, 'the gripper would have to leap at depth '
                             f'{reached:.4g} m: the shapes that do the task turn back there')
    if found is None:
        return draft.refusal('equilibrium', wanted - reached, 'no equilibrium with the tangent '
                             f'along the normal was found beyond depth {reached:g} m')
    shape = found.shape
    if shape.stability < -NEUTRAL:
        return draft.refusal('stability', -shape.stability, 'the DLO would not stay in the shape '
                             f'that passes the cut-out; stability {shape.stability:.3g} < 0')
    return refusal_for_step(simulator, draft, before, found)


def _rolled(simulator: DirectSimulator, draft: PlanBuilder, task: Aligned, here: Passing,
            depth: float, wanted: float, best: Passing | None) -> Passing | None:
    """Return a Passing that is stable enough, the gripper rolled as little as that takes.

    If there is none, the most stable one, or `best`.

    Parameters
    ----------
    here : Passing
        Passing of the waypoint before, at `depth`, m.
    """
    most = largest_turn((wanted - depth) / simulator.rod.length)
    for part in _ROLLS:
        found = task.at(here, wanted, part * most, True)
        if found is None or best is not None and found.shape.stability <= best.shape.stability:
            continue
        if _refusal(simulator, draft, here, found, wanted, wanted, 0.0) is None:
            best = found
            if found.shape.stability >= _DOUBTFUL:
                break  # no larger roll than needed: the gripper's way stays smooth
    return best
