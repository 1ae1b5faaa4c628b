# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through one cut-out: at every depth the DLO passes the center along the normal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.solvers.conditions import Aligned
from dlo_planner.inverse.solvers.continuation.following import Rolls
from dlo_planner.inverse.solvers.continuation.quick import (
    gets_there,
    grid_nodes,
    quick_simulator,
)
from dlo_planner.inverse.solvers.continuation.route import Route, find_route, sweep
from dlo_planner.inverse.solvers.hanging.sphere import Crossings, HangingShapes, hanging_shapes
from dlo_planner.inverse.solvers.hanging.start_candidates import (
    Candidate,
    is_axisymmetric,
    start_candidates,
    with_free_end,
)
from dlo_planner.inverse.solvers.threading.through_depths import Threading, thread_from
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.assembly import truncate
from dlo_planner.plan.plan import Plan, PlanStatus

_FEW = 60           # waypoints at most of a plan that is only a trial
_CURVES = 32        # depths at which a route is looked for
_STARTS = 80, 24    # shapes looked at: set down in the natural shape, brought from an initial one
_AHEAD = 0.0, 0.15  # of the length: other smoothings of a route
_PREFERENCE = 0.01  # for a start without a turn, per rad^2, against rad^2 of motion on the way
NO_WAY = ('equilibrium', 'stability', 'start', 'continuity', 'direction', 'reach')


