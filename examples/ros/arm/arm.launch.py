# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A six-axis arm by its URDF and joint_trajectory_controller, led by the planner: see README.md.

With `mock:=false` only the planner is started: the driver of a real arm does the rest.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

HERE = Path(__file__).resolve().parent
PLANNER = HERE.parents[2] / 'launch' / 'planner.launch.py'
CONTROLLERS = str(HERE / 'controllers.yaml')


def generate_launch_description():
    """Return the planner, and the arm with its controller if it is asked for."""
    mock = IfCondition(LaunchConfiguration('mock'))
    return LaunchDescription([
        DeclareLaunchArgument('mock', default_value='true', choices=['true', 'false'],
                              description='Whether to start an arm that is not there.'),
        DeclareLaunchArgument('params_file', default_value=str(HERE / 'planner.yaml'),
                              description='Parameters of the planner: DLO, tool, limits.'),
        DeclareLaunchArgument('arm', default_value='tool0',
                              description='The link of robot_description with the gripper.'),
        DeclareLaunchArgument('controller', default_value='/joint_trajectory_controller',
                              description='The joint_trajectory_controller of the arm.'),
        Node(package='robot_state_publisher', executable='robot_state_publisher', condition=mock,
             parameters=[{'robot_description': ParameterValue(
                 (HERE / 'arm.urdf').read_text(), value_type=str)}]),
        Node(package='controller_manager', executable='ros2_control_node', condition=mock,
             parameters=[CONTROLLERS],
             remappings=[('~/robot_description', '/robot_description')]),
        Node(package='controller_manager', executable='spawner', condition=mock,
             arguments=['joint_state_broadcaster', 'joint_trajectory_controller',
                        '--param-file', CONTROLLERS]),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(PLANNER)),
            launch_arguments=[(name, LaunchConfiguration(name))
                              for name in ('params_file', 'arm', 'controller')]
            + [('through', 'joints')])])
