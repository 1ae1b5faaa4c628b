# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The total potential as a function of the unknowns: the sum over all effects, and its derivatives.

Unknowns q (m, 3): per component of strain the coefficients of an orthonormal basis (Ritz), or one
value per element (local), scaled so that the elastic energy is |q|^2 / 2 (in J).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.energy.effects import (
    EFFECTS,
    Effects,
    Needs,
    add_forces,
    add_stiffness,
    needs_of,
    width,
    with_hold,
)
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arrays import copy
from dlo_planner.ritz.kinematics import Attached, add_gradient, cleared, march, new_attached
from dlo_planner.ritz.record import Record, makes
from dlo_planner.ritz.second_order import second_order
from dlo_planner.ritz.springs import widened

_HINGE = 1e-20  # of the stiffness of the DLO: that of a hinge is below


class System(Record):
    """A discretized DLO in a gripper: plain arrays, as the kernels want them.

    For Python an effect, or a field of one, is an attribute as well; `_replace` takes them, too.

    Attributes:
        lengths: (N,) of the elements, m
        natural: (N, 3) stress-free strains, 1/m
        stiffness: (N, 3) GJ, EI_n, EI_b, N m^2
        scale: (N, 3) strain = natural + scale * (basis @ q, or q itself)
        basis: (N, N_c) orthonormal basis at the elements; (N, 0) = local
        base: (3, 3) the gripper's rotation; origin: (3,) its position, m
        effects: Effects, what acts on it; needs: what they need of the solver
        near: (m, 3) unknowns to which a weak spring of strength `tie` keeps, tie |q - near|^2 / 2,
            a device of the minimizer; (0, 3) without
    """

    lengths: Floats
    natural: Floats
    stiffness: Floats
    scale: Floats
    basis: Floats
    base: Floats
    origin: Floats
    effects: Effects
    needs: Needs
    near: Floats
    tie: float

    def __getattr__(self, name: str) -> Any:
        """Read a field, an effect, or a field of an effect."""
        if name in self.FIELDS or name.startswith('_'):
            return super().__getattr__(name)
        if name in EFFECTS:
            return getattr(self.effects, name)
        return getattr(getattr(self.effects, self._owner(name)), name)

    def _owner(self, name: str) -> str:
        """Return the name of the effect with a field."""
        for effect in EFFECTS:
            if name in getattr(getattr(self.effects, effect), 'FIELDS', ()):
                return effect
        raise AttributeError(f'{name}: nothing that acts on this System has it')

    def _replace(self, **changes: Any) -> System:
        """Return the same System with other values of some fields, effects, fields of effects."""
        fields = {name: changes.pop(name) for name in tuple(changes) if name in self.FIELDS}
        effects = {name: changes.pop(name) for name in tuple(changes) if name in EFFECTS}
        for name, value in changes.items():
            owner = self._owner(name)
            effects[owner] = effects.get(owner, getattr(self.effects, owner))._replace(
                **{name: value})
        if effects:
            fields['effects'] = fields.get('effects', self.effects)._replace(**effects)
        if 'effects' in fields:
            nodes = len(fields.get('lengths', self.lengths)) + 1
            fields['needs'] = needs_of(fields['effects'], nodes)
        return super()._replace(**fields)


@makes(System)
@kernel
def _new_system(lengths, natural, stiffness, scale, basis, base, origin, effects, needs, near,
                tie):
    return System(lengths, natural, stiffness, scale, basis, base, origin, effects, needs, near,
                  tie)


class State(Record):
    """Everything known at one value of the unknowns (arrays, refilled in place).

    Attributes:
        q, gradient: (m, 3) unknowns and derivative of the potential by them
        strains: (N, 3); rotations: (N + 1, 3, 3); positions: (N + 1, 3), relative to the gripper
        slope: (N, 3) derivative of the potential by the scaled strains
        pull: (N + 1, 3) derivative of the potential by the node positions
        weight: (N + 1,) its second derivative where that is the same in all directions, N/m; (0,)
            where displacements do not matter
        base_force, base_moment: (3,) derivative of the potential by displacement and rotation of
            the gripper
        attached: what acts elsewhere than on the nodes; None: nothing
    """

    q: Floats
    gradient: Floats
    strains: Floats
    rotations: Floats
    positions: Floats
    slope: Floats
    pull: Floats
    weight: Floats
    base_force: Floats
    base_moment: Floats
    attached: Attached | None


def tip_wrench(state: State) -> Floats:
    """Return (6,) derivative of the potential by displacement and rotation of the free end."""
    attached = state.attached
    if attached is None:
        return np.zeros(6)
    return np.concatenate([attached.tip_force, attached.tip_moment])


@kernel
def turned_system(system, base, origin):
    """Return the same system in a gripper with rotation `base` (3, 3) at `origin` (3,)."""
    return System(system.lengths, system.natural, system.stiffness, system.scale, system.basis,
                  base, origin, system.effects, system.needs, system.near, system.tie)


@kernel
def regripped_system(system, base, hold):
    """Return the same system in a gripper with rotation `base` (3, 3), its far end in `hold`."""
    return System(system.lengths, system.natural, system.stiffness, system.scale, system.basis,
                  base, system.origin, with_hold(system.effects, hold), system.needs, system.near,
                  system.tie)


