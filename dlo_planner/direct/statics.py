# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium: from a gripper's pose and a discretization to a Shape with its proof."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.ball_joint import pinned_newton
from dlo_planner.direct.contact import contact_rows, contacts_of, forces_after
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.memory import ContactPoints, Memory
from dlo_planner.direct.shape import NO_WRENCH, Shape, State
from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.gap import penetration_of_point
from dlo_planner.energy.grip import constraint_violation
from dlo_planner.energy.plastic import PlasticSection, add_plastic, return_map
from dlo_planner.energy.potential import configuration_at, evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, new_configuration
from dlo_planner.energy.scene import translated
from dlo_planner.energy.terms import potential, stored
from dlo_planner.geometry.so3 import jacobians, matrix, plus, put_vector, transposed_applied, vector
from dlo_planner.kernels import kernel
from dlo_planner.minimize.classic import search
from dlo_planner.minimize.contact_solver import constrained_newton
from dlo_planner.minimize.convergence import CONVERGED, Minimum, is_stationary
from dlo_planner.minimize.newton import (
    HELD_NEUTRAL,
    NEUTRAL,
    minimize,
    new_workspace,
    newton_descent,
    next_to,
    thorough,
    within,
)
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd, distance, spans
from dlo_planner.model.value import freeze

TOLERANCE = 1e-10      # of the residual; the last step of a quadratic method overshoots it
EXACT = 1e-10          # of the length: violation of a constraint aimed at
KEPT = 1e-6            # the same that still counts as converged
MAX_ITERATIONS = 1000
_ELSEWHERE = 0.1       # of the length: a shape in contact that moves so far is another one
_GRIP_KEPT = 1e-9      # of the length: by how much a grip may be missed at the end
_SLACK = 1e-3          # of the slack: the same, as the DLO pulls the tighter the less there is
_GRIP_EXACT = 1e-4     # of the slack: what is aimed at
_LEAST_SLACK = 1e-10   # of the length: slack that is looked at
_IN_VAIN = 30          # Newton steps towards what is out of reach
_NO_PAST = np.zeros((0, 6))  # nothing has touched: where it was does not matter
NO_NODES: Ints = np.zeros(0, dtype=np.int64)  # of no RotationBound


class Search(NamedTuple):
    """Until when a minimum is sought."""

    steps: int = MAX_ITERATIONS  # Newton steps at most
    check: bool = True           # whether its stability is looked at, and what is unstable left
    exact: float = EXACT         # of the length: by how much constraints may be violated
    tolerance: float = TOLERANCE


class RotationBound(NamedTuple):
    """How far a DLO that hangs freely may turn from the Shape before, in the gripper."""

    frames: Floats = np.zeros((0, 3, 3))  # of that Shape, read-only
    before: Floats = np.eye(3)            # rotation of its gripper, read-only
    nodes: Ints = NO_NODES                # that are looked at
    most: float = np.inf                  # rad


THOROUGH, UNBOUNDED = Search(), RotationBound()
freeze(UNBOUNDED[:2])  # nodes are of the type of others


