# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The viewer node beside a planner that is played here."""

import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from browser import dragged_to, looking_at
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from planner_here import context_of_its_own
from planner_process import PATIENCE, until
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from dlo_planner import Box, CutOut, DirectSimulator, InverseSimulator, Pose, Rod
from dlo_planner.ros.markers import MarkerCache
from dlo_planner.view.scene import obstacle_primitives, plan_primitives, shape_primitives
from dlo_planner.view.viser import pose_of
from msg_helpers.poses import pose_from_msg, pose_stamped_msg
from msg_helpers.trajectories import plan_path

pytest.importorskip('viser', reason='extra [view] is not installed')
from dlo_planner.cell.node import _LATCHED, _RELIABLE  # noqa: E402
from dlo_planner.ros.viewer import Viewer  # noqa: E402

LEVEL = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
PLANNER = '/cell/planner'
STAMP = Time(sec=77)  # of the robot's poses


class PlayedPlanner(Node):
    """Publishes what a planner does, notes what it is sent."""

    def __init__(self, context):
        super().__init__('planner', namespace='/cell', context=context)
        markers = self.create_publisher(MarkerArray, '~/markers', _LATCHED)
        self.picture = MarkerCache(markers.publish)
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', _RELIABLE)
        self.status = self.create_publisher(DiagnosticStatus, '~/status', _LATCHED)
        self.asked, self.poses, self.goals = [], [], []
        self.create_subscription(PoseStamped, '~/gripper_pose', self.poses.append,
                                 qos_profile_sensor_data)
        self.create_subscription(PoseStamped, '~/task_goal', self.goals.append, _RELIABLE)
        self.plan = self.create_publisher(Path, '~/gripper_trajectory', _LATCHED)
        self.create_service(GetPlan, '~/execute_plan', self._execute)
        for name in ('replan', 'cancel'):
            self.create_service(Trigger, f'~/{name}',
                                lambda _, answer, name=name: self._answer(name, answer))

    def _execute(self, request, answer):
        self.asked.append(('execute', request.start.header.stamp.sec))
        return answer

    def show_plan(self, seconds):
        """Publish a plan with a stamp."""
        path = plan_path([Pose.identity()], [0.0], 'world', Time(sec=seconds))
        self.plan.publish(path)

    def _answer(self, name, answer):
        self.asked.append(name)
        answer.success, answer.message = name != 'cancel', f'<b>{name}</b> is answered'
        return answer


@contextmanager
def spinning(*nodes, context):
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join(timeout=PATIENCE)


@contextmanager
def viewed(**parameters):
    """Yield a PlayedPlanner and the Viewer that shows it."""
    given = {'planner': PLANNER, 'port': 18_500, **parameters}
    with context_of_its_own() as context:
        planner = PlayedPlanner(context)
        viewer = Viewer(context=context, parameter_overrides=[
            Parameter(name, value=value) for name, value in given.items()])
        try:
            with spinning(planner, viewer, context=context):
                yield planner, viewer
        finally:
            viewer.destroy_node()
            planner.destroy_node()


def stamp(planner):
    return planner.get_clock().now().to_msg()


@pytest.fixture(scope='module')
def plan():
    wire = Rod.circular(1.0, 4e-3, 8960.0, 110e9, 0.34)
    inverse = InverseSimulator(DirectSimulator(wire, n_elements=24, n_terms=8))
    return inverse.thread(CutOut(Pose.looking_along((0.6, 0.0, 0.9), (1, 0, 0)), radius=0.02),
                          depths=np.linspace(0, 0.9, 8))


def show_shape(planner, plan):
    now = stamp(planner)
    planner.picture.show('shape', 'base', now, lambda: shape_primitives(plan.shapes[3]))
    planner.picture.flush()


def show_all(planner, plan):
    now = stamp(planner)
    hole = plan.sheets[0][0].cutouts[0]
    block = Box(Pose((0.4, 0.4, 0.8), (0, 0, 0, 1)), (0.1, 0.1, 0.4))
    planner.picture.show('plan', 'base', now, lambda: plan_primitives(plan, [hole]))
    planner.picture.show('obstacles', 'base', now, lambda: obstacle_primitives([block]))
    show_shape(planner, plan)


def tell(planner, text, **values):
    status = DiagnosticStatus(name='cell/planner: solver', level=DiagnosticStatus.WARN,
                              message=text)
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    others = [DiagnosticStatus(name=name, message='of another') for name in (
        'cell/planner: execution', 'planner: solver', 'other/planner: solver', '')]
    planner.diagnostics.publish(DiagnosticArray(status=[status, *others]))


def press(button):
    for callback in list(button._impl.update_cb):
        callback(type('Click', (), {'client': None, 'target': button}))


@pytest.mark.sweep
def test_it_shows_what_the_planner_publishes(domain, plan):
    with viewed() as (planner, viewer):
        show_all(planner, plan)
        canvas = viewer.page.page.canvas
        groups = {'dlo', 'gripper', 'cutout', 'trajectory', 'plate', 'margin', 'rim margin',
                  'ghost', 'obstacle'}
        assert until(lambda: {name[0] for name in canvas.items} == groups), canvas.items.keys()
        tube = canvas.items['dlo', 0]
        np.testing.assert_allclose(tube.points, plan.shapes[3].positions)
        hole = plan.sheets[0][0].cutouts[0].pose
        assert until(lambda: np.allclose(pose_of(viewer.page.goal).matrix, hole.matrix))
        planner.picture.hide('obstacles')
        planner.picture.flush()
        assert until(lambda: ('obstacle', 0) not in canvas.items)
        tell(planner, 'all <i>well</i>', **{'report': 'held', 'report reason': 'none',
                                            'plan smallest clearance [m]': '0.004',
                                            'report largest swing in motion [m]': 'nan'})
        assert until(lambda: 'all &lt;i&gt;well&lt;/i&gt;' in viewer.page.state.content)
        assert 'held' in viewer.page.state.content
        assert until(lambda: '0.004' in viewer.page.margins.content)
        assert 'not looked at' in viewer.page.margins.content
        assert 'of another' not in viewer.page.state.content
        planner.status.publish(DiagnosticStatus(level=DiagnosticStatus.ERROR, message='refused'))
        assert until(lambda: 'status: refused' in viewer.page.state.content)


