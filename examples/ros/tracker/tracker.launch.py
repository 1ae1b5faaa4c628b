# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A tracker whose points tell what the DLO is like: see README.md.

With `mock:=false` only the planner is started: your tracker and your robot do the rest.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

HERE = Path(__file__).resolve().parent
PLANNER = HERE.parents[2] / 'launch' / 'planner.launch.py'
SERVO = HERE.parent / 'servo' / 'servo.py'


def generate_launch_description():
    """Return the planner, and a tracker and a gripper that stands, if they are asked for."""
    mock = IfCondition(LaunchConfiguration('mock'))
    pose, points = LaunchConfiguration('gripper_pose'), LaunchConfiguration('tracker')
    return LaunchDescription([
        DeclareLaunchArgument('mock', default_value='true', choices=['true', 'false'],
                              description='Whether to start a tracker that plays looks.csv, and '
                                          'a gripper that stands.'),
        DeclareLaunchArgument('params_file', default_value=str(HERE / 'planner.yaml'),
                              description='Parameters of the planner: DLO, camera, tool.'),
        DeclareLaunchArgument('tracker', default_value='/tracker/points',
                              description="Topic (PointCloud2) of the tracker's points."),
        DeclareLaunchArgument('gripper_pose', default_value='/servo/pose',
                              description='Topic (PoseStamped) that says where the tool is.'),
        ExecuteProcess(cmd=['python3', str(HERE / 'tracker.py'), '--ros-args',
                            '-r', ['points:=', points]], condition=mock),
        ExecuteProcess(cmd=['python3', str(SERVO), '--ros-args',
                            '-r', ['gripper_pose:=', pose]], condition=mock),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(PLANNER)),
            launch_arguments=[(name, LaunchConfiguration(name))
                              for name in ('params_file', 'tracker', 'gripper_pose')])])
