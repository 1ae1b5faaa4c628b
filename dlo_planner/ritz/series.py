"""The basis functions of the Ritz series, Eq. 4, and their orthonormal form on a mesh.

Every strain is written as its natural value plus a series. The functions are orthonormalised
(QR, weights h) so that the elastic energy is half the squared norm of the unknowns; what the
series spans is the paper's, what the minimiser sees is well conditioned.
"""

import numpy as np

BASES = ('chebyshev', 'fourier', 'local')


def chebyshev(x, n_terms):
    """Return T_j(x) = cos(j arccos x), j < n_terms, at x (m,) in [-1, 1], as (m, n_terms)."""
    return np.cos(np.arccos(np.clip(x, -1.0, 1.0))[:, None] * np.arange(n_terms))


def fourier(x, n_terms):
    """Return 1, cos y, sin y, cos 2y, ... with y = pi x, at x (m,) in [-1, 1], (m, n_terms)."""
    order = (np.arange(n_terms) + 1) // 2
    phase = np.pi * np.asarray(x)[:, None] * order
    return np.where(np.arange(n_terms) % 2 == 1, np.cos(phase), np.where(order == 0, 1.0,
                                                                         np.sin(phase)))


def orthonormal_basis(basis, n_terms, s):
    """Return (N, n_terms): the basis at the middle of the elements, orthonormal with weight h.

    Args:
        basis: 'chebyshev' or 'fourier'; 'local' gives (N, 0), one unknown strain per element
        n_terms: N_c
        s: (N + 1,) nodes, s[0] = 0, s[-1] = L
    """
    if basis == 'local':
        return np.zeros((s.size - 1, 0))
    middle = 0.5 * (s[1:] + s[:-1])
    functions = {'chebyshev': chebyshev, 'fourier': fourier}[basis]
    root = np.sqrt(np.diff(s))[:, None]
    q, r = np.linalg.qr(root * functions(2 * middle / s[-1] - 1, n_terms))
    return np.ascontiguousarray(q * np.sign(np.diag(r)) / root)
