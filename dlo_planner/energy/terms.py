# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What acts on a DLO: the terms of its potential, a file each, and the kernels that ask all.

A term has a Record of what it acts by, and those of these functions that it needs (kernels but for
the last three); what it has is called below, by its own name:

    add_forces(effect, system, state)       its forces; returns its potential in J, and how large
                                            the terms are of which that is a sum
    add_stiffness(effect, system, state, diagonal)  second derivatives by the elements' strains
    roundoff(effect, system, state, length) forces whose relative rounding errors its own have, N
    forbids(effect, system, before, after)  whether it forbids the way between two states
    may_forbid(effect)                      whether it ever does
    may_act(effect, system, strains, positions, before)  whether it would have a say in a step of a
                                            DLO found without it, see `direct.statics`
    constraint_jacobian(effect, state, out) what it holds of nodes
    stored(effect, system, strains)         energy that it stores in the DLO, J
    potential(effect, system, positions)    its potential where the nodes are in the world, J
    needs(effect)                           dict: what the solver has to provide, see `Structure`
    hinged(effect, part)                    the same with one more element before the first, which
                                            has a `part` of that one's stiffness
    made(surroundings, s)                   its Record for the loads that a simulator has
                                            (`other_loads`) on nodes s; None where none is of its
                                            kind

Forces go to `state.slope` (by strains), `state.pull` (nodes) and `state.attached` (elsewhere);
their second derivatives by the nodes' places to `state.weight` and `state.attached`.

Where there is no such term it is None. numba compiles nothing of what stands behind
`if effect is None: return`, so each kernel that gets one begins with it, but for elastic and load,
which are always there.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from dlo_planner.energy import contact, elastic, grip, inertia, loads, plastic, strands
from dlo_planner.energy.contact import add_forces as contact_forces
from dlo_planner.energy.contact import forbids as contact_blocks
from dlo_planner.energy.contact import may_act as contact_acts
from dlo_planner.energy.contact import may_forbid as contact_may_block
from dlo_planner.energy.contact import roundoff as contact_noise
from dlo_planner.energy.elastic import Elastic
from dlo_planner.energy.elastic import add_forces as elastic_forces
from dlo_planner.energy.elastic import add_stiffness as elastic_stiffness
from dlo_planner.energy.elastic import stored as elastic_stored
from dlo_planner.energy.grip import add_forces as grip_forces
from dlo_planner.energy.grip import constraint_jacobian as grip_rows
from dlo_planner.energy.grip import roundoff as grip_noise
from dlo_planner.energy.inertia import add_forces as inertia_forces
from dlo_planner.energy.inertia import roundoff as inertia_noise
from dlo_planner.energy.loads import Load
from dlo_planner.energy.loads import add_forces as load_forces
from dlo_planner.energy.loads import potential as load_potential
from dlo_planner.energy.plastic import add_forces as plastic_forces
from dlo_planner.energy.plastic import add_stiffness as plastic_stiffness
from dlo_planner.energy.plastic import may_act as plastic_acts
from dlo_planner.energy.strands import ROWS
from dlo_planner.energy.strands import add_forces as strand_forces
from dlo_planner.energy.strands import forbids as strands_block
from dlo_planner.energy.strands import may_act as strands_act
from dlo_planner.energy.strands import roundoff as strand_noise
from dlo_planner.geometry.kinematics import OffNodeLoads, nothing_attached
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints


class Terms(Record):
    """What acts on a DLO: of each term its Record, or None."""

    elastic: Elastic
    plastic: Any  # Layers or None: numba compiles for each of them
    load: Load
    anchor: Any  # Anchor or None
    hold: Any  # HoldRows or None
    contact: Any  # Contact or None
    strands: Any  # Strands or None


# The Python side: `needs`, `hinged` and `made` of those that have them.
TERMS = {'elastic': elastic, 'plastic': plastic, 'load': loads, 'anchor': inertia, 'hold': grip,
         'contact': contact, 'strands': strands}


def free_terms(pull: Floats) -> Terms:
    """Return the Terms of an elastic DLO under forces `pull` (N + 1, 3) alone."""
    there = {'elastic': elastic.purely_elastic(), 'load': Load(pull)}
    return Terms(*[there.get(name) for name in Terms.FIELDS])


@kernel
def add_forces(effects, system, state):
    """Add the forces of all terms; return the potential in J, and the size of what it sums."""
    energy, size = elastic_forces(effects.elastic, system, state)
    more, terms = plastic_forces(effects.plastic, system, state)
    energy, size = energy + more, size + terms
    more, terms = load_forces(effects.load, system, state)
    energy, size = energy + more, size + terms
    more, terms = inertia_forces(effects.anchor, system, state)
    energy, size = energy + more, size + terms
    more, terms = grip_forces(effects.hold, system, state)
    energy, size = energy + more, size + terms
    more, terms = contact_forces(effects.contact, system, state)
    energy, size = energy + more, size + terms
    more, terms = strand_forces(effects.strands, system, state)
    return energy + more, size + terms


@kernel
def add_stiffness(effects, system, state, diagonal):
    """Add the second derivatives by the scaled strains to diagonal (N, 3, 3)."""
    elastic_stiffness(effects.elastic, system, state, diagonal)
    plastic_stiffness(effects.plastic, system, state, diagonal)


