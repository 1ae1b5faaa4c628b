# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The ruler: static shapes of a round wire under its weight, by a loop written for nothing else.

The method is that of the package with `basis='local'`: arcs of constant strain, Newton's method
with a Riccati sweep, at most 0.8 rad in a step, a shift where a pivot is negative, a stated side
where the wire may fall to either, a kick off a saddle, the lowest eigenvalue at the end. Forces are
vertical, so a rotation about the vertical costs nothing and all blocks are 2 wide; gradient,
Hessian, factorization and the first half of the solution are one pass. Nothing of the package is
imported.
"""

from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

_TOLERANCE = 1e-10   # of the residual, as the package
_LARGEST_TURN = 0.8  # rad per step
_KICK, _LEAN, _FALLING, _NEUTRAL = 0.3, 1e-5, 2e-3, 1e-7
_ZERO = 1e-16  # stands for a pivot of zero
_LANCZOS = 40
_MOST = 1000

compiled = njit(cache=True, error_model='numpy', nogil=True)


class Wire(NamedTuple):
    """A wire of N even elements: their length, m; weights (N + 1,) of the nodes, N; GJ and EI."""

    h: float
    weights: np.ndarray
    torsion: float
    bending: float


class Work(NamedTuple):
    """Arrays of one search, refilled: unknowns, geometry, and the blocks of the sweep."""

    q: np.ndarray
    trial: np.ndarray
    step: np.ndarray
    frames: np.ndarray
    places: np.ndarray
    turning: np.ndarray   # (N, 3, 3) row j: world rotation of all beyond, per unknown j
    gain: np.ndarray      # (N, 3, 2)
    inverse: np.ndarray   # (N, 6)
    half: np.ndarray      # (N, 3) first half of the solution
    side: np.ndarray      # (N, 3) to which it falls where both are alike
    vectors: np.ndarray   # (_LANCZOS + 1, N, 3)


def copper_wire(n=64, tip_mass=0.0):
    """Return the Wire of the paper's benchmark A, of B with a tip mass of 1 kg."""
    area, young = pi * 0.5e-3**2, 110e9
    inertia = area**2 / (4 * pi)
    weights = np.full(n + 1, 9.81 * 8960.0 * area / n)
    weights[[0, -1]] *= 0.5
    weights[-1] += 9.81 * tip_mass
    return Wire(1.0 / n, weights, young / (2 * 1.34) * 2 * inertia, young * inertia)


def new_work(n):
    """Return the Work of a wire with n elements."""
    shapes = [(n, 3)] * 3 + [(n + 1, 3, 3), (n + 1, 3), (n, 3, 3), (n, 3, 2), (n, 6), (n, 3)]
    return Work(*map(np.zeros, shapes), preferred(n), np.zeros((_LANCZOS + 1, n, 3)))


def preferred(n):
    """Return (n, 3): the side to which a wire falls where both are alike, as the package states."""
    values, seed = np.empty((n, 3)), 12345
    for e in range(n):
        for i in range(3):
            seed = (1103515245 * seed + 12345) % 2147483648
            values[e, i] = (1.2 - e / n) * (0.9 + 0.2 * seed / 2147483648.0)
    return values / sqrt(np.sum(values**2))


@compiled
def _coefficients(a2):
    """Return c1, c2, d1, d2, dd1, dd2 of the angle squared: those of exp, slopes, second slopes."""
    if a2 < 0.02:
        c1 = 1 / 2 - a2 * (1 / 24 - a2 * (1 / 720 - a2 * (1 / 40320 - a2 / 3628800)))
        c2 = 1 / 6 - a2 * (1 / 120 - a2 * (1 / 5040 - a2 * (1 / 362880 - a2 / 39916800)))
        d1 = -1 / 12 + a2 * (1 / 180 - a2 * (1 / 6720 - a2 * (1 / 453600 - a2 / 47900160)))
        d2 = -1 / 60 + a2 * (1 / 1260 - a2 * (1 / 60480 - a2 * (1 / 4989600 - a2 / 622702080)))
        return (c1, c2, d1, d2, 1 / 90 - a2 * (1 / 1680 - a2 / 75600),
                1 / 630 - a2 * (1 / 15120 - a2 / 831600))
    if a2 < 1.0:
        return _long_series(a2)
    a = sqrt(a2)
    c0 = sin(a) / a
    c1, c2 = (1 - cos(a)) / a2, (1 - c0) / a2
    d1, d2 = (c0 - 2 * c1) / a2, (c1 - 3 * c2) / a2
    return c1, c2, d1, d2, (c2 - c1 - 4 * d1) / a2, (d1 - 5 * d2) / a2


