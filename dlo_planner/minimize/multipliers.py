# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The way to a minimum that keeps all constraints, by what constrains the DLO."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.contact import obstructed, trial_traction
from dlo_planner.energy.gap import closest_point, near_nodes, next_touching, node_gap
from dlo_planner.energy.grip import holds
from dlo_planner.energy.problem import Configuration, Problem, hinged
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.minimize.newton import newton
from dlo_planner.minimize.resting import bear_on, touch_down
from dlo_planner.model.arrays import Floats

_FIRM = 1e2      # times the stiffness of contacts' springs, where they are to hardly give
COARSER = 10.0  # times the tolerance: the springs' rounding errors leave no more of it


def constrained_newton(system: Problem, q: Floats, tolerance: float, max_iterations: int,
                       check: bool, exact: float, previous: Floats) -> Minimum:
    """Descend from q to a minimum that keeps all constraints.

    Parameters
    ----------
    system : Problem
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
    return newton(system, q, tolerance, max_iterations, check,
                  exact if holds(system.hold) or hinged(system) else 0.0)


def carried_newton(system: Problem, start: tuple[Floats, Floats, Floats, Floats], tolerance: float,
                   max_iterations: int, exact: float, previous: Floats) -> Minimum | None:
    """Return the Minimum in which a DLO goes on bearing as its gripper moves, or None.

    It is None where something is in its way, or where the points that bear do not go on bearing.

    Parameters
    ----------
    system : Problem
        In the gripper after the step, its contacts those before.
    start : tuple of ndarray
        Base, slid, strains, shift of `resting.bear_on`.
    tolerance, max_iterations, exact, previous
        As of `constrained_newton`.
    """
    goes_on, *end = bear_on(system, *start, COARSER * tolerance, exact, max_iterations,
                            previous)
    return Minimum(*end) if goes_on else None


def firm(system: Problem, state: Configuration) -> Problem:
    """Return the Problem with contacts so stiff that they hardly give, their forces the same."""
    if not obstructed(system.contact):
        return system
    contacts = system.contacts
    contacts = contacts._replace(node=contacts.node.copy(), multiplier=contacts.multiplier.copy(),
                                 shear=contacts.shear.copy())
    _keep_forces(system._replace(contacts=contacts), state, (_FIRM - 1) * contacts.stiffness)
    return system._replace(contacts=contacts._replace(stiffness=_FIRM * contacts.stiffness,
                                                      grip=_FIRM * contacts.grip))


@kernel
def _keep_forces(system: Problem, state: Configuration, more: float) -> None:
    """Move the multipliers of what touches by what springs stiffer by `more` (N/m) would add.

    Those of friction get stiffer by the same part.
    """
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    k = contacts.stiffness
    x, normal, hessian, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        node, last, longest = near_nodes(scene, o, state.strains)
        while node <= last:
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           hessian)
            if contacts.node[o, node] > k * gap:
                contacts.node[o, node] += more * gap
            node = next_touching(system.lengths, contacts.node[o], node, gap * longest)
    for c in range(contacts.element.size):
        e = contacts.element[c]
        if contacts.obstacle[c] >= 0:
            gap, _, _ = closest_point(scene, contacts, c, system.lengths, state.strains,
                                      state.rotations, state.positions, normal, hessian)
            if contacts.multiplier[c] > k * gap:
                contacts.multiplier[c] += more * gap
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     contacts.fraction[c], hessian, x)
        if trial_traction(contacts, c, x, normal) <= contacts.multiplier[c]:  # it sticks
            contacts.shear[c] -= more / k * (normal - contacts.shear[c])
