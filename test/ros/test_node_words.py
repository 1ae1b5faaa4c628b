# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node in this process: how requests end, and what is said where they are refused."""

import re
import time
from pathlib import Path

import pytest
from nav_msgs.msg import Goals
from node_inside import GOAL, HERE, box, clear, state
from planner_process import PATIENCE, drain, until
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from dlo_planner import Pose
from dlo_planner.execute.causes import Cause
from dlo_planner.ros.lifecycle import LATEST
from msg_helpers.poses import pose_msg, pose_stamped_msg


def stamped(pose=HERE, frame_id='world', **orientation):
    msg = pose_stamped_msg(pose, frame_id)
    msg.header.stamp.sec = 77
    for name, value in orientation.items():
        setattr(msg.pose.orientation, name, value)
    return msg


REQUESTS = {
    'good goal': (lambda c: c._goal_out.publish(stamped(GOAL)), 'task_goal', 0, '12 gripper poses'),
    'frame': (lambda c: c._goal_out.publish(stamped(GOAL, 'map')), 'task_goal', 101,
              "task_goal.header.frame_id = 'map': expected 'world'"),
    'long frame': (lambda c: c._goal_out.publish(stamped(GOAL, 3_000_000 * 'x')), 'task_goal', 101,
                   'task_goal.header.frame_id has 3000000 characters: expected 256 at most'),
    'odd quaternion': (lambda c: c._goal_out.publish(stamped(GOAL, w=1e60)), 'task_goal', 102,
                       'task_goal.pose.orientation = [0.0, 0.0, 0.0, 1e+60]'),
    'huge quaternion': (lambda c: c._goal_out.publish(stamped(GOAL, w=1e200)), 'task_goal', 102,
                        'task_goal: Pose.quaternion = [0.0, 0.0, 0.0, 1e+200]'),
    'far': (lambda c: c._goal_out.publish(stamped(Pose((1e20, 0, 0), (0, 0, 0, 1)))), 'task_goal',
            103, 'workspace.reach = 1000 m'),
    'no goals': (lambda c: c._goals_out.publish(Goals()), 'task_goals', 105, 'expected 1 to 100'),
    'goals': (lambda c: c.send_goals([GOAL]), 'task_goals', 0, '12 gripper poses'),
    'shape': (lambda c: c.predict_shape(HERE), 'predict_shape', 0, '65 nodes'),
    'far shape': (lambda c: c.predict_shape(Pose((0, 2e3, 0), (0, 0, 0, 1))), 'predict_shape', 103,
                  'predict_shape.start.pose.position = [0.0, 2000.0, 0.0]'),
    'plan': (lambda c: c.plan_threading(HERE, GOAL), 'plan_threading', 0, '12 gripper poses'),
    'two': (lambda c: c.plan_two_cutouts(GOAL, Pose((0.25, 0, 0.98), (0, 0, 0, 1))),
            'plan_two_cutouts', 0, '12 gripper poses'),
    'replan': (lambda c: c.trigger('replan'), 'replan', 0, '12 gripper poses'),
    'reset': (lambda c: c.trigger('reset'), 'reset', 0, 'natural shape'),
    # the first one ends what the requests before have left: a proof
    'cancel': (lambda c: (c.trigger('cancel'), c.status_of('cancel'), c.trigger('cancel')),
               'cancel', 414, 'nothing was planned, proved or executed'),
}


@pytest.mark.parametrize('name', REQUESTS)
def test_each_request_has_one_outcome_with_stamp_and_number(inside, node, name):
    ask, request, code, text = REQUESTS[name]
    ask(inside)
    came, message, values = inside.status_of(request)
    assert came == code and text in message
    assert values['cause'] == Cause(code).name
    if name in ('good goal', 'frame', 'odd quaternion', 'huge quaternion', 'far'):
        assert values['stamp'] == '77.000000000'
    else:
        assert values['stamp'] != ''
    time.sleep(0.05)  # another one would come at once
    assert not drain(inside.statuses)