@compiled
def _long_series(a2):
    c1 = c2 = d1 = d2 = dd1 = dd2 = 0.0
    term = 0.5  # (-1)^n / (2 n + 2)!
    power = powers = 1.0
    before = 0.0
    for n in range(12):
        c1 += term * power
        c2 += term / (2 * n + 3) * power
        if n > 0:
            d1 += 2 * n * term * powers
            d2 += 2 * n * term / (2 * n + 3) * powers
        if n > 1:
            dd1 += 4 * n * (n - 1) * term * before
            dd2 += 4 * n * (n - 1) * term / (2 * n + 3) * before
        before, powers = powers if n > 0 else 1.0, power
        power *= a2
        term /= -(2 * n + 3) * (2 * n + 4)
    return c1, c2, d1, d2, dd1, dd2


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _flat(a, b):
    return a[0] * b[0] + a[1] * b[1]


@compiled
def _march(wire, scale, q, base, work):
    """Fill frames and places for the unknowns q; return the energy and its rounding errors in J."""
    frames, places, h = work.frames, work.places, wire.h
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = base.ravel()
    px = py = pz = elastic = load = size = 0.0
    for e in range(q.shape[0] + 1):
        frame, place = frames[e], places[e]
        frame[0, 0], frame[0, 1], frame[0, 2] = r00, r01, r02
        frame[1, 0], frame[1, 1], frame[1, 2] = r10, r11, r12
        frame[2, 0], frame[2, 1], frame[2, 2] = r20, r21, r22
        place[0], place[1], place[2] = px, py, pz
        load += wire.weights[e] * pz
        size += abs(wire.weights[e] * pz)
        if e == q.shape[0]:
            break
        elastic += q[e, 0] * q[e, 0] + q[e, 1] * q[e, 1] + q[e, 2] * q[e, 2]
        x, y, z = scale[0] * q[e, 0], scale[1] * q[e, 1], scale[1] * q[e, 2]
        a2 = x * x + y * y + z * z
        c1, c2, _, _, _, _ = _coefficients(a2)
        c0, rest = 1 - a2 * c2, 1 - a2 * c1
        t00, t11, t22 = rest + c1 * x * x, rest + c1 * y * y, rest + c1 * z * z
        t01, t10 = c1 * x * y - c0 * z, c1 * x * y + c0 * z
        t02, t20 = c1 * x * z + c0 * y, c1 * x * z - c0 * y
        t12, t21 = c1 * y * z - c0 * x, c1 * y * z + c0 * x
        k0 = h * (1 - c2 * (y * y + z * z))
        k1, k2 = h * (c1 * z + c2 * x * y), h * (c2 * x * z - c1 * y)
        px += r00 * k0 + r01 * k1 + r02 * k2
        py += r10 * k0 + r11 * k1 + r12 * k2
        pz += r20 * k0 + r21 * k1 + r22 * k2
        r00, r01, r02 = (r00 * t00 + r01 * t10 + r02 * t20, r00 * t01 + r01 * t11 + r02 * t21,
                         r00 * t02 + r01 * t12 + r02 * t22)
        r10, r11, r12 = (r10 * t00 + r11 * t10 + r12 * t20, r10 * t01 + r11 * t11 + r12 * t21,
                         r10 * t02 + r11 * t12 + r12 * t22)
        r20, r21, r22 = (r20 * t00 + r21 * t10 + r22 * t20, r20 * t01 + r21 * t11 + r22 * t21,
                         r20 * t02 + r21 * t12 + r22 * t22)
    return 0.5 * elastic + load, 2e-16 * (0.5 * elastic + size)


