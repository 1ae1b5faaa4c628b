# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One step of a DLO on one mesh: from the shape before to the next.

Where it goes on bearing on obstacles, or in both its grips, a step is a correction of the shape
before. Else the grips are moved to their places, around obstacles where that can be, and the
minimum is sought from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dlo_planner.direct.ball_joint import hinge_unknowns, own_unknowns, turn_of, with_hinge
from dlo_planner.direct.contact import (
    contacts_in,
    ended,
    forces_left,
    halved,
    left_of,
    standing,
)
from dlo_planner.direct.continuation import between
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.memory import Memory
from dlo_planner.direct.paper import described_equilibrium
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import (
    EXACT,
    KEPT,
    MAX_ITERATIONS,
    TOLERANCE,
    Search,
    Solution,
    Way,
    equilibrium,
    hanging,
    held_nearby,
    shape_from,
    shape_of,
    solve,
)
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.direct.terms import Solved
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.gap import penetration, penetration_of_point
from dlo_planner.energy.potential import configuration_at, evaluate, unknowns_of
from dlo_planner.energy.problem import new_configuration
from dlo_planner.energy.scene import Scene
from dlo_planner.geometry.so3 import partway
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_solver import (
    COARSER,
    follow_contact,
    predictor_corrector,
)
from dlo_planner.minimize.convergence import TOUCHING, as_rounded
from dlo_planner.minimize.newton import HELD_NEUTRAL, follow_homotopy
from dlo_planner.minimize.semismooth import correction
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.supports import FarEnd, held_rows
from dlo_planner.model.value import freeze
from dlo_planner.model.varying import scaled

if TYPE_CHECKING:
    from dlo_planner.energy.problem import Problem
    from dlo_planner.model.arrays import Ints

_TURN, _SHIFT = 0.3, 0.08  # rad, part of the length: how far a grip goes in one part
_FINER = 4   # times the parts of a way that is not found in larger ones
_FINEST = 3  # times they are made smaller


def lead(discretization: Discretization, strains: Floats, grippers: tuple[Pose, Pose],
         far_ends: tuple[FarEnd, FarEnd], history: Memory,
         parts: int) -> tuple[Pose, Floats, Memory]:
    """Return gripper, strains (N, 3) and the past near the end of a straight way of both grips.

    What is left is the last part. Where the DLO does not follow, the way is left there.
    """
    begin, end = grippers
    held, far_end = far_ends
    done = 0.0
    for finer in range(_FINEST):
        count = int(np.ceil(parts * _FINER**finer * (1.0 - done) - 1e-9))
        if count <= 1:
            break
        shares = done + (1.0 - done) * np.arange(1, count) / count
        gripped, bases = _way(begin, end, shares)
        held_at, axes = _way(held.pose, far_end.pose, shares)
        system = discretization.system(bases[0], gripped[0], history,
                                       FarEnd(Pose.from_rotation(held_at[0], axes[0]), held.grip))
        rows = np.array([held_rows(held.grip, one) for one in axes])
        rows[:, :, :3] *= discretization.lever
        q = discretization.unknowns(strains)
        if discretization.surroundings.pinned:
            bases[:] = system.base
            q, gone = follow_homotopy(with_hinge(system), hinge_unknowns(system, q), bases,
                                      held_at - gripped, axes, rows)
            begin, end = (Pose.from_rotation(pose.position, system.base @ turn_of(system, q))
                          for pose in (begin, end))
            q = own_unknowns(system, q)
        else:
            q, gone = follow_homotopy(system, q, bases, held_at - gripped, axes, rows)
        strains = discretization.strains_of(q)
        history = history.leaving(hold=system.hold.multiplier)
        if gone == len(shares):
            break
        done = shares[gone - 1] if gone else done
    return end, strains, history


