# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The smallest eigenvalue of the Hessian and its mode: is it a minimum, and if not, which way down.

Lanczos on the inverse of H + shift I (Golub and Van Loan, ch. 10). The largest eigenvalue is found
long before the vectors lose their orthogonality, so nothing is done to keep it.
In the scaled unknowns the elastic part of H is the identity: 1 is a rod that feels no load, 0 a
shape that is neutral, a negative value one that falls over.
"""

import numpy as np

from dlo_planner.energy.potential import project
from dlo_planner.energy.system import unknown_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.border import add_to, dot
from dlo_planner.minimize.linear import solve

_STEPS = 40
_ROUGH = 1e-2  # of the tolerance: how exactly it is looked whether it still grows
_EXACT = 1e-11
_QUIET = 3       # steps in a row without growth: one alone may be a rest on the way
_MODE_BELOW = 1e-3  # nobody asks for the mode of a shape that is well stable


@kernel
def lowest_mode(system, hessian, shift, tolerance):
    """Return the smallest eigenvalue of H and its unit mode (m, 3), zero if well stable.

    The mode points to the side that is `preferred`.

    Args:
        hessian: factorized with `shift`, without negative pivots
        shift: of that factorization
        tolerance: relative accuracy of the eigenvalue of the inverse
    """
    m = unknown_count(system)
    steps = min(_STEPS, 3 * m)
    vectors = np.empty((steps + 1, m, 3))
    diagonal = np.empty(steps)
    side = np.empty(steps)
    preferred(system, vectors[0])
    top, quiet = 0.0, 0
    used = steps
    for k in range(steps):
        image = vectors[k + 1]
        solve(system, hessian, vectors[k], image)
        diagonal[k] = dot(image, vectors[k])
        add_to(image, -diagonal[k], vectors[k])
        if k:
            add_to(image, -side[k - 1], vectors[k - 1])
        side[k] = np.sqrt(dot(image, image))
        if side[k] < 1e-13 * abs(diagonal[k]):
            used = k + 1
            break
        for e in range(m):
            for i in range(3):
                image[e, i] /= side[k]
        stable = top * (shift + _MODE_BELOW) < 1.0
        near = tolerance if stable else _EXACT  # of a shape that falls, the mode is wanted as well
        previous, top = top, _largest_eigenvalue(diagonal, side, k + 1, top, _ROUGH * near)
        quiet = quiet + 1 if top - previous < near * top else 0
        if quiet == _QUIET:
            used = k + 1
            break
    top = _largest_eigenvalue(diagonal, side, used, 0.0, 1e-13)
    mode = np.zeros((m, 3))
    value = 1.0 / top - shift
    if value < _MODE_BELOW:
        _, modes = np.linalg.eigh(_tridiagonal(diagonal, side, used))
        for k in range(used):
            add_to(mode, modes[k, used - 1], vectors[k])
        size = np.sqrt(dot(mode, mode))
        mode /= size if dot(mode, vectors[0]) >= 0.0 else -size
    return value, mode


@kernel
def preferred(system, vector):
    """Fill the unit vector (m, 3) of the side to which a DLO falls where both are alike.

    Positive torsion and curvatures in the gripper's frame, more of them near the gripper, and of
    the smooth low modes more than of others. Each element has a part of its own, from a fixed row
    of numbers, so that no mode lies square to it by symmetry: rounding errors do not decide.
    """
    lengths = system.lengths
    total = np.sum(lengths)
    values = np.empty((lengths.size, 3))
    series = system.basis.shape[1] > 0
    seed = 12345
    where = 0.0
    for e in range(lengths.size):
        smooth = lengths[e] if series else np.sqrt(lengths[e])
        smooth *= 1.2 - where / total
        where += lengths[e]
        for i in range(3):
            seed = (1103515245 * seed + 12345) % 2147483648
            values[e, i] = smooth * (0.9 + 0.2 * seed / 2147483648.0)
    project(system.basis, values, vector)
    vector /= np.sqrt(dot(vector, vector))


@kernel
def _largest_eigenvalue(diagonal, side, size, least, tolerance):
    """Return the largest eigenvalue of a symmetric tridiagonal matrix, by bisection.

    Args:
        diagonal, side: of the matrix; size: rows of it
        least: what it is not below, as that of a smaller part of the matrix
        tolerance: relative
    """
    low = high = max(diagonal[0], least)
    for k in range(size):
        low = max(low, diagonal[k])
        radius = (side[k - 1] if k else 0.0) + (side[k] if k < size - 1 else 0.0)
        high = max(high, diagonal[k] + radius)
    while high - low > tolerance * abs(high):
        middle = 0.5 * (low + high)
        # one positive pivot of the matrix minus the middle: the eigenvalue lies above it
        above = False
        pivot = 1.0
        for k in range(size):
            pivot = diagonal[k] - middle - (side[k - 1] ** 2 / pivot if k else 0.0)
            if pivot > 0:
                above = True
                break
            if pivot == 0:
                pivot = -1e-300
        if above:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _tridiagonal(diagonal, side, size):
    matrix = np.zeros((size, size))
    for k in range(size):
        matrix[k, k] = diagonal[k]
        if k:
            matrix[k, k - 1] = side[k - 1]
            matrix[k - 1, k] = side[k - 1]
    return matrix
