# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One step in one compiled call, from a Problem to all that a Shape is made of; and many in a loop.

Python between kernels would take as long as the step itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dlo_planner.energy.contact import ContactSet, trial_traction
from dlo_planner.energy.gap import penetration_of_point
from dlo_planner.energy.grip import constraint_violation, put_wrenches
from dlo_planner.energy.plastic import add_plastic, return_map
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import (
    Configuration,
    Problem,
    is_to_end,
    new_configuration,
    with_gripper,
)
from dlo_planner.energy.scene import translated
from dlo_planner.energy.strands import add_moments_behind
from dlo_planner.energy.terms import KKTBorder, may_act, potential, stored
from dlo_planner.geometry.basis import truncation_error
from dlo_planner.geometry.kinematics import folded, point_inside
from dlo_planner.geometry.record import Record, copy, replaced
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_solver import COARSER, predictor_corrector, solve_contact
from dlo_planner.minimize.contact_table import Touching, touching, with_contacts
from dlo_planner.minimize.convergence import is_stationary
from dlo_planner.minimize.newton import (
    HELD_NEUTRAL,
    NEUTRAL,
    is_held,
    minimize,
    new_workspace,
    next_to,
    thorough,
    within,
)
from dlo_planner.minimize.reach import (
    among_all,
    bodies_in_reach,
    bodies_near,
    forces_among_all,
    points_on,
    stays_within,
    with_bodies,
)
from dlo_planner.model.arrays import Floats, Ints

_WAYS = 1.5        # times the gripper's motion: by so much nodes of a DLO that bears mostly move
_ONE_PLACE = 1e-7  # of the length: contacts with one body that are nearer are one


class Solution(NamedTuple):
    """All that a Shape and its Memory take from a step."""

    strains: Floats
    frames: Floats
    positions: Floats  # (N + 1, 3), world, m
    wrench: Floats     # (6,) of the gripper on the DLO,
    wrenches: Floats | None  # (A, 6) and of what else holds it; None, as what follows,
    hold: Floats | None      # (K,) N, where nothing
    plastic: Floats | None   # does that: an array that goes to Python takes it a microsecond
    forces: Any        # `forces_after`
    contacts: Any      # `contact_rows`
    elastic: float     # J, stored
    energy: float      # J
    lost: float        # J, to plastic deformation in the step
    missed: float      # m, by what is held
    inside: float      # m, how deep the gripper holds the axis in an obstacle
    stationary: bool   # the gradient vanishes, and no element is folded
    residual: float
    stability: float
    iterations: int
    kicks: int
    violation: float   # m
    acts: bool         # whether something would have, without which it was found
    strands: Any = None  # Strands: pairs of elements that bear on each other


@kernel
def placed(system: Problem, base: Floats, origin: Floats, hold: Any, spring: float,
           plastic: Floats, node: Floats, point_of: Ints, points: Floats) -> Any:
    """Return the same Problem in a gripper and HoldRows `hold`, with what a Memory has left."""
    effects, needs = system.effects, system.needs
    held = replaced(
        system, 'base', base, 'origin', origin,
        'effects', replaced(effects, 'plastic', with_set(effects.plastic, plastic), 'hold', hold),
        'needs', replaced(needs, 'displaced', _displaced(needs.displaced, hold),
                          'border', _with_rows(needs.border, hold)))
    return _touching(effects.contact, held, origin, spring, node, point_of, points)


@kernel
def with_set(plastic: Any, strain: Floats) -> Any:
    """Return a PlasticSection with another plastic strain; None for None."""
    if plastic is None:
        return plastic
    return replaced(plastic, 'set', strain.copy())


@kernel
def _displaced(displaced: Any, hold: Any) -> Any:
    """Whether displacements matter: by the springs of holds, too; None for None."""
    if displaced is None or hold is None:
        return displaced
    return displaced or hold.multiplier.size > 0 and hold.stiffness > 0.0


@kernel
def _with_rows(border: Any, hold: Any) -> Any:
    """Return an empty KKTBorder of as many rows as are held; None for None."""
    if border is None or hold is None:
        return border
    none = np.empty((hold.multiplier.size, 0, 3))
    return KKTBorder(none, none, np.empty((0, 0)), np.zeros(1))


