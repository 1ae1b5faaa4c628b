# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from dlo_planner.geometry.so3 import partway, rotation_vector

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
