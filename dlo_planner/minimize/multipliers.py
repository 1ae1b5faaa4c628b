# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The way to a minimum that keeps all constraints, by what constrains the DLO."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import next_touching, obstructed
from dlo_planner.energy.friction import trial_force
from dlo_planner.energy.hold import holds
from dlo_planner.energy.outline import is_face, longest_stretch, node_gap, nodes_of
from dlo_planner.energy.rolling import watched
from dlo_planner.energy.system import State, System, hinged
from dlo_planner.kernels import kernel
from dlo_planner.minimize.held import held_newton
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import newton
from dlo_planner.minimize.resting import bear_on, touch_down
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.kinematics import point_inside

_FIRM = 1e2      # times the stiffness of contacts' springs, where they are to hardly give
COARSER = 10.0  # times the tolerance: the springs' rounding errors leave no more of it


def constrained_newton(system: System, q: Floats, tolerance: float, max_iterations: int,
                       check: bool, exact: float, previous: Floats) -> Minimum:
    """Descend from q to a minimum that keeps all constraints.

    Parameters
    ----------
    system : System
        The DLO; the multipliers of its constraints are where the search begins.
    q : ndarray, shape (m, 3)
        Start, scaled unknowns.
    tolerance, max_iterations, check
        As of `newton.newton`.
    exact : float
        How far a constraint may be violated at the end, m.
    previous : ndarray, shape (N + 1, 6)
        Positions, m, relative to the gripper of this step, and tangents of the nodes before it,
        from which friction counts. (0, 6) if there is no step before.
    """
    if obstructed(system.contact):
        end = touch_down(system, q, COARSER * tolerance, exact, max_iterations, check, previous)
        return Minimum(*end)
    if holds(system.hold) or hinged(system):
        return held_newton(system, q, tolerance, exact, max_iterations, check)
    return newton(system, q, tolerance, max_iterations, check)


def carried_newton(system: System, start: tuple[Floats, Floats, Floats, Floats], tolerance: float,
                   max_iterations: int, exact: float, previous: Floats) -> Minimum | None:
    """Return the Minimum in which a DLO goes on bearing as its gripper moves, or None.

    It is None where something is in its way, or where the points that bear do not go on bearing.

    Parameters
    ----------
    system : System
        In the gripper after the step, its contacts those before.
    start : tuple of ndarray
        Base, slid, strains, shift of `resting.bear_on`.
    tolerance, max_iterations, exact, previous
        As of `constrained_newton`.
    """
    goes_on, *end = bear_on(system, *start, COARSER * tolerance, exact, max_iterations,
                            previous)
    return Minimum(*end) if goes_on else None


def firm(system: System, state: State) -> System:
    """Return the System with contacts so stiff that they hardly give, their forces the same."""
    if not obstructed(system.contact):
        return system
    contacts = system.contacts
    contacts = contacts._replace(node=contacts.node.copy(), multiplier=contacts.multiplier.copy(),
                                 shear=contacts.shear.copy())
    _keep_forces(system._replace(contacts=contacts), state, (_FIRM - 1) * contacts.stiffness)
    return system._replace(contacts=contacts._replace(stiffness=_FIRM * contacts.stiffness,
                                                      grip=_FIRM * contacts.grip))


@kernel
def _keep_forces(system: System, state: State, more: float) -> None:
    """Move the multipliers of what touches by what springs stiffer by `more` (N/m) would add.

    Those of friction get stiffer by the same part.
    """
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    k = contacts.stiffness
    x, normal, hessian, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        if is_face(scene, o):
            continue
        longest = longest_stretch(scene, o, state.strains)
        begin, end = nodes_of(scene, o, system.lengths.size)
        node = max(1, begin)
        while node <= end:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           hessian)
            if contacts.node[o, node] > k * gap:
                contacts.node[o, node] += more * gap
            node = next_touching(system.lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        e = contacts.element[c]
        if contacts.obstacle[c] >= 0:
            gap, _, _ = watched(scene, contacts, c, system.lengths, state.strains,
                                state.rotations, state.positions, normal, hessian)
            if contacts.multiplier[c] > k * gap:
                contacts.multiplier[c] += more * gap
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     contacts.fraction[c], hessian, x)
        if trial_force(contacts, c, x, normal) <= contacts.multiplier[c]:  # it sticks
            contacts.shear[c] -= more / k * (normal - contacts.shear[c])
