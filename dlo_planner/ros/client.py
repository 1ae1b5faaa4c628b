# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A running planner node for Python programs, as Nav2's simple commander: plan, proof, execute."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from time import monotonic, sleep
from types import MappingProxyType
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.inverse.task import Task
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.ros.lifecycle import ALL_LATCHED, REQUEST
from dlo_planner.settings.tasks import task_to_yaml
from msg_helpers.obstacles import obstacles_msg
from msg_helpers.poses import pose_stamped_msg, stamp_text
from msg_helpers.trajectories import poses_from_path

_REMEMBERED = 1000  # messages of a topic
_ACTIVE = State.PRIMARY_STATE_ACTIVE


class Progress(NamedTuple):
    """How far an execution has come: its phase, what is done in percent, and in seconds."""

    phase: str
    percent: float
    done: float


class DloCommander(Node):
    """Asks a planner node, and waits for its answers; rclpy has to be initialized.

    Each call raises Refused, whose `cause` is the number of the reason and whose text is the
    reason, if the node refuses, and TimeoutError if it does not answer.

    Parameters
    ----------
    planner : str, optional
        Full name of the planner node.
    frame_id : str, optional
        Frame of all poses.
    timeout : float, optional
        Seconds to wait for one answer; a plan may take threading.planning_deadline.
    """

    def __init__(self, planner: str = '/dlo_planner', frame_id: str = 'world',
                 timeout: float = 70.0, **options: Any) -> None:
        super().__init__('dlo_commander', **options)
        self.planner, self._frame_id, self._timeout = planner, frame_id, timeout
        self._asked: dict[str, Any] = {}
        self._said, self._progress = (deque[Any](maxlen=_REMEMBERED) for _ in range(2))
        for name, came in (('status', self._said), ('execution', self._progress)):
            self.create_subscription(DiagnosticStatus, f'{planner}/{name}',
                                     lambda msg, came=came: came.append(msg), ALL_LATCHED)
        self._obstacles = self.create_publisher(MarkerArray, f'{planner}/obstacles', REQUEST)

    def wait_until_active(self, timeout: float = 600.0) -> None:
        """Wait until the node answers; the first start of all compiles for a while."""
        end = monotonic() + timeout
        self.wait_for(self._client(GetState, 'get_state').service_is_ready, 'get_state', timeout)
        while self._call(GetState, 'get_state', GetState.Request()).current_state.id != _ACTIVE:
            if monotonic() > end:
                raise TimeoutError(f'{self.planner} does not become active')
            sleep(0.1)

    def set_planner(self, **values: Any) -> None:
        """Set parameters of the node, all or none; '__' stands for '.'."""
        request = SetParametersAtomically.Request(parameters=[
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()])
        result = self._call(SetParametersAtomically, 'set_parameters_atomically', request).result
        if not result.successful:
            raise Refused(Cause.INVALID_PARAMETER, result.reason)

    def set_obstacles(self, obstacles: Iterable[Obstacle], friction: float | None = None) -> None:
        """Publish obstacles in place of those before; with a friction, if each has not its own."""
        self.wait_for(self._obstacles.get_subscription_count, 'obstacles')
        self._obstacles.publish(obstacles_msg(obstacles, self._frame_id, friction=friction))

    def predict(self, gripper: Pose, far_end: Pose | None = None) -> list[Pose]:
        """Return the frames of the DLO, node by node, for a gripper pose."""
        return poses_from_path(self._ask('predict_shape', self._stamped(gripper),
                                         self._stamped(far_end))[0])

    def plan(self, task: Task | str, start: Pose | None = None, goal: Pose | None = None,
             tolerance: float = 0.0) -> Path:
        """Return the plan of a task, or of its YAML text, as the gripper's poses.

        Parameters
        ----------
        task : Task or str
        start : Pose, optional
            Pose of the tool frame now. If None, the one that the node has heard last.
        goal : Pose, optional
            Pose of the task. If None, its own.
        tolerance : float, optional
            By how much a waypoint may miss its place, m; 0: by any amount.
        """
        self.set_planner(task=task if isinstance(task, str) else task_to_yaml(task))
        return self._ask('plan', self._stamped(start), self._stamped(goal), tolerance)[0]

    def proof(self, plan: Path, timeout: float = 300.0) -> dict[str, str]:
        """Return the figures of the proof of a plan, name -> text, once it has held."""
        return self._outcome('proof', {'plan stamp': stamp_text(plan.header.stamp)}, timeout)

    def execute(self, plan: Path) -> Iterator[Progress]:
        """Have a proved plan executed; yield its progress until it has succeeded."""
        self._progress.clear()
        stamp = self._ask('execute_plan', plan.poses[0], self._stamped(None))[1]
        self._outcome('execute', {'stamp': stamp})
        end = None
        while end is None:
            self.wait_for(lambda: self._progress or self._found('execute', {'stamp': stamp}),
                          'execution')
            end = self._found('execute', {'stamp': stamp})
            while self._progress:
                values = values_of(self._progress.popleft())
                yield Progress(values['state'], float(values.get('progress [%]', 0.0)),
                               float(values.get('done [s]', 0.0)))
        _judged(end)

    def trigger(self, name: str) -> str:
        """Call cancel, reset, replan, next_stage or identify; return what the node says."""
        while before := self._found(name, {}):  # of other calls
            self._said.remove(before)
        answer = self._call(Trigger, name, Trigger.Request())
        if not answer.success:
            self._outcome(name)
        return str(answer.message)

    def _stamped(self, pose: Pose | None) -> PoseStamped:
        return PoseStamped() if pose is None else pose_stamped_msg(pose, self._frame_id)

    def _ask(self, name: str, start: PoseStamped, goal: PoseStamped,
             tolerance: float = 0.0) -> tuple[Path, str]:
        """Return what a GetPlan service answers, and the stamp of the request."""
        goal.header.stamp = self.get_clock().now().to_msg()
        if name != 'execute_plan':  # of which the stamp of the first pose names the plan
            start.header.stamp = goal.header.stamp
        answer, stamp = self._call(GetPlan, name, GetPlan.Request(
            start=start, goal=goal, tolerance=tolerance)), stamp_text(goal.header.stamp)
        if not answer.plan.poses:
            self._outcome('execute' if name == 'execute_plan' else name, {'stamp': stamp})
        return answer.plan, stamp

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        client = self._client(kind, name)
        self.wait_for(client.service_is_ready, name)
        future = client.call_async(request)
        self.wait_for(future.done, name)
        return future.result()

    def _client(self, kind: Any, name: str) -> Any:
        if name not in self._asked:
            self._asked[name] = self.create_client(kind, f'{self.planner}/{name}')
        return self._asked[name]

    def wait_for(self, wanted: Callable[[], Any], what: str, timeout: float | None = None) -> None:
        """Take messages until `wanted()`; `what` comes then, and is named in the TimeoutError."""
        end = monotonic() + (self._timeout if timeout is None else timeout)
        while not wanted():
            if monotonic() > end:
                raise TimeoutError(f'{self.planner}/{what}: nothing came in time')
            rclpy.spin_once(self, timeout_sec=0.05)

    def _outcome(self, request: str, known: Mapping[str, str] = MappingProxyType({}),
                 timeout: float | None = None) -> dict[str, str]:
        """Return what ~/status says of a request with these values; raise what it refuses with."""
        self.wait_for(lambda: self._found(request, known), f'status of {request}', timeout)
        status = self._found(request, known)
        self._said.remove(status)
        return _judged(status)

    def _found(self, request: str, known: Mapping[str, str]) -> DiagnosticStatus | None:
        wanted = {'request': request, **known}.items()
        return next((one for one in self._said if wanted <= values_of(one).items()), None)


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """Return what a status says, by name."""
    return {item.key: item.value for item in status.values}


def _judged(status: DiagnosticStatus) -> dict[str, str]:
    values = values_of(status)
    if values['code'] != '0':
        raise Refused(Cause(int(values['code'])), status.message)
    return values