def _way(one: Pose, other: Pose, shares: Floats) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) at shares (n,) of a straight way."""
    turned = [partway(one.rotation, other.rotation, share) for share in shares.tolist()]
    return one.position + shares[:, None] * (other.position - one.position), np.array(turned)


def grip_before(discretization: Discretization, previous: Shape | None, strains: Floats,
                begin: Pose, far_end: FarEnd | None) -> FarEnd | None:
    """Return the FarEnd, of the kind of `far_end` or None, that holds the end where it is now."""
    if far_end is None:
        return None
    if previous is not None:
        end = Pose.from_rotation(previous.positions[-1], previous.frames[-1])
    else:
        state = configuration_at(discretization.system(begin.rotation), strains)
        end = Pose.from_rotation(begin.position + state.positions[-1], state.rotations[-1])
    return FarEnd(end, far_end.grip)


def grip_at(held: FarEnd | None, far_end: FarEnd | None, share: float) -> FarEnd | None:
    """Return the FarEnd at a `share` of the way from `held` to `far_end`."""
    if held is None or far_end is None or share == 1.0:
        return far_end
    return FarEnd(between(held.pose, far_end.pose, share), far_end.grip)


def parts_between(begin: Pose, gripper: Pose, held: FarEnd | None, far_end: FarEnd | None,
                  length: float) -> int:
    """Return in how many parts the motion is to be made at least; 0 if there is none."""
    pairs = [(begin, gripper)]
    if held is not None and far_end is not None:
        pairs.append((held.pose, far_end.pose))
    parts: float = 0.0
    for one, other in pairs:
        shift = float(np.linalg.norm(other.position - one.position))
        turn = angle_between(one.rotation, other.rotation)
        if far_end is None:
            parts = max(parts, 1.0 if shift + turn > 0 else 0.0)
        else:
            if far_end.grip == 'pinned' and one is not begin:
                turn = 0.0
            parts = max(parts, shift / (_SHIFT * length), turn / _TURN)
    return int(np.ceil(parts - 1e-9))


_SOFT = 0.1       # of the bending stiffness: torsion below it is soft
_STEPS = 100      # Newton steps for one step of growth
_DEPTH = 1e-5   # of the length: depth in obstacles that is allowed while it grows
_LEFT = 1e-4      # residual at which a step of growth ends; ten times that is still accepted
_ENOUGH = 10.0
_LEAST_GROWTH = 2.0**-10  # of the growth: if smaller steps fail, the growth ends there


def set_down(discretization: Discretization, gripper: Pose, strains: np.ndarray,
             far_ends: tuple[FarEnd, FarEnd], history: Memory,
             parts: int) -> tuple[Pose, np.ndarray, Memory]:
    """Return gripper, strains (N, 3) and the past of a DLO that is in its grips."""
    from dlo_planner.direct.taut import first_shape  # noqa: PLC0415  (SciPy: a free DLO needs none)
    far_end = far_ends[1]
    firm = _resisting_twist(discretization)
    amid = bool(discretization.surroundings.obstacles)
    bare = firm.without_obstacles if amid else firm
    past = bare.past(history)
    gripper, strains, past = (first_shape(bare, gripper, far_end, past) or lead(
        bare, strains, (gripper, gripper), far_ends, past, parts))
    if amid:
        shape, _ = equilibrium(bare, gripper, strains, 'newton', past, far_end)
        past = firm.past(history).leaving(hold=shape.state.left.left['hold'])
        gripper, strains, past = grown(firm, shape.gripper, np.array(shape.element_strains),
                                       far_end, past)
    if firm is not discretization:
        shape, _ = equilibrium(firm, gripper, strains, 'newton', past, far_end)
        gripper, strains, past = shape.gripper, np.array(shape.element_strains), shape.state.left
    return gripper, strains, history.with_forces(past)


def _resisting_twist(discretization: Discretization) -> Discretization:
    """Return a Discretization whose torsion is no softer than its bending; itself if it is not."""
    rod = discretization.rod
    twist, bend = rod.stiffness[0], min(rod.stiffness[1:])
    if rod.yields or twist > _SOFT * bend:
        return discretization
    return discretization.of(replace(rod, torsional_stiffness=scaled(rod.torsional_stiffness,
                                                                     float(bend / twist))))


def grown(discretization: Discretization, gripper: Pose, strains: np.ndarray, far_end: FarEnd,
          history: Memory) -> tuple[Pose, np.ndarray, Memory]:
    """Return gripper, strains (N, 3) and past of a DLO grown to its thickness among obstacles.

    Arguments as `set_down`; `strains` are those of the DLO without obstacles.
    """
    system = discretization.system(gripper.rotation, gripper.position, history, far_end)
    state = configuration_at(system, strains)
    thin = growth = penetration(system.scene, system.lengths, state.strains, state.rotations,
                                state.positions)
    step = growth
    while thin > 0.0 and step > _LEAST_GROWTH * growth:
        wanted = max(0.0, thin - step)
        system = discretization.system(gripper.rotation, gripper.position, history, far_end)
        found = solve(discretization, system._replace(scene=_thinner(system.scene, wanted)),
                      gripper, discretization.unknowns(strains), history,
                      Search(_STEPS, False, _DEPTH, _LEFT))
        state, system = found.state, found.system
        if not (found.residual < _ENOUGH * _LEFT
                and found.violation < _DEPTH * discretization.s[-1]):
            step *= 0.5
            continue
        thin, step = wanted, min(2 * step, wanted)
        strains = state.strains.copy()
        if discretization.surroundings.pinned:
            gripper = Pose.from_rotation(gripper.position, system.base)
        history = history.underway(Solved(discretization, system, state, gripper, far_end,
                                          history.left))
    return gripper, strains, history


def _thinner(scene: Scene, thin: float) -> Scene:
    """Return the Scene of a DLO whose surface is `thin` (m) deeper everywhere."""
    return scene._replace(radius=scene.radius - thin, radii=scene.radii - thin,
                          rounding=scene.rounding - thin)


_RELAXING = 12       # Newton steps between two parts of a motion
_ROUGHLY = 1e-5      # of the length: how well obstacles are kept clear of on the way
_SMALLEST = 2.0**-14  # part of the motion: what cannot be moved by it is blocked
_MORE_PARTS = 1000   # than the longest would need: what takes more of them has got stuck


class Advanced(NamedTuple):
    """Where a search begins: gripper, strains (N, 3), the past; and whether the way is clear."""

    gripper: Pose
    strains: np.ndarray
    history: Memory
    clear: bool = True


def approach(discretization: Discretization, previous: Shape | None, strains: Floats, gripper: Pose,
             far_end: FarEnd | None, history: Memory) -> tuple[Floats, bool]:
    """Return element strains (N, 3) at `gripper` that continue `previous`, and if the way is clear.

    Arguments as `advance_boundary`.
    """
    found = advance_boundary(discretization, previous, strains, gripper, far_end, history)
    return found.strains, found.clear


def advance_boundary(discretization: Discretization, previous: Shape | None, strains: Floats,
                     gripper: Pose,
                     far_end: FarEnd | None, history: Memory) -> Advanced:
    """Return where the search begins, as Advanced.

    The gripper (and the far end's grip) goes straight from its pose in `previous`; the DLO gives
    way. Where an obstacle is between here and there, the motion is made in smaller parts. The past
    is `history` with the forces of the far end's grip at the end of the way.

    Shapes: strains (N, 3).
    """
    obstacles = discretization.surroundings.obstacles
    if previous is None and far_end is None or not obstacles and far_end is None:
        return Advanced(gripper, strains, history)
    strains = np.array(strains)  # those of a Shape are read-only, another type for kernels
    begin = gripper if previous is None else previous.gripper
    held = grip_before(discretization, previous, strains, begin, far_end)
    parts = parts_between(begin, gripper, held, far_end, discretization.s[-1])
    if parts == 0:
        return Advanced(gripper, strains, history)
    if previous is None and far_end is not None:
        assert held is not None  # as far_end is not
        return Advanced(*set_down(discretization, gripper, strains, (held, far_end), history,
                                  parts))
    if not obstacles and held is not None and far_end is not None:
        return Advanced(*lead(discretization, strains, (begin, gripper), (held, far_end), history,
                              parts))
    return _in_parts(discretization, strains, (begin, gripper), (held, far_end), history,
                     1.0 / parts)


def _in_parts(discretization: Discretization, strains: Floats, grippers: tuple[Pose, Pose],
              far_ends: tuple[FarEnd | None, FarEnd | None], history: Memory,
              longest: float) -> Advanced:
    """Return where the search begins after a way in parts, around obstacles where it can."""
    (begin, gripper), (held, far_end) = grippers, far_ends
    done, step = 0.0, longest
    where, past, left = begin, history, round(1.0 / longest) + _MORE_PARTS
    while done < 1.0:
        old = configuration_at(discretization.system(where.rotation), strains)
        target = min(1.0, done + step)
        there = gripper if target == 1.0 else between(begin, gripper, target)
        grip = grip_at(held, far_end, target)
        system = discretization.system(there.rotation, there.position, history, grip)
        new = configuration_at(system, strains)
        shift = there.position - where.position
        if sweeps_through(system.scene, system.lengths, old.strains, old.rotations,
                          old.positions - shift, new.rotations, new.positions):
            step *= 0.5
            if step < _SMALLEST or left == 0:
                return Advanced(gripper, strains, past, False)
            continue
        done, where, left = target, there, max(left - 1, 0)
        step = min(2 * step, longest)
        if done == 1.0:
            break  # what is left is the step itself
        found = solve(discretization, system, there, new.q, history,
                      Search(_RELAXING, False, _ROUGHLY))
        strains, system = found.state.strains, found.system
        if discretization.surroundings.pinned:  # it has turned
            there, begin, gripper = (Pose.from_rotation(pose.position, system.base)
                                     for pose in (there, begin, gripper))
            where = there
        history = history.underway(Solved(discretization, system, found.state, there, grip,
                                          history.left))
    return Advanced(gripper, strains, past.leaving(hold=history.left['hold']))


def holding_on(mesh: Discretization, gripper: Pose, initial: Shape | None,
               far_end: FarEnd, past: Memory) -> tuple[Shape, int] | None:
    """Return the Shape next to `initial` in grips that moved a little, and 0 kicks; else None."""
    if (initial is None or not mesh.hangs or initial.far_end is None
            or initial.far_end.grip != far_end.grip):
        return None
    return held_from(mesh, gripper, mesh.start_from(initial), far_end, past)


def held_from(mesh: Discretization, gripper: Pose, strains: Floats, far_end: FarEnd,
              past: Memory) -> tuple[Shape, int] | None:
    """Return the Shape next to given strains, and 0 kicks; None where it is not near.

    Shapes: strains (N, 3).
    """
    found = held_nearby(mesh, gripper, far_end, strains, past.left['hold'])
    if found is None:
        return None
    (strains, frames, positions, wrenches, force, elastic, energy, residual, stability, steps,
     missed) = found
    after = past.followed(positions, frames[:, :, 0].copy(), hold=force)
    solution = Solution(strains, frames, positions, wrenches[0], elastic, energy, residual,
                        stability, steps, True, violation=missed, far_wrench=wrenches[1])
    return shape_from(mesh, gripper, solution, Way(past, after, far_end)), 0



def bearing_on(discretization: Discretization, gripper: Pose, initial: Shape | None,
               past: Memory) -> tuple[Shape, int] | None:
    """Return the Shape in which a DLO bears on where it does, and the kicks, or None."""
    around = discretization.surroundings
    if initial is None or around.pinned or around.has_moments or not _bears(past):
        return None
    if discretization.only_touches:
        return _at_once(discretization, gripper, initial, past)
    begin = initial.gripper
    start = (np.array(begin.rotation, order='C'), past.left['point_slid'],
             discretization.strains_from(initial.s, initial.element_strains),
             gripper.position - begin.position)
    before = np.empty((len(past.positions), 6))
    np.subtract(past.positions, gripper.position, out=before[:, :3])
    before[:, 3:] = past.tangents
    system = discretization.system(gripper.rotation, gripper.position, past)
    found = follow_contact(system, start, TOLERANCE, MAX_ITERATIONS,
                           EXACT * discretization.s[-1], before)
    if found is None:
        return None
    return shape_of(discretization, gripper, found, past), found.kicks


def _at_once(mesh: Discretization, gripper: Pose, initial: Shape,
             past: Memory) -> tuple[Shape, int] | None:
    """Return what `bearing_on` does, of a DLO that only touches: by one kernel."""
    begin = initial.gripper
    goes_on, end, known = _borne_on(
        mesh.static, begin.rotation, begin.position, mesh.start_from(initial), past.positions,
        past.tangents, COARSER * TOLERANCE, EXACT * mesh.s[-1], MAX_ITERATIONS, gripper.rotation,
        gripper.position, mesh.spring, *forces_left(past.left))
    if not goes_on:
        return None
    kicks, *proof = end
    return _shape(mesh, gripper, proof, past, known), kicks


def _shape(mesh: Discretization, gripper: Pose, proof: Sequence[Any], past: Memory,
           known: Sequence[Any]) -> Shape:
    """Return what `shape_of` does of a DLO that only touches.

    Of numbers and arrays alone: Records take as long to get to Python as to compute.
    """
    residual, stability, steps, violation = proof
    (strains, frames, positions, tangents, wrench, elastic, energy, noise), forces, rows = known
    after = past.followed(positions, tangents, **left_of(forces))
    good = (as_rounded(residual, noise, TOUCHING) and stability > -HELD_NEUTRAL
            and violation <= KEPT * mesh.s[-1])
    solution = Solution(strains, frames, positions, wrench, elastic, energy, residual, stability,
                        steps, bool(good), violation=violation,
                        contacts=contacts_in(mesh, rows, gripper.position))
    return shape_from(mesh, gripper, solution, Way(past, after))


def corrected_by(mesh: Discretization, shape: Shape, left: Memory) -> float:
    """Return how far, in m, the nodes are from the true rod's, by one step with halved elements.

    About what `Shape.error_estimate` says, which makes all steps and proves what it finds. Infinite
    where such a step tells nothing.
    """
    around = mesh.surroundings
    if (not shape.contacts or shape.far_end is not None or mesh.yields or around.pinned
            or around.has_moments):
        return np.inf
    gripper, finer = shape.gripper, mesh.finer
    return 4 / 3 * float(_corrected(finer.static, shape.element_strains, shape.positions,
                                    gripper.rotation, gripper.position, finer.spring,
                                    *forces_left(left.left)))


@kernel
def _borne_on(system: Problem, begin: Floats, start: Floats, strains: Floats, positions: Floats,
              tangents: Floats, tolerance: float, exact: float, max_iterations: int, base: Floats,
              origin: Floats, spring: float, node: Floats, element: Ints, obstacle: Ints,
              multiplier: Floats, fraction: Floats, anchor: Floats, normal: Floats, shear: Floats,
              slid: Floats) -> Any:
    """Return whether a DLO goes on bearing, and what it comes to; all arrays are read-only.

    Args:
        begin: (3, 3) rotation of the gripper before; start: (3,) its position, m
        strains: (N, 3), positions: (N + 1, 3), tangents: (N + 1, 3) before, 1/m and m, world
        tolerance, exact, max_iterations: as of `predictor_corrector`
        system; base, and all after it: as of `contact.halved`, base and origin after the step
    """
    here, shift = origin.copy(), np.empty(3)
    now = standing(system, base.copy(), here, spring, node, element, obstacle, multiplier,
                   fraction, anchor, normal, shear)
    previous = np.empty((positions.shape[0], 6))
    for i in range(3):
        shift[i] = origin[i] - start[i]
        for k in range(positions.shape[0]):
            previous[k, i] = positions[k, i] - origin[i]
            previous[k, 3 + i] = tangents[k, i]
    goes_on, state, residual, stability, steps, kicks, loaded, violation = predictor_corrector(
        now, begin.copy(), slid, strains.copy(), shift, tolerance, exact, max_iterations, previous)
    if not goes_on:  # Configuration and Problem may be unfinished, and of different contacts
        loaded, state = now, new_configuration(now)
        unknowns_of(now, strains.copy(), state.q)
        evaluate(now, state)
    violation = max(violation, penetration_of_point(system.effects.contact.scene, here))
    return (goes_on, (kicks, residual, stability, steps, violation), ended(loaded, state, here))


@kernel
def _corrected(system: Problem, strains: Floats, positions: Floats, base: Floats, origin: Floats,
               spring: float, node: Floats, element: Ints, obstacle: Ints, multiplier: Floats,
               fraction: Floats, anchor: Floats, normal: Floats, shear: Floats,
               slid: Floats) -> Any:
    """Return `minimize.semismooth.correction`, m, of a DLO held by a gripper; see `_borne_on`."""
    away = positions.copy()
    for k in range(away.shape[0]):
        for i in range(3):
            away[k, i] -= origin[i]
    finer = halved(system, base.copy(), origin.copy(), spring, node, element, obstacle, multiplier,
                   fraction, anchor, normal, shear, slid)
    return correction(finer, strains.copy(), away)


def _bears(past: Memory) -> bool:
    """Whether contacts have pressed on the DLO."""
    left = past.left
    return bool(left['node_force'].any() or left['point_multiplier'].any())


class How(NamedTuple):
    """How a DLO is held in a step, what it begins with, and how its shape is sought.

    Attributes
    ----------
    history : Memory or None
        Memory that the DLO starts with if there is no Shape of it before.
    far_end : FarEnd or None
    method, strains : str
        As of `DirectSimulator`.
    most : float
        Largest angle in rad by which a DLO that hangs freely may turn from the Shape before in the
        gripper until the search is given up.
    """

    history: Memory | None = None
    far_end: FarEnd | None = None
    method: str = 'newton'
    strains: str = 'components'
    most: float = np.inf


FREELY = How()


def step(discretization: Discretization, gripper: Pose, initial: Shape | None,
         how: How = FREELY) -> tuple[Shape, int]:
    """Return the Shape that follows `initial` (a Shape or None) on a mesh, and the kicks."""
    history, far_end, method, unknowns, most = how
    if far_end is None and method == 'newton' and discretization.hangs:
        return _hanging(discretization, gripper, initial, most)
    past = past_of(discretization, initial, history)
    if method == 'newton' and unknowns == 'components':
        found = (bearing_on(discretization, gripper, initial, past) if far_end is None else
                 holding_on(discretization, gripper, initial, far_end, past))
        if found is not None:
            return found
    if initial is None:
        strains = discretization.stress_free(past)
    else:
        strains = discretization.strains_from(initial.s, initial.element_strains)
    if unknowns == 'paper':
        return described_equilibrium(discretization, gripper, strains, method, past)
    gripper = held_by(discretization.surroundings, gripper, initial)
    gripper, strains, past, clear = advance_boundary(discretization, initial, strains, gripper,
                                                     far_end, past)
    if initial is None and far_end is not None and discretization.hangs and method == 'newton':
        freeze(strains)  # kernels take what is read-only as another type
        found = held_from(discretization, gripper, strains, far_end, past)
        if found is not None:
            return found
    shape, kicks = equilibrium(discretization, gripper, strains, method, past, far_end)
    return (shape if clear else replace(shape, converged=False, jumped=True)), kicks


def _hanging(discretization: Discretization, gripper: Pose, initial: Shape | None,
             most: float) -> tuple[Shape, int]:
    """Return what `step` does for a DLO that hangs freely, see `Discretization.hangs`."""
    if initial is None:
        return hanging(discretization, gripper, discretization.relaxed)
    if discretization.has_nodes(initial.s):
        return hanging(discretization, gripper, initial.element_strains, initial, most)
    return hanging(discretization, gripper,
                   discretization.strains_from(initial.s, initial.element_strains))


def held_by(surroundings: Surroundings, gripper: Pose, initial: Shape | None) -> Pose:
    """Return the Pose in which the gripper holds the DLO of `initial` (a Shape or None).

    A pinned DLO does not turn with its gripper.
    """
    if initial is None or not surroundings.pinned:
        return gripper
    return Pose.from_rotation(gripper.position, initial.gripper.rotation)


def past_of(discretization: Discretization, initial: Shape | None,
            history: Memory | None) -> Memory:
    """Return the Memory, on a mesh, of the DLO in the Shape `initial` or None."""
    known = None if initial is None else initial.state.history
    if (initial is not None and known is not None and known.positions is not initial.positions
            and not np.array_equal(known.positions, initial.positions)):
        # carried somewhere else since, or predicted: there it has touched nothing yet
        known = known.lasting()
    return discretization.past(known, history)