@kernel
def roundoff(effects, system, state, length):
    """Return forces in N whose relative rounding errors those of all terms have."""
    forces = inertia_noise(effects.anchor, system, state, length)
    forces += grip_noise(effects.hold, system, state, length)
    forces += strand_noise(effects.strands, system, state, length)
    return forces + contact_noise(effects.contact, system, state, length)


@kernel
def forbids(effects, system, before, after):
    """Whether anything forbids the way from a State to another."""
    return (contact_blocks(effects.contact, system, before, after)
            or strands_block(effects.strands, system, before, after))


@kernel
def may_forbid(effects):
    """Whether anything ever does but the DLO itself, whose strands are nowhere but where it is."""
    return contact_may_block(effects.contact)


@kernel
def may_act(effects, system, strains, positions, before):
    """Whether anything would have a say in a step that was found without it."""
    return (plastic_acts(effects.plastic, system, strains, positions, before)
            or contact_acts(effects.contact, system, strains, positions, before)
            or strands_act(effects.strands, system, strains, positions, before))


@kernel
def constraint_jacobian(effects, state, out):
    """Fill out (K, 6): what is held of nodes, by a twist of all."""
    grip_rows(effects.hold, state, out)


@kernel
def stored(effects, system, strains):
    """Return the energy that strains (N, 3) store, J."""
    return elastic_stored(effects.elastic, system, strains)


@kernel
def potential(effects, system, positions):
    """Return the potential in J of what acts at positions (N + 1, 3), world, m."""
    energy = load_potential(effects.load, system, positions)
    return energy


def hinged(effects: Terms, part: float) -> Terms:
    """Return the same Terms with one more element before the first."""
    return effects._replace(**{
        name: module.hinged(effect, part) for name, module in TERMS.items()
        if (effect := getattr(effects, name)) is not None and hasattr(module, 'hinged')})


class KKTBorder(Record):
    """What K rows that are held add to a Newton system, see `minimize.kkt`."""

    rows: Floats  # (K, m, 3) derivatives of what is held by the unknowns
    answers: Floats  # (K, m, 3) H^-1 of them
    schur: Floats  # (K, K) inverse of rows answers + give
    give: Floats  # (1,) by how much each of them gives way, m/N


class Coupling(Record):
    """What pairs of places that touch add to a Newton system, see `minimize.coupling`."""

    rows: Floats     # (R, m, 3) derivatives by the unknowns of what they couple
    answers: Floats  # (R, m, 3) H^-1 of them
    weights: Floats  # (R,) second derivatives of the potential by that, N/m
    factor: Floats   # (R, R) factors of rows answers + 1 / weights
    used: Ints       # (1,) how many rows there are


class Structure(Record):
    """What effects need of the solver; None where no effect that is there ever does."""

    # whether displacements of what lies beyond an element matter, not only rotations
    displaced: bool | None
    # an empty one of the right sizes, where forces act elsewhere than on nodes
    attached: OffNodeLoads | None
    border: KKTBorder | None  # an empty one of the right number of rows, where something is held
    coupling: Coupling | None  # an empty one of the most rows there may be, where strands touch


def structure_of(effects: Terms, nodes: int) -> Structure:
    """Return the Structure of Terms on a DLO with so many nodes."""
    asked = [module.needs(effect) for name, module in TERMS.items()
             if hasattr(module, 'needs') and (effect := getattr(effects, name)) is not None]
    if not asked:
        return _nothing_needed()
    displaced = any(one.get('displaced', False) for one in asked)
    attached = border = coupling = None
    if any('attached' in one for one in asked):
        element = np.concatenate([one.get('element', _NOWHERE) for one in asked])
        attached = nothing_attached(nodes, element)
    if any('rows' in one for one in asked):
        held = sum(one.get('rows', 0) for one in asked)
        border = KKTBorder(np.empty((held, 0, 3)), np.empty((held, 0, 3)), np.empty((0, 0)),
                           np.zeros(1))
    if any('pairs' in one for one in asked):
        most = ROWS * sum(one.get('pairs', 0) for one in asked)
        coupling = Coupling(np.empty((most, 0, 3)), np.empty((most, 0, 3)), np.empty(most),
                            np.empty((0, 0)), np.zeros(1, dtype=np.int64))
    return Structure(displaced, attached, border, coupling)


@cache
def _nothing_needed() -> Structure:
    return Structure(None, None, None, None)


_NOWHERE = np.zeros(0, dtype=np.int64)


@kernel
def new_border(border, unknowns):
    """Return an empty KKTBorder of as many rows as `border`, for (m, 3) unknowns; None for None."""
    out = border
    if border is not None:
        held = border.rows.shape[0]
        out = KKTBorder(np.empty((held, unknowns, 3)), np.empty((held, unknowns, 3)),
                        np.empty((held, held)), np.zeros(1))
    return out


@kernel
def new_coupling(coupling, unknowns):
    """Return an empty Coupling of as many rows, for (m, 3) unknowns; None for None."""
    out = coupling
    if coupling is not None:
        most = coupling.weights.size
        out = Coupling(np.empty((most, unknowns, 3)), np.empty((most, unknowns, 3)), np.empty(most),
                       np.empty((most, most)), np.zeros(1, dtype=np.int64))
    return out


@kernel
def row_count(border):
    """Return how many rows are held."""
    if border is None:
        return 0
    return border.rows.shape[0]


@kernel
def width(displaced):
    """Return how many numbers tell how what lies beyond an element moves: 6, or 3 of rotation."""
    if displaced is None:
        return 3
    return 6 if displaced else 3
