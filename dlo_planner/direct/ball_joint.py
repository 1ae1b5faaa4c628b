# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A gripper that holds the DLO's beginning like a ball joint: its position, not its rotation.

The joint is one more element before the DLO: almost without length, so that it moves nothing,
and almost without stiffness. Its three strains are the rotation of the beginning, an unknown like
any other, so contacts, a far end and the judgement of stability work as they do for a clamp. What
is found is given back as a DLO that is clamped as it hangs, which the gripper's moment, zero,
confirms.
"""

import numpy as np
import scipy

from dlo_planner.energy.contact import without_hinge as without_hinge_of_contact
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import Problem, bending_energy, new_configuration
from dlo_planner.energy.terms import hinged
from dlo_planner.minimize.contact_solver import constrained_newton
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.model.arrays import Floats

_LENGTH = 1e-13     # of the DLO's
_STIFFNESS = 1e-14  # of the DLO's bend energy per rad: enough to divide by


def pinned_newton(system: Problem, q: Floats, tolerance: float, most: int, check: bool,
                  exact: float, previous: Floats) -> Minimum:
    """Return what `constrained_newton` does, for a DLO whose beginning may turn.

    The Problem that is returned has the rotation that was found as its `base`.
    """
    before = np.vstack([previous[:1], previous])
    found = constrained_newton(with_hinge(system), hinge_unknowns(system, q), tolerance, most,
                               check, exact, before)
    clamped = without_hinge(system, found.system, np.array(found.state.rotations[1]))
    final = new_configuration(clamped)
    final.q[:] = own_unknowns(system, found.state.q)
    evaluate(clamped, final)
    result: Minimum = found._replace(state=final, system=clamped)
    return result


def with_hinge(system: Problem) -> Problem:
    """Return the Problem of a DLO with a hinge before its first element."""
    length, bend = system.lengths.sum(), bending_energy(system)
    h = _LENGTH * length
    # a series' terms are orthonormal, the elements' lengths being their weights
    term = 1.0 / np.sqrt(h) if system.basis.shape[1] else 1.0

    def before(first: float, others: Floats) -> Floats:
        return np.concatenate([np.full((1, *others.shape[1:]), first), others])

    part = _STIFFNESS * bend * h / system.stiffness[0].max()
    return system._replace(
        lengths=before(h, system.lengths), natural=before(0.0, system.natural),
        stiffness=before(_STIFFNESS * bend * h, system.stiffness),
        scale=before(1.0 / (np.sqrt(bend) * h * term), system.scale),
        basis=_basis(system.basis, term), effects=hinged(system.effects, part))


def without_hinge(system: Problem, settled: Problem, rotation: Floats) -> Problem:
    """Return `system` at a rotation (3, 3), with the forces that were found with the hinge."""
    return system._replace(base=rotation, hold=settled.hold,
                           contact=without_hinge_of_contact(settled.contact))


def hinge_unknowns(system: Problem, q: Floats) -> Floats:
    """Return q (m, 3) with the hinge's unknowns, at rest: before it, or after a series."""
    at_rest = np.zeros((1, 3))
    return np.vstack([q, at_rest] if system.basis.shape[1] else [at_rest, q])


def own_unknowns(system: Problem, q: Floats) -> Floats:
    """Return q (m + 1, 3) without the hinge's unknowns."""
    return q[:-1] if system.basis.shape[1] else q[1:]


def turn_of(system: Problem, q: Floats) -> Floats:
    """Return (3, 3) the rotation of the hinge of unknowns q (m + 1, 3)."""
    turn = q[-1] if system.basis.shape[1] else q[0]
    rotation = scipy.spatial.transform.Rotation.from_rotvec(turn / np.sqrt(bending_energy(system)))
    result: Floats = rotation.as_matrix()
    return result


def _basis(basis: Floats, term: float) -> Floats:
    """Return the basis (N + 1, N_c + 1) with a `term` of the hinge alone; (N + 1, 0) if local."""
    n, terms = basis.shape
    if not terms:
        return np.zeros((n + 1, 0))
    wider = np.zeros((n + 1, terms + 1))
    wider[1:, :-1], wider[0, -1] = basis, term
    return wider