@compiled
def _column(frame, scale, turned, shifted, weight, moment):
    """Return what one unknown does to all beyond: rotation, that rolled by the load, and all.

    Args:
        turned, shifted: (3,) in the element's frame: rotation, displacement of its far end
        moment: (3,) first moment of the weight beyond, about that end
    """
    turn = (scale * _dot(frame[0], turned), scale * _dot(frame[1], turned),
            scale * _dot(frame[2], turned))
    rolled = (turn[2] * moment[0] - moment[2] * turn[0],
              turn[2] * moment[1] - moment[2] * turn[1])
    cross = (rolled[0] + scale * weight * _dot(frame[1], shifted),
             rolled[1] - scale * weight * _dot(frame[0], shifted))
    return turn, rolled, cross


@compiled
def _own_bend(x, y, z, coefficients, b, a):
    """Return the second derivatives (xx, yy, zz, xy, xz, yz) of b . J(phi) e1 and a . (dJ[d] d).

    phi = (x, y, z); b: force times length, a: moment, both in the element's frame.
    """
    c1, c2, d1, d2, dd1, dd2 = coefficients
    a2 = x * x + y * y + z * z
    along = b[0] * x + b[1] * y + b[2] * z
    alpha, beta = b[1] * z - b[2] * y, x * along - a2 * b[0]
    twist = a[0] * x + a[1] * y + a[2] * z
    part = d2 * a2 + c2
    s0 = d2 * (along - x * b[0]) + 0.5 * (d1 * (a[1] * z - a[2] * y) - part * a[0])
    s1 = (-d1 * b[2] + d2 * (x * b[1] - 2 * y * b[0])
          + 0.5 * (d1 * (a[2] * x - a[0] * z) - part * a[1]))
    s2 = (d1 * b[1] + d2 * (x * b[2] - 2 * z * b[0])
          + 0.5 * (d1 * (a[0] * y - a[1] * x) - part * a[2]))
    square = dd1 * alpha + dd2 * beta + d2 * twist
    unit = d1 * alpha + d2 * beta + c2 * twist
    return (square * x * x + 2 * x * s0 + unit,
            square * y * y + 2 * y * s1 + unit - 2 * c2 * b[0],
            square * z * z + 2 * z * s2 + unit - 2 * c2 * b[0],
            square * x * y + x * s1 + y * s0 + c2 * b[1],
            square * x * z + x * s2 + z * s0 + c2 * b[2],
            square * y * z + y * s2 + z * s1)


@compiled
def _inverse(p00, p11, p22, p10, p20, p21):
    """Return the inverse (00, 11, 22, 10, 20, 21) of a symmetric matrix, and its pivots <= 0."""
    p00 = p00 if p00 != 0.0 else _ZERO
    l10, l20 = p10 / p00, p20 / p00
    d1 = p11 - l10 * p10
    d1 = d1 if d1 != 0.0 else _ZERO
    middle = p21 - l20 * p10
    l21 = middle / d1
    d2 = p22 - l20 * p20 - l21 * middle
    d2 = d2 if d2 != 0.0 else _ZERO
    i0, i1, i2 = 1 / p00, 1 / d1, 1 / d2
    low = l10 * l21 - l20
    return (i0 + l10 * l10 * i1 + low * low * i2, i1 + l21 * l21 * i2, i2,
            -l10 * i1 - l21 * low * i2, low * i2, -l21 * i2), (p00 <= 0) + (d1 <= 0) + (d2 <= 0)


@compiled
def _times(m, v):
    """Return a symmetric matrix (00, 11, 22, 10, 20, 21) times v (3,)."""
    return (m[0] * v[0] + m[3] * v[1] + m[4] * v[2], m[3] * v[0] + m[1] * v[1] + m[5] * v[2],
            m[4] * v[0] + m[5] * v[1] + m[2] * v[2])


