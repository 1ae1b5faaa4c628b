# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The sweeps of `riccati` where all loads are vertical: a turn about the vertical costs nothing.

The cost to go depends on two components of the rotation of what lies beyond an element, so the
blocks of the sweep are two wide instead of three.
"""

from dlo_planner.kernels import kernel
from dlo_planner.minimize.riccati import inverse3
from dlo_planner.ritz.arc import coefficients_in, jacobians_with, second_derivatives_with
from dlo_planner.ritz.matrix3 import columns_scaled, matrix, put_matrix, times, vector


@kernel
def is_vertical(pull):
    """Whether all forces on the nodes (N + 1, 3) are along z."""
    vertical = True
    for k in range(pull.shape[0]):
        vertical = vertical and pull[k, 0] == 0.0 and pull[k, 1] == 0.0
    return vertical


@kernel(forceinline=True)
def _element(h, strain, c, scale, frame, force, first, value):
    """Return what `ritz.second_order.element_blocks` does, for the two horizontal rotations.

    Args:
        h, strain, c, scale, frame: as there
        force: upward component of the sum of `pull` beyond
        first: (3 numbers) first moment of these about the element's far end
        value: (3 numbers: 00, 01, 11) second derivative of the cost to go

    Returns
    -------
        turned: (9 numbers); coupling: (6 numbers); pivot: (6 numbers: 00, 11, 22, 01, 02, 12)
    """
    x, y, z = h * strain[0], h * strain[1], h * strain[2]
    rotation_jacobian, chord_jacobian = jacobians_with(x, y, z, h, c)
    w0, w1, w2 = h * scale[0], h * scale[1], h * scale[2]
    t = times(frame, columns_scaled(rotation_jacobian, w0, w1, w2))
    s = times(frame, columns_scaled(chord_jacobian, w0, w1, w2))
    m0, m1, m2 = first
    v00, v01, v11 = value[0] - m2, value[1], value[2] - m2
    a0, b0 = t[0] * v00 + t[3] * v01 + t[6] * m0, t[0] * v01 + t[3] * v11 + t[6] * m1
    a1, b1 = t[1] * v00 + t[4] * v01 + t[7] * m0, t[1] * v01 + t[4] * v11 + t[7] * m1
    a2, b2 = t[2] * v00 + t[5] * v01 + t[8] * m0, t[2] * v01 + t[5] * v11 + t[8] * m1
    coupling = (a0 + force * s[3], b0 - force * s[0], a1 + force * s[4], b1 - force * s[1],
                a2 + force * s[5], b2 - force * s[2])
    own = second_derivatives_with(
        x, y, z, h, (force * frame[6], force * frame[7], force * frame[8]),
        (m1 * frame[0] - m0 * frame[3], m1 * frame[1] - m0 * frame[4],
         m1 * frame[2] - m0 * frame[5]), c)
    pivot = (w0 * w0 * own[0] + a0 * t[0] + b0 * t[3], w1 * w1 * own[4] + a1 * t[1] + b1 * t[4],
             w2 * w2 * own[8] + a2 * t[2] + b2 * t[5],
             w0 * w1 * own[1] + 0.5 * (a0 * t[1] + b0 * t[4] + a1 * t[0] + b1 * t[3]),
             w0 * w2 * own[2] + 0.5 * (a0 * t[2] + b0 * t[5] + a2 * t[0] + b2 * t[3]),
             w1 * w2 * own[5] + 0.5 * (a1 * t[2] + b1 * t[5] + a2 * t[1] + b2 * t[4]))
    return t, coupling, pivot


@kernel
def factorize_vertical_loads(system, state, hessian, shift):
    """Do what `riccati.factorize_dead_loads` does, where `is_vertical`."""
    return _factorized(system.lengths,
                       (state.strains, state.arcs, system.scale, state.positions, state.pull),
                       (hessian.twist_jacobian, state.rotations, hessian.diagonal, hessian.gain,
                        hessian.inverse, hessian.passed), shift)


@kernel
def _factorized(lengths, rows, blocks, shift):
    strains, arcs, scale, positions, pull = rows
    jacobians, rotations, diagonals, gains, inverses, passed = blocks
    force, first, value = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(lengths.size):
        e = lengths.size - 1 - k
        d, gain, kept = diagonals[e], gains[e], passed[e]
        force += pull[e + 1, 2]
        t, c, p = _element(lengths[e], vector(strains[e]), coefficients_in(arcs[e]),
                           vector(scale[e]), matrix(rotations[e]), force, first, value)
        inverse, below = inverse3((d[0, 0] + p[0] + shift, d[1, 1] + p[1] + shift,
                                   d[2, 2] + p[2] + shift, d[0, 1] + p[3], d[0, 2] + p[4],
                                   d[1, 2] + p[5]))
        put_matrix(t, jacobians[e])
        if below > 0:
            return False
        put_matrix(inverse, inverses[e])
        a0 = inverse[0] * c[0] + inverse[1] * c[2] + inverse[2] * c[4]
        a1 = inverse[3] * c[0] + inverse[4] * c[2] + inverse[5] * c[4]
        a2 = inverse[6] * c[0] + inverse[7] * c[2] + inverse[8] * c[4]
        b0 = inverse[0] * c[1] + inverse[1] * c[3] + inverse[2] * c[5]
        b1 = inverse[3] * c[1] + inverse[4] * c[3] + inverse[5] * c[5]
        b2 = inverse[6] * c[1] + inverse[7] * c[3] + inverse[8] * c[5]
        gain[0, 0], gain[0, 1], gain[0, 2] = a0, b0, 0.0
        gain[1, 0], gain[1, 1], gain[1, 2] = a1, b1, 0.0
        gain[2, 0], gain[2, 1], gain[2, 2] = a2, b2, 0.0
        kept[0, 0] = 1.0 - (t[0] * a0 + t[1] * a1 + t[2] * a2)
        kept[0, 1] = -(t[0] * b0 + t[1] * b1 + t[2] * b2)
        kept[1, 0] = -(t[3] * a0 + t[4] * a1 + t[5] * a2)
        kept[1, 1] = 1.0 - (t[3] * b0 + t[4] * b1 + t[5] * b2)
        value = (value[0] - c[0] * a0 - c[2] * a1 - c[4] * a2,
                 value[1] - c[0] * b0 - c[2] * b1 - c[4] * b2,
                 value[2] - c[1] * b0 - c[3] * b1 - c[5] * b2)
        first = (first[0] + force * (positions[e + 1, 0] - positions[e, 0]),
                 first[1] + force * (positions[e + 1, 1] - positions[e, 1]),
                 first[2] + force * (positions[e + 1, 2] - positions[e, 2]))
    return True


@kernel
def solve_vertical_loads(hessian, right, out):
    """Do what `riccati.solve_turns` does, after `factorize_vertical_loads`."""
    _solved((hessian.twist_jacobian, hessian.gain, hessian.inverse, hessian.passed), right, out)


@kernel
def _solved(blocks, right, out):
    jacobians, gains, inverses, passed = blocks
    n = jacobians.shape[0]
    x, y = 0.0, 0.0  # slope of the cost to go by the rotation, negated
    for k in range(n):
        e = n - 1 - k
        t, gain, inverse, kept = jacobians[e], gains[e], inverses[e], passed[e]
        b0, b1, b2 = right[e, 0], right[e, 1], right[e, 2]
        r0 = b0 + (t[0, 0] * x + t[1, 0] * y)
        r1 = b1 + (t[0, 1] * x + t[1, 1] * y)
        r2 = b2 + (t[0, 2] * x + t[1, 2] * y)
        out[e, 0] = inverse[0, 0] * r0 + inverse[0, 1] * r1 + inverse[0, 2] * r2
        out[e, 1] = inverse[1, 0] * r0 + inverse[1, 1] * r1 + inverse[1, 2] * r2
        out[e, 2] = inverse[2, 0] * r0 + inverse[2, 1] * r1 + inverse[2, 2] * r2
        x, y = (kept[0, 0] * x + kept[1, 0] * y
                - (gain[0, 0] * b0 + gain[1, 0] * b1 + gain[2, 0] * b2),
                kept[0, 1] * x + kept[1, 1] * y
                - (gain[0, 1] * b0 + gain[1, 1] * b1 + gain[2, 1] * b2))
    x, y = 0.0, 0.0  # rotation of what lies beyond
    for e in range(n):
        t, gain, kept = jacobians[e], gains[e], passed[e]
        h0, h1, h2 = out[e, 0], out[e, 1], out[e, 2]
        out[e, 0] = h0 - (gain[0, 0] * x + gain[0, 1] * y)
        out[e, 1] = h1 - (gain[1, 0] * x + gain[1, 1] * y)
        out[e, 2] = h2 - (gain[2, 0] * x + gain[2, 1] * y)
        x, y = (kept[0, 0] * x + kept[0, 1] * y + (t[0, 0] * h0 + t[0, 1] * h1 + t[0, 2] * h2),
                kept[1, 0] * x + kept[1, 1] * y + (t[1, 0] * h0 + t[1, 1] * h1 + t[1, 2] * h2))
