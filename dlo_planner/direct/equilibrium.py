# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium: the search for it from given strains, and the Shape of what it finds.

Most searches are one compiled call (`minimize.solve`). All shapes of simulators are made here, by
`shape_from`, which alone says whether what was found is an equilibrium.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.discretization import (
    NO_STRANDS,
    NOWHERE,
    ContactPoints,
    Discretization,
    Memory,
)
from dlo_planner.direct.grips import Grips
from dlo_planner.direct.search import (
    EXACT,
    KEPT,
    MAX_ITERATIONS,
    THOROUGH,
    TOLERANCE,
    Search,
    minimum,
    minimum_by,
)
from dlo_planner.direct.shape import (
    LYING,
    NO_WRENCHES,
    SelfContact,
    Shape,
    State,
    contacts_of,
    self_contacts_of,
)
from dlo_planner.energy.problem import Problem
from dlo_planner.energy.terms import may_act
from dlo_planner.minimize.convergence import CONVERGED, Minimum
from dlo_planner.minimize.quasi_static import settling
from dlo_planner.minimize.semismooth import correction
from dlo_planner.minimize.solve import (
    Solution,
    follow_step,
    is_equilibrium,
    outcome,
    placed_step,
    solve_step,
)
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.holds import Holds, Span, row_count, spans_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze, put, read_only
from dlo_planner.progress import INTERRUPT

_ELSEWHERE = 0.1       # of the length: a shape in contact that moves so far is another one
_GRIP_KEPT = 1e-9      # of the length: by how much a grip may be missed at the end
_SLACK = 1e-3          # of the slack: the same, as the DLO pulls the tighter the less there is
_GRIP_EXACT = 1e-4     # of the slack: what is aimed at
_LEAST_SLACK = 1e-10   # of the length: slack that is looked at
_WHOLE = 100           # Newton steps of a whole step, after its halves: beyond, it leads nowhere
# The same of a fall on halved elements, which tells an error alone: ordinary ones take 45 to 130,
# and one that was not bounded took 24 s, in vain
_OF_FALL = 150
_IN_VAIN = 30          # Newton steps towards what is out of reach


class Watch(NamedTuple):
    """What a step without what may act is watched for: that nothing does, and how far it turns."""

    places: Floats = NOWHERE   # (N + 1, 3) of the nodes before, m; (0, 3): stress-free
    frames: Floats = np.zeros((0, 3, 3))  # (N + 1, 3, 3) of the nodes before, read-only,
    rotation: Floats = np.zeros((3, 3))  # in a gripper with this rotation, read-only, zeros if
    # not known:
    nodes: Ints = np.zeros(0, dtype=np.int64)  # of these none
    most: float = np.inf       # turns by more in the gripper, rad


_HALVED = Search(4, False, tolerance=1e-9)  # of halved elements
UNWATCHED = Watch()
freeze(UNWATCHED[:3])  # nodes are of the type of others


def past_of(mesh: Discretization, initial: Shape | None, memory: Memory | None) -> Memory:
    """Return the Memory, on a mesh, of the DLO in the Shape `initial` or None."""
    known = None if initial is None else initial.state.history
    if (initial is not None and known is not None and len(known.positions)
            and known.positions is not initial.positions
            and not np.array_equal(known.positions, initial.positions)):
        # carried somewhere else since, or predicted: there it has touched nothing yet
        known = known.permanent_part()
    return mesh.past(known, memory)