@kernel
def _touching(contact: Any, system: Problem, origin: Floats, spring: float, node: Floats,
              point_of: Ints, points: Floats) -> Any:
    """Return the Problem with contacts that are left, in world axes; itself without obstacles."""
    if contact is None:
        return system
    contacts = ContactSet(
        spring, node.copy(), point_of[:, 0].copy(), point_of[:, 1].copy(), points[:, 0].copy(),
        points[:, 1].copy(), points[:, 2:5] - origin, points[:, 5:8].copy(),
        points[:, 8:11].copy(), spring)
    return with_contacts(system, contacts, translated(contact.scene, origin))


@kernel
def solve_step(system: Problem, watched: Any, base: Floats, origin: Floats, strains: Floats,
               places: Floats, tangents: Floats, frames: Floats, turned_from: Floats, nodes: Ints,
               most: float, tolerance: float, exact: float, steps: int, check: bool,
               near: bool) -> Any:
    """Return the fields of the Solution of one step. All arrays are read-only, but for `nodes`.

    Args:
        watched: Problem with all that may act, if it is to be looked at whether something does,
            else None; base, origin: (3, 3), (3,) of the gripper, m
        strains: (N, 3) where the search begins, 1/m
        places, tangents: (N + 1, 3) of the nodes before, m, world; (0, 3) if not known
        frames, turned_from: (N + 1, 3, 3), (3, 3) of nodes and gripper before, from which no node
            of `nodes` (k,) is to turn by more than `most`, rad, in the gripper; zeros if not known
        tolerance, exact, steps: largest residual and violation of constraints at the end, m, and
            Newton steps until then at most
        check: whether the smallest eigenvalue is found, and a saddle left
        near: whether only what is near is sought; the residual is infinite where it is not
    """
    turned = with_gripper(system, base.copy(), origin.copy())
    work = new_workspace(turned)
    unknowns_of(turned, strains.copy(), work.start)
    if near:
        options = next_to(tolerance, exact, check, is_held(turned))
    else:
        options = within(thorough(tolerance, exact, steps, check, steps < 0), frames, turned_from,
                         base, nodes, most)
    state, residual, stability, iterations, kicks, loaded, violation = _minimum(
        turned.effects.contact, turned, options, work, places, tangents, turned_from)
    end = outcome(loaded, state, turned.origin, residual, 0.0, True)
    acts = residual < np.inf and _acts(watched, turned, end[0], end[2], places)
    return _without_empty(turned.effects.hold, end) + (
        residual, stability, iterations, kicks, violation, acts)


@kernel
def _without_empty(hold: Any, end: Any) -> Any:
    """Return an `outcome` without the arrays of what a DLO without holds and set has not."""
    if hold is None:
        return end[:4] + (None, None, None) + end[7:]
    return end


@kernel
def placed_step(system: Problem, base: Floats, origin: Floats, hold: Any, spring: float,
                plastic: Floats, node: Floats, point_of: Ints, points: Floats, watched: Any,
                strains: Floats, places: Floats, tangents: Floats, frames: Floats,
                turned_from: Floats, nodes: Ints, most: float, tolerance: float, exact: float,
                steps: int, check: bool, near: bool) -> Any:
    """Return what `solve_step` does of what is `placed`: a Problem takes long to go to Python."""
    there = placed(system, base.copy(), origin.copy(), hold, spring, plastic, node, point_of,
                   points)
    return solve_step(there, watched, base, origin, strains, places, tangents, frames, turned_from,
                      nodes, most, tolerance, exact, steps, check, near)


