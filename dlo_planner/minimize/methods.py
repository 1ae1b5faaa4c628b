# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's two minimizers, and how they come to end in a minimum.

Both stop where the gradient vanishes, which may be a saddle. What they reach is judged as what
Newton's method reaches, and a saddle is left in the same way: kicked along its lowest mode.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import State, System, bending_energy, new_state
from dlo_planner.minimize.dfp import dfp
from dlo_planner.minimize.downhill_simplex import downhill_simplex
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.minimize.newton import MOST_KICKS, NEUTRAL, Descent, descend
from dlo_planner.minimize.protocol import Ended, Problem
from dlo_planner.minimize.saddle import kick
from dlo_planner.model.arrays import Floats

SEARCHES: dict[str, Callable[..., Ended]] = {'dfp': dfp, 'downhill_simplex': downhill_simplex}
METHODS = ('newton', *SEARCHES)
_EPS = 2.2e-16


def search(system: System, q: Floats, method: str, tolerance: float) -> Minimum:
    """Descend from q to a minimum of the potential, as `minimize.newton.newton` does.

    Parameters
    ----------
    system : System
        The DLO.
    q : ndarray, shape (m, 3)
        Start, scaled unknowns.
    method : str
        One of SEARCHES.
    tolerance : float
        Largest residual at the end.
    """
    problem = problem_of(system)
    iterations = evaluations = kicks = 0
    while True:
        end = SEARCHES[method](problem, q.ravel().copy(), tolerance)
        iterations, evaluations = iterations + end.iterations, evaluations + end.evaluations
        reached = judged(system, end.q.reshape(q.shape), tolerance)
        kicked = beside(system, reached)
        if kicked is None or kicks >= MOST_KICKS:
            return Minimum(reached.state, reached.residual, reached.stability, iterations, kicks,
                           system, evaluations=evaluations)
        q, kicks = kicked, kicks + 1


def approximate(system: System, q: Floats, method: str, tolerance: float,
                most: int) -> tuple[Floats, int]:
    """Return strains (N, 3) on the way from q to a minimum, and the work that it took.

    Nothing is said of them: they are where others begin.

    Parameters
    ----------
    system : System
        The DLO.
    q : ndarray, shape (m, 3)
        Start, scaled unknowns.
    method : str
        'newton', or one of SEARCHES.
    tolerance : float
        Residual at which the search ends.
    most : int
        Work after which it ends where it is: Newton steps, or evaluations of the potential.
    """
    if method == 'newton':
        descent = descend(system, q, tolerance, most, False)
        return descent.state.strains, descent.iterations
    end = SEARCHES[method](problem_of(system), q.ravel().copy(), tolerance, most)
    state: State = new_state(system)
    state.q[:] = end.q.reshape(q.shape)
    evaluate(system, state)
    return state.strains, end.evaluations


def problem_of(system: System) -> Problem:
    """Return the Problem of the potential of a System, its unknowns in one row."""
    state: State = new_state(system)

    def value(flat: Floats) -> float:
        state.q[:] = flat.reshape(state.q.shape)
        energy: float = evaluate(system, state)[0]
        return energy

    def value_and_gradient(flat: Floats) -> tuple[float, Floats]:
        return value(flat), state.gradient.ravel().copy()

    return Problem(value, value_and_gradient, np.sqrt(bending_energy(system)), rounding(system))


def rounding(system: System) -> float:
    """Return the rounding errors of the potential in J, but for those in proportion to it."""
    weight = np.linalg.norm(system.load.pull, axis=1).sum()
    return float(_EPS * (weight * system.lengths.sum() + bending_energy(system)))


def judged(system: System, q: Floats, tolerance: float) -> Descent:
    """Return the Descent that ends at q (m, 3), where it begins."""
    return descend(system, q, tolerance, 0, True)


def beside(system: System, reached: Descent) -> Floats | None:
    """Return unknowns (m, 3) beside a saddle, on the way down; None at a minimum."""
    return None if reached.stability > -NEUTRAL else kick(system, reached.state, reached.mode)
