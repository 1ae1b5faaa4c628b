"""Look at a running planner: `rviz:=true` in RViz, `viewer:=true` on a page in the browser."""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    """Return RViz with config/planner.rviz, and the viewer, each if it is asked for."""
    settings = PathJoinSubstitution([FindPackageShare('dlo_planner'), 'config', 'planner.rviz'])
    viewer = {
        'planner': ParameterValue(LaunchConfiguration('planner'), value_type=str),
        'port': ParameterValue(LaunchConfiguration('port'), value_type=int),
        'allow_execute': ParameterValue(LaunchConfiguration('allow_execute'), value_type=bool)}
    return LaunchDescription([
        DeclareLaunchArgument('rviz', default_value='true', description='whether to start RViz'),
        DeclareLaunchArgument('viewer', default_value='false',
                              description='whether to offer the page (extra `view`)'),
        DeclareLaunchArgument('planner', default_value='/dlo_planner',
                              description='full name of the planner node, for the page'),
        DeclareLaunchArgument('port', default_value='8080', description='of the page'),
        DeclareLaunchArgument('allow_execute', default_value='false',
                              description='whether the page may execute plans'),
        Node(package='rviz2', executable='rviz2', arguments=['-d', settings],
             condition=IfCondition(LaunchConfiguration('rviz'))),
        Node(package='dlo_planner', executable='viewer', parameters=[viewer], output='screen',
             condition=IfCondition(LaunchConfiguration('viewer'))),
    ])
