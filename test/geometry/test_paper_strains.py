# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dlo_planner.geometry.basis import (
    add,
    element_rotation,
    from_components,
    to_components,
)

values = st.floats(-20, 20)
strains = st.tuples(values, values, values).map(lambda row: np.array([row]))


@given(strains)
def test_conversion_is_exact(components):
    again = to_components(from_components(components))
    np.testing.assert_allclose(again, components, atol=1e-13)


@given(strains, strains)
def test_deformations_add_as_their_components(one, other):
    total = add(from_components(one), from_components(other))
    np.testing.assert_allclose(to_components(total), one + other, atol=1e-6)


def test_without_curvature_the_direction_is_zero():
    np.testing.assert_array_equal(from_components([[3.0, 0.0, 0.0]]), [[0.0, 0.0, 3.0]])
    opposite = add([[0.3, 2.0, 1.0]], [[0.3 + np.pi, 2.0, 1.0]])
    np.testing.assert_allclose(opposite[0, 1:], [0.0, 2.0], atol=1e-7)


def test_negative_amount_is_the_opposite_direction():
    np.testing.assert_allclose(to_components([[0.4, -2.0, 1.0]]),
                               to_components([[0.4 + np.pi, 2.0, 1.0]]), atol=1e-15)


def test_equation_16_is_the_exponential_of_small_components():
    described = np.array([0.7, 2.0, -1.5])
    components = to_components(described[None])[0]
    errors = []
    for length in (0.02, 0.01):
        exact = Rotation.from_rotvec(length * components).as_matrix()
        errors.append(np.abs(element_rotation(described, length) - exact).max())
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 3.8  # the order of the two rotations matters at second order


def test_pure_bending_turns_the_tangent_about_the_rotated_normal():
    # curvature in the direction q_d = 90 degrees is about b: the tangent turns towards n
    turned = element_rotation((np.pi / 2, 1.0, 0.0), 0.1) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(turned, [np.cos(0.1), np.sin(0.1), 0.0], atol=1e-15)
