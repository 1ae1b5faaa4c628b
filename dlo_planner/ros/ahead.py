# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is told of the coming time, so that it does not depend on a machine being in time.

Each message has all of the coming motion: the horizon, and after it a way to rest along the path,
which the next message replaces. So a robot comes to rest within its limits where the messages end.
A controller that takes trajectories with stamps, and replaces what it had from the first point on
(as joint_trajectory_controller does), needs no more.
"""

from typing import NamedTuple

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.ros.execution import Execution
from dlo_planner.ros.stopping import decelerate


class Ahead(NamedTuple):
    """The coming commands.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Seconds since `Execution.stamp`, ascending from 0; after the last, the robot rests.
    poses : list of Pose
        The n poses of the tool frame.
    """

    times: Floats
    poses: list[Pose]


def coming(execution: Execution) -> Ahead:
    """Return the coming commands of an Execution with a horizon, one in each of its periods."""
    way, period = execution.way, execution.period
    if execution.phase == 'stopping':
        assert execution.deceleration is not None  # `stop` made it
        since = _even(execution.since, max(execution.deceleration.length, execution.since), period)
        times, places = since - execution.since, execution.deceleration.at(since)
    else:
        times = _even(0.0, max(execution.sent - execution.done, 0.0), period)
        places = execution.done + times
        if execution.sent < way.duration:
            slower = decelerate(way, execution.sent, 2 * period)
            after = _even(0.0, slower.length, period)[1:]
            places = np.append(places, slower.at(after))
            times = np.append(times, times[-1] + after)
    return Ahead(times, [pose.compose(execution.back) for pose in way.at(places)[0]])


def _even(begin: float, end: float, period: float) -> Floats:
    """Return times (n,) from begin to end, at most a period apart."""
    result: Floats = np.linspace(begin, end, max(int(np.ceil((end - begin) / period)), 0) + 1)
    return result