def equilibrium(mesh: Discretization, gripper: Pose, strains: Floats,
                memory: Memory | None = None, holds: Holds = (), *,
                method: str = 'newton', culled: bool = False, watch: Watch | None = None,
                how: Search | None = None) -> Shape:
    """Return the Shape that the DLO falls into from strains (N, 3); `culled`: `Discretization`."""
    around, culled = mesh.surroundings, culled or mesh.hangs
    how = how or search_of(mesh, gripper, holds)
    if method == 'newton' and not (around.pinned or around.has_moments):
        end = solution(mesh, gripper, strains, memory, holds, how, culled, watch)
        return shape_from(mesh, gripper, end, memory, holds, culled)
    system = mesh.system(gripper.rotation, gripper.position, memory, holds, culled=culled)
    q = mesh.unknowns(strains)
    found = (minimum(mesh, system, gripper, q, memory, how) if method == 'newton'
             else minimum_by(method, system, q, TOLERANCE))
    return shape_of(mesh, gripper, found, memory, holds)


def held_nearby(mesh: Discretization, gripper: Pose, strains: Floats, memory: Memory,
                holds: Holds, culled: bool, watch: Watch | None = None) -> Shape | None:
    """Return the Shape in all grips next to given strains (N, 3); None if it is not near.

    Holds have no springs: then displacements of what lies beyond an element do not matter, and
    the Hessian's blocks are 3 wide. What springs would add is zero on what holds leave free.
    """
    how = search_of(mesh, gripper, holds)
    if (not culled or how.steps < MAX_ITERATIONS
            or memory.hold.size != row_count(holds)):
        return None
    end = solution(mesh, gripper, strains, memory, holds, how._replace(near=True), True, watch)
    return shape_from(mesh, gripper, end, memory, holds, True) if end.residual < np.inf else None


def bearing_on(mesh: Discretization, gripper: Pose, initial: Shape, strains: Floats,
               past: Memory) -> Shape | None:
    """Return the Shape in which a DLO goes on bearing where it does, or None."""
    if not mesh.may_hang or not past.in_contact or past.strands.size:
        return None
    end = _uninterrupted(follow_step(
        mesh.full, gripper.rotation, gripper.position, past.plastic, past.node_force, *past.points,
        past.positions, read_only(past.tangents), initial.gripper.rotation,
        initial.gripper.position, strains, TOLERANCE, EXACT * float(mesh.s[-1])))
    if not end.residual < np.inf:
        return None
    return shape_from(mesh, gripper, end, past, (), False)


def solution(mesh: Discretization, gripper: Pose, strains: Floats, memory: Memory | None,
             holds: Holds, how: Search, culled: bool,
             watch: Watch | None = None) -> Solution:
    """Return the Solution of a step, found by one compiled call; arguments as of `equilibrium`."""
    full = None if watch is None or mesh.hangs or not culled else mesh.full
    places, frames, rotation, nodes, most = watch or UNWATCHED
    tangents, exact = NOWHERE, how.exact * mesh.s.item(-1)
    if memory is not None and not culled:
        places, tangents = read_only(memory.positions), read_only(memory.tangents)
    if mesh.touches_itself:
        from dlo_planner.direct.self_contact import Step, kept_apart, rays_behind  # noqa: PLC0415  (few DLOs need it)
        rays = rays_behind(gripper, holds, mesh.s.item(-1))
        if full is not None:
            full = full._replace(rays=rays)
    if mesh.touches_itself and not culled:
        past = memory or mesh.start

        def system_of(memory: Memory) -> Problem:
            system: Problem = mesh.system(gripper.rotation, gripper.position, memory, holds)
            return system._replace(rays=rays)

        def solved(system: Problem, strains: Floats, how: Search) -> Solution:
            return _uninterrupted(solve_step(
                system, full, gripper.rotation, gripper.position, read_only(strains), places,
                tangents, frames, rotation, nodes, most, how.tolerance, exact, how.steps, how.check,
                how.near))

        def after(end: Solution) -> Memory:
            return memory_after(mesh, end, past, False)

        return kept_apart(Step(mesh, past, system_of, solved, after), strains, how)
    base, origin, strains = gripper.rotation, gripper.position, read_only(strains)
    if holds or not culled:
        system, *left = mesh.placing(origin, memory or mesh.start, holds, culled, not how.near)
        given: tuple[Any, ...] = (
            system, base, origin, *left, full, strains, places, tangents, frames, rotation, nodes,
            most, how.tolerance, exact, how.steps, how.check, how.near)
        return _uninterrupted(placed_step(*given))
    return _uninterrupted(solve_step(
        mesh.free, full, base, origin, strains, places, tangents, frames, rotation, nodes, most,
        how.tolerance, exact, how.steps, how.check, how.near))


