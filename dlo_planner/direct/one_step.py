# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One step of a DLO on one mesh: from the shape before to the next."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.approach import advance_boundary
from dlo_planner.direct.bearing import bearing_on
from dlo_planner.direct.described import described_equilibrium
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.direct.holding import held_from, holding_on
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import equilibrium, hanging
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import freeze


class How(NamedTuple):
    """How a DLO is held in a step, what it begins with, and how its shape is sought.

    Attributes
    ----------
    history : History or None
        History that the DLO starts with if there is no Shape of it before.
    far_end : FarEnd or None
    method, strains : str
        As of `DirectSimulator`.
    most : float
        Largest angle in rad by which a DLO that hangs freely may turn from the Shape before in the
        gripper until the search is given up.
    """

    history: History | None = None
    far_end: FarEnd | None = None
    method: str = 'newton'
    strains: str = 'components'
    most: float = np.inf


FREELY = How()


def step(discretization: Discretization, gripper: Pose, initial: Shape | None,
         how: How = FREELY) -> tuple[Shape, int]:
    """Return the Shape that follows `initial` (a Shape or None) on a mesh, and the kicks.

    Parameters
    ----------
    initial : Shape or None
        Shape to begin with. Of this DLO, its past counts; of any other, it is only a start.
    how : How, optional
    """
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
            history: History | None) -> History:
    """Return the History, on a mesh, of the DLO in the Shape `initial` or None.

    Parameters
    ----------
    history : History or None
        History that counts if `initial` is None or of another rod.
    """
    known = None if initial is None else initial.state.history
    if (initial is not None and known is not None and known.positions is not initial.positions
            and not np.array_equal(known.positions, initial.positions)):
        # carried somewhere else since, or predicted: there it has touched nothing yet
        known = known.lasting()
    return discretization.past(known, history)
