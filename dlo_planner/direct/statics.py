# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium: from a gripper's pose and a discretization to a Shape with its proof."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.memory import NOWHERE, ContactPoints, Memory
from dlo_planner.direct.search import (
    EXACT,
    KEPT,
    MAX_ITERATIONS,
    TOLERANCE,
    Search,
    is_equilibrium,
    minimum,
)
from dlo_planner.direct.shape import NO_WRENCH, Shape, State, contacts_of
from dlo_planner.energy.terms import may_act
from dlo_planner.minimize.classic import search
from dlo_planner.minimize.convergence import CONVERGED, Minimum
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.minimize.solve import Solution, outcome, solve_step
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd, distance, spans
from dlo_planner.model.value import freeze, put, read_only

_ELSEWHERE = 0.1       # of the length: a shape in contact that moves so far is another one
_GRIP_KEPT = 1e-9      # of the length: by how much a grip may be missed at the end
_SLACK = 1e-3          # of the slack: the same, as the DLO pulls the tighter the less there is
_GRIP_EXACT = 1e-4     # of the slack: what is aimed at
_LEAST_SLACK = 1e-10   # of the length: slack that is looked at
_IN_VAIN = 30          # Newton steps towards what is out of reach


class Watch(NamedTuple):
    """What a step without what may act is watched for: that nothing does, and how far it turns."""

    places: Floats = NOWHERE   # (N + 1, 3) of the nodes before, m; (0, 3): stress-free
    frames: Floats = np.zeros((0, 3, 3))  # (N + 1, 3, 3) of the nodes before, read-only,
    rotation: Floats = np.eye(3)  # in a gripper with this rotation, read-only:
    nodes: Ints = np.zeros(0, dtype=np.int64)  # of these none
    most: float = np.inf       # turns by more in the gripper, rad


_HALVED = Search(4, False, tolerance=1e-9)  # of halved elements
UNWATCHED = Watch()
freeze(UNWATCHED[:3])  # nodes are of the type of others


def equilibrium(mesh: Discretization, gripper: Pose, strains: Floats,
                memory: Memory | None = None, far_end: FarEnd | None = None, *,
                method: str = 'newton', culled: bool = False, watch: Watch | None = None,
                how: Search | None = None) -> Shape:
    """Return the Shape that the DLO falls into from strains (N, 3); `culled`: `Discretization`."""
    around, culled = mesh.surroundings, culled or mesh.hangs
    how = how or search_of(mesh, gripper, far_end)
    if method == 'newton' and not (around.pinned or around.has_moments):
        end = solution(mesh, gripper, strains, memory, far_end, how, culled, watch)
        return shape_from(mesh, gripper, end, memory, far_end, culled)
    system = mesh.system(gripper.rotation, gripper.position, memory, far_end, culled=culled)
    q = mesh.unknowns(strains)
    found = (minimum(mesh, system, gripper, q, memory, how) if method == 'newton'
             else search(system, q, method, TOLERANCE))
    return shape_of(mesh, gripper, found, memory, far_end)


def held_nearby(mesh: Discretization, gripper: Pose, strains: Floats, memory: Memory,
                far_end: FarEnd, culled: bool, watch: Watch | None = None) -> Shape | None:
    """Return the Shape in two grips next to given strains (N, 3); None if it is not near.

    The grip has no springs: then displacements of what lies beyond an element do not matter, and
    the Hessian's blocks are 3 wide. What springs would add is zero on what the grip leaves free.
    """
    how = search_of(mesh, gripper, far_end)
    if not culled or how.steps < MAX_ITERATIONS or memory.hold.shape != (len(far_end.held),):
        return None
    end = solution(mesh, gripper, strains, memory, far_end, how._replace(near=True), True, watch)
    return shape_from(mesh, gripper, end, memory, far_end, True) if end.residual < np.inf else None