def equilibrium(mesh: Discretization, gripper: Pose, strains: Floats, method: str = 'newton',
                memory: Memory | None = None, far_end: FarEnd | None = None, *,
                culled: bool = False, bound: RotationBound = UNBOUNDED) -> tuple[Shape, int]:
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    `culled`: without what may act, see `Discretization`. Shapes: strains (N, 3).
    """
    culled = culled or mesh.hangs
    system = mesh.system(gripper.rotation, gripper.position, memory, far_end, culled=culled)
    q = mesh.unknowns(strains)
    if method != 'newton':
        found = search(system, q, method, TOLERANCE)
    else:
        found = minimum(mesh, system, gripper, q, memory, search_of(mesh, gripper, far_end),
                        culled=culled, bound=bound)
    return shape_of(mesh, gripper, found, memory, far_end, culled=culled), found.kicks


def search_of(mesh: Discretization, gripper: Pose, far_end: FarEnd | None) -> Search:
    """Return the thorough Search in these grips.

    The less slack there is, the more its tension depends on where the end is. What is out of reach
    is given up soon.
    """
    if far_end is None:
        return THOROUGH
    length, spanned = float(mesh.s[-1]), distance(far_end, gripper)
    steps = MAX_ITERATIONS if spans(spanned, length, mesh.loaded) else _IN_VAIN
    exact = EXACT
    if mesh.loaded:
        exact = min(exact, _GRIP_EXACT * max(1.0 - spanned / length, _LEAST_SLACK))
    return Search(steps, exact=exact)


def reach_of(mesh: Discretization, spanned: Floats) -> Floats:
    """Return by how much a grip may be missed at distances (n,) that are spanned, m.

    Below zero where that is out of reach.
    """
    length, loaded = float(mesh.s[-1]), mesh.loaded
    slack = _SLACK * (length - spanned) if loaded else np.inf
    return np.where(spans(spanned, length, loaded), np.minimum(_GRIP_KEPT * length, slack), -1.0)


def minimum(mesh: Discretization, system: Problem, gripper: Pose, q: Floats,
            memory: Memory | None = None, how: Search = THOROUGH, *, culled: bool = False,
            bound: RotationBound = UNBOUNDED) -> Minimum:
    """Return the Minimum that is reached from q (m, 3)."""
    exact = how.exact * float(mesh.s[-1])
    if culled:  # by one kernel, whatever holds it
        state, residual, stability, steps, kicks, missed = _descend(
            system, q, how.tolerance, exact, how.steps, how.check, *bound[:2],
            np.array(gripper.rotation, order='C'), *bound[2:])
        return Minimum(state, residual, stability, steps, kicks, system, missed)
    before = _NO_PAST
    if memory is not None and len(memory.positions):
        before = np.hstack([memory.positions - gripper.position, memory.tangents])
    newtons = pinned_newton if mesh.surroundings.pinned else constrained_newton

    def solved(system: Problem, q: Floats) -> Minimum:
        return newtons(system, q, how.tolerance, how.steps, how.check, exact, before)

    if mesh.surroundings.has_moments:
        return _balanced(solved, system, q, mesh.moments)
    return solved(system, q)


@kernel
def _descend(system: Problem, q: Floats, tolerance: float, exact: float, steps: int, check: bool,
             frames: Floats, before: Floats, base: Floats, nodes: Ints, most: float) -> Any:
    """Return what `minimize` does, on a RotationBound; base: (3, 3) of the gripper."""
    options = within(thorough(tolerance, exact, steps, check, tolerance < 0.0), frames, before,
                     base, nodes, most)
    return minimize(system, q.copy(), options, new_workspace(system))


def held_nearby(mesh: Discretization, gripper: Pose, strains: Floats, memory: Memory,
                far_end: FarEnd, culled: bool) -> Shape | None:
    """Return the Shape in two grips next to given strains (N, 3); None if it is not near.

    The grip has no springs: then displacements of what lies beyond an element do not matter, and
    the Hessian's blocks are 3 wide. What springs would add is zero on what the grip leaves free.
    """
    how = search_of(mesh, gripper, far_end)
    if not culled or how.steps < MAX_ITERATIONS or memory.hold.shape != (len(far_end.held),):
        return None
    system = mesh.system(gripper.rotation, gripper.position, memory, far_end, culled=True,
                         springs=False)
    state, residual, stability, steps, kicks, missed = _descend_nearby(
        system, mesh.unknowns(strains), how.tolerance, how.exact * float(mesh.s[-1]))
    if not residual < np.inf:
        return None
    found = Minimum(state, residual, stability, steps, kicks, system, missed)
    return shape_of(mesh, gripper, found, memory, far_end, culled=True)


@kernel
def _descend_nearby(system: Problem, q: Floats, tolerance: float, exact: float) -> Any:
    """Return what `minimize` does of what is near; else its residual is infinite."""
    held = exact > 0.0  # True; a literal would be compiled for by itself
    return minimize(system, q.copy(), next_to(tolerance, exact, held, held), new_workspace(system))


# ------------------------------------------------------------------------------------------------
# From a Minimum to a Shape.


class Outcome(NamedTuple):
    """All that a Shape and its Memory take from the end of a step, see `outcome`."""

    strains: Floats
    frames: Floats
    positions: Floats  # (N + 1, 3), world, m
    tangents: Floats
    wrench: Floats     # (6,) of the gripper on the DLO,
    far_wrench: Floats  # and of the far end's grip
    hold: Floats
    plastic: Floats
    forces: Any        # `forces_after`
    contacts: Any      # `contact_rows`
    elastic: float     # J, stored
    energy: float      # J
    lost: float        # J, to plastic deformation in the step
    missed: float      # m, by the far end
    inside: float      # m, how deep the gripper holds the axis in an obstacle
    stationary: bool


@kernel
def outcome(system: Problem, state: Configuration, origin: Floats, residual: float,
            rounding: float, ended: bool) -> Any:
    """Return the fields of an Outcome.

    Args:
        origin: (3,) position of the gripper, m
        residual, rounding: as of `is_stationary`
        ended: whether the step has; before, friction counts from where it began
    """
    n, effects = system.lengths.size, system.effects
    positions, tangents = np.empty((n + 1, 3)), np.empty((n + 1, 3))
    wrench, far_wrench = np.empty(6), np.zeros(6)
    for k in range(n + 1):
        for i in range(3):
            positions[k, i] = origin[i] + state.positions[k, i]
            tangents[k, i] = state.rotations[k, i, 0]
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    hold, missed = _grip_after(effects.hold, state, far_wrench)
    plastic, lost, springs = _set_after(effects.plastic, system, state.strains)
    elastic = stored(effects, system, state.strains) + springs
    forces, contacts, inside = _contacts_after(effects.contact, system, state, origin, ended)
    return (state.strains, state.rotations, positions, tangents, wrench, far_wrench, hold, plastic,
            forces, contacts, elastic, elastic + potential(effects, system, positions), lost,
            missed, inside, is_stationary(system, state, residual, rounding))


@kernel
def _grip_after(hold: Any, state: Configuration, wrench: Floats) -> Any:
    """Return the forces (K,) of the far end's grip, its miss in m; fill its wrench (6,)."""
    if hold is None:
        return np.zeros(0), 0.0
    if hold.multiplier.size == 0:
        return hold.multiplier, 0.0
    for i in range(3):
        wrench[i] = -state.attached.tip_force[i]
        wrench[3 + i] = -state.attached.tip_moment[i]
    return hold.multiplier, constraint_violation(hold, state.rotations[-1], state.positions[-1])


