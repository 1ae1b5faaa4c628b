# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All contact forces of one linearized step at once.

Geometry is linear about a state, the laws of contact are exact. For each point that is near an
obstacle no gap w < 0, no force p < 0 and p w = 0; and Coulomb's law, |t| <= mu p, with the friction
t against the slip v. Written with the gap that De Saxce and Feng's bipotential opens by mu |v|,

    x = (mu p, t),    z = (w / mu + |v|, v),    x and z in the cone of Lorentz,  x . z = 0,

this is complementarity in second-order cones, whose interior point methods are robust. Here it is
the method of Mehrotra with the scaling of Nesterov and Todd; |v| follows from step to step, which
keeps all matrices symmetric (Acary, Armand, Nguyen and Shpakovych, Second-order cone programming
for frictional contact mechanics using interior point algorithm, 2022). Each contact is eliminated
at its own place, where it leaves a spring of 3 x 3 numbers: a Newton step costs one sweep over the
elements, however many contacts there are. Where |v| would only follow, as of what slides far, its
derivative is regarded, a part that is not symmetric and is left to a Krylov method.

Before it a semismooth Newton method on the same equations is tried (`exact_step`). It begins with
what bears, sticks and slides by now, takes a few steps instead of ten, and ends in the laws
themselves. Each of its steps is made as far as these are kept best along it. What slides couples
friction with the normal force, which is left to the same Krylov method over the sweep.

