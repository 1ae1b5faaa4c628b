# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How the minimum of a Problem is sought, whatever acts: ball joints, dead moments; what is one.

Most steps of statics are one compiled call instead (`minimize.solve.solve_step`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.energy.contact import without_hinge as without_hinge_of_contact
from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.grip import without_hinge as without_hinge_of_holds
from dlo_planner.energy.potential import configuration_at, evaluate
from dlo_planner.energy.problem import Configuration, Problem, bending_energy, new_configuration
from dlo_planner.energy.terms import hinged
from dlo_planner.extras import studied
from dlo_planner.geometry.basis import orthonormal_basis
from dlo_planner.geometry.so3 import jacobians, matrix, plus, put_vector, transposed_applied, vector
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_solver import constrained_newton
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

TOLERANCE = 1e-10      # of the residual; the last step of a quadratic method overshoots it
EXACT = 1e-10          # of the length: violation of a constraint aimed at
KEPT = 1e-6            # the same that still counts as converged
MAX_ITERATIONS = 1000


class Search(NamedTuple):
    """Until when a minimum is sought."""

    steps: int = MAX_ITERATIONS  # Newton steps at most
    check: bool = True           # whether its stability is looked at, and what is unstable left
    exact: float = EXACT         # of the length: by how much constraints may be violated
    tolerance: float = TOLERANCE
    near: bool = False           # whether it is given up where it is not near


THOROUGH = Search()  # of what hangs freely: it is not given up soon


def minimum(mesh: Discretization, system: Problem, gripper: Pose, q: Floats,
            memory: Memory | None, how: Search) -> Minimum:
    """Return the Minimum of a Problem that is reached from q (m, 3), whatever acts."""
    exact, before = how.exact * float(mesh.s[-1]), np.zeros((0, 6))
    if memory is not None and len(memory.positions):
        before = np.hstack([memory.positions - gripper.position, memory.tangents])
    newtons = pinned_newton if mesh.surroundings.pinned else constrained_newton

    def solved(system: Problem, q: Floats) -> Minimum:
        return newtons(system, q, how.tolerance, how.steps, how.check, exact, before)

    if mesh.surroundings.has_moments:
        return _balanced(solved, system, q, mesh.moments)
    return solved(system, q)


def evaluated(system: Problem, q: Floats) -> Configuration:
    """Return the Configuration of a Problem at unknowns q (m, 3)."""
    state: Configuration = new_configuration(system)
    state.q[:] = q
    evaluate(system, state)
    return state


# ------------------------------------------------------------------------------------------------
# A gripper that holds the DLO's beginning like a ball joint: its position, not its rotation.
#
# The joint is one more element before the DLO: almost without length, so that it moves nothing, and
# almost without stiffness. Its three strains are the rotation of the beginning, an unknown like any
# other, so contacts, holds and the judgement of stability work as they do for a clamp. What is
# found is given back as a DLO that is clamped as it hangs, which the gripper's moment, zero,
# confirms.


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
    final = evaluated(clamped, own_unknowns(system, found.state.q))
    return found._replace(state=final, system=clamped)


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
    return system._replace(base=rotation, hold=without_hinge_of_holds(settled.hold),
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
    """Return the basis (3, N + 1, N_c + 1) with a `term` of the hinge alone; (3, 0, 0) if local."""
    _, n, terms = basis.shape
    if not n:
        return basis
    wider = np.zeros((3, n + 1, terms + 1))
    wider[:, 1:, :-1], wider[:, 0, -1] = basis, term
    return wider


# ------------------------------------------------------------------------------------------------
# Dead moments, which have no potential.


_ROUNDS = 60
_REMEMBERED = 8   # rounds that tell the next one where to go
_SETTLED = 1e-10  # part of the moments by which they may still turn


def _balanced(solved: Callable[[Problem, Floats], Minimum], system: Problem, q: Floats,
              moments: Floats) -> Minimum:
    """Return what `solved` returns in equilibrium with dead moments, its residual theirs too.

    The fixed point of frames -> shape -> frames is sought by Anderson's acceleration.
    """
    unit = np.abs(moments).sum()
    state = evaluated(system, q)
    known = _couples(system.lengths, state.strains, state.rotations, moments) / unit
    strains, iterations = state.strains, 0
    tried: list[Floats] = []
    missed: list[Floats] = []
    for _ in range(_ROUNDS):
        elastic = with_couples(system.elastic, unit * known)
        loaded = system._replace(elastic=elastic)
        found = solved(loaded, configuration_at(loaded, strains).q)
        state, system = found.state, found.system._replace(elastic=system.elastic)
        iterations += found.iterations
        strains = state.strains
        miss = _couples(system.lengths, strains, state.rotations, moments) / unit - known
        off = np.abs(miss).max()
        if off <= _SETTLED:
            break
        tried, missed = [*tried, known][-_REMEMBERED:], [*missed, miss][-_REMEMBERED:]
        known = _next(tried, missed)
    return found._replace(residual=max(found.residual, off), iterations=iterations, system=system)


def _next(tried: list[Floats], missed: list[Floats]) -> Floats:
    """Return where the misses (n, 3) would vanish, by least squares over what was tried."""
    best = tried[-1] + missed[-1]
    if len(tried) == 1:
        return best
    of_misses = np.column_stack([(one - missed[-1]).ravel() for one in missed[:-1]])
    share, *_ = np.linalg.lstsq(of_misses, -missed[-1].ravel(), rcond=1e-10)
    for part, one, miss in zip(share, tried[:-1], missed[:-1], strict=True):
        best = best + part * (one + miss - tried[-1] - missed[-1])
    return best


@kernel
def _couples(lengths: Floats, strains: Floats, rotations: Floats, moments: Floats) -> Floats:
    """Return (N, 3): the work of all moments beyond, per length and strain of each element, N m."""
    out = np.empty(strains.shape)
    beyond = (0.0, 0.0, 0.0)
    for e in range(lengths.size - 1, -1, -1):
        h = lengths[e]
        beyond = plus(beyond, vector(moments[e + 1]))
        turning, _ = jacobians(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h)
        own = transposed_applied(matrix(rotations[e]), beyond)
        put_vector(transposed_applied(turning, own), out[e])
    return out


# ------------------------------------------------------------------------------------------------
# The paper's own methods and unknowns, for study: they have a room of their own.


METHODS = ('newton', 'dfp', 'downhill_simplex')
STRAINS = ('components', 'paper')


def minimum_by(method: str, system: Problem, q: Floats, tolerance: float) -> Minimum:
    """Return the Minimum that one of the paper's methods reaches from q (m, 3)."""
    found: Minimum = studied('minimizers.search')(system, q, method, tolerance)
    return found


def described_minimum(mesh: Discretization, system: Problem, strains: Floats,
                      method: str) -> Minimum:
    """Return the Minimum whose (q_d, q_kappa, q_tau) are series, of the system of `mesh.local`."""
    basis = orthonormal_basis(mesh.basis, mesh.n_terms, mesh.s, np.ones_like(system.natural))[0]
    found: Minimum = studied('strains.described_minimum')(system, basis, strains, method, TOLERANCE)
    return found
