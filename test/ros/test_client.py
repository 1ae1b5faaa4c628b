# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The commander: a plan, its proof, its execution, and refusals by their number."""

import numpy as np
import pytest
import rclpy
from follower import Follower
from node_inside import GOAL, HERE, state
from planner_process import until
from test_node_tasks import BAR, DIRECT, HOLES, ON_BAR

from dlo_planner import FarEnd, HoldContact, Pose, Thread
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.ros.client import DloCommander
from msg_helpers.poses import pose_from_msg

TASK = Thread(HOLES[0], (0.0, 0.1, 0.2, 0.3))


@pytest.fixture(scope='module')
def robot(node):
    rclpy.init()
    try:
        made = DloCommander()
        made.wait_until_active()
        yield made
        made.destroy_node()
    finally:  # where it is not active in time, the next one begins anew
        rclpy.shutdown()


@pytest.mark.sweep
def test_a_plan_is_made_proved_and_executed(inside, node, robot):
    plan = robot.plan(TASK, start=HERE)
    assert len(plan.poses) == 4
    proof = robot.proof(plan)
    assert proof['report'] == 'held' and float(proof['duration [s]']) > 1
    gripper = Follower(inside.node, inside.planner, pose_from_msg(plan.poses[0].pose))
    try:
        assert until(lambda: state(node).feedback is not None and np.allclose(
            state(node).pose.matrix, pose_from_msg(plan.poses[0].pose).matrix))
        came = list(robot.execute(plan))
    finally:
        gripper.close()
    done = [one.percent for one in came]
    assert done == sorted(done) and done[-1] == pytest.approx(100) and len(came) > 5
    assert came[0].phase == 'running' and came[-1].phase in ('settling', 'succeeded')
    with pytest.raises(Refused) as refused:  # the gripper is at its end
        next(robot.execute(plan))
    assert refused.value.cause == Cause.NOT_AT_START


def test_a_plan_from_where_the_gripper_is_to_where_it_is_asked_for(inside, node, robot):
    inside.shape_for(HERE)
    plan = robot.plan('{type: Thread, depths: [0, 0.1]}', goal=GOAL)
    assert len(plan.poses) == 2
    assert np.allclose(state(node).task.cutout.pose.matrix, GOAL.matrix)
    assert 'proof ends' in robot.trigger('cancel')
    with pytest.raises(Refused) as refused:
        robot.trigger('cancel')
    assert refused.value.cause == Cause.NOTHING_TO_CANCEL


@pytest.mark.parametrize(('ask', 'cause', 'said'), [
    (lambda robot: robot.plan('{type: Thred}'), 107, 'Thread, ThreadInGrasps'),
    (lambda robot: robot.plan(TASK, start=Pose((2e3, 0, 0), (0, 0, 0, 1))), 103, 'plan.start'),
    (lambda robot: robot.plan(TASK, tolerance=-1.0), 100, 'plan.tolerance = -1'),
    (lambda robot: robot.plan('{type: Thread, depths: [0, 3]}', goal=GOAL), 100, 'depths'),
    (lambda robot: robot.predict(HERE, far_end=GOAL), 107, 'far_end.hold = free'),
    (lambda robot: robot.set_planner(rod__length=-1.0), 107, 'rod.length')])
def test_what_is_refused_is_raised_with_its_number(inside, robot, ask, cause, said):
    with pytest.raises(Refused, match=said) as refused:
        ask(robot)
    assert refused.value.cause == cause


def test_shapes_and_obstacles(inside, node, robot):
    robot.set_planner(far_end__hold='pinned')
    level, there = Pose((0, 0, 1), (0, 0, 0, 1)), Pose((0.8, 0, 0.9), (0, 0, 0, 1))
    np.testing.assert_allclose(
        [pose.position for pose in robot.predict(level, there)],
        DIRECT.solve(level, far_end=FarEnd(there, 'pinned')).positions, atol=1e-6)
    robot.set_planner(far_end__hold='free')
    robot.set_obstacles([BAR], friction=0.4)
    assert until(lambda: state(node).scene.bodies)
    assert [one.friction for one in state(node).scene.direct.obstacles] == [0.4]
    assert len(robot.plan(HoldContact(ON_BAR, 0.5), start=HERE).poses) == 2
    robot.set_obstacles([])
    assert until(lambda: not state(node).scene.bodies)
    robot.set_planner(task='{type: Thread}')


def test_a_node_that_is_not_there_is_not_waited_for_for_ever(robot):
    with pytest.raises(TimeoutError, match='/nobody/predict_shape: nothing came in time'):
        DloCommander('/nobody', timeout=0.2).predict(HERE)