@compiled
def _sweep(wire, scale, q, work, shift):
    """Factorize Hessian + `shift`, begin the step; return negative pivots, gradient squared."""
    h, torsion, bending = wire.h, scale[0], scale[1]
    negative, gradient2, weight = 0, 0.0, 0.0
    moment = (0.0, 0.0, 0.0)
    v00 = v01 = v11 = slope0 = slope1 = 0.0
    for e in range(q.shape[0] - 1, -1, -1):
        weight += wire.weights[e + 1]
        frame = work.frames[e]
        u = (torsion * q[e, 0], bending * q[e, 1], bending * q[e, 2])
        x, y, z = u
        a2 = x * x + y * y + z * z
        both = _coefficients(a2)
        c1, c2, d1, d2, _, _ = both
        rest, across = 1 - c2 * a2, -d2 * (y * y + z * z)
        up, down = d1 * z + d2 * x * y, d2 * x * z - d1 * y
        n0 = (rest + c2 * x * x, c2 * x * y + c1 * z, c2 * x * z - c1 * y)
        n1 = (c2 * x * y - c1 * z, rest + c2 * y * y, c2 * y * z + c1 * x)
        n2 = (c2 * x * z + c1 * y, c2 * y * z - c1 * x, rest + c2 * z * z)
        k0 = (h * across * x, h * (up * x + c2 * y), h * (down * x + c2 * z))
        k1 = (h * (across * y - 2 * c2 * y), h * (up * y + c2 * x), h * (down * y - c1))
        k2 = (h * (across * z - 2 * c2 * z), h * (up * z + c1), h * (down * z + c2 * x))
        b = (weight * frame[2, 0], weight * frame[2, 1], weight * frame[2, 2])
        a = (frame[0, 0] * moment[1] - frame[1, 0] * moment[0],
             frame[0, 1] * moment[1] - frame[1, 1] * moment[0],
             frame[0, 2] * moment[1] - frame[1, 2] * moment[0])
        g0 = q[e, 0] + torsion * (_dot(n0, a) + _dot(k0, b))
        g1 = q[e, 1] + bending * (_dot(n1, a) + _dot(k1, b))
        g2 = q[e, 2] + bending * (_dot(n2, a) + _dot(k2, b))
        gradient2 += g0 * g0 + g1 * g1 + g2 * g2
        t0, r0, x0 = _column(frame, torsion, n0, k0, weight, moment)
        t1, r1, x1 = _column(frame, bending, n1, k1, weight, moment)
        t2, r2, x2 = _column(frame, bending, n2, k2, weight, moment)
        own = _own_bend(x, y, z, both, (h * b[0], h * b[1], h * b[2]), a)
        w0 = (t0[0] * v00 + t0[1] * v01, t0[0] * v01 + t0[1] * v11)
        w1 = (t1[0] * v00 + t1[1] * v01, t1[0] * v01 + t1[1] * v11)
        w2 = (t2[0] * v00 + t2[1] * v01, t2[0] * v01 + t2[1] * v11)
        inverse, below = _inverse(
            1 + shift + torsion * torsion * own[0] + _flat(r0, t0) + _flat(w0, t0),
            1 + shift + bending * bending * own[1] + _flat(r1, t1) + _flat(w1, t1),
            1 + shift + bending * bending * own[2] + _flat(r2, t2) + _flat(w2, t2),
            torsion * bending * own[3] + 0.5 * (_flat(r0, t1) + _flat(r1, t0)) + _flat(w0, t1),
            torsion * bending * own[4] + 0.5 * (_flat(r0, t2) + _flat(r2, t0)) + _flat(w0, t2),
            bending * bending * own[5] + 0.5 * (_flat(r1, t2) + _flat(r2, t1)) + _flat(w1, t2))
        negative += below
        left = (x0[0] + w0[0], x1[0] + w1[0], x2[0] + w2[0])
        right = (x0[1] + w0[1], x1[1] + w1[1], x2[1] + w2[1])
        gain0, gain1 = _times(inverse, left), _times(inverse, right)
        v00 -= _dot(left, gain0)
        v01 -= _dot(left, gain1)
        v11 -= _dot(right, gain1)
        rhs = (g0 + t0[0] * slope0 + t0[1] * slope1, g1 + t1[0] * slope0 + t1[1] * slope1,
               g2 + t2[0] * slope0 + t2[1] * slope1)
        slope0 -= _dot(gain0, rhs)
        slope1 -= _dot(gain1, rhs)
        _keep(work, e, (t0, t1, t2), gain0, gain1, inverse, _times(inverse, rhs))
        moment = (moment[0] + weight * (work.places[e + 1, 0] - work.places[e, 0]),
                  moment[1] + weight * (work.places[e + 1, 1] - work.places[e, 1]),
                  moment[2] + weight * (work.places[e + 1, 2] - work.places[e, 2]))
    return negative, gradient2


