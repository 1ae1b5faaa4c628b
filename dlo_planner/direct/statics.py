# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Statics of a DLO on one mesh: from the shape before to the next, with its proof.

An obstacle that is not touched and a yield stress that is not reached add zeros to the equations.
So a step is made first without them, and a compiled sweep (`energy.terms.may_act`) looks at the end
of the step and at the straight way to it. Where something acts, or the DLO remembers something, it
is made with all that may act.

Where the DLO goes on bearing on obstacles, or in all its grips, a step is a correction of the
shape before. Else the grips are moved to their places, around obstacles where that can be, and the
minimum is sought from there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.coarse import coarsely
from dlo_planner.direct.discretization import (
    NO_STRANDS,
    NOWHERE,
    ContactPoints,
    Discretization,
    Memory,
)
from dlo_planner.direct.search import (
    EXACT,
    KEPT,
    MAX_ITERATIONS,
    THOROUGH,
    TOLERANCE,
    Search,
    described_minimum,
    hinge_unknowns,
    minimum,
    minimum_by,
    own_unknowns,
    turn_of,
    with_hinge,
)
from dlo_planner.direct.shape import (
    NO_WRENCH,
    NO_WRENCHES,
    SelfContact,
    Shape,
    State,
    contacts_of,
    hinge_of,
    self_contacts_of,
)
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.gap import penetration, penetration_of_point
from dlo_planner.energy.potential import configuration_at
from dlo_planner.energy.problem import Problem
from dlo_planner.energy.terms import may_act
from dlo_planner.geometry.so3 import matrix, partway, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import CONVERGED, Minimum
from dlo_planner.minimize.newton import follow_homotopy
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
from dlo_planner.model.holds import (
    FarEnd,
    Hold,
    Holds,
    Span,
    alike,
    counterpart,
    places_of,
    posed,
    row_count,
    spans_of,
)
from dlo_planner.model.pose import Pose, angle_between, pose_of
from dlo_planner.model.value import Constant, changed, freeze, put, read_only
from dlo_planner.model.varying import scaled
from dlo_planner.progress import INTERRUPT, uninterrupted


def between(one: Pose, other: Pose, fraction: float) -> Pose:
    """Return the Pose at `fraction` of the way: position linear, rotation about one fixed axis."""
    return pose_of(one.position + fraction * (other.position - one.position),
                   partway(one.rotation, other.rotation, float(fraction)))


class Grips(NamedTuple):
    """What holds a DLO: Pose of the gripper, Holds."""

    gripper: Pose
    holds: Holds = ()

    def towards(self, goal: Grips, fraction: float) -> Grips:
        """Return where grips are at a fraction of the straight way to `goal`, which holds as much.

        Their ways of holding are those of `goal`.
        """
        holds = tuple(posed(other, between(one.pose, other.pose, fraction))
                      for one, other in zip(self.holds, goal.holds, strict=True))
        return Grips(between(self.gripper, goal.gripper, fraction), holds)


def grips_at(shape: Shape, holds: Holds) -> Grips:
    """Return where a Shape has its gripper, and the places that Holds are to hold."""
    return Grips(shape.gripper, tuple(posed(hold, _place_of(shape, hold)) for hold in holds))


def _place_of(shape: Shape, hold: Hold) -> Pose:
    """Return the Pose of the DLO where something is to hold it."""
    if hold.s is None:
        return Pose.from_rotation(shape.positions[-1], shape.frames[-1])
    rotation, position = shape.frame_at(hold.s)
    return Pose.from_rotation(position, rotation)


class StepInputs(NamedTuple):
    """How a DLO is held in a step, what it begins with, and how its shape is sought."""

    memory: Memory | None = None  # that it starts with if there is no Shape of it before
    holds: Holds = ()
    method: str = 'newton'        # as of `DirectSimulator`, like `strains`
    strains: str = 'components'
    # rad, by which a DLO that hangs freely may turn, see `Watch`; if it is finite, a fall onto
    # obstacles or along them is wanted no more exactly than the first mesh has it, and what is not
    # found soon is sought in smaller parts
    most: float = np.inf


ALONE = StepInputs()
LYING = 4  # contacts at least, of a DLO that lies on something


