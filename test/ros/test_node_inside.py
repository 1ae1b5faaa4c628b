"""The node in this process, its state at hand: what is refused, what is lost, what is said."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals
from planner_process import connected_client, drain
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import Pose
from dlo_planner.ros.causes import MEANINGS, Cause
from dlo_planner.ros.executor import PatientExecutor
from dlo_planner.ros.follower import Follower
from dlo_planner.ros.planner_node import PlannerNode
from msg_helpers.poses import pose_from_msg, pose_msg, pose_stamped_msg

HERE = Pose.looking_along((0.1, -0.2, 1.0), (1.0, 0.3, 0.2))
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
OVERRIDES = {'rod.diameter': 1.5e-3, 'threading.waypoints': 12, 'diagnostics_period': 0.1,
             'threading.deepest': 0.5, 'rod.damping': [0.5, 0.0], 'incoming_command_timeout': 0.5}


@pytest.fixture(scope='module')
def node(domain):
    """Yield a PlannerNode that is served by a thread."""
    context = rclpy.Context()
    rclpy.init(context=context)
    planner = PlannerNode(context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in OVERRIDES.items()])
    executor = PatientExecutor(8, context=context)
    executor.add_node(planner)
    ended = threading.Event()

    def serve():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.05)

    thread = threading.Thread(target=serve)
    thread.start()
    yield planner
    ended.set()
    thread.join()
    executor.shutdown()
    planner.destroy_node()
    rclpy.try_shutdown(context=context)


class _Alive:
    log = ''

    def alive(self):
        return True


@pytest.fixture(scope='module')
def client(node):
    with connected_client(_Alive()) as connected:
        yield connected


@pytest.fixture(autouse=True)
def fresh(client):
    """Begin each test with what was asked for before answered and forgotten."""
    time.sleep(0.05)
    for messages in (client.statuses, client.executions, client.commands, client.diagnostics):
        drain(messages)


def state(node):
    return node._store.state


def until(wanted, timeout=10.0):
    end = time.monotonic() + timeout
    while not wanted() and time.monotonic() < end:
        time.sleep(0.01)
    return wanted()


def box(number, x=3.0, size=0.1, namespace='cell'):
    marker = Marker(ns=namespace, id=number, type=Marker.CUBE, action=Marker.ADD)
    marker.header.frame_id = 'world'
    marker.pose = pose_msg(Pose((x, 5.0, 0.0), (0, 0, 0, 1)))
    marker.scale.x = marker.scale.y = marker.scale.z = size
    return marker


def clear(client, node):
    client.send_obstacles([Marker(action=Marker.DELETEALL)])
    assert until(lambda: not state(node).bodies)


# ---- one state --------------------------------------------------------------------------------

def test_of_obstacles_and_parameters_sent_at_once_none_is_lost(client, node):
    rng, number = np.random.default_rng(5), 250
    pauses = rng.uniform(0, 4e-3, (2, number))

    def send_obstacles():
        for k, pause in enumerate(pauses[0]):
            client._obstacles_out.publish(MarkerArray(markers=[box(k, 3 + 0.2 * k)]))
            time.sleep(pause)

    sending = threading.Thread(target=send_obstacles)
    sending.start()
    not_in_force = 0
    for k, pause in enumerate(pauses[1]):
        value = 0.05 + 1e-4 * k
        assert client.set_parameters(threading__linear_speed=value)[0].successful
        not_in_force += state(node).scene.linear_speed != value
        time.sleep(pause)
    sending.join()
    assert until(lambda: len(state(node).bodies) == number)
    assert not_in_force == 0
    assert len(state(node).scene.direct.obstacles) == number
    assert set(state(node).bodies) == {('cell', k) for k in range(number)}
    clear(client, node)
    client.set_parameters(threading__linear_speed=0.1)


def test_a_limit_keeps_the_shape_and_the_pose(client, node):
    client.shape_for(HERE)
    before = state(node)
    assert client.set_parameters(threading__linear_speed=0.11)[0].successful
    assert state(node).shape is before.shape and state(node).pose == before.pose
    assert client.set_parameters(rod__tip_mass=0.001, threading__linear_speed=0.1)[0].successful
    assert state(node).pose == before.pose  # the gripper is where it was, whatever it holds
    client.send_goal(GOAL)
    assert client.status_of('task_goal')[0] == Cause.DONE
    client.set_parameters(rod__tip_mass=0.0)


def test_obstacles_that_come_again_unchanged_change_nothing(client, node):
    client.send_obstacles([box(1)])
    assert until(lambda: state(node).bodies)
    client.plan_threading(HERE, GOAL)
    made = state(node).made
    for _ in range(3):
        client.send_obstacles([box(1)])
    time.sleep(0.2)
    assert state(node).made is made
    client.send_obstacles([box(1, x=3.5)])
    assert until(lambda: state(node).made is None)
    answer = client.trigger('execute')
    assert not answer.success and 'obstacles changed (cell/1)' in answer.message
    clear(client, node)


# ---- words ------------------------------------------------------------------------------------

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
    'odd quaternion': (lambda c: c._goal_out.publish(stamped(GOAL, w=1e60)), 'task_goal', 102,
                       'task_goal.pose.orientation = [0.0, 0.0, 0.0, 1e+60]'),
    'huge quaternion': (lambda c: c._goal_out.publish(stamped(GOAL, w=1e200)), 'task_goal', 102,
                        'task_goal: Pose.quaternion = [0.0, 0.0, 0.0, 1e+200]'),
    'far': (lambda c: c._goal_out.publish(stamped(Pose((1e20, 0, 0), (0, 0, 0, 1)))), 'task_goal',
            103, 'workspace.reach = 1000 m'),
    'no goals': (lambda c: c._goals_out.publish(Goals()), 'task_goals', 105, 'one or two'),
    'goals': (lambda c: c.send_goals([GOAL]), 'task_goals', 0, '12 gripper poses'),
    'shape': (lambda c: c.predict_shape(HERE), 'predict_shape', 0, '65 nodes'),
    'far shape': (lambda c: c.predict_shape(Pose((0, 2e3, 0), (0, 0, 0, 1))), 'predict_shape', 103,
                  'predict_shape.start.pose.position = [0.0, 2000.0, 0.0]'),
    'plan': (lambda c: c.plan_threading(HERE, GOAL), 'plan_threading', 0, '12 gripper poses'),
    'two': (lambda c: c.plan_two_cutouts(GOAL, Pose((0.25, 0, 0.98), (0, 0, 0, 1))),
            'plan_two_cutouts', 0, '12 gripper poses'),
    'replan': (lambda c: c.trigger('replan'), 'replan', 0, '12 gripper poses'),
    'reset': (lambda c: c.trigger('reset'), 'reset', 0, 'natural shape'),
    'cancel': (lambda c: c.trigger('cancel'), 'cancel', 414, 'nothing was planned or executed'),
}


@pytest.mark.parametrize('name', REQUESTS)
def test_each_request_has_one_outcome_with_stamp_and_number(client, node, name):
    ask, request, code, text = REQUESTS[name]
    ask(client)
    came, message, values = client.status_of(request)
    assert came == code and text in message
    assert values['cause'] == Cause(code).name
    if name in ('good goal', 'frame', 'odd quaternion', 'huge quaternion', 'far'):
        assert values['stamp'] == '77.000000000'
    else:
        assert values['stamp'] != ''
    time.sleep(0.05)
    assert not drain(client.statuses)


def test_a_plan_that_cannot_be_made_says_why(client, node):
    assert client.set_parameters(rod__diameter=1e-3, threading__deepest=0.95)[0].successful
    assert client.plan_threading(HERE, GOAL)[0].poses == []
    assert client.status_of('plan_threading')[0] == Cause.UNSTABLE
    answer = client.trigger('replan')
    assert not answer.success and 'waypoint 0' in answer.message
    client.set_parameters(rod__diameter=1.5e-3, threading__deepest=0.5)
    client.set_parameters(workspace__upper=[-2.0, 9.0, 9.0])
    client.plan_threading(HERE, GOAL)
    code, message, _ = client.status_of('plan_threading')
    client.set_parameters(workspace__upper=[float('inf')] * 3)
    assert code == Cause.WORKSPACE and 'workspace.upper.x' in message


def test_obstacles_are_called_by_their_names(client, node):
    client.send_obstacles([box(8), box(3, namespace='table')])
    assert until(lambda: len(state(node).bodies) == 2)
    where = pose_msg(HERE)
    inside = box(5, size=0.5)
    inside.pose = where
    client.send_obstacles([inside])
    assert until(lambda: len(state(node).bodies) == 3)
    assert client.predict_shape(HERE)[0].poses == []
    code, message, _ = client.status_of('predict_shape')
    assert code == Cause.IN_OBSTACLE and 'inside obstacle cell/5' in message
    # a cube before the hole: the DLO would have to go through it
    client.send_obstacles([Marker(action=Marker.DELETEALL)])
    assert until(lambda: not state(node).bodies)
    before = box(4, size=0.2, namespace='jig')
    before.pose = pose_msg(Pose((-0.3, 0.0, 1.1), (0, 0, 0, 1)))
    client.send_obstacles([box(8), before])
    assert until(lambda: len(state(node).bodies) == 2)
    assert client.plan_threading(HERE, GOAL)[0].poses == []
    code, message, _ = client.status_of('plan_threading')
    assert code in (Cause.COLLISION, Cause.WORKSPACE) and 'jig/4' in message
    assert 'Box' not in message and 'keep_out' not in message
    clear(client, node)


@pytest.mark.parametrize(('spoil', 'named'), [
    (lambda marker: setattr(marker.pose.position, 'x', 1e20),
     'obstacles.markers[0].pose.position = [1e+20, 5.0, 0.0]'),
    (lambda marker: setattr(marker.pose.orientation, 'w', 2.0),
     'obstacles.markers[0].pose.orientation = [0.0, 0.0, 0.0, 2.0]'),
    (lambda marker: setattr(marker.scale, 'y', 1e20), 'obstacles.markers[0].scale'),
    (lambda marker: setattr(marker.scale, 'y', -1.0), 'obstacles.markers[0]: scale'),
    (lambda marker: setattr(marker, 'type', Marker.TEXT_VIEW_FACING), 'CUBE, SPHERE')])
def test_absurd_obstacles_are_refused_by_name(client, node, spoil, named):
    marker = box(9)
    spoil(marker)
    client.send_obstacles([marker])
    assert until(lambda: named in node._health.report()[1])
    assert not state(node).bodies


def test_a_flood_of_odd_poses_is_a_line_a_second(client, node, capfd):
    begun = time.monotonic()
    for _ in range(300):
        client._pose_out.publish(stamped(HERE, w=1e200))
        time.sleep(1e-3)
    until(lambda: node._health.report()[2]['poses refused'] >= 100)
    lines = [line for line in capfd.readouterr().err.splitlines() if line]
    assert 1 <= len(lines) <= 2 + (time.monotonic() - begun)
    assert all('1e+200' in line and 'gripper_pose' in line for line in lines)
    assert client.shape_for(HERE)


@pytest.mark.parametrize(('name', 'value', 'reason'), [
    ('rod__length', 1, None), ('threading__deepest', 0, None), ('gravity', [0, 0, -10], None),
    ('rod__damping', [0.5], 'rod.damping = [0.5]: expected two numbers'),
    ('simulator__n_elements', 100_000, 'simulator.n_elements'),
    ('simulator__n_terms', 11, None), ('simulator__accuracy', 1e-9, 'simulator.accuracy = 1e-09'),
    ('tool__position', [1e20, 0.0, 0.0], 'tool.position'), ('gravity', [0.0, 0.0, 1e20], 'gravity'),
    ('rod__length', 'long', 'DOUBLE'), ('rod__length', 2**60, 'rod.length'),
    ('execute__rate', 10, 'execute.rate'), ('constraints__goal_time', -1.0, 'constraints'),
    ('decelerate_on_cancel', 1, 'BOOL')])
def test_parameters_at_run_time(client, node, name, value, reason):
    before = state(node).values
    result = client.set_parameters(**{name: value})[0]
    assert result.successful == (reason is None), result.reason
    assert reason is None or reason in result.reason
    plain = name.replace('__', '.')
    if reason is None:
        assert state(node).values[plain] == value
        assert type(state(node).values[plain]) is type(before[plain])
        client.set_parameters(**{name: before[plain]})
    assert state(node).values[plain] == before[plain]


def test_table_and_page_of_causes_agree():
    page = (Path(__file__).parents[2] / 'docs' / 'ros_interface.md').read_text()
    rows = [line for line in page.splitlines() if line.startswith('| ')]
    for cause in Cause:
        assert f'| {cause.value} | `{cause.name}` | {MEANINGS[cause]} |' in rows
    named = [row for row in rows if row.split('|')[1].strip().isdigit()]
    assert len(named) == len(Cause)


# ---- planning can be ended ----------------------------------------------------------------------

@pytest.fixture
def long_plan(client):
    """Let plans take long."""
    client.set_parameters(threading__waypoints=10_000)
    yield
    client.set_parameters(threading__waypoints=12, threading__planning_deadline=60.0)


def test_cancel_ends_the_planning(client, node, long_plan):
    client.send_goal(GOAL)
    assert until(lambda: node._planning._run is not None)
    time.sleep(0.2)
    asked = time.monotonic()
    answer = client.trigger('cancel')
    assert answer.success and 'planning ends' in answer.message
    code, message, _ = client.status_of('task_goal')
    assert code == Cause.PLANNING_CANCELED and 'canceled' in message
    assert time.monotonic() - asked < 2.0
    assert not client.trigger('cancel').success


def test_planning_has_a_deadline(client, node, long_plan):
    assert client.set_parameters(threading__planning_deadline=0.2)[0].successful
    asked = time.monotonic()
    assert client.plan_threading(HERE, GOAL)[0].poses == []
    assert time.monotonic() - asked < 2.0
    code, message, _ = client.status_of('plan_threading')
    assert code == Cause.PLANNING_DEADLINE
    assert 'threading.planning_deadline = 0.2 s' in message


def test_a_plan_of_a_scene_that_changed_meanwhile_is_refused(client, node, long_plan):
    client.set_parameters(threading__waypoints=400)
    client.send_goal(GOAL)
    assert until(lambda: node._planning._run is not None)
    client.send_obstacles([box(1)])
    assert client.status_of('task_goal')[0] == Cause.SCENE_CHANGED
    clear(client, node)


# ---- proofs and execution -----------------------------------------------------------------------

def test_a_proof_whose_process_is_killed_is_made_again(client, node):
    client.plan_threading(HERE, GOAL)
    made = state(node).made
    assert until(lambda: state(node).proof.report is not None)  # the motion is being made
    time.sleep(0.2)
    node._prover._process.kill()
    assert until(lambda: state(node).made is made and state(node).proof.done, 60.0)
    assert state(node).proof.safe


@pytest.fixture
def simulated_time(client, node):
    """Yield a function that publishes /clock; node and client live by it, the clock at 100 s."""
    out = client.node.create_publisher(Clock, '/clock', 10)
    parameter = Parameter('use_sim_time', value=True)

    def tell(seconds):
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = int(seconds), int(1e9 * (seconds % 1))
        out.publish(msg)

    node.set_parameters([parameter])
    client.node.set_parameters([parameter])
    yield tell
    for one in (node, client.node):
        one.set_parameters([Parameter('use_sim_time', value=False)])
    client.node.destroy_publisher(out)


def test_without_a_clock_plans_are_proved_and_diagnostics_come(client, node, simulated_time):
    path, _ = client.plan_threading(HERE, GOAL)
    assert client.proof(path)['report'] == 'held'
    assert len(client.shape_for(HERE)[0].poses) == 65


@pytest.mark.parametrize('jump', [5.0, -60.0])
def test_a_clock_that_jumps_makes_no_leap(client, node, simulated_time, jump):
    begun, shift = time.monotonic(), [100.0]
    ended = threading.Event()

    def tick():
        while not ended.wait(0.01):
            simulated_time(shift[0] + time.monotonic() - begun)

    ticking = threading.Thread(target=tick)
    ticking.start()
    robot = Follower(client.node, client.planner, HERE)
    try:
        path, _ = client.plan_threading(HERE, GOAL)
        robot.put(pose_from_msg(path.poses[0].pose))
        assert client.proof(path)['report'] == 'held'
        drain(client.commands)
        drain(client.executions)
        answer = client.trigger('execute')
        assert answer.success, answer.message
        time.sleep(1.5)
        shift[0] += jump
        time.sleep(1.5)
        client.trigger('cancel')
        client.execution_in('stopped')
    finally:
        ended.set()
        ticking.join()
        robot.close()
    places = np.array([pose_from_msg(one.pose).position for one in drain(client.commands)])
    way = np.array(state(node).execution.way.at(np.arange(0, 4, 0.02))[0])
    regular = max(np.linalg.norm(b.position - a.position)
                  for a, b in zip(way, way[1:], strict=False))
    assert len(places) > 60
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= 1.2 * regular


def test_execution_is_on_diagnostics_and_on_its_topic(client, node):
    robot = Follower(client.node, client.planner, HERE)
    try:
        path, _ = client.plan_threading(HERE, GOAL)
        robot.put(pose_from_msg(path.poses[0].pose))
        client.proof(path)
        client.trigger('execute')
        _, _, values = client.execution_in('running')
        first = float(values['progress [%]'])
        drain(client.executions)
        time.sleep(0.5)
        came = drain(client.executions)
        assert 1 <= len(came) <= 5
        later = client.execution_in('running')[2]
        assert 0 <= first < float(later['progress [%]']) < 100
        drain(client.diagnostics)
        status = client.diagnostics.get(timeout=5).status[1]
        assert status.name.endswith(': execution') and status.message == 'running'
        client.trigger('cancel')
        client.execution_in('stopped')
        time.sleep(0.2)
        drain(client.diagnostics)
        values = {v.key: v.value for v in client.diagnostics.get(timeout=5).status[1].values}
        assert values['state'] == 'stopped' and values['cause'] == 'CANCELED'
    finally:
        robot.close()


def test_a_pose_without_a_stamp_is_predicted_but_not_executed_from(client, node):
    msg = PoseStamped()
    msg.header.frame_id, msg.pose = 'world', pose_msg(HERE)
    heard = state(node).heard
    drain(client.shapes)
    client._pose_out.publish(msg)
    assert client.shapes.get(timeout=5).header.stamp.sec == 0
    assert state(node).heard is heard and state(node).pose == HERE