Contacts give a little under changes of their forces since the step before (a proximal method):
else nothing would decide how points share a force that lie along an obstacle. What they give
vanishes as the steps do.
"""

import numpy as np

from dlo_planner.energy.grip import constraint_value
from dlo_planner.energy.potential import project, value_at
from dlo_planner.energy.problem import bending_energy
from dlo_planner.geometry.kinematics import part_of_element
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hessian import assemble, factorize_with, solve, solve_held
from dlo_planner.minimize.kkt import add_to
from dlo_planner.minimize.riccati import no_springs
from dlo_planner.model.arrays import Bools, Floats, Ints

_MOST, _FEW = 60, 25  # Newton steps: of the interior point method, and of exact laws
# The barrier parameter to begin with, and where it ends, of the energy that the loads stand for;
# near rest it goes on. With it a law of motion is kept but for such a part of the length.
_FIRST, _LAST, _KEPT = 1e-4, 1e-8, 1e-5
_SHARP, _SHARPLY = 1e-14, 1e-9
_STUCK, _PATIENCE = 0.1, 25  # part of a step, and steps: then the first of both ends is enough
_EDGE = 1e-24  # of the square of a force: how near it comes to its cone, as rounded
# A step that is still not found after so many Newton steps, of a flow and near rest, is good enough
# with such a part of the barrier parameter to begin with, and wrong by such a part of its motion
_ENOUGH, _SHARPLY_ENOUGH, _BARRIER, _ROUGH = 15, 30, 0.1, 0.03
_CENTERED = 1e-2      # of the barrier parameter: what a step leaves of it at least
_SHORT = 0.99         # of the way to the boundary
_CLOSE = 1e-3         # of the length: gaps that are no smaller at the beginning
_GIVE = 2e-6          # of the length: by how much contacts give under a change by all the loads
_STIFFER = 4.0        # times the shift with which it does not stand
_LEAST_SHIFT, _MOST_SHIFT = 1e-3, 1e6  # of the Hessian while what will bear does not hold it yet
_LOST = 20            # steps in a row on which the DLO does not stand: it will not
_INNER, _COUPLED = 20, 1e-16  # directions of the coupling at most; what is left of its square
# The same of the interior point method; Newton steps from which on it is regarded there, and what
# part of such a step is made at least, else the next one goes without
_ROUGHLY, _FROM, _JAMS = 1e-4, 6, 0.2
_UNEVEN, _SECANTS = 0.1, 20  # of the imbalance along a step: what may be left; trials of its part
_SETTLED = 1e-6       # of the loads: changes of forces that are none
_BEARS = 1e-4         # of the loads that an element has: a smaller force is none
_STICKS = 0.999       # of its limit: friction that does not slide


class ContactRows(Record):
    """How A points of contact move with the DLO, and where their forces go."""

    node: Ints      # (A,) with whose twist they go: their own, or the first one of their element
    inside: Bools   # (A,) whether they are inside the element that begins there
    axis: Floats    # (A, 3) m, of the axis there, relative to the gripper
    frame: Floats   # (A, 3, 3) rows: normal and two tangents
    twist: Floats   # (A, 3, 6) their motions along these by that twist, stated at the gripper, m
    own: Floats     # (A, 3, 3) and by the unknowns of the element that they are in


@kernel
def contact_rows(system, state, table):
    """Return the ContactRows of the contacts in a table."""
    count = table.gap.size
    rows = ContactRows(table.element + 1, table.inside >= 0, np.empty((count, 3)),
                       np.empty((count, 3, 3)), np.empty((count, 3, 6)), np.zeros((count, 3, 3)))
    arm, own, lever = np.empty(3), np.empty((6, 3)), np.empty(3)
    for a in range(count):
        e, x, frame = table.element[a], rows.axis[a], rows.frame[a]
        for i in range(3):
            x[i] = state.positions[e + 1, i]
        if rows.inside[a]:
            rows.node[a] = e
            part_of_element(system.lengths[e], table.fraction[a], state.strains[e],
                            system.scale[e], state.rotations[e], own, arm)
            for i in range(3):
                x[i] = state.positions[e, i] + arm[i]
        _put_tangents(table.normal[a], frame)
        for r in range(3):
            # (friction acts at the axis, the normal force beside it)
            for i in range(3):
                lever[i] = x[i] + (table.arm[a, i] if r == 0 else 0.0)
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                rows.twist[a, r, i] = lever[j] * frame[r, k] - lever[k] * frame[r, j]
                rows.twist[a, r, 3 + i] = frame[r, i]
            for b in range(3 if rows.inside[a] else 0):
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    turn = (lever[j] - x[j]) * frame[r, k] - (lever[k] - x[k]) * frame[r, j]
                    rows.own[a, r, b] += frame[r, i] * own[3 + i, b] + turn * own[i, b]
    return rows


@kernel
def _put_tangents(normal, frame):
    """Fill frame (3, 3) with a normal and two directions across, all of one length."""
    least, size = 0, 0.0
    for i in range(3):
        frame[0, i] = normal[i]
        if abs(normal[i]) < abs(normal[least]):
            least = i
    for i in range(3):
        frame[1, i] = (1.0 if i == least else 0.0) - normal[least] * normal[i]
        size += frame[1, i] ** 2
    size = np.sqrt(size)
    for i in range(3):
        frame[1, i] /= size
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        frame[2, i] = normal[j] * frame[1, k] - normal[k] * frame[1, j]


@kernel
def put_motions(system, hessian, rows, step, moved):
    """Fill moved (A, 3): by how much the points move along their normals and tangents, m."""
    jacobians = hessian.twist_jacobian
    n = jacobians.shape[0]
    twists, own = np.empty((n + 1, 6)), np.empty((n, 3))
    for i in range(6):
        twists[0, i] = 0.0
    for e in range(n):
        x, y, z = value_at(system.basis, step, e)
        own[e, 0], own[e, 1], own[e, 2] = x, y, z
        for i in range(6):
            twists[e + 1, i] = (twists[e, i] + jacobians[e, i, 0] * x + jacobians[e, i, 1] * y
                                + jacobians[e, i, 2] * z)
    for a in range(moved.shape[0]):
        k = rows.node[a]
        for r in range(3):
            moved[a, r] = _motion(rows.twist[a, r], twists[k])
            if rows.inside[a]:
                for b in range(3):
                    moved[a, r] += rows.own[a, r, b] * own[k, b]


@kernel(forceinline=True)
def _motion(by, twist):
    """Return by (6,) times twist (6,)."""
    return (by[0] * twist[0] + by[1] * twist[1] + by[2] * twist[2]
            + by[3] * twist[3] + by[4] * twist[4] + by[5] * twist[5])


@kernel
def add_twist(rows, twist, along, across):
    """Add to along (A,) and across (A, 2) how the points move with a twist (6,) of the gripper."""
    for a in range(along.size):
        along[a] += _motion(rows.twist[a, 0], twist)
        across[a, 0] += _motion(rows.twist[a, 1], twist)
        across[a, 1] += _motion(rows.twist[a, 2], twist)


@kernel
def add_loads(system, hessian, rows, force, right):
    """Add to right (m, 3) forces (A, 3) along the normals and tangents of the points, N."""
    jacobians = hessian.twist_jacobian
    n = jacobians.shape[0]
    wrenches, by, total = np.zeros((n + 1, 6)), np.zeros((n, 3)), np.zeros(6)
    for a in range(force.shape[0]):
        k = rows.node[a]
        for r in range(3):
            for i in range(6):
                wrenches[k, i] += force[a, r] * rows.twist[a, r, i]
            if rows.inside[a]:
                for b in range(3):
                    by[k, b] += force[a, r] * rows.own[a, r, b]
    for r in range(n):
        e = n - 1 - r
        for i in range(6):
            total[i] += wrenches[e + 1, i]
        for b in range(3):
            for i in range(6):
                by[e, b] += jacobians[e, i, b] * total[i]
    out = np.empty_like(right)
    project(system.basis, by, out)
    add_to(right, 1.0, out)


@kernel
def _put_springs(rows, spring, blocks):
    """Fill SpringBlocks with the springs (A, 3, 3) of the contacts."""
    left, beside = np.empty((3, 6)), np.empty((3, 3))
    for a in range(spring.shape[0]):
        k = rows.node[a]
        blocks.acts[k] = False
        if rows.inside[a]:
            blocks.inside[k] = False
    for a in range(spring.shape[0]):
        if spring[a, 0, 0] == 0.0:  # it does not bear
            continue
        k, by, own = rows.node[a], rows.twist[a], rows.own[a]
        for r in range(3):
            for i in range(6):
                left[r, i] = (spring[a, r, 0] * by[0, i] + spring[a, r, 1] * by[1, i]
                              + spring[a, r, 2] * by[2, i])
        target = blocks.twist[k]
        if not blocks.acts[k]:
            blocks.acts[k] = True
            for i in range(6):
                for j in range(6):
                    target[i, j] = 0.0
        for i in range(6):
            for j in range(6):
                target[i, j] += (by[0, i] * left[0, j] + by[1, i] * left[1, j]
                                 + by[2, i] * left[2, j])
        if not rows.inside[a]:
            continue
        if not blocks.inside[k]:
            blocks.inside[k] = True
            for b in range(3):
                for j in range(6):
                    blocks.cross[k, b, j] = 0.0
                for c in range(3):
                    blocks.own[k, b, c] = 0.0
        for r in range(3):
            for b in range(3):
                beside[r, b] = (spring[a, r, 0] * own[0, b] + spring[a, r, 1] * own[1, b]
                                + spring[a, r, 2] * own[2, b])
        for b in range(3):
            for r in range(3):
                for j in range(6):
                    blocks.cross[k, b, j] += own[r, b] * left[r, j]
                for c in range(3):
                    blocks.own[k, b, c] += own[r, b] * beside[r, c]


class StepLaws(Record):
    """What the laws of A contacts say about one linearized step."""

    rows: ContactRows
    friction: Floats     # (A,) coefficient, 0 of what does not rub
    rubs: bool
    gap: Floats          # (A,) m, at the state
    slid: Floats         # (A, 2) m, from where the point stuck, along the tangents
    first: Floats        # (A, 3) N, forces that the gradient has, along normals and tangents
    give: float          # m/N, compliance of all contacts
    whole: float         # N, all loads on the DLO
    tau: float           # J, barrier parameter to begin with
    miss: Floats         # (K,) of what is held


@kernel
def step_laws(system, state, table, shear, closed, held):
    """Return the StepLaws at a state; shear (A, 3): friction forces; held: K.

    `closed`: the part of what is deep in an obstacle, or out of its grip, that the step mends.
    """
    contacts, friction = system.effects.contact.contacts, system.effects.contact.scene.friction
    count, length = table.gap.size, np.sum(system.lengths)
    rows, gap = contact_rows(system, state, table), table.gap.copy()
    energy = np.sum(np.abs(system.effects.load.pull)) * length + bending_energy(system)
    first, slid, rubbing = np.zeros((count, 3)), np.zeros((count, 2)), np.zeros(count)
    for a in range(count):
        c = table.rubbing[a]
        first[a, 0] = table.force[a]
        if gap[a] < 0.0:
            gap[a] *= closed
        if c >= 0:
            rubbing[a] = friction[table.obstacle[a]]
            for r in range(2):
                for i in range(3):
                    slid[a, r] += rows.frame[a, 1 + r, i] * (rows.axis[a, i]
                                                             - contacts.anchor[c, i])
                    first[a, 1 + r] -= rows.frame[a, 1 + r, i] * shear[a, i]
    miss = np.zeros(held)
    constraint_value(system.effects.hold, state, miss)
    for k in range(held):
        miss[k] *= closed
    return StepLaws(rows, rubbing, np.any(table.rubbing >= 0), gap, slid, first,
                    _GIVE * length * length / energy, energy / length,
                    _FIRST * energy / system.lengths.size, miss)


class Springs(Record):
    """How the forces of A contacts answer to their motions in one Newton step."""

    force: Floats    # (A, 3) N, on the DLO, along normals and tangents, if no point moves
    spring: Floats   # (A, 3, 3) N/m
    pulls: Floats    # (A, 3) change of the force with another unknown, as a slip or normal force
    sense: Floats    # (A, 3) how that changes with the motion
    offset: Floats   # (A,) what it is if no point moves


class Answer(Record):
    """What such a Newton step leads to."""

    step: Floats     # (m, 3)
    moved: Floats    # (A, 3) m, along normals and tangents
    other: Floats    # (A,) the other unknowns
    right: Floats    # (m, 3) work space, like all that follows
    change: Floats   # (m, 3)
    by: Floats       # (A, 3)
    load: Floats     # (A, 3)
    krylov: Floats   # (2, _INNER, A)


@kernel
def new_springs(count):
    """Return empty Springs."""
    return Springs(np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)),
                   np.zeros((count, 3)), np.zeros(count))


@kernel
def new_answer(unknowns, count):
    """Return an empty Answer."""
    return Answer(np.zeros((unknowns, 3)), np.zeros((count, 3)), np.zeros(count),
                  np.empty((unknowns, 3)), np.empty((unknowns, 3)), np.empty((count, 3)),
                  np.zeros((count, 3)), np.empty((2, _INNER, count)))


@kernel
def _solve_linear(system, state, hessian, laws, springs, more, back, answer, reaction, couples):
    """Fill the Answer to Springs with a factorization that is there.

    `more`: a shift in it that holds the step to `back` (m, 3); `couples`: what may be left of the
    coupling, squared; it is not regarded if that is 1.
    """
    rows, right, step = laws.rows, answer.right, answer.step
    for j in range(step.shape[0]):
        for i in range(3):
            right[j, i] = more * back[j, i] - state.gradient[j, i]
    for a in range(springs.offset.size):
        for i in range(3):
            answer.load[a, i] = springs.force[a, i] - laws.first[a, i]
    add_loads(system, hessian, rows, answer.load, right)
    for k in range(reaction.size):
        reaction[k] = laws.miss[k]
    solve_held(system, hessian, right, laws.miss, step, reaction)
    put_motions(system, hessian, rows, step, answer.moved)
    other = answer.other
    for a in range(other.size):
        other[a] = 0.0
    if couples >= 1.0:
        return
    _couple(system, hessian, rows, springs, answer, couples)
    for a in range(other.size):
        for i in range(3):
            answer.load[a, i] = springs.pulls[a, i] * other[a]
    for j in range(step.shape[0]):
        for i in range(3):
            right[j, i] = 0.0
    add_loads(system, hessian, rows, answer.load, right)
    solve(system, hessian, right, answer.change)
    put_motions(system, hessian, rows, answer.change, answer.by)
    for a in range(other.size):
        for i in range(3):
            answer.moved[a, i] += answer.by[a, i]
    for j in range(step.shape[0]):
        for i in range(3):
            step[j, i] += answer.change[j, i]


@kernel
def _couple(system, hessian, rows, springs, answer, couples):
    """Fill the other unknowns (A,) of the laws, which couple what is not symmetric.

    Orthogonal directions of minimal residual (GCR: Eisenstat, Elman and Schultz, SIAM J. Numer.
    Anal. 20, 1983), with the symmetric factorization as preconditioner.
    """
    count, used = springs.offset.size, answer.other
    left, by, krylov = np.empty(count), answer.by, answer.krylov
    whole = 0.0
    for a in range(count):
        left[a] = springs.offset[a]
        for i in range(3):
            left[a] += springs.sense[a, i] * answer.moved[a, i]
        whole += left[a] * left[a]
    for d in range(_INNER):
        rest = 0.0
        for a in range(count):
            rest += left[a] * left[a]
        if not rest > couples * whole:
            return
        v, w = krylov[0, d], krylov[1, d]
        for a in range(count):
            v[a] = left[a]
            for i in range(3):
                answer.load[a, i] = springs.pulls[a, i] * v[a]
        for j in range(answer.right.shape[0]):
            for i in range(3):
                answer.right[j, i] = 0.0
        add_loads(system, hessian, rows, answer.load, answer.right)
        solve(system, hessian, answer.right, answer.change)
        put_motions(system, hessian, rows, answer.change, by)
        for a in range(count):
            w[a] = v[a]
            for i in range(3):
                w[a] -= springs.sense[a, i] * by[a, i]
        for c in range(d):
            along = 0.0
            for a in range(count):
                along += krylov[1, c, a] * w[a]
            for a in range(count):
                w[a] -= along * krylov[1, c, a]
                v[a] -= along * krylov[0, c, a]
        size = along = 0.0
        for a in range(count):
            size += w[a] * w[a]
        if not size > 0.0:
            return
        size = np.sqrt(size)
        for a in range(count):
            v[a] /= size
            w[a] /= size
            along += w[a] * left[a]
        for a in range(count):
            used[a] += along * v[a]
            left[a] -= along * w[a]


@kernel(error_model='numpy', forceinline=True)
def _scaling(x, z, mu, give, w, scale, unscale, soft):
    """Fill the scaling W of Nesterov and Todd, W z = W^-1 x, its inverse, w (3,) W z, and soft.

    `soft` is the inverse of W^-2 plus what the contact gives. x, z (3,) are inside the cone of
    Lorentz. All is put together from the eigenvalues of W, which may differ by any factor.
    """
    rx, rz = np.sqrt(x[1] * x[1] + x[2] * x[2]), np.sqrt(z[1] * z[1] + z[2] * z[2])
    dx = np.sqrt(max((x[0] - rx) * (x[0] + rx), _EDGE * x[0] * x[0]))
    dz = np.sqrt(max((z[0] - rz) * (z[0] + rz), _EDGE * z[0] * z[0]))
    inner = max((x[0] * z[0] + x[1] * z[1] + x[2] * z[2]) / (dx * dz), 1.0)
    half = 0.5 / np.sqrt(0.5 * (1.0 + inner))
    w0 = half * (x[0] / dx + z[0] / dz)
    w1, w2 = half * (x[1] / dx - z[1] / dz), half * (x[2] / dx - z[2] / dz)
    size, turn = np.sqrt(dx / dz), np.sqrt(w1 * w1 + w2 * w2)
    c, d = (w1 / turn, w2 / turn) if turn > 0.0 else (1.0, 0.0)
    k = w0 + turn
    _from_eigenvalues(size * k, size / k, size, c, d, scale)
    _from_eigenvalues(1.0 / (size * k), k / size, 1.0 / size, c, d, unscale)
    for i in range(3):
        w[i] = scale[i, 0] * z[0] + scale[i, 1] * z[1] + scale[i, 2] * z[2]
    one, other = (1.0 / (size * k)) ** 2, (k / size) ** 2
    mean, half = 0.5 * (one + other), 0.5 * (one - other)
    along = give / (mu * mu)
    det = one * other + mean * (along + give) + along * give
    s00, s01, s11 = (mean + give) / det, -half / det, (mean + along) / det
    s22 = 1.0 / (1.0 / (size * size) + give)
    soft[0, 0] = s00
    soft[0, 1] = soft[1, 0] = s01 * c
    soft[0, 2] = soft[2, 0] = s01 * d
    soft[1, 1] = s11 * c * c + s22 * d * d
    soft[1, 2] = soft[2, 1] = (s11 - s22) * c * d
    soft[2, 2] = s11 * d * d + s22 * c * c


@kernel(error_model='numpy', forceinline=True)
def _from_eigenvalues(one, other, third, c, d, out):
    """Fill out (3, 3) of eigenvalues along (1, c, d), (1, -c, -d) and (0, -d, c)."""
    mean, half = 0.5 * (one + other), 0.5 * (one - other)
    out[0, 0] = mean
    out[0, 1] = out[1, 0] = half * c
    out[0, 2] = out[2, 0] = half * d
    out[1, 1] = mean * c * c + third * d * d
    out[1, 2] = out[2, 1] = (mean - third) * c * d
    out[2, 2] = mean * d * d + third * c * c


@kernel(error_model='numpy', forceinline=True)
def _to_boundary(x, d):
    """Return the largest part, at most 1, of a step d (3,) from x (3,) that stays in the cone."""
    a = d[0] * d[0] - d[1] * d[1] - d[2] * d[2]
    b = x[0] * d[0] - x[1] * d[1] - x[2] * d[2]
    c = x[0] * x[0] - x[1] * x[1] - x[2] * x[2]
    most = 1.0
    if d[0] < 0.0:
        most = min(most, -x[0] / d[0])
    root = b * b - a * c
    if root >= 0.0:
        root = np.sqrt(root)
        # c + 2 b y + a y^2 = 0, its smallest positive root
        y = c / (root - b) if b < 0.0 or a < 0.0 else -1.0
        if y > 0.0:
            most = min(most, y)
    return most


@kernel
def _standing(system, hessian, blocks, shift, floor, most):
    """Return 0 and about the least shift with which the DLO stands, factorized; 1 if none does."""
    bad = 1
    while bad > 0 and shift < most:
        shift = max(_STIFFER * shift, floor)
        bad = factorize_with(system, hessian, blocks, shift)
    if bad == 0:
        if factorize_with(system, hessian, blocks, 0.5 * shift) == 0:
            shift *= 0.5
        else:
            factorize_with(system, hessian, blocks, shift)
    return bad, shift


@kernel(error_model='numpy')
def interior_step(system, state, hessian, laws, shift, floor, most, sharp, force, answer, reaction):
    """Fill forces (A, 3) and the Answer of a step after which all laws hold.

    Return 1 if there is one on which the DLO stands, -1 if it does not stand, 0 if none is found;
    and the shift with which it stands, no smaller than the one given. `floor`, `most`: the least
    shift that is one, and the most.
    """
    count, rows, give = laws.gap.size, laws.rows, laws.give
    length, blocks = np.sum(system.lengths), no_springs(system.lengths.size)
    assemble(system, state, hessian)
    springs, moved, back = new_springs(count), np.zeros((count, 3)), np.zeros_like(answer.step)
    x, z, dx, dz = (np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)),
                    np.zeros((count, 3)))
    ax, az, lam, left = np.zeros(3), np.zeros(3), np.zeros((count, 3)), np.zeros((count, 3))
    scale, unscale, soft = np.zeros((count, 3, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    r, cross, slip = np.zeros(3), np.zeros((count, 3)), np.zeros(count)
    tau, last = laws.tau, (_SHARP if sharp else _LAST) / _FIRST * laws.tau
    kept = (_SHARPLY if sharp else _KEPT) * length
    for a in range(count):
        mu = laws.friction[a]
        w = max(laws.gap[a], _CLOSE * length)
        push = max(tau / w, 0.5 * laws.first[a, 0])
        if mu > 0.0:
            slip[a] = np.sqrt(laws.slid[a, 0] ** 2 + laws.slid[a, 1] ** 2)
            x[a, 0], z[a, 0] = mu * push, w / mu + slip[a]
        else:
            x[a, 0], z[a, 0] = push, w
    # (|v| that follows may go to and fro without end; from then on it stays as it is, and what is
    # left is convex: gaps are wrong by mu times its change, and the next step begins from there)
    couples, follows = False, _SHARPLY_ENOUGH if sharp else _ENOUGH
    more, done, falls, lost, bad, part, stood = 0.0, False, False, 0, 0, 1.0, False
    for iteration in range(_MOST):
        mean = wrong = 0.0
        for a in range(count):
            mu = laws.friction[a]
            mean += (x[a, 0] * z[a, 0] + x[a, 1] * z[a, 1] + x[a, 2] * z[a, 2]) / count
            if not mu > 0.0:
                left[a, 0] = (laws.gap[a] + moved[a, 0] + give * (x[a, 0] - laws.first[a, 0])
                              - z[a, 0])
                soft[a, 0, 0] = 1.0 / (z[a, 0] / x[a, 0] + give)
                springs.spring[a, 0, 0] = soft[a, 0, 0]
                wrong = max(wrong, abs(left[a, 0]))
                continue
            if iteration <= follows:
                slip[a] = np.sqrt((laws.slid[a, 0] + moved[a, 1]) ** 2
                                  + (laws.slid[a, 1] + moved[a, 2]) ** 2)
            for q in (1, 2):
                springs.sense[a, q] = ((laws.slid[a, q - 1] + moved[a, q]) / slip[a]
                                       if slip[a] > 0.0 else 0.0)
            springs.offset[a] = -(springs.sense[a, 1] * moved[a, 1]
                                  + springs.sense[a, 2] * moved[a, 2])
            left[a, 0] = (laws.gap[a] + moved[a, 0] + give * (x[a, 0] / mu - laws.first[a, 0])
                          ) / mu + slip[a] - z[a, 0]
            for q in (1, 2):
                left[a, q] = (laws.slid[a, q - 1] + moved[a, q]
                              + give * (x[a, q] - laws.first[a, q]) - z[a, q])
            for q in range(3):
                wrong = max(wrong, abs(left[a, q]))
            _scaling(x[a], z[a], mu, give, lam[a], scale[a], unscale[a], soft[a])
            for i in range(3):
                for j in range(3):
                    springs.spring[a, i, j] = soft[a, i, j] / (
                        (mu if i == 0 else 1.0) * (mu if j == 0 else 1.0))
                springs.pulls[a, i] = -soft[a, i, 0] / (mu if i == 0 else 1.0)
        near = mean <= _LAST / _FIRST * laws.tau and wrong < _KEPT * length
        if iteration > 0 and bad == 0 and (mean <= last and wrong < kept
                              or near and (part < _STUCK or iteration > _PATIENCE)):
            done = True
            break
        if bad == 0 and iteration > (_SHARPLY_ENOUGH if sharp else _ENOUGH):
            far = 0.0
            for a in range(count):
                for i in range(3):
                    far = max(far, abs(moved[a, i]))
            if mean < _BARRIER * laws.tau and wrong < _ROUGH * far:
                done = True
                break
        _put_springs(rows, springs.spring, blocks)
        bad = factorize_with(system, hessian, blocks, shift)
        lost = 0 if bad == 0 else lost + 1
        again, stood = stood and bad > 0, stood or bad == 0 and iteration > 0
        more = 0.0 if bad == 0 or count == 0 else 0.25 * more
        if bad > 0 and (count == 0 or mean <= last or near or again or lost > _LOST):
            bad, shift = _standing(system, hessian, blocks, shift, floor, most)
            if bad > 0:
                falls = True
                break
            more, lost = 0.0, 0
        unstable = bad > 0
        while bad > 0 and more < _MOST_SHIFT:
            more = max(_LEAST_SHIFT, 4.0 * more)
            bad = factorize_with(system, hessian, blocks, shift + more)
        if bad > 0:
            falls = True
            break
        bad = int(unstable)
        couples = laws.rubs and _FROM < iteration <= follows and not (couples and part < _JAMS)
        target, part = 0.0, 1.0
        for stage in range(2):
            for a in range(count):
                mu = laws.friction[a]
                if not mu > 0.0:
                    r[0] = (target - cross[a, 0] * stage) / x[a, 0] - z[a, 0] - left[a, 0]
                    springs.force[a, 0] = x[a, 0] + soft[a, 0, 0] * (r[0] + moved[a, 0])
                    continue
                one, two, three = lam[a]
                # the arrow of lam, inverted, times target e - cross
                b0, b1, b2 = target, 0.0, 0.0
                if stage > 0:
                    b0, b1, b2 = b0 - cross[a, 0], b1 - cross[a, 1], b2 - cross[a, 2]
                det = one * one - two * two - three * three
                first = (one * b0 - two * b1 - three * b2) / det
                second = (b1 - two * first) / one
                third = (b2 - three * first) / one
                ax[0], ax[1], ax[2] = first - one, second - two, third - three
                for i in range(3):
                    r[i] = (unscale[a, i, 0] * ax[0] + unscale[a, i, 1] * ax[1]
                            + unscale[a, i, 2] * ax[2] - left[a, i]
                            + moved[a, i] / (mu if i == 0 else 1.0))
                for i in range(3):
                    push = x[a, i]
                    for j in range(3):
                        push += soft[a, i, j] * r[j]
                    springs.force[a, i] = push / (mu if i == 0 else 1.0)
            _solve_linear(system, state, hessian, laws, springs, more, back, answer, reaction,
                          _ROUGHLY if couples else 1.0)
            part = 1.0
            for a in range(count):
                mu = laws.friction[a]
                if not mu > 0.0:
                    dx[a, 0] = (springs.force[a, 0] - soft[a, 0, 0] * answer.moved[a, 0]
                                - x[a, 0])
                    dz[a, 0] = (left[a, 0] + answer.moved[a, 0] - moved[a, 0]
                                + give * dx[a, 0])
                    if dx[a, 0] < 0.0:
                        part = min(part, -x[a, 0] / dx[a, 0])
                    if dz[a, 0] < 0.0:
                        part = min(part, -z[a, 0] / dz[a, 0])
                    continue
                for i in range(3):
                    dx[a, i] = springs.force[a, i]
                    for j in range(3):
                        dx[a, i] -= springs.spring[a, i, j] * answer.moved[a, j]
                    dx[a, i] += springs.pulls[a, i] * answer.other[a]
                    dx[a, i] = dx[a, i] * (mu if i == 0 else 1.0) - x[a, i]
                    dz[a, i] = (left[a, i] + (answer.moved[a, i] - moved[a, i])
                                / (mu if i == 0 else 1.0)
                                + give / (mu * mu if i == 0 else 1.0) * dx[a, i])
                dz[a, 0] += answer.other[a]
                part = min(part, _to_boundary(x[a], dx[a]))
                part = min(part, _to_boundary(z[a], dz[a]))
            if stage > 0 or count == 0:
                break
            after = 0.0
            for a in range(count):
                for i in range(3):
                    after += (x[a, i] + part * dx[a, i]) * (z[a, i] + part * dz[a, i]) / count
            target = max(min(1.0, max(after / mean, 0.0) ** 3), _CENTERED) * mean
            target = max(target, 0.3 * last)
            for a in range(count):
                if not laws.friction[a] > 0.0:
                    cross[a, 0] = dx[a, 0] * dz[a, 0]
                    continue
                for i in range(3):
                    ax[i] = (unscale[a, i, 0] * dx[a, 0] + unscale[a, i, 1] * dx[a, 1]
                             + unscale[a, i, 2] * dx[a, 2])
                    az[i] = (scale[a, i, 0] * dz[a, 0] + scale[a, i, 1] * dz[a, 1]
                             + scale[a, i, 2] * dz[a, 2])
                cross[a, 0] = ax[0] * az[0] + ax[1] * az[1] + ax[2] * az[2]
                cross[a, 1] = ax[0] * az[1] + az[0] * ax[1]
                cross[a, 2] = ax[0] * az[2] + az[0] * ax[2]
        part = min(1.0, _SHORT * part)
        for a in range(count):
            for i in range(3):
                x[a, i] += part * dx[a, i]
                z[a, i] += part * dz[a, i]
                moved[a, i] += part * (answer.moved[a, i] - moved[a, i])
        for j in range(back.shape[0]):
            for i in range(3):
                back[j, i] += part * (answer.step[j, i] - back[j, i])
        if count == 0:
            done = True
            break
    for a in range(count):
        mu = laws.friction[a]
        force[a, 0] = x[a, 0] / mu if mu > 0.0 else x[a, 0]
        force[a, 1], force[a, 2] = x[a, 1], x[a, 2]
    for j in range(back.shape[0]):
        for i in range(3):
            answer.step[j, i] = back[j, i]
    return (-1 if falls else 1 if done else 0), shift


@kernel(error_model='numpy')
def exact_step(system, state, hessian, laws, shift, floor, most, sharp, force, answer, reaction):
    """Do what `interior_step` does, beginning with what bears, sticks and slides by now.

    A semismooth Newton method: it ends where all contacts do in the end what they were taken to do.
    What slides rubs with its limit exactly then. Where the DLO does not stand with what bears and
    sticks in the middle of the search, the shift grows there, and the search goes on with it; not
    if it is to be `sharp`, near rest: there what seems to fall is left to `interior_step`.
    """
    count, rows, firm = laws.gap.size, laws.rows, 1.0 / laws.give
    springs, none, blocks = (new_springs(count), np.zeros_like(answer.step),
                             no_springs(system.lengths.size))
    assemble(system, state, hessian)
    bears, slides, z = (np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_),
                        np.zeros((count, 2)))
    p, least = np.empty(count), _BEARS * laws.whole / system.lengths.size
    moved, found = np.zeros((count, 3)), 0
    balance, there, way = laws.first.copy(), np.zeros((count, 3)), np.zeros((count, 3))
    for a in range(count):
        p[a] = laws.first[a, 0]
        bears[a] = p[a] > least
        one, other = laws.first[a, 1], laws.first[a, 2]
        size = np.sqrt(one * one + other * other)
        slides[a] = bears[a] and size > _STICKS * laws.friction[a] * p[a]
        away = np.sqrt(laws.slid[a, 0] ** 2 + laws.slid[a, 1] ** 2)
        for r in range(2):
            along = -laws.first[a, 1 + r] / size if size > 0.0 else 0.0
            z[a, r] = (size + firm * away) * along
    for trial in range(_FEW):
        for a in range(count):
            for i in range(3):
                springs.force[a, i] = springs.pulls[a, i] = springs.sense[a, i] = 0.0
                for j in range(3):
                    springs.spring[a, i, j] = 0.0
            springs.offset[a] = -p[a]
            if not bears[a]:
                continue
            springs.spring[a, 0, 0] = firm
            springs.force[a, 0] = laws.first[a, 0] - firm * laws.gap[a]
            springs.offset[a] += springs.force[a, 0]
            springs.sense[a, 0] = -firm
            if not laws.friction[a] > 0.0:
                continue
            size = np.sqrt(z[a, 0] ** 2 + z[a, 1] ** 2)
            limit = laws.friction[a] * max(p[a], 0.0)
            # (of its friction as it is by now, which does not turn as abruptly as the way that it
            # slides: Chan, Golub and Mulet, SIAM J. Sci. Comput. 20, 1999)
            pull = np.sqrt(balance[a, 1] ** 2 + balance[a, 2] ** 2)
            kept = limit / pull if pull > limit else 1.0
            for r in range(2):
                if not slides[a]:
                    springs.spring[a, 1 + r, 1 + r] = firm
                    springs.force[a, 1 + r] = laws.first[a, 1 + r] - firm * laws.slid[a, r]
                    continue
                springs.pulls[a, 1 + r] = -laws.friction[a] * z[a, r] / size
                springs.force[a, 1 + r] = -limit * z[a, r] / size
                for q in range(2):
                    springs.spring[a, 1 + r, 1 + q] = firm / size * (
                        limit * (r == q) + 0.5 * kept / size * (
                            balance[a, 1 + r] * z[a, q] + balance[a, 1 + q] * z[a, r]))
                    springs.force[a, 1 + r] += (springs.spring[a, 1 + r, 1 + q]
                                                * moved[a, 1 + q])
        _put_springs(rows, springs.spring, blocks)
        # (with another shift forces before are in balance no more: then all of the step is made)
        bad, again = factorize_with(system, hessian, blocks, shift), trial == 0
        if bad > 0 and (trial == 0 or not sharp):
            (bad, shift), again = _standing(system, hessian, blocks, shift, floor, most), bad > 0
        if bad > 0:
            found = -1
            break
        _solve_linear(system, state, hessian, laws, springs, 0.0, none, answer, reaction,
                      _COUPLED if laws.rubs else 1.0)
        for a in range(count):
            for i in range(3):
                there[a, i] = springs.force[a, i] + springs.pulls[a, i] * answer.other[a]
                for j in range(3):
                    there[a, i] -= springs.spring[a, i, j] * answer.moved[a, j]
                way[a, i] = answer.moved[a, i] - moved[a, i]
        part = 1.0 if again else _part_of(laws, moved, way, balance, there)
        same, change = part == 1.0, 0.0
        for a in range(count):
            for i in range(3):
                moved[a, i] += part * way[a, i]
                balance[a, i] += part * (there[a, i] - balance[a, i])
            push = laws.first[a, 0] - firm * (laws.gap[a] + moved[a, 0])
            change = max(change, abs(max(push, 0.0) - p[a]))
            p[a] = max(push, 0.0)
            same = same and (push > 0.0) == bears[a]
            bears[a] = push > 0.0
            if not laws.friction[a] > 0.0:
                continue
            square = turned = 0.0
            for r in range(2):
                now = firm * (laws.slid[a, r] + moved[a, 1 + r]) - laws.first[a, 1 + r]
                turned += (now - z[a, r]) ** 2
                z[a, r] = now
                square += now * now
            if bears[a] and slides[a] and turned > 0.0:
                change = max(change, laws.friction[a] * p[a] * np.sqrt(turned / (square + turned)))
            beyond = bears[a] and square > (laws.friction[a] * p[a]) ** 2
            same = same and (not bears[a] or beyond == slides[a])
            slides[a] = beyond
        if same and change < _SETTLED * laws.whole:
            found = 1
            break
    for a in range(count):
        size = np.sqrt(z[a, 0] ** 2 + z[a, 1] ** 2)
        limit = laws.friction[a] * p[a]
        force[a, 0] = p[a]
        for r in range(2):
            force[a, 1 + r] = -z[a, r] * (limit / size if size > limit else 1.0)
    return found, shift


@kernel
def _part_of(laws, moved, way, balance, there):
    """Return the part of a step on which the laws are kept best, along it.

    With friction whose limits are given this is where a convex potential is least. Shapes (A, 3):
    motions before the step and in it; forces in balance with the DLO, before and after.
    """
    before = _imbalance(laws, moved, way, balance, there, 0.0)
    after = _imbalance(laws, moved, way, balance, there, 1.0)
    if not before < 0.0 < after or after < _UNEVEN * abs(before):
        return 1.0
    low, high, at_low, at_high = 0.0, 1.0, before, after
    part = 1.0
    for _ in range(_SECANTS):
        part = low + (high - low) * min(max(at_low / (at_low - at_high), 0.1), 0.9)
        value = _imbalance(laws, moved, way, balance, there, part)
        if abs(value) < _UNEVEN * abs(before):
            break
        if value < 0.0:
            low, at_low = part, value
        else:
            high, at_high = part, value
    return part


@kernel
def _imbalance(laws, moved, way, balance, there, part):
    """Return the derivative along a step, J, of the energy of the DLO and its contacts there."""
    total, firm, z, x = 0.0, 1.0 / laws.give, np.empty(2), np.empty(3)
    for a in range(laws.gap.size):
        for i in range(3):
            x[i] = moved[a, i] + part * way[a, i]
            total += (balance[a, i] + part * (there[a, i] - balance[a, i])) * way[a, i]
        push = max(laws.first[a, 0] - firm * (laws.gap[a] + x[0]), 0.0)
        total -= push * way[a, 0]
        limit, square = laws.friction[a] * push, 0.0
        if not limit > 0.0:
            continue
        for r in range(2):
            z[r] = firm * (laws.slid[a, r] + x[1 + r]) - laws.first[a, 1 + r]
            square += z[r] * z[r]
        kept = 1.0 if square <= limit * limit else limit / np.sqrt(square)
        for r in range(2):
            total += kept * z[r] * way[a, 1 + r]
    return total


@kernel
def world_forces(laws, force):
    """Return forces (A, 3) as normal forces (A,) and friction (A, 3) as derivatives, world axes."""
    count = force.shape[0]
    normal, shear = np.empty(count), np.empty((count, 3))
    for a in range(count):
        normal[a] = force[a, 0]
        for i in range(3):
            shear[a, i] = -(force[a, 1] * laws.rows.frame[a, 1, i]
                            + force[a, 2] * laws.rows.frame[a, 2, i])
    return normal, shear


@kernel
def put_change(system, state, hessian, laws, force, part, right):
    """Fill right (m, 3) with what changes as a part of a step is made: gradient and forces."""
    change = force - laws.first
    for j in range(right.shape[0]):
        for i in range(3):
            right[j, i] = -part * state.gradient[j, i]
    add_loads(system, hessian, laws.rows, change, right)
