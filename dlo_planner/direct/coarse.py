# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A first shape between two grips, found on a coarse mesh: the long way to it costs little there.

Which of several shapes it is decides itself on the way; where a DLO is smooth, 16 elements tell
that as 64 do, and what they miss of the shape is a few steps of Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import changed

_FEW = 3  # parts of a way: a shorter one is gone on the mesh itself
# of the length: what is less slack bends next to its clamps alone, where coarse elements are long
_SLACK = 0.05


def coarsely(mesh: Discretization, gripper: Pose, holds: Holds, memory: Memory, parts: int,
             led: Callable[[Discretization], tuple[Pose, Floats, Memory, bool]],
             ) -> tuple[Pose, Floats, Memory, bool] | None:
    """Return gripper, strains (N, 3) and the past of a DLO near its shape; None if none is found.

    `led` leads it there from its natural shape on a coarser mesh, in as many `parts` as it would be
    here, and returns gripper, strains and memory at the end of the way, and whether the DLO got
    there. Only where the gripper clamps the DLO, one grip holds its tip, some of it is slack, and
    nothing is varied or yields.
    """
    coarse = mesh.coarser
    if (coarse is None or parts < _FEW or holds[0].s is not None
            or mesh.surroundings.pinned or mesh.yields or mesh.variation is not None
            or np.linalg.norm(holds[0].pose.position - gripper.position)
            > (1 - _SLACK) * mesh.s[-1]):
        return None
    _, strains, past, arrived = led(coarse)
    if not arrived:
        return None
    return gripper, mesh.prolongation @ strains, changed(memory, hold=past.hold), True
