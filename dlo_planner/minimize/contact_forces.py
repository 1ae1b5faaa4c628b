"""The forces of contact and friction that satisfy their laws, to first order.

A step of the outer loop. With the compliance of the DLO at its contacts, from solves with Newton's
Hessian, all multipliers follow at once: no gap where it bears, no sliding where it sticks, mu times
the force where it slides (semismooth Newton method, Alart and Curnier 1991). Where that cannot be
trusted each multiplier becomes the force that it has (augmented Lagrangian).
"""

import numpy as np

from dlo_planner.energy.friction import trial_force
from dlo_planner.energy.potential import project
from dlo_planner.kernels import kernel
from dlo_planner.minimize.linear import assemble, factorise, new_hessian, solve
from dlo_planner.ritz.kinematics import part_of_element, point_inside

_SOFT = 1e-4      # of a spring's compliance, added: contacts that depend on each other share
_FARTHEST = 0.02  # of the length: a prediction that moves a contact farther is none


@kernel
def move_multipliers(system, state, table, at_once):
    """Move the multipliers of `system`, in place, to what the laws ask for.

    Args:
        state, table: State and Touching at the minimum for the present multipliers
        at_once: whether to use the compliance of the DLO

    Returns:
        whether it was used
    """
    normal, shear = table.force.copy(), np.zeros((table.gap.size, 3))
    for a in range(table.gap.size):
        if table.rubbing[a] >= 0:
            shear[a] = state.attached.force[table.rubbing[a]]
    used = at_once and table.gap.size > 0 and _solved(system, state, table, normal, shear)
    contacts, friction = system.contacts, system.scene.friction
    contacts.node[:] = 0.0
    for c in range(contacts.element.size):
        if contacts.obstacle[c] >= 0:
            contacts.multiplier[c] = 0.0
    for a in range(table.gap.size):
        o, e, c = table.obstacle[a], table.element[a], table.rubbing[a]
        force = max(0.0, normal[a])
        if table.inside[a] < 0:
            contacts.node[o, e + 1] = force
        else:
            contacts.multiplier[table.inside[a]] = force
        if c >= 0:
            limit = friction[o] * force
            contacts.multiplier[c] = limit
            size = max(limit, np.sqrt(np.sum(shear[a] ** 2)))
            for i in range(3):
                contacts.shear[c, i] = shear[a, i] * limit / size if size > 0.0 else 0.0
    return used


@kernel
def _solved(system, state, table, normal, shear):
    """Fill normal (A,) and shear (A, 3) with the forces of the linearised laws; return if done."""
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    if factorise(system, hessian, 0.0) > 0:
        return False
    count = table.gap.size
    first = np.empty(count, dtype=np.int64)  # row of the normal; of a friction's two, the next
    size = 0
    for a in range(count):
        first[a] = size
        size += 1 if table.rubbing[a] < 0 else 3
    axes, laws = np.zeros((size, 3)), np.zeros((size, 3))
    _linearise(system, state, table, first, axes, laws)
    loads, answers = _answers(system, state, hessian, table, first, axes)
    compliance = loads @ answers.T
    shift = np.zeros(size)  # of the limits, to those of the multipliers as they are
    for a in range(count):
        if table.rubbing[a] >= 0 and laws[first[a] + 1, 0] > 0.0:
            shift[first[a] + 1] = laws[first[a] + 1, 2] * system.contacts.stiffness * table.gap[a]
    free = -answers @ state.gradient.copy().reshape(-1) - compliance @ shift
    reaction = compliance @ _effect(table, first, laws)
    matrix, right = _equations(system, table, first, laws, reaction, free)
    sign, _ = np.linalg.slogdet(matrix)
    if not sign > 0.0:  # what slides does so by itself: no multipliers hold it there
        return False
    change = np.linalg.solve(matrix, right)
    moved = free - reaction @ change
    farthest = _FARTHEST * np.sum(system.lengths)
    for i in range(size):
        if not abs(moved[i]) < farthest:
            return False
    k = system.contacts.stiffness
    for a in range(count):
        i = first[a]
        normal[a] += k * table.gap[a] + change[i]
        if table.rubbing[a] >= 0:
            shear[a] = (system.contacts.shear[table.rubbing[a]] + change[i + 1] * axes[i + 1]
                        + change[i + 2] * axes[i + 2])
    return True


