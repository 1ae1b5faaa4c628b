# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's two minimizers, and how they come to end in a minimum.

Both stop where the gradient vanishes, which may be a saddle. What they reach is judged as what
Newton's method reaches, and a saddle is left in the same way: kicked along its lowest mode.
"""

import numpy as np

from dlo_planner.energy.potential import System, bend_energy, evaluate, new_state
from dlo_planner.minimize.dfp import dfp
from dlo_planner.minimize.downhill_simplex import downhill_simplex
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import MOST_KICKS, NEUTRAL, Descent, descend
from dlo_planner.minimize.protocol import Problem
from dlo_planner.minimize.saddle import kick

SEARCHES = {'dfp': dfp, 'downhill_simplex': downhill_simplex}
METHODS = ('newton', *SEARCHES)
_EPS = 2.2e-16


def search(system, q, method, tolerance):
    """Descend from q (m, 3) to a minimum of the potential, as `minimize.newton.newton` does.

    Args:
        method: key of SEARCHES
        tolerance: of the residual

    Returns:
        Minimum
    """
    problem = problem_of(system)
    iterations = evaluations = kicks = 0
    while True:
        found = SEARCHES[method](problem, q.ravel().copy(), tolerance)
        iterations, evaluations = iterations + found.iterations, evaluations + found.evaluations
        reached = judged(system, found.q.reshape(q.shape), tolerance)
        kicked = beside(system, reached)
        if kicked is None or kicks >= MOST_KICKS:
            return Minimum(reached.state, reached.residual, reached.stability, iterations, kicks,
                           system, evaluations=evaluations)
        q, kicks = kicked, kicks + 1


def near(system, q, method, tolerance, most):
    """Return strains (N, 3) on the way from q (m, 3) to a minimum, and the work that it took.

    Nothing is said of them: they are where others begin.

    Args:
        most: work, after which the search ends where it is: Newton steps, or evaluations
    """
    if method == 'newton':
        found = descend(system, q, tolerance, most, False)
        state, work = found.state, found.iterations
    else:
        found = SEARCHES[method](problem_of(system), q.ravel().copy(), tolerance, most)
        state, work = new_state(system), found.evaluations
        state.q[:] = found.q.reshape(q.shape)
        evaluate(system, state)
    return state.strains, work


def problem_of(system):
    """Return the Problem of the potential of a System, its unknowns in one row."""
    state = new_state(system)

    def value(flat):
        state.q[:] = flat.reshape(state.q.shape)
        return evaluate(system, state)[0]

    def value_and_gradient(flat):
        return value(flat), state.gradient.ravel().copy()

    return Problem(value, value_and_gradient, np.sqrt(bend_energy(system)), rounding(system))


def rounding(system):
    """Return the rounding errors of the potential in J, but for those in proportion to it."""
    weight = np.linalg.norm(system.load.pull, axis=1).sum()
    return _EPS * (weight * system.lengths.sum() + bend_energy(system))


def judged(system: System, q: np.ndarray, tolerance: float) -> Descent:
    """Return the Descent that ends at q (m, 3), where it begins."""
    return descend(system, q, tolerance, 0, True)


def beside(system: System, reached: Descent) -> np.ndarray | None:
    """Return unknowns (m, 3) beside a saddle, on the way down; None at a minimum."""
    return None if reached.stability > -NEUTRAL else kick(system, reached.state, reached.mode)
