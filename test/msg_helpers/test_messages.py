# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory as JointTrajectoryMsg
from visualization_msgs.msg import Marker

from dlo_planner import (
    CutOut,
    DirectSimulator,
    FarEnd,
    InvalidTask,
    InverseSimulator,
    Pose,
    Rod,
    Trajectory,
)
from dlo_planner.arm.joint_trajectory import JointTrajectory
from dlo_planner.tasks import Carry
from dlo_planner.view.scene import (
    axes_primitives,
    cutout_primitives,
    dlo_primitives,
    path_primitives,
)
from msg_helpers.diagnostics import WARN, diagnostics_msg
from msg_helpers.markers import markers_from_primitives
from msg_helpers.poses import (
    pose_from_msg,
    pose_from_stamped,
    pose_msg,
    pose_msg_of,
    pose_stamped_msg,
    time_msg,
    wrench_in,
    wrench_msg,
)
from msg_helpers.trajectories import (
    joint_trajectory_msg,
    plan_path,
    poses_from_path,
    positions_from_joint_state,
    shape_bytes,
    shape_path,
    timed_trajectory,
    times_from_path,
)

POSE = Pose((1.0, -2.0, 3.5), (0.1, -0.2, 0.3, 0.9))
STAMP = Time(sec=7, nanosec=999_999_999)


@pytest.fixture(scope='module')
def shape():
    rod = Rod(1.0, 0.1, 1.0, 1.0, radius=0.004)
    return DirectSimulator(rod, n_elements=12).solve(Pose.identity())


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def markers(*primitives):
    """Return the Markers of Primitives, as they arrive."""
    return over_the_wire(markers_from_primitives(primitives, 'world', STAMP)).markers


def test_pose_round_trip():
    again = pose_from_msg(over_the_wire(pose_msg(POSE)))
    np.testing.assert_array_equal(again.position, POSE.position)
    np.testing.assert_array_equal(again.quaternion, POSE.quaternion)


def test_frame_is_checked_by_name():
    message = pose_stamped_msg(POSE, 'map')
    with pytest.raises(InvalidTask, match="goal.header.frame_id = 'map': expected 'world'"):
        pose_from_stamped(message, 'world', 'goal')
    message = pose_stamped_msg(POSE, 'world')
    message.pose.position.y = float('inf')
    with pytest.raises(InvalidTask, match=r'goal: Pose\.position'):
        pose_from_stamped(message, 'world', 'goal')


def test_shape_path(shape):
    path = over_the_wire(shape_path(shape, 'world', STAMP))
    assert path.header.stamp == STAMP
    assert all(pose.header == path.header for pose in path.poses)
    poses = poses_from_path(path)
    np.testing.assert_array_equal([pose.position for pose in poses], shape.positions)
    np.testing.assert_allclose([pose.rotation for pose in poses], shape.frames, atol=1e-14)


@pytest.mark.parametrize('length', range(9))  # of the name: what follows it is aligned
def test_the_bytes_of_a_shape_are_those_that_ros_makes(shape, length):
    header, quaternions = Header(frame_id=length * 'f', stamp=STAMP), [
        Rotation.from_matrix(frame).as_quat() for frame in shape.frames]
    message = Path(header=header, poses=[
        PoseStamped(header=header, pose=pose_msg_of(*one))
        for one in zip(shape.positions, quaternions, strict=True)])
    sent = shape_bytes(shape, length * 'f', STAMP)
    assert len(sent) == len(serialize_message(message))
    assert deserialize_message(sent, Path) == message


def test_a_wrench_by_the_axes_of_a_sensor():
    sensor = Pose((0.0, 0.0, 1.0), Rotation.from_euler('z', 90, degrees=True).as_quat())
    at = Pose((2.0, 0.0, 1.0), (0, 0, 0, 1))
    force = wrench_in(sensor, at, (0.0, 0.0, -3.0, 0.0, 0.0, 0.5))
    # x of the sensor is y of the world, its y is -x; the arm of 2 m turns about y by 6 N m
    np.testing.assert_allclose(force, (0.0, 0.0, -3.0, 6.0, 0.0, 0.5), atol=1e-12)
    msg = over_the_wire(wrench_msg(force, 'tool0', STAMP))
    assert (msg.header.frame_id, msg.header.stamp) == ('tool0', STAMP)
    assert (msg.wrench.force.z, msg.wrench.torque.x, msg.wrench.torque.z) == (-3.0, 6.0, 0.5)


