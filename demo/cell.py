# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The demo's last part: a wire that is not as its data sheet says, in a cell with a camera.

The cell is a process of its own (extra `cell`), a physics engine that shares no code with the
planner. The node sees the wire, identifies it, plans, and corrects what it executes.
"""

import os
import queue
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from subprocess import Popen
from time import monotonic, sleep
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMsg
from rclpy.qos import qos_profile_sensor_data

from demo.child import child
from demo.client import PlannerClient
from demo.figures import Watched, save_cell
from dlo_planner.execute.execution import ACTIVE
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.ros.lifecycle import LATCHED
from msg_helpers.poses import pose_from_msg
from msg_helpers.trajectories import poses_from_path

RADIUS, DIAMETER = 8e-3, 1.5e-3  # of the hole and of the wire, m
_WAYPOINTS = 40
_LOOKING = 4.0   # s for which the wire hangs at rest before the camera
_PROVING = 300.0  # s for a proof, on the busiest machine
_EACH = 0.07     # s between two looks: each image
_PATIENCE = 10.0  # times as long as it should take: a slow machine computes the cell slower
_TASK, _SEED = 0, 0
_AS_STATED = {'rod__length': 1.0, 'rod__density': 8960.0, 'rod__youngs_modulus': 110e9,
              'rod__poisson_ratio': 0.34, 'rod__tip_mass': 0.0,
              'rod__natural_curvature': [0.0, 0.0], 'rod__natural_curvature_terms': [0.0, 0.0],
              'tool__position': [0.0, 0.0, 0.0], 'tool__orientation': [0.0, 0.0, 0.0, 1.0],
              'threading__standoff': 0.0, 'cutouts__radius': 0.0, 'threading__deadline': 60.0}


@dataclass(frozen=True)
class Outcome:
    """What came of it.

    Attributes
    ----------
    planned : float
        s for the plan.
    threaded : bool
        Whether the wire is through, in the engine.
    depth, wanted : float
        Depth and wanted in m.
    miss, force : float
        Largest ones there, m, N.
    blind : float
        Blind in m, by how much the plan for the wire of the data sheet would have missed.
    corrections : int
        How many were executed.
    promised : float
        Largest miss in m that the node expected before the entry, with 95 %.
    """

    planned: float
    threaded: bool
    depth: float
    wanted: float
    miss: float
    force: float
    blind: float
    corrections: int
    promised: float


def installed() -> bool:
    """Return whether there is an engine for the cell."""
    return find_spec('mujoco') is not None


def close_the_loop(client: PlannerClient, folder: Path,
                   progress: Callable[[str, int, int], object]) -> Outcome:
    """Have the wire of a cell threaded that the planner does not know; save a picture.

    Parameters
    ----------
    client : PlannerClient
    folder : Path
        Folder of the picture.
    progress : callable
        Called as progress(what, done, total).

    Raises
    ------
    TimeoutError
        Something does not come.
    """
    client.set_parameters(rod__diameter=DIAMETER, cutouts__radius=RADIUS, threading__standoff=0.05,
                          observe__period=_EACH, threading__deepest=0.7,
                          threading__deadline=_PROVING, incoming_command_timeout=0.5)
    client.trigger('reset')
    heard: dict[str, queue.Queue[Any]] = {
        name: queue.Queue() for name in ('shape', 'outcome', 'cutout', 'pose')}
    for kind, topic, qos in ((PathMsg, 'shape', LATCHED), (DiagnosticStatus, 'outcome', LATCHED),
                             (PoseStamped, 'cutout', LATCHED)):
        client.node.create_subscription(kind, f'/dlo_cell/{topic}', heard[topic].put, qos)
    client.node.create_subscription(PoseStamped, f'{client.planner}/gripper_pose',
                                    heard['pose'].put, qos_profile_sensor_data)
    with cell_process(), simulated_time(client):
        goal = pose_from_msg(_next(heard['cutout']).pose)
        start = pose_from_msg(_next(heard['pose']).pose)
        blind, _ = client.plan_threading(start, goal)
        _pass_time(heard['pose'], _LOOKING)
        answer = client.trigger('identify')
        print(f'  identify: {answer.message}')
        path, planned = client.plan_threading(start, goal)
        missed = _missed(client, blind, goal)
        proof = client.proof(path, _PROVING)
        print(f'  proof: {proof["report"]}, {proof["report duration [s]"]} s')
        executed = _executed(client, path, float(proof['report duration [s]']), progress)
        sleep(1.0)
        outcome = [{item.key: item.value for item in msg.values}
                   for msg in _drained(heard['outcome'])][-1]
    shapes = [np.array([pose.position for pose in poses_from_path(msg)])
              for msg in _drained(heard['shape'])]
    way = np.array([pose_from_msg(msg.pose).position for msg in _drained(heard['pose'])])
    worst = np.array([float(outcome[f'its {axis} [m]']) for axis in 'yz'])
    save_cell(folder / 'closed_loop.png', CutOut(goal, radius=RADIUS), Watched(shapes, way, worst))
    client.set_parameters(**_AS_STATED)  # what was identified is of this wire alone
    return Outcome(planned, outcome['threaded'] == 'True', float(outcome['depth [m]']),
                   float(outcome['of [m]']), float(outcome['largest miss [m]']),
                   float(outcome['largest force [N]']), missed, *executed)


@contextmanager
def simulated_time(client: PlannerClient) -> Iterator[None]:
    """Return a context in which the node takes its time from the cell.

    A machine that cannot compute a cell in real time computes it slower, and nothing else changes.
    """
    client.set_parameters(use_sim_time=True)
    try:
        yield
    finally:
        client.set_parameters(use_sim_time=False)


def cell_process() -> AbstractContextManager[Popen[bytes]]:
    """Return a context in which the cell runs, in the ROS domain of this process."""
    return child('dlo_planner.cell.node', '--ros-args', '-p', f'task:={_TASK}',
                 '-p', f'seed:={_SEED}', '-p', f'radius:={RADIUS}',
                 '-p', 'clock:=true', env=os.environ)


def _missed(client: PlannerClient, path: PathMsg, goal: Pose) -> float:
    """Return how far from the hole a wire as identified comes there, on a plan made before, m."""
    entry = poses_from_path(path)[len(path.poses) - _WAYPOINTS]
    tip = poses_from_path(client.predict_shape(entry)[0])[-1].position
    return float(np.linalg.norm(np.cross(tip - goal.position, goal.direction)))


def _executed(client: PlannerClient, path: PathMsg, seconds: float,
              progress: Callable[[str, int, int], object]) -> tuple[int, float]:
    """Have the plan executed; return how often it was corrected, and the miss expected, m."""
    _drained(client.executions)
    code, message, _ = client.execute(path)
    print(f'  execute: {message}')
    state, end = 'running', monotonic() + _PATIENCE * seconds
    while code == 0 and state in ACTIVE and monotonic() < end:
        with suppress(TimeoutError):
            _, message, values = client.execution_in(*ACTIVE, 'succeeded', 'stopped', timeout=1.0)
            state = values['state']
            progress('seconds executed', int(float(values['done [s]'])), int(seconds))
    _drained(client.diagnostics)
    values = {item.key: item.value for item in client.diagnostics.get(timeout=5.0).status[0].values}
    print(f'  {state}: {message}; {values["corrections"]} corrections; a miss of '
          f'{1e3 * float(values["miss expected at most [m]"]):.2g} mm at most was expected')
    return int(values['corrections']), float(values['miss expected at most [m]'])


def _next(messages: queue.Queue[Any]) -> Any:
    try:
        return messages.get(timeout=30.0)
    except queue.Empty:
        raise TimeoutError('the cell did not come up') from None


def _pass_time(poses: queue.Queue[PoseStamped], seconds: float) -> None:
    """Wait until so much time has passed in the cell."""
    _drained(poses)
    first = _seconds(_next(poses))
    while _seconds(_next(poses)) < first + seconds:
        pass


def _seconds(msg: PoseStamped) -> float:
    return float(msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec)


def _drained(messages: queue.Queue[Any]) -> list[Any]:
    taken = []
    with suppress(queue.Empty):
        while True:
            taken.append(messages.get_nowait())
    return taken
