# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The node seen from the other side: ask it over DDS and wait for the answers."""

import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from time import monotonic
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.model.pose import Pose
from dlo_planner.ros.lifecycle import ALL_LATCHED, CHANGES, LATCHED, REQUEST
from dlo_planner.ros.state import DONE
from msg_helpers.poses import header, pose_stamped_msg, stamp_text

Told = tuple[int, str, dict[str, str]]  # code, message, values


class PlannerClient:
    """Talks to a running planner node; a thread of its own receives what comes."""

    def __init__(self, planner: str = '/dlo_planner', frame_id: str = 'world',
                 timeout: float = 10.0) -> None:
        self.planner, self.frame_id, self.timeout = planner, frame_id, timeout
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node('dlo_planner_client', context=self.context)
        self.shapes: queue.Queue[Path] = queue.Queue()
        self.trajectories: queue.Queue[Path] = queue.Queue()
        self.timed: queue.Queue[MultiDOFJointTrajectory] = queue.Queue()
        self.diagnostics: queue.Queue[DiagnosticArray] = queue.Queue()
        self.commands: queue.Queue[PoseStamped] = queue.Queue()
        self.statuses: queue.Queue[DiagnosticStatus] = queue.Queue()
        self.executions: queue.Queue[DiagnosticStatus] = queue.Queue()
        for name, came in (('status', self.statuses), ('execution', self.executions)):
            self.node.create_subscription(DiagnosticStatus, f'{planner}/{name}', came.put,
                                          ALL_LATCHED)
        self.node.create_subscription(Path, f'{planner}/predicted_shape', self.shapes.put, LATCHED)
        self.node.create_subscription(Path, f'{planner}/gripper_trajectory',
                                      self.trajectories.put, ALL_LATCHED)
        self.node.create_subscription(MultiDOFJointTrajectory,
                                      f'{planner}/gripper_trajectory_timed', self.timed.put,
                                      ALL_LATCHED)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self.diagnostics.put,
                                      REQUEST)
        self.node.create_subscription(PoseStamped, f'{planner}/gripper_command', self.commands.put,
                                      CHANGES)  # none may be lost, however late they are taken
        self._pose_out = self.node.create_publisher(PoseStamped, f'{planner}/gripper_pose',
                                                    qos_profile_sensor_data)
        self._goal_out = self.node.create_publisher(PoseStamped, f'{planner}/task_goal', REQUEST)
        self._goals_out = self.node.create_publisher(Goals, f'{planner}/task_goals', REQUEST)
        self._obstacles_out = self.node.create_publisher(MarkerArray, f'{planner}/obstacles',
                                                         REQUEST)
        self._clients: dict[str, Any] = {}
        self._closed = False
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._closed:
            # a subscription that another thread destroys may be waited for just then
            with suppress(ExternalShutdownException, InvalidHandle):
                self._executor.spin()

    def close(self) -> None:
        """Stop receiving and leave the ROS graph."""
        self._closed = True
        self._executor.shutdown()
        self._thread.join(timeout=5.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def wait_until_ready(self, timeout: float, alive: Callable[[], bool] = lambda: True) -> bool:
        """Return whether the node answers within `timeout` s; stop early when not `alive()`."""
        end = monotonic() + timeout
        while monotonic() < end and alive():
            # The node is ready when it can be seen. The publishers have to be matched too: a pose
            # that is sent before that is lost.
            if (self._client(GetPlan, 'plan_threading').wait_for_service(0.1)
                    and self._pose_out.get_subscription_count()
                    and self._goal_out.get_subscription_count()
                    and self._goals_out.get_subscription_count()
                    and self._obstacles_out.get_subscription_count()):
                return True
        return False

    def send_pose(self, pose: Pose, frame_id: str | None = None) -> Time:
        """Publish a Pose as the gripper's; return its stamp."""
        return self._send(self._pose_out, pose, frame_id)

    def send_goal(self, pose: Pose, frame_id: str | None = None) -> Time:
        """Publish a Pose as the cut-out; return its stamp."""
        return self._send(self._goal_out, pose, frame_id)

    def _send(self, publisher: Publisher, pose: Pose, frame_id: str | None) -> Time:
        stamp = self.node.get_clock().now().to_msg()
        publisher.publish(pose_stamped_msg(pose, frame_id or self.frame_id, stamp))
        return stamp

    def shape_for(self, pose: Pose) -> tuple[Path, float]:
        """Publish a gripper Pose and return the shape (Path) that answers it, and the s it took."""
        started = monotonic()
        stamps = []
        while monotonic() - started < self.timeout:
            stamps.append(self.send_pose(pose))
            sent = monotonic()
            while monotonic() - sent < 1.0:
                try:
                    path = self.shapes.get(timeout=0.05)
                except queue.Empty:
                    continue
                if path.header.stamp in stamps:
                    return path, monotonic() - sent
        raise TimeoutError(f'no shape came within {self.timeout} s')

    def predict_shape(self, pose: Pose) -> tuple[Path, float]:
        """Return the Path that the service predict_shape answers for a gripper Pose, and the s."""
        request = GetPlan.Request(start=pose_stamped_msg(pose, self.frame_id))
        response, seconds = self._call(GetPlan, 'predict_shape', request)
        return response.plan, seconds

    def plan_threading(self, start: Pose, goal: Pose) -> tuple[Path, float]:
        """Return the Path that the service plan_threading answers, and the s it took."""
        request = GetPlan.Request(start=pose_stamped_msg(start, self.frame_id),
                                  goal=pose_stamped_msg(goal, self.frame_id))
        response, seconds = self._call(GetPlan, 'plan_threading', request)
        return response.plan, seconds

    def plan_two_cutouts(self, first: Pose, second: Pose) -> tuple[Path, float]:
        """Return the Path that the service plan_two_cutouts answers, and the s it took."""
        request = GetPlan.Request(start=pose_stamped_msg(first, self.frame_id),
                                  goal=pose_stamped_msg(second, self.frame_id))
        response, seconds = self._call(GetPlan, 'plan_two_cutouts', request)
        return response.plan, seconds

    def send_goals(self, poses: Sequence[Pose]) -> None:
        """Publish Poses as cut-outs, in the order in which they are passed."""
        self._goals_out.publish(Goals(header=header(self.frame_id), goals=[
            pose_stamped_msg(pose, self.frame_id) for pose in poses]))

    def send_obstacles(self, markers: Sequence[Marker]) -> None:
        """Publish visualization_msgs/Markers as obstacles."""
        self._obstacles_out.publish(MarkerArray(markers=markers))

    def trigger(self, name: str) -> Trigger.Response:
        """Return the std_srvs/Trigger response of the node's service `name`."""
        return self._call(Trigger, name, Trigger.Request())[0]

    def execute(self, path: Path) -> Told:
        """Have the plan (Path) executed; return the outcome as (code, message, values)."""
        drain(self.statuses)
        answer, _ = self._call(GetPlan, 'execute_plan', GetPlan.Request(start=path.poses[0]))
        outcome = self.status_of('execute')
        assert (outcome[0] == 0) == bool(answer.plan.poses)
        return outcome

    def set_parameters(self, **values: Any) -> list[SetParametersResult]:
        """Set parameters ('__' stands for '.'); return the list of SetParametersResult."""
        request = SetParameters.Request(parameters=[
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()])
        answer, _ = self._call(SetParameters, 'set_parameters', request)
        return list(answer.results)

    def proof(self, path: Path, timeout: float | None = None) -> dict[str, str]:
        """Return what /diagnostics says of a plan (Path), name -> text, once its proof is done."""
        wanted = stamp_text(path.header.stamp)
        timeout = 6 * self.timeout if timeout is None else timeout
        end = monotonic() + timeout
        while monotonic() < end:
            with suppress(queue.Empty):
                status = self.diagnostics.get(timeout=0.1).status[0]
                values = {item.key: item.value for item in status.values}
                if values.get('plan stamp') == wanted and values['report'] in DONE:
                    return values
        raise TimeoutError(f'the plan was not proved within {timeout} s')

    def timed_for(self, path: Path) -> MultiDOFJointTrajectory:
        """Return the timed trajectory (MultiDOFJointTrajectory) of a proved plan (Path)."""
        end = monotonic() + self.timeout
        while monotonic() < end:
            with suppress(queue.Empty):
                timed = self.timed.get(timeout=0.1)
                if timed.header.stamp == path.header.stamp:
                    return timed
        raise TimeoutError(f'no timed trajectory of this plan came within {self.timeout} s')

    def status_of(self, request: str, timeout: float | None = None) -> Told:
        """Return the next outcome of a request by its name, as (code, message, values)."""
        return self._next(self.statuses, timeout, lambda values: values['request'] == request)

    def execution_in(self, *states: str, timeout: float | None = None) -> Told:
        """Return the next report on the execution in one of these states, as `status_of` does."""
        return self._next(self.executions, timeout, lambda values: values['state'] in states)

    def _next(self, came: queue.Queue[DiagnosticStatus], timeout: float | None,
              wanted: Callable[[dict[str, str]], bool]) -> Told:
        timeout = self.timeout if timeout is None else timeout
        end = monotonic() + timeout
        while monotonic() < end:
            with suppress(queue.Empty):
                status = came.get(timeout=0.1)
                values = {item.key: item.value for item in status.values}
                if wanted(values):
                    return int(values['code']), status.message, values
        raise TimeoutError(f'nothing of that kind came within {timeout} s')

    def _client(self, kind: Any, name: str) -> Any:
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, f'{self.planner}/{name}')
        return self._clients[name]

    def _call(self, kind: Any, name: str, request: Any) -> tuple[Any, float]:
        client = self._client(kind, name)
        if not client.wait_for_service(self.timeout):
            raise TimeoutError(f'service {name} did not appear within {self.timeout} s')
        done = threading.Event()
        started = monotonic()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        if not done.wait(self.timeout):
            raise TimeoutError(f'service {name} did not answer within {self.timeout} s')
        return future.result(), monotonic() - started


def drain(messages: queue.Queue[Any]) -> list[Any]:
    """Empty a queue; return what was in it."""
    taken = []
    with suppress(queue.Empty):
        while True:
            taken.append(messages.get_nowait())
    return taken