@kernel
def follow_step(system: Problem, base: Floats, origin: Floats, plastic: Floats, node: Floats,
                point_of: Ints, points: Floats, places: Floats, tangents: Floats,
                turned_from: Floats, moved_from: Floats, strains: Floats, tolerance: float,
                exact: float) -> Any:
    """Return what `solve_step` does, of a DLO that goes on bearing where it does as it is moved.

    What a Memory has left stands as in `placed`; `turned_from`, `moved_from` (3, 3), (3,) are the
    gripper before. The residual is infinite where something is in the way, or points that bear do
    not go on bearing.
    """
    there = placed(system, base.copy(), origin.copy(), system.effects.hold,
                   system.effects.contact.contacts.stiffness, plastic, node, point_of, points)
    before = _seen_from(origin, places, tangents)
    bodies = bodies_in_reach(there, before)
    length, turned = np.sum(there.lengths), 0.0
    for i in range(3):
        for j in range(3):
            turned += (base[i, j] - turned_from[i, j]) ** 2
    margin = _WAYS * (np.sqrt(np.sum((origin - moved_from) ** 2)) + np.sqrt(0.5 * turned) * length)
    near = bodies_near(there, before, bodies, margin)
    if near.size == 0:
        near = bodies
    while True:
        some = near.size < there.effects.contact.scene.kind.size
        rubbing = points[points_on(there, near)][:, 11:].copy()
        (goes_on, state, residual, stability, iterations, kicks, loaded,
         violation) = predictor_corrector(
            with_bodies(there, near) if some else there, turned_from.copy(), rubbing,
            strains.copy(), origin - moved_from, COARSER * tolerance, exact, before)
        if not goes_on or near.size == bodies.size or stays_within(margin, before,
                                                                   state.positions):
            break
        near = bodies  # it may have come to one of the others
    if not goes_on:
        residual, loaded, state = np.inf, there, new_configuration(there)
        evaluate(there, state)
    end = outcome(loaded, state, loaded.origin, residual, 0.0, True)
    if goes_on and some:  # no other one is touched, and none has the gripper in it
        table = touching(loaded.effects.contact.scene, loaded.effects.contact.contacts,
                         loaded.lengths, state)
        forces = forces_among_all(forces_after(loaded, state, table, loaded.origin, True), near,
                                  there.effects.contact.scene.kind.size)
        end = end[:7] + (forces,) + end[8:]
    return end + (residual, stability, iterations, kicks, violation, True)


@kernel
def _minimum(contact, system, options, work, places, tangents, turned_from):
    """Return what `solve_contact` does, of a DLO with obstacles or without."""
    if contact is None:
        return _unobstructed(system, options, work)
    if contact.scene.kind.size == 0:  # nor are there tangents then
        return _unobstructed(system, options, work)
    before = _seen_from(system.origin, places, tangents)
    bodies = bodies_in_reach(system, before)
    if bodies.size == 0:
        end = _unobstructed(with_bodies(system, bodies), options, work)
        return end[:5] + (among_all(system, end[5], bodies), end[6])
    # read-only arrays are another type: all that has to do with contacts would be compiled again
    return _minimum_among(bodies, system, work.start, options.gtol, options.ctol, options.maxiter,
                          options.check, before, turned_from.copy(), options.max_rotation)


@kernel
def _unobstructed(system, options, work):
    """Return what `solve_contact` does, where there are no obstacles."""
    state, residual, stability, iterations, kicks, violation = minimize(system, work.start, options,
                                                                        work)
    return state, residual, stability, iterations, kicks, system, violation


@kernel
def obstructed_minimum(system, q, tolerance, exact, steps, check, places, tangents):
    """Return what `solve_contact` does of a DLO whose nodes were at `places`, world, before."""
    before = _seen_from(system.origin, places, tangents)
    return _minimum_among(bodies_in_reach(system, before), system, q, tolerance, exact, steps,
                          check, before, np.zeros((3, 3)), np.inf)


@kernel
def _minimum_among(bodies, system, q, tolerance, exact, steps, check, before, turned_from,
                   farthest):
    """Return what `solve_contact` does, of a DLO that may meet some bodies (m,) alone."""
    some = 0 < bodies.size < system.effects.contact.scene.kind.size
    end = solve_contact(with_bodies(system, bodies) if some else system, q, COARSER * tolerance,
                        exact, steps, check, before, turned_from, farthest)
    return end[:5] + (among_all(system, end[5], bodies) if some else end[5], end[6])