@kernel
def _set_after(plastic: Any, system: Problem, strains: Floats) -> Any:
    """Return the plastic strain after a step, the energy lost in it and that in springs, J."""
    if plastic is None:
        return np.zeros((system.lengths.size, 0)), 0.0, 0.0
    if plastic.share.shape[0] == 0:
        return plastic.set, 0.0, 0.0
    new, lost = return_map(system.lengths, strains, system.natural, plastic)
    after = PlasticSection(plastic.direction, plastic.limit, plastic.share, plastic.kind,
                           plastic.strength, plastic.ellipse, new)
    return new, lost, add_plastic(system.lengths, strains, system.natural, after,
                                  np.zeros(strains.shape))


@kernel
def _contacts_after(contact: Any, system: Problem, state: Configuration, origin: Floats,
                    ended: bool) -> Any:
    """Return `forces_after`, `contact_rows`, and how deep the gripper is in an obstacle, m.

    No force can push the axis out there. The surface beside it may reach into one, as where a thick
    DLO leaves a thin gripper.
    """
    if contact is None:
        return None, None, 0.0
    inside = 0.0
    if is_obstructed(contact):
        inside = penetration_of_point(translated(contact.scene, np.zeros(3)), origin)
    return (forces_after(system, state, origin, ended), contact_rows(system, state),
            max(0.0, inside))


@kernel
def is_obstructed(contact: Any) -> bool:
    """Whether there are obstacles."""
    if contact is None:
        return False
    return contact.scene.kind.size > 0  # type: ignore[no-any-return]


