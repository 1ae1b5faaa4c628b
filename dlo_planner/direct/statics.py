"""One equilibrium: from a gripper's pose and a discretisation to a Shape with its proof."""

from dataclasses import replace
from functools import partial

import numpy as np

from dlo_planner.direct.contacts import contacts_of, points_of
from dlo_planner.direct.history import History
from dlo_planner.direct.moments import balanced
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.plastic import settled
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.minimize.methods import search
from dlo_planner.minimize.multipliers import HELD_NEUTRAL, constrained_newton
from dlo_planner.minimize.newton import NEUTRAL, newton

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
CONVERGED = 1e-8   # what is promised
_HELD = 1e-7       # the same with constraints, whose stiff springs multiply rounding errors
EXACT = 1e-10      # of the length: violation of a constraint aimed at
KEPT = 1e-6        # of the length: violation that still counts as converged
MAX_ITERATIONS = 1000


def equilibrium(discretisation, gripper, strains, method='newton', history=None, far_end=None):
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Args:
        discretisation: a Discretisation
        gripper: Pose
        strains: (N, 3) of the elements, 1/m, where the descent starts
        method: of METHODS
        history: History on the same mesh; None: no past
        far_end: FarEnd or None
    """
    system = discretisation.system(gripper.rotation, gripper.position, history, far_end)
    q = discretisation.unknowns(strains)
    if method == 'newton':
        found = solve(discretisation, system, gripper, q, history)
        return shape_of(discretisation, gripper, found, history, far_end), found[4]
    *found, evaluations = search(system, q, method, TOLERANCE)
    shape = shape_of(discretisation, gripper, (*found, system, 0.0), history)
    return replace(shape, evaluations=evaluations), found[4]


def solve(discretisation, system, gripper, q, history, most=MAX_ITERATIONS, check=True,
          exact=EXACT):
    """Return what `constrained_newton` returns for q (m, 3) and the past `history` or None.

    Args:
        exact: part of the length by which constraints may be violated
    """
    before = np.zeros((0, 3))
    if history is not None and len(history.positions):
        before = history.positions - gripper.position
    def solved(system, q):
        return constrained_newton(system, q, TOLERANCE, most, check,
                                  exact * discretisation.s[-1], before)

    if discretisation.surroundings.has_moments:
        return balanced(solved, system, q, discretisation.moments)
    return solved(system, q)


def shape_of(discretisation, gripper, found, history=None, far_end=None):
    """Return the Shape of a kernel's result.

    Args:
        found: state, residual, stability, iterations, kicks, system, violation
    """
    state, residual, stability, iterations, _, system, violation = found
    history = history or discretisation.start
    load = discretisation.load
    new_set, lost = history.set, 0.0
    if system.layers.share.size:
        new_set, lost = settled(system.lengths, state.strains, system.natural, system.stiffness,
                                system.layers)
        # a damper among the layers has no set
        new_set = new_set[:, :history.set.shape[1]].copy()
    if (system.natural is discretisation.natural and discretisation.isometric
            and not system.layers.share.size):
        stored = 0.5 * float(np.vdot(state.q, state.q))  # what the unknowns are scaled for
    else:
        stored = elastic_energy(discretisation, state.strains, new_set)
    energy = (stored + float(np.vdot(system.pull, state.positions))
              + float(load @ gripper.position))
    positions = state.positions + gripper.position
    touching = contacts_of(discretisation, system, state, gripper)
    past = History(discretisation.s, new_set, history.lost + lost, system.contacts.node,
                   points_of(system, state, gripper), system.hold.multiplier, positions,
                   discretisation.surroundings)
    kept = violation <= KEPT * discretisation.s[-1]
    promised, neutral = CONVERGED, NEUTRAL
    if system.scene.kind.size or far_end is not None:
        promised, neutral = _HELD, HELD_NEUTRAL
    converged = bool(residual < promised and stability > -neutral and kept)
    return Shape(gripper, discretisation.s, positions, state.rotations, state.strains, energy,
                 stored, _wrench(discretisation, state), float(residual),
                 float(stability), int(iterations), converged, contacts=touching,
                 violation=float(violation), far_end=far_end,
                 far_wrench=_NOTHING if far_end is None else _far_wrench(state),
                 dissipated=past.lost,
                 _estimate=partial(_estimate, discretisation, gripper, state.strains,
                                   state.positions, history, far_end),
                 _discretisation=discretisation, _history=past, _before=history)


def elastic_energy(discretisation, strains, plastic_set):
    """Return the stored energy in J of element strains (N, 3) with a set (N, J, 3)."""
    system = discretisation.static
    lengths = system.lengths[:, None]
    bent = strains - system.natural
    if not system.layers.share.size:
        return 0.5 * float(np.sum(lengths * system.stiffness * bent**2))
    share = system.layers.share[:, [0, 1, 1]]
    away = bent[:, None, :] - plastic_set
    return 0.5 * float(np.sum(lengths[:, :, None] * system.stiffness[:, None] * share * away**2))


_NOTHING = np.zeros(6)


def _wrench(discretisation, state):
    """Return force and moment (6,) on the DLO at its gripper."""
    moment = state.base_moment
    if discretisation.surroundings.has_moments:
        moment = moment - discretisation.moments.sum(axis=0)
    return np.concatenate([state.base_force, moment])


def _far_wrench(state):
    """Return force and moment (6,) on the DLO at its far end, about that end."""
    return -np.concatenate([state.attached.tip_force, state.attached.tip_moment])


def _estimate(discretisation, gripper, strains, positions, history, far_end):
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find.
    """
    finer = discretisation.finer
    past = finer.past(history)
    system = finer.system(gripper.rotation, gripper.position, past, far_end)
    q = np.empty((finer.n_unknowns, 3))
    unknowns_of(system, np.repeat(strains, 2, axis=0), q)
    if (system.scene.kind.size or far_end is not None or system.layers.share.size
            or discretisation.surroundings.has_moments):
        state = solve(finer, system, gripper, q, past)[0]
    else:
        state = newton(system, q, 1e-9, 4, False)[0]
    moved = np.linalg.norm(state.positions[::2] - positions, axis=1).max()
    rounding = 1e-15 * discretisation.s.size * discretisation.s[-1]
    return float(4 / 3 * moved + rounding)
