"""Constraints by multipliers: Newton's method inside, their update outside.

The augmented Lagrangian method (Nocedal and Wright, ch. 17.4): minimise, move each multiplier by
what its constraint is violated by, repeat until nothing is violated. A DLO held at both ends may
be free to turn as a whole; there the multipliers alone would let it drift, so each round is tied
weakly to where it begins (proximal method of multipliers, Rockafellar 1976). Between two
minimisations the set of points that may touch is looked at anew. Friction comes last: its limits
follow from the contact forces of the round before.
"""

import numpy as np

from dlo_planner.energy.contact import nearest_inside
from dlo_planner.energy.hold import violation as hold_violation
from dlo_planner.energy.outline import is_face, node_gap, nodes_of
from dlo_planner.energy.potential import evaluate, hinged, new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.friction import with_friction
from dlo_planner.minimize.held import HELD_NEUTRAL, descend_held, held_newton
from dlo_planner.minimize.newton import descend, gradient_noise, kick, newton
from dlo_planner.minimize.watching import watching

_ROUNDS = 60
_SLOW = 0.3         # a violation that falls less than this in a round needs a stiffer spring
_STIFFER = 10.0
_MOST_STIFFER = 1e2
_FIRM = 1e2         # times the stiffness of contacts' springs, where they are to hardly give
_MOST_KICKS = 10
_COARSER = 10.0     # times the tolerance: the springs' rounding errors leave no more of it
_STALLED = 100.0    # the same, where Newton's method has found no better point


def constrained_newton(system, q, tolerance, max_iterations, check, exact, previous):
    """Descend from q (m, 3) to a minimum that keeps all constraints; see `newton`.

    Args:
        exact: m, how far a constraint may be violated at the end
        previous: (N + 1, 3) node positions before the step, relative to the gripper of this one,
            from which friction counts; (0, 3) if there is no step before

    Returns:
        what `newton` returns, then the System at the end (with its multipliers) and the largest
        violation in m
    """
    held = _is_held(system)
    if not held and system.scene.kind.size == 0:
        state, residual, stability, iterations, kicks = newton(system, q, tolerance,
                                                               max_iterations, check)
        return state, residual, stability, iterations, kicks, system, 0.0
    if not system.scene.kind.size:
        state, residual, stability, iterations, kicks, violation = held_newton(
            system, q, tolerance, exact, max_iterations, check)
        return state, residual, stability, iterations, kicks, system, violation
    tolerance *= _COARSER
    slipping = bool(np.any(system.scene.friction > 0.0))
    iterations = kicks = 0
    before = violation = np.inf
    stiffer = 1.0
    stability, judged = np.nan, False
    for _ in range(_ROUNDS):
        state, residual, made = _descended(system, q, tolerance, exact, max_iterations - iterations)
        iterations += made
        q = state.q
        enough = residual < max(tolerance, gradient_noise(system, state)) * (
            _COARSER if made else _STALLED)
        system, settled = _looking_again(system, state, previous,
                                         slipping and before < 1e3 * exact)
        violation = _update(system, state)
        good = violation < exact and settled and enough
        if iterations >= max_iterations or good and not check:
            break
        if good:
            stability, mode = _judged(system, state, tolerance, exact)
            judged = True
            pushed = None
            if stability <= -HELD_NEUTRAL and kicks < _MOST_KICKS:
                pushed = kick(system, state, mode)
            if pushed is None:
                break
            kicks += 1
            q, before, judged = pushed, np.inf, False
            continue
        if violation > max(exact, _SLOW * before) and stiffer < _MOST_STIFFER:
            stiffer *= _STIFFER
            system = system._replace(contacts=system.contacts._replace(
                stiffness=_STIFFER * system.contacts.stiffness))
        before = violation
    if check and not judged:
        stability, _ = _judged(system, state, tolerance, exact)
    final = new_state(system)  # of the points that are watched at the end
    final.q[:] = state.q
    evaluate(system, final)
    return final, residual, stability, iterations, kicks, system, violation