def test_a_plan_that_cannot_be_made_says_why(inside, node, capfd):
    drain(inside.trajectories)
    assert inside.plan_threading(HERE, GOAL)[0] == inside.trajectories.get(timeout=PATIENCE)
    assert inside.status_of('plan_threading')[0] == Cause.DONE
    assert inside.set_parameters(rod__diameter=1e-3, threading__deepest=0.95)[0].successful
    assert inside.plan_threading(HERE, GOAL)[0].poses == []
    assert inside.trajectories.empty()  # the last good plan stays
    assert inside.status_of('plan_threading')[0] == Cause.UNSTABLE
    answer = inside.trigger('replan')
    assert not answer.success and 'waypoint 0' in answer.message
    code, message, _ = inside.status_of('replan')
    assert code == Cause.UNSTABLE and message == answer.message
    assert re.search(r'some are between [\d.]+ and [\d.]+ m|along the normal', message)
    assert any(re.search(r'depths looked at', line) for line in capfd.readouterr().err.splitlines())
    inside.set_parameters(rod__diameter=1.5e-3, threading__deepest=0.5)
    inside.set_parameters(workspace__upper=[-2.0, 9.0, 9.0])
    inside.plan_threading(HERE, GOAL)
    code, message, _ = inside.status_of('plan_threading')
    inside.set_parameters(workspace__upper=[float('inf')] * 3)
    assert code == Cause.WORKSPACE and 'workspace.upper.x' in message


def test_a_cloud_that_is_refused_says_why_once_a_second(inside, node):
    drain(inside.statuses)
    out = inside.node.create_publisher(PointCloud2, f'{inside.planner}/observed_points', LATEST)
    assert until(out.get_subscription_count)
    stamp = inside.node.get_clock().now().to_msg()
    stamp.sec -= 1000
    refused = node.shared.statistics.report()[2]['clouds refused']
    for _ in range(40):
        stamp.sec += 10  # each is due
        out.publish(PointCloud2(header=Header(frame_id='nowhere', stamp=stamp)))
        time.sleep(0.02)
    assert until(lambda: node.shared.statistics.report()[2]['clouds refused'] > refused + 10)
    code, message, values = inside.status_of('observed_points')
    assert code == Cause.INVALID_FRAME and "'nowhere'" in message
    assert values['stamp'] != ''
    assert len(drain(inside.statuses)) <= 2
    inside.node.destroy_publisher(out)


def test_obstacles_are_called_by_their_names(inside, node):
    inside.send_obstacles([box(8), box(3, namespace='table')])
    assert until(lambda: len(state(node).scene.bodies) == 2)
    where = pose_msg(HERE)
    around = box(5, size=0.5)
    around.pose = where
    inside.send_obstacles([around])
    assert until(lambda: len(state(node).scene.bodies) == 3)
    assert inside.predict_shape(HERE)[0].poses == []
    code, message, _ = inside.status_of('predict_shape')
    assert code == Cause.IN_OBSTACLE and 'inside obstacle cell/5' in message
    # a cube before the hole: the DLO would have to go through it
    inside.send_obstacles([Marker(action=Marker.DELETEALL)])
    assert until(lambda: not state(node).scene.bodies)
    before = box(4, size=0.2, namespace='jig')
    before.pose = pose_msg(Pose((-0.3, 0.0, 1.1), (0, 0, 0, 1)))
    inside.send_obstacles([box(8), before])
    assert until(lambda: len(state(node).scene.bodies) == 2)
    assert inside.plan_threading(HERE, GOAL)[0].poses == []
    code, message, _ = inside.status_of('plan_threading')
    assert code in (Cause.COLLISION, Cause.WORKSPACE) and 'jig/4' in message
    assert 'Box' not in message and 'keep_out' not in message
    clear(inside, node)


def test_the_file_of_the_cell_is_drawn_and_its_obstacles_are_called_by_their_names(
        inside, node, tmp_path):
    path = tmp_path / 'cell.yaml'
    path.write_text('''- box: {name: cupboard, pose: [0.1, -0.2, 1], size: [0.1, 0.1, 0.1]}
- sheet: {name: panel, pose: [5, 0, 1], width: 0.3, height: 0.2,
          cutouts: [{pose: [5, 0, 1], radius: 0.02}]}
''')
    inside.send_obstacles([box(8)])
    assert until(lambda: len(state(node).scene.bodies) == 1)
    assert inside.set_parameters(scene__file=str(path))[0].successful
    assert until(lambda: len(state(node).scene.direct.obstacles) == 3)
    assert inside.predict_shape(HERE)[0].poses == []
    code, message, _ = inside.status_of('predict_shape')
    assert code == Cause.IN_OBSTACLE and 'inside obstacle cupboard' in message
    shown = node.shared.markers
    shown.flush()
    groups = [one.ns for one in shown._parts['obstacles']]
    assert groups.count('obstacle') == 3 and {'scene cutout'} <= set(groups)
    refused = inside.set_parameters(scene__file=str(tmp_path / 'no.xml'))[0]
    assert not refused.successful and 'scene.file' in refused.reason
    assert inside.set_parameters(scene__file='')[0].successful
    clear(inside, node)
    assert until(lambda: not state(node).scene.direct.obstacles)


