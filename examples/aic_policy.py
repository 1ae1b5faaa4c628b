# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A policy for the AI for Industry Challenge (github.com/intrinsic-dev/aic) that asks this node.

    ros2 run dlo_planner planner_node --ros-args -p frame_id:=base_link --params-file CABLE.yaml
    export DLO_PLANNER_CONFIG=CABLE.yaml PYTHONPATH=examples:$PYTHONPATH
    ros2 run aic_model aic_model --ros-args -p policy:=aic_policy

Both need the RMW_IMPLEMENTATION of the challenge, rmw_zenoh_cpp.

The node plans the way of the gripper (`~/plan_threading`, GetPlan in base_link); the poses go out
at 20 Hz. What the cable itself does to the force sensor, its predicted `gripper_wrench`, is taken
off the measured wrench; what is left is contact, and too much of it ends the task. Where port and
gripper are is read from tf: the port's frame is there with `ground_truth:=true` only; without it,
something has to publish where the cameras see it.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from aic_model.policy import Policy
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from numpy.typing import NDArray
from rclpy.time import Time
from scipy.spatial.transform import Rotation, Slerp

from dlo_planner import Pose
from dlo_planner.settings.building import direct_of
from dlo_planner.settings.yaml_files import read_values
from msg_helpers.paths import poses_from_path, times_from_path
from msg_helpers.poses import pose_msg, pose_stamped_msg

PLANNER = os.environ.get('DLO_PLANNER_NODE', '/dlo_planner')
BASE, GRIPPER = 'base_link', 'gripper/tcp'
PERIOD = 0.05                  # s between two targets
LARGEST = 10.0, 1.0            # N, N m: more than the cable explains is contact
PATIENCE = 60.0                # s for a plan
WAIT = 10.0                    # s for frames and the first observation
# a plug goes against the z axis of its port; a cut-out's x axis is the way through it
INTO_PORT = Pose.from_rotation((0, 0, 0), Rotation.from_euler('y', 90, degrees=True).as_matrix())


class AicPolicy(Policy):
    """Plans once, then follows the plan while no more than the cable is felt."""

    def __init__(self, parent_node: Any) -> None:
        super().__init__(parent_node)
        values, _ = read_values(os.environ.get('DLO_PLANNER_CONFIG', 'copper_wire'))
        self._direct = direct_of(values)
        self._tool = Pose(values['tool.position'], values['tool.orientation'])
        self._client = parent_node.create_client(GetPlan, f'{PLANNER}/plan_threading')
        self._shape = None

    def insert_cable(self, task: Any, get_observation: Callable, set_pose_target: Callable,
                     send_feedback: Callable[[str], None]) -> bool:
        """Insert the cable of a Task; return whether the gripper came to the end of the plan."""
        frame = f'task_board/{task.target_module_name}/{task.port_name}_link'
        if not self._waited(lambda: get_observation() is not None):
            send_feedback(f'no observation within {WAIT:g} s')
            return False
        for needed in (frame, GRIPPER, get_observation().wrist_wrench.header.frame_id):
            if not self._waited(lambda needed=needed: self._is_known(needed)):
                send_feedback(f'no frame {needed} in tf within {WAIT:g} s')
                return False
        port = self._pose_of(frame)
        path = self._planned(self._pose_of(GRIPPER), port.compose(INTO_PORT))
        if path is None or not path.poses:
            send_feedback(f'no plan: {PLANNER}/status says why')
            return False
        send_feedback(f'plan of {len(path.poses)} poses')
        for pose in sampled(poses_from_path(path), times_from_path(path)):
            force, torque = self._unexplained(pose, get_observation())
            if force > LARGEST[0] or torque > LARGEST[1]:
                send_feedback(f'contact: {force:.1f} N, {torque:.2f} N m beyond the cable')
                return False
            set_pose_target(pose_msg(pose), BASE)
            self.sleep_for(PERIOD)
        return True

    def _waited(self, ready: Callable[[], bool]) -> bool:
        """Return whether something is ready within WAIT."""
        for _ in range(round(WAIT / PERIOD)):
            if ready():
                return True
            self.sleep_for(PERIOD)
        return ready()

    def _is_known(self, frame: str) -> bool:
        return bool(self._parent_node._tf_buffer.can_transform(BASE, frame, Time()))

    def _pose_of(self, frame: str) -> Pose:
        """Return where a frame is, as a Pose in base_link."""
        found = self._parent_node._tf_buffer.lookup_transform(BASE, frame, Time()).transform
        return Pose([getattr(found.translation, axis) for axis in 'xyz'],
                    [getattr(found.rotation, axis) for axis in 'xyzw'])

    def _planned(self, start: Pose, goal: Pose) -> Path | None:
        """Return the Path that the node answers; None if it does not."""
        if not self._client.wait_for_service(timeout_sec=PATIENCE):
            return None
        asked = self._client.call_async(GetPlan.Request(
            start=pose_stamped_msg(start, BASE), goal=pose_stamped_msg(goal, BASE)))
        latest = time.monotonic() + PATIENCE
        while not asked.done() and time.monotonic() < latest:
            time.sleep(0.01)  # another thread receives the answer
        return asked.result().plan if asked.done() else None

    def _unexplained(self, gripper: Pose, observation: Any) -> tuple[float, float]:
        """Return the force (N) and torque (N m) on the sensor that the cable does not explain.

        The sensor is tared without the cable. The cable pulls with the opposite of `gripper_wrench`
        at the grip; its moment about the sensor has the lever between both.
        """
        held = gripper.compose(self._tool)
        self._shape = self._direct.solve(held, self._shape)
        pull, turn = -self._shape.gripper_wrench[:3], -self._shape.gripper_wrench[3:]
        sensor = self._pose_of(observation.wrist_wrench.header.frame_id)
        turn = turn + np.cross(held.position - sensor.position, pull)
        measured = observation.wrist_wrench.wrench
        found = [sensor.rotation @ [getattr(part, axis) for axis in 'xyz']
                 for part in (measured.force, measured.torque)]
        return float(np.linalg.norm(found[0] - pull)), float(np.linalg.norm(found[1] - turn))


def sampled(poses: Sequence[Pose], times: NDArray[np.float64]) -> Iterator[Pose]:
    """Yield the Poses of a timed plan every PERIOD, the last one at its end."""
    turns = Slerp(times, Rotation.from_matrix([pose.rotation for pose in poses]))
    places = np.array([pose.position for pose in poses])
    for now in np.append(np.arange(times[0], times[-1], PERIOD), times[-1]):
        place = [np.interp(now, times, places[:, axis]) for axis in range(3)]
        yield Pose.from_rotation(place, turns(now).as_matrix())


aic_policy = AicPolicy  # aic_model takes the class that is named as its module
