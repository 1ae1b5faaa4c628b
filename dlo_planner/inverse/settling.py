"""The equilibrium of a DLO that is known by the state of an estimate."""

import numpy as np

from dlo_planner.direct.continuation import follow
from dlo_planner.direct.statics import equilibrium


def settled(varied, z, gripper, before=None, followed=True):
    """Return the Shape at a state z (n,), or the one that Newton's method ended with.

    Args:
        varied: Varied
        gripper: Pose of the gripper as it is
        before: Shape from which the DLO comes; None: set down in its natural shape
        followed: whether the gripper's way from there is followed in steps that do not leap; else
            `before` is only where Newton's method begins
    """
    mesh = varied.at(z)

    def found(gripper, initial, _):
        if initial is None:
            return equilibrium(mesh, gripper, np.array(mesh.natural))
        strains = initial.element_strains
        if len(strains) != mesh.s.size - 1:
            strains = mesh.strains_from(initial.s * (mesh.s[-1] / initial.s[-1]), strains)
        return equilibrium(mesh, gripper, np.array(strains))

    if before is None or not followed:
        return found(gripper, before, None)[0]
    # at rest first, where the DLO comes from: the way may only begin in an equilibrium
    return follow(found, found(before.gripper, before, None)[0], gripper)