def step(mesh: Discretization, gripper: Pose, initial: Shape | None, how: StepInputs = ALONE,
         start: Floats | None = None) -> Shape:
    """Return the Shape that follows `initial` (a Shape or None) on a mesh.

    The search begins with the strains `start` (N, 3), if any, instead of those of `initial`.
    """
    if initial is not None and not initial.converged and initial.impossible:
        # neither its strains nor the set that it would leave are those of a DLO
        how, initial = how._replace(memory=initial.state.before or how.memory), None
    past, shape = past_of(mesh, initial, how.memory), None
    if (how.method == 'newton' and mesh.may_hang and past.idle
            and (mesh.hangs or mesh.touches_itself or not how.holds or initial is not None)):
        shape = _searched(mesh, gripper, initial, how, past, start, culled=True)
        given_up = not shape.converged and how.most < np.inf  # then it is made in parts
        if (mesh.touches_itself and initial is not None and not given_up
                and _may_have_met(initial, shape)):
            shape = None
        if shape is not None and not (mesh.hangs or given_up
                                      or shape.converged and shape.state.culled):
            if mesh.touches_itself and initial is None and shape.converged:
                start = shape.element_strains  # from where strands in each other are pushed apart
            shape = None
    if shape is None:
        shape = _searched(mesh, gripper, initial, how, past, start, culled=False)
    return _with_set_judged(shape, initial) if mesh.yields else shape


def _with_set_judged(shape: Shape, initial: Shape | None) -> Shape:
    """Return a Shape whose history knows how exact its permanent set is, if it can be one.

    The set that a step makes is as exact as the step; what comes later tells nothing of it. It
    cannot take more energy than the step was given. Where it gathers in one element (`hinge_of`),
    no mesh tells how far that bends: neither this shape nor one that follows it is an answer.
    """
    before, after, state = shape.state.before, shape.state.history, shape.state
    if before is None or after is None or not after.has_set:
        return shape
    if not shape.converged:
        return _without_set(shape, before) if shape.impossible else shape
    if before.original_set is None and np.array_equal(before.plastic, after.plastic):
        return shape
    excess = 0.0 if initial is None else overspent(initial, shape)
    if excess > 0.0:
        return _without_set(replace(shape, converged=False, state=replace(
            state, overspent=excess)), before)
    finer = halved(state.made_on, shape.gripper, shape.element_strains, before, shape.holds,
                   state.culled)
    hinge = hinge_of(shape, finer)
    error = np.inf if finer is None else moved_from(state.made_on, shape.positions, finer,
                                                    state.culled)
    if hinge is not None:
        return replace(shape, converged=False, state=replace(
            state, history=replace(after, hinge=hinge), estimate=Constant(np.inf)))
    return replace(shape, state=replace(
        state, history=changed(after, set_error=max(before.set_error, error)),
        estimate=Constant(error)))


def _without_set(shape: Shape, before: Memory) -> Shape:
    """Return a Shape that leaves to the next step the set that was there before it."""
    return replace(shape, state=replace(shape.state, history=before.permanent_part()))


def _searched(mesh: Discretization, gripper: Pose, initial: Shape | None, how: StepInputs,
              past: Memory, start: Floats | None, *, culled: bool) -> Shape:
    """Return what `step` does; `culled`: without what may act."""
    holds, newton = how.holds, how.method == 'newton'
    if start is not None:
        strains = read_only(start)
    elif initial is None:
        strains = mesh.stress_free(past)
    elif mesh.has_nodes(initial.s):
        strains = initial.element_strains
    else:
        strains = read_only(mesh.strains_from(initial.s, initial.element_strains))
    watch = _watched(mesh, initial, how.most) if culled else None if initial is None else (
        UNWATCHED._replace(rotation=initial.gripper.rotation, most=how.most))
    if culled and not holds:
        return equilibrium(mesh, gripper, strains, past, culled=True, watch=watch)
    if how.strains == 'paper':
        system = mesh.local.system(gripper.rotation, gripper.position, past)
        return shape_of(mesh.local, gripper, described_minimum(mesh, system, strains, how.method),
                        past)
    shape = None
    if newton and initial is not None:
        if not holds:
            shape = _corrected_contact(mesh, gripper, initial, strains, past)
        elif alike(initial.holds, holds):
            shape = held_nearby(mesh, gripper, strains, past, holds, culled, watch)
        else:
            past = changed(past, hold=_forces_that_stay(initial.holds, past.hold, holds))
    if shape is not None:
        return shape
    if initial is not None and mesh.surroundings.pinned:  # it does not turn with its gripper
        gripper = Pose.from_rotation(gripper.position, initial.gripper.rotation)
    gripper, strains, past, clear = _predict(mesh, initial, strains, Grips(gripper, holds), past,
                                             culled)
    if newton and initial is None and holds:
        shape = held_nearby(mesh, gripper, strains, past, holds, culled, watch)
    if shape is None:
        search = search_of(mesh, gripper, holds)
        if how.most < np.inf and initial is not None and len(initial.contacts) >= LYING:
            search = search._replace(steps=_IN_PARTS)
        shape = equilibrium(mesh, gripper, strains, past, holds, method=how.method,
                            culled=culled, watch=watch, how=search)
        if (newton and initial is None and not shape.converged and places_of(holds)
                and not mesh.obstructed and _may_come_out(mesh, gripper, holds)):
            shape = _joined(mesh, gripper, past, holds) or shape
        if (newton and initial is None and mesh.obstructed and not culled
                and shape.violation > KEPT * mesh.s[-1] and _may_come_out(mesh, gripper, holds)):
            shape = _from_elsewhere(mesh, gripper, past, holds) or shape
    return shape if clear else replace(shape, converged=False, jumped=True)


