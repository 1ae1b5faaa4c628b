# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from dlo_planner.geometry.basis import chebyshev, fourier, fourier_polynomial, orthonormal_basis


def test_chebyshev_polynomials():
    x = np.linspace(-1, 1, 7)
    expected = np.column_stack([np.ones_like(x), x, 2 * x**2 - 1, 4 * x**3 - 3 * x])
    np.testing.assert_allclose(chebyshev(x, 4), expected, atol=1e-14)


def test_fourier_terms():
    x = np.linspace(-1, 1, 7)
    y = np.pi * x
    expected = np.column_stack([np.ones_like(x), np.cos(y), np.sin(y), np.cos(2 * y)])
    np.testing.assert_allclose(fourier(x, 4), expected, atol=1e-14)


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier', 'fourier_polynomial'])
def test_basis_is_orthonormal_and_spans_the_series(basis, rng):
    s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 40))])
    phi = orthonormal_basis(basis, 8, s)
    h = np.diff(s)
    np.testing.assert_allclose(phi.T @ (h[:, None] * phi), np.eye(8), atol=1e-12)
    middle = (s[1:] + s[:-1]) / s[-1] - 1
    series = {'chebyshev': chebyshev, 'fourier': fourier,
              'fourier_polynomial': fourier_polynomial}[basis](middle, 8)
    rest = series - phi @ (phi.T @ (h[:, None] * series))
    np.testing.assert_allclose(rest, 0, atol=1e-12)


@pytest.mark.parametrize('terms', [1, 3, 5, 6, 9])
def test_polynomials_stand_before_the_waves(terms):
    x = np.linspace(-1, 1, 7)
    expected = np.hstack([chebyshev(x, 5), fourier(x, 5)[:, 1:]])[:, :terms]
    np.testing.assert_allclose(fourier_polynomial(x, terms), expected, atol=1e-14)


def test_polynomials_make_a_series_converge():
    # of a function that differs at its ends; 20 more terms leave a fifth and a thousandth
    s = np.linspace(0, 1, 2001)
    values = np.exp(2 * 0.5 * (s[1:] + s[:-1]))

    def left(basis, terms):
        phi = orthonormal_basis(basis, terms, s)
        return np.sqrt(np.mean((values - phi @ (phi.T @ (values * np.diff(s))))**2))

    assert left('fourier', 32) > 0.3 * left('fourier', 12)
    assert left('fourier_polynomial', 32) < 0.01 * left('fourier_polynomial', 12)
    assert left('fourier_polynomial', 12) < 1e-3 * left('fourier', 12)


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier', 'fourier_polynomial'])
@pytest.mark.parametrize('elements', [2, 7, 8, 40])
def test_there_are_no_more_terms_than_elements(basis, elements):
    s = np.linspace(0, 1, elements + 1)
    phi = orthonormal_basis(basis, elements + 5, s)
    np.testing.assert_allclose(phi.T @ phi / elements, np.eye(elements), atol=1e-11)


def test_local_has_no_basis():
    assert orthonormal_basis('local', 0, np.linspace(0, 1, 5)).shape == (4, 0)
