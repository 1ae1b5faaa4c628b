# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Start the planner node for one of the DLOs in config/: `rod:=copper_wire` and so on."""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import LaunchDescription

# Beside this folder, in the source tree and where the package is installed.
CONFIG = Path(__file__).parent.parent / 'config'


def generate_launch_description():
    """Return the node with the parameters of the chosen DLO."""
    return LaunchDescription([
        DeclareLaunchArgument('rod', default_value='copper_wire',
                              choices=sorted(path.stem for path in CONFIG.glob('*.yaml')),
                              description='The DLO: name of a file in config/, without .yaml.'),
        DeclareLaunchArgument('namespace', default_value='',
                              description='Of the node, e.g. cell1: /cell1/dlo_planner.'),
        DeclareLaunchArgument('autostart', default_value='true', choices=['true', 'false'],
                              description='Whether the node configures and activates itself.'),
        Node(package='dlo_planner', executable='planner_node', name='dlo_planner',
             namespace=LaunchConfiguration('namespace'), output='screen',
             parameters=[ParameterFile([f'{CONFIG}/', LaunchConfiguration('rod'), '.yaml']),
                         {'autostart': ParameterValue(LaunchConfiguration('autostart'),
                                                      value_type=bool)}]),
    ])