def _joined(mesh: Discretization, gripper: Pose, memory: Memory, holds: Holds) -> Shape | None:
    """Return the Shape next to what `_by_parts` returns, or None."""
    found = _by_parts(mesh, gripper, holds, memory)
    if found is None:
        return None
    shape = equilibrium(mesh, found.gripper, found.strains, found.memory, holds)
    return shape if shape.converged else None


def _forces_that_stay(before: Holds, forces: Floats, holds: Holds) -> Floats:
    """Return forces (K,) of Holds: of those that held `before` theirs, else 0."""
    counts = [len(hold.held) for hold in before]
    if forces.size != sum(counts):
        return np.zeros(0)
    known = {(hold.s, hold.grip): part for hold, part in zip(
        before, np.split(forces, np.cumsum(counts)[:-1]), strict=True)} if before else {}
    return np.concatenate([known.get((hold.s, hold.grip), np.zeros(len(hold.held)))
                           for hold in holds])


def _from_elsewhere(mesh: Discretization, gripper: Pose, memory: Memory,
                    holds: Holds) -> Shape | None:
    """Return the Shape that falls onto the obstacles from above, or swings against them; or None.

    Where a DLO is first inside obstacles the way out may be above them, where its dead loads would
    lift it, or below, where it would hang without them. It yields on the last way alone.
    """
    bare = mesh.within(replace(mesh.surroundings, obstacles=()))
    lifted = bare.varied(pull=-bare.free.load.pull)
    for one in (lifted, bare) if mesh.loaded else (bare,):
        there = step(one, gripper, None, StepInputs(holds=holds))
        if there.converged:
            shape = equilibrium(mesh, there.gripper, there.element_strains, memory, holds)
            if shape.converged:
                return shape
    return None


def _may_come_out(mesh: Discretization, gripper: Pose, holds: Holds) -> bool:
    """Return whether the gripper is in no obstacle, and all that holds within reach."""
    length = float(mesh.s[-1])
    inside = penetration_of_point(mesh.scene, np.array(gripper.position))
    return inside <= KEPT * length and all(
        span.reaches(mesh.loaded) for span in spans_of(holds, gripper, length))


