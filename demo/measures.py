# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the demo measures: residuals of what came, commands against the plan, misses."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from time import monotonic, sleep

import numpy as np
from nav_msgs.msg import Path
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory

from demo.client import PlannerClient, drained
from demo.follower import Follower
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import new_configuration
from dlo_planner.execute.execution import ACTIVE
from dlo_planner.minimize.convergence import residual_of
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from msg_helpers.poses import pose_from_msg

GOAL = Pose.looking_along((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
_PATIENCE = 5.0  # s


def received_residual(simulator: DirectSimulator, gripper: Pose, poses: Sequence[Pose]) -> float:
    """Return the scaled gradient of the potential at a shape that came as a message.

    The strains are taken from the received orientations alone, so this judges what a user gets.
    """
    frames = Rotation.from_quat([pose.quaternion for pose in poses])
    discretization = simulator.discretization(gripper, None)
    system = discretization.system(gripper.rotation)
    turns = (frames[:-1].inv() * frames[1:]).as_rotvec()
    state = new_configuration(system)
    unknowns_of(system, turns / system.lengths[:, None], state.q)
    evaluate(system, state)
    return float(residual_of(system, state))


def times_and_poses(timed: MultiDOFJointTrajectory) -> tuple[Floats, list[Pose]]:
    """Return times (n,) s and Poses (list) of a timed trajectory."""
    times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
             for point in timed.points]
    ways = [point.transforms[0] for point in timed.points]
    return np.array(times), [Pose(
        [getattr(way.translation, axis) for axis in 'xyz'],
        [getattr(way.rotation, axis) for axis in 'xyzw']) for way in ways]


def executed(client: PlannerClient, seconds: float, path: Path) -> list[Pose]:
    """Have a plan (Path) executed by a robot; return the Poses that it was told.

    Parameters
    ----------
    client : PlannerClient
    seconds : float
        Seconds that it takes.
    path : Path
    """
    robot = Follower(client.node, client.planner, pose_from_msg(path.poses[0].pose))
    sleep(0.5)  # its first poses have to be heard
    drained(client.executions)
    code, message, _ = client.execute(path)
    print(f'  execute: {message}')
    state, message, end = 'running', 'nothing came', monotonic() + seconds + _PATIENCE
    while code == 0 and state in ACTIVE and monotonic() < end:
        with suppress(TimeoutError):
            _, message, values = client.execution_in(*ACTIVE, 'succeeded', 'stopped', timeout=1.0)
            state = values['state']
            if state == 'running' and sys.stdout.isatty():
                progress('seconds executed', int(float(values['done [s]'])), int(seconds) + 1)
    print(f'  {state}: {message}')
    robot.close()
    return robot.told


def away_from(commands: Iterable[Pose], grippers: Sequence[Pose]) -> Iterator[float]:
    """Return how far each commanded Pose is from the way through Poses, m."""
    way = np.array([pose.position for pose in grippers])
    steps = np.diff(way, axis=0)
    lengths = np.maximum((steps**2).sum(axis=1), 1e-30)
    for command in commands:
        along = np.clip(((command.position - way[:-1]) * steps).sum(axis=1) / lengths, 0, 1)
        yield np.linalg.norm(way[:-1] + along[:, None] * steps - command.position, axis=1).min()


def missed(shape: Shape) -> float:
    """Return by how much a Shape passes beside the center of GOAL, m; nan before it gets there."""
    depth = (shape.positions - GOAL.position) @ GOAL.direction
    if depth[-1] < 0:
        return np.nan
    last = np.flatnonzero(depth[:-1] < 0)[-1]
    s = brentq(lambda s: (shape.positions_at([s])[0] - GOAL.position) @ GOAL.direction,
               shape.s[last], shape.s[last + 1])
    return float(np.linalg.norm(shape.positions_at([s])[0] - GOAL.position))


def progress(what: str, done: int, total: int) -> None:
    """Show on one line how far a task is."""
    end = '\n' if done == total else '\r'
    if sys.stdout.isatty() or done == total:
        print(f'  {what}: {done}/{total}', end=end, flush=True)