def solution(mesh: Discretization, gripper: Pose, strains: Floats, memory: Memory | None,
             far_end: FarEnd | None, how: Search, culled: bool,
             watch: Watch | None = None) -> Solution:
    """Return the Solution of a step, found by one compiled call; arguments as of `equilibrium`."""
    system = mesh.free
    if far_end is not None or not culled:
        system = mesh.system(gripper.rotation, gripper.position, memory, far_end, culled=culled,
                             springs=not how.near)
    full = None if watch is None or mesh.hangs else mesh.full
    places, frames, rotation, nodes, most = watch or UNWATCHED
    tangents = NOWHERE
    if memory is not None and not culled:
        places, tangents = read_only(memory.positions), read_only(memory.tangents)
    return Solution(*solve_step(
        system, full, gripper.rotation, gripper.position, read_only(strains), places, tangents,
        frames, rotation, nodes, most, how.tolerance, how.exact * float(mesh.s[-1]), how.steps,
        how.check, how.near))


def acts_at(mesh: Discretization, strains: Floats, positions: Floats, before: Floats) -> bool:
    """Return whether something acts at a shape, or on the straight way to it from places before."""
    full = mesh.full
    return bool(may_act(full.effects, full, *map(np.array, (strains, positions, before))))


def search_of(mesh: Discretization, gripper: Pose, far_end: FarEnd | None) -> Search:
    """Return the thorough Search in these grips.

    The less slack there is, the more its tension depends on where the end is. What is out of reach
    is given up soon.
    """
    if far_end is None:
        return Search()
    length, spanned = float(mesh.s[-1]), distance(far_end, gripper)
    steps = MAX_ITERATIONS if spans(spanned, length, mesh.loaded) else _IN_VAIN
    exact = EXACT
    if mesh.loaded:
        exact = min(exact, _GRIP_EXACT * max(1.0 - spanned / length, _LEAST_SLACK))
    return Search(steps, exact=exact)


def reach_of(mesh: Discretization, spanned: float) -> float:
    """Return by how much a grip may be missed where so much is spanned, m; -1: out of reach."""
    length = float(mesh.s[-1])
    if not spans(spanned, length, mesh.loaded):
        return -1.0
    return min(_GRIP_KEPT * length, _SLACK * (length - spanned) if mesh.loaded else np.inf)


# ------------------------------------------------------------------------------------------------
# From a Solution to a Shape.


def shape_of(mesh: Discretization, gripper: Pose, found: Minimum, memory: Memory | None = None,
             far_end: FarEnd | None = None, *, culled: bool = False) -> Shape:
    """Return the Shape of a Minimum; `memory` is what the step began with."""
    if mesh.surroundings.pinned:
        gripper = Pose.from_rotation(gripper.position, found.system.base)
    end = solution_of(found, gripper)
    if mesh.surroundings.has_moments:
        end.wrench[3:] -= mesh.moments.sum(axis=0)
    return shape_from(mesh, gripper, end, memory, far_end, culled or mesh.hangs, found.evaluations)


def solution_of(found: Minimum, gripper: Pose, ended: bool = True) -> Solution:
    """Return the Solution of a Minimum, in the middle of a step if that has not `ended`."""
    residual, stability = float(found.residual), float(found.stability)
    end = outcome(found.system, found.state, np.array(gripper.position), residual, 0.0, ended)
    return Solution._make((*end, residual, stability, found.iterations, found.kicks,
                           float(found.violation), False))