def _uninterrupted(found: tuple[Any, ...]) -> Solution:
    """Return the Solution of what a kernel has found, as `progress.uninterrupted` does."""
    interrupt = INTERRUPT.get()
    if interrupt is not None:
        interrupt()
    return Solution(*found)


def acts_at(mesh: Discretization, strains: Floats, positions: Floats, before: Floats) -> bool:
    """Return whether something acts at a shape, or on the straight way to it from places before."""
    full = mesh.full
    return bool(may_act(full.effects, full, *map(np.array, (strains, positions, before))))


def search_of(mesh: Discretization, gripper: Pose, holds: Holds) -> Search:
    """Return the thorough Search in these grips.

    The less slack there is, the more tension depends on where the grips are. What is out of reach
    is given up soon.
    """
    if not holds:
        return THOROUGH
    steps, exact, length, loaded = MAX_ITERATIONS, EXACT, mesh.s.item(-1), mesh.loaded
    for span in spans_of(holds, gripper, length):
        if not span.reaches(loaded):
            steps = _IN_VAIN
        if loaded:
            slack = 1.0 - span.distance / span.length
            exact = min(exact, _GRIP_EXACT * max(slack, _LEAST_SLACK) * (span.length / length))
    return Search(steps, exact=exact)


def reach_of(mesh: Discretization, tautest: Iterable[Span], moves: bool = False) -> float:
    """Return by how much grips may be missed that have these Spans, m; -1: one is out of reach.

    What `moves` bears its loads by inertia for a while, so it may be as long as a span is.
    """
    reach, least = _GRIP_KEPT * mesh.s.item(-1), EXACT * mesh.s.item(-1) if moves else 0.0
    for span in tautest:
        if not span.reaches(mesh.loaded and not moves):
            return -1.0
        if mesh.loaded:
            reach = min(reach, max(_SLACK * (span.length - span.distance), least))
    return reach


# ------------------------------------------------------------------------------------------------
# From a Solution to a Shape.


def shape_of(mesh: Discretization, gripper: Pose, found: Minimum, memory: Memory | None = None,
             holds: Holds = ()) -> Shape:
    """Return the Shape of a Minimum; `memory` is what the step began with."""
    if mesh.surroundings.pinned:
        gripper = Pose.from_rotation(gripper.position, found.system.base)
    end = solution_of(found, gripper)
    if mesh.surroundings.has_moments:
        end.wrench[3:] -= mesh.moments.sum(axis=0)
    return shape_from(mesh, gripper, end, memory, holds, mesh.hangs, found.evaluations)


def solution_of(found: Minimum, gripper: Pose, ended: bool = True) -> Solution:
    """Return the Solution of a Minimum, in the middle of a step if that has not `ended`."""
    residual, stability = float(found.residual), float(found.stability)
    end = outcome(found.system, found.state, np.array(gripper.position), residual, 0.0, ended)
    return Solution._make((*end, residual, stability, found.iterations, found.kicks,
                           float(found.violation), False, None))


