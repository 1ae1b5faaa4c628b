"""A DLO with both ends held, set down in its grips, wherever obstacles may be.

Where its torsion is soft it is led there as if it were not, and softens in its grips: torsion that
is soft is twisted far by little, on a long and winding way. It hangs without obstacles first. Where
it would lie in one, it is made thinner, by one and the same amount everywhere, until it just
touches; then it grows to its thickness, and what it touches pushes it aside. Deep in an obstacle
each point would be pushed its own way.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.contacts import points_of
from dlo_planner.direct.leading import grip_before, lead, parts_between
from dlo_planner.direct.statics import equilibrium, solve
from dlo_planner.energy.depth import depth
from dlo_planner.energy.potential import placed
from dlo_planner.model.along import scaled
from dlo_planner.model.pose import Pose

_SOFT = 0.1       # of the stiffness of bending: torsion that is softer
_STEPS = 100      # Newton steps in which the DLO has to follow its growth
_ROUGHLY = 1e-5   # of the length: how well it has to keep clear of obstacles on the way
_LEFT = 1e-4      # residual on the way
_FINEST = 2.0**-10  # of the growth: what it does not follow in smaller parts is blocked


def set_down(discretisation, gripper, strains, far_end, history):
    """Return gripper, strains (N, 3) and the past of a DLO that is in its grips.

    Args:
        strains: (N, 3) to begin with, the gripper being where it ends
        far_end: FarEnd
        history: History on this mesh
    """
    firm = _resisting_twist(discretisation)
    amid = bool(discretisation.surroundings.obstacles)
    alone = firm.alone if amid else firm
    past = alone.past(history)
    held = grip_before(alone, None, strains, gripper, far_end)
    parts = parts_between(gripper, gripper, held, far_end, alone.s[-1])
    gripper, strains, past = lead(alone, strains, (gripper, gripper), (held, far_end), past, parts)
    if amid:
        shape, _ = equilibrium(alone, gripper, strains, 'newton', past, far_end)
        past = replace(firm.past(history), hold=shape._history.hold)
        gripper, strains, past = grown(firm, shape.gripper, np.array(shape.element_strains),
                                       far_end, past)
    if firm is not discretisation:
        shape, _ = equilibrium(firm, gripper, strains, 'newton', past, far_end)
        gripper, strains, past = shape.gripper, np.array(shape.element_strains), shape._history
    return gripper, strains, replace(history, hold=past.hold, node_force=past.node_force,
                                     points=past.points)


def _resisting_twist(discretisation):
    """Return a Discretisation whose torsion is no softer than its bending; itself if it is not."""
    rod = discretisation.rod
    twist, bend = rod.stiffness[0], min(rod.stiffness[1:])
    if rod.yields or twist > _SOFT * bend:
        return discretisation
    return discretisation.of(replace(rod, torsional_stiffness=scaled(rod.torsional_stiffness,
                                                                     float(bend / twist))))


def grown(discretisation, gripper, strains, far_end, history):
    """Return gripper, strains and past of a DLO that has grown to its thickness among obstacles.

    Arguments as `set_down`; `strains` are those of the DLO without obstacles.
    """
    system = discretisation.system(gripper.rotation, gripper.position, history, far_end)
    state = placed(system, strains)
    thin = growth = depth(system.scene, system.lengths, state.strains, state.rotations,
                          state.positions)
    step = growth
    while thin > 0.0 and step > _FINEST * growth:
        wanted = max(0.0, thin - step)
        system = discretisation.system(gripper.rotation, gripper.position, history, far_end)
        found = solve(discretisation, system._replace(scene=_thinner(system.scene, wanted)),
                      gripper, discretisation.unknowns(strains), history, _STEPS, False,
                      _ROUGHLY, _LEFT)
        state, residual, system, violation = found[0], found[1], found[5], found[6]
        if not (residual < 10 * _LEFT and violation < _ROUGHLY * discretisation.s[-1]):
            step *= 0.5
            continue
        thin, step = wanted, min(2 * step, wanted)
        strains = state.strains.copy()
        if discretisation.surroundings.pinned:
            gripper = Pose.from_rotation(gripper.position, system.base)
        history = replace(history, hold=system.hold.multiplier, node_force=system.contacts.node,
                          points=points_of(system, state, gripper, False))
    return gripper, strains, history


def _thinner(scene, thin):
    """Return the Scene of a DLO whose surface is `thin` (m) deeper everywhere."""
    return scene._replace(radius=scene.radius - thin, radii=scene.radii - thin,
                          rounding=scene.rounding - thin)