def test_plan_path_is_stamped():
    path = over_the_wire(plan_path([POSE, POSE, POSE], [0.0, 0.25, 2.5], 'world', STAMP))
    np.testing.assert_allclose(times_from_path(path), [0.0, 0.25, 2.5], atol=1e-9)
    assert path.poses[1].header.stamp == Time(sec=8, nanosec=249_999_999)


def test_seconds_carry_over():
    assert time_msg(0.5, Time(sec=1, nanosec=600_000_000)) == Time(sec=2, nanosec=100_000_000)


@pytest.mark.parametrize('cutout', [
    CutOut(POSE), CutOut(POSE, radius=0.01), CutOut(POSE, width=0.02, height=0.01)])
def test_markers_are_complete(shape, cutout):
    tube, scale, *axes = markers(*dlo_primitives(shape),
                                  *axes_primitives('gripper', shape.gripper))
    assert tube.scale.x == pytest.approx(0.008)
    assert [marker.type for marker in axes] == [Marker.ARROW] * 3
    assert scale.type == Marker.TEXT_VIEW_FACING and '1/m' in scale.text
    # the sharpest bend, at the gripper, is bright yellow, the free end dark violet
    bright, dark = tube.colors[0], tube.colors[-1]
    assert (bright.r, bright.g, bright.b) == pytest.approx((0.993, 0.906, 0.144), abs=1e-6)
    assert (dark.r, dark.g, dark.b) == pytest.approx((0.267, 0.005, 0.329), abs=0.02)
    drawn = markers(*cutout_primitives([cutout]), *path_primitives([POSE, POSE]))
    rim = np.array([(p.x, p.y, p.z) for p in drawn[0].points])
    np.testing.assert_allclose(rim[0], rim[-1], atol=1e-15)
    sizes = (cutout.radius, cutout.radius) if cutout.radius else (
        (0.01, 0.005) if cutout.width else (0.02, 0.02))
    np.testing.assert_allclose(np.abs(rim).max(axis=0), (0, *sizes), atol=1e-12)
    assert all(np.isfinite(marker.pose.position.x) for marker in drawn)


def test_markers_of_two_cutouts():
    holes = [CutOut(POSE, radius=0.01), CutOut(Pose.identity(), radius=0.03)]
    drawn = markers(*cutout_primitives(holes), *path_primitives([POSE]))
    assert len({(marker.ns, marker.id) for marker in drawn}) == len(drawn) == 6
    assert drawn[2].points[0].y == pytest.approx(0.03)


def test_timed_trajectory_moves_the_tool_not_the_gripper():
    direct = DirectSimulator(Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.6, 0.4)))
    plan = InverseSimulator(direct).thread(CutOut(Pose.identity()), depths=[0.0, 0.1, 0.2])
    tool = Pose((0.1, 0.0, 0.2), (0.1, 0.2, 0.3, 0.9))
    way = Trajectory(plan)
    message = over_the_wire(timed_trajectory(way, 2001, tool, 'world', STAMP))

    def numbers(vectors):
        return np.array([(v.x, v.y, v.z) for v in vectors])

    position = numbers(point.transforms[0].translation for point in message.points)
    speed = numbers(point.velocities[0].linear for point in message.points)
    change = numbers(point.accelerations[0].linear for point in message.points)
    step = way.duration / 2000
    np.testing.assert_allclose(np.gradient(position, step, axis=0)[2:-2], speed[2:-2], atol=1e-5)
    np.testing.assert_allclose(np.gradient(speed, step, axis=0)[2:-2], change[2:-2], atol=1e-4)
    np.testing.assert_allclose(position[-1], plan.grippers[-1].compose(tool.inverse()).position,
                               atol=1e-12)
    # angular ones are about the world's axes, not the tool's
    turns = Rotation.from_quat([(q.x, q.y, q.z, q.w) for q in (
        point.transforms[0].rotation for point in message.points)])
    spin = numbers(point.velocities[0].angular for point in message.points)
    twist = numbers(point.accelerations[0].angular for point in message.points)
    turning = (turns[1:] * turns[:-1].inv()).as_rotvec() / step
    assert (np.ptp(spin, axis=0) > 1e-3).all()
    np.testing.assert_allclose(turning, 0.5 * (spin[1:] + spin[:-1]), atol=1e-5)
    np.testing.assert_allclose(np.gradient(spin, step, axis=0)[2:-2], twist[2:-2], atol=1e-3)


