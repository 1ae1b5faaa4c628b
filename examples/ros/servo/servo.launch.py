# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A Cartesian servo that follows gripper_command: see README.md.

With `mock:=false` only the planner is started: your servo does the rest.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

HERE = Path(__file__).resolve().parent
PLANNER = HERE.parents[2] / 'launch' / 'planner.launch.py'


def generate_launch_description():
    """Return the planner, and the servo if it is asked for."""
    pose, command = LaunchConfiguration('gripper_pose'), LaunchConfiguration('gripper_command')
    return LaunchDescription([
        DeclareLaunchArgument('mock', default_value='true', choices=['true', 'false'],
                              description='Whether to start a servo that is not there.'),
        DeclareLaunchArgument('params_file', default_value=str(HERE / 'planner.yaml'),
                              description='Parameters of the planner: DLO, tool, limits.'),
        DeclareLaunchArgument('gripper_pose', default_value='/servo/pose',
                              description='Topic (PoseStamped) that says where the tool is.'),
        DeclareLaunchArgument('gripper_command', default_value='/servo/command',
                              description='Topic (PoseStamped) that the servo follows.'),
        ExecuteProcess(
            cmd=['python3', str(HERE / 'servo.py'), '--ros-args',
                 '-p', 'begin:=[-0.6, 0.02, 1.02, 0.0, 0.0, 0.0, 1.0]',
                 '-r', ['gripper_pose:=', pose], '-r', ['gripper_command:=', command]],
            condition=IfCondition(LaunchConfiguration('mock'))),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(PLANNER)),
            launch_arguments=[(name, LaunchConfiguration(name))
                              for name in ('params_file', 'gripper_pose', 'gripper_command')]
            + [('through', 'pose')])])
