# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a step has to prove before it is called converged, and the energy that it leaves stored."""

from collections.abc import Sequence

import numpy as np

from dlo_planner.direct.acting import ACTING
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.part import Left, Part, Solved
from dlo_planner.energy.effects import stored
from dlo_planner.energy.system import System
from dlo_planner.minimize.held import HELD_NEUTRAL
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.minimize.residual import gradient_noise
from dlo_planner.model.arrays import Floats

CONVERGED = 1e-8   # residual that is promised
KEPT = 1e-6        # of the length: violation that still counts as converged
_BLURRED = 1e-5    # a residual that rounding may make larger than this tells nothing


def proved(solved: Solved, found: Minimum, rounding: float = 0.0) -> bool:
    """Return whether a Minimum is a stable or neutral equilibrium that keeps all constraints.

    Parameters
    ----------
    solved : Solved
        The same as a step.
    found : Minimum
    rounding : float, optional
        Rounding error of the residual, where it is larger than usual.
    """
    mesh, system = solved.mesh, solved.system
    bound = [part for part in ACTING if part.constrains(system)]
    neutral = HELD_NEUTRAL if bound or mesh.surroundings.pinned else NEUTRAL
    return bool((_moved_by_less(system, found.residual, bound)
                 or _promised(solved, found.residual, rounding, bound))
                and found.stability > -neutral
                and all(part.kept(solved) for part in ACTING)
                and violation(solved, found) <= KEPT * mesh.s[-1])


def violation(solved: Solved, found: Minimum) -> float:
    """Return by how much a constraint is violated at most, m."""
    return max(float(found.violation), *(part.violation(solved) for part in ACTING))


def _moved_by_less(system: System, residual: float, bound: Sequence[Part]) -> bool:
    """Whether a residual is as small as promised, of a DLO whose inertia tells where it is.

    However large the rounding errors of its forces are, see `minimize.decrement`.
    """
    promised = max((part.residual for part in bound), default=CONVERGED)
    moves = system.anchor is not None and system.anchor.weight.size > 0
    return moves and residual < promised


def _promised(solved: Solved, residual: float, rounding: float, bound: Sequence[Part]) -> bool:
    """Whether the residual is below what is promised, or where constrained, what rounding leaves.

    Forces that rounding errors hide, of a DLO that is nearly taut, are no answer.
    """
    if not bound:
        return residual < CONVERGED + 100 * rounding
    noise = gradient_noise(solved.system, solved.state)
    return as_rounded(residual - 100 * rounding, noise, max(part.residual for part in bound))


def as_rounded(residual: float, noise: float, promised: float) -> bool:
    """Whether a residual is as small as promised, or as the `noise` that rounding may leave."""
    return residual < max(promised, noise) and noise < _BLURRED


def stored_after(solved: Solved, left: Left) -> float:
    """Return the energy in J that is stored in the DLO after a step."""
    mesh, system, state = solved.mesh, solved.system, solved.state
    if mesh.isometric and not mesh.stores and np.array_equal(system.natural, mesh.natural):
        return 0.5 * float(np.vdot(state.q, state.q))  # what the unknowns are scaled for
    return elastic_energy(mesh, state.strains, left)


def elastic_energy(mesh: Discretization, strains: Floats, left: Left) -> float:
    """Return the energy in J that is stored at strains (N, 3), after what effects have left."""
    system = mesh.static
    if not mesh.stores:
        bent = strains - system.natural
        return 0.5 * float(np.sum(system.lengths[:, None] * system.stiffness * bent**2))
    strains = strains.copy()
    return sum((part.stored(mesh, left, strains) for part in mesh.stores),
               stored(system.effects, system, strains))
