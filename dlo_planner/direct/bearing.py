# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A step of a DLO that goes on bearing on obstacles where it does: most steps in contact.

Then it gives way by what its contacts leave free (`minimize.bearing`), and the motion need not be
made in small parts (`direct.approach`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.direct.acting import ACTING
from dlo_planner.direct.part import Solved
from dlo_planner.direct.proof import proved_bearing, violation
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.state import State
from dlo_planner.direct.statics import EXACT, MAX_ITERATIONS, TOLERANCE, estimated, shape_of
from dlo_planner.direct.touch import ended, halved_system
from dlo_planner.minimize.bearing import correction
from dlo_planner.minimize.multipliers import carried_newton

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.history import History
    from dlo_planner.minimize.minimum import Minimum
    from dlo_planner.model.arrays import Floats
    from dlo_planner.model.pose import Pose


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
    if discretization.stores:
        return shape_of(discretization, gripper, found, past), found.kicks
    return _shape(discretization, gripper, found, past), found.kicks


def _shape(mesh: Discretization, gripper: Pose, found: Minimum, past: History) -> Shape:
    """Return what `shape_of` does of a DLO that only touches, with one look at what was found."""
    known = ended(found.system, found.state, np.array(gripper.position))
    solved = Solved(mesh, found.system, found.state, gripper, None, past.left, known)
    strains, frames, positions, tangents, wrench, elastic, energy, noise = known[0]
    after = past.followed(positions, tangents, **{
        name: np.asarray(one) for part in ACTING for name, one in part.leaves(solved).items()})
    reports = {name: value for part in ACTING
               for name, value in part.reports(solved, after.left).items()}
    estimate = partial(_estimate, mesh, gripper, strains, positions, past)
    return Shape(gripper, mesh.s, positions, frames, strains, energy, elastic, wrench,
                 found.residual, found.stability, found.iterations,
                 proved_bearing(solved, found, noise), violation=violation(solved, found),
                 state=State.made(mesh, after, past, estimate), **reports)


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
    return 4 / 3 * float(correction(halved_system(mesh, shape.gripper, left.left),
                                    np.array(shape.element_strains),
                                    shape.positions - shape.gripper.position))


def _bears(past: History) -> bool:
    """Whether contacts have pressed on the DLO."""
    left = past.left
    return bool(left['node_force'].any() or left['point_multiplier'].any())
