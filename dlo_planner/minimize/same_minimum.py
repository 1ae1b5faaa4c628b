"""Whether two searches end in one minimum, told without making both."""

import numpy as np

from dlo_planner.energy.potential import evaluate, new_state
from dlo_planner.minimize.linear import assemble, factorise, largest_turn, new_hessian, solve
from dlo_planner.minimize.newton import LARGEST_TURN

_SURE = 0.25    # of a Newton step: if the next one, with the same Hessian, is no longer than this
_CLOSE = 1e-7   # of the unknowns: what two searches for one minimum may leave between them


def lower(system, one, other):
    """Whether the potential is lower at unknowns `one` (m, 3) than at `other`."""
    state, values = new_state(system), []
    for q in (one, other):
        state.q[:] = q
        values.append(evaluate(system, state)[0])
    return values[0] < values[1]


def leads_to(system, start, end):
    """Whether Newton's method from `start` (m, 3) goes to the minimum `end` (m, 3) straight away.

    It does where the Hessian is positive definite, no step would be cut, and a second step with the
    same Hessian is so much shorter than the first that its limit is near, and the only one near
    (Deuflhard, Newton Methods for Nonlinear Problems, theorem 2.5: the contraction by simplified
    steps). Then `end` has to be there.
    """
    state, hessian = new_state(system), new_hessian(system)
    first, second = np.empty_like(state.q), np.empty_like(state.q)
    state.q[:] = start
    evaluate(system, state)
    assemble(system, state, hessian)
    if factorise(system, hessian, 0.0):
        return False
    solve(system, hessian, -state.gradient, first)
    if largest_turn(system, hessian, first) > LARGEST_TURN:
        return False
    state.q[:] = start + first
    evaluate(system, state)
    solve(system, hessian, -state.gradient, second)
    close = _CLOSE * (np.linalg.norm(end) + np.linalg.norm(first))
    step, rest = np.linalg.norm(first), np.linalg.norm(second)
    return bool(rest <= _SURE * step + close
                and np.linalg.norm(start + first - end) <= 2 * rest + close)
