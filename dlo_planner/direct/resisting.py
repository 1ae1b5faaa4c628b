# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What inertia and damping of a step add to a DLO that hangs freely, and how stable it is so.

The stability of most steps is only proved to be good (`minimize.nearby`): its value is found when
somebody asks for it.
"""

import numpy as np

from dlo_planner.direct.trail import Coefficients
from dlo_planner.energy.effects import Needs, with_anchor
from dlo_planner.energy.inertia import Anchor
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.system import System
from dlo_planner.kernels import kernel
from dlo_planner.minimize.linear import assembled_definite
from dlo_planner.minimize.shifting import LEAST_SHIFT, safe_shift
from dlo_planner.minimize.spectrum import lowest_mode
from dlo_planner.minimize.workspace import new_workspace
from dlo_planner.model.arrays import Floats

_EXACT = 1e-4  # relative error of the eigenvalue


@kernel
def resisting(system: System, how: Coefficients, where: Floats, calm: Floats, base: Floats,
               origin: Floats) -> System:
    """Return the System of a DLO at rest with masses drawn to `where` (N + 1, 3) from the gripper.

    Its damped springs are drawn to the strains `calm` (N, 3).
    """
    strength = how.stiffness + how.slow * how.velocity_gain
    firm = how.viscous * how.velocity_gain
    natural = np.empty_like(system.natural)
    for e in range(natural.shape[0]):
        for i in range(3):  # K b u' is a spring of its own, drawn to where u' = 0
            natural[e, i] = (system.natural[e, i] + firm * calm[e, i]) / (1 + firm)
    return System(system.lengths, natural, system.stiffness * (1 + firm), system.scale,
                  system.basis, base, origin,
                  with_anchor(system.effects, Anchor(where, how.masses * strength)),
                  Needs(how.masses.size > 0, system.needs.attached, system.needs.border),
                  system.proximal_point, system.proximal_weight)


@kernel
def stability_at(system: System, how: Coefficients, base: Floats, origin: Floats, nodes: Floats,
                 bends: Floats) -> float:
    """Return the smallest eigenvalue of the Hessian that a step had at its end.

    How the DLO moves there tells what the step drew it to.

    Args:
        system, how: as of `swing_along`
        base: (3, 3), origin: (3,) of the gripper, read-only
        nodes: (4, N + 1, 3), bends: (4, N, 3) of a row of a Trail
    """
    where, calm = np.empty_like(nodes[0]), np.empty_like(bends[0])
    strength = how.stiffness + how.slow * how.velocity_gain
    for k in range(where.shape[0]):
        for i in range(3):
            force = nodes[2, k, i] + how.slow * nodes[1, k, i]  # per mass
            where[k, i] = nodes[0, k, i] - origin[i] - force / strength
    for e in range(calm.shape[0]):
        for i in range(3):
            calm[e, i] = bends[0, e, i] - bends[1, e, i] / how.velocity_gain
    # copied, since arrays that can be written are of another type: all else is compiled for them
    moving = resisting(system, how, where, calm, base.copy(), origin.copy())
    work = new_workspace(moving)
    unknowns_of(moving, bends[0], work.state.q)
    evaluate(moving, work.state)
    shift = 0.0
    if not assembled_definite(moving, work.state, work.hessian, shift):
        shift = safe_shift(moving, work.hessian, LEAST_SHIFT)
    value, _ = lowest_mode(moving, work.hessian, shift, _EXACT)
    stability: float = value
    return stability
