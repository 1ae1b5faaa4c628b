# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Good examples of arguments that are ROS messages, which not every machine has."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory
from visualization_msgs.msg import MarkerArray

from dlo_planner import Pose
from dlo_planner.arm.joint_stream import JointPoints
from msg_helpers.clouds import cloud_msg


def arguments():
    """Return examples by the names of arguments, as `specimens.arguments` does."""
    stamped = PoseStamped()
    stamped.header.frame_id = 'world'
    stamped.pose.orientation.w = 1.0
    return {
        'stamp': Time(), 'frame': Pose.identity(), 'poses.wrench_in.at': Pose.identity(),
        'wrench': (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 'obstacles.obstacles_msg.friction': 0.3,
        'poses.pose_from_msg.msg': stamped.pose,
        'markers.primitives_after.msg': MarkerArray(), 'markers.holds_msg.holds': (),
        'obstacles.obstacles_after.msg': MarkerArray(),
        'clouds.points_from_cloud.msg': cloud_msg(np.ones((2, 3)), 'world'),
        'poses.pose_from_stamped.msg': stamped,
        'trajectories.poses_from_path.path': Path(), 'trajectories.times_from_path.path': Path(),
        'trajectories.stamped_poses.msg': MultiDOFJointTrajectory(),
        'trajectories.poses_ahead.stamp': 1.0, 'trajectories.joint_points_msg.names': ['joint'],
        'told': JointPoints(1.0, np.zeros(1), *np.zeros((3, 1, 1))),
        'joint_state': JointState(name=['joint'], position=[0.5])}