def _corrected_contact(mesh: Discretization, gripper: Pose, initial: Shape, strains: Floats,
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
    shape = shape_from(mesh, gripper, end, past, (), False)
    return None if mesh.touches_itself and _may_have_met(initial, shape) else shape


def _may_have_met(initial: Shape, shape: Shape) -> bool:
    """Return whether strands may have met on the way between two Shapes."""
    from dlo_planner.direct.self_contact import may_have_met  # noqa: PLC0415  (few need it)
    return may_have_met(initial, shape)


def past_of(mesh: Discretization, initial: Shape | None, memory: Memory | None) -> Memory:
    """Return the Memory, on a mesh, of the DLO in the Shape `initial` or None."""
    known = None if initial is None else initial.state.history
    if (initial is not None and known is not None and len(known.positions)
            and known.positions is not initial.positions
            and not np.array_equal(known.positions, initial.positions)):
        # carried somewhere else since, or predicted: there it has touched nothing yet
        known = known.permanent_part()
    return mesh.past(known, memory)


def _watched(mesh: Discretization, before: Shape | None, most: float) -> Watch:
    """Return what a step from `before` (None: stress-free) is watched for; `most`: StepInputs."""
    if before is None:
        return UNWATCHED
    if mesh.has_nodes(before.s):
        if most == np.inf:
            return Watch(before.positions, rotation=before.gripper.rotation)
        return Watch(before.positions, before.frames, before.gripper.rotation, mesh.sampled, most)
    if mesh.hangs:
        return UNWATCHED
    strains, pose = mesh.strains_from(before.s, before.element_strains), before.gripper
    places = configuration_at(mesh.system(pose.rotation, culled=True), strains).positions
    freeze(places := places + pose.position)
    return UNWATCHED._replace(places=places, rotation=pose.rotation)


def corrected_by(mesh: Discretization, shape: Shape, past: Memory) -> float:
    """Return how far, in m, the nodes are from the true rod's, by one step with halved elements.

    About what `Shape.error_estimate` says, which makes all steps and proves what it finds. Infinite
    where such a step tells nothing.
    """
    if not shape.contacts or shape.holds or mesh.yields or not mesh.may_hang:
        return np.inf
    gripper, finer = shape.gripper, mesh.finer
    system = finer.system(gripper.rotation, gripper.position, past.halved(finer.s))
    return 4 / 3 * float(correction(system, np.array(shape.element_strains),
                                    shape.positions - gripper.position))


# ------------------------------------------------------------------------------------------------
# The way of the grips to where a search begins.


_TURN, _SHIFT = 0.3, 0.08  # rad, part of the length: how far a grip goes in one part
_FINER = 4   # times the parts of a way that is not found in larger ones
_FINEST = 3  # times they are made smaller
_RELAXING = Search(12, False, 1e-5)  # between two parts of a motion
_AGAIN = 8            # times that what is not out of obstacles yet is sought again there
_SMALLEST = 2.0**-14  # part of the motion: what cannot be moved by it is blocked
_MORE_PARTS = 1000    # than the longest would need: what takes more of them has got stuck
_SOFT = 0.1           # of the bending stiffness: torsion below it is soft
_DEPTH = 1e-5         # of the length: depth in obstacles that is allowed while it grows
_LEFT = 1e-4          # residual at which a step of growth ends; ten times that is still accepted
_GROWING = Search(100, False, _DEPTH, _LEFT)
_LEAST_GROWTH = 2.0**-10  # of the growth: if smaller steps fail, the growth ends there


class Predictor(NamedTuple):
    """Where a search begins: gripper, strains (N, 3), the past; and whether the way is clear."""

    gripper: Pose
    strains: Floats
    memory: Memory
    clear: bool = True


def _predict(mesh: Discretization, previous: Shape | None, strains: Floats, goal: Grips,
             memory: Memory, culled: bool) -> Predictor:
    """Return where the search begins, the past with the forces of a grip at the end of the way.

    The grips go straight from where they are in `previous`; the DLO gives way. Where an obstacle is
    between here and there, the motion is made in smaller parts.
    """
    (gripper, holds), amid = goal, mesh.obstructed and not culled
    if not holds and (previous is None or not amid):
        return Predictor(gripper, strains, memory)
    strains = np.array(strains)  # those of a Shape are read-only, another type for kernels
    if previous is not None:
        begin = grips_at(previous, holds)
    else:
        begin = Grips(gripper, _places_in(mesh, gripper, strains, holds))
    parts = _parts_between(begin, goal, float(mesh.s[-1]))
    if parts == 0:
        return Predictor(gripper, strains, memory)
    if holds and previous is None:
        return _initial_placement(mesh, strains, begin, goal, memory, parts)
    if holds and not amid:
        return _follow_way(mesh, strains, begin, goal, memory, parts, culled)
    return _advance_in_parts(mesh, strains, begin, goal, memory, parts)


def _places_in(mesh: Discretization, gripper: Pose, strains: Floats, holds: Holds) -> Holds:
    """Return Holds that are where the DLO has their places with strains (N, 3) in a gripper."""
    state, there = configuration_at(mesh.system(gripper.rotation, culled=True), strains), []
    positions, rotations = state.positions, state.rotations
    for hold, node in zip(holds, mesh.held_nodes(holds)[0].tolist(), strict=True):
        place = gripper.position + positions[node]
        there.append(posed(hold, Pose.from_rotation(place, rotations[node])))
    return tuple(there)


def _parts_between(begin: Grips, goal: Grips, length: float) -> int:
    """Return in how many parts the motion is to be made at least; 0 if there is none."""
    pairs = [(begin.gripper, goal.gripper, True)]
    pairs += [(one.pose, other.pose, other.grip != 'pinned')
              for one, other in zip(begin.holds, goal.holds, strict=True)]
    parts = 0.0
    for one, other, turns in pairs:
        shift = float(np.linalg.norm(other.position - one.position))
        turn = angle_between(one.rotation, other.rotation) if turns else 0.0
        if not goal.holds:
            return int(shift + turn > 0)
        parts = max(parts, shift / (_SHIFT * length), turn / _TURN)
    return int(np.ceil(parts - 1e-9))


def _follow_way(mesh: Discretization, strains: Floats, begin: Grips, goal: Grips, memory: Memory,
                parts: int, culled: bool) -> Predictor:
    """Return where the search begins near the end of a straight way of all grips together.

    What is left is the last part. Where the DLO does not follow, the way is left there.
    """
    holds, first, last, done = goal.holds, begin.gripper, goal.gripper, 0.0
    for finer in range(_FINEST):
        count = int(np.ceil(parts * _FINER**finer * (1.0 - done) - 1e-9))
        if count <= 1:
            break
        shares = done + (1.0 - done) * np.arange(1, count) / count
        gripped, bases = _way(first, last, shares)
        held_at, axes = (np.empty((count - 1, len(holds), 3)),
                         np.empty((count - 1, len(holds), 3, 3)))
        there: Holds = ()
        for k, (one, other) in enumerate(zip(begin.holds, holds, strict=True)):
            held_at[:, k], axes[:, k] = _way(one.pose, other.pose, shares)
            there += posed(other, Pose.from_rotation(held_at[0, k], axes[0, k])),
        system = mesh.system(bases[0], gripped[0], memory, there, culled=culled)
        targets, rows = held_at - gripped[:, None], mesh.grip_rows(holds, axes)
        q = mesh.unknowns(strains)
        if mesh.surroundings.pinned:
            bases[:] = system.base
            q, gone = uninterrupted(follow_homotopy(
                with_hinge(system), hinge_unknowns(system, q), bases, targets, axes, rows))
            first, last = (Pose.from_rotation(pose.position, system.base @ turn_of(system, q))
                           for pose in (first, last))
            q = own_unknowns(system, q)
        else:
            q, gone = uninterrupted(follow_homotopy(
                system, q, bases, targets, axes, rows))
        strains = mesh.strains_of(q)
        memory = changed(memory, hold=system.hold.multiplier)
        if gone == len(shares):
            break
        done = shares[gone - 1] if gone else done
    return Predictor(last, strains, memory)


def _way(one: Pose, other: Pose, shares: Floats) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) at shares (n,) of a straight way."""
    turned = [partway(one.rotation, other.rotation, share) for share in shares.tolist()]
    return one.position + shares[:, None] * (other.position - one.position), np.array(turned)


def _initial_placement(mesh: Discretization, strains: Floats, begin: Grips, goal: Grips,
                       memory: Memory, parts: int) -> Predictor:
    """Return where the search begins for a DLO that is set down in its grips.

    First without obstacles, then it grows to its thickness among them; torsion that is soft is as
    stiff as bending until then.
    """
    (gripper, holds), amid = goal, mesh.obstructed
    firm = _with_firm_torsion(mesh)
    bare = firm.within(replace(firm.surroundings, obstacles=())) if amid else firm
    past = bare.past(memory)

    def led(coarse: Discretization) -> Shape:
        far = _follow_way(coarse, coarse.strains_from(mesh.s, strains), begin, goal, coarse.start,
                          parts, False)
        return equilibrium(coarse, far.gripper, far.strains, far.memory, holds)

    gripper, strains, past, _ = (
        _first_shape(bare, gripper, holds, past) or coarsely(bare, gripper, holds, past, parts, led)
        or _follow_way(bare, strains, begin, goal, past, parts, False))
    if amid:
        shape = equilibrium(bare, gripper, strains, past, holds)
        past = changed(firm.past(memory), hold=shape.state.left.hold)
        gripper, strains, past, _ = _grow_thickness(
            firm, shape.gripper, np.array(shape.element_strains), holds, past)
    if firm is not mesh:
        shape = equilibrium(firm, gripper, strains, past, holds)
        gripper, strains, past = shape.gripper, np.array(shape.element_strains), shape.state.left
    return Predictor(gripper, strains, memory.with_forces(past))


def _first_shape(mesh: Discretization, gripper: Pose, holds: Holds,
                 memory: Memory) -> tuple[Pose, Floats, Memory, bool] | None:
    """Return what a DLO of which a part is nearly taut begins with; None where none is, or known.

    From the stress-free shape a search would have to find the tension, beyond all bounds.
    """
    from dlo_planner.direct.taut import first_shape, is_taut  # noqa: PLC0415  (SciPy: a free DLO needs none)
    if len(holds) == 1 and holds[0].s is None:
        return first_shape(mesh, gripper, holds[0], memory)
    return _by_parts(mesh, gripper, holds, memory) if is_taut(mesh, gripper, holds) else None


def _by_parts(mesh: Discretization, gripper: Pose, holds: Holds,
              memory: Memory) -> Predictor | None:
    """Return a DLO whose parts between holds are each in equilibrium; None if one is not found.

    Where a pin leaves the frame open, its tangent is that of `taut.pin_tangent`.
    """
    from dlo_planner.direct.taut import pin_tangent  # noqa: PLC0415  (SciPy: a free DLO needs none)
    if memory.has_set:
        return None  # it stays on its mesh
    nodes = [0, *mesh.held_nodes(holds)[0].tolist()]
    grips: list[Hold | None] = []
    for k, hold in enumerate(holds):
        tangent = None
        if hold.grip == 'pinned' and hold.s is not None:
            tangent = pin_tangent(gripper, holds, k)
        grips.append(FarEnd(hold.pose, hold.grip) if tangent is None else FarEnd(
            Pose.looking_along(hold.pose.position, tangent), 'aligned'))
    if nodes[-1] < mesh.s.size - 1:  # what hangs beyond
        nodes, grips = [*nodes, mesh.s.size - 1], [*grips, None]
    begin, shapes = gripper, []
    for first, last, end in zip(nodes, nodes[1:], grips, strict=False):
        part = _part_of(mesh, first, last)
        shape = step(part, begin, None, StepInputs(holds=() if end is None else (end,)))
        if not (shape.converged or shape.nearly):
            return None
        begin = Pose.from_rotation(shape.positions[-1], shape.frames[-1])
        shapes.append(shape)
    forces = []
    for k, hold in enumerate(holds):
        wrench, rows = shapes[k].far_wrench, hold.held
        if k + 1 < len(shapes):
            wrench = wrench + shapes[k + 1].gripper_wrench
        forces.append(-(rows[:, :3] @ wrench[3:] / mesh.lever + rows[:, 3:] @ wrench[:3]))
    strains = np.vstack([shape.element_strains for shape in shapes])
    return Predictor(shapes[0].gripper, mesh.strains_of(mesh.unknowns(strains)),
                     replace(memory, hold=np.concatenate(forces)))


def _part_of(mesh: Discretization, first: int, last: int) -> Discretization:
    """Return the elements between two nodes of a Discretization, without what may act."""
    around, (begin, end) = mesh.surroundings.free, mesh.s[[first, last]].tolist()
    if last < mesh.s.size - 1:
        around = around.part(end, -1).part(end - begin, -1)
    elif first:
        around = around.part(begin, 1)
    if first:  # a pinned gripper is only at the beginning
        around = replace(around, grip='clamped')
    s = mesh.s[first:last + 1] - begin
    s[-1] = around.rod.length
    return Discretization(around, s, 'local', 0)


def _with_firm_torsion(mesh: Discretization) -> Discretization:
    """Return a Discretization whose torsion is no softer than its bending; itself if it is not."""
    rod = mesh.rod
    twist, bend = rod.stiffness[0], min(rod.stiffness[1:])
    if rod.yields or twist > _SOFT * bend:
        return mesh
    firm = replace(rod, torsional_stiffness=scaled(rod.torsional_stiffness, float(bend / twist)))
    return mesh.within(mesh.surroundings.of_rod(firm))


def _grow_thickness(mesh: Discretization, gripper: Pose, strains: Floats, holds: Holds,
                    memory: Memory) -> Predictor:
    """Return a DLO grown to its thickness among obstacles, from its strains without them."""
    system = mesh.system(gripper.rotation, gripper.position, memory, holds)
    state = configuration_at(system, strains)
    thin = growth = penetration(system.scene, system.lengths, state.strains, state.rotations,
                                state.positions)
    step = growth
    while thin > 0.0 and step > _LEAST_GROWTH * growth:
        wanted = max(0.0, thin - step)
        system = mesh.system(gripper.rotation, gripper.position, memory, holds)
        scene = system.scene  # of a DLO whose surface is deeper everywhere
        scene = scene._replace(radius=scene.radius - wanted, radii=scene.radii - wanted,
                               rounding=scene.rounding - wanted)
        found = minimum(mesh, system._replace(scene=scene), gripper, mesh.unknowns(strains),
                        memory, _GROWING)
        if not (found.residual < 10.0 * _LEFT and found.violation < _DEPTH * mesh.s[-1]):
            step *= 0.5
            continue
        thin, step = wanted, min(2 * step, wanted)
        strains = found.state.strains.copy()
        if mesh.surroundings.pinned:
            gripper = Pose.from_rotation(gripper.position, found.system.base)
        memory = underway(mesh, found, gripper, memory)
    return Predictor(gripper, strains, memory)


def _advance_in_parts(mesh: Discretization, strains: Floats, begin: Grips, goal: Grips,
                      memory: Memory, parts: int) -> Predictor:
    """Return where the search begins after a way in parts, around obstacles where it can."""
    done, step, where, past, left = 0.0, 1.0 / parts, begin.gripper, memory, parts + _MORE_PARTS
    while done < 1.0:
        old = configuration_at(mesh.system(where.rotation), strains)
        target = min(1.0, done + step)
        there = goal if target == 1.0 else begin.towards(goal, target)
        system = mesh.system(there.gripper.rotation, there.gripper.position, memory, there.holds)
        new = configuration_at(system, strains)
        shift = there.gripper.position - where.position
        if sweeps_through(system.scene, system.lengths, old.strains, old.rotations,
                          old.positions - shift, new.rotations, new.positions):
            step *= 0.5
            if step < _SMALLEST or left == 0:
                return Predictor(goal.gripper, strains, past, False)
            continue
        done, where, left = target, there.gripper, max(left - 1, 0)
        step = min(2 * step, 1.0 / parts)
        if done == 1.0:
            break  # what is left is the step itself
        found = minimum(mesh, system, where, new.q, memory, _RELAXING)
        for _ in range(_AGAIN):  # what stays behind is deeper in an obstacle in the next part
            if found.violation <= _DEPTH * mesh.s[-1]:
                break
            found = minimum(mesh, system, where, found.state.q, memory, _RELAXING)
        strains = found.state.strains
        if mesh.surroundings.pinned:  # it has turned
            where, first, last = (Pose.from_rotation(pose.position, found.system.base)
                                  for pose in (where, begin.gripper, goal.gripper))
            begin, goal = begin._replace(gripper=first), goal._replace(gripper=last)
        memory = underway(mesh, found, where, memory)
    return Predictor(goal.gripper, strains, changed(past, hold=memory.hold))


# ------------------------------------------------------------------------------------------------
# One equilibrium: a search, and the Shape of what it finds.


_ELSEWHERE = 0.1       # of the length: a shape in contact that moves so far is another one
_GRIP_KEPT = 1e-9      # of the length: by how much a grip may be missed at the end
_SLACK = 1e-3          # of the slack: the same, as the DLO pulls the tighter the less there is
_GRIP_EXACT = 1e-4     # of the slack: what is aimed at
_LEAST_SLACK = 1e-10   # of the length: slack that is looked at
_IN_VAIN = 30          # Newton steps towards what is out of reach
_IN_PARTS = 300        # the same, of what lies on something and may be sought in smaller parts


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


def reach_of(mesh: Discretization, tautest: Iterable[Span]) -> float:
    """Return by how much grips may be missed that have these Spans, m; -1: one is out of reach."""
    reach = _GRIP_KEPT * mesh.s.item(-1)
    for span in tautest:
        if not span.reaches(mesh.loaded):
            return -1.0
        if mesh.loaded:
            reach = min(reach, _SLACK * (span.length - span.distance))
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
            contacts = contacts_of(mesh.s, end.contacts, gripper.position)
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
        estimated, mesh, gripper, end.strains, end.positions, before, holds, culled),
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
              before: Memory, holds: Holds, culled: bool) -> float:
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.
    """
    if culled and not holds:
        there = solution(mesh.finer, gripper, np.repeat(strains, 2, axis=0), None, (), _HALVED,
                         True).positions
        return _error_from(mesh, positions, there)
    finer = halved(mesh, gripper, strains, before, holds, culled)
    return np.inf if finer is None else moved_from(mesh, positions, finer, culled)