@kernel
def unknown_count(system):
    """Return m, the number of unknowns per strain component."""
    if system.basis.shape[1] == 0:
        return system.lengths.size
    return system.basis.shape[1]


@kernel
def hinged(system: System) -> bool:
    """Return whether the first element is a hinge: so soft that its stiffness does not count."""
    return system.stiffness[0, 1] < _HINGE * system.stiffness[-1, 1]


@kernel
def bend_energy(system: System) -> float:
    """Return twice the energy in J that bending the whole DLO evenly by 1 rad takes."""
    compliance = 0.0
    for e in range(system.lengths.size):
        softer = min(system.stiffness[e, 1], system.stiffness[e, 2])
        if e > 0 or not hinged(system):
            compliance += system.lengths[e] / softer
    return 1.0 / compliance


@kernel
def new_state(system: System) -> State:
    """Return an empty State of the right sizes."""
    n = system.lengths.size
    m = unknown_count(system)
    return State(np.zeros((m, 3)), np.zeros((m, 3)), np.empty((n, 3)), np.empty((n + 1, 3, 3)),
                 np.empty((n + 1, 3)), np.empty((n, 3)), np.empty((n + 1, 3)),
                 np.zeros(n + 1 if width(system.needs.displaced) == 6 else 0), np.empty(3),
                 np.empty(3), new_attached(system.needs.attached))


@kernel
def unknowns_of(system: System, strains: Floats, q: Floats) -> None:
    """Fill q (m, 3) with the unknowns whose strains are nearest to `strains` (N, 3)."""
    natural, scale, lengths = system.natural, system.scale, system.lengths
    series = system.basis.shape[1] > 0
    values = np.empty(natural.shape)
    for e in range(lengths.size):
        for i in range(3):
            values[e, i] = (strains[e, i] - natural[e, i]) / scale[e, i]
            if series:
                values[e, i] *= lengths[e]
    project(system.basis, values, q)


@kernel
def _strains_of(system, q, strains):
    natural, scale = system.natural, system.scale
    values = at_elements(system.basis, q)
    for e in range(natural.shape[0]):
        for i in range(3):
            strains[e, i] = natural[e, i] + scale[e, i] * values[e, i]


@kernel
def at_elements(basis, q):
    """Return the unknowns q (m, 3) at all elements (N, 3): q itself, or the series' values."""
    values = q
    if basis.shape[1]:
        values = np.zeros((basis.shape[0], 3))
        for e in range(basis.shape[0]):
            for j in range(basis.shape[1]):
                for i in range(3):
                    values[e, i] += basis[e, j] * q[j, i]
    return values


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
def evaluate(system: System, state: State) -> tuple[float, float]:
    """Refill `state` for its q; return the potential and the size of its rounding errors, in J."""
    lengths, scale, slope, pull = system.lengths, system.scale, state.slope, state.pull
    n = lengths.size
    _strains_of(system, state.q, state.strains)
    march(lengths, state.strains, system.base, state.rotations, state.positions)
    for e in range(n):
        for i in range(3):
            slope[e, i] = 0.0
            pull[e, i] = 0.0
    for i in range(3):
        pull[n, i] = 0.0
    for k in range(state.weight.size):
        state.weight[k] = 0.0
    cleared(state.attached)
    energy, size = add_forces(system.effects, system, state)
    add_gradient(lengths, state.strains, state.rotations, state.positions, pull, state.attached,
                 slope, state.base_force, state.base_moment)
    for e in range(n):
        for i in range(3):
            slope[e, i] *= scale[e, i]
    project(system.basis, slope, state.gradient)
    for j in range(system.near.shape[0]):
        for i in range(3):
            away = state.q[j, i] - system.near[j, i]
            state.gradient[j, i] += system.tie * away
            energy += 0.5 * system.tie * away * away
            size += 0.5 * system.tie * away * away
    return energy, 2e-16 * size


@kernel
def project(basis, values, out):
    """Fill out (m, 3) with the sum over the elements of basis times values (N, 3)."""
    n, terms = basis.shape
    if terms == 0:
        copy(values, out)
        return
    for j in range(terms):
        for i in range(3):
            out[j, i] = 0.0
    for e in range(n):
        for j in range(terms):
            for i in range(3):
                out[j, i] += basis[e, j] * values[e, i]


@kernel
def element_hessian(system, state, turning, cross, diagonal, base):
    """Fill the semi-separable Hessian by the scaled strains (see `ritz.kinematics`).

    The blocks have 3 rows (columns) in statics, where only the rotation of what lies beyond
    counts, and 6 where its displacement matters as well.

    Args:
        base: (3, 3) filled: change of the dead loads' moment on the gripper per rotation of it
    """
    second_order(system.lengths, state.strains, system.scale, state.rotations, state.positions,
                 state.pull, state.attached, turning, cross, diagonal, base)
    widened(system.needs.displaced, system.lengths, state.strains, system.scale, state.rotations,
            state.positions, state.weight, state.attached, turning, cross, diagonal)
    add_stiffness(system.effects, system, state, diagonal)


def placed(system: System, strains: Floats) -> State:
    """Return the State of a System with element strains (N, 3), 1/m."""
    state: State = new_state(system)
    unknowns_of(system, strains, state.q)
    evaluate(system, state)
    return state