def shape_from(mesh: Discretization, gripper: Pose, end: Solution, memory: Memory | None,
               holds: Holds, culled: bool, evaluations: int = 0) -> Shape:
    """Return the Shape of a Solution: all that simulators return are made here."""
    around, before = mesh.surroundings, memory or mesh.start
    hangs = mesh.hangs and not holds  # then the next step does not count from here
    self_contacts: tuple[SelfContact, ...] = ()
    strands = NO_STRANDS
    violation = max(end.violation, end.inside)
    if end.strands is not None:
        self_contacts, depth, strands = self_contacts_of(mesh.s, end.positions, end.strands)
        violation = max(violation, depth)
    for one in end[:4]:
        one.setflags(write=False)
    if not hangs:
        freeze(end[4:7] if culled else end[4:8])
    bound = (around.pinned or holds or mesh.obstructed and not culled
             or end.strands is not None)
    reach = reach_of(mesh, spans_of(holds, gripper, mesh.s.item(-1))) if holds else np.inf
    good = is_equilibrium(bool(end.stationary), end.stability, bool(bound), violation,
                          KEPT * mesh.s.item(-1), end.missed, reach) and before.hinge < 0.0
    after: Memory = before
    contacts: tuple[Any, ...] = ()
    if not hangs:
        after = memory_after(mesh, end, before, culled, strands)
        if mesh.obstructed and not culled:
            of, rows = end.contacts
            contacts = contacts_of(mesh.s, of, rows, gripper.position)
    shape = Shape.__new__(Shape)  # its arrays are its own: to judge them takes as long as a step
    put(shape, gripper=gripper, s=mesh.s, positions=end.positions, frames=end.frames,
        element_strains=end.strains, energy=end.energy, elastic_energy=end.elastic,
        gripper_wrench=end.wrench, residual=end.residual, stability=end.stability,
        iterations=end.iterations, converged=bool(good), jumped=False, contacts=contacts,
        evaluations=evaluations, violation=violation, holds=holds,
        self_contacts=self_contacts,
        wrenches=end.wrenches if holds else NO_WRENCHES, dissipated=after.dissipated, parts=None,
        state=State.__new__(State), passed_itself=False)
    put(shape.state, mesh=mesh, history=after, before=before, estimate=partial(
        estimated, mesh, gripper, end.strains, end.positions, before, holds, culled, {}),
        culled=culled and not end.acts, kicks=end.kicks)
    return shape


def memory_after(mesh: Discretization, end: Solution, before: Memory, culled: bool,
                 touching: Floats = NO_STRANDS) -> Memory:
    """Return what a Solution leaves to the next step; `touching`: its `Memory.strands`."""
    plastic, lost = before.plastic, before.dissipated
    force, points, strands = before.node_force, before.points, before.strands
    frames = before.frames
    if not culled:
        if end.plastic is not None:
            plastic, lost = end.plastic, lost + end.lost
        if mesh.obstructed:
            force, points = end.forces[0], ContactPoints(*end.forces[1:])
        if mesh.touches_itself:
            strands = read_only(touching)
            frames = end.frames if mesh.rubs_itself else frames
    after = Memory.__new__(Memory)  # nobody else has its arrays: it need not look at them
    hold = mesh.start.hold if end.hold is None else end.hold
    put(after, s=mesh.s, plastic=plastic, dissipated=lost, hold=hold, node_force=force,
        points=points, positions=end.positions, tangents=end.frames[:, :, 0], of=mesh.surroundings,
        set_error=before.set_error, hinge=before.hinge, original_set=None, strands=strands,
        frames=frames)
    return after


def underway(mesh: Discretization, found: Minimum, gripper: Pose, memory: Memory) -> Memory:
    """Return the same past with the forces in the middle of a step."""
    return memory.with_forces(memory_after(mesh, solution_of(found, gripper, False), memory, False))


def hanging_shape(mesh: Discretization, gripper: Pose, strains: Floats, frames: Floats,
                  positions: Floats, wrench: Floats, elastic: float, energy: float,
                  residual: float, stability: float, iterations: int) -> Shape:
    """Return the Shape of a DLO that hangs freely, which another kernel has found."""
    return shape_from(mesh, gripper, Solution(
        strains, frames, positions, wrench, None, None, None, None, None, elastic, energy, 0.0, 0.0,
        0.0, bool(residual < CONVERGED), residual, stability, iterations, 0, 0.0, False),
        mesh.start, (), True)


