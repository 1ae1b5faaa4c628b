# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A step of a DLO between two grips that move a little: most steps of one that is held so.

One kernel finds it (`minimize.holding`). Where it does not, grips are brought to their places in
parts (`direct.leading`), and every guard of `minimize.held` watches the way. So it is with a DLO
that is set down in its grips; the end of its way is such a step again.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from dlo_planner.direct.shape import Shape, made_shape
from dlo_planner.direct.state import State
from dlo_planner.direct.statics import estimated, held_nearby

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.history import History
    from dlo_planner.model.arrays import Floats
    from dlo_planner.model.far_end import FarEnd
    from dlo_planner.model.pose import Pose


def holding_on(mesh: Discretization, gripper: Pose, initial: Shape | None,
               far_end: FarEnd, past: History) -> tuple[Shape, int] | None:
    """Return the Shape next to `initial` in grips that moved a little, and 0 kicks; else None.

    Parameters
    ----------
    mesh : Discretization
    gripper : Pose
        Pose of the gripper after the step.
    initial : Shape or None
        Shape before.
    far_end : FarEnd
        What holds the far end after the step.
    past : History
        What `initial` leaves to the step, on this mesh.
    """
    if (initial is None or not mesh.hangs or initial.far_end is None
            or initial.far_end.grip != far_end.grip):
        return None
    return held_from(mesh, gripper, mesh.start_from(initial), far_end, past)


def held_from(mesh: Discretization, gripper: Pose, strains: Floats, far_end: FarEnd,
              past: History) -> tuple[Shape, int] | None:
    """Return the Shape next to given strains, and 0 kicks; None where it is not near.

    Parameters
    ----------
    mesh, gripper, far_end
        As of `holding_on`.
    strains : ndarray, shape (N, 3)
        Strains of the elements, 1/m, read-only.
    past : History
        What is left to the step, on this mesh, with the forces of the far end's grip.
    """
    found = held_nearby(mesh, gripper, far_end, strains, past.left['hold'])
    if found is None:
        return None
    (strains, frames, positions, wrenches, force, elastic, energy, residual, stability, steps,
     missed) = found
    after = past.followed(positions, frames[:, :, 0].copy(), hold=force)
    estimate = partial(estimated, mesh, gripper, strains, positions - gripper.position, past,
                       far_end)
    return made_shape(
        gripper=gripper, s=mesh.s, positions=positions, frames=frames, element_strains=strains,
        energy=energy, elastic_energy=elastic, gripper_wrench=wrenches[0], residual=residual,
        stability=stability, iterations=steps, converged=True, violation=missed, far_end=far_end,
        far_wrench=wrenches[1], state=State.made(mesh, after, past, estimate)), 0
