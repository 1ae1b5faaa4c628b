# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Run the demo, which starts a planner node of its own and checks what it answers."""

from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    """Return the demo; the launch ends when it does."""
    demo = Node(package='dlo_planner', executable='demo', output='screen',
                arguments=['--output', LaunchConfiguration('output')])
    return LaunchDescription([
        DeclareLaunchArgument('output', default_value='demo_output',
                              description='folder for the pictures'),
        demo,
        RegisterEventHandler(OnProcessExit(target_action=demo,
                                           on_exit=[EmitEvent(event=Shutdown())])),
    ])
