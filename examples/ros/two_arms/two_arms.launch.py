# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Two Cartesian servos that hold both ends of a wire: see README.md.

With `mock:=false` only the planner is started: your servos do the rest.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

HERE = Path(__file__).resolve().parent
SERVO = HERE.parent / 'servo' / 'servo.py'
PLANNER = HERE.parents[2] / 'launch' / 'planner.launch.py'
# of each servo: where it begins, the topic on which it reports, the one that it follows
ARMS = {'gripper': ('[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]', 'gripper_pose', 'gripper_command'),
        'far_end': ('[0.34, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]', 'far_end_pose',
                    'gripper_command/far_end')}


def generate_launch_description():
    """Return the planner, and the servos if they are asked for."""
    servos = [ExecuteProcess(
        cmd=['python3', str(SERVO), '--ros-args', '-r', f'__node:={name}_servo',
             '-p', f'begin:={begin}', '-r', f'gripper_pose:=/dlo_planner/{pose}',
             '-r', f'gripper_command:=/dlo_planner/{command}'],
        condition=IfCondition(LaunchConfiguration('mock')))
        for name, (begin, pose, command) in ARMS.items()]
    return LaunchDescription([
        DeclareLaunchArgument('mock', default_value='true', choices=['true', 'false'],
                              description='Whether to start servos that are not there.'),
        DeclareLaunchArgument('params_file', default_value=str(HERE / 'planner.yaml'),
                              description='Parameters of the planner: DLO, grips, limits.'),
        *servos,
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(PLANNER)),
            launch_arguments=[('params_file', LaunchConfiguration('params_file')),
                              ('through', 'pose')])])
