# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The basis functions of the Ritz series, Eq. 4, and their orthonormal form on a mesh.

Every strain is written as its natural value plus a series. The functions are orthonormalized
(QR, weights h) so that the elastic energy is half the squared norm of the unknowns; what the
series spans is the paper's, what the minimizer sees is well conditioned.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.model.arrays import Floats

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


def orthonormal_basis(basis: str, n_terms: int, s: Floats) -> Floats:
    """Return (N, m): the basis at the middle of the elements, orthonormal with weight h.

    N strains are all that N elements can have, so m is n_terms or N, whichever is less: further
    terms could not be told from the first N, and nothing is lost without them.

    Parameters
    ----------
    basis : str
        One of BASES; 'local' gives (N, 0), one unknown strain per element.
    n_terms : int
        Number of terms, N_c.
    s : ndarray, shape (N + 1,)
        Nodes, s[0] = 0, s[-1] = L.
    """
    if basis == 'local':
        return np.zeros((s.size - 1, 0))
    middle = 0.5 * (s[1:] + s[:-1])
    root = np.sqrt(np.diff(s))[:, None]
    terms = min(n_terms, middle.size)
    q, r = np.linalg.qr(root * _FUNCTIONS[basis](2 * middle / s[-1] - 1, terms))
    return np.ascontiguousarray(q * np.where(np.diag(r) < 0, -1.0, 1.0) / root)