def _is_held(system):
    """Whether a far end's grip, or a hinge at the gripper, has a say."""
    return system.hold.multiplier.size > 0 or hinged(system)


def _descended(system, q, tolerance, exact, most):
    """Return State, residual and steps of a descent with the contacts' multipliers as they are."""
    if _is_held(system):
        state, residual, _, made, _, _ = held_newton(system, q, tolerance, exact, most, False)
    else:
        state, residual, _, made, _ = newton(system, q, tolerance, most, False)
    return state, residual, made


def _looking_again(system, state, previous, slipping):
    """Return the System with the points that may touch now, and if its friction has settled."""
    if not system.scene.kind.size:
        return system, True
    settled = True
    following = system
    if slipping:
        contacts, settled = with_friction(system, state, previous)
        following = system._replace(contacts=contacts)
    return system._replace(contacts=watching(following, state)), settled


def _judged(system, state, tolerance, exact):
    """Return the smallest eigenvalue, on what a grip leaves free, and its mode."""
    if _is_held(system):
        _, _, stability, _, mode, _ = descend_held(system, state.q, tolerance, exact, 0, True)
    else:
        _, _, stability, _, mode = descend(system, state.q, tolerance, 0, True)
    return stability, mode


def firm(system, state):
    """Return the System with contacts so stiff that they hardly give, their forces the same."""
    contacts = system.contacts
    if not system.scene.kind.size:
        return system
    contacts = contacts._replace(node=contacts.node.copy(), multiplier=contacts.multiplier.copy())
    _keep_forces(system._replace(contacts=contacts), state, (_FIRM - 1) * contacts.stiffness)
    return system._replace(contacts=contacts._replace(stiffness=_FIRM * contacts.stiffness))


@kernel
def _keep_forces(system, state, more):
    """Move the multipliers of what touches by what springs stiffer by `more` (N/m) would add."""
    scene, contacts = system.scene, system.contacts
    k = contacts.stiffness
    x, normal, bend, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        if is_face(scene, o):
            continue
        begin, end = nodes_of(scene, o, system.lengths.size)
        for node in range(max(1, begin), end + 1):
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           bend)
            if contacts.node[o, node] > k * gap:
                contacts.node[o, node] += more * gap
    for c in range(contacts.element.size):
        if contacts.obstacle[c] < 0:
            continue
        gap, _ = nearest_inside(scene, contacts.obstacle[c], contacts.element[c], system.lengths,
                                state.strains, state.rotations, state.positions, normal, bend)
        if contacts.multiplier[c] > k * gap:
            contacts.multiplier[c] += more * gap


@kernel
def _update(system, state):
    """Move all multipliers; return the largest violation in m."""
    violation = 0.0
    last = system.lengths.size
    if system.hold.multiplier.size:  # its reaction is found with the shape
        violation = hold_violation(system.hold, state.rotations[last], state.positions[last])
    scene, contacts = system.scene, system.contacts
    k = contacts.stiffness
    x, normal, bend, offset = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(2)
    for o in range(scene.kind.size):
        if is_face(scene, o):
            continue
        begin, end = nodes_of(scene, o, last)
        for node in range(max(1, begin), end + 1):
            gap = node_gap(scene, o, node, state.rotations, state.positions, offset, x, normal,
                           bend)
            violation = max(violation, abs(min(gap, contacts.node[o, node] / k)))
            contacts.node[o, node] = max(0.0, contacts.node[o, node] - k * gap)
    for c in range(contacts.element.size):
        if contacts.obstacle[c] < 0:
            continue
        gap, _ = nearest_inside(scene, contacts.obstacle[c], contacts.element[c], system.lengths,
                                state.strains, state.rotations, state.positions, normal, bend)
        violation = max(violation, abs(min(gap, contacts.multiplier[c] / k)))
        contacts.multiplier[c] = max(0.0, contacts.multiplier[c] - k * gap)
    return violation
