"""One equilibrium: from a gripper's pose and a discretisation to a Shape with its proof."""

from dataclasses import replace
from functools import partial

import numpy as np

from dlo_planner.direct.contacts import contacts_of, points_of
from dlo_planner.direct.history import History
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.plastic import settled
from dlo_planner.energy.potential import bend_energy, evaluate, new_state, unknowns_of
from dlo_planner.minimize.dfp import dfp
from dlo_planner.minimize.downhill_simplex import downhill_simplex
from dlo_planner.minimize.multipliers import HELD_NEUTRAL, constrained_newton
from dlo_planner.minimize.newton import NEUTRAL, newton
from dlo_planner.minimize.protocol import Problem

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
CONVERGED = 1e-8   # what is promised
_HELD = 1e-7       # the same with constraints, whose stiff springs multiply rounding errors
EXACT = 1e-10      # of the length: violation of a constraint aimed at
KEPT = 1e-6        # of the length: violation that still counts as converged
_ELSEWHERE = 0.1   # of the length: a shape in contact that moves so far is another one
MAX_ITERATIONS = 1000


METHODS = ('newton', 'dfp', 'downhill_simplex')


def equilibrium(discretisation, gripper, strains, method='newton', history=None, far_end=None):
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Args:
        discretisation: a Discretisation
        gripper: Pose
        strains: (N, 3) of the elements, 1/m, where the descent starts
        method: of METHODS. Only 'newton' leaves a saddle; the others may end in one, and then
            stability says so.
        history: History on the same mesh; None: no past
        far_end: FarEnd or None
    """
    system = discretisation.system(gripper.rotation, gripper.position, history, far_end)
    q = discretisation.unknowns(strains)
    most = MAX_ITERATIONS
    learnt = None
    if method != 'newton':
        learnt = _descend(system, q, {'dfp': dfp, 'downhill_simplex': downhill_simplex}[method])
        q, most = learnt.q.reshape(q.shape), 0  # Newton's part is only to judge the result
    found = solve(discretisation, system, gripper, q, history, most)
    shape = shape_of(discretisation, gripper, found, history, far_end)
    if learnt is not None:
        shape = replace(shape, iterations=learnt.iterations, evaluations=learnt.evaluations)
    return shape, found[4]


def solve(discretisation, system, gripper, q, history, most=MAX_ITERATIONS, check=True,
          exact=EXACT):
    """Return what `constrained_newton` returns for q (m, 3) and the past `history` or None.

    Args:
        exact: part of the length by which constraints may be violated
    """
    before = np.zeros((0, 6))
    if history is not None and len(history.positions):
        before = np.hstack([history.positions - gripper.position, history.tangents])
    return constrained_newton(system, q, TOLERANCE, most, check, exact * discretisation.s[-1],
                              before)


def _descend(system, q, method):
    """Return the Minimum that `method` reaches from q (m, 3)."""
    state = new_state(system)

    def value(flat):
        state.q[:] = flat.reshape(state.q.shape)
        return evaluate(system, state)[0]

    def value_and_gradient(flat):
        return value(flat), state.gradient.ravel().copy()

    bend = np.sqrt(bend_energy(system))
    return method(Problem(value, value_and_gradient, bend), q.ravel().copy(), TOLERANCE)


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
    if system.natural is discretisation.natural and not system.layers.share.size:
        stored = 0.5 * float(np.vdot(state.q, state.q))  # what the unknowns are scaled for
    else:
        stored = elastic_energy(discretisation, state.strains, new_set)
    energy = (stored + float(np.vdot(system.pull, state.positions))
              + float(load @ gripper.position))
    positions = state.positions + gripper.position
    touching = contacts_of(discretisation, system, state, gripper)
    past = History(discretisation.s, new_set, history.lost + lost, system.contacts.node,
                   points_of(system, state, gripper), system.hold.multiplier, positions,
                   state.rotations[:, :, 0].copy(), discretisation.surroundings)
    kept = violation <= KEPT * discretisation.s[-1]
    promised, neutral = CONVERGED, NEUTRAL
    if system.scene.kind.size or far_end is not None:
        promised, neutral = _HELD, HELD_NEUTRAL
    converged = bool(residual < promised and stability > -neutral and kept)
    return Shape(gripper, discretisation.s, positions, state.rotations, state.strains, energy,
                 stored, np.concatenate([state.base_force, state.base_moment]), float(residual),
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


def _far_wrench(state):
    """Return force and moment (6,) on the DLO at its far end, about that end."""
    return -np.concatenate([state.attached.tip_force, state.attached.tip_moment])


def _estimate(discretisation, gripper, strains, positions, history, far_end):
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find. In contact it may be that the finer DLO finds no equilibrium nearby, let go by
    friction for instance: then nothing is known, and the estimate is infinite.
    """
    finer = discretisation.finer
    past = finer.past(history)
    system = finer.system(gripper.rotation, gripper.position, past, far_end)
    q = np.empty((finer.n_unknowns, 3))
    unknowns_of(system, np.repeat(strains, 2, axis=0), q)
    if system.scene.kind.size or far_end is not None or system.layers.share.size:
        state, residual, stability, *_, violation = solve(finer, system, gripper, q, past)
        if not (residual < _HELD and stability > -HELD_NEUTRAL
                and violation <= KEPT * discretisation.s[-1]):
            return np.inf
    else:
        state = newton(system, q, 1e-9, 4, False)[0]
    moved = np.linalg.norm(state.positions[::2] - positions, axis=1).max()
    if system.scene.kind.size and moved > _ELSEWHERE * discretisation.s[-1]:
        return np.inf
    rounding = 1e-15 * discretisation.s.size * discretisation.s[-1]
    return float(4 / 3 * moved + rounding)