def shape_of(mesh: Discretization, gripper: Pose, found: Minimum, memory: Memory | None = None,
             far_end: FarEnd | None = None, *, culled: bool = False) -> Shape:
    """Return the Shape of a Minimum: all that simulators return are made here or in `shape_from`.

    `memory` is what the step began with.
    """
    around, before, culled = mesh.surroundings, memory or mesh.start, culled or mesh.hangs
    if around.pinned:
        gripper = Pose.from_rotation(gripper.position, found.system.base)
    end = Outcome(*outcome(found.system, found.state, np.array(gripper.position),
                           float(found.residual), 0.0, True))
    violation = max(float(found.violation), end.inside)
    bound = around.pinned or far_end is not None or mesh.obstructed and not culled
    good = bool(end.stationary and found.stability > -(HELD_NEUTRAL if bound else NEUTRAL)
                and violation <= KEPT * mesh.s[-1])
    if far_end is not None:
        good = good and bool(end.missed <= reach_of(mesh, np.array(distance(far_end, gripper))))
    if around.has_moments:
        end.wrench[3:] -= mesh.moments.sum(axis=0)
    return shape_from(mesh, gripper, end, before, far_end, culled=culled, proof={
        'residual': float(found.residual), 'stability': float(found.stability),
        'iterations': int(found.iterations), 'evaluations': int(found.evaluations),
        'violation': violation, 'converged': good})


def shape_from(mesh: Discretization, gripper: Pose, end: Outcome, before: Memory,
               far_end: FarEnd | None, proof: dict[str, Any], *, culled: bool,
               estimate: Callable[[], float] | None = None) -> Shape:
    """Return the Shape of an Outcome on a mesh; `before` is what the step began with."""
    for array in end[:8]:
        array.flags.writeable = False
    after, contacts = before, ()
    if not (mesh.hangs and far_end is None):  # else the next step does not count from here
        after, contacts = memory_after(mesh, end, before, culled)
    if estimate is None:
        estimate = partial(estimated, mesh, gripper, end.strains, end.positions, before, far_end,
                           culled)
    return Shape(
        gripper, mesh.s, end.positions, end.frames, end.strains, end.energy, end.elastic,
        end.wrench, contacts=contacts, far_end=far_end,
        far_wrench=NO_WRENCH if far_end is None else end.far_wrench,
        dissipated=after.dissipated, state=State(mesh, after, before, estimate, culled), **proof)


def memory_after(mesh: Discretization, end: Outcome, before: Memory,
                 culled: bool) -> tuple[Memory, tuple[Any, ...]]:
    """Return what a step leaves to the next one, and its Contacts."""
    plastic, lost = before.plastic, before.dissipated
    force, points = before.node_force, before.points
    contacts: tuple[Any, ...] = ()
    if not culled:
        if mesh.yields:
            plastic, lost = end.plastic, lost + end.lost
        if mesh.obstructed:
            force, points = end.forces[0], ContactPoints(*end.forces[1:])
            contacts = contacts_of(mesh.s, end.contacts, end.positions[0])
    return Memory(mesh.s, plastic, lost, end.hold, force, points, end.positions, end.tangents,
                  mesh.surroundings, before.set_error), contacts


def underway(mesh: Discretization, found: Minimum, gripper: Pose, memory: Memory) -> Memory:
    """Return the same past with the forces in the middle of a step."""
    end = Outcome(*outcome(found.system, found.state, np.array(gripper.position),
                           float(found.residual), 0.0, False))
    if not mesh.obstructed:
        return replace(memory, hold=end.hold)
    return replace(memory, hold=end.hold, node_force=end.forces[0],
                   points=ContactPoints(*end.forces[1:]))


def hanging_shape(mesh: Discretization, gripper: Pose, strains: Floats, frames: Floats,
                  positions: Floats, wrench: Floats, elastic: float, energy: float,
                  residual: float, stability: float, iterations: int) -> Shape:
    """Return the Shape of a DLO that hangs freely, which another kernel has found."""
    end = Outcome(strains, frames, positions, frames[:, :, 0].copy(),
                  wrench, NO_WRENCH, mesh.start.hold, mesh.start.plastic, None, None,
                  elastic, energy, 0.0, 0.0, 0.0, bool(residual < CONVERGED))
    good = bool(hangs_still(residual, stability))
    return shape_from(mesh, gripper, end, mesh.start, None, culled=True, proof={
        'residual': residual, 'stability': stability, 'iterations': iterations, 'converged': good})


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
    finer = mesh.finer
    if culled and far_end is None:
        moved = _moved_where_halved(
            finer.system(gripper.rotation, gripper.position, culled=True), strains, positions)
    else:
        past, halved = finer.past(before), np.repeat(strains, 2, axis=0)
        shape = None if far_end is None else held_nearby(finer, gripper, halved, past, far_end,
                                                         culled)
        if shape is None:
            shape, _ = equilibrium(finer, gripper, halved, 'newton', past, far_end, culled=culled)
            if not shape.converged:
                return np.inf
        moved = np.linalg.norm(shape.positions[::2] - positions, axis=1).max()
    if mesh.obstructed and not culled and moved > _ELSEWHERE * mesh.s[-1]:
        return np.inf
    rounding = 1e-15 * mesh.s.size * mesh.s[-1]
    return float(4 / 3 * moved + rounding)


