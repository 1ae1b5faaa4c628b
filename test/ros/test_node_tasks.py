# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node in this process: every task of the library, and all that it can be asked for one."""

import re
from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Goals
from nav_msgs.srv import GetPlan
from node_inside import GOAL, HERE, state
from planner_process import PATIENCE, drain, until
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import String

import dlo_planner
import dlo_planner.tasks
from dlo_planner import (
    CutOut,
    Cylinder,
    DirectSimulator,
    FarEnd,
    HoldContact,
    Insert,
    InverseSimulator,
    LayOnLine,
    Minimize,
    PointLoad,
    Pose,
    Rod,
    SlideContact,
    Thread,
    ThreadSequence,
    ThreadTwo,
)
from dlo_planner.direct.grasp import grasped_at
from dlo_planner.execute.causes import Cause
from dlo_planner.inverse.task import Task
from dlo_planner.penalties import PositionAt
from dlo_planner.rods import GraspedInside, with_plug
from dlo_planner.ros.lifecycle import LATCHED
from dlo_planner.ros.state import Proof
from dlo_planner.ros.streaming import loop_task_of
from dlo_planner.settings.tasks import task_to_yaml
from dlo_planner.tasks import (
    Approach,
    Carry,
    Fork,
    InsertPlug,
    MoveTo,
    Plug,
    Route,
    ThreadInGrasps,
)
from msg_helpers.obstacles import obstacles_msg
from msg_helpers.poses import pose_stamped_msg
from msg_helpers.trajectories import poses_from_path

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
DIRECT = DirectSimulator(WIRE, n_elements=64, n_terms=10, basis='chebyshev')
BAR = Cylinder((0.3, -0.5, 0.8), (0.3, 0.5, 0.8), 0.02, 0.3)
ON_BAR = Pose((0.3, 0.0, 0.82), (0, 0, 0, 1))
HOLES = tuple(CutOut(Pose.looking_along((x, 0.0, z), (1.0, 0.0, 0.0)), radius=0.02)
              for x, z in ((0.0, 1.0), (0.15, 0.99), (0.3, 0.97)))
START = Pose.looking_along((-1.3, -0.2, 1.0), (1.0, 0.1, 0.0))
DEPTHS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)


def approach():
    plan = InverseSimulator(DIRECT).thread(HOLES[0], depths=DEPTHS)
    return Approach(HOLES[0], plan.shapes[0], 0.05)


TASKS = {
    Thread: lambda: Thread(HOLES[0], DEPTHS), ThreadTwo: lambda: ThreadTwo(*HOLES[:2], DEPTHS),
    ThreadSequence: lambda: ThreadSequence(HOLES, depths=DEPTHS),
    Insert: lambda: Insert(CutOut(HOLES[0].pose, radius=1e-3), DEPTHS[:4], 0.2),
    Approach: approach, HoldContact: lambda: HoldContact(ON_BAR, 0.5),
    SlideContact: lambda: SlideContact(ON_BAR, np.linspace(0.45, 0.55, 4)),
    Minimize: lambda: Minimize(PositionAt(1.0, (0.8, 0.0, 0.8))),
    Carry: lambda: Carry(Pose(HERE.position + np.array([0.2, 0.1, 0.0]), HERE.quaternion)),
    InsertPlug: lambda: InsertPlug(
        HERE.compose(Pose((-0.2, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))),
        Plug(0.05, 0.005, 0.02)),
    ThreadInGrasps: lambda: ThreadInGrasps(
        HOLES[0], 0.3, Pose.looking_along((-0.6, 0.0, 0.9), (1.0, 0.0, -0.5)), hold_at=0.8),
    MoveTo: lambda: MoveTo([Pose(HERE.position + np.array([0.0, 0.0, 0.15]), HERE.quaternion)]),
    Route: lambda: Route([Fork(Pose.looking_along((0.55, 0.0, 0.95), (1.0, 0.1, 0.0)), slip=0.5)]),
    LayOnLine: lambda: LayOnLine(Pose.looking_along((0.8, 0.0, 0.9), (1.0, 0.2, 0.0)))}


