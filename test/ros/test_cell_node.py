# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The cell as a node: it follows commands, shows its DLO, and says where it is not in real time."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from planner_here import Witness, context_of_its_own
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

pytest.importorskip('mujoco')

from dlo_planner import Pose  # noqa: E402
from dlo_planner.cell.node import CellNode  # noqa: E402
from dlo_planner.cell.passage import Passage  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402
from dlo_planner.ros.qos import LATCHED, REQUEST  # noqa: E402
from msg_helpers.poses import pose_stamped_msg  # noqa: E402


class _Cell:
    def __init__(self, context):
        self.node = CellNode(context=context, parameter_overrides=[
            Parameter('dlo', value='leaf spring'), Parameter('radius', value=0.02)])
        self.witness = Witness(context)
        self.outcomes = self.witness.hear(DiagnosticStatus, '/dlo_cell/outcome', LATCHED)
        self.poses, self.clouds = (
            self.witness.hear(kind, f'/dlo_planner/{name}', qos_profile_sensor_data)
            for kind, name in ((PoseStamped, 'gripper_pose'), (PointCloud2, 'observed_points')))
        self.out = self.witness.node.create_publisher(
            PoseStamped, '/dlo_planner/gripper_command', REQUEST)
        self.witness.executor.add_node(self.node)

    def said(self, wanted, seconds=20.0):
        """Return the first outcome from now on of which `wanted(message, values)`."""
        self.outcomes.clear()
        found = []

        def came():
            found[:] = [(one.message, values) for one in self.outcomes
                        for values in [{item.key: item.value for item in one.values}]
                        if wanted(one.message, values)]
            return found
        assert self.witness.wait_for(came, seconds), [one.message for one in self.outcomes]
        return found[0]


@pytest.fixture
def cell(domain):
    with context_of_its_own() as context:
        made = _Cell(context)
        yield made
        made.witness.executor.remove_node(made.node)
        made.node.destroy_node()
        made.witness.close()


def test_it_shows_its_dlo_and_follows_commands(cell):
    assert cell.witness.wait_for(lambda: len(cell.poses) > 20 and len(cell.clouds) > 3)
    start = cell.node.task.start
    ahead = Pose(start.position + (0, 0, 0.001), start.quaternion)
    now = cell.node.get_clock().now().to_msg()

    def there():
        cell.out.publish(pose_stamped_msg(ahead, 'world', now))
        return abs(cell.poses[-1].pose.position.z - ahead.position[2]) < 1e-9
    assert cell.witness.wait_for(there)
    message, values = cell.said(lambda *_: True)
    assert message.startswith('under way') and values['threaded'] == 'False'
    assert values['largest miss [m]'] == values['its y [m]'] == values['its z [m]'] == 'nan'
    cell.node._worst = Passage(0.02, 5e-3, 3e-3, -4e-3)
    _, values = cell.said(lambda _, values: values['its y [m]'] != 'nan')
    worst = [float(values[f'{name} [m]']) for name in ('its y', 'its z', 'its depth')]
    assert worst == [3e-3, -4e-3, 0.02] and float(values['largest miss [m]']) == 5e-3
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in cell.clouds]
    assert stamps == sorted(stamps)


def test_a_machine_that_is_too_slow_is_said_to_be(cell, monkeypatch):
    move = Plant.move

    def slow(self, *arguments):
        time.sleep(0.1)
        move(self, *arguments)
    monkeypatch.setattr(Plant, 'move', slow)
    message, values = cell.said(lambda message, _: 'too slow' in message)
    assert 'of no meaning' in message and float(values['lost [s]']) > 0.5
    monkeypatch.undo()
    assert cell.witness.ask(Trigger, '/dlo_cell/restart').success
    assert float(cell.said(lambda *_: True)[1]['lost [s]']) < float(values['lost [s]'])
