# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The basis of the series, the paper's strains, and the error of mesh and series."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

# ------------------------------------------------------------------------------------------------
# The basis functions of the Ritz series, Eq. 4, and their orthonormal form on a mesh.
#
# Every strain is written as its natural value plus a series. The functions are orthonormalized
# (QR, weights h) so that the elastic energy is half the squared norm of the unknowns; what the
# series spans is the paper's, what the minimizer sees is well conditioned. Where the stiffness
# varies they are series of moments, which do not jump where it does.


BASES = ('chebyshev', 'fourier', 'fourier_polynomial', 'local')
_DEGREE = 4  # of the polynomials beside Fourier's terms


def chebyshev(x: Floats, n_terms: int) -> Floats:
    """Return T_j(x) = cos(j arccos x), j < n_terms, at x (m,) in [-1, 1], as (m, n_terms)."""
    return np.cos(np.arccos(np.clip(x, -1.0, 1.0))[:, None] * np.arange(n_terms))


def fourier(x: Floats, n_terms: int) -> Floats:
    """Return 1, cos y, sin y, cos 2y, ... with y = pi x, at x (m,) in [-1, 1], (m, n_terms)."""
    order = (np.arange(n_terms) + 1) // 2
    phase = np.pi * np.asarray(x)[:, None] * order
    return np.where(np.arange(n_terms) % 2 == 1, np.cos(phase), np.where(order == 0, 1.0,
                                                                         np.sin(phase)))


def fourier_polynomial(x: Floats, n_terms: int) -> Floats:
    """Return 1, polynomials to degree 4, then cos y, sin y, ... at x (m,), as (m, n_terms).

    A Fourier series continues a strain with period L, with a jump where the ends do not fit, so its
    terms fall off like 1/n. The polynomials carry the jumps of the strain and of its first three
    derivatives (Lanczos, Discourse on Fourier Series); what is left falls off like 1/n^5.
    """
    waves = fourier(x, max(n_terms - _DEGREE, 1))
    return np.hstack([chebyshev(x, min(n_terms, _DEGREE + 1)), waves[:, 1:]])


_FUNCTIONS = {'chebyshev': chebyshev, 'fourier': fourier, 'fourier_polynomial': fourier_polynomial}


def converging(basis: str) -> str:
    """Return the basis that takes the place of `basis` where an accuracy has to be reached."""
    return 'fourier_polynomial' if basis == 'fourier' else basis


def orthonormal_basis(basis: str, n_terms: int, s: Floats, stiffness: Floats) -> Floats:
    """Return (3, N, m): the basis of each strain at the elements, orthonormal with weight h.

    Its functions are those named, at the middle of the elements, over the root of the stiffness. N
    strains are all that N elements can have, so m is n_terms or N, whichever is less: further
    terms could not be told from the first N, and nothing is lost without them. (3, 0, 0): local.

    Shapes: s (N + 1,), stiffness (N, 3).
    """
    if basis == 'local':
        return np.zeros((3, 0, 0))
    middle = 0.5 * (s[1:] + s[:-1])
    root = np.sqrt(np.diff(s))[:, None]
    functions = _FUNCTIONS[basis](2 * middle / s[-1] - 1, min(n_terms, middle.size))
    weights = root / np.sqrt(stiffness / stiffness[0])  # of even rods the same to the last bit
    q, r = np.linalg.qr(weights.T[:, :, None] * functions)
    signs = np.where(np.diagonal(r, axis1=1, axis2=2) < 0, -1.0, 1.0)
    return np.ascontiguousarray(q * signs[:, None] / root)


# ------------------------------------------------------------------------------------------------
# The paper's description of bending and torsion: (q_d, q_kappa, q_tau), sections 3.3.1, 3.3.2.
#
# q_d is the direction of curvature (the angle of its axis from n about t), q_kappa its amount,
# q_tau the torsion. The components used elsewhere are (torsion, curvature about n, curvature about
# b) = (q_tau, q_kappa cos q_d, q_kappa sin q_d), exactly. Where there is no curvature its
# direction is not defined, and small changes of shape are large changes of q_d: the reason why the
# components are what the simulators use.