@pytest.fixture
def tell(inside):
    """Yield a function that sends a task as text, and returns how that ended."""
    out = inside.node.create_publisher(String, f'{inside.planner}/task', 10)
    assert until(out.get_subscription_count)

    def send(task):
        drain(inside.statuses)
        out.publish(String(data=task if isinstance(task, str) else task_to_yaml(task)))
        return inside.status_of('task', PATIENCE)

    yield send
    inside.node.destroy_publisher(out)


@pytest.fixture
def bar(inside, node):
    """Put a bar there."""
    inside._obstacles_out.publish(obstacles_msg([BAR], 'world'))
    assert until(lambda: state(node).scene.bodies)
    yield
    inside._obstacles_out.publish(obstacles_msg([], 'world'))
    assert until(lambda: not state(node).scene.bodies)


def ask(client, name, start=None, goal=None, tolerance=0.0, stamp=0):
    """Return the poses that a GetPlan service answers, and how that ended."""
    request = GetPlan.Request(tolerance=tolerance)
    for field, pose in (('start', start), ('goal', goal)):
        if pose is not None:
            setattr(request, field, pose_stamped_msg(pose, 'world'))
            getattr(request, field).header.stamp.sec = stamp
    drain(client.statuses)
    answer, _ = client._call(GetPlan, name, request)
    return poses_from_path(answer.plan), client.status_of(name)


def at_once(client, **values):
    """Set all of these parameters or none; return the result."""
    return client._call(SetParametersAtomically, 'set_parameters_atomically',
                        SetParametersAtomically.Request(parameters=[
                            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
                            for name, value in values.items()]))[0].result


def test_each_public_task_has_its_way_through_the_node():
    public = {one for one in (*vars(dlo_planner.public).values(), *vars(dlo_planner.tasks).values())
              if isinstance(one, type) and issubclass(one, Task) and one is not Task}
    assert public == set(TASKS)


@pytest.mark.parametrize('kind', TASKS, ids=lambda kind: kind.__name__)
def test_each_task_is_planned_as_the_library_does(inside, node, tell, bar, kind):
    task, start = TASKS[kind](), START if kind is Approach else HERE
    inside.trigger('reset')
    inside.shape_for(start)
    code, message, values = tell(task)
    assert code == 0, message
    assert values['task'] == kind.__name__
    made, scene = state(node).planned, state(node).scene
    known = InverseSimulator(scene.direct, workspace=scene.workspace).plan(task, start=start)
    grippers = (made.whole or made.plan).grippers[-len(known):]
    np.testing.assert_allclose([pose.matrix for pose in grippers],
                               [pose.matrix for pose in known.grippers], atol=1e-6)
    if kind is InsertPlug:
        assert float(values['plug force [N]']) == pytest.approx(known.plug_force.max(), rel=1e-3)
    if len(known) == 1:  # there is a way to it
        assert np.allclose(made.plan.grippers[0].matrix, start.matrix) and len(made.plan) == 2


def test_a_plan_in_stages_goes_on_when_it_is_told_that_the_hold_is_there(inside, node, tell):
    drain(inside.timed)
    code, message, values = tell(TASKS[ThreadInGrasps]())
    assert code == 0 and message.endswith(
        'thread, stage 1 of 9; then close second at s = 0.9 m'), message
    assert (values['stage'], values['stages']) == ('thread', '9')
    assert (values['event 1'], values['event 1 arm'], values['event 1 s [m]']) == (
        'close', 'second', '0.9')
    whole = state(node).planned.whole
    pose = [float(number) for number in values['event 1 pose'].split()]
    np.testing.assert_allclose(pose[:3], whole.events[0].hold.pose.position, atol=1e-5)
    assert inside.status_of('proof', PATIENCE)[0] == 0
    proof = state(node).proof
    node.shared.store.change(lambda now: replace(now, proof=Proof(proof.plan)))
    answer = inside.trigger('next_stage')  # nothing is known of the motion that should be done
    assert not answer.success and 'thread is not proved' in answer.message
    assert inside.status_of('next_stage')[0] == Cause.PROOF_PENDING
    node.shared.store.change(lambda now: replace(now, proof=proof))
    assert inside.timed.get(timeout=PATIENCE).joint_names == ['gripper', 'first']
    assert inside.trigger('next_stage').success
    code, message, values = inside.status_of('next_stage')
    assert code == 0 and message.endswith('hand over 1, stage 2 of 9; then open first at s = 0.8 m'
                                          ', then close first at s = 0.725 m'), message
    assert inside.status_of('proof', PATIENCE)[0] == 0
    timed = inside.timed.get(timeout=PATIENCE)
    assert timed.joint_names == ['gripper', 'first', 'second']
    end = timed.points[-1].transforms[2].translation
    np.testing.assert_allclose([end.x, end.y, end.z], whole.stages[1].arms['second'][-1].position,
                               atol=1e-9)
    made = state(node).planned
    node.shared.store.change(lambda now: replace(
        now, planned=made.in_stage(8), proof=replace(now.proof, plan=made.in_stage(8).plan)))
    assert 'pull 2 is the last stage' in inside.trigger('next_stage').message
    code, message, _ = tell(TASKS[Thread]())  # the hands hold it, as was said
    assert code == Cause.FAR_END_HELD and 'expected ~/reset' in message
    inside.trigger('reset')
    tell(TASKS[Thread]())
    assert 'this one of a Thread has one stage' in inside.trigger('next_stage').message


