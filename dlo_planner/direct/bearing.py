# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A step of a DLO that goes on bearing on obstacles where it does: most steps in contact.

Then it gives way by what its contacts leave free (`minimize.bearing`), and the motion need not be
made in small parts (`direct.approach`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dlo_planner.direct.contacts import contacts_in
from dlo_planner.direct.proof import KEPT, as_rounded
from dlo_planner.direct.shape import Shape, made_shape
from dlo_planner.direct.state import State
from dlo_planner.direct.statics import EXACT, MAX_ITERATIONS, TOLERANCE, estimated, shape_of
from dlo_planner.direct.touch import (
    Touch,
    ended,
    forces_left,
    halved,
    left_of,
    standing,
)
from dlo_planner.energy.depth import depth_of_point
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.system import new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.bearing import correction
from dlo_planner.minimize.held import HELD_NEUTRAL
from dlo_planner.minimize.multipliers import COARSER, carried_newton
from dlo_planner.minimize.resting import bear_on
from dlo_planner.model.value import freeze

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.history import History
    from dlo_planner.energy.system import System
    from dlo_planner.model.arrays import Floats, Ints
    from dlo_planner.model.pose import Pose

_NOTHING = np.zeros(6)
freeze(_NOTHING)

def bearing_on(discretization: Discretization, gripper: Pose, initial: Shape | None,
               past: History) -> tuple[Shape, int] | None:
    """Return the Shape in which a DLO bears on where it does, and the kicks; None if it does not.

    Parameters
    ----------
    discretization : Discretization
    gripper : Pose
        Pose of the gripper after the step.
    initial : Shape or None
        Shape before.
    past : History
        What it leaves to the step, on this mesh.
    """
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
    found = carried_newton(system, start, TOLERANCE, MAX_ITERATIONS,
                           EXACT * discretization.s[-1], before)
    if found is None:
        return None
    return shape_of(discretization, gripper, found, past), found.kicks


def _at_once(mesh: Discretization, gripper: Pose, initial: Shape,
             past: History) -> tuple[Shape, int] | None:
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


def _shape(mesh: Discretization, gripper: Pose, proof: Sequence[Any], past: History,
           known: Sequence[Any]) -> Shape:
    """Return what `shape_of` does of a DLO that only touches.

    Of numbers and arrays alone: a System and a State take as long to get to Python as to compute.

    Parameters
    ----------
    proof : tuple
        Residual, stability, steps, violation, as of a Minimum.
    known : tuple
        What `touch.ended` returns.
    """
    residual, stability, steps, violation = proof
    (strains, frames, positions, tangents, wrench, elastic, energy, noise), forces, rows = known
    after = past.followed(positions, tangents, **left_of(forces))
    good = as_rounded(residual, noise, Touch.residual) and stability > -HELD_NEUTRAL
    return made_shape(
        gripper=gripper, s=mesh.s, positions=positions, frames=frames, element_strains=strains,
        energy=energy, elastic_energy=elastic, gripper_wrench=wrench, residual=residual,
        stability=stability, iterations=steps, violation=violation,
        converged=bool(good and violation <= KEPT * mesh.s[-1]), far_wrench=_NOTHING,
        contacts=contacts_in(mesh, rows, gripper.position),
        state=State.made(mesh, after, past,
                         partial(_estimate, mesh, gripper, strains, positions, past)))


def _estimate(mesh: Discretization, gripper: Pose, strains: Floats, positions: Floats,
              past: History) -> float:
    return estimated(mesh, gripper, strains, positions - gripper.position, past, None)


def corrected_by(mesh: Discretization, shape: Shape, left: History) -> float:
    """Return how far, in m, the nodes are from the true rod's, by one step with halved elements.

    About what `Shape.error_estimate` says, which makes all steps and proves what it finds. Infinite
    where such a step tells nothing.

    Parameters
    ----------
    mesh : Discretization
    shape : Shape
        Shape on this mesh.
    left : History
        What it leaves.
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
def _borne_on(system: System, begin: Floats, start: Floats, strains: Floats, positions: Floats,
              tangents: Floats, tolerance: float, exact: float, max_iterations: int, base: Floats,
              origin: Floats, spring: float, node: Floats, element: Ints, obstacle: Ints,
              multiplier: Floats, fraction: Floats, anchor: Floats, normal: Floats, shear: Floats,
              slid: Floats) -> Any:
    """Return whether a DLO goes on bearing, and what it comes to; all arrays are read-only.

    Args:
        begin: (3, 3) rotation of the gripper before; start: (3,) its position, m
        strains: (N, 3), positions: (N + 1, 3), tangents: (N + 1, 3) before, 1/m and m, world
        tolerance, exact, max_iterations: as of `resting.bear_on`
        system; base, and all after it: as of `touch.halved`, base and origin after the step

    Returns
    -------
        whether; kicks, and the proof that `_shape` takes; what `touch.ended` returns. If it does
        not go on, nothing else means anything.
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
    goes_on, state, residual, stability, steps, kicks, loaded, violation = bear_on(
        now, begin.copy(), slid, strains.copy(), shift, tolerance, exact, max_iterations, previous)
    if not goes_on:  # State and System may be unfinished, and of different contacts
        loaded, state = now, new_state(now)
        unknowns_of(now, strains.copy(), state.q)
        evaluate(now, state)
    violation = max(violation, depth_of_point(system.effects.contact.scene, here))
    return (goes_on, (kicks, residual, stability, steps, violation), ended(loaded, state, here))


@kernel
def _corrected(system: System, strains: Floats, positions: Floats, base: Floats, origin: Floats,
               spring: float, node: Floats, element: Ints, obstacle: Ints, multiplier: Floats,
               fraction: Floats, anchor: Floats, normal: Floats, shear: Floats,
               slid: Floats) -> Any:
    """Return `minimize.bearing.correction`, m, of a DLO held by a gripper; see `_borne_on`."""
    away = positions.copy()
    for k in range(away.shape[0]):
        for i in range(3):
            away[k, i] -= origin[i]
    finer = halved(system, base.copy(), origin.copy(), spring, node, element, obstacle, multiplier,
                   fraction, anchor, normal, shear, slid)
    return correction(finer, strains.copy(), away)


def _bears(past: History) -> bool:
    """Whether contacts have pressed on the DLO."""
    left = past.left
    return bool(left['node_force'].any() or left['point_multiplier'].any())
