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
from dlo_planner.energy.problem import unknown_count
from dlo_planner.geometry.record import scaled_by
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hessian import solve
from dlo_planner.minimize.kkt import add_to, dot

_STEPS = 40
_EXACT = 1e-11
_SHARP = 0.05    # of the root of the accuracy: a residual whose square tells the eigenvalue so well
_REFINED = 8     # Newton steps at most for an eigenvalue of Lanczos' matrix
_EIGEN = 1e-13   # its relative accuracy
_LEAST = 1e-200  # a divisor at least
_MODE_BELOW = 1e-3  # nobody asks for the mode of a shape that is well stable


@kernel
def lowest_mode(system, hessian, shift, tolerance):
    """Return the smallest eigenvalue of H and its unit mode (m, 3), zero if well stable.

    The mode points to the side that is `reference_mode`.
    """
    m = unknown_count(system)
    steps = min(_STEPS, 3 * m)
    vectors = np.empty((steps + 1, m, 3))
    diagonal = np.empty(steps)
    side = np.empty(steps)
    reference_mode(system, vectors[0])
    top, last = 0.0, 1.0
    used = steps
    for k in range(steps):
        image, before = vectors[k + 1], vectors[max(k - 1, 0)]
        solve(system, hessian, vectors[k], image)
        diagonal[k] = dot(image, vectors[k])
        side[k] = _orthogonalized(image, diagonal[k], vectors[k], side[k - 1] if k else 0.0, before)
        top, last = largest_eigenvalue(diagonal, side, k + 1, top, last)
        stable = top * (shift + _MODE_BELOW) < 1.0
        near = tolerance if stable else _EXACT  # of a shape that falls, the mode is wanted as well
        # an eigenvalue is as near as the residual, and as its square over the way to the next one
        residual = side[k] * np.sqrt(last)
        if residual < _SHARP * np.sqrt(near) * top or side[k] < 1e-13 * abs(diagonal[k]):
            used = k + 1
            break
        scaled_by(1.0 / side[k], image)
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
def reference_mode(system, vector):
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
            seed = (1103515245 * seed + 12345) & 2147483647
            values[e, i] = smooth * (0.9 + 0.2 * seed / 2147483648.0)
    project(system.basis, values, vector)
    scaled_by(1.0 / np.sqrt(dot(vector, vector)), vector)


@kernel
def _orthogonalized(image, part, vector, other_part, other):
    """Take parts of two others (m, 3) from a vector (m, 3); return its length."""
    x, y, z = 0.0, 0.0, 0.0  # three sums: each addition waits for the one before
    for e in range(image.shape[0]):
        a = image[e, 0] - part * vector[e, 0] - other_part * other[e, 0]
        b = image[e, 1] - part * vector[e, 1] - other_part * other[e, 1]
        c = image[e, 2] - part * vector[e, 2] - other_part * other[e, 2]
        image[e, 0], image[e, 1], image[e, 2] = a, b, c
        x += a * a
        y += b * b
        z += c * c
    return np.sqrt(x + y + z)


@kernel
def largest_eigenvalue(diagonal, side, size, before, last):
    """Return the largest eigenvalue of a symmetric tridiagonal matrix, and `last` of it.

    A row that is added raises it by no less than in the plane of that eigenvector and the new axis.
    From there Newton's method finds it where it can: the last pivot is concave
    above `before`, so each step falls short, by its square over the way from `before` at most.
    """
    if size == 1:
        return diagonal[0], 1.0
    half, square = 0.5 * (diagonal[size - 1] - before), side[size - 2] ** 2 * last
    root = np.sqrt(half * half + square)
    value, rise = before + (half + root if half > 0.0 else square / max(root - half, _LEAST)), 1.0
    for _ in range(_REFINED):
        pivot, rise = _last_pivot(diagonal, side, size, value)
        change = pivot / rise
        told = change * change <= _EIGEN * abs(value * (value - before))
        value -= change
        if told:
            if _exceeded(diagonal, side, size, value + _EIGEN * abs(value)):
                break
            return value, 1.0 / rise
    value = np.linalg.eigvalsh(_tridiagonal(diagonal, side, size))[size - 1]
    return value, 1.0 / _last_pivot(diagonal, side, size, value)[1]


@kernel
def _last_pivot(diagonal, side, size, value):
    """Return the last pivot of `value` I - T, and its derivative by `value`, 1 at least."""
    pivot, rise = value - diagonal[0], 1.0
    for k in range(1, size):
        ratio = side[k - 1] / (pivot if abs(pivot) > _LEAST else _LEAST)
        pivot, rise = value - diagonal[k] - ratio * side[k - 1], 1.0 + ratio * ratio * rise
    return pivot, rise


@kernel
def _exceeded(diagonal, side, size, value):
    """Whether an eigenvalue lies above `value`: one positive pivot of T - value I (Sylvester)."""
    pivot = 1.0
    for k in range(size):
        pivot = diagonal[k] - value - (side[k - 1] ** 2 / pivot if k else 0.0)
        if pivot > 0:
            return True
        if pivot == 0:
            pivot = -_LEAST
    return False


@kernel
def _tridiagonal(diagonal, side, size):
    matrix = np.zeros((size, size))
    for k in range(size):
        matrix[k, k] = diagonal[k]
        if k:
            matrix[k, k - 1] = side[k - 1]
            matrix[k - 1, k] = side[k - 1]
    return matrix