def test_what_nothing_feeds_is_planned_and_proved_and_not_executed(inside, tell):
    drain(inside.timed)
    code, message, values = tell(ThreadInGrasps(HOLES[0], 0.3, hold_at=0.8, begins_free=True))
    assert code == 0 and message.endswith(
        'thread, stage 1 of 9; then close second at s = 0.9 m'), message
    assert inside.status_of('proof', PATIENCE)[0] == 0
    timed = inside.timed.get(timeout=PATIENCE)
    while timed.joint_names == ['gripper']:  # of a plan before
        timed = inside.timed.get(timeout=PATIENCE)
    assert timed.joint_names == ['gripper', 'first']  # one hand, under both names
    for point in timed.points:
        assert point.transforms[0] == point.transforms[1]
    answer = inside.trigger('execute')
    assert not answer.success and 'and ~/next_stage when that is done' in answer.message
    assert inside.trigger('next_stage').success
    assert inside.status_of('next_stage')[0] == 0
    assert inside.status_of('proof', PATIENCE)[0] == 0
    inside.trigger('reset')


def test_a_proof_ends_with_a_message_of_its_own(inside, node, tell):
    code, _, values = tell(Thread(HOLES[0], DEPTHS))
    proof = inside.status_of('proof', PATIENCE)
    assert (code, proof[0]) == (0, 0) and proof[2]['report'] == 'held'
    assert proof[2]['plan stamp'] == values['plan stamp']
    assert proof[2]['stamp'] == values['stamp']
    assert float(proof[2]['duration [s]']) > 0
    inside.set_parameters(threading__deadline=0.1)
    drain(inside.timed)
    node.shared.store.change(lambda now: replace(now, others=0))  # whatever was planned before
    tell(Thread(HOLES[0], DEPTHS))
    code, message, _ = inside.status_of('proof', PATIENCE)
    inside.set_parameters(threading__deadline=300.0)
    assert code == Cause.PROOF_DEADLINE and 'threading.deadline' in message
    answer = inside.trigger('execute')
    assert not answer.success and 'threading.deadline' in answer.message
    assert not drain(inside.timed)  # only what may be executed is published


@pytest.mark.parametrize(('text', 'code', 'said'), [
    ('{type: []}', 100, 'expected {type: ..., ...}'),
    ('{type: ThreadSequence, cutouts: 3}', 100, 'task.cutouts = 3: expected a list of them'),
    ('{type: Thred}', 100, 'expected {type: ..., ...} with a type of Approach, Carry, Hold'),
    ('nothing', 100, "got 'nothing'"), ('{type: [', 100, 'task, line 1: expected YAML'),
    ('{type: Thread, contac: 1}', 100, 'task.contac: expected one of as_deep_as_possible, cutout'),
    ('{type: HoldContact, s: 0.5}', 100, 'task: expected a pose, by contact or with the request'),
    ('{type: Insert, bore: {radius: -1}}', 100, 'CutOut.radius = -1'),
    ('{type: Thread, cutout: {pose: {position: [2e3, 0, 0]}}}', 103, 'workspace.reach = 1000 m'),
    ('{type: Thread, cutout: {pose: {position: [.nan, 0, 0]}}}', 100, 'Pose.position'),
    (200_000 * 'x', 100, 'task has 200000 characters: expected 100000 at most')])
