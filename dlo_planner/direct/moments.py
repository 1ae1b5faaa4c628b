# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Dead moments: they turn no way with the DLO, and so have no potential.

Their work in a small change of the strains is a linear function of it, with factors that depend on
the frames. With the frames held fixed that is the work of a natural strain: the equilibrium is
sought so, again and again, until the frames are those of the shape that is found (about one axis at
once). What stability says is that against disturbances which the moments follow.
"""

from collections.abc import Callable

import numpy as np

from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.plastic import yields
from dlo_planner.energy.potential import evaluate, placed
from dlo_planner.energy.system import System, new_state
from dlo_planner.kernels import kernel
from dlo_planner.minimize.minimum import Minimum
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.arc import jacobians
from dlo_planner.ritz.matrix3 import matrix, plus, put_vector, transposed_applied, vector

_ROUNDS = 60
_REMEMBERED = 8   # rounds that tell the next one where to go
_SETTLED = 1e-10  # part of the moments by which they may still turn


def balanced(solved: Callable[[System, Floats], Minimum], system: System, q: Floats,
             moments: Floats) -> Minimum:
    """Return what `solved` returns in equilibrium with dead moments, its residual theirs too.

    The fixed point of frames -> shape -> frames is sought by Anderson's acceleration.

    Parameters
    ----------
    solved : callable
        Function (system, q) -> Minimum.
    system : System
        System without the moments.
    q : ndarray, shape (m, 3)
        Unknowns to begin with.
    moments : ndarray, shape (N + 1, 3)
        Moments on the nodes, N m, world axes.
    """
    free, unit = system, np.abs(moments).sum()
    state = new_state(system)
    state.q[:] = q
    evaluate(system, state)
    known = _couples(system.lengths, state.strains, state.rotations, moments) / unit
    strains, iterations = state.strains, 0
    tried: list[Floats] = []
    missed: list[Floats] = []
    for _ in range(_ROUNDS):
        loaded = _pulled(system, free, unit * known)
        found = solved(loaded, placed(loaded, strains).q)
        state, system = found.state, found.system
        iterations += found.iterations
        strains = state.strains
        miss = _couples(system.lengths, strains, state.rotations, moments) / unit - known
        off = np.abs(miss).max()
        if off <= _SETTLED:
            break
        tried, missed = [*tried, known][-_REMEMBERED:], [*missed, miss][-_REMEMBERED:]
        known = _next(tried, missed)
    return found._replace(residual=max(found.residual, off), iterations=iterations)


def _pulled(system: System, free: System, couples: Floats) -> System:
    """Return a System like `system`, but that couples (N, 3) in N m pull at the strains of `free`.

    What cannot yield is as though its natural strains were others.
    """
    if yields(free.plastic):
        return system._replace(elastic=with_couples(free.elastic, couples))
    return system._replace(natural=free.natural + couples / free.stiffness)


def _next(tried: list[Floats], missed: list[Floats]) -> Floats:
    """Return where the misses (n, 3) would vanish, by least squares over what was tried."""
    best = tried[-1] + missed[-1]
    if len(tried) == 1:
        return best
    of_misses = np.column_stack([(one - missed[-1]).ravel() for one in missed[:-1]])
    share, *_ = np.linalg.lstsq(of_misses, -missed[-1].ravel(), rcond=1e-10)
    for part, one, miss in zip(share, tried[:-1], missed[:-1], strict=True):
        best = best + part * (one + miss - tried[-1] - missed[-1])
    return best


@kernel
def _couples(lengths: Floats, strains: Floats, rotations: Floats, moments: Floats) -> Floats:
    """Return (N, 3): the work of all moments beyond, per length and strain of each element, N m."""
    out = np.empty(strains.shape)
    beyond = (0.0, 0.0, 0.0)
    for e in range(lengths.size - 1, -1, -1):
        h = lengths[e]
        beyond = plus(beyond, vector(moments[e + 1]))
        turning, _ = jacobians(h * strains[e, 0], h * strains[e, 1], h * strains[e, 2], h)
        own = transposed_applied(matrix(rotations[e]), beyond)
        put_vector(transposed_applied(turning, own), out[e])
    return out
