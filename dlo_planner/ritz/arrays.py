# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Sums of arrays (n, 3), in loops: an array expression takes a compiler a hundred times longer."""

from dlo_planner.kernels import kernel


@kernel
def copy(a, out):
    """Fill out (n, 3) with a (n, 3)."""
    for e in range(out.shape[0]):
        for i in range(3):
            out[e, i] = a[e, i]


@kernel
def put_sum(a, factor, b, out):
    """Fill out (n, 3) with a (n, 3) and a factor times b (n, 3)."""
    for e in range(out.shape[0]):
        for i in range(3):
            out[e, i] = a[e, i] + factor * b[e, i]


@kernel
def scaled_by(factor, a):
    """Multiply a (n, 3) by a factor."""
    for e in range(a.shape[0]):
        for i in range(3):
            a[e, i] *= factor
