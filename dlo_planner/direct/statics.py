"""One equilibrium: from a gripper's pose and a discretisation to a Shape with its proof."""

from functools import partial

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.minimize.newton import NEUTRAL, newton

TOLERANCE = 1e-10  # of the residual; the last step of a quadratic method overshoots it
CONVERGED = 1e-8   # what is promised
_MAX_ITERATIONS = 1000


def equilibrium(discretisation, gripper, strains):
    """Return the Shape that the DLO falls into from the given strains, and how often it kicked.

    Args:
        discretisation: a Discretisation
        gripper: Pose
        strains: (N, 3) of the elements, 1/m, where the descent starts
    """
    system = discretisation.system(gripper.rotation)
    q = np.empty((discretisation.n_unknowns, 3))
    unknowns_of(system, strains, q)
    state, _, _, residual, stability, iterations, kicks = newton(
        system, q, TOLERANCE, _MAX_ITERATIONS, True)
    shape = shape_of(discretisation, gripper, system, state, residual, stability, iterations)
    return shape, kicks


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