def thread(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading; see `InverseSimulator.thread`.

    Which roll of the DLO the threading begins with is free, and how it rolls on the way. The plan
    that begins with the first candidate and rolls only where it has to is tried first. If it is
    refused, the sphere of all hanging shapes shows a better route, or that there is none. The
    search uses a quick simulator, whatever the accuracy of the plan.
    """
    task = replace(task, demands=task.demands.made_with(simulator))
    quick = quick_simulator(simulator)
    if quick is simulator:
        return _search(simulator, task)[0]
    trial = replace(task, demands=task.demands.silent(quick), method='coupled')
    _, begin, route = _search(quick, trial)
    if begin is None:
        begin = next(start_candidates(simulator, task.cutout, task.start))
    return thread_from(simulator, task, begin, route)


def first_choice(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading that begins with its first Candidate, without a route."""
    return thread_from(simulator, task, next(start_candidates(simulator, task.cutout, task.start)),
                       None)


def _search(simulator: DirectSimulator,
            task: Threading) -> tuple[Plan, Candidate | None, Rolls | None]:
    """Return a Plan, its Candidate (None: the first one), and its route or None."""
    candidates = start_candidates(simulator, task.cutout, task.start)
    try:
        return thread_from(simulator, task, next(candidates), None), None, None
    except Infeasible as error:
        refused = error
    few = task.at_most(_FEW)
    deepest = _depth(task, refused)
    best: tuple[Candidate, Route | None] | None = None
    for begin, route in _other_ways(simulator, task, candidates, refused):
        task.demands.progress.check()
        try:
            if few is not task:
                thread_from(simulator, few, begin, route)
            return thread_from(simulator, task, begin, route), begin, route
        except Infeasible as error:
            depth = _depth(few if few is not task else task, error)
            if depth > deepest:
                deepest, best, refused = depth, (begin, route), error
    if few is not task and best is not None:  # the same at all depths, as evidence
        begin, route = best
        return thread_from(simulator, task, begin, route), begin, route
    raise refused


def _other_ways(simulator: DirectSimulator, task: Threading, candidates: Iterator[Candidate],
                refused: Infeasible) -> Iterator[tuple[Candidate, Route | None]]:
    """Yield other Candidates, each with a Route or None, after a refusal."""
    if refused.constraint not in NO_WAY:  # a demand: another roll may keep it
        yield from ((begin, None) for begin in candidates)
        return
    if is_axisymmetric(simulator.rod):
        return
    shapes = hanging_shapes(simulator.surroundings, grid_nodes(simulator))
    if shapes is None:
        yield from ((begin, None) for begin in candidates)
        return
    route = _route(simulator, shapes, task)
    if route is not None:
        guess = with_free_end(simulator, route.end)
        begin = Candidate(guess, guess.gripper.rotation, float(route.depths[0]))
        yield begin, route
        if route.complete:  # smoothed rolls may miss a narrow route, or leap on a rough one
            yield from ((begin, replace(route, ahead=ahead)) for ahead in _AHEAD)
    # the grid may be too coarse: where the DLO hardly stands, the stable shapes can be a strip
    # narrower than its mesh
    if route is None or route.complete:
        yield from ((begin, None) for begin in candidates)


def certificate(simulator: DirectSimulator, cutout: CutOut, depths: Floats) -> str:
    """Return in words at which depths (n,), m, stable shapes pass a cut-out, as `Infeasible` does.

    The shapes are those of a quick simulator, in all directions of the free end.
    """
    quick = quick_simulator(simulator)
    shapes = hanging_shapes(quick.surroundings, grid_nodes(quick))
    if shapes is None:
        return ''
    aligned = Aligned(quick, cutout.normal)
    looked_at = np.unique(np.linspace(depths[0], depths[-1], _CURVES))
    layers = [aligned.crossings(shapes, depth) for depth in looked_at]
    stable = np.array([len(layer) > 0 for layer in layers])
    reached = len(sweep(layers, np.zeros(len(layers[0])), quick.rod.length)[0])
    begin = (f'of {len(shapes.stability)} shapes in which the DLO hangs, {looked_at.size} depths '
             'looked at: ')
    if not stable.any():
        return f'{begin}no stable one is along the normal at any depth'
    ends = looked_at[stable][[0, -1]]
    if not stable[0]:
        return (f'{begin}no stable one is along the normal at depth {looked_at[0]:.4g} m, where '
                f'the plan begins; some are between {ends[0]:.4g} and {ends[1]:.4g} m')
    if reached < looked_at.size:
        none = '' if stable[reached] else ', where there is none'
        return (f'{begin}stable ones are along the normal from depth {looked_at[0]:.4g} m on, but '
                f'none leads from {looked_at[reached - 1]:.4g} to {looked_at[reached]:.4g} m{none}')
    return f'{begin}stable ones are along the normal at each, in reach of each other'


def _route(simulator: DirectSimulator, shapes: HangingShapes, task: Threading) -> Route | None:
    """Return the Route through the curves of all depths, or of some where there are many."""
    aligned = Aligned(simulator, task.cutout.normal)
    depths = np.unique(np.linspace(task.depths[0], task.depths[-1], _CURVES))
    layers = [aligned.crossings(shapes, depth) for depth in depths]
    return find_route(layers, depths, _starts(simulator, layers[0], task), simulator.rod.length)


def _starts(simulator: DirectSimulator, curve: Crossings, task: Threading) -> Floats:
    """Return the cost (m,) of beginning at each of the Crossings; infinite where it cannot.

    The DLO has to take the shape by itself. Among these shapes the cost is least where the gripper
    is turned least from `start`.
    """
    cost = np.full(len(curve), np.inf)
    most = _STARTS[task.initial is not None]
    for k in np.unique(np.linspace(0, len(curve) - 1, min(len(curve), most)).astype(int)):
        gripper = Pose.from_rotation(task.cutout.center + curve.places[k], curve.grippers[k])
        if gets_there(simulator, gripper, curve.ends[k], task.initial):
            turn = 0.0 if task.start is None else angle_between(
                gripper.rotation, task.start.rotation)
            cost[k] = _PREFERENCE * turn**2
    return cost


def _depth(task: Threading, refused: Infeasible) -> tuple[float, bool]:
    """Return what orders refusals: the depth reached, and whether only the start failed."""
    return task.depths[refused.waypoint], refused.constraint == 'start'


def trim_to_clearance(plan: Plan, cutout: CutOut, clearance: float, may_end: bool) -> Plan:
    """Return the part of a Plan in which the gripper is `clearance` m before the sheet."""
    rooms = np.array([(cutout.center - gripper.position) @ cutout.normal
                      for gripper in plan.grippers])
    if (rooms >= clearance).all():
        return plan
    index = int(np.argmax(rooms < clearance))
    if may_end and index:
        return truncate(plan, index, PlanStatus.COMPLETE)
    raise Infeasible(f'waypoint {index} (depth {plan.depths[index]:g} m): the gripper is '
                     f'{rooms[index]:.3g} m before the sheet, gripper_clearance = {clearance:g} m',
                     index, 'gripper_clearance', float(clearance - rooms[index]),
                     truncate(plan, index, PlanStatus.PARTIAL))
