# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Start the planner node for a DLO of config/ (`rod:=copper_wire`) or of a file of your own.

`ros2 launch dlo_planner planner.launch.py --show-args` prints the arguments; examples/ros has
launch files of whole cells.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue

from launch import LaunchDescription

# Beside this folder, in the source tree and where the package is installed.
CONFIG = Path(__file__).parent.parent / 'config'
ARGUMENTS = {  # name -> default, description, choices
    'rod': ('copper_wire', 'The DLO: name of a file in config/, without .yaml; params_file counts '
                           'in its place.', sorted(path.stem for path in CONFIG.glob('*.yaml'))),
    'params_file': ('', 'Your own file of parameters, with its full path: the DLO, the tool, '
                        'limits (begin it with /**:, as those of config/). Empty: that of rod.',
                    None),
    'name': ('dlo_planner', 'Of the node; its topics and services begin with it.', None),
    'namespace': ('', 'Of the node, e.g. cell1: /cell1/dlo_planner.', None),
    'autostart': ('true', 'Whether the node configures and activates itself; false: a lifecycle '
                          'manager does.', ['true', 'false']),
    'through': ('', 'How the robot is told what is executed: pose (it follows gripper_command) | '
                    'ahead (gripper_commands_ahead) | joints (a joint_trajectory_controller). '
                    'Empty: as the file says (execute.through).', ['', 'pose', 'ahead', 'joints']),
    'arm': ('', 'The link of robot_description that carries the gripper, e.g. tool0: motions are '
                'solved for the joints of this arm (arm.tool_link). Empty: as the file says.',
            None),
    'controller': ('', 'The joint_trajectory_controller that is told the joints, with through:='
                       'joints, e.g. /joint_trajectory_controller. Empty: commands go out on '
                       '~/joint_commands_ahead, and move nothing.', None),
    'gripper_pose': ('', 'Topic (PoseStamped) that says where the tool of the robot is. Empty: '
                         '~/gripper_pose.', None),
    'gripper_command': ('', 'Topic (PoseStamped) of a servo that follows poses. Empty: '
                            '~/gripper_command.', None),
    'tracker': ('', 'Topic (PointCloud2) with the points of the DLO that a tracker sees. Empty: '
                    '~/observed_points.', None)}


def generate_launch_description():
    """Return the node with the parameters of the chosen DLO."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text,
                                **({} if choices is None else {'choices': choices}))
          for name, (default, text, choices) in ARGUMENTS.items()),
        OpaqueFunction(function=planner)])


def planner(context):
    """Return the node as the arguments say; what they do not say is left to the file."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    said = {'arm.tool_link': given['arm'], 'execute.through': given['through']}
    topics = {'~/gripper_pose': given['gripper_pose'], '~/observed_points': given['tracker'],
              '~/gripper_command': given['gripper_command'],
              '~/joint_commands_ahead': given['controller'] and (
                  f'{given["controller"]}/joint_trajectory')}
    return [Node(
        package='dlo_planner', executable='planner_node', name=given['name'],
        namespace=given['namespace'], output='screen',
        parameters=[ParameterFile(given['params_file'] or f'{CONFIG}/{given["rod"]}.yaml'),
                    {'autostart': ParameterValue(given['autostart'] == 'true', value_type=bool),
                     **{name: ParameterValue(value, value_type=str)
                        for name, value in said.items() if value}}],
        remappings=[one for one in topics.items() if one[1]])]
