# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Vectors (3,) and matrices (3, 3) as tuples of 3 and 9 numbers, row after row.

A compiler keeps tuples in registers, where it would go to memory for every entry of an array: the
sweeps over the elements are twice as quick with them.
"""

from __future__ import annotations

from typing import TypeAlias

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]

ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def vector(v):
    """Return the tuple of an array (3,)."""
    return v[0], v[1], v[2]


@kernel
def matrix(m: Floats) -> Matrix:
    """Return the tuple of an array (3, 3)."""
    return m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2]


@kernel
def put_vector(v, out):
    """Fill an array (3,)."""
    out[0], out[1], out[2] = v


@kernel
def put_matrix(m, out):
    """Fill an array (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = m[0], m[1], m[2]
    out[1, 0], out[1, 1], out[1, 2] = m[3], m[4], m[5]
    out[2, 0], out[2, 1], out[2, 2] = m[6], m[7], m[8]


@kernel
def plus(a, b):
    """Return the vector a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a, b):
    """Return the vector a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def added(a, b):
    """Return the matrix a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5],
            a[6] + b[6], a[7] + b[7], a[8] + b[8])


@kernel
def subtracted(a, b):
    """Return the matrix a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5],
            a[6] - b[6], a[7] - b[7], a[8] - b[8])


@kernel
def transposed(m):
    """Return the matrix m^T."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@kernel
def inner(a, b):
    """Return the number a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    """Return the vector a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def applied(m, v):
    """Return the vector m v."""
    return (m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
            m[6] * v[0] + m[7] * v[1] + m[8] * v[2])


@kernel
def transposed_applied(m, v):
    """Return the vector m^T v."""
    return (m[0] * v[0] + m[3] * v[1] + m[6] * v[2], m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
            m[2] * v[0] + m[5] * v[1] + m[8] * v[2])


@kernel
def times(a, b):
    """Return the matrix a b."""
    return (a[0] * b[0] + a[1] * b[3] + a[2] * b[6], a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
            a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[3] + a[5] * b[6], a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
            a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[3] + a[8] * b[6], a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
            a[6] * b[2] + a[7] * b[5] + a[8] * b[8])


@kernel
def transposed_times(a, b):
    """Return the matrix a^T b."""
    return (a[0] * b[0] + a[3] * b[3] + a[6] * b[6], a[0] * b[1] + a[3] * b[4] + a[6] * b[7],
            a[0] * b[2] + a[3] * b[5] + a[6] * b[8],
            a[1] * b[0] + a[4] * b[3] + a[7] * b[6], a[1] * b[1] + a[4] * b[4] + a[7] * b[7],
            a[1] * b[2] + a[4] * b[5] + a[7] * b[8],
            a[2] * b[0] + a[5] * b[3] + a[8] * b[6], a[2] * b[1] + a[5] * b[4] + a[8] * b[7],
            a[2] * b[2] + a[5] * b[5] + a[8] * b[8])


@kernel
def times_transposed(a, b):
    """Return the matrix a b^T."""
    return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2], a[0] * b[3] + a[1] * b[4] + a[2] * b[5],
            a[0] * b[6] + a[1] * b[7] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[1] + a[5] * b[2], a[3] * b[3] + a[4] * b[4] + a[5] * b[5],
            a[3] * b[6] + a[4] * b[7] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[1] + a[8] * b[2], a[6] * b[3] + a[7] * b[4] + a[8] * b[5],
            a[6] * b[6] + a[7] * b[7] + a[8] * b[8])


@kernel
def crossed_columns(v, m):
    """Return the matrix of the vectors v x (a column of m)."""
    return (v[1] * m[6] - v[2] * m[3], v[1] * m[7] - v[2] * m[4], v[1] * m[8] - v[2] * m[5],
            v[2] * m[0] - v[0] * m[6], v[2] * m[1] - v[0] * m[7], v[2] * m[2] - v[0] * m[8],
            v[0] * m[3] - v[1] * m[0], v[0] * m[4] - v[1] * m[1], v[0] * m[5] - v[1] * m[2])


@kernel
def columns_scaled(m, w0, w1, w2):
    """Return the matrix m with its columns times three numbers."""
    return (m[0] * w0, m[1] * w1, m[2] * w2, m[3] * w0, m[4] * w1, m[5] * w2,
            m[6] * w0, m[7] * w1, m[8] * w2)


@kernel
def outer(a, b):
    """Return the matrix a b^T."""
    return (a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[0], a[1] * b[1], a[1] * b[2],
            a[2] * b[0], a[2] * b[1], a[2] * b[2])


@kernel
def without_trace(m):
    """Return m - trace(m) I."""
    trace = m[0] + m[4] + m[8]
    return (m[0] - trace, m[1], m[2], m[3], m[4] - trace, m[5], m[6], m[7], m[8] - trace)