@kernel
def _seen_from(origin, places, tangents):
    """Return (N + 1, 6) places of nodes from a gripper at `origin` (3,), and tangents there."""
    before = np.empty((places.shape[0], 6))
    for k in range(places.shape[0]):
        for i in range(3):
            before[k, i] = places[k, i] - origin[i]
            before[k, 3 + i] = tangents[k, i]
    return before


@kernel
def _acts(watched, system, strains, positions, places):
    """Whether something acts at the end of a step or on the straight way to it, see `may_act`.

    The way is from `places`, or from the stress-free shape in the gripper.
    """
    if watched is None:
        return False
    before = places.copy()
    if places.shape[0] == 0:
        natural = new_configuration(system)
        evaluate(system, natural)
        before = natural.positions
        for k in range(before.shape[0]):
            for i in range(3):
                before[k, i] += system.origin[i]
    return may_act(watched.effects, watched, strains, positions, before)


@kernel
def outcome(system: Problem, state: Configuration, origin: Floats, residual: float,
            rounding: float, ended: bool) -> Any:
    """Return the fields of a Solution up to `stationary`; residual, rounding: `is_stationary`.

    Until a step has `ended`, friction counts from where it began.
    """
    effects, positions, wrench = system.effects, np.empty_like(state.positions), np.empty(6)
    elastic, energy = outputs(system, state, origin, positions, wrench)
    hold, wrenches, missed = _holds_after(effects.hold, state)
    add_moments_behind(effects.strands, system, state, wrench, wrenches)
    plastic, lost, springs = _set_after(effects.plastic, system, state.strains)
    forces, contacts, inside = _contacts_after(effects.contact, system, state, origin, ended)
    # copies: what a Shape has is no array of a search
    return (state.strains.copy(), state.rotations.copy(), positions, wrench, wrenches, hold,
            plastic, forces, contacts, elastic + springs, energy + springs, lost, missed, inside,
            is_stationary(system, state, residual, rounding)
            and not folded(system.lengths, state.strains, system.natural))


@kernel
def is_equilibrium(stationary: bool, stability: float, bound: bool, violation: float, kept: float,
                   missed: float, reach: float) -> bool:
    """Whether a minimum is a stable or neutral equilibrium that keeps all constraints.

    `bound`: whether grips or contacts may bind it, which tells its stability less exactly; `kept`,
    `reach`: by how much constraints may be violated, and what is held be missed, m.
    """
    return (stationary and stability > -(HELD_NEUTRAL if bound else NEUTRAL)
            and violation <= kept and missed <= reach)


@kernel
def outputs(system, state, origin, positions, wrench):
    """Fill positions (N + 1, 3), world, and the gripper's wrench (6,) on the DLO.

    Returns elastic and all energy, J, but for springs that yield.
    """
    for k in range(positions.shape[0]):
        for i in range(3):
            positions[k, i] = origin[i] + state.positions[k, i]
    for i in range(3):
        wrench[i], wrench[3 + i] = state.base_force[i], state.base_moment[i]
    elastic = stored(system.effects, system, state.strains)
    return elastic, elastic + potential(system.effects, system, positions)


@kernel
def _holds_after(hold: Any, state: Configuration) -> Any:
    """Return the forces (K,) of holds, their wrenches (A, 6), their miss in m."""
    if hold is None:
        return np.zeros(0), np.empty((0, 6)), 0.0
    # what is returned is nobody else's
    forces, wrenches = hold.multiplier.copy(), np.empty((hold.node.size, 6))
    if forces.size == 0:
        return forces, wrenches, 0.0
    put_wrenches(hold, state, wrenches)
    return forces, wrenches, constraint_violation(hold, state)


@kernel
def _set_after(plastic: Any, system: Problem, strains: Floats) -> Any:
    """Return the plastic strain after a step, the energy lost in it and that in springs, J."""
    if plastic is None:
        return np.zeros((system.lengths.size, 0)), 0.0, 0.0
    if plastic.share.shape[0] == 0:
        return plastic.set.copy(), 0.0, 0.0
    new, lost = return_map(system.lengths, strains, system.natural, plastic)
    return new, lost, add_plastic(system.lengths, strains, system.natural,
                                  replaced(plastic, 'set', new), np.zeros(strains.shape))


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
    if contact.scene.kind.size:
        inside = penetration_of_point(translated(contact.scene, np.zeros(3)), origin)
    table = touching(contact.scene, contact.contacts, system.lengths, state)
    return (forces_after(system, state, table, origin, ended), contact_rows(system, state, table),
            max(0.0, inside))