def estimated(mesh: Discretization, gripper: Pose, strains: Floats, positions: Floats,
              before: Memory, holds: Holds, culled: bool, known: dict[float, float],
              most: float = np.inf) -> float:
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.

    Args:
        mesh, gripper, strains, positions, before, holds, culled: of the shape
        known: estimates found so far, by `most`; filled here
        most: of `halved`
    """
    if most in known:
        return known[most]
    if culled and not holds:
        there = solution(mesh.finer, gripper, np.repeat(strains, 2, axis=0), None, (), _HALVED,
                         True).positions
        error = _error_from(mesh, positions, there)
    else:
        finer = halved(mesh, gripper, strains, before, holds, culled, most)
        error = np.inf if finer is None else moved_from(mesh, positions, finer, culled)
    known[most] = error
    if error < np.inf:
        known[np.inf] = error  # with another `most` it is the same
    return error


class AlongWay(NamedTuple):
    """The error of a Shape: of its mesh, and of the way on which it rubbed or fell.

    Called, it returns their sum in m.
    """

    on_mesh: Callable[[], float]
    ways: tuple[Callable[[], float], ...] = ()   # of the parts of its step in which it rubs
    falls: tuple[Callable[[], float], ...] = ()  # of those in which it fell

    def where_it_lies(self) -> float:
        """Return it without how far elsewhere the DLO may have landed."""
        return self.on_mesh() + sum(way() for way in self.ways)

    def __call__(self) -> float:
        """Return it."""
        return self.where_it_lies() + sum(fall() for fall in self.falls)


def error_of_way(mesh: Discretization, gripper: Pose, positions: Floats, before: Pose,
                 strains: Floats, past: Memory, holds: Holds) -> float:
    """Return how far, in m, nodes are from where one step leads that was made in two halves.

    Friction follows a way by steps of first order. So halves of a step are wrong by as much as they
    are from the whole of it: what quarters would change is half of that, what eighths a quarter.
    Infinite where the whole step leads nowhere.

    Args:
        mesh: on which the halves were made
        gripper, positions, holds: where they ended, positions (N + 1, 3)
        before, strains, past: gripper, strains (N, 3) and Memory from which they began
    """
    how = search_of(mesh, gripper, holds)
    whole = equilibrium(mesh, gripper, strains, past, holds,
                        how=how._replace(steps=min(how.steps, _WHOLE)),
                        watch=UNWATCHED._replace(rotation=before.rotation))
    return _largest(whole.positions - positions) if whole.converged else np.inf


def error_of_step(mesh: Discretization, gripper: Pose, positions: Floats, before: Pose,
                  strains: Floats, past: Memory, holds: Holds, halfway: Grips) -> float:
    """Return how far, in m, nodes are off that a DLO which rubs brought there in a single step.

    That is twice of what they are from where two halves lead, see `error_of_way`, whose arguments
    these are. Infinite where a half leads nowhere.

    Args:
        halfway: where the grips are after the first half
    """
    rotation = before.rotation
    for grips in (halfway, Grips(gripper, holds)):
        how = search_of(mesh, grips.gripper, grips.holds)
        half = equilibrium(mesh, grips.gripper, strains, past, grips.holds,
                           how=how._replace(steps=min(how.steps, _WHOLE)),
                           watch=UNWATCHED._replace(rotation=rotation))
        if not half.converged:
            return np.inf
        rotation, strains = half.gripper.rotation, half.element_strains
        past = past_of(mesh, half, None)
    return 2.0 * _largest(half.positions - positions)


def error_of_fall(mesh: Discretization, gripper: Pose, positions: Floats, before: Pose,
                  strains: Floats, past: Memory, holds: Holds) -> float:
    """Return how far, in m, nodes are from where a DLO lands that falls from the same Shape.

    Where it lands among obstacles depends on all that it meets on the way. With halved elements it
    meets that in another order, and friction may hold it somewhere else. Infinite where it does not
    come to rest soon. Arguments as of `error_of_way`, of a fall in one step.
    """
    finer = mesh.finer
    how = search_of(finer, gripper, holds)
    there = equilibrium(finer, gripper, np.repeat(strains, 2, axis=0), finer.past(past), holds,
                        how=how._replace(steps=min(how.steps, _OF_FALL)),
                        watch=UNWATCHED._replace(rotation=before.rotation))
    return _largest(there.positions[::2] - positions) if there.converged else np.inf


def halved(mesh: Discretization, gripper: Pose, strains: Floats, before: Memory,
           holds: Holds, culled: bool, most: float = np.inf) -> Shape | None:
    """Return the equilibrium beside strains (N, 3) with every element halved; None without one.

    Among obstacles it is followed by `most`, rad, and no farther than to where it falls, if that is
    finite.
    """
    finer, start = mesh.finer, np.repeat(strains, 2, axis=0)
    past, shape = finer.past(before), None
    if holds:
        shape = held_nearby(finer, gripper, start, past, holds, culled)
    if shape is None:
        watch = UNWATCHED._replace(most=most) if most < np.inf and not culled else None
        shape = equilibrium(finer, gripper, start, past, holds, culled=culled, watch=watch)
        if not shape.converged:
            return None
    return shape


def moved_from(mesh: Discretization, positions: Floats, finer: Shape, culled: bool) -> float:
    """Return the error in m of nodes at `positions` (N + 1, 3), from where they are in `finer`.

    It is infinite where that is another shape in contact.
    """
    moved = _largest(finer.positions[::2] - positions)
    if mesh.obstructed and not culled and moved > _ELSEWHERE * mesh.s[-1]:
        return np.inf
    return _error_from(mesh, positions, finer.positions)


def _error_from(mesh: Discretization, positions: Floats, finer: Floats) -> float:
    """Return the error of nodes (N + 1, 3), of second order, from those of halved elements."""
    rounding = 1e-15 * mesh.s.size * mesh.s[-1]
    return float(4 / 3 * _largest(finer[::2] - positions) + rounding)


def _largest(vectors: Floats) -> float:
    """Return the length of the longest of some vectors (n, 3)."""
    return float(np.sqrt(np.einsum('ki,ki->k', vectors, vectors).max()))


def corrected_by(mesh: Discretization, shape: Shape, past: Memory) -> float:
    """Return how far, in m, the nodes are from the true rod's, by one step with halved elements.

    About what `Shape.error_estimate` says, which makes all steps and proves what it finds. Infinite
    where such a step tells nothing. Few points roll to where they are nearest; those of a DLO that
    lies on something exchange their forces, with others in between (`minimize.quasi_static`).
    """
    if not shape.contacts or mesh.yields or not mesh.may_hang or shape.state.feed is not None:
        return np.inf
    gripper, finer = shape.gripper, mesh.finer
    strains, places = np.array(shape.element_strains), shape.positions - gripper.position
    if len(shape.contacts) < LYING:
        there = past.halved(finer.s)
        system = finer.system(gripper.rotation, gripper.position, there, shape.holds)
        return 4 / 3 * float(correction(system, strains, places))
    before = shape.state.before or past
    there = finer.past(before.under(past))
    system = finer.system(gripper.rotation, gripper.position, there, shape.holds)
    return 4 / 3 * float(settling(system, strains, places, _seen_from(gripper, there)))


def _seen_from(gripper: Pose, past: Memory) -> Floats:
    """Return (N + 1, 6) where nodes were, from a gripper, and their tangents; (0, 6) if new."""
    if not len(past.positions):
        return np.zeros((0, 6))
    return np.hstack([past.positions - gripper.position, past.tangents])
