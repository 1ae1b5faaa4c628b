# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Joint trajectories and joint states as messages."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory as JointTrajectoryMsg

from dlo_planner import InvalidTask
from dlo_planner.arm.joint_trajectory import JointTrajectory
from msg_helpers.trajectories import joint_trajectory_msg, positions_from_joint_state


def test_all_of_it_arrives(rng):
    times = np.array([0.0, 0.1, 1.9999999996, 12.25])
    given = JointTrajectory(('b', 'a'), times, *rng.normal(size=(3, 4, 2)))
    msg = deserialize_message(serialize_message(joint_trajectory_msg(given)), JointTrajectoryMsg)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (0, 0)  # starts when it arrives
    assert msg.joint_names == ['b', 'a']
    for k, point in enumerate(msg.points):
        np.testing.assert_array_equal(point.positions, given.positions[k])
        np.testing.assert_array_equal(point.velocities, given.velocities[k])
        np.testing.assert_array_equal(point.accelerations, given.accelerations[k])
    assert [(point.time_from_start.sec, point.time_from_start.nanosec) for point in msg.points] == [
        (0, 0), (0, 100_000_000), (2, 0), (12, 250_000_000)]


def test_joint_states():
    assert positions_from_joint_state(JointState(name=['a', 'b'], position=[1.0, -2.0])) == {
        'a': 1.0, 'b': -2.0}
    assert positions_from_joint_state(JointState(name=['a'], velocity=[1.0])) == {}
    with pytest.raises(InvalidTask, match='joint_state has 2 names and 1 positions'):
        positions_from_joint_state(JointState(name=['a', 'b'], position=[1.0]))
    with pytest.raises(InvalidTask, match='joint_state: b = nan: expected a finite number'):
        positions_from_joint_state(JointState(name=['a', 'b'], position=[1.0, float('nan')]))
