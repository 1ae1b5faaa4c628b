# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The cell as a ROS node: a robot with a DLO that is not quite as stated, and a camera.

python -m dlo_planner.cell.node --ros-args -p dlo:='wire 1.5' -p unknown:=much

It follows a planner's `gripper_commands_ahead`, which it takes at their stamps as the controller of
a robot does, or `gripper_command`. It publishes what a real cell would: the gripper's pose, the
points of the DLO that its tracker sees, and with `sees_hole` where that sees the hole. What came of
the task is on `~/outcome`.

The plant's time is the clock's, from the beginning on: where the machine is late, what is published
comes late, but nothing else happens than if it were in time. With `clock` the plant's time is on
/clock, for nodes with use_sim_time: it goes on as fast as this machine can, and never gets lost.
"""

import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from threading import Event, Lock, Thread
from time import monotonic
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from dlo_planner.cell.camera import Viewer
from dlo_planner.cell.cases import CASES, FAULTS, JOINED, UNKNOWNS, case, strikes_inside
from dlo_planner.cell.disturbances import UNDISTURBED
from dlo_planner.cell.plant import STEP, TOUCH, Passage, Plant
from dlo_planner.cell.robot import Robot
from dlo_planner.cell.tasks import draw_task
from dlo_planner.errors import DloPlannerError, NotConverged
from dlo_planner.model.pose import Pose
from dlo_planner.signals import end_at_once, heard, ignore
from msg_helpers.clouds import cloud_msg
from msg_helpers.diagnostics import ERROR, OK, WARN, status_msg
from msg_helpers.poses import pose_from_stamped, pose_stamped_msg
from msg_helpers.trajectories import plan_path, stamped_poses

_FRAME = 'world'
_PERIOD = 0.01  # s between two poses
_PATIENCE = 5.0  # s for which simulated time waits for a planner that is late
_BEHIND = 0.4   # s that are caught up with; what is later than that is lost
_SLOW = 0.5     # s that are lost, from which on nothing of a motion can be told
_TOLD = 0.5     # s between outcomes and pictures of the DLO
_HEARD = 0.2    # s, after which a signal is heard at the latest
_STOP = 5.0     # N, at which a robot stops
_NODES = 65     # of the DLO as it is published
_RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
_LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)
_PARAMETERS = {
    'planner': ('/dlo_planner', 'Full name of the planner node.'),
    'task': (0, 'Seed of the task: hole and start pose, see `draw_task`.'),
    'dlo': ('wire 1.5', 'wire 1.5 | wire 2 | hose | leaf spring.'),
    'radius': (0.005, 'Of the hole, m; 0: drawn.'),
    'unknown': ('much', 'What the planner does not know: nothing | much | more.'),
    'case': ('', f'What happens, of {" | ".join(CASES)}, s after the gripper first moves; with '
                 'its camera.'),
    'seed': (0, 'Of what is unknown and of the camera\'s errors.'),
    'damping': (0.005, 'Stated ratio, of the slowest vibration.'),
    'sees_hole': (False, 'Whether its camera looks at the hole as well.'),
    'clock': (False, 'Whether it publishes its time on /clock, for nodes with use_sim_time.')}


class CellNode(Node):
    """A plant in real time; where the machine is too slow for that, the outcome says so.

    Raises
    ------
    DloPlannerError
        A parameter makes no sense, or MuJoCo is not installed.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('dlo_cell', **options)
        values = {name: self.declare_parameter(name, default, ParameterDescriptor(
            description=text, read_only=True)).value
            for name, (default, text) in _PARAMETERS.items()}
        if values['unknown'] not in UNKNOWNS:
            raise DloPlannerError(f'parameter unknown = {values["unknown"]!r}: expected one of '
                                  f'{", ".join(UNKNOWNS)}')
        if values['case'] not in ('', *CASES) and not {*values['case'].split(JOINED)} <= {*FAULTS}:
            raise DloPlannerError(f'parameter case = {values["case"]!r}: expected \'\', one of '
                                  f'{", ".join(CASES)}, or some of {", ".join(FAULTS)} with '
                                  f'{JOINED!r} between them')
        self.task = draw_task(values['task'], values['dlo'], values['radius'] or None)
        self._values, self._lock, self._over = values, Lock(), Event()
        self._begin()
        planner = values['planner'].rstrip('/')
        self._pose_out = self.create_publisher(PoseStamped, f'{planner}/gripper_pose',
                                               qos_profile_sensor_data)
        self._cloud_out = self.create_publisher(PointCloud2, f'{planner}/observed_points',
                                                qos_profile_sensor_data)
        self._hole_out = self.create_publisher(PoseStamped, f'{planner}/observed_cutout',
                                               _RELIABLE)
        self._shape_out = self.create_publisher(Path, '~/shape', _LATCHED)
        self._cutout_out = self.create_publisher(PoseStamped, '~/cutout', _LATCHED)
        self._clock_out = self.create_publisher(Clock, '/clock', _RELIABLE) if (
            values['clock']) else None
        self._outcome_out = self.create_publisher(DiagnosticStatus, '~/outcome', _LATCHED)
        self.create_subscription(PoseStamped, f'{planner}/gripper_command', self._on_command,
                                 _RELIABLE)
        self.create_subscription(MultiDOFJointTrajectory, f'{planner}/gripper_commands_ahead',
                                 self._on_ahead, _RELIABLE)
        self.create_service(Trigger, '~/restart', self._on_restart)
        self._cutout_out.publish(pose_stamped_msg(self.task.cutout.pose, _FRAME,
                                                  self._stamped(self._plant.time)))
        self._thread = Thread(target=self._run, name='plant', daemon=True)
        self._thread.start()

    def _begin(self) -> None:
        """Hang the DLO at rest in the gripper at its start pose."""
        unknowns, camera = UNKNOWNS[self._values['unknown']]
        disturbances, seed = UNDISTURBED, self._values['seed']
        if self._values['case']:
            disturbances, camera = case(self._values['case'], seed)
        rng = np.random.default_rng([seed, 78])
        truth = unknowns.draw(rng)
        truth = replace(truth, hole_shift=truth.hole_shift + disturbances.sheets_shift)
        # nobody knows when a planner begins: what happens on the way waits for that
        course = replace(disturbances.draw(np.random.default_rng([seed, 79])), since=np.inf)
        bodies = [replace(one, friction=disturbances.friction) for one in self.task.bodies]
        self._plant = Plant(self.task.rod, self.task.start, bodies, truth=truth, course=course,
                            step=STEP, damping=self._values['damping'] * truth.damping)
        camera = replace(camera, sees_hole=self._values['sees_hole'])
        self._viewer, self._broken = Viewer(camera, rng), ''
        self._worst: Passage | None = None  # of the largest miss
        self._stays: list[tuple[float, float]] = []  # in the hole, from when to when, s
        self._robot = Robot(self.task.start)
        self._due, self._lost, self._told_at = monotonic(), 0.0, -np.inf
        # ns of the clock at the plant's time 0: nothing is stamped by when it was computed
        self._zero = self.get_clock().now().nanoseconds

    def _on_command(self, msg: PoseStamped) -> None:
        with suppress(DloPlannerError), self._lock:
            self._robot.follow(pose_from_stamped(msg, _FRAME, 'gripper_command'))

    def _on_ahead(self, msg: MultiDOFJointTrajectory) -> None:
        with suppress(DloPlannerError), self._lock:
            self._told_at = monotonic()
            self._robot.follow_ahead(*stamped_poses(msg))

    def _on_restart(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            self._begin()
        response.success, response.message = True, 'the DLO hangs at rest at the start pose'
        return response

    def destroy_node(self) -> None:
        """Let time stand still."""
        self._over.set()
        self._thread.join(timeout=5.0)
        super().destroy_node()

    # ---- time -------------------------------------------------------------------------------

    def _run(self) -> None:
        told = -np.inf
        while not self._over.wait(max(self._due - monotonic(), 0.0)):
            with self._lock:
                behind = _BEHIND if self._clock_out is None else 0.0
                lost = max(monotonic() - behind - self._due, 0.0)
                self._due += _PERIOD + lost
                if self._waits():
                    continue
                if self._clock_out is None:
                    self._lost += lost
                    self._zero += round(1e9 * lost)
                self._step()
                if monotonic() - told >= _TOLD:
                    told = monotonic()
                    self._tell()

    def _waits(self) -> bool:
        """Return whether simulated time stands still until the planner has told more."""
        return (self._clock_out is not None and self._robot.waits(self._next)
                and monotonic() - self._told_at < _PATIENCE)

    def _step(self) -> None:
        plant, broken = self._plant, self._broken
        try:
            if not broken:
                there = self._robot.moved(self._next, _PERIOD)
                if there != self.task.start and np.isinf(plant.course.since):
                    plant.course = replace(plant.course, since=plant.time)
                plant.move(there, _PERIOD)
        except NotConverged as error:
            self._broken = str(error)
        if plant.largest_forces.max(initial=0.0) > _STOP:
            self._broken = f'a force of {plant.largest_forces.max():.3g} N: the robot stops'
        passage = plant.passage(self.task.cutout)
        if passage.depth > 0:
            self._stay_inside(plant.time)
            if self._worst is None or passage.miss > self._worst.miss:
                self._worst = passage
        if self._clock_out is not None:
            self._clock_out.publish(Clock(clock=self._stamped(plant.time)))
        self._pose_out.publish(pose_stamped_msg(plant.measured, _FRAME,
                                                self._stamped(plant.time)))
        for image in self._viewer.images(plant, self.task.cutout):
            stamp = self._stamped(image.stamp)
            if image.hole is not None:
                hole = Pose(image.hole, self.task.cutout.pose.quaternion)
                self._hole_out.publish(pose_stamped_msg(hole, _FRAME, stamp))
            self._cloud_out.publish(cloud_msg(image.points, _FRAME, stamp))

    def _stay_inside(self, time: float) -> None:
        begin, end = self._stays.pop() if self._stays else (time, time)
        if time > end + 1.5 * _PERIOD:  # it was outside meanwhile
            self._stays.append((begin, end))
            begin = time
        self._stays.append((begin, time))

    @property
    def _next(self) -> float:
        """Time of the clock at the end of the next period, s."""
        return float(1e-9 * self._zero + self._plant.time + _PERIOD)

    def _stamped(self, time: float) -> Time:
        """Return the stamp of a time of the plant."""
        return _stamp(self._zero + round(1e9 * time))

    def _tell(self) -> None:
        plant, task = self._plant, self.task
        self._shape_out.publish(plan_path(seen(plant), np.zeros(_NODES), _FRAME,
                                          self._stamped(plant.time)))
        depth, force = plant.passage(task.cutout).depth, plant.largest_forces.max(initial=0.0)
        worst = self._worst or Passage(0.0, np.nan, np.nan, np.nan, np.nan)
        threaded = depth > 0.99 * task.depth and worst.miss < task.radius
        slow = self._lost > _SLOW
        level = ERROR if self._broken else WARN if force > TOUCH or slow else OK
        message = self._broken or ('threaded' if threaded else 'under way')
        if slow:
            message += (f'; of no meaning: this machine is too slow, the DLO moved {self._lost:.1f}'
                        ' s too little, so it felt commands that were too fast')
        self._outcome_out.publish(status_msg('dlo_cell: task', task.name, level, message, {
            'threaded': threaded, 'depth [m]': float(depth), 'of [m]': float(task.depth),
            'largest miss [m]': float(worst.miss), 'its y [m]': float(worst.y),
            'its z [m]': float(worst.z), 'its depth [m]': float(worst.depth),
            'room [m]': float(task.room),
            'largest force [N]': float(force), 'touched': bool(force > TOUCH),
            'struck inside': any(strikes_inside(plant.course.times, *stay)
                                 for stay in self._stays),
            'lost [s]': float(self._lost)}))


def seen(plant: Plant) -> list[Pose]:
    """Return Poses along the DLO, x axis = tangent."""
    positions = plant.points(np.linspace(0, plant.length, _NODES))
    tangents = np.gradient(positions, axis=0)
    return [Pose.looking_along(*node) for node in zip(positions, tangents, strict=True)]


def _stamp(nanoseconds: float) -> Time:
    return Time(sec=int(nanoseconds // 10**9), nanosec=int(nanoseconds % 10**9))


def main(args: Sequence[str] | None = None) -> int:
    """Run the cell until it is interrupted; return the exit status."""
    end_at_once()
    # its own handlers would end the context while the plant's thread publishes
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    node = None
    try:
        node = CellNode()
        signals = heard()
        while not signals:  # a wait without an end would not hear signals
            rclpy.spin_once(node, timeout_sec=_HEARD)
    except ExternalShutdownException:
        pass
    except DloPlannerError as error:
        print(f'dlo_cell: cannot start: {error}', file=sys.stderr)
        return 1
    finally:
        ignore()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