@pytest.mark.parametrize(('spoil', 'named'), [
    (lambda marker: setattr(marker.pose.position, 'x', 1e20),
     'obstacles.markers[0].pose.position = [1e+20, 5.0, 0.0]'),
    (lambda marker: setattr(marker.pose.orientation, 'w', 2.0),
     'obstacles.markers[0].pose.orientation = [0.0, 0.0, 0.0, 2.0]'),
    (lambda marker: setattr(marker.scale, 'y', 1e20), 'obstacles.markers[0].scale'),
    (lambda marker: setattr(marker.scale, 'y', -1.0), 'obstacles.markers[0]: scale'),
    (lambda marker: setattr(marker, 'type', Marker.TEXT_VIEW_FACING), 'CUBE, SPHERE')])
def test_absurd_obstacles_are_refused_by_name(inside, node, spoil, named):
    marker = box(9)
    spoil(marker)
    inside.send_obstacles([marker])
    assert until(lambda: named in node.shared.statistics.report()[1])
    assert not state(node).scene.bodies


def test_a_flood_of_odd_poses_is_a_line_a_second(inside, node, capfd):
    def refused():
        return node.shared.statistics.report()[2]['poses refused']

    begun, before = time.monotonic(), refused()
    while refused() < before + 100:
        assert time.monotonic() < begun + PATIENCE
        inside._pose_out.publish(stamped(HERE, w=1e200))
        time.sleep(1e-3)
    lines = [line for line in capfd.readouterr().err.splitlines() if line]
    assert 1 <= len(lines) <= 2 + (time.monotonic() - begun)
    assert all('1e+200' in line and 'gripper_pose' in line for line in lines)
    assert inside.shape_for(HERE)


@pytest.mark.parametrize(('name', 'value', 'reason'), [
    ('rod__length', 1, None), ('threading__deepest', 0, None), ('gravity', [0, 0, -10], None),
    ('rod__damping', [0.5], 'rod.damping = [0.5]: expected two numbers'),
    ('rod__poisson_ratio', 0.9, 'rod.poisson_ratio'), ('rod__section', 'oval', 'rod.section'),
    ('simulator__basis', 'splines', "basis = 'splines'"), ('frame_id', 'map', 'read-only'),
    ('tool__orientation', [0.0] * 4, 'Pose.quaternion'),
    ('workspace__upper', [float('-inf'), 0.0, 0.0], 'Workspace.upper'),
    ('simulator__n_elements', 100_000, 'simulator.n_elements'),
    ('simulator__n_terms', 11, None), ('simulator__accuracy', 1e-9, 'simulator.accuracy = 1e-09'),
    ('tool__position', [1e20, 0.0, 0.0], 'tool.position'), ('gravity', [0.0, 0.0, 1e20], 'gravity'),
    ('rod__length', 'long', 'DOUBLE'), ('rod__length', 2**60, 'rod.length'),
    ('execute__rate', 10, 'execute.rate'), ('constraints__goal_time', -1.0, 'constraints'),
    ('decelerate_on_cancel', 1, 'BOOL')])
def test_parameters_at_run_time(inside, node, name, value, reason):
    before = state(node).scene.values
    result = inside.set_parameters(**{name: value})[0]
    assert result.successful == (reason is None), result.reason
    assert reason is None or reason in result.reason
    plain = name.replace('__', '.')
    if reason is None:
        assert state(node).scene.values[plain] == value
        assert type(state(node).scene.values[plain]) is type(before[plain])
        inside.set_parameters(**{name: before[plain]})
    assert state(node).scene.values[plain] == before[plain]


def test_table_and_page_of_causes_agree():
    page = (Path(__file__).parents[2] / 'docs' / 'ros' / 'status.md').read_text()
    rows = [line for line in page.splitlines() if line.startswith('| ')]
    for cause in Cause:
        assert f'| {cause.value} | `{cause.name}` | {cause.meaning} |' in rows
    named = [row for row in rows if row.split('|')[1].strip().isdigit()]
    assert len(named) == len(Cause)
