# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The equilibrium of a DLO at a given state of an estimate."""

from __future__ import annotations

from typing import Any

from dlo_planner.direct.continuation import follow
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import equilibrium
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.supports import FarEnd
from dlo_planner.verify.uncertain import Varied


def settled(varied: Varied, z: Floats, gripper: Pose, before: Shape | None = None,
            followed: bool = True) -> Shape:
    """Return the Shape at a state z (n,), `converged` or not."""
    mesh = varied.at(z)

    def found(gripper: Pose, initial: Shape | None, _far_end: FarEnd | None = None,
              _most: int | None = None) -> tuple[Shape, Any]:
        strains = mesh.natural if initial is None else initial.element_strains
        if initial is not None and len(strains) != mesh.s.size - 1:
            strains = mesh.strains_from(initial.s * (mesh.s[-1] / initial.s[-1]), strains)
        result: tuple[Shape, Any] = equilibrium(mesh, gripper, strains)
        return result

    if before is None or not followed:
        return found(gripper, before)[0]
    # first the equilibrium at z in the gripper's pose of `before`: following starts from one
    result: Shape = follow(found, found(before.gripper, before)[0], gripper)
    return result
