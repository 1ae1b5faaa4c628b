"""Constraints by multipliers: Newton's method inside, their update outside.

The augmented Lagrangian method (Nocedal and Wright, ch. 17.4): minimise, move each multiplier by
what its constraint is violated by, repeat until nothing is violated. A DLO held at both ends may
be free to turn as a whole; there the multipliers alone would let it drift, so each round is tied
weakly to where it begins (proximal method of multipliers, Rockafellar 1976). Between two
minimisations the set of points that may touch is looked at anew, and the limits of friction follow
from the forces found. What is judged is the residual with these limits: friction has no potential.
"""

import numpy as np

from dlo_planner.energy.contact import nearest_inside, next_touching
from dlo_planner.energy.distance import signed_distance
from dlo_planner.energy.friction import trial_force
from dlo_planner.energy.hold import miss
from dlo_planner.energy.potential import bend_energy, evaluate, new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_forces import move_multipliers
from dlo_planner.minimize.friction import with_friction
from dlo_planner.minimize.newton import descend, kick, newton
from dlo_planner.minimize.touching import truth
from dlo_planner.minimize.watching import watching
from dlo_planner.ritz.kinematics import point_inside

_ROUNDS = 100
_SLOW = 0.3         # a violation that falls less than this in a round needs a stiffer spring
_STIFFER = 10.0
_MOST_STIFFER = 1e2
_BUCKLED = 0.05     # an eigenvalue below minus this is no effect of soft springs
_FIRM = 1e2         # times the stiffness of contacts' springs, where they are to hardly give
_RIGID = 3e2        # times the stiffness of the far end's springs, to judge stability
HELD_NEUTRAL = 1e-3  # as NEUTRAL, with constraints: a mesh splits what is neutral by about as much
_MOST_KICKS = 10
_TIE = 1e-4         # of the elastic stiffness: keeps a neutral shape where it is (proximal method)
_FEW, _MANY = 6, 100  # Newton steps with each soft spring, on a step's way and after a push
_COARSER = 10.0     # times the tolerance: the springs' rounding errors leave no more of it
_STALLED = 100.0    # the same, where Newton's method has found no better point
_HELPS = 0.5        # an error that falls less in a round asks for smaller steps of the multipliers
_SHARES = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.125, 0.125, 0.0)  # after so many rounds in vain
_SHORT = 1e3        # times the tolerance: a residual that Newton's method did not bring down
_PATIENCE = 80      # Newton steps in a round, before it is looked at what touches
_NEWS = 3           # rounds in a row that go without multipliers, because of what has just touched


def constrained_newton(system, q, tolerance, max_iterations, check, exact, previous):
    """Descend from q (m, 3) to a minimum that keeps all constraints; see `newton`.

    Args:
        exact: m, how far a constraint may be violated at the end
        previous: (N + 1, 6) positions, relative to the gripper of this step, and tangents of the
            nodes before it, from which friction counts; (0, 6) if there is no step before

    Returns:
        what `newton` returns, then the System at the end (with its multipliers) and the largest
        violation in m
    """
    if system.hold.offset.shape[0] == 0 and system.scene.kind.size == 0:
        state, residual, stability, iterations, kicks = newton(system, q, tolerance,
                                                               max_iterations, check)
        return state, residual, stability, iterations, kicks, system, 0.0
    tolerance *= _COARSER
    held = system.hold.offset.shape[0] > 0
    touches = system.scene.kind.size > 0
    vain = news = 0
    best = np.inf
    bend = bend_energy(system)
    iterations = kicks = 0
    before = violation = np.inf
    stiffer = 1.0
    stability, judged = np.nan, False
    pushed = None
    if held:
        q, iterations = _led(system, q, tolerance, _FEW)
    for round_ in range(_ROUNDS):
        tied = system._replace(near=q, tie=_TIE) if held else system
        state, residual, _, made, _ = newton(
            tied, q, tolerance, min(_PATIENCE, max_iterations - iterations), False)
        short = residual > _SHORT * tolerance
        iterations += made
        if check and held and round_ == 0:
            # Held straight, a DLO may need a push before its constraints can be met at all.
            _, _, lowest, _, mode = descend(tied, state.q, tolerance, 0, True)
            if lowest < -_BUCKLED:
                pushed = kick(tied, state, mode)
        if pushed is None:
            tied_by = np.linalg.norm(state.q - q) / np.sqrt(np.sum(state.q**2) + bend)
            q = state.q
            violation = 0.0
            if touches:
                contacts, new = watching(system, state)
                news = news + 1 if new or short else 0
                if len(previous):  # without a past it has slid to where it needs no friction
                    contacts = with_friction(system, contacts, state, previous)
                system = system._replace(contacts=contacts)
                state, residual, table, violation = truth(system, q)
            if held:
                residual = max(residual, _TIE * tied_by)
                violation = max(violation, _update(system, state))
            enough = residual < (_COARSER if made else _STALLED) * tolerance
            good = violation < exact and enough
            if iterations >= max_iterations or good and not check:
                break
            if good:
                stability, mode = _judged(system, state, tolerance)
                judged = True
                if stability <= -HELD_NEUTRAL and kicks < _MOST_KICKS:
                    pushed = kick(system, state, mode)
                if pushed is None:
                    break
            solved = False
            if touches and not good:
                wrong = max(violation / exact, residual / tolerance)
                vain = 0 if wrong < _HELPS * best else vain + 1
                best = min(wrong, best)
                if news % (_NEWS + 1) == 0:  # what is new has to bear before its force counts
                    share = _SHARES[min(vain, len(_SHARES) - 1)]
                    solved = move_multipliers(system, state, table, share)
            if (not good and not solved and news == 0 and violation > max(exact, _SLOW * before)
                    and stiffer < _MOST_STIFFER):
                stiffer *= _STIFFER
                system = _stiffened(system, _STIFFER)
            before = violation
        if pushed is not None:
            kicks += 1
            q, before, judged = pushed, np.inf, False
            if held:
                q, made = _led(system, q, tolerance, _MANY)
                iterations += made
            pushed = None
    if check and not judged:
        stability, _ = _judged(system, state, tolerance)
    if touches:
        final, residual, _, inside = truth(system, state.q)
        return final, residual, stability, iterations, kicks, system, max(violation, inside)
    final = new_state(system)
    final.q[:] = state.q
    evaluate(system, final)
    return final, residual, stability, iterations, kicks, system, violation


