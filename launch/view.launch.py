# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Look at a running planner: in RViz, with `viewer:=true` on a page in the browser as well."""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

# Beside this folder, in the source tree and where the package is installed.
RVIZ = Path(__file__).parent.parent / 'config' / 'planner.rviz'
ARGUMENTS = {  # name -> default, description
    'rviz': ('true', 'Whether to start RViz.'),
    'viewer': ('false', 'Whether to offer the page (extra `view`).'),
    'planner': ('/dlo_planner', 'Full name of the planner node, for the page.'),
    'host': ('localhost', 'Where the page is offered.'),
    'port': ('8080', 'Of the page.'),
    'allow_execute': ('false', 'Whether the page may execute plans.')}


def generate_launch_description():
    """Return RViz with config/planner.rviz, and the viewer, each if it is asked for."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, (default, text) in ARGUMENTS.items()),
        Node(package='rviz2', executable='rviz2', arguments=['-d', str(RVIZ)],
             condition=IfCondition(LaunchConfiguration('rviz'))),
        Node(package='dlo_planner', executable='viewer', output='screen',
             parameters=[{name: LaunchConfiguration(name)
                          for name in ('planner', 'host', 'port', 'allow_execute')}],
             condition=IfCondition(LaunchConfiguration('viewer'))),
    ])
