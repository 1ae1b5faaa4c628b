# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A step of a DLO that goes on bearing on obstacles where it does: most steps in contact.

Then it gives way by what its contacts leave free (`minimize.bearing`), and the motion need not be
made in small parts (`direct.approach`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.direct.statics import EXACT, MAX_ITERATIONS, TOLERANCE, shape_of
from dlo_planner.direct.touch import halved_forces
from dlo_planner.minimize.bearing import correction
from dlo_planner.minimize.multipliers import carried_newton
from dlo_planner.ritz.rotation import turn_between

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.history import History
    from dlo_planner.direct.shape import Shape
    from dlo_planner.model.arrays import Floats
    from dlo_planner.model.pose import Pose

_NOWHERE = np.zeros((0, 3))


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
    shift = gripper.position - begin.position
    start = (np.array(begin.rotation, order='C'), past.left['point_slid'].any(axis=1),
             discretization.strains_from(initial.s, initial.element_strains),
             np.concatenate([turn_between(begin.rotation, gripper.rotation), shift]))
    before = np.hstack([past.positions - gripper.position, past.tangents])
    system = discretization.system(gripper.rotation, gripper.position, past)
    found = carried_newton(system, start, TOLERANCE, MAX_ITERATIONS,
                           EXACT * discretization.s[-1], before)
    return None if found is None else (shape_of(discretization, gripper, found, past), found.kicks)


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
    finer, gripper = mesh.finer, shape.gripper
    system = finer.system(gripper.rotation, gripper.position, _halved(left, finer.s))
    return 4 / 3 * float(correction(system, np.array(shape.element_strains),
                                    shape.positions - gripper.position))


def _halved(past: History, s: Floats) -> History:
    """Return what contacts leave to a mesh `s` (2 N + 1,) with halved elements, and nothing else.

    Of a DLO that does not yield and hangs free of other grips.
    """
    return replace(past, s=s, left={**past.left, **halved_forces(past.left, s)},
                   positions=_NOWHERE, tangents=_NOWHERE)


def _bears(past: History) -> bool:
    """Whether contacts have pressed on the DLO."""
    left = past.left
    pressed = left['point_multiplier'][left['point_obstacle'] >= 0]
    return bool(left['node_force'].any() or pressed.any())
