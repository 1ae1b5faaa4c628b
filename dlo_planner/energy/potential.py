# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The total potential as a function of the unknowns: the list of terms, and nothing else.

Unknowns q (m, 3): per component of strain the coefficients of an orthonormal basis (Ritz), or one
value per element (local), scaled so that the elastic energy is |q|^2 / 2 (in J).
"""

import numpy as np

from dlo_planner.energy.contact import Contacts, add_contacts
from dlo_planner.energy.distance import Scene
from dlo_planner.energy.elastic import add_elastic
from dlo_planner.energy.hold import Hold, add_hold
from dlo_planner.energy.inertia import add_anchor
from dlo_planner.energy.loads import dead_load
from dlo_planner.energy.outline import has_section
from dlo_planner.energy.plastic import Layers, add_plastic, add_plastic_stiffness
from dlo_planner.kernels import kernel
from dlo_planner.ritz.kinematics import Attached, add_gradient, march, nothing_attached
from dlo_planner.ritz.record import Record, makes
from dlo_planner.ritz.second_order import add_stiffness, second_order

_HINGE = 1e-20  # of the stiffness of the DLO: that of a hinge is below


class System(Record):
    """A discretized DLO in a gripper: plain arrays, as the kernels want them.

    Attributes:
        lengths: (N,) of the elements, m
        natural: (N, 3) stress-free strains, 1/m
        stiffness: (N, 3) GJ, EI_n, EI_b, N m^2
        scale: (N, 3) strain = natural + scale * (basis @ q, or q itself)
        basis: (N, N_c) orthonormal basis at the elements; (N, 0) = local
        pull: (N + 1, 3) derivative of the dead loads' potential by the node positions, N
        base: (3, 3) the gripper's rotation
        anchor: (N + 1, 3) relative to the gripper, m, and anchor_weight: (N + 1,) N/m: see
            `energy.inertia`; both empty in statics
        layers: see `energy.plastic`; hold: `energy.hold`; scene: `energy.distance`; contacts:
            `energy.contact`; each empty without its effect
        near: (m, 3) unknowns to which a weak spring of strength `tie` keeps, tie |q - near|^2 / 2,
            a device of the minimizer; (0, 3) without
    """

    lengths: np.ndarray
    natural: np.ndarray
    stiffness: np.ndarray
    scale: np.ndarray
    basis: np.ndarray
    pull: np.ndarray
    base: np.ndarray
    anchor: np.ndarray
    anchor_weight: np.ndarray
    layers: Layers
    hold: Hold
    scene: Scene
    contacts: Contacts
    near: np.ndarray
    tie: float


@makes(System)
@kernel
def _new_system(lengths, natural, stiffness, scale, basis, pull, base, anchor, anchor_weight,
                layers, hold, scene, contacts, near, tie):
    return System(lengths, natural, stiffness, scale, basis, pull, base, anchor, anchor_weight,
                  layers, hold, scene, contacts, near, tie)


class State(Record):
    """Everything known at one value of the unknowns (arrays, refilled in place).

    Attributes:
        q, gradient: (m, 3) unknowns and derivative of the potential by them
        strains: (N, 3); rotations: (N + 1, 3, 3); positions: (N + 1, 3), relative to the gripper
        slope: (N, 3) derivative of the potential by the scaled strains
        pull: (N + 1, 3) derivative of the potential by the node positions
        base_force, base_moment: (3,) derivative of the potential by displacement and rotation of
            the gripper
        attached: what acts elsewhere than on the nodes
    """

    q: np.ndarray
    gradient: np.ndarray
    strains: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    slope: np.ndarray
    pull: np.ndarray
    base_force: np.ndarray
    base_moment: np.ndarray
    attached: Attached


@kernel
def turned_system(system, base):
    """Return the same system in a gripper with rotation `base` (3, 3)."""
    return System(system.lengths, system.natural, system.stiffness, system.scale, system.basis,
                  system.pull, base, system.anchor, system.anchor_weight, system.layers,
                  system.hold, system.scene, system.contacts, system.near, system.tie)


@kernel
def regripped_system(system, base, hold):
    """Return the same system in a gripper with rotation `base` (3, 3), its far end in `hold`."""
    return System(system.lengths, system.natural, system.stiffness, system.scale, system.basis,
                  system.pull, base, system.anchor, system.anchor_weight, system.layers,
                  hold, system.scene, system.contacts, system.near, system.tie)


@kernel
def twists_count(system):
    """Return whether displacements of what lies beyond an element matter, not only rotations."""
    return (system.anchor_weight.size + system.hold.multiplier.size + system.scene.kind.size) > 0


@kernel
def unknown_count(system):
    """Return m, the number of unknowns per strain component."""
    if system.basis.shape[1] == 0:
        return system.lengths.size
    return system.basis.shape[1]


@kernel
def hinged(system):
    """Return whether the first element is a hinge: so soft that its stiffness does not count."""
    return system.stiffness[0, 1] < _HINGE * system.stiffness[-1, 1]


@kernel
def bend_energy(system):
    """Return twice the energy in J that bending the whole DLO evenly by 1 rad takes."""
    compliance = 0.0
    for e in range(system.lengths.size):
        softer = min(system.stiffness[e, 1], system.stiffness[e, 2])
        if e > 0 or not hinged(system):
            compliance += system.lengths[e] / softer
    return 1.0 / compliance


@kernel
def new_state(system):
    """Return an empty State of the right sizes."""
    n = system.lengths.size
    m = unknown_count(system)
    return State(np.zeros((m, 3)), np.zeros((m, 3)), np.empty((n, 3)), np.empty((n + 1, 3, 3)),
                 np.empty((n + 1, 3)), np.empty((n, 3)), np.empty((n + 1, 3)), np.empty(3),
                 np.empty(3), nothing_attached(n + 1 if system.scene.kind.size else 0,
                                               system.contacts.element,
                                               has_section(system.scene)))


@kernel
def unknowns_of(system, strains, q):
    """Fill q (m, 3) with the unknowns whose strains are nearest to `strains` (N, 3)."""
    values = (strains - system.natural) / system.scale
    if system.basis.shape[1] > 0:
        for e in range(system.lengths.size):
            values[e] *= system.lengths[e]
    project(system.basis, values, q)


@kernel
def _strains_of(system, q, strains):
    natural, scale, basis = system.natural, system.scale, system.basis
    for e in range(natural.shape[0]):
        for i in range(3):
            strains[e, i] = natural[e, i] + scale[e, i] * at_element(basis, q, e, i)


@kernel(inline='always')
def at_element(basis, q, e, i):
    """Return component i of the unknowns q (m, 3) at element e: the series' value there."""
    if basis.shape[1] == 0:
        return q[e, i]
    value = 0.0
    for j in range(basis.shape[1]):
        value += basis[e, j] * q[j, i]
    return value


