# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The way of the grips to where the search for a shape begins.

The grips go straight from where they are in the shape before, in small parts in which the DLO gives
way; around obstacles where that can be. A DLO that is set down in its grips is led into them from
its stress-free shape, first without obstacles, among which it then grows to its thickness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from dlo_planner.direct.coarse import coarsely
from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.direct.equilibrium import equilibrium, underway
from dlo_planner.direct.grips import Grips, grips_at
from dlo_planner.direct.search import (
    Search,
    hinge_unknowns,
    minimum,
    own_unknowns,
    turn_of,
    with_hinge,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.gap import penetration
from dlo_planner.energy.potential import configuration_at
from dlo_planner.geometry.so3 import turns_between
from dlo_planner.minimize.newton import follow_homotopy
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import FarEnd, Hold, Holds, posed
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import changed
from dlo_planner.model.varying import scaled
from dlo_planner.progress import uninterrupted

_TURN, _SHIFT = 0.3, 0.08  # rad, part of the length: how far a grip goes in one part
_FINER = 4   # times the parts of a way that is not found in larger ones
_FINEST = 3  # times they are made smaller
# steps in a part: so small that a strip that is turned by up to a turn while two clamps press it
# together buckles in its first one, in 8 of 8; of parts it does in 1, of halves in 7
_STEPS = 4
_RELAXING = Search(12, False, 1e-5)  # between two parts of a motion
_AGAIN = 8            # times that what is not out of obstacles yet is sought again there
_SMALLEST = 2.0**-14  # part of the motion: what cannot be moved by it is blocked
# Than the longest parts would need: what takes more has got stuck. Of 3,900 clear ways among
# obstacles none took more than 130: a third would refuse some of them, and three times as many only
# take three times as long to refuse what is stuck
_MORE_SEARCHES = 250
_SOFT = 0.1           # of the bending stiffness: torsion below it is soft
_DEPTH = 1e-5         # of the length: depth in obstacles that is allowed while it grows
_LEFT = 1e-4          # residual at which a step of growth ends; ten times that is still accepted
_GROWING = Search(100, False, _DEPTH, _LEFT)
_LEAST_GROWTH = 2.0**-10  # of the growth: if smaller steps fail, the growth ends there


# of (mesh, gripper, holds): the Shape in which a DLO settles that is set down there
Settled: TypeAlias = Callable[[Discretization, Pose, Holds], Shape]


class Predictor(NamedTuple):
    """Where a search begins: gripper, strains (N, 3), the past; and whether the way is clear."""

    gripper: Pose
    strains: Floats
    memory: Memory
    clear: bool = True


def moved(mesh: Discretization, previous: Shape, strains: Floats, goal: Grips, memory: Memory,
          culled: bool) -> Predictor:
    """Return where the search begins for a DLO whose grips go straight to a `goal`.

    They go from where they are in `previous`, whose `strains` (N, 3) the DLO has; it gives way.
    Where an obstacle is between here and there, the motion is made in smaller parts.
    """
    amid = mesh.obstructed and not culled
    if not (goal.holds or amid):
        return Predictor(goal.gripper, strains, memory)
    begin = grips_at(previous, goal.holds)
    parts = _parts_between(begin, goal, float(mesh.s[-1]))
    if parts == 0:
        return Predictor(goal.gripper, strains, memory)
    strains = np.array(strains)  # those of a Shape are read-only, another type for kernels
    if amid:
        return _advance_in_parts(mesh, strains, begin, goal, memory, parts)
    return _follow_way(mesh, strains, begin, goal, memory, parts, culled)


def set_down(mesh: Discretization, strains: Floats, goal: Grips, memory: Memory,
             settled: Settled) -> Predictor:
    """Return where the search begins for a DLO that is set down in its grips.

    It comes from `strains` (N, 3) that it has in its gripper alone: first without obstacles, then
    it grows to its thickness among them; torsion that is soft is as stiff as bending until then.
    """
    (gripper, holds), amid = goal, mesh.obstructed
    strains = np.array(strains)  # those of a Shape are read-only, another type for kernels
    begin = Grips(gripper, _places_in(mesh, gripper, strains, holds))
    parts = _parts_between(begin, goal, float(mesh.s[-1]))
    if parts == 0:
        return Predictor(gripper, strains, memory)
    firm = _with_firm_torsion(mesh)
    bare = firm.within(replace(firm.surroundings, obstacles=())) if amid else firm
    past = bare.past(memory)

    def led(coarse: Discretization) -> Predictor:
        return _follow_way(coarse, mesh.restriction @ strains, begin, goal, coarse.start, parts,
                           False, True)

    gripper, strains, past, _ = (
        _taut_shape(bare, gripper, holds, past, settled)
        or coarsely(bare, gripper, holds, past, parts, led)
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
                parts: int, culled: bool, whole: bool = False) -> Predictor:
    """Return where the search begins near the end of a straight way of all grips together.

    What is left is the last part, unless it goes the `whole` way. Where the DLO does not follow
    the way is left there; then a whole one is not clear.
    """
    holds, first, last = goal.holds, begin.gripper, goal.gripper
    done, arrived = 0.0, False
    for finer in range(_FINEST):
        count = int(np.ceil(parts * _FINER**finer * (1.0 - done) - 1e-9))
        parts_gone = count if whole else count - 1
        if parts_gone == 0:
            break
        shares = done + (1.0 - done) * np.arange(1, parts_gone + 1) / count
        gripped, bases = _way(first, last, shares)
        held_at, axes = (np.empty((shares.size, len(holds), 3)),
                         np.empty((shares.size, len(holds), 3, 3)))
        there: Holds = ()
        for k, (one, other) in enumerate(zip(begin.holds, holds, strict=True)):
            held_at[:, k], axes[:, k] = _way(one.pose, other.pose, shares)
            there += posed(other, Pose.from_rotation(held_at[0, k], axes[0, k])),
        system = mesh.system(bases[0], gripped[0], memory, there, culled=culled)
        displaced = (mesh.held if culled else mesh.full).needs.displaced
        targets, rows = held_at - gripped[:, None], mesh.grip_rows(holds, axes)
        q = mesh.unknowns(strains)
        if mesh.surroundings.pinned:
            bases[:] = system.base
            q, forces, gone = uninterrupted(follow_homotopy(
                with_hinge(system), displaced, hinge_unknowns(system, q), bases, targets, axes,
                rows))
            first, last = (Pose.from_rotation(pose.position, system.base @ turn_of(system, q))
                           for pose in (first, last))
            q = own_unknowns(system, q)
        else:
            q, forces, gone = uninterrupted(follow_homotopy(
                system, displaced, q, bases, targets, axes, rows))
        strains = mesh.strains_of(q)
        memory = changed(memory, hold=forces)
        arrived = gone == len(shares)
        if arrived:
            break
        done = shares[gone - 1] if gone else done
    # only a whole way has to arrive; the others begin a search
    return Predictor(last, strains, memory, arrived or not whole)


def small_steps(begin: Grips, goal: Grips, length: float) -> list[Grips]:
    """Return Grips on a straight way to a `goal`, and that, of a DLO of a `length` (m)."""
    count = max(1, _STEPS * _parts_between(begin, goal, length))
    return [*(begin.towards(goal, k / count) for k in range(1, count)), goal]


def _way(one: Pose, other: Pose, shares: Floats) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) at shares (n,) of a straight way."""
    return (one.position + shares[:, None] * (other.position - one.position),
            turns_between(one.rotation, other.rotation, shares))


def _taut_shape(mesh: Discretization, gripper: Pose, holds: Holds, memory: Memory,
                settled: Settled) -> tuple[Pose, Floats, Memory, bool] | None:
    """Return what a DLO of which a part is nearly taut begins with; None where none is, or known.

    From the stress-free shape a search would have to find the tension, beyond all bounds.
    """
    from dlo_planner.direct.taut import first_shape, is_taut  # noqa: PLC0415  (SciPy: a free DLO needs none)
    if len(holds) == 1 and holds[0].s is None:
        return first_shape(mesh, gripper, holds[0], memory)
    if not is_taut(mesh, gripper, holds):
        return None
    return by_parts(mesh, gripper, holds, memory, settled)


def by_parts(mesh: Discretization, gripper: Pose, holds: Holds, memory: Memory,
             settled: Settled) -> Predictor | None:
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
        shape = settled(part, begin, () if end is None else (end,))
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
    done, step, where, past, left = 0.0, 1.0 / parts, begin.gripper, memory, parts + _MORE_SEARCHES
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
            if step < _SMALLEST or left <= 0:
                return Predictor(goal.gripper, strains, past, False)
            continue
        done, where = target, there.gripper
        step = min(2 * step, 1.0 / parts)
        if done == 1.0:
            break  # what is left is the step itself
        found = minimum(mesh, system, where, new.q, memory, _RELAXING)
        left -= 1
        for _ in range(_AGAIN):  # what stays behind is deeper in an obstacle in the next part
            if found.violation <= _DEPTH * mesh.s[-1]:
                break
            found = minimum(mesh, system, where, found.state.q, memory, _RELAXING)
            left -= 1
        strains = found.state.strains
        if mesh.surroundings.pinned:  # it has turned
            where, first, last = (Pose.from_rotation(pose.position, found.system.base)
                                  for pose in (where, begin.gripper, goal.gripper))
            begin, goal = begin._replace(gripper=first), goal._replace(gripper=last)
        memory = underway(mesh, found, where, memory)
    return Predictor(goal.gripper, strains, changed(past, hold=memory.hold))
