# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation, Slerp

from dlo_planner.geometry.so3 import (
    jacobians,
    partway,
    rotation_and_chord,
    rotation_vector,
)

VECTORS = [np.zeros(3), np.array([1e-4, -2e-4, 5e-5]), np.array([0.02, 0.1, -0.07]),
           np.array([0.5, -0.6, 0.62]), np.array([0.5, -0.6, 0.63]), np.array([2.0, 1.0, -2.5])]


def arc(phi, h=0.7):
    turn, chord = rotation_and_chord(*phi, h)
    return np.reshape(turn, (3, 3)), np.array(chord)


def derivatives(phi, h=0.7):
    rotation_jacobian, chord_jacobian = jacobians(*phi, h)
    return np.reshape(rotation_jacobian, (3, 3)), np.reshape(chord_jacobian, (3, 3))


@pytest.mark.every(3)
@pytest.mark.parametrize('phi', VECTORS)
def test_arc_is_the_integral_of_the_rotating_tangent(phi):
    turn, chord = arc(phi)
    expected, _ = quad_vec(lambda t: 0.7 * Rotation.from_rotvec(t * phi).as_matrix()[:, 0], 0, 1,
                           epsabs=1e-14)
    np.testing.assert_allclose(turn, Rotation.from_rotvec(phi).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(chord, expected, atol=1e-14)


@pytest.mark.parametrize('phi', VECTORS)
def test_jacobians_against_differences(phi):
    rotation_jacobian, chord_jacobian = derivatives(phi)
    step = 1e-6
    for j in range(3):
        change = step * np.eye(3)[j]
        (turn_up, chord_up), (turn_down, chord_down) = arc(phi + change), arc(phi - change)
        spin = Rotation.from_matrix(turn_up @ turn_down.T).as_rotvec() / (2 * step)
        np.testing.assert_allclose(rotation_jacobian[:, j], spin, atol=1e-9)
        np.testing.assert_allclose(chord_jacobian[:, j], (chord_up - chord_down) / (2 * step),
                                   atol=1e-9)


# ---- rotations ------------------------------------------------------------------------------


AXES = [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, -0.64, 0.48), (-0.2, 0.3, -0.9)]
ANGLES = [0.0, 1e-9, 1e-3, 0.7, 2.0, 3.0, np.pi - 1e-6]


def unit(axis):
    return np.array(axis) / np.linalg.norm(axis)


@pytest.mark.parametrize('axis', AXES)
@pytest.mark.parametrize('angle', ANGLES)
def test_the_vector_of_a_rotation(axis, angle):
    matrix = Rotation.from_rotvec(angle * unit(axis)).as_matrix()
    found = rotation_vector(tuple(matrix.ravel()))
    np.testing.assert_allclose(found, angle * unit(axis), atol=2e-15 * max(angle, 1))


def test_half_a_turn_has_an_axis():
    for axis in AXES:
        matrix = Rotation.from_rotvec(np.pi * unit(axis)).as_matrix()
        found = np.array(rotation_vector(tuple(matrix.ravel())))
        assert np.linalg.norm(found) == pytest.approx(np.pi)
        assert abs(found @ unit(axis)) == pytest.approx(np.pi)


def test_part_of_the_way(rng):
    for _ in range(20):
        both = Rotation.random(2, random_state=int(rng.integers(1 << 31)))
        one, other = both.as_matrix()
        one.flags.writeable = other.flags.writeable = False
        way = Slerp([0, 1], both)
        for fraction in (0.0, 0.3, 1.0):
            np.testing.assert_allclose(partway(one, other, fraction),
                                       way(fraction).as_matrix(), atol=3e-15)