@compiled
def _keep(work, e, turns, gain0, gain1, inverse, half):
    turning, gain, kept, out = work.turning[e], work.gain[e], work.inverse[e], work.half[e]
    for j in range(3):
        turn = turns[j]
        turning[j, 0], turning[j, 1], turning[j, 2] = turn
        gain[j, 0], gain[j, 1] = gain0[j], gain1[j]
        kept[j], kept[3 + j] = inverse[j], inverse[3 + j]
        out[j] = half[j]


@compiled
def _finish(work, out):
    """Fill `out` with the second half of a solution; return the largest turn of a node in rad."""
    th0 = th1 = th2 = largest = 0.0
    for e in range(out.shape[0]):
        gain, turn, half = work.gain[e], work.turning[e], work.half[e]
        s0 = -half[0] - gain[0, 0] * th0 - gain[0, 1] * th1
        s1 = -half[1] - gain[1, 0] * th0 - gain[1, 1] * th1
        s2 = -half[2] - gain[2, 0] * th0 - gain[2, 1] * th1
        out[e, 0], out[e, 1], out[e, 2] = s0, s1, s2
        th0 += turn[0, 0] * s0 + turn[1, 0] * s1 + turn[2, 0] * s2
        th1 += turn[0, 1] * s0 + turn[1, 1] * s1 + turn[2, 1] * s2
        th2 += turn[0, 2] * s0 + turn[1, 2] * s1 + turn[2, 2] * s2
        largest = max(largest, th0 * th0 + th1 * th1 + th2 * th2)
    return sqrt(largest)


@compiled
def _solve(work, right, out):
    """Fill `out` with (Hessian + shift)^-1 right, factorized by `_sweep`."""
    slope0 = slope1 = 0.0
    for e in range(right.shape[0] - 1, -1, -1):
        gain, turn = work.gain[e], work.turning[e]
        rhs = (turn[0, 0] * slope0 + turn[0, 1] * slope1 - right[e, 0],
               turn[1, 0] * slope0 + turn[1, 1] * slope1 - right[e, 1],
               turn[2, 0] * slope0 + turn[2, 1] * slope1 - right[e, 2])
        half = _times(work.inverse[e], rhs)
        work.half[e, 0], work.half[e, 1], work.half[e, 2] = half
        slope0 -= gain[0, 0] * rhs[0] + gain[1, 0] * rhs[1] + gain[2, 0] * rhs[2]
        slope1 -= gain[0, 1] * rhs[0] + gain[1, 1] * rhs[1] + gain[2, 1] * rhs[2]
    return _finish(work, out)


@compiled
def _turn_of(work, step):
    """Return the largest turn of a node in rad that a step (N, 3) makes."""
    largest = 0.0
    turn = np.zeros(3)
    for e in range(step.shape[0]):
        for i in range(3):
            for j in range(3):
                turn[i] += work.turning[e, j, i] * step[e, j]
        largest = max(largest, _dot(turn, turn))
    return sqrt(largest)


