# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO with both ends held, set down in its grips, wherever obstacles may be.

A DLO with soft torsion is led to its grips with stiffer torsion, and gets its own torsion there:
small moments twist soft torsion far, on a long and winding way. The DLO first hangs without
obstacles. If it would lie in an obstacle, it is made thinner, by the same amount everywhere, until
it just touches; then it grows to its thickness, and the obstacle pushes it aside. Without this,
each point deep in an obstacle would be pushed in its own direction.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.history import History
from dlo_planner.direct.leading import lead
from dlo_planner.direct.part import Solved
from dlo_planner.direct.statics import Search, equilibrium, solve
from dlo_planner.energy.depth import depth
from dlo_planner.energy.potential import placed
from dlo_planner.energy.scene import Scene
from dlo_planner.model.along import scaled
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose

_SOFT = 0.1       # of the bending stiffness: torsion below it is soft
_STEPS = 100      # Newton steps for one step of growth
_ROUGHLY = 1e-5   # of the length: depth in obstacles that is allowed while it grows
_LEFT = 1e-4      # residual at which a step of growth ends; ten times that is still accepted
_ENOUGH = 10.0
_FINEST = 2.0**-10  # of the growth: if smaller steps fail, the growth ends there


def set_down(discretization: Discretization, gripper: Pose, strains: np.ndarray,
             far_ends: tuple[FarEnd, FarEnd], history: History,
             parts: int) -> tuple[Pose, np.ndarray, History]:
    """Return gripper, strains (N, 3) and the past of a DLO that is in its grips.

    Parameters
    ----------
    discretization : Discretization
        Discretization of the DLO.
    gripper : Pose
        The final pose.
    strains : ndarray, shape (N, 3)
        Strains to begin with, 1/m.
    far_ends : tuple
        Two FarEnds of the same grip: where the end is with these strains, and where it is held.
    history : History
        History on this mesh.
    parts : int
        Number of parts into which the way of the far end is cut.
    """
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
          history: History) -> tuple[Pose, np.ndarray, History]:
    """Return gripper, strains (N, 3) and past of a DLO grown to its thickness among obstacles.

    Arguments as `set_down`; `strains` are those of the DLO without obstacles.
    """
    system = discretization.system(gripper.rotation, gripper.position, history, far_end)
    state = placed(system, strains)
    thin = growth = depth(system.scene, system.lengths, state.strains, state.rotations,
                          state.positions)
    step = growth
    while thin > 0.0 and step > _FINEST * growth:
        wanted = max(0.0, thin - step)
        system = discretization.system(gripper.rotation, gripper.position, history, far_end)
        found = solve(discretization, system._replace(scene=_thinner(system.scene, wanted)),
                      gripper, discretization.unknowns(strains), history,
                      Search(_STEPS, False, _ROUGHLY, _LEFT))
        state, system = found.state, found.system
        if not (found.residual < _ENOUGH * _LEFT
                and found.violation < _ROUGHLY * discretization.s[-1]):
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