@kernel
def contact_rows(system: Problem, state: Configuration, table: Touching) -> Any:
    """Return of A contacts (A, 2) obstacle and element; (A, 15) what else there is of them.

    That is m along the element, place, normal, force, friction, gap, arm. Places are relative to
    the gripper; friction is that on the DLO; the arm goes from its axis to what bears beside it, m.
    A node and a point that has rolled to it are one.
    """
    scene, lengths = system.effects.contact.scene, system.lengths
    count = table.gap.size
    along, places, friction = np.empty(count), np.empty((count, 3)), np.zeros((count, 3))
    rotation = np.empty((3, 3))
    for a in range(count):
        e = table.element[a]
        along[a] = table.fraction[a] * lengths[e]
        point_inside(lengths, state.strains, state.rotations, state.positions, e,
                     table.fraction[a], rotation, places[a])
        if table.rubbing[a] >= 0:
            friction[a] -= state.attached.force[table.rubbing[a]]
    kept, force, one_place = (np.ones(count, dtype=np.bool_), table.force.copy(),
                              _ONE_PLACE * np.sum(lengths))
    for a in range(count):
        for b in range(a):
            if not (kept[b] and table.obstacle[a] == table.obstacle[b]):
                continue
            square = 0.0
            for i in range(3):
                square += (places[a, i] - places[b, i]) ** 2
            if square < one_place**2:
                one, other = (a, b) if force[a] > force[b] else (b, a)
                force[one] += force[other]
                friction[one] += friction[other]
                kept[other] = False
                if other == a:
                    break
    of, rows, found = np.empty((count, 2), dtype=np.int64), np.empty((count, 15)), 0
    for a in range(count):
        if not kept[a]:
            continue
        of[found, 0], of[found, 1] = scene.source[table.obstacle[a]], table.element[a]
        row = rows[found]
        row[0], row[7], row[11] = along[a], force[a], table.gap[a]
        for i in range(3):
            row[1 + i], row[4 + i] = places[a, i], table.normal[a, i]
            row[8 + i], row[12 + i] = friction[a, i], table.arm[a, i]
        found += 1
    return of[:found], rows[:found]


@kernel
def forces_after(system: Problem, state: Configuration, table: Touching, origin: Floats,
                 ended: bool) -> Any:
    """Return the forces on nodes (M, N + 1), N, and points inside elements and of friction.

    These are (C, 2) and (C, 14) as of `ContactPoints`. What does not bear any more leaves none.
    What slid sticks from now on to where it has come to, if the step has `ended`.
    """
    contacts = system.effects.contact.contacts
    node, multiplier = np.zeros_like(contacts.node), contacts.multiplier.copy()
    for c in range(multiplier.size):
        if contacts.obstacle[c] >= 0:
            multiplier[c] = 0.0
    for a in range(table.gap.size):
        # below zero a multiplier holds back the spring of a point that does not bear
        o, k, c = table.obstacle[a], table.element[a] + 1, table.inside[a]
        if c < 0:
            node[o, k] = max(contacts.node[o, k], 0.0)
        else:
            multiplier[c] = max(contacts.multiplier[c], 0.0)
    count = contacts.element.size
    of, points = np.empty((count, 2), dtype=np.int64), np.empty((count, 14))
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for c in range(count):
        of[c, 0], of[c, 1] = contacts.element[c], contacts.obstacle[c]
        point = points[c]
        point[0], point[1] = multiplier[c], contacts.fraction[c]
        for i in range(3):
            point[2 + i], point[5 + i] = contacts.anchor[c, i] + origin[i], contacts.normal[c, i]
            point[8 + i], point[11 + i] = contacts.shear[c, i], 0.0
        if contacts.obstacle[c] >= 0:
            continue
        for i in range(3):
            point[8 + i] = state.attached.force[c, i]
        if not ended:
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        sticks = trial_traction(contacts, c, x, trial) <= contacts.multiplier[c]
        out = 0.0
        for i in range(3):
            out += (x[i] - contacts.anchor[c, i]) * contacts.normal[c, i]
        for i in range(3):
            away = x[i] - contacts.anchor[c, i]
            point[11 + i] = out * contacts.normal[c, i] if sticks else away
            point[2 + i] += point[11 + i]
    return node, of, points