@compiled
def _inner(a, b):
    total = 0.0
    for e in range(a.shape[0]):
        total += a[e, 0] * b[e, 0] + a[e, 1] * b[e, 1] + a[e, 2] * b[e, 2]
    return total


@compiled
def _add(a, factor, b):
    for e in range(a.shape[0]):
        for i in range(3):
            a[e, i] += factor * b[e, i]


@compiled
def _top(diagonal, beside, size):
    """Return the largest eigenvalue of a symmetric tridiagonal matrix, by bisection."""
    low = high = diagonal[0]
    for k in range(size):
        radius = (beside[k - 1] if k else 0.0) + (beside[k] if k < size - 1 else 0.0)
        low, high = max(low, diagonal[k]), max(high, diagonal[k] + radius)
    while high - low > 1e-13 * abs(high):
        middle, above, pivot = 0.5 * (low + high), False, 1.0
        for k in range(size):
            pivot = diagonal[k] - middle - (beside[k - 1] ** 2 / pivot if k else 0.0)
            if pivot > 0:
                above = True
                break
            pivot = min(pivot, -1e-300)
        if above:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@compiled
def _lowest(work, shift, mode):
    """Return the smallest eigenvalue of the Hessian, by Lanczos on its inverse; fill its mode."""
    vectors, diagonal, beside = work.vectors, np.zeros(_LANCZOS), np.zeros(_LANCZOS)
    vectors[0] = work.side
    used, previous = _LANCZOS, 0.0
    for k in range(_LANCZOS):
        image = vectors[k + 1]
        _solve(work, vectors[k], image)
        diagonal[k] = _inner(image, vectors[k])
        _add(image, -diagonal[k], vectors[k])
        if k:
            _add(image, -beside[k - 1], vectors[k - 1])
        beside[k] = sqrt(_inner(image, image))
        if not beside[k] > 1e-13 * abs(diagonal[k]):  # the side is a sum of k + 1 modes
            used = k + 1
            break
        _add(image, 1 / beside[k] - 1, image)
        if k % 3 == 2:
            top = _top(diagonal, beside, k + 1)
            if abs(top - previous) < 1e-4 * top:
                used = k + 1
                break
            previous = top
    value = 1 / _top(diagonal, beside, used) - shift
    if value < 1e-3:
        matrix = np.zeros((used, used))
        for k in range(used):
            matrix[k, k] = diagonal[k]
            if k:
                matrix[k, k - 1] = matrix[k - 1, k] = beside[k - 1]
        _, modes = np.linalg.eigh(matrix)
        mode[:] = 0.0
        for k in range(used):
            _add(mode, modes[k, used - 1] * (1.0 if modes[0, used - 1] > 0 else -1.0), vectors[k])
    return value


@compiled
def _factorize(wire, scale, work, shift):
    """Return the first shift in a row that leaves no negative pivot, and gradient squared."""
    negative, gradient2 = _sweep(wire, scale, work.q, work, shift)
    while negative > 0:
        shift = max(1e-3, 4.0 * shift)
        negative, gradient2 = _sweep(wire, scale, work.q, work, shift)
    return shift, gradient2


@compiled
def _kick(wire, scale, base, work, energy, noise):
    """Move q off a saddle along work.step, to the lower side; return whether there is one."""
    size = _KICK / _turn_of(work, work.step)
    for _ in range(20):
        work.trial[:] = work.q + size * work.step
        plus, _ = _march(wire, scale, work.trial, base, work)
        work.trial[:] = work.q - size * work.step
        minus, _ = _march(wire, scale, work.trial, base, work)
        if min(plus, minus) < energy - 10 * noise:
            sign = 1.0 if energy - plus >= 0.5 * (energy - minus) else -1.0
            work.q[:] = work.q + sign * size * work.step
            return True
        size *= 0.5
    return False