def test_what_is_no_task_is_refused_by_name(inside, tell, text, code, said):
    came, message, _ = tell(text)
    assert came == code and said in message


def test_a_service_for_each_task_fills_its_pose(inside, node, tell, bar):
    node.shared.store.change(lambda now: replace(now, tasks={}))
    inside.shape_for(HERE)
    for name, kind in (('plan_threading', Thread), ('plan_insertion', Insert)):
        place = 'cutout' if kind is Thread else 'bore'
        tell(f'{{type: {kind.__name__}, {place}: {{pose: {{position: [0, 0, 1.1]}}}}}}')
        poses, (code, message, _) = ask(inside, name, HERE, GOAL)
        assert code == 0 and len(poses) == 12, message
        assert type(state(node).task) is kind
        place = getattr(state(node).task, 'cutout', None) or state(node).task.bore
        np.testing.assert_allclose(place.pose.matrix, GOAL.matrix, atol=1e-12)
    for name, text, count in (
            ('plan_hold_contact', '{type: HoldContact, s: 0.5}', 2),
            ('plan_slide_contact', '{type: SlideContact, lengths: [0.45, 0.5]}', 2)):
        assert ask(inside, name, HERE, ON_BAR)[1][0] == Cause.NO_GOAL
        assert inside.set_parameters(task=text)[0].successful
        poses, (code, message, _) = ask(inside, name, HERE, ON_BAR)
        assert code == 0 and len(poses) == count, message
        again, _ = ask(inside, 'plan', goal=ON_BAR)  # from where the gripper is
        assert np.allclose([pose.matrix for pose in again], [pose.matrix for pose in poses])
    assert not inside.set_parameters(task='{type: Thred}')[0].successful
    inside.set_parameters(task='{type: Thread}')


def test_cutouts_move_together_and_any_number_is_passed(inside, node, tell):
    assert tell(TASKS[ThreadSequence]())[0] == 0
    goal = Pose.looking_along((0.0, 0.5, 1.0), (1.0, 0.0, 0.0))
    poses, (code, message, _) = ask(inside, 'plan_sequence', HERE, goal)
    assert code == 0 and poses, message
    for one, other in zip(state(node).task.cutouts, HOLES, strict=True):
        np.testing.assert_allclose(one.center, other.center + (0.0, 0.5, 0.0), atol=1e-12)
    goals = Goals(goals=[pose_stamped_msg(hole.pose, 'world') for hole in HOLES])
    inside._goals_out.publish(goals)
    assert inside.status_of('task_goals', PATIENCE)[0] == 0
    assert [type(state(node).task), len(state(node).task.cutouts)] == [ThreadSequence, 3]
    assert ask(inside, 'plan_two_cutouts', HOLES[0].pose, HOLES[1].pose)[1][0] == 0
    for one, other in zip((state(node).task.first, state(node).task.second), HOLES, strict=False):
        np.testing.assert_allclose(one.pose.matrix, other.pose.matrix, atol=1e-12)


def test_a_tolerance_is_kept_or_refused(inside, node, tell):
    assert tell(TASKS[ThreadSequence]())[0] == 0
    worst = float(state(node).planned.plan.position_error.max())
    poses, (code, _, _) = ask(inside, 'plan', HERE, tolerance=2 * worst)
    assert code == 0 and poses
    poses, (code, message, values) = ask(inside, 'plan', HERE, tolerance=0.5 * worst, stamp=77)
    assert code == Cause.INFEASIBLE and not poses and 'tolerance' in message
    assert values['stamp'] == '77.000000000'
    for name in ('plan', 'plan_threading', 'plan_two_cutouts'):
        _, (code, message, _) = ask(inside, name, GOAL, GOAL, tolerance=float('nan'))
        assert code == 100 and f'{name}.tolerance = nan' in message
    _, (code, message, _) = ask(inside, 'predict_shape', HERE, tolerance=0.1)
    assert code == 100 and 'predict_shape.tolerance = 0.1: expected 0' in message


@pytest.fixture
def wrenches(inside):
    """Yield a dict of the wrenches that came last, by topic."""
    came = {}
    made = [inside.node.create_subscription(
        WrenchStamped, f'{inside.planner}/{name}', lambda msg, name=name: came.update({name: msg}),
        qos_profile_sensor_data) for name in ('gripper_wrench', 'far_end_wrench')]
    yield came
    for one in made:
        inside.node.destroy_subscription(one)