def halved(mesh: Discretization, gripper: Pose, strains: Floats, before: Memory,
           holds: Holds, culled: bool) -> Shape | None:
    """Return the equilibrium beside strains (N, 3) with every element halved; None without one."""
    finer, start = mesh.finer, np.repeat(strains, 2, axis=0)
    past, shape = finer.past(before), None
    if holds:
        shape = held_nearby(finer, gripper, start, past, holds, culled)
    if shape is None:
        shape = equilibrium(finer, gripper, start, past, holds, culled=culled)
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


# ------------------------------------------------------------------------------------------------
# The energy balance of a step: what its grips gave, and what the DLO took, stored and lost.


# What a step may seem to lose beyond what it was given. Of the elastic energy: two meshes differ
# by about as much. Times the work: on the way the force may be larger than at both its ends, as
# where a DLO buckles. In 80 random scenes of wires that yield on mandrels, in two grips or
# under loads no step of a shape that was found is refused.
_ROUGH, _MORE_WORK = 0.05, 2.0


def overspent(previous: Shape, shape: Shape) -> float:
    """Return by how much, in J, plastic deformation takes more in a step than it was given; else 0.

    It was given the work of the grips, and the energy that is not there any more. Energies of
    another DLO, or of one under other forces, say nothing of that: then it is 0, as it is where
    the energy before is not known (nan).
    """
    if not _compare(previous, shape):
        return 0.0
    lost = shape.dissipated - previous.dissipated
    work, spread = work_of_grips(previous, shape)
    given = previous.energy - shape.energy + max(work, 0.0) * _MORE_WORK + min(work, 0.0)
    energy = max(previous.elastic_energy, shape.elastic_energy)
    excess = lost - given - _MORE_WORK * spread - _ROUGH * energy
    return excess if excess > 0.0 else 0.0


