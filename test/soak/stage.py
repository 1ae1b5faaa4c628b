# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A planner process, what it answers, and a robot: the same before and after everything."""

from contextlib import contextmanager, suppress
from queue import Queue
from time import monotonic, sleep

import numpy as np
from follower import Follower
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.srv import GetState
from planner_process import connected_client, drain, running_planner
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from visualization_msgs.msg import Marker

from dlo_planner import Pose
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.poses import pose_from_msg

GRIPPERS = (Pose.looking_along((0.1, -0.2, 1.0), (1.0, 0.3, 0.2)),
            Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)))
GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
# Plans are short, and no search may take long: what counts here is how many there are. Guards of
# time are those for a machine that is busy with everything else.
OPTIONS = {'rod.diameter': 1.5e-3, 'rod.damping': [0.5, 0.01], 'threading.waypoints': 12,
           'threading.deepest': 0.3, 'threading.planning_deadline': 5.0,
           'threading.deadline': 100.0, 'cutouts.radius': 0.01, 'diagnostics_period': 0.2,
           'incoming_command_timeout': 2.0, 'execute.longest_pause': 5.0,
           'constraints.path.position': 0.2, 'constraints.path.angle': 0.5,
           'constraints.goal_time': 10.0}
DEEP = 1000       # commands that are kept for this process, should it be late: none may be lost
PROOF = 400.0     # s to wait for a proof, an execution
STEP = 1.2        # of the regular one, the largest step between two commands


def arguments(**options):
    """Return the command line of a planner with OPTIONS; '__' stands for '.'."""
    values = OPTIONS | {name.replace('__', '.'): value for name, value in options.items()}
    return [part for name, value in values.items() for part in ('-p', f'{name}:={value}')]


class Stage:
    """A planner, its client, and what it has to answer whatever was thrown at it.

    Args:
        planner: Planner; client: PlannerClient
    """

    def __init__(self, planner, client):
        self.planner, self.client = planner, client
        self._parameters = client.node.create_client(GetParameters,
                                                     f'{client.planner}/get_parameters')
        self._lifecycle = client.node.create_client(GetState, f'{client.planner}/get_state')
        self.commands = Queue()
        client.node.create_subscription(PoseStamped, f'{client.planner}/gripper_command',
                                        self.commands.put, DEEP)
        self._values = self._read()
        self.answers = None
        self.restore()
        self.answers = self._asked()

    @property
    def process(self) -> int:
        return self.planner.process.pid

    def restore(self):
        """Take back what good messages have changed: obstacles, parameters, shape, execution."""
        client = self.client
        if 'execution' in client.trigger('cancel').message:
            self._rest()
        client.send_obstacles([Marker(action=Marker.DELETEALL)])
        changed = {name: value for name, value in self._read().items()
                   if not same(value, self._values[name])}
        if changed:
            results = client.set_parameters(**{
                name.replace('.', '__'): self._values[name] for name in changed})
            assert all(one.successful for one in results), results
        client.trigger('reset')
        for messages in (client.shapes, client.trajectories, client.timed, client.diagnostics,
                         client.commands, self.commands, client.statuses, client.executions):
            drain(messages)

    def differences(self) -> list[str]:
        """Restore, and return what is answered otherwise than in the beginning, in words.

        Bit for bit: the same questions in the same state have the same answers.
        """
        self.restore()
        return [f'{name} is answered otherwise' for name, answer in self._asked().items()
                if answer != self.answers[name]]

    def _asked(self):
        """Return name -> what a request is answered."""
        client = self.client
        shapes = {f'predict_shape {k}': poses(client.predict_shape(gripper)[0])
                  for k, gripper in enumerate(GRIPPERS)}
        live = {f'gripper_pose {k}': poses(client.shape_for(gripper)[0])
                for k, gripper in enumerate(GRIPPERS)}
        plan = client.plan_threading(GRIPPERS[1], GOAL)[0]
        assert plan.poses or self.answers is not None, self.planner.log
        values = {name: str(value) for name, value in self._read().items()}
        state = self._call(self._lifecycle, GetState.Request()).current_state.label
        return {**shapes, **live, 'plan_threading': poses(plan), 'lifecycle': state, **values}

    def _read(self):
        answer = self._call(self._parameters, GetParameters.Request(names=list(PARAMETERS)))
        return {name: plain(parameter_value_to_python(value))
                for name, value in zip(PARAMETERS, answer.values, strict=True)}

    def _call(self, client, request):
        assert client.wait_for_service(self.client.timeout), self.planner.log
        future, end = client.call_async(request), monotonic() + self.client.timeout
        while not future.done():
            assert monotonic() < end and self.planner.alive(), self.planner.log
            sleep(0.001)
        return future.result()

    def _rest(self):
        with suppress(TimeoutError):  # it was planning
            self.client.execution_in('stopped', 'succeeded', timeout=3.0)

    # ---- execution --------------------------------------------------------------------------

    def execution(self, robot) -> float:
        """Plan, wait for the proof, begin to execute; return the largest step of a period, m.

        Args:
            robot: Follower, or what has its `put`
        """
        client = self.client
        path = client.plan_threading(GRIPPERS[1], GOAL)[0]
        robot.put(pose_from_msg(path.poses[0].pose))
        values = client.proof(path, PROOF)
        assert values['report'] == 'held', values
        timed = client.timed_for(path)
        for messages in (self.commands, client.executions):
            drain(messages)
        end = monotonic() + PROOF
        while (answer := client.execute(path))[0]:  # the robot is on its way
            assert answer[1] and monotonic() < end, answer[1]
            sleep(0.1)
        speeds = [np.linalg.norm([v.x, v.y, v.z]) for v in (
            point.velocities[0].linear for point in timed.points)]
        return 0.02 * max(speeds)

    def longest_step(self) -> float:
        """Return the largest step between two commands that have come, m."""
        places = [pose_from_msg(one.pose).position for one in drain(self.commands)]
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0.0))


def plain(value):
    """Return a parameter's value, with lists for arrays."""
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def same(one, other) -> bool:
    return str(one) == str(other)


def poses(path) -> list:
    """Return the numbers of a nav_msgs/Path, without stamps."""
    return [[getattr(part, axis) for part, axes in (
        (one.pose.position, 'xyz'), (one.pose.orientation, 'xyzw')) for axis in axes]
        for one in path.poses]


@contextmanager
def stage(directory, *extra, name='/dlo_planner'):
    """Yield a Stage; it ends at the end.

    Args:
        directory: Path for its log
        extra: parts of the planner's command line
        name: of the node
    """
    with (running_planner(directory, *arguments(), *extra) as planner,
          connected_client(planner, name) as client):
        client.timeout = 60.0
        yield Stage(planner, client)


@contextmanager
def robot(stage: Stage):
    follower = Follower(stage.client.node, stage.client.planner, GRIPPERS[1])
    try:
        yield follower
    finally:
        follower.close()
