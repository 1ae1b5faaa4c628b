# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The policy for the AI for Industry Challenge, with a real planner process.

The challenge's packages are not here: `aic_model.policy` is what its documentation says of it, tf
answers from a table, and the force sensor feels the weight of the wire.
"""

import importlib
import sys
from threading import Thread
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped, WrenchStamped
from planner_process import ROOT, connected_client, running_planner
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from dlo_planner import Pose, Rod
from msg_helpers.poses import pose_from_msg

PORT = Pose((0.0, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0))  # its z axis is up: the way in is down
START = Pose.looking_along((-0.1, 0.05, 1.35), (0.1, 0.0, -1.0))
SENSOR = Pose.looking_along((-0.1, 0.05, 1.45), (0.1, 1.0, -1.0))
WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)


class Policy:
    """The base class of the challenge, as its public file declares it; its sleep is quicker."""

    def __init__(self, parent_node):
        self._parent_node = parent_node

    def sleep_for(self, duration_sec):
        self._parent_node.slept.append(duration_sec)


class _Tf:
    def __init__(self, frames):
        self.frames = frames

    def can_transform(self, _, source, __):
        return source in self.frames

    def lookup_transform(self, _, source, __):
        found, pose = TransformStamped(), self.frames[source]
        for axis, value in zip('xyz', pose.position, strict=True):
            setattr(found.transform.translation, axis, float(value))
        for axis, value in zip('xyzw', pose.quaternion, strict=True):
            setattr(found.transform.rotation, axis, float(value))
        return found


@pytest.fixture(scope='module')
def node(domain, tmp_path_factory):
    with running_planner(tmp_path_factory.mktemp('aic'), '--params-file',
                         str(ROOT / 'config' / 'copper_wire.yaml'), '-p', 'frame_id:=base_link',
                         '-p', 'rod.diameter:=0.0015', '-p', 'threading.waypoints:=12',
                         '-p', 'threading.deepest:=0.3') as planner:
        with connected_client(planner):
            pass
        context = rclpy.Context()
        rclpy.init(context=context)
        node = Node('aic_model', context=context)
        node.slept = []
        node._tf_buffer = _Tf({'task_board/nic/sfp_link': PORT, 'gripper/tcp': START,
                               'sensor': SENSOR})
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        thread = Thread(target=executor.spin, daemon=True)
        thread.start()
        yield node
        executor.shutdown()
        thread.join(5.0)
        node.destroy_node()
        rclpy.try_shutdown(context=context)


@pytest.fixture
def policy(node, monkeypatch, tmp_path):
    package, module = ModuleType('aic_model'), ModuleType('aic_model.policy')
    module.Policy = Policy
    monkeypatch.setitem(sys.modules, 'aic_model', package)
    monkeypatch.setitem(sys.modules, 'aic_model.policy', module)
    monkeypatch.syspath_prepend(str(ROOT / 'examples'))
    config = tmp_path / 'cable.yaml'
    config.write_text((ROOT / 'config' / 'copper_wire.yaml').read_text().replace(
        'diameter: 0.001', 'diameter: 0.0015'))
    monkeypatch.setenv('DLO_PLANNER_CONFIG', str(config))
    monkeypatch.delitem(sys.modules, 'aic_policy', raising=False)
    found = importlib.import_module('aic_policy')
    return getattr(found, found.__name__)(node)  # as aic_model looks for it


def _felt(force, torque):
    """Return an Observation whose sensor feels a load in world axes."""
    wrench = WrenchStamped()
    wrench.header.frame_id = 'sensor'
    for name, load in (('force', force), ('torque', torque)):
        for axis, value in zip('xyz', SENSOR.rotation.T @ np.asarray(load), strict=True):
            setattr(getattr(wrench.wrench, name), axis, float(value))
    return SimpleNamespace(wrist_wrench=wrench)


def _weight():
    return np.array([0.0, 0.0, -9.81 * WIRE.node_masses(np.array([0.0, 1.0])).sum()])


def _insert(policy, observation):
    targets, words = [], []
    task = SimpleNamespace(target_module_name='nic', port_name='sfp')
    done = policy.insert_cable(task, lambda: observation,
                               lambda pose, frame: targets.append((pose_from_msg(pose), frame)),
                               words.append)
    return done, targets, words


def test_the_gripper_follows_the_plan_at_20_hz(policy, node):
    node.slept.clear()
    done, targets, words = _insert(policy, _felt(_weight(), np.zeros(3)))
    assert done, words
    assert set(node.slept) == {0.05}
    assert {frame for _, frame in targets} == {'base_link'}
    ways = np.diff([pose.position for pose, _ in targets], axis=0)
    assert np.linalg.norm(ways, axis=1).max() < 0.05 * 0.5
    assert targets[-1][0].position[2] < START.position[2] - 0.1
    # the wire stands in the port at last: the end of it is where the plan says
    shape = policy._direct.solve(targets[-1][0])
    below = shape.positions[:, 2] < PORT.position[2]
    assert below.any()
    crossing = shape.positions[np.argmax(below)]
    assert np.linalg.norm(crossing[:2]) < 0.02


def test_the_weight_of_the_wire_is_no_contact_but_more_is(policy):
    force, torque = policy._unexplained(START, _felt(_weight(), np.zeros(3)))
    assert force < 1e-3  # a free wire pulls with its weight alone, whatever its shape
    assert torque < 0.2
    done, targets, words = _insert(policy, _felt(_weight() + [0.0, 15.0, 0.0], np.zeros(3)))
    assert not done
    assert targets == []
    assert 'contact: 15.0 N' in words[-1]


def test_what_is_not_there_yet_is_waited_for_and_then_named(policy, node):
    node.slept.clear()
    assert _insert(policy, None) == (False, [], ['no observation within 10 s'])
    assert sum(node.slept) == pytest.approx(10)
    port = node._tf_buffer.frames.pop('task_board/nic/sfp_link')
    try:  # as without the ground truth
        assert _insert(policy, _felt(_weight(), np.zeros(3))) == (
            False, [], ['no frame task_board/nic/sfp_link in tf within 10 s'])
    finally:
        node._tf_buffer.frames['task_board/nic/sfp_link'] = port
    seen = iter([None, None])
    task = SimpleNamespace(target_module_name='nic', port_name='sfp')
    assert policy.insert_cable(task, lambda: next(seen, _felt(_weight(), np.zeros(3))),
                               lambda *_: None, lambda _: None)


def test_without_a_plan_it_says_so(policy, monkeypatch):
    module = sys.modules['aic_policy']
    monkeypatch.setattr(module, 'BASE', 'nowhere')  # a frame that the node refuses
    assert _insert(policy, _felt(_weight(), np.zeros(3))) == (
        False, [], ['no plan: /dlo_planner/status says why'])
    monkeypatch.setattr(module, 'PATIENCE', 0.1)
    policy._client = policy._parent_node.create_client(module.GetPlan, '/absent/plan_threading')
    assert not _insert(policy, _felt(_weight(), np.zeros(3)))[0]