# ------------------------------------------------------------------------------------------------
# Many DLOs that hang freely: a third of the time of such a step would be Python's.


class RodTable(Record):
    """What differs between DLOs of as many elements and terms; r rods, u different lengths."""

    mesh: Ints  # (r,) which of the u meshes each rod has
    lengths: Floats  # (u, N) of the elements, m
    basis: Floats  # (u, 3, N, N_c) orthonormal; (u, 3, 0, 0): local
    natural: Floats  # (r, N, 3) as of a Problem, like what follows
    stiffness: Floats  # (r, N, 3) N m^2
    scale: Floats  # (r, N, 3) of the unknowns
    pull: Floats  # (r, N + 1, 3) derivative of the dead loads' potential by the node positions, N


class FreeShapes(Record):
    """What is found of n DLOs, filled by `solve_free`."""

    strains: Floats  # (n, N, 3) 1/m
    rotations: Floats  # (n, N + 1, 3, 3)
    positions: Floats  # (n, N + 1, 3) m
    wrenches: Floats  # (n, 6)
    energies: Floats  # (n, 2) elastic and all, J
    proofs: Floats  # (n, 3) residual, stability, `truncation_error`
    iterations: Ints  # (n,)


@kernel
def solve_free(system: Problem, rods: RodTable, rod_of: Ints, bases: Floats, origins: Floats,
               tolerance: float, max_iterations: int, found: FreeShapes) -> None:
    """Fill the equilibria that DLOs which hang freely fall into from their natural shapes.

    Args:
        system: Problem; its lengths, natural, stiffness, scale, basis and pull are written over
        rod_of: (n,) which of the rods each DLO is; bases, origins: (n, 3, 3), (n, 3) of grippers, m
    """
    mesh = rod = -1
    work = new_workspace(system)
    options = thorough(tolerance, 0.0, max_iterations, tolerance > 0.0, tolerance < 0.0)
    turned = with_gripper(system, np.empty((3, 3)), np.empty(3))
    worked = np.zeros(1)
    for k in range(rod_of.size):
        if is_to_end(worked, system, 4):
            return
        if rod_of[k] != rod:
            rod = rod_of[k]
            _put_rod(system, rods, rod, rods.mesh[rod] != mesh)
            mesh = rods.mesh[rod]
        copy(bases[k], turned.base)
        for i in range(3):
            turned.origin[i] = origins[k, i]
        unknowns_of(turned, system.natural.copy(), work.start)
        state, residual, stability, found.iterations[k], _, _ = minimize(turned, work.start,
                                                                         options, work)
        elastic, energy = outputs(turned, state, turned.origin, state.positions, found.wrenches[k])
        found.energies[k, 0], found.energies[k, 1] = elastic, energy
        copy(state.strains, found.strains[k])
        copy(state.positions, found.positions[k])
        for node in range(state.rotations.shape[0]):
            copy(state.rotations[node], found.rotations[k, node])
        if folded(system.lengths, state.strains, system.natural):
            residual = np.inf
        found.proofs[k, 0], found.proofs[k, 1] = residual, stability
        found.proofs[k, 2] = truncation_error(system.lengths, state.strains, system.natural,
                                              system.scale, system.basis)


@kernel
def _put_rod(system, rods, rod, other_mesh):
    """Write a rod into the Problem; its mesh, too, if that is another one."""
    u = rods.mesh[rod]
    if other_mesh:
        system.lengths[:] = rods.lengths[u]
        system.basis[:] = rods.basis[u]
    copy(rods.natural[rod], system.natural)
    copy(rods.stiffness[rod], system.stiffness)
    copy(rods.scale[rod], system.scale)
    copy(rods.pull[rod], system.effects.load.pull)