@pytest.mark.sweep
def test_dragging_is_sent_only_where_no_robot_sends(domain, plan):
    with viewed() as (planner, viewer), looking_at(viewer.page.page.url):
        show_all(planner, plan)
        pose = Pose.looking_along((0.1, 0.2, 0.9), (1, 0.2, 0))
        dragged_to(viewer.page.gripper, pose)
        time.sleep(0.3)
        assert planner.poses == []  # the box is not ticked
        assert until(viewer.page.page.server.get_clients)
        viewer.page.sending.value = True
        assert viewer.page.gripper.visible
        assert until(lambda: len(planner.poses) > 3)
        sent = planner.poses[-1]
        assert sent.header.frame_id == 'base' and sent.header.stamp.sec > 0
        np.testing.assert_allclose(pose_from_msg(sent.pose).matrix, pose.matrix, atol=1e-9)
        robot = planner.create_publisher(PoseStamped, '~/gripper_pose', qos_profile_sensor_data)
        assert until(lambda: not viewer.page.sending.value)
        assert 'another node publishes' in viewer.page.message.content

        def robot_is_shown():
            robot.publish(pose_stamped_msg(LEVEL, 'base', STAMP))
            return np.allclose(pose_of(viewer.page.gripper).matrix, LEVEL.matrix)

        assert until(robot_is_shown)
        assert until(lambda: planner.poses and planner.poses[-1].header.stamp == STAMP)
        before = len(planner.poses)  # what the viewer had sent has come
        time.sleep(0.5)
        assert all(one.header.stamp == STAMP for one in planner.poses[before:])


@pytest.mark.sweep
def test_a_goal_is_sent_and_answers_are_said(domain):
    with viewed() as (planner, viewer):
        page = viewer.page
        assert until(lambda: all(client.service_is_ready()
                                 for client in viewer._triggers.values()))
        goal = Pose.looking_along((0.7, 0.1, 0.9), (0, 1, 0))
        page.aiming.value = True
        assert page.goal.visible and not page.send_goal.disabled
        dragged_to(page.goal, goal)
        press(page.send_goal)
        assert until(lambda: planner.goals)
        np.testing.assert_allclose(pose_from_msg(planner.goals[0].pose).matrix, goal.matrix)
        press(page.replan)
        assert until(lambda: '&lt;b&gt;replan&lt;/b&gt; is answered' in page.message.content)
        assert 'ok:' in page.message.content
        press(page.cancel)
        assert until(lambda: 'error:' in page.message.content)
        assert planner.asked == ['replan', 'cancel']


def test_it_executes_only_where_that_is_allowed_and_confirmed(domain):
    with viewed() as (planner, viewer):
        assert viewer.page.execute.disabled
        press(viewer.page.execute)
        viewer._execute()
        press(viewer.page.replan)  # what came before it has been answered
        assert until(lambda: planner.asked == ['replan'])
    with viewed(allow_execute=True) as (planner, viewer):
        assert until(viewer._execute_plan.service_is_ready)
        press(viewer.page.execute)
        press(viewer.page.yes)
        assert 'execute: there is no plan' in viewer.page.message.content
        for seconds in (7, 8):
            planner.show_plan(seconds)
            assert until(lambda: viewer._plan and viewer._plan.header.stamp.sec == seconds)  # noqa: B023
        press(viewer.page.execute)
        press(viewer.page.no)
        assert planner.asked == []
        press(viewer.page.execute)
        press(viewer.page.yes)
        assert until(lambda: planner.asked == [('execute', 8)])


@pytest.mark.sweep
def test_no_planner_is_said(domain):
    with viewed(planner='/nobody') as (_, viewer):
        press(viewer.page.replan)
        assert 'there is no service /nobody/replan' in viewer.page.message.content


@pytest.mark.sweep
def test_in_the_browser(domain, plan):
    with viewed(allow_execute=True) as (planner, viewer), looking_at(
            viewer.page.page.url) as look:
        look.wait_for('nothing asked yet')
        before = look.picture()
        show_shape(planner, plan)
        assert look.changed(before) > 1e-3
        before = look.picture()
        show_all(planner, plan)  # the camera goes back, so that all is seen
        tell(planner, 'ready', **{'plan smallest clearance [m]': '0.004'})
        look.wait_for('planner: ready')
        assert look.changed(before) > 1e-3
        assert until(lambda: look.colors() > 100 or look.page.wait_for_timeout(200))
        planner.show_plan(7)
        assert until(lambda: viewer._plan)
        look.page.get_by_role('button', name='Execute ...').click()
        look.wait_for('the robot will move')
        look.page.get_by_role('button', name='Execute', exact=True).click()
        assert until(lambda: planner.asked == [('execute', 7)])
        assert look.complaints == []