def row(msg):
    return np.array([getattr(part, axis) for part in (msg.wrench.force, msg.wrench.torque)
                     for axis in 'xyz'])


def test_the_wrench_of_the_dlo_is_that_at_the_tool(inside, node, wrenches):
    inside.set_parameters(tool__position=[0.0, 0.0, 0.1])
    try:
        level = Pose((0.0, 0.0, 1.0), (0, 0, 0, 1))
        assert until(lambda: inside.shape_for(level) and 'gripper_wrench' in wrenches)
        weight = WIRE.mass_per_length * 9.81
        shape = DIRECT.solve(Pose((0.0, 0.0, 1.1), (0, 0, 0, 1)))
        x = float(np.mean(0.5 * (shape.positions[1:, 0] + shape.positions[:-1, 0])))
        # weight pulls down, at the center of mass, about the tool's origin
        expected = [0.0, 0.0, -weight, 0.0, weight * x, 0.0]
        np.testing.assert_allclose(row(wrenches['gripper_wrench']), expected, rtol=1e-4,
                                   atol=1e-9)
        assert wrenches['gripper_wrench'].header.frame_id == 'tool0'
        assert 'far_end_wrench' not in wrenches
    finally:
        inside.set_parameters(tool__position=[0.0, 0.0, 0.0])


def test_who_asks_late_hears_the_wrench_of_the_shape_that_stands(inside, node):
    path, _ = inside.shape_for(Pose((0.1, 0.0, 1.0), (0, 0, 0, 1)))
    came = []
    made = inside.node.create_subscription(
        WrenchStamped, f'{inside.planner}/gripper_wrench', came.append, LATCHED)
    assert until(lambda: came)
    assert came[0].header.stamp == path.header.stamp
    inside.node.destroy_subscription(made)


def test_a_far_end_is_held_while_its_poses_come(inside, node, wrenches, capfd):
    there = Pose((0.8, 0.0, 0.9), (0, 0, 0, 1))
    level = Pose((0.0, 0.0, 1.0), (0, 0, 0, 1))
    out = inside.node.create_publisher(PoseStamped, f'{inside.planner}/far_end_pose', 1)
    assert until(out.get_subscription_count)
    assert 'far_end.hold = free' in ask(inside, 'predict_shape', level, there)[1][1]
    assert inside.set_parameters(far_end__hold='clamped', far_end__timeout=60.0)[0].successful
    assert not inside.set_parameters(far_end__hold='glued')[0].successful
    try:
        inside.shape_for(level)
        poses, _ = ask(inside, 'predict_shape', level, there)
        known = DIRECT.solve(level, far_end=FarEnd(there))
        np.testing.assert_allclose([pose.position for pose in poses], known.positions, atol=1e-6)
        out.publish(pose_stamped_msg(there, 'world', inside.node.get_clock().now().to_msg()))
        assert until(lambda: state(node).far_end is not None)
        path, _ = inside.shape_for(level)
        np.testing.assert_allclose(poses_from_path(path)[-1].position, there.position, atol=1e-6)
        assert until(lambda: inside.shape_for(level) and 'far_end_wrench' in wrenches)
        np.testing.assert_allclose(row(wrenches['far_end_wrench']), -known.far_wrench, rtol=1e-3,
                                   atol=1e-5)
        assert ask(inside, 'plan_threading', HERE, GOAL)[1][0] == Cause.FAR_END_HELD
        # what does not come any more holds no more
        assert inside.set_parameters(far_end__timeout=1e-3)[0].successful
        path, _ = inside.shape_for(level)
        np.testing.assert_allclose(poses_from_path(path)[-1].position, DIRECT.solve(
            level).positions[-1], atol=1e-6)
        assert 'far_end_pose: the last one is older' in capfd.readouterr().err
    finally:
        inside.set_parameters(far_end__hold='free', far_end__timeout=0.5)
        inside.node.destroy_publisher(out)
        inside.trigger('reset')