@compiled
def _fall(wire, scale, base, work, gradient_step, energy, noise):
    """Move q along work.step until the energy has fallen; return energy, noise, and if it has."""
    fraction = 1.0
    while fraction > 1e-9:
        work.trial[:] = work.q + fraction * work.step
        new, new_noise = _march(wire, scale, work.trial, base, work)
        gain = fraction * gradient_step
        if new <= energy + 1e-4 * gain or abs(gain) < 100 * noise:
            work.q[:] = work.trial
            return new, new_noise, True
        fraction *= 0.5
    _march(wire, scale, work.q, base, work)
    return energy, noise, False


@compiled
def search(wire, base, work):
    """Descend from work.q to a minimum; return residual, lowest eigenvalue, Newton steps.

    Args:
        base: (3, 3) rotation of the gripper, columns t, n, b
    """
    scale = (sqrt(wire.h / wire.torsion), sqrt(wire.h / wire.bending))
    bend = wire.bending / (wire.h * work.q.shape[0])
    energy, noise = _march(wire, scale, work.q, base, work)
    shift, steps, kicks, leans = 0.0, 0, 0, False
    while True:
        shift, gradient2 = _factorize(wire, scale, work, shift)
        residual = sqrt(gradient2 / (_inner(work.q, work.q) + bend))
        if residual < _TOLERANCE or steps == _MOST:
            shift, _ = _factorize(wire, scale, work, 0.0) if shift > 0 else (shift, 0.0)
            value = _lowest(work, shift, work.step)
            stays = value > -_NEUTRAL or kicks == 10 or steps == _MOST
            if stays or not _kick(wire, scale, base, work, energy, noise):
                return residual, value, steps
            kicks, leans, shift = kicks + 1, False, 0.0
            energy, noise = _march(wire, scale, work.q, base, work)
            continue
        if shift > _FALLING and not leans:
            leans = True
            _add(work.q, _LEAN / _turn_of(work, work.side), work.side)
            energy, noise = _march(wire, scale, work.q, base, work)
            continue
        turn = _finish(work, work.step)
        factor = min(1.0, _LARGEST_TURN / max(turn, 1e-300))
        if factor < 1.0:
            _add(work.step, factor - 1.0, work.step)
        # the slope along the step, from  (H + shift) step = - gradient: no gradient is stored
        slope = -factor * gradient2 if gradient2 < 1e-20 else -factor * _decrease(work)
        energy, noise, moved = _fall(wire, scale, base, work, slope, energy, noise)
        steps += 1
        shift = (0.0 if shift < 1e-3 else 0.1 * shift) if moved else max(1e-2, 10.0 * shift)


@compiled
def _decrease(work):
    """Return gradient^T (H + shift)^-1 gradient: the sum over the pivots of the sweep."""
    total = 0.0
    for e in range(work.half.shape[0]):
        p00, p11, p22, p10, p20, p21 = work.inverse[e]
        inverse, _ = _inverse(p00, p11, p22, p10, p20, p21)
        total += _dot(work.half[e], _times(inverse, work.half[e]))
    return total


@compiled
def solve_all(wire, bases, warm, work, positions, figures):
    """Solve for each gripper rotation (n, 3, 3), from the natural shape or the one before (`warm`).

    Fills positions (n, N + 1, 3), and figures (n, 3): residual, lowest eigenvalue, Newton steps.
    """
    work.q[:] = 0.0
    for k in range(bases.shape[0]):
        if not warm:
            work.q[:] = 0.0
        figures[k, 0], figures[k, 1], figures[k, 2] = search(wire, bases[k], work)
        positions[k] = work.places


def solved(wire, bases, warm=False, work=None):
    """Return positions (n, N + 1, 3) and figures (n, 3) as `solve_all` fills them."""
    n = wire.weights.size - 1
    positions, figures = np.empty((len(bases), n + 1, 3)), np.empty((len(bases), 3))
    solve_all(wire, np.ascontiguousarray(bases), warm, work or new_work(n), positions, figures)
    return positions, figures