def _led(system, q, tolerance, steps):
    """Return unknowns (m, 3) nearer to where a far end is held, and the Newton steps made.

    Springs that are soft first let the DLO find its way, which stiff ones make narrow.
    """
    total = 0
    for softer in (1e-3, 1e-2, 1e-1):
        soft = _stiffened(system, softer)._replace(near=q, tie=_TIE)
        state, _, _, made, _ = newton(soft, q, tolerance, steps, False)
        q = state.q
        total += made
    return q, total


def _judged(system, state, tolerance):
    """Return the smallest eigenvalue and its mode where the far end's grip is as good as rigid.

    Springs of finite stiffness k let a shape that is neutral look unstable by O(1 / k).
    """
    _, _, stability, _, mode = descend(rigid(system, state), state.q, tolerance, 0, True)
    return stability, mode


def rigid(system, state):
    """Return the System with a far end's grip so stiff that it hardly gives, its forces the same.

    The multipliers take over what the springs' misses of up to 1e-10 of the length would add.
    """
    hold = system.hold
    if not hold.offset.shape[0]:
        return system
    stiffness = _RIGID * hold.stiffness
    multiplier = hold.multiplier.copy()
    away, arm = np.empty(3), np.empty(3)
    for p in range(len(multiplier)):
        miss(hold, p, state.rotations[-1], state.positions[-1], away, arm)
        multiplier[p] -= stiffness * away
    return system._replace(hold=hold._replace(stiffness=stiffness, multiplier=multiplier))


def firm(system, state):
    """Return the System with contacts so stiff that they hardly give, their forces the same."""
    contacts = system.contacts
    if not system.scene.kind.size:
        return system
    contacts = contacts._replace(node=contacts.node.copy(), multiplier=contacts.multiplier.copy(),
                                 shear=contacts.shear.copy())
    _keep_forces(system._replace(contacts=contacts), state, (_FIRM - 1) * contacts.stiffness)
    return system._replace(contacts=contacts._replace(stiffness=_FIRM * contacts.stiffness,
                                                      grip=_FIRM * contacts.grip))


@kernel
def _keep_forces(system, state, more):
    """Move the multipliers of what touches by what springs stiffer by `more` (N/m) would add.

    Those of friction get stiffer by the same part.
    """
    scene, contacts = system.scene, system.contacts
    k = contacts.stiffness
    x, normal, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        node = 1
        while node <= system.lengths.size:
            for i in range(3):
                x[i] = scene.origin[i] + state.positions[node, i]
            gap = signed_distance(scene, o, x, normal, bend) - scene.radius
            if contacts.node[o, node] > k * gap:
                contacts.node[o, node] += more * gap
            node = next_touching(system.lengths, contacts.node[o], node, gap)
    for c in range(contacts.element.size):
        e = contacts.element[c]
        if contacts.obstacle[c] >= 0:
            gap, _ = nearest_inside(scene, contacts.obstacle[c], e, system.lengths, state.strains,
                                    state.rotations, state.positions, normal, bend)
            if contacts.multiplier[c] > k * gap:
                contacts.multiplier[c] += more * gap
            continue
        point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                     contacts.fraction[c], bend, x)
        if trial_force(contacts, c, x, normal) <= contacts.multiplier[c]:  # it sticks
            contacts.shear[c] -= more / k * (normal - contacts.shear[c])


def _stiffened(system, factor):
    hold, contacts = system.hold, system.contacts
    return system._replace(
        hold=hold._replace(stiffness=factor * hold.stiffness),
        contacts=contacts._replace(stiffness=max(1.0, factor) * contacts.stiffness))


@kernel
def _update(system, state):
    """Move the multipliers of a far end's grip; return the largest violation in m."""
    violation = 0.0
    last = system.lengths.size
    away, arm = np.empty(3), np.empty(3)
    for p in range(system.hold.offset.shape[0]):
        miss(system.hold, p, state.rotations[last], state.positions[last], away, arm)
        system.hold.multiplier[p] += system.hold.stiffness * away
        violation = max(violation, np.sqrt(np.sum(away * away)))
    return violation