def shape_from(mesh: Discretization, gripper: Pose, end: Solution, memory: Memory | None,
               far_end: FarEnd | None, culled: bool, evaluations: int = 0) -> Shape:
    """Return the Shape of a Solution: all that simulators return are made here."""
    around, before = mesh.surroundings, memory or mesh.start
    freeze(end[:4])
    violation = max(end.violation, end.inside)
    bound = around.pinned or far_end is not None or mesh.obstructed and not culled
    reach = np.inf if far_end is None else reach_of(mesh, distance(far_end, gripper))
    good = is_equilibrium(bool(end.stationary), end.stability, bool(bound), violation,
                          float(KEPT * mesh.s[-1]), end.missed, reach)
    after: Memory = before
    contacts: tuple[Any, ...] = ()
    if not (mesh.hangs and far_end is None):  # else the next step does not count from here
        freeze(end[4:7])
        after = memory_after(mesh, end, before, culled)
        if mesh.obstructed and not culled:
            contacts = contacts_of(mesh.s, end.contacts, gripper.position)
    return Shape(
        gripper, mesh.s, end.positions, end.frames, end.strains, end.energy, end.elastic,
        end.wrench, end.residual, end.stability, end.iterations, bool(good), contacts=contacts,
        evaluations=evaluations, violation=violation, far_end=far_end,
        far_wrench=NO_WRENCH if far_end is None else end.far_wrench, dissipated=after.dissipated,
        state=State(mesh, after, before, partial(
            estimated, mesh, gripper, end.strains, end.positions, before, far_end, culled),
            culled and not end.acts, end.kicks))


def memory_after(mesh: Discretization, end: Solution, before: Memory, culled: bool) -> Memory:
    """Return what a Solution leaves to the next step."""
    plastic, lost = before.plastic, before.dissipated
    force, points = before.node_force, before.points
    if not culled:
        if mesh.yields:
            plastic, lost = end.plastic, lost + end.lost
        if mesh.obstructed:
            force, points = end.forces[0], ContactPoints(*end.forces[1:])
            freeze(end.forces)
    tangents = end.frames[:, :, 0].copy()
    tangents.flags.writeable = False
    after = Memory.__new__(Memory)  # nobody else has its arrays: it need not look at them
    put(after, s=mesh.s, plastic=plastic, dissipated=lost, hold=end.hold, node_force=force,
        points=points, positions=end.positions, tangents=tangents, of=mesh.surroundings,
        set_error=before.set_error, original_set=None)
    return after


def underway(mesh: Discretization, found: Minimum, gripper: Pose, memory: Memory) -> Memory:
    """Return the same past with the forces in the middle of a step."""
    return memory.with_forces(memory_after(mesh, solution_of(found, gripper, False), memory, False))


def hanging_shape(mesh: Discretization, gripper: Pose, strains: Floats, frames: Floats,
                  positions: Floats, wrench: Floats, elastic: float, energy: float,
                  residual: float, stability: float, iterations: int) -> Shape:
    """Return the Shape of a DLO that hangs freely, which another kernel has found."""
    start = mesh.start
    return shape_from(mesh, gripper, Solution(
        strains, frames, positions, wrench, NO_WRENCH, start.hold, start.plastic, None, None,
        elastic, energy, 0.0, 0.0, 0.0, bool(residual < CONVERGED), residual, stability, iterations,
        0, 0.0, False), start, None, True)


def hangs_still(residual: Any, stability: Any) -> Any:
    """Whether a DLO that hangs freely is in a stable or neutral equilibrium."""
    return (residual < CONVERGED) & (stability > -NEUTRAL)


def estimated(mesh: Discretization, gripper: Pose, strains: Floats, positions: Floats,
              before: Memory, far_end: FarEnd | None, culled: bool) -> float:
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.
    """
    finer, halved = mesh.finer, np.repeat(strains, 2, axis=0)
    if culled and far_end is None:
        there = solution(finer, gripper, halved, None, None, _HALVED, True).positions
    else:
        past = finer.past(before)
        shape = None if far_end is None else held_nearby(finer, gripper, halved, past, far_end,
                                                         culled)
        if shape is None:
            shape = equilibrium(finer, gripper, halved, past, far_end, culled=culled)
            if not shape.converged:
                return np.inf
        there = shape.positions
    moved = np.linalg.norm(there[::2] - positions, axis=1).max()
    if mesh.obstructed and not culled and moved > _ELSEWHERE * mesh.s[-1]:
        return np.inf
    rounding = 1e-15 * mesh.s.size * mesh.s[-1]
    return float(4 / 3 * moved + rounding)
