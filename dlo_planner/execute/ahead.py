# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is told of the coming time, so that it does not depend on a machine being in time.

Each message has all of the coming motion: the horizon, and after it a way to rest along the path,
which the next message replaces. So a robot comes to rest within its limits where the messages end.
A controller that takes trajectories with stamps, and replaces what it had from the first point on
(as joint_trajectory_controller does), needs no more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_planner.execute.stopping import decelerate
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

if TYPE_CHECKING:
    from dlo_planner.execute.execution import Execution


class Ahead(NamedTuple):
    """The coming commands.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Seconds since `Execution.stamp`, ascending from 0, a period apart; after the last, the robot
        rests.
    poses : list of Pose
        The n poses of the tool frame.
    """

    times: Floats
    poses: list[Pose]


def coming(execution: Execution) -> Ahead:
    """Return the coming commands of an Execution with a horizon, one in each of its periods."""
    grippers = grippers_ahead(execution)
    return Ahead(execution.period * np.arange(len(grippers), dtype=float),
                 [gripper.compose(execution.back) for gripper in grippers])


def grippers_ahead(execution: Execution) -> list[Pose]:
    """Return the Poses of the gripper frame in them."""
    way, period, done = execution.way, execution.period, execution.done
    if execution.phase == 'stopping':
        return way.poses([done, *execution.places(len(execution.pace))])
    steps = max(int(np.ceil((execution.sent - done) / period - 1e-9)), 0)
    places = np.array([done, *execution.places(steps)])
    if execution.sent < way.duration:
        places = np.append(places, decelerate(way, execution.sent, execution.kept, period))
    return way.poses(places)
