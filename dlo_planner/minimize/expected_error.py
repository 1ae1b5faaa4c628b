# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The error of elements of constant strain, to leading order, from what they leave out.

A true strain changes along an element, u(s) = u + u' s from its middle on. To leading order in its
length h, beside the arc of its mean strain u,

* its end is turned by h^3 / 12  u x u'  more (Magnus: Iserles and Norsett 1999, in the body frame),
* and shifted by  - h^3 / 12  u' x t  (the arc's error is the opposite),
* and a load q per length, which stands on the nodes, bends it by the moment h^2 / 12  t x q too
  much, on average over the element.

These are put into the equilibrium as if they were given: what the mean strains, frames and
positions change by is their error. It is one solution with the Hessian that proves the shape.
On another mesh the same is left out, with its own h: errors there are known before it is made.
"""

from __future__ import annotations

import numpy as np
import scipy

from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import Problem, new_configuration, with_gripper
from dlo_planner.geometry.basis import equidistribute
from dlo_planner.geometry.so3 import (
    applied,
    cross,
    jacobians,
    matrix,
    plus,
    transposed_applied,
    vector,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hessian import assemble, factorize, new_hessian, solve
from dlo_planner.model.arrays import Floats


@kernel
def discretization_errors(system: Problem, base: Floats, strains: Floats,
            spread: Floats) -> tuple[float, Floats, Floats, float, Floats]:
    """Return the error of a DLO that hangs freely, and what it is on a mesh graded to its bend.

    Args:
        system: Problem of a local mesh; its `base` is not used
        base: (3, 3), read-only, rotation of the gripper
        strains: (N, 3), read-only, of its equilibrium, 1/m
        spread: (3,) derivative by the positions of the loads that are spread out, N/m
    """
    turned = with_gripper(system, base.copy(), np.zeros(3))
    state, hessian = new_configuration(turned), new_hessian(turned)
    unknowns_of(turned, strains.copy(), state.q)
    off, there = np.zeros_like(state.q), np.zeros_like(state.q)
    shares = equidistribute(system.lengths, strains.copy())
    evaluate(turned, state)
    assemble(turned, state, hessian)
    if factorize(turned, hessian, 0.0) > 0:
        return np.inf, off, shares, np.inf, there
    wanted = np.empty_like(system.lengths)
    for e in range(wanted.size):
        wanted[e] = system.lengths[e] / (shares[e + 1] - shares[e])
    own = _error(turned, state, hessian, spread, system.lengths, off)
    return own, off, shares, _error(turned, state, hessian, spread, wanted, there), there


@kernel
def _error(system, state, hessian, spread, wanted, off):
    """Return the error where elements are of lengths `wanted` (N,), fill that of strains (N, 3)."""
    left, shifts, right = np.empty_like(state.q), np.empty_like(state.q), np.empty_like(state.q)
    _left_out(system, state, spread, wanted, left, shifts, right)
    solve(system, hessian, right, off)
    return _moved(system, state, hessian.twist_jacobian, left, shifts, off)


def resampled_means(s: Floats, values: Floats, nodes: Floats) -> Floats:
    """Return the means (n, 3) over the elements of a finer mesh of a smooth function.

    By a spline through its integral, of degree 5 where there are nodes enough.

    Shapes: s (N + 1,) m, values (N, 3) means over their elements, nodes (n + 1,) m, on the same
    length.
    """
    total = np.vstack([np.zeros(3), np.cumsum(np.diff(s)[:, None] * values, axis=0)])
    integral = scipy.interpolate.make_interp_spline(s, total, min(5, s.size - 1))
    means: Floats = np.diff(integral(nodes), axis=0) / np.diff(nodes)[:, None]
    return means


@kernel
def _left_out(system, state, spread, wanted, left, shifts, right):
    """Fill what elements leave out, and the slope of the potential that it makes."""
    n, natural, strains = system.lengths.size, system.natural, state.strains
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(n):
        e = n - 1 - k
        h, scale = system.lengths[e], system.scale[e]
        force = plus(force, vector(state.pull[e + 1]))
        share = h * wanted[e] ** 2 / 12.0
        rate = _rate(system.lengths, strains, natural, e)
        turn = cross(vector(strains[e]), rate)
        begin, end = matrix(state.rotations[e]), matrix(state.rotations[e + 1])
        aside = cross(rate, (1.0, 0.0, 0.0))
        one, other = applied(begin, aside), applied(end, aside)
        shift = (-0.5 * share * (one[0] + other[0]), -0.5 * share * (one[1] + other[1]),
                 -0.5 * share * (one[2] + other[2]))
        tangent = (state.positions[e + 1, 0] - state.positions[e, 0],
                   state.positions[e + 1, 1] - state.positions[e, 1],
                   state.positions[e + 1, 2] - state.positions[e, 2])
        couple, lumped = cross(shift, force), cross(tangent, vector(spread))
        beside = cross(vector(strains[e]), (1.0, 0.0, 0.0))
        one, other = applied(begin, beside), applied(end, beside)
        aside = cross((one[0] + other[0], one[1] + other[1], one[2] + other[2]), vector(spread))
        couple = (couple[0] - 0.5 * share * aside[0], couple[1] - 0.5 * share * aside[1],
                  couple[2] - 0.5 * share * aside[2])
        stress = (system.stiffness[e, 0] * (strains[e, 0] - natural[e, 0]),
                  system.stiffness[e, 1] * (strains[e, 1] - natural[e, 1]),
                  system.stiffness[e, 2] * (strains[e, 2] - natural[e, 2]))
        within = cross(rate, stress)
        bent = (share * lumped[0] / h - h * (moment[0] + 0.5 * couple[0]),
                share * lumped[1] / h - h * (moment[1] + 0.5 * couple[1]),
                share * lumped[2] / h - h * (moment[2] + 0.5 * couple[2]))
        first, last = transposed_applied(begin, bent), transposed_applied(end, bent)
        moment = plus(moment, couple)
        for i in range(3):
            left[e, i] = -share * turn[i] / (h * scale[i])
            shifts[e, i] = shift[i]
            right[e, i] = left[e, i] - scale[i] * (0.5 * (first[i] + last[i]) + share * within[i])


@kernel
def _rate(lengths, strains, natural, e):
    """Return (3 numbers) the rate at which the strain changes in the middle of element e, 1/m^2."""
    n = lengths.size
    if n < 3:
        return 0.0, 0.0, 0.0
    c = min(max(e, 1), n - 2)
    before, after = 0.5 * (lengths[c - 1] + lengths[c]), 0.5 * (lengths[c] + lengths[c + 1])
    # the slope of a parabola through three elements, at the middle of this one
    place = -before if e < c else after if e > c else 0.0
    one = (2.0 * place - after) / (before * (before + after))
    three = (2.0 * place + before) / (after * (before + after))
    a, b, d = strains[c - 1], strains[c], strains[c + 1]
    u, v, w = natural[c - 1], natural[c], natural[c + 1]
    return (one * (a[0] - u[0] - b[0] + v[0]) + three * (d[0] - w[0] - b[0] + v[0]),
            one * (a[1] - u[1] - b[1] + v[1]) + three * (d[1] - w[1] - b[1] + v[1]),
            one * (a[2] - u[2] - b[2] + v[2]) + three * (d[2] - w[2] - b[2] + v[2]))


@kernel
def _moved(system, state, turning, left, shifts, off):
    """Return the largest displacement of a node; make `off` (N, 3) the errors of the strains."""
    place, theta, largest = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    for e in range(system.lengths.size):
        h, u, scale = system.lengths[e], state.strains[e], system.scale[e]
        turn = applied(matrix(turning[e]), vector(off[e]))
        for i in range(3):
            off[e, i] = scale[i] * (off[e, i] - left[e, i])
        _, chord = jacobians(h * u[0], h * u[1], h * u[2], h)
        along = applied(chord, (h * off[e, 0], h * off[e, 1], h * off[e, 2]))
        arm = (state.positions[e + 1, 0] - state.positions[e, 0],
               state.positions[e + 1, 1] - state.positions[e, 1],
               state.positions[e + 1, 2] - state.positions[e, 2])
        place = plus(plus(place, cross(theta, arm)), applied(matrix(state.rotations[e]), along))
        place = (place[0] - shifts[e, 0], place[1] - shifts[e, 1], place[2] - shifts[e, 2])
        theta = plus(theta, turn)
        largest = max(largest, place[0] ** 2 + place[1] ** 2 + place[2] ** 2)
    return np.sqrt(largest)