def _compare(previous: Shape, shape: Shape) -> bool:
    """Whether energies of two Shapes are of one potential, as far as their meshes are known.

    Obstacles are none of it: what touches does no work.
    """
    one, other = previous.state.mesh, shape.state.mesh
    if one is None or other is None or one.surroundings is other.surroundings:
        return True
    return replace(one.surroundings, obstacles=()) == replace(other.surroundings, obstacles=())


def work_of_grips(previous: Shape, shape: Shape) -> tuple[float, float]:
    """Return the work in J of the grips on a straight way, forces changing evenly, and its spread.

    It is larger or smaller by up to the spread if all of the change is at one end of the way.
    """
    one, other = previous.gripper, shape.gripper
    work, spread = _work(one.rotation, other.rotation, one.position, other.position,
                         previous.gripper_wrench, shape.gripper_wrench)
    for hold, after in zip(shape.holds, shape.wrenches, strict=True):
        before, place = NO_WRENCH, hold.s
        held = counterpart(hold, shape.holds, previous.holds)
        for known, wrench in zip(previous.holds, previous.wrenches, strict=True):
            if known is held:
                before, place = wrench, known.s  # of a ring another place was in it
        turned, turned_after, at, at_after = (
            previous.frames[-1], shape.frames[-1], previous.positions[-1], shape.positions[-1])
        if hold.s is not None:
            assert place is not None
            (turned, at), (turned_after, at_after) = (
                frame_inside(previous, place), frame_inside(shape, hold.s))
        more, wider = _work(turned, turned_after, at, at_after, before, after)
        work, spread = work + more, spread + wider
    return work, spread


def frame_inside(shape: Shape, s: float) -> tuple[Floats, Floats]:
    """Return axes (3, 3) and position (3,) of a Shape at `s` (m), read-only as those of nodes."""
    rotation, position = shape.frame_at(s)
    return read_only(rotation), read_only(position)


@kernel
def _work(one: Floats, other: Floats, begin: Floats, end: Floats, before: Floats,
          after: Floats) -> tuple[float, float]:
    """Return the work of one grip in J and its spread, of arrays.

    Rotations, positions and wrenches on the DLO are those before and after the step. What does not
    hold after it has let go, which is no work.
    """
    turn = rotation_vector(times_transposed(matrix(other), matrix(one)))
    work = spread = 0.0
    for i in range(3):
        shift = end[i] - begin[i]
        work += (before[i] + after[i]) * shift + (before[3 + i] + after[3 + i]) * turn[i]
        spread += abs((after[i] - before[i]) * shift)
        spread += abs((after[3 + i] - before[3 + i]) * turn[i])
    return 0.5 * work, 0.5 * spread
