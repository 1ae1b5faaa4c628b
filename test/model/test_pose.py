# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from properties import given
from properties import strategies as st
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, InvalidTask, Pose
from dlo_planner.model.pose import angle_between

numbers = st.floats(-10, 10).filter(lambda x: abs(x) > 1e-3)
vectors = st.tuples(numbers, numbers, numbers)
quaternions = st.tuples(numbers, numbers, numbers, numbers)


@given(vectors, quaternions)
def test_matrix_round_trip(position, quaternion):
    pose = Pose(position, quaternion)
    again = Pose.from_matrix(pose.matrix)
    np.testing.assert_allclose(again.matrix, pose.matrix, atol=1e-12)


@given(vectors, quaternions)
def test_inverse_composes_to_identity(position, quaternion):
    pose = Pose(position, quaternion)
    np.testing.assert_allclose(pose.compose(pose.inverse()).matrix, np.eye(4), atol=1e-12)


@given(vectors)
def test_looking_along_is_upright(direction):
    pose = Pose.looking_along((0, 0, 0), direction)
    np.testing.assert_allclose(pose.direction, direction / np.linalg.norm(direction), atol=1e-12)
    assert abs(pose.rotation[2, 1]) < 1e-12  # the y axis is level
    assert pose.rotation[2, 2] >= -1e-12     # the z axis points up


@pytest.mark.parametrize('z', [1.0, -1.0])
def test_looking_along_the_vertical_is_defined(z):
    pose = Pose.looking_along((0, 0, 0), (0, 0, z))
    np.testing.assert_allclose(pose.direction, (0, 0, z), atol=1e-15)
    np.testing.assert_allclose(pose.rotation[:, 1], (0, 1, 0), atol=1e-15)


@pytest.mark.parametrize(('make', 'named'), [
    (lambda: Pose((0, 0, np.nan), (0, 0, 0, 1)), 'Pose.position'),
    (lambda: Pose((0, 0), (0, 0, 0, 1)), 'Pose.position has shape (2,)'),
    (lambda: Pose((0, 0, 0), (0, 0, 0, 0)), 'Pose.quaternion = [0.0, 0.0, 0.0, 0.0]'),
    (lambda: Pose.looking_along((0, 0, 0), (0, 0, 0)), 'direction'),
    (lambda: Pose.from_matrix(2 * np.eye(4)), 'rigid'),
    (lambda: CutOut('hole'), "CutOut.pose = 'hole'"),
    (lambda: CutOut(Pose.identity(), radius=0.0), 'CutOut.radius = 0.0'),
    (lambda: CutOut(Pose.identity(), width=1.0), 'both width and height'),
    (lambda: CutOut(Pose.identity(), 1.0, 1.0, 1.0), 'not both'),
])
def test_bad_values_are_named(make, named):
    with pytest.raises(InvalidTask) as caught:
        make()
    assert named in str(caught.value)


@pytest.mark.parametrize('axes', [
    2 * np.eye(3), 0.5 * np.eye(3), np.diag([1.0, 1.0, -1.0]), -np.eye(3), np.zeros((3, 3)),
    np.eye(3) + 1e-3, np.diag([1.0, 1.0, 1.0001])])
def test_axes_that_are_no_rotation_are_refused(axes):
    with pytest.raises(InvalidTask, match='rotation = .*expected orthonormal, right-handed axes'):
        Pose.from_rotation((0, 0, 0), axes)
    with pytest.raises(InvalidTask, match='rigid transform'):
        Pose.from_matrix(np.block([[axes, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))


def test_axes_that_are_nearly_a_rotation_are_made_one(rng):
    exact = Pose(rng.normal(size=3), rng.normal(size=4)).rotation
    near = Pose.from_rotation((0, 0, 0), exact + 1e-6 * rng.uniform(-1, 1, (3, 3))).rotation
    np.testing.assert_allclose(near.T @ near, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(near, exact, atol=3e-6)


def test_a_quaternion_may_be_large():
    np.testing.assert_allclose(Pose((0, 0, 0), (0, 0, 0, 1e70)).quaternion, (0, 0, 0, 1))


@pytest.mark.parametrize('angle', [0.0, 1e-12, 1e-5, 1.0, np.pi - 1e-9, np.pi])
def test_angles_between_orientations_are_exact_at_both_ends(angle):
    for axis in ((1, 0, 0), (0, 0.6, -0.8), (-0.48, 0.6, 0.64)):
        turn = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
        base = Rotation.from_euler('xyz', (0.3, -1.2, 2.0)).as_matrix()
        assert abs(angle_between(base, turn @ base) - angle) < 1e-15 + 1e-14 * angle


def test_quaternions_of_axes_are_those_of_scipy():
    turns = np.concatenate([Rotation.random(200, random_state=1).as_rotvec(), np.zeros((1, 3)),
                            np.pi * np.eye(3), (np.pi - 1e-9) * np.eye(3)])
    rotations = Rotation.from_rotvec(turns)
    for quaternion, matrix in zip(rotations.as_quat(), rotations.as_matrix(), strict=True):
        found = Pose.from_rotation(np.zeros(3), matrix).quaternion
        assert abs(found @ quaternion) == pytest.approx(1, abs=1e-15)
