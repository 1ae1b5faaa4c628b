import numpy as np
import pytest

from dlo_planner.ritz.series import chebyshev, fourier, orthonormal_basis


def test_chebyshev_polynomials():
    x = np.linspace(-1, 1, 7)
    expected = np.column_stack([np.ones_like(x), x, 2 * x**2 - 1, 4 * x**3 - 3 * x])
    np.testing.assert_allclose(chebyshev(x, 4), expected, atol=1e-14)


def test_fourier_terms():
    x = np.linspace(-1, 1, 7)
    y = np.pi * x
    expected = np.column_stack([np.ones_like(x), np.cos(y), np.sin(y), np.cos(2 * y)])
    np.testing.assert_allclose(fourier(x, 4), expected, atol=1e-14)


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier'])
def test_basis_is_orthonormal_and_spans_the_series(basis, rng):
    s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 40))])
    phi = orthonormal_basis(basis, 8, s)
    h = np.diff(s)
    np.testing.assert_allclose(phi.T @ (h[:, None] * phi), np.eye(8), atol=1e-12)
    middle = (s[1:] + s[:-1]) / s[-1] - 1
    series = {'chebyshev': chebyshev, 'fourier': fourier}[basis](middle, 8)
    rest = series - phi @ (phi.T @ (h[:, None] * series))
    np.testing.assert_allclose(rest, 0, atol=1e-12)


def test_local_has_no_basis():
    assert orthonormal_basis('local', 0, np.linspace(0, 1, 5)).shape == (4, 0)