@kernel
def _linearise(system, state, table, first, axes, laws):
    """Fill axes (K, 3): normal, direction of friction, third; and laws (K, 3) of the friction.

    Laws: in the second row whether it slides, the limit's part of the trial force, mu; in the third
    the multiplier's components along both axes and the trial force.
    """
    contacts = system.contacts
    rotation, x, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        n = table.normal[a]
        axes[i] = n
        if c < 0:
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions,
                     contacts.element[c], contacts.fraction[c], rotation, x)
        size = trial_force(contacts, c, x, trial)
        limit = contacts.multiplier[c]
        slides = size > limit
        if slides:
            axes[i + 1] = trial / size
        else:
            least = np.argmin(np.abs(n))
            axes[i + 1, least] = 1.0
            axes[i + 1] -= n[least] * n
            axes[i + 1] /= np.sqrt(np.sum(axes[i + 1] ** 2))
        for j in range(3):
            axes[i + 2, j] = (n[(j + 1) % 3] * axes[i + 1, (j + 2) % 3]
                              - n[(j + 2) % 3] * axes[i + 1, (j + 1) % 3])
        laws[i + 1, 0] = 1.0 if slides else 0.0
        laws[i + 1, 1] = limit / size if slides else 1.0
        laws[i + 1, 2] = system.scene.friction[table.obstacle[a]]
        laws[i + 2, 0] = np.sum(contacts.shear[c] * axes[i + 1])
        laws[i + 2, 1] = np.sum(contacts.shear[c] * axes[i + 2])
        laws[i + 2, 2] = np.sum(trial * axes[i + 1])
        if not slides:
            laws[i + 1, 2] = np.sum(trial * axes[i + 2])


@kernel
def _answers(system, state, hessian, table, first, axes):
    """Return (K, 3 m) unit forces at the contacts along `axes`, as loads, and what they answer."""
    size, m = axes.shape[0], state.q.shape[0]
    loads, answers = np.empty((size, 3 * m)), np.empty((size, 3 * m))
    load, answer = np.empty((m, 3)), np.empty((m, 3))
    for a in range(table.gap.size):
        for i in range(first[a], first[a] + (1 if table.rubbing[a] < 0 else 3)):
            unit_load(system, state, hessian, table.element[a], table.fraction[a], axes[i], load)
            solve(system, hessian, load, answer)
            loads[i], answers[i] = load.reshape(-1), answer.reshape(-1)
    return loads, answers


@kernel
def unit_load(system, state, hessian, element, fraction, axis, load):
    """Fill load (m, 3): change of the displacement along `axis` of a point, by the unknowns."""
    n = system.lengths.size
    rows = np.zeros((n, 3))
    part, arm = np.empty((6, 3)), np.empty(3)
    part_of_element(system.lengths[element], fraction, state.strains[element],
                    system.scale[element], state.rotations[element], part, arm)
    moment = np.empty(3)
    for i in range(3):
        arm[i] += state.positions[element, i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moment[i] = arm[j] * axis[k] - arm[k] * axis[j]
    for e in range(element):
        for j in range(3):
            for k in range(3):
                rows[e, j] += (hessian.turning[e, k, j] * moment[k]
                               + hessian.turning[e, 3 + k, j] * axis[k])
    for j in range(3):
        for k in range(3):
            rows[element, j] += part[3 + k, j] * axis[k]
    project(system.basis, rows, load)


@kernel
def _effect(table, first, laws):
    """Return (K, K): what the multipliers' changes add to the potential's slope at the contacts."""
    effect = np.zeros((laws.shape[0], laws.shape[0]))
    for a in range(table.gap.size):
        i = first[a]
        effect[i, i] = -1.0
        if table.rubbing[a] >= 0:
            slides = laws[i + 1, 0] > 0.0
            effect[i + 1, i] = laws[i + 1, 2] if slides else 0.0
            effect[i + 1, i + 1] = 0.0 if slides else 1.0
            effect[i + 2, i + 2] = laws[i + 1, 1]
    return effect


@kernel
def _equations(system, table, first, laws, reaction, free):
    """Return matrix (K, K) and right side (K,) for the changes of the multipliers.

    Args:
        reaction: (K, K) displacement of the contacts against such changes
        free: (K,) displacement that the gradient left over makes
    """
    size = free.size
    k, grip = system.contacts.stiffness, system.contacts.grip
    matrix, right = np.zeros((size, size)), np.empty(size)
    for a in range(table.gap.size):
        i, c = first[a], table.rubbing[a]
        matrix[i] = -k * reaction[i]
        matrix[i, i] += _SOFT
        right[i] = -k * (table.gap[a] + free[i])
        if c < 0:
            continue
        limit = system.contacts.multiplier[c]
        along, across, trial = laws[i + 2]
        part = laws[i + 1, 1]
        if laws[i + 1, 0] > 0.0:
            matrix[i + 1, i + 1] = 1.0
            matrix[i + 1, i] = -laws[i + 1, 2]
            # the limit is that of the force here; the multiplier's change counts from m
            right[i + 1] = limit - along + laws[i + 1, 2] * k * table.gap[a]
            matrix[i + 2] = grip * part * reaction[i + 2]
            matrix[i + 2, i + 2] += 1.0 - part
            right[i + 2] = -across + grip * part * free[i + 2]
        else:
            for j, slid in ((1, trial - along), (2, laws[i + 1, 2] - across)):
                matrix[i + j] = grip * reaction[i + j]
                matrix[i + j, i + j] += _SOFT
                right[i + j] = slid + grip * free[i + j]
    return matrix, right
