# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion begins where the gripper is, which is hardly ever exactly where the plan begins."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.identify.blending import Change
from dlo_planner.identify.steering import Steered
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.plan.motion.periods import slowest_period
from dlo_planner.plan.motion.timed_path import TimedPath

_NOTICED = 1e-3, 5e-3  # m, rad: what is less is left to the robot, as it is at every command
_LONG_AGO = -1e6       # s
_WINDOWS = 0.02, 5.0   # s
_EVEN = 0.1            # s


def from_where_it_is(way: TimedPath, here: Pose, shape: Shape) -> TimedPath | Steered:
    """Return a motion that begins at a pose and goes over to its way without swinging the DLO.

    Parameters
    ----------
    way : TimedPath
        TimedPath of the gripper.
    here : Pose
        Pose of the gripper now, near the beginning of the way.
    shape : Shape
        Shape of the DLO there.
    """
    first = way.at([0.0])[0][0]
    turn = Rotation.from_matrix(here.rotation @ first.rotation.T).as_rotvec()
    away = np.concatenate([turn, here.position - first.position])
    if np.linalg.norm(away[3:]) <= _NOTICED[0] and np.linalg.norm(turn) <= _NOTICED[1]:
        return way
    try:
        steered = Steered.of(way, shape)
    except InvalidTask:  # modes are not defined for all shapes
        rod: Any = shape.rod  # a plan's shapes know it
        period = np.clip(slowest_period(rod), *_WINDOWS)
        steered = Steered(way, np.array([period, period, _EVEN]))
    return replace(steered, changes=(Change(_LONG_AGO, np.zeros(1), away[None]),
                                     Change(0.0, np.zeros(1), -away[None])))


def blending_as(steered: Steered, windows: Floats, time: float) -> Steered | None:
    """Return a Steered that blends further changes in over other windows.

    None as long as one of its changes is still being blended in: the motion would leap.

    Parameters
    ----------
    windows : ndarray, shape (k,)
    time : float
        Time of the motion, s.
    """
    if np.array_equal(steered.windows, windows):
        return steered
    last = max((change.since for change in steered.changes), default=_LONG_AGO)
    return replace(steered, windows=windows) if time >= last + steered.windows.sum() else None