def from_components(strains: ArrayLike) -> Floats:
    """Return (n, 3) q_d in (-pi, pi], q_kappa >= 0, q_tau of component strains (n, 3).

    Without curvature q_d is 0.
    """
    torsion, about_n, about_b = np.asarray(strains, dtype=float).T
    amount = np.hypot(about_n, about_b)
    direction = np.where(amount > 0, np.arctan2(about_b, about_n), 0.0)
    return np.column_stack([direction, amount, torsion])


def to_components(described: ArrayLike) -> Floats:
    """Return (n, 3) torsion, curvature about n, about b of (q_d, q_kappa, q_tau) (n, 3).

    A negative q_kappa is curvature in the opposite direction.
    """
    direction, amount, torsion = np.asarray(described, dtype=float).T
    return np.column_stack([torsion, amount * np.cos(direction), amount * np.sin(direction)])


# ------------------------------------------------------------------------------------------------
# How far a shape can be off because its mesh and its series end: a figure, not a bound.


OF_AN_ARC = 12  # h^3 |u'| / 12: how far an arc's end is off
_TWISTED = np.pi  # with more, elements misplace by turns, not by gradients


@kernel
def truncation_error(lengths: Floats, strains: Floats, natural: Floats, scale: Floats,
                     basis: Floats) -> float:
    """Return how far, in m, the free end may be off by mesh and series.

    Arcs of constant strain misplace the end of an element by h^3 |u'| / 12, and a series that ends
    too early by what its last two terms still do.
    """
    terms = basis.shape[2]
    last = np.zeros(3)  # of the series, as strains
    total = lengths[0]
    mesh = 0.0
    for e in range(1, lengths.size):
        h = lengths[e]
        total += h
        change = 0.0
        for i in range(3):
            change += abs(strains[e, i] - natural[e, i] - strains[e - 1, i] + natural[e - 1, i])
        mesh += h * h * h * change / (0.5 * (h + lengths[e - 1]))
    series = 0.0
    for j in range(max(terms - 2, 0), terms):
        last[:] = 0.0
        for e in range(lengths.size):
            for i in range(3):
                last[i] += (basis[i, e, j] * lengths[e] * (strains[e, i] - natural[e, i])
                            / scale[e, i])
        for i in range(3):
            series += abs(last[i]) * scale[0, i]
    if terms:
        series *= total * np.sqrt(total) / terms**2
    return mesh / OF_AN_ARC + series


def very_twisted(turn: Any) -> Any:
    """Whether `truncation_error` says too little of a DLO with so much natural twist, in rad."""
    return np.abs(turn) > _TWISTED


# ------------------------------------------------------------------------------------------------
# Which mesh shares out evenly the error of arcs of constant strain.


@kernel
def equidistribute(lengths: Floats, strains: Floats) -> Floats:
    """Return (N + 1,) where the nodes of a known shape lie on the best mesh, as parts of it.

    An arc whose strain should change at the rate u' misplaces its end by about h^3 |u'|, so
    the best density of elements goes with the cube root of |u'|; a floor keeps a third of the
    elements for where nothing seems to happen.

    Args:
        lengths: (N,) of its elements, m
        strains: (N, 3) of its elements, less what jumps in the natural ones, 1/m
    """
    n = lengths.size
    density, shares = np.zeros(n), np.zeros(n + 1)
    for e in range(1, n):
        square = 0.0
        for i in range(3):
            square += (strains[e, i] - strains[e - 1, i]) ** 2
        rate = np.sqrt(square) / (0.5 * (lengths[e] + lengths[e - 1]))
        density[e - 1] += rate if e == 1 else 0.5 * rate
        density[e] += rate if e == n - 1 else 0.5 * rate
    mean, length = 0.0, np.sum(lengths)
    for e in range(n):
        density[e] = np.cbrt(density[e] * length * length)  # a root of a number: units do not count
        mean += density[e] * lengths[e]
    mean /= length
    for e in range(n):
        more = density[e] / mean if mean > 0.0 else 0.0
        shares[e + 1] = shares[e] + (more + 0.5) * lengths[e]
    for k in range(n + 1):
        shares[k] /= shares[n]
    return shares