@kernel
def _moved_where_halved(system: Problem, strains: Floats, positions: Floats) -> Any:
    """Return how far, in m, a few Newton steps move nodes of a DLO whose elements are halved.

    Args:
        system: of the halved elements; strains: (N, 3), positions: (N + 1, 3) of the whole ones
    """
    work, twice, never = new_workspace(system), np.empty_like(system.natural), strains.size < 0
    for e in range(2 * len(strains)):
        for i in range(3):
            twice[e, i] = strains[e // 2, i]
    unknowns_of(system, twice, work.start)
    state, _, _, _, _, _, _ = newton_descent(
        system, work.start, thorough(1e-9, 0.0, 4, never, never), work)
    farthest = 0.0
    for k in range(positions.shape[0]):
        away = 0.0
        for i in range(3):
            away += (state.positions[2 * k, i] + system.origin[i] - positions[k, i]) ** 2
        farthest = max(farthest, away)
    return np.sqrt(farthest)


# ------------------------------------------------------------------------------------------------
# Dead moments, which have no potential.


_ROUNDS = 60
_REMEMBERED = 8   # rounds that tell the next one where to go
_SETTLED = 1e-10  # part of the moments by which they may still turn


def _balanced(solved: Callable[[Problem, Floats], Minimum], system: Problem, q: Floats,
              moments: Floats) -> Minimum:
    """Return what `solved` returns in equilibrium with dead moments, its residual theirs too.

    The fixed point of frames -> shape -> frames is sought by Anderson's acceleration.

    Shapes: q (m, 3), moments (N + 1, 3).
    """
    unit = np.abs(moments).sum()
    state = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    known = _couples(system.lengths, state.strains, state.rotations, moments) / unit
    strains, iterations = state.strains, 0
    tried: list[Floats] = []
    missed: list[Floats] = []
    for _ in range(_ROUNDS):
        elastic = with_couples(system.elastic, unit * known)
        loaded = system._replace(elastic=elastic)
        found = solved(loaded, configuration_at(loaded, strains).q)
        state, system = found.state, found.system._replace(elastic=system.elastic)
        iterations += found.iterations
        strains = state.strains
        miss = _couples(system.lengths, strains, state.rotations, moments) / unit - known
        off = np.abs(miss).max()
        if off <= _SETTLED:
            break
        tried, missed = [*tried, known][-_REMEMBERED:], [*missed, miss][-_REMEMBERED:]
        known = _next(tried, missed)
    return found._replace(residual=max(found.residual, off), iterations=iterations, system=system)


def _next(tried: list[Floats], missed: list[Floats]) -> Floats:
    """Return where the misses (n, 3) would vanish, by least squares over what was tried."""
    best = tried[-1] + missed[-1]
    if len(tried) == 1:
        return best
    of_misses = np.column_stack([(one - missed[-1]).ravel() for one in missed[:-1]])
    share, *_ = np.linalg.lstsq(of_misses, -missed[-1].ravel(), rcond=1e-10)
    for part, one, miss in zip(share, tried[:-1], missed[:-1], strict=True):
        best = best + part * (one + miss - tried[-1] - missed[-1])
    return best


@kernel
def _couples(lengths: Floats, strains: Floats, rotations: Floats, moments: Floats) -> Floats:
    """Return (N, 3): the work of all moments beyond, per length and strain of each element, N m."""
    out = np.empty(strains.shape)
    beyond = (0.0, 0.0, 0.0)
    for e in range(lengths.size - 1, -1, -1):
        h = lengths[e]
        beyond = plus(beyond, vector(moments[e + 1]))
        turning, _ = jacobians(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h)
        own = transposed_applied(matrix(rotations[e]), beyond)
        put_vector(transposed_applied(turning, own), out[e])
    return out