@kernel
def evaluate(system, state):
    """Refill `state` for its q; return the potential and the size of its rounding errors, in J.

    A new effect (a file of this folder) adds its energy and its derivatives here.
    """
    n = system.lengths.size
    _strains_of(system, state.q, state.strains)
    march(system.lengths, state.strains, system.base, state.rotations, state.positions)
    state.slope[:] = 0.0
    if system.layers.share.shape[0]:
        elastic = add_plastic(system.lengths, state.strains, system.natural, system.stiffness,
                              system.layers, state.slope)
    else:
        elastic = add_elastic(system.lengths, state.strains, system.natural, system.stiffness,
                              state.slope)
    state.pull[:] = system.pull
    load, size = dead_load(system.pull, state.positions)
    other = add_anchor(system.anchor, system.anchor_weight, state.positions, state.pull)
    if system.hold.multiplier.size:
        other += add_hold(system.hold, state.rotations[n], state.positions[n], state.attached)
    if system.scene.kind.size:
        other += add_contacts(system.scene, system.contacts, system.lengths, state.strains,
                              state.rotations, state.positions, state.pull, state.attached)
    state.base_force[:], state.base_moment[:] = add_gradient(
        system.lengths, state.strains, state.rotations, state.positions, state.pull,
        state.attached, state.slope)
    slope, scale = state.slope, system.scale
    for e in range(n):
        for i in range(3):
            slope[e, i] *= scale[e, i]
    project(system.basis, slope, state.gradient)
    for j in range(system.near.shape[0]):
        for i in range(3):
            away = state.q[j, i] - system.near[j, i]
            state.gradient[j, i] += system.tie * away
            other += 0.5 * system.tie * away * away
    return elastic + load + other, 2e-16 * (elastic + size + abs(other))


@kernel
def project(basis, values, out):
    """Fill out (m, 3) with the sum over the elements of basis times values (N, 3)."""
    n, terms = basis.shape
    if terms == 0:
        out[:] = values
        return
    out[:] = 0.0
    for e in range(n):
        for j in range(terms):
            for i in range(3):
                out[j, i] += basis[e, j] * values[e, i]


@kernel
def element_hessian(system, state, turning, cross, diagonal):
    """Fill the semi-separable Hessian by the scaled strains (see `ritz.kinematics`).

    The blocks have 3 rows (columns) in statics, where only the rotation of what lies beyond
    counts, and 6 where its displacement matters as well.

    Returns the (3, 3) change of the dead loads' moment on the gripper per rotation of it.
    """
    base = second_order(system.lengths, state.strains, system.scale, state.rotations,
                        state.positions, state.pull, state.attached, turning, cross, diagonal)
    if turning.shape[1] > 3:
        add_stiffness(system.lengths, state.strains, system.scale, state.rotations,
                      state.positions, system.anchor_weight, state.attached, turning, cross,
                      diagonal)
    if system.layers.share.shape[0]:
        add_plastic_stiffness(system.lengths, state.strains, system.natural, system.stiffness,
                              system.layers, system.scale, diagonal)
        return base
    lengths, stiffness, scale = system.lengths, system.stiffness, system.scale
    for e in range(lengths.size):
        for i in range(3):
            diagonal[e, i, i] += lengths[e] * stiffness[e, i] * scale[e, i] ** 2
    return base


def placed(system, strains):
    """Return the State of a System with element strains (N, 3)."""
    state = new_state(system)
    unknowns_of(system, strains, state.q)
    evaluate(system, state)
    return state
