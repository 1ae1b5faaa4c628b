# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""config/planner.rviz: classes that RViz 2 has, topics that the node really publishes."""

import pytest
import yaml
from planner_process import ROOT, until
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

CONFIG = yaml.safe_load((ROOT / 'config' / 'planner.rviz').read_text())
MANAGER = CONFIG['Visualization Manager']
# class of RViz 2 (rviz_common, rviz_default_plugins of Jazzy) -> type of its topic
DISPLAYS = {'rviz_default_plugins/Grid': None, 'rviz_default_plugins/Axes': None,
            'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
            'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
            'rviz_default_plugins/Pose': 'geometry_msgs/msg/PoseStamped'}
TOOLS = {f'rviz_default_plugins/{name}' for name in (
    'Interact', 'MoveCamera', 'Select', 'FocusCamera', 'Measure', 'SetGoal')}
PANELS = {f'rviz_common/{name}' for name in ('Displays', 'Selection', 'Tool Properties', 'Views')}
DURABILITIES = {'Transient Local': DurabilityPolicy.TRANSIENT_LOCAL,
                'Volatile': DurabilityPolicy.VOLATILE}
FED = [display for display in MANAGER['Displays'] if DISPLAYS.get(display['Class'])]


def test_every_class_is_one_of_rviz():
    assert {panel['Class'] for panel in CONFIG['Panels']} <= PANELS
    assert {display['Class'] for display in MANAGER['Displays']} <= DISPLAYS.keys()
    assert {tool['Class'] for tool in MANAGER['Tools']} <= TOOLS
    assert MANAGER['Views']['Current']['Class'] == 'rviz_default_plugins/Orbit'
    assert MANAGER['Transformation']['Current']['Class'] == 'rviz_default_plugins/TF'
    assert len({display['Name'] for display in MANAGER['Displays']}) == len(MANAGER['Displays'])


def test_its_frame_is_the_nodes_default():
    assert MANAGER['Global Options']['Fixed Frame'] == 'world'


def of_the_planner(ask, topic):
    """Return what the planner has of a topic, once the graph knows of it."""
    found = []

    def known():
        found[:] = [one for one in ask(topic['Value']) if one.node_name == 'dlo_planner']
        return found

    assert until(known), topic
    return found


@pytest.mark.parametrize('display', FED, ids=lambda display: display['Name'])
def test_every_display_has_its_topic(client, display):
    topic = display['Topic']
    own = of_the_planner(client.node.get_publishers_info_by_topic, topic)
    assert len(own) == 1
    assert own[0].topic_type == DISPLAYS[display['Class']]
    # the same durability: a latched one is kept for those who come late, and no more is asked for
    assert own[0].qos_profile.durability == DURABILITIES[topic['Durability Policy']]
    assert own[0].qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert topic['Reliability Policy'] == 'Reliable'


def test_the_goal_tool_sends_where_the_node_listens(client):
    topic = next(tool['Topic'] for tool in MANAGER['Tools'] if tool['Class'].endswith('SetGoal'))
    own = of_the_planner(client.node.get_subscriptions_info_by_topic, topic)
    assert {one.topic_type for one in own} == {'geometry_msgs/msg/PoseStamped'}
    durable = {one.qos_profile.durability for one in own}
    assert DURABILITIES[topic['Durability Policy']] in durable
