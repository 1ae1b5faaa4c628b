# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A page in the browser that shows a running planner: `ros2 run dlo_planner viewer`."""

import sys
from collections.abc import Sequence
from contextlib import suppress
from threading import Lock
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from dlo_planner.errors import DloPlannerError
from dlo_planner.model.pose import Pose
from dlo_planner.ros.lifecycle import LATCHED, REQUEST
from dlo_planner.signals import end_at_once, heard, ignore
from dlo_planner.view.pages import Actions, LivePage
from dlo_planner.view.primitives import Primitive
from dlo_planner.view.viser import LOCAL, PORT, Page, margin_values
from msg_helpers.markers import primitives_after
from msg_helpers.poses import pose_from_msg, pose_stamped_msg

_PARAMETERS = {'planner': '/dlo_planner', 'frame_id': 'world', 'host': LOCAL, 'port': PORT,
               'allow_execute': False, 'rate': 30.0}
_SENT = 0.05    # s between poses of the dragged gripper
_HEARD = 0.2    # s, after which a signal is heard at the latest
_FASTEST = 100.0  # pictures per second


class Viewer(Node):
    """Feeds a LivePage from the topics of a planner, and the planner from the page.

    Parameters: `planner`: full name of its node; `frame_id`: of what is sent, until the planner's
    markers say another; `host`, `port`: of the page; `allow_execute`: whether the page may execute
    plans; `rate`: pictures per second at most.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('dlo_viewer', **options)
        for name, default in _PARAMETERS.items():
            self.declare_parameter(name, default)
        given = {name: self.get_parameter(name).value for name in _PARAMETERS}
        self._planner, self._frame = given['planner'].rstrip('/'), given['frame_id']
        self._allow_execute = given['allow_execute']
        self._plan: Path | None = None  # the one that is shown
        self._items: dict[tuple[str, int], Primitive] = {}
        self._changed, self._lock = False, Lock()
        self._heard = None  # geometry_msgs/Pose of the gripper, not shown yet
        self.page = LivePage(Page(f'dlo_planner: {self._planner}', given['host'], given['port']),
                             Actions(self._send_goal, lambda: self._trigger('replan'),
                                     self._execute, lambda: self._trigger('cancel')),
                             self._allow_execute)
        self._subscribe()
        self._pose_out = self.create_publisher(PoseStamped, self._topic('gripper_pose'),
                                               qos_profile_sensor_data)
        self._goal_out = self.create_publisher(PoseStamped, self._topic('task_goal'), REQUEST)
        self._triggers = {name: self.create_client(Trigger, self._topic(name))
                          for name in ('replan', 'cancel')}
        self._execute_plan = self.create_client(GetPlan, self._topic('execute_plan'))
        self.create_timer(1 / min(max(given['rate'], 1.0), _FASTEST), self._draw)
        self.create_timer(_SENT, self._send_gripper)
        self.get_logger().info(f'{self._planner} is shown at {self.page.page.url}')

    def _subscribe(self) -> None:
        self.create_subscription(MarkerArray, self._topic('markers'), self._on_markers, LATCHED)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, REQUEST)
        self.create_subscription(PoseStamped, self._topic('gripper_pose'), self._on_pose,
                                 qos_profile_sensor_data)
        self.create_subscription(Path, self._topic('gripper_trajectory'), self._on_plan, LATCHED)
        for name in ('status', 'execution'):
            self.create_subscription(DiagnosticStatus, self._topic(name),
                                     lambda msg, name=name: self._on_state(name, msg), LATCHED)

    def _topic(self, name: str) -> str:
        return f'{self._planner}/{name}'

    # ---- what is heard --------------------------------------------------------------------------

    def _on_markers(self, msg: MarkerArray) -> None:
        with self._lock:
            self._items, self._changed = primitives_after(self._items, msg), True
            self._frame = next((marker.header.frame_id for marker in msg.markers
                                if marker.header.frame_id), self._frame)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        own = f'{self._planner.lstrip("/")}: solver'
        for status in msg.status:
            if status.name == own:
                values = {item.key: item.value for item in status.values}
                self.page.put_state('planner', _level(status), status.message)
                if 'report' in values:
                    self.page.put_state('proof', 0 if values['report'].startswith('held') else 1,
                                        f'{values["report"]} ({values.get("report reason")})')
                self.page.put_margins(margin_values(values))

    def _on_state(self, name: str, msg: DiagnosticStatus) -> None:
        self.page.put_state(name, _level(msg), msg.message)

    def _on_plan(self, msg: Path) -> None:
        self._plan = msg

    def _on_pose(self, msg: PoseStamped) -> None:
        self._heard = msg.pose

    # ---- what the page does ---------------------------------------------------------------------

    def _draw(self) -> None:
        with self._lock:
            changed, self._changed = self._changed, False
            items = list(self._items.values())
            rim = self._items.get(('cutout', 0))
        if changed:
            self.page.show(items)
            if rim is not None:
                self.page.put_goal(rim.pose)
        heard, self._heard = self._heard, None
        if heard is not None:
            with suppress(DloPlannerError):  # the planner says what is wrong with it
                self.page.put_gripper(pose_from_msg(heard))

    def _send_gripper(self) -> None:
        pose = self.page.dragged
        if pose is None:
            return
        if self.count_publishers(self._topic('gripper_pose')) > 1:
            self.page.stop_sending(f'another node publishes {self._topic("gripper_pose")}: '
                                   'the dragged gripper is not sent')
            return
        self._pose_out.publish(self._stamped(pose))

    def _send_goal(self, pose: Pose) -> None:
        self._goal_out.publish(self._stamped(pose))
        self.page.say(f'goal sent on {self._topic("task_goal")}')

    def _stamped(self, pose: Pose) -> PoseStamped:
        return pose_stamped_msg(pose, self._frame, self.get_clock().now().to_msg())

    def _execute(self) -> None:
        """Have the plan executed that is shown, and no other."""
        if not self._allow_execute:
            return
        if self._plan is None or not self._execute_plan.service_is_ready():
            self.page.say(f'execute: there is no plan, or no service {self._topic("execute_plan")}',
                          2)
            return
        self.page.say('execute: asked')  # ~/status says how it ended
        self._execute_plan.call_async(GetPlan.Request(start=self._plan.poses[0]))

    def _trigger(self, name: str) -> None:
        client = self._triggers[name]
        if not client.service_is_ready():
            self.page.say(f'{name}: there is no service {self._topic(name)}', 2)
            return
        self.page.say(f'{name}: asked')
        client.call_async(Trigger.Request()).add_done_callback(
            lambda future: self._answered(name, future.result()))

    def _answered(self, name: str, answer: Trigger.Response) -> None:
        self.page.say(f'{name}: {answer.message}', 0 if answer.success else 2)

    def destroy_node(self) -> None:
        """End the page as well."""
        self.page.page.close()
        super().destroy_node()


def _level(status: DiagnosticStatus) -> int:
    return int.from_bytes(status.level, 'little')


def main(args: Sequence[str] | None = None) -> int:
    """Run the viewer until SIGINT or SIGTERM; return the exit status."""
    end_at_once()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    node = None
    try:
        node = Viewer()
        signals = heard()
        while not signals:  # a wait without an end would not hear signals
            rclpy.spin_once(node, timeout_sec=_HEARD)
    except ExternalShutdownException:
        pass
    except (DloPlannerError, ModuleNotFoundError, OSError, ParameterException) as error:
        print(f'viewer: cannot start: {error}', file=sys.stderr)
        return 1
    finally:
        ignore()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
