# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A discretized DLO and all that acts on it, and what is known of it at one shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.energy.strands import ROWS
from dlo_planner.energy.terms import TERMS, Structure, Terms, structure_of, width
from dlo_planner.geometry.kinematics import new_attached
from dlo_planner.geometry.record import Record, replaced
from dlo_planner.kernels import kernel
from dlo_planner.kernels.interruption import interrupted
from dlo_planner.model.arrays import Floats

_BETWEEN = 10_000  # steps of a search of one element: 5 to 50 ms
_LOOKED_AT = 16  # elements: to look whether they are near all others takes about as long as a step
_HINGE = 1e-20  # of the stiffness of the DLO: that of a hinge is below


class Problem(Record):
    """A discretized DLO in a gripper: plain arrays, as the kernels want them.

    For Python an effect, or a field of one, is an attribute as well; `_replace` takes them, too.
    """

    lengths: Floats  # (N,) lengths of the elements, m
    natural: Floats  # (N, 3) stress-free strains, 1/m
    stiffness: Floats  # (N, 3) GJ, EI_n, EI_b, N m^2
    scale: Floats  # (N, 3) strain i = natural + scale * (basis[i] @ q[:, i], or q itself)
    basis: Floats  # (3, N, N_c) orthonormal bases at the elements; (3, 0, 0): local
    base: Floats  # (3, 3) rotation of the gripper
    origin: Floats  # (3,) its position, m
    effects: Terms  # what acts on the DLO
    needs: Structure  # what they need of the solver
    # (m, 3) unknowns to which a weak spring keeps, w |q - p|^2 / 2, a device of the minimizer; (0,
    # 3) without
    proximal_point: Floats
    proximal_weight: float  # strength of that spring

    def __getattr__(self, name: str) -> Any:
        """Read a field, an effect, or a field of an effect."""
        if name in self.FIELDS or name.startswith('_'):
            return super().__getattr__(name)
        if name in TERMS:
            return getattr(self.effects, name)
        return getattr(getattr(self.effects, self._owner(name)), name)

    def _owner(self, name: str) -> str:
        """Return the name of the effect with a field."""
        for effect in TERMS:
            if name in getattr(getattr(self.effects, effect), 'FIELDS', ()):
                return effect
        raise AttributeError(f'{name}: nothing that acts on this Problem has it')

    def _replace(self, **changes: Any) -> Problem:
        """Return the same Problem with other values of some fields, effects, fields of effects."""
        fields = {name: changes.pop(name) for name in tuple(changes) if name in self.FIELDS}
        effects = {name: changes.pop(name) for name in tuple(changes) if name in TERMS}
        for name, value in changes.items():
            owner = self._owner(name)
            effects[owner] = effects.get(owner, getattr(self.effects, owner))._replace(
                **{name: value})
        if effects:
            fields['effects'] = fields.get('effects', self.effects)._replace(**effects)
        if 'effects' in fields:
            nodes = len(fields.get('lengths', self.lengths)) + 1
            fields['needs'] = structure_of(fields['effects'], nodes)
        return super()._replace(**fields)


class Configuration(Record):
    """Everything known at one value of the unknowns (arrays, refilled in place)."""

    q: Floats  # (m, 3) unknowns
    gradient: Floats  # (m, 3) derivative of the potential by them
    strains: Floats  # (N, 3) strains of the elements, 1/m
    arcs: Floats  # (N, 7) `geometry.so3.coefficients` of the elements
    rotations: Floats  # (N + 1, 3, 3) frames of the nodes, columns t, n, b
    positions: Floats  # (N + 1, 3) positions of the nodes relative to the gripper, m
    slope: Floats  # (N, 3) derivative of the potential by the scaled strains
    pull: Floats  # (N + 1, 3) derivative of the potential by the node positions, N
    # (N + 1,) its second derivative where that is the same in all directions, N/m; (0,) where
    # displacements do not matter
    weight: Floats
    base_force: Floats  # (3,) derivative of the potential by the displacement of the gripper, N
    base_moment: Floats  # (3,) derivative of the potential by the rotation of the gripper, N m
    attached: Any  # what acts elsewhere than on the nodes; None: nothing


@kernel
def with_gripper(system, base, origin):
    """Return the same system in a gripper with rotation `base` (3, 3) at `origin` (3,)."""
    return replaced(system, 'base', base, 'origin', origin)


@kernel
def unknown_count(system):
    """Return m, the number of unknowns per strain component."""
    if system.basis.shape[1] == 0:
        return system.lengths.size
    return system.basis.shape[2]


@kernel
def hinged(system: Problem) -> bool:
    """Return whether the first element is a hinge: so soft that its stiffness does not count."""
    return system.stiffness[0, 1] < _HINGE * system.stiffness[-1, 1]


@kernel
def bending_energy(system: Problem) -> float:
    """Return twice the energy in J that bending the whole DLO evenly by 1 rad takes."""
    compliance = 0.0
    for e in range(system.lengths.size):
        softer = min(system.stiffness[e, 1], system.stiffness[e, 2])
        if e > 0 or not hinged(system):
            compliance += system.lengths[e] / softer
    return 1.0 / compliance


@kernel
def is_to_end(worked: Floats, system: Problem, cost: int) -> bool:
    """Return whether a search is to end before another step, see `kernels.interruption`.

    `worked` (1,) is what it has done since it asked; `cost` of a step, relative to one of Newton's
    method for a DLO that hangs freely. To ask takes Python's lock: it may have to wait 5 ms.
    """
    terms = system.basis.shape[2]
    worked[0] += (cost * (1.0 + terms * terms / 256.0 + _strands(system.effects.strands))
                  + _bodies(system.effects.contact)) * system.lengths.size
    if worked[0] < _BETWEEN:
        return False
    worked[0] = 0.0
    return interrupted()


@kernel
def _bodies(contact):
    """Return how many bodies a step may have to look at."""
    if contact is None:
        return 0
    return contact.scene.kind.size


@kernel
def _strands(strands):
    """Return how many solutions pairs of strands, and looking for others, take the time of."""
    if strands is None:
        return 0
    return ROWS * strands.pair.shape[0] + strands.strand_radius.size // _LOOKED_AT


@kernel
def new_configuration(system: Problem) -> Configuration:
    """Return an empty Configuration of the right sizes."""
    n = system.lengths.size
    m = unknown_count(system)
    return Configuration(np.zeros((m, 3)), np.zeros((m, 3)), np.empty((n, 3)), np.empty((n, 7)),
                         np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3)),
                         np.empty((n + 1, 3)),
                         np.zeros(n + 1 if width(system.needs.displaced) == 6 else 0), np.empty(3),
                         np.empty(3), new_attached(system.needs.attached))
