"""Start the planner node for one of the DLOs in config/: `rod:=copper_wire` and so on."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    """Return the node with the parameters of the chosen DLO."""
    parameters = PathJoinSubstitution(
        [FindPackageShare('dlo_planner'), 'config', [LaunchConfiguration('rod'), '.yaml']])
    return LaunchDescription([
        DeclareLaunchArgument('rod', default_value='copper_wire',
                              description='name of a file in config/, without .yaml'),
        Node(package='dlo_planner', executable='planner_node', name='dlo_planner',
             parameters=[parameters], output='screen'),
    ])