def test_both_ends_are_carried_and_proved(inside, node, tell):
    begin = Pose((0.0, 0.0, 1.0), (0, 0, 0, 1)), Pose((0.8, 0.0, 1.0), (0, 0, 0, 1))
    task = Carry(Pose((0.0, 0.1, 1.0), (0, 0, 0, 1)), Pose((0.75, 0.15, 1.0), (0, 0, 0, 1)),
                 max_force=20.0)
    out = inside.node.create_publisher(PoseStamped, f'{inside.planner}/far_end_pose', 1)
    assert until(out.get_subscription_count)
    assert inside.set_parameters(far_end__hold='clamped', far_end__timeout=600.0)[0].successful
    try:
        inside.trigger('reset')
        out.publish(pose_stamped_msg(begin[1], 'world', inside.node.get_clock().now().to_msg()))
        assert until(lambda: state(node).far_end is not None)
        inside.shape_for(begin[0])
        drain(inside.timed)
        code, message, _ = tell(task)
        assert code == 0, message
        plan = state(node).planned.plan
        np.testing.assert_allclose(plan.far_end_poses[0].matrix, begin[1].matrix, atol=1e-9)
        np.testing.assert_allclose(plan.far_end_poses[-1].matrix, task.far_end_to.matrix, atol=1e-9)
        code, said, _ = inside.status_of('proof', PATIENCE)
        assert code == 0, said
        timed = inside.timed.get(timeout=PATIENCE)
        assert timed.joint_names == ['gripper', 'far_end']
        for k, pose in ((0, begin[1]), (-1, task.far_end_to)):
            place = timed.points[k].transforms[1].translation
            np.testing.assert_allclose((place.x, place.y, place.z), pose.position, atol=1e-9)
        assert timed.points[len(timed.points) // 2].velocities[1].linear.y > 0
    finally:
        inside.set_parameters(far_end__hold='free', far_end__timeout=0.5)
        inside.node.destroy_publisher(out)
        inside.trigger('reset')


@pytest.mark.parametrize(('values', 'simulator'), [
    ({'rod__grasped_at': 0.4}, GraspedInside(WIRE, 0.4, n_elements=64, n_terms=10,
                                             basis='chebyshev')),
    ({'rod__point_loads': [0.5, 0.0, 0.02, 0.0]}, DirectSimulator(
        WIRE, n_elements=64, n_terms=10, basis='chebyshev',
        point_loads=[PointLoad((0.0, 0.02, 0.0), s=0.5)])),
    ({'rod__point_masses': [0.5, 0.004], 'rod__plug__length': 0.02, 'rod__plug__mass': 0.002,
      'rod__plug__radius': 0.003}, DirectSimulator(with_plug(Rod.circular(
          1.0, 1.5e-3, 8960.0, 110e9, 0.34, point_masses=((0.5, 0.004),), damping=(0.5, 0.0)),
          0.02, 0.002, radius=0.003), n_elements=64, n_terms=10, basis='chebyshev'))])
def test_what_loads_the_dlo_is_stated_by_parameters(inside, node, values, simulator):
    before = {name: state(node).scene.values[name.replace('__', '.')] for name in values}
    assert at_once(inside, **values).successful
    try:
        path, _ = inside.shape_for(HERE)
        np.testing.assert_allclose([pose.position for pose in poses_from_path(path)],
                                   simulator.solve(HERE).positions, atol=1e-6)
        assert ask(inside, 'plan_threading', HERE, GOAL)[1][0] == 0
    finally:
        assert at_once(inside, **before).successful


def test_a_dlo_that_touches_itself_is_predicted_and_not_planned_for(inside, node, tell):
    coil = {'rod__section': 'stiffness', 'rod__length': 0.6, 'rod__diameter': 0.012,
            'rod__mass_per_length': 0.035, 'rod__bending_stiffness': [1.2e-3, 1.2e-3],
            'rod__torsional_stiffness': 0.96e-3, 'rod__natural_curvature': [26.2, 0.0],
            'simulator__basis': 'local', 'simulator__n_elements': 48,
            'simulator__self_contact': True, 'simulator__self_friction': 0.2}
    before = {name: state(node).scene.values[name.replace('__', '.')] for name in coil}
    assert at_once(inside, **coil).successful
    try:
        inside.trigger('reset')
        inside.shape_for(HERE)
        assert until(lambda: state(node).shape is not None)
        shape = state(node).shape
        assert shape.self_contacts
        assert not shape.lies_in_itself
        code, message, _ = tell(Thread(HOLES[0], DEPTHS))
        assert code == Cause.INVALID_PARAMETER
        assert 'simulator.self_contact = True: expected False for the plan of a Thread' in message
        code, message, _ = inside.trigger('identify') and inside.status_of('identify')
        assert code == Cause.INVALID_PARAMETER
        assert 'simulator.self_contact = True: expected False for an estimate' in message
        refused = at_once(inside, rod__grasped_at=0.4)
        assert not refused.successful
        assert 'simulator.self_contact = True: expected False' in refused.reason
        refused = at_once(inside, simulator__self_contact=False)
        assert not refused.successful
        assert 'self_friction = 0.2: expected 0 without self_contact' in refused.reason
    finally:
        assert at_once(inside, **before).successful
        inside.trigger('reset')


def test_a_soft_wire_passes_a_level_hole_obliquely(inside, node, tell, capfd):
    measured = {'rod__section': 'stiffness', 'rod__length': 0.2, 'rod__diameter': 3e-3,
                'rod__mass_per_length': 0.0174, 'rod__bending_stiffness': [1.22e-4, 1.22e-4],
                'rod__torsional_stiffness': 1e-4, 'threading__waypoints': 40}
    before = {name: state(node).scene.values[name.replace('__', '.')] for name in measured}
    assert at_once(inside, **measured).successful
    try:
        code, message, values = tell(Thread(CutOut(HOLES[0].pose, radius=0.01)))
        assert code == 0, message
        assert 0.6 < float(values['largest misalignment [rad]']) < 1.1
        assert -1e-3 < float(values['smallest margin [m]']) < 8.5e-3
        assert re.search(r'misaligned by up to \d+ degrees', capfd.readouterr().err)
        up = CutOut(Pose.looking_along((0, 0, 1), (0.2, 0, 1)), radius=0.006)
        code, message, _ = tell(Thread(up))
        assert code == Cause.NO_ROOM and 'it would pass if held at most' in message
    finally:
        assert at_once(inside, **before).successful


def test_a_dlo_that_is_grasped_inside_is_threaded(inside, node, tell):
    assert at_once(inside, rod__grasped_at=0.4).successful
    try:
        inside.trigger('reset')
        inside.shape_for(HERE)
        code, message, _ = tell(Thread(HOLES[0], DEPTHS[:2]))
        assert code == 0, message
        known = InverseSimulator(DIRECT).thread(HOLES[0], depths=DEPTHS[:2], hold_at=0.4,
                                                start=HERE)
        made = state(node).planned
        np.testing.assert_allclose([pose.matrix for pose in made.plan.grippers],
                                   [pose.matrix for pose in known.grippers], atol=1e-6)
        assert grasped_at(made.plan.shapes[0]) == 0.4 and made.plan.shapes[0].s[-1] == 1.0
        assert inside.status_of('proof', PATIENCE)[2]['report'] == 'held'
        task = loop_task_of(made)
        assert task.hold_at == 0.4 and task.front.simulator.rod.length == pytest.approx(0.6)
        # without depths of its own: as deep as the part in front is long
        assert tell(Thread(HOLES[0]))[0] == 0
        deepest = state(node).scene['threading.deepest']
        assert state(node).planned.plan.depths[-1] == pytest.approx(0.6 * deepest)
        for task, said in ((TASKS[ThreadTwo](), 'a ThreadTwo: of a DLO that is grasped inside'),
                           (Thread(HOLES[0], hold_at=0.3), 'hold_at = 0.3: expected none, or')):
            code, message, _ = tell(task)
            assert code == Cause.INVALID_REQUEST and said in message
        code, message, _ = inside.trigger('identify') and inside.status_of('identify')
        assert code == Cause.INVALID_PARAMETER
        assert 'rod.grasped_at = 0.4: expected 0 for identify' in message
    finally:
        assert at_once(inside, rod__grasped_at=0.0).successful
    for asked in (Thread(HOLES[0], DEPTHS, hold_at=0.4), Insert(HOLES[0], DEPTHS, hold_at=0.4)):
        code, message, _ = tell(asked)
        assert code == Cause.INVALID_PARAMETER
        assert 'rod.grasped_at = 0: expected 0.4, where the task says' in message
