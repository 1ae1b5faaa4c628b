"""One equilibrium: from a gripper's pose and a discretisation to a Shape with its proof."""

from functools import partial

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.potential import evaluate, new_state, unknowns_of
from dlo_planner.minimize.dfp import dfp
from dlo_planner.minimize.downhill_simplex import downhill_simplex
from dlo_planner.minimize.newton import NEUTRAL, newton
from dlo_planner.minimize.protocol import Problem

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
CONVERGED = 1e-8   # what is promised
_MAX_ITERATIONS = 1000


METHODS = ('newton', 'dfp', 'downhill_simplex')


def equilibrium(discretisation, gripper, strains, method='newton'):
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Args:
        discretisation: a Discretisation
        gripper: Pose
        strains: (N, 3) of the elements, 1/m, where the descent starts
        method: of METHODS. Only 'newton' leaves a saddle; the others may end in one, and then
            stability says so.
    """
    system = discretisation.system(gripper.rotation)
    q = np.empty((discretisation.n_unknowns, 3))
    unknowns_of(system, strains, q)
    most = _MAX_ITERATIONS
    learnt = None
    if method != 'newton':
        learnt = _descend(system, q, {'dfp': dfp, 'downhill_simplex': downhill_simplex}[method])
        q, most = learnt.q.reshape(q.shape), 0  # Newton's part is only to judge the result
    state, residual, stability, iterations, kicks = newton(system, q, TOLERANCE, most, True)
    if learnt is not None:
        iterations = learnt.iterations
    shape = shape_of(discretisation, gripper, system, state, residual, stability, iterations)
    return shape, kicks


def _descend(system, q, method):
    """Return the Minimum that `method` reaches from q (m, 3)."""
    state = new_state(system)

    def value(flat):
        state.q[:] = flat.reshape(state.q.shape)
        return evaluate(system, state)[0]

    def value_and_gradient(flat):
        return value(flat), state.gradient.ravel().copy()

    bend = np.sqrt(min(system.stiffness[1:]) / system.lengths.sum())
    return method(Problem(value, value_and_gradient, bend), q.ravel().copy(), TOLERANCE)


def shape_of(discretisation, gripper, system, state, residual, stability, iterations):
    """Return the Shape of a kernel State."""
    force = system.pull.sum(axis=0)
    energy = (0.5 * float(np.vdot(state.q, state.q)) + float(np.vdot(system.pull, state.positions))
              + float(force @ gripper.position))
    converged = bool(residual < CONVERGED and stability > -NEUTRAL)
    return Shape(gripper, discretisation.s, state.positions + gripper.position, state.rotations,
                 state.strains, energy, np.concatenate([force, state.base_moment]),
                 float(residual), float(stability), int(iterations), converged,
                 _estimate=partial(estimate_error, discretisation, gripper.rotation, state.strains,
                                   state.positions),
                 _discretisation=discretisation)


def estimate_error(discretisation, rotation, strains, positions):
    """Return how far, in m, the nodes are from the true rod's: see `Shape.error_estimate`.

    The elements are of second order, so halving them removes three quarters of their error.
    A few Newton steps from the given shape are enough: what they leave undone is far below
    what they find.
    """
    finer = discretisation.finer
    system = finer.system(rotation)
    q = np.empty((finer.n_unknowns, 3))
    unknowns_of(system, np.repeat(strains, 2, axis=0), q)
    state = newton(system, q, 1e-9, 4, False)[0]
    moved = np.linalg.norm(state.positions[::2] - positions, axis=1).max()
    rounding = 1e-15 * discretisation.s.size * discretisation.s[-1]
    return float(4 / 3 * moved + rounding)