def test_other_arms_have_a_joint_each():
    direct = DirectSimulator(Rod(1.0, 0.05, 0.1, 0.08))
    begin, end = (Pose((x, y, 0.0), (0, 0, 0, 1)) for x, y in ((0.7, 0.0), (0.75, 0.1)))
    plan = InverseSimulator(direct).plan(Carry(
        Pose((0.0, 0.1, 0.0), (0, 0, 0, 1)), end, far_end=FarEnd(begin)), start=Pose.identity())
    way, tool = Trajectory(plan, tolerance=np.inf), Pose((0.1, 0.0, 0.2), (0.1, 0.2, 0.3, 0.9))
    message = over_the_wire(timed_trajectory(way, 501, tool, 'world', STAMP))
    assert message.joint_names == ['gripper', 'far_end']
    places = np.array([(one.x, one.y, one.z) for one in (
        point.transforms[1].translation for point in message.points)])
    speeds = np.array([(one.x, one.y, one.z) for one in (
        point.velocities[1].linear for point in message.points)])
    # the hold itself, which no tool of the gripper displaces
    np.testing.assert_allclose(places[[0, -1]], [begin.position, end.position], atol=1e-9)
    np.testing.assert_allclose(np.gradient(places, way.duration / 500, axis=0)[2:-2],
                               speeds[2:-2], atol=1e-4)


def test_diagnostics():
    message = over_the_wire(diagnostics_msg('a: b', 'wire', WARN, 'look', {'x': 0.25, 'n': 3},
                                            STAMP))
    status = message.status[0]
    assert (status.level, status.message, status.hardware_id) == (WARN, 'look', 'wire')
    assert [(v.key, v.value) for v in status.values] == [('x', '0.25'), ('n', '3')]


def test_all_of_it_arrives(rng):
    times = np.array([0.0, 0.1, 1.9999999996, 12.25])
    given = JointTrajectory(('b', 'a'), times, *rng.normal(size=(3, 4, 2)))
    msg = deserialize_message(serialize_message(joint_trajectory_msg(given)), JointTrajectoryMsg)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (0, 0)  # starts when it arrives
    assert msg.joint_names == ['b', 'a']
    for k, point in enumerate(msg.points):
        np.testing.assert_array_equal(point.positions, given.positions[k])
        np.testing.assert_array_equal(point.velocities, given.velocities[k])
        np.testing.assert_array_equal(point.accelerations, given.accelerations[k])
    assert [(point.time_from_start.sec, point.time_from_start.nanosec) for point in msg.points] == [
        (0, 0), (0, 100_000_000), (2, 0), (12, 250_000_000)]


def test_joint_states():
    assert positions_from_joint_state(JointState(name=['a', 'b'], position=[1.0, -2.0])) == {
        'a': 1.0, 'b': -2.0}
    assert positions_from_joint_state(JointState(name=['a'], velocity=[1.0])) == {}
    with pytest.raises(InvalidTask, match='joint_state has 2 names and 1 positions'):
        positions_from_joint_state(JointState(name=['a', 'b'], position=[1.0]))
    with pytest.raises(InvalidTask, match='joint_state: b = nan: expected a finite number'):
        positions_from_joint_state(JointState(name=['a', 'b'], position=[1.0, float('nan')]))
