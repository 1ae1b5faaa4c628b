# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node in this process commands several arms: all by one clock, and one that is late stops all.

Each arm is a robot that follows a little late, and reports where it is.
"""

from contextlib import ExitStack, contextmanager
from time import monotonic

import numpy as np
import pytest
from follower import Follower
from geometry_msgs.msg import PoseStamped, WrenchStamped
from node_inside import OVERRIDES as WIRE
from node_inside import state
from planner_process import PATIENCE, drain, until
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import CutOut, FarEnd, Pose
from dlo_planner.execute.causes import Cause
from dlo_planner.ros.lifecycle import LATCHED, REQUEST
from dlo_planner.settings.tasks import task_to_yaml
from dlo_planner.tasks import Carry, Clip, Fork, Route, ThreadInGrasps
from msg_helpers.poses import pose_from_msg

OVERRIDES = {**WIRE, 'far_end.hold': 'clamped', 'far_end.timeout': 60.0,
             'incoming_command_timeout': 0.5, 'threading.linear_speed': 0.3,
             'threading.linear_acceleration': 2.0, 'threading.linear_jerk': 20.0,
             'constraints.path.position': 0.05}
LEVEL = (0, 0, 0, 1)
BEGIN = Pose((0.0, 0.0, 1.0), LEVEL), Pose((0.8, 0.0, 1.0), LEVEL)
TASK = Carry(Pose((0.0, 0.1, 1.0), LEVEL), Pose((0.75, 0.15, 1.0), LEVEL), max_force=20.0)


def _since(heard):
    """Return how many s ago a Feedback came."""
    return monotonic() - heard.arrived


def numbers(vector):
    """Return the numbers [3] of a Vector3."""
    return [vector.x, vector.y, vector.z]


@contextmanager
def robots(client, **poses):
    """Yield a Follower of each arm, by its name, which begins at a Pose."""
    with ExitStack() as stack:
        made = {name: Follower(client.node, client.planner, pose, arm=name)
                for name, pose in poses.items()}
        for one in made.values():
            stack.callback(one.close)
        yield made


@contextmanager
def listening(client, kind, topic, qos=REQUEST):
    came = []
    made = client.node.create_subscription(kind, f'{client.planner}/{topic}', came.append, qos)
    yield came
    client.node.destroy_subscription(made)


def told(client, task):
    """Have a task planned and proved."""
    out = client.node.create_publisher(String, f'{client.planner}/task', 10)
    assert until(out.get_subscription_count)
    drain(client.statuses)
    out.publish(String(data=task_to_yaml(task)))
    code, message, _ = client.status_of('task', PATIENCE)
    client.node.destroy_publisher(out)
    assert code == 0, message
    code, message, _ = client.status_of('proof', PATIENCE)
    assert code == 0, message


def begin(client):
    """Let the plan be executed; return what is said of it."""
    drain(client.statuses)
    answer = client.trigger('execute')
    assert answer.success, answer.message
    return client.status_of('execute')[2]


def ended(client):
    """Return code and message with which an execution ends."""
    return client.status_of('execute', 2 * PATIENCE)[:2]


@pytest.fixture
def held(inside, node):
    """Yield the robots of a gripper and of a far end, which hold the DLO."""
    inside.trigger('reset')
    with robots(inside, gripper=BEGIN[0], far_end=BEGIN[1]) as made:
        assert until(lambda: state(node).feedback is not None and state(node).far_end is not None)
        assert until(lambda: state(node).shape is not None
                     and state(node).shape.far_end is not None)
        yield made
    inside.trigger('reset')


def test_both_ends_are_carried_by_one_clock(inside, node, held):
    with listening(inside, PoseStamped, 'gripper_command/far_end') as commands, listening(
            inside, MarkerArray, 'holds', LATCHED) as holds, listening(
            inside, PoseStamped, 'gripper_command') as led, listening(
            inside, WrenchStamped, 'gripper_command_wrench') as wrenches:
        told(inside, TASK)
        assert until(lambda: holds)
        assert until(lambda: node.count_subscribers(f'{inside.planner}/gripper_command/far_end'))
        arrows = [one for one in holds[-1].markers if one.action == Marker.ADD]
        assert [(one.ns, one.text) for one in arrows] == [('far_end', 'clamped at the tip')]
        np.testing.assert_allclose(pose_from_msg(arrows[0].pose).matrix, BEGIN[1].matrix,
                                   atol=1e-9)
        proved = state(node).proof.report.trajectory
        assert begin(inside)['arms'] == 'gripper, far_end'
        code, message = ended(inside)
        assert code == 0, message
        for name, end in (('gripper', TASK.to), ('far_end', TASK.far_end_to)):
            assert np.linalg.norm(held[name].pose.position - end.position) < 0.01
        # at each time both were told the poses of one time of the proved motion
        known = proved.arm('far_end').poses(np.linspace(0, proved.duration, 4000))
        places = np.array([pose.position for pose in known])
        one, other = (held[name].told for name in ('gripper', 'far_end'))
        assert len(one) == len(other) > 30
        grippers = np.array([pose.position for pose in proved.poses(
            np.linspace(0, proved.duration, 4000))])
        for first, second in zip(one[::7], other[::7], strict=True):
            at = np.linalg.norm(places - second.position, axis=1)
            assert at.min() < 1e-4
            assert np.linalg.norm(grippers[at.argmin()] - first.position) < 1e-3
        assert len(commands) > 30
        # with each command the wrench of the DLO that both ends hold there, in the tool frame
        assert until(lambda: len(wrenches) == len(commands) == len(led))
        direct, tool, shape = state(node).scene.direct, state(node).scene.tool, None
        for *poses, wrench in list(zip(led, commands, wrenches, strict=True))[::9]:
            first, second = (pose_from_msg(one.pose) for one in poses)
            shape = direct.solve(first.compose(tool), shape, far_end=FarEnd(second))
            force = -shape.gripper_wrench[:3] @ first.rotation
            moment = -shape.gripper_wrench[3:] - np.cross(
                shape.gripper.position - first.position, shape.gripper_wrench[:3])
            assert wrench.header.frame_id == state(node).scene['tool.frame_id']
            np.testing.assert_allclose(numbers(wrench.wrench.force), force, atol=0.02)
            np.testing.assert_allclose(numbers(wrench.wrench.torque), moment @ first.rotation,
                                       atol=0.01)
        last = pose_from_msg(commands[-1].pose)
        np.testing.assert_allclose(last.matrix, TASK.far_end_to.matrix, atol=1e-9)
        assert until(lambda: [pose_from_msg(one.pose).position[0] for one in holds[-1].markers
                              if one.action == Marker.ADD] == pytest.approx([0.75]))


def test_an_arm_that_stands_still_stops_all(inside, node, held):
    told(inside, TASK)
    begin(inside)
    assert until(lambda: state(node).execution.done > 0.3)
    there = held['far_end'].pose
    held['far_end'].stand()
    code, message = ended(inside)
    assert code == Cause.PATH_TOLERANCE and 'the arm far_end is 0.05' in message
    assert np.linalg.norm(held['far_end'].pose.position - there.position) < 0.05
    assert until(lambda: not state(node).executing)
    # the gripper has stopped as well: where this machine is very late, what single commands lead
    execution = state(node).execution
    if not execution.done < execution.way.duration:
        execution = execution.single
    assert execution.done < execution.way.duration
    for one in execution.arms:
        expected = one.way.poses([execution.done])[0].compose(one.back)
        np.testing.assert_allclose(one.command.matrix, expected.matrix, atol=1e-9)


def test_an_arm_that_is_not_heard_begins_nothing_and_stops_all(inside, node, held):
    told(inside, TASK)
    held['far_end'].silent = True
    assert until(lambda: _since(state(node).far_end) > 0.6)
    answer = inside.trigger('execute')
    assert not answer.success and 'far_end_pose: the last one is' in answer.message
    held['far_end'].silent = False
    assert until(lambda: _since(state(node).far_end) < 0.1)
    begin(inside)
    held['far_end'].silent = True
    code, message = ended(inside)
    assert code == Cause.GRIPPER_POSE_LOST and 'far_end_pose: the last one is' in message


def arrow(holds):
    """Return what the last message of ~/holds says: text and place, by name."""
    return {one.ns: (one.text, pose_from_msg(one.pose)) for one in holds[-1].markers
            if one.action == Marker.ADD}


@pytest.mark.sweep
def test_hands_take_turns_when_they_are_told_to(inside, node):
    inside.trigger('reset')
    assert inside.set_parameters(far_end__hold='free')[0].successful
    hole = CutOut(Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)), radius=0.02)
    feed = Pose.looking_along((-0.6, 0.0, 0.9), (1.0, 0.0, -0.5))
    with listening(inside, MarkerArray, 'holds', LATCHED) as holds:
        told(inside, ThreadInGrasps(hole, 0.2, feed, hold_at=0.85))
        whole = state(node).planned.whole
        first, second = (whole.arms[name][0] for name in ('first', 'second'))
        with robots(inside, gripper=feed, first=first, second=second) as arms:
            assert until(lambda: {'first', 'second'} <= set(state(node).arms))
            assert until(lambda: state(node).feedback is not None)
            answer = inside.trigger('next_stage')  # it is not executed, but others may have
            assert answer.success
            inside.status_of('proof', PATIENCE)
            answer = inside.trigger('execute')  # the first hand is not where that begins
            assert not answer.success and 'the arm first is ' in answer.message
            inside.trigger('reset')
            told(inside, ThreadInGrasps(hole, 0.2, feed, hold_at=0.85))
            assert begin(inside)['arms'] == 'gripper, first'
            assert not inside.trigger('next_stage').success
            assert inside.status_of('next_stage')[0] == Cause.EXECUTING
            # the shape is that of the DLO in both grips
            assert until(lambda: state(node).shape.holds)
            code, message, values = inside.status_of('execute', 2 * PATIENCE)
            assert code == 0 and message.endswith('; then close second at s = 0.95 m'), message
            assert (values['event 1'], values['event 1 arm']) == ('close', 'second')
            end = whole.stages[0].shapes[-1]
            shape = state(node).shape
            np.testing.assert_allclose(shape.positions[-1], end.positions[-1], atol=2e-3)
            assert arrow(holds)['first'][0] == 'clamped at 0.85 m'
            np.testing.assert_allclose(arrow(holds)['first'][1].matrix,
                                       whole.stages[0].arms['first'][-1].matrix, atol=1e-9)
            # told that the second hand holds, it goes on: both are commanded
            assert inside.trigger('next_stage').success
            assert until(lambda: set(arrow(holds)) == {'first', 'second'})
            inside.status_of('proof', PATIENCE)
            arms['second'].put(Pose(second.position + (0.0, 0.0, 0.03), second.quaternion))
            assert until(lambda: state(node).arms['second'].pose.position[2] > second.position[2])
            answer = inside.trigger('execute')
            assert not answer.success and 'the arm second is 0.03 m from' in answer.message
            arms['second'].put(second)
            assert until(lambda: state(node).arms['second'].pose.position[2]
                         < second.position[2] + 1e-6)
            assert begin(inside)['arms'] == 'gripper, first, second'
            code, message = ended(inside)
            assert code == 0, message
            for name, pose in whole.stages[1].arms.items():
                assert np.linalg.norm(arms[name].pose.position - pose[-1].position) < 0.01
            # the first hand opens, and closes farther back; then both draw the DLO on
            assert inside.trigger('next_stage').success
            assert state(node).planned.stage == 3  # in the one between nothing moves
            pull = whole.stage_plans[3]
            inside.status_of('proof', PATIENCE)
            for name, pose in pull.arms.items():
                arms[name].put(pose[0])
            assert until(lambda: np.linalg.norm(state(node).arms['first'].pose.position
                                                - pull.arms['first'][0].position) < 1e-6)
            begin(inside)
            code, message = ended(inside)
            assert code == 0 and message.endswith('stage 4 of 4; then nothing'), message
            np.testing.assert_allclose(state(node).shape.positions[-1],
                                       pull.shapes[-1].positions[-1], atol=5e-3)
            drain(inside.statuses)
            path, _ = inside.plan_threading(feed, hole.pose)
            code, message, _ = inside.status_of('plan_threading')
            assert not path.poses and code == Cause.FAR_END_HELD
            assert 'held by first, second, as the last plan says' in message
    inside.trigger('reset')
    assert inside.set_parameters(far_end__hold='clamped')[0].successful


def test_a_route_is_carried_out_stage_by_stage(inside, node):
    inside.trigger('reset')
    start = Pose.looking_along((0.1, -0.2, 1.0), (1.0, 0.3, 0.2))
    seat = Pose.looking_along((0.55, 0.0, 0.95), (1.0, 0.1, 0.0))
    with listening(inside, MarkerArray, 'holds', LATCHED) as holds, robots(
            inside, gripper=start) as arms:
        assert inside.set_parameters(far_end__hold='free')[0].successful
        assert until(lambda: state(node).feedback is not None
                     and np.allclose(state(node).pose.matrix, start.matrix))
        told(inside, Route([Fork(seat, slip=0.5)]))
        whole = state(node).planned.whole
        names = []
        for k, stage in enumerate(whole.stage_plans):
            assert state(node).planned.stage == k
            begin(inside)
            code, message, values = inside.status_of('execute', 2 * PATIENCE)
            assert code == 0, message
            names.append(values['stage'])
            assert np.linalg.norm(arms['gripper'].pose.position
                                  - stage.grippers[-1].position) < 0.01
            if k == 1:
                assert message.endswith('; then close fork 1 at s = 0.8 m'), message
            if k < 2:
                assert not arrow(holds)
                assert inside.trigger('next_stage').success
                code, said, _ = inside.status_of('proof', PATIENCE)
                assert code == 0, said
        assert names == ['approach fork 1', 'enter fork 1', 'press fork 1']
        # what slides is known at rest only, which is said; it is predicted with its fork
        assert 'the plan is safe at rest: the DLO slides through fork 1' in said
        assert set(arrow(holds)) == {'fork 1'} and arrow(holds)['fork 1'][0].startswith('ring at')
        shape = state(node).shape
        assert [hold.by for hold in shape.holds] == ['fork 1']
        np.testing.assert_allclose(shape.positions[-1],
                                   whole.shapes[-1].positions[-1], atol=5e-3)
        assert 'is the last stage' in inside.trigger('next_stage').message
        inside.trigger('reset')
        assert inside.set_parameters(far_end__hold='clamped')[0].successful


def test_a_hand_that_may_overload_a_fitting_is_stopped(inside, node):
    inside.trigger('reset')
    start = Pose.looking_along((0.1, -0.2, 1.0), (1.0, 0.3, 0.2))
    seat = Pose.looking_along((0.55, 0.0, 0.95), (1.0, 0.1, 0.0))
    wrench = WrenchStamped()
    out = inside.node.create_publisher(WrenchStamped, f'{inside.planner}/measured_wrench', 1)
    timer = inside.node.create_timer(0.02, lambda: out.publish(wrench))
    with robots(inside, gripper=start):
        assert inside.set_parameters(far_end__hold='free')[0].successful
        assert until(lambda: state(node).feedback is not None
                     and np.allclose(state(node).pose.matrix, start.matrix))
        told(inside, Route([Clip(seat, bears=0.5)]))
        wrench.wrench.force.z = 50.0  # what is measured before a fitting holds the DLO is all one
        for _ in range(2):
            begin(inside)
            code, message = ended(inside)
            assert code == 0, message
            assert inside.trigger('next_stage').success
            code, said, _ = inside.status_of('proof', PATIENCE)
            assert code == 0, said
        assert until(lambda: state(node).pull is not None and state(node).pull.force == 50.0)
        begin(inside)
        code, message = ended(inside)
        assert code == Cause.PULL, message
        assert 'the gripper pulls with 50 N' in message and 'a fitting may be overloaded' in message
        assert state(node).execution.phase == 'stopped'  # of half a second, perhaps at its end
    inside.node.destroy_timer(timer)
    inside.node.destroy_publisher(out)
    inside.trigger('reset')
    assert inside.set_parameters(far_end__hold='clamped')[0].successful
