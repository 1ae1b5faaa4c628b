# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Series along a DLO: orthonormal, and complete."""

import numpy as np
import pytest
from properties import given
from properties import strategies as st
from scipy.spatial.transform import Rotation

from dlo_planner.geometry.basis import (
    chebyshev,
    fourier,
    fourier_polynomial,
    from_components,
    orthonormal_basis,
    to_components,
)
from dlo_planner.geometry.kinematics import forward_kinematics


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
    stiffness = np.exp(rng.uniform(-3, 3, (40, 3)))
    h = np.diff(s)
    middle = (s[1:] + s[:-1]) / s[-1] - 1
    for phi, stiff in zip(orthonormal_basis(basis, 8, s, stiffness), stiffness.T, strict=True):
        np.testing.assert_allclose(phi.T @ (h[:, None] * phi), np.eye(8), atol=1e-12)
        series = {'chebyshev': chebyshev, 'fourier': fourier,
                  'fourier_polynomial': fourier_polynomial}[basis](middle, 8)
        series /= np.sqrt(stiff)[:, None]
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
        phi = orthonormal_basis(basis, terms, s, np.ones((2000, 3)))[0]
        return np.sqrt(np.mean((values - phi @ (phi.T @ (values * np.diff(s))))**2))

    assert left('fourier', 32) > 0.3 * left('fourier', 12)
    assert left('fourier_polynomial', 32) < 0.01 * left('fourier_polynomial', 12)
    assert left('fourier_polynomial', 12) < 1e-3 * left('fourier', 12)


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier', 'fourier_polynomial'])
@pytest.mark.parametrize('elements', [2, 7, 8, 40])
def test_there_are_no_more_terms_than_elements(basis, elements):
    s = np.linspace(0, 1, elements + 1)
    phi = orthonormal_basis(basis, elements + 5, s, np.ones((elements, 3)))[0]
    np.testing.assert_allclose(phi.T @ phi / elements, np.eye(elements), atol=1e-11)


# ---- the strain description of the paper, exact in both directions --------------------------


values = st.floats(-20, 20)
strains = st.tuples(values, values, values).map(lambda row: np.array([row]))


@given(strains)
def test_conversion_is_exact(components):
    again = to_components(from_components(components))
    np.testing.assert_allclose(again, components, atol=1e-13)


def test_without_curvature_the_direction_is_zero():
    np.testing.assert_array_equal(from_components([[3.0, 0.0, 0.0]]), [[0.0, 0.0, 3.0]])


def test_negative_amount_is_the_opposite_direction():
    np.testing.assert_allclose(to_components([[0.4, -2.0, 1.0]]),
                               to_components([[0.4 + np.pi, 2.0, 1.0]]), atol=1e-15)


# ---- equations 15 to 17 of the paper as printed, against the exact arcs used here -----------


STRAINS = np.array([[2.0, 3.0, -4.0]])  # torsion, curvature about n, about b


def printed(steps):
    """Return the free end: Eq. 16 for the rotation over ds, Eq. 17 and 15 as sums."""
    (direction, amount, torsion), ds = from_components(STRAINS)[0], 1.0 / steps
    turn = (Rotation.from_rotvec([direction, 0, 0]) * Rotation.from_rotvec([0, amount * ds, 0])
            * Rotation.from_rotvec([-direction, 0, 0]) * Rotation.from_rotvec([torsion * ds, 0, 0]))
    frame, end = np.eye(3), np.zeros(3)
    for _ in range(steps):
        end = end + frame[:, 0] * ds
        frame = frame @ turn.as_matrix()
    return end


def exact():
    rotations, positions = np.empty((2, 3, 3)), np.empty((2, 3))
    forward_kinematics(np.ones(1), STRAINS, np.eye(3), rotations, positions, np.empty((1, 7)))
    return positions[-1]


def test_they_are_of_first_order_and_one_exact_arc_is_their_limit():
    off = [np.linalg.norm(printed(steps) - exact()) for steps in (64, 256, 1024, 4096)]
    assert off[0] > 0.01
    np.testing.assert_allclose(np.array(off[:-1]) / off[1:], 4.0, rtol=0.05)
    extrapolated = (4 * printed(4096) - printed(1024)) / 3
    assert extrapolated == pytest.approx(exact(), abs=1e-6)
