# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion begins where the gripper is, which is hardly ever exactly where the plan begins."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.execute.limiter import used
from dlo_planner.identify.blending import Change
from dlo_planner.identify.steering import Steered
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.plan.requirements import Limits
from dlo_planner.trajectory.modal_response import slowest_period
from dlo_planner.trajectory.timed_path import TimedPath

_NOTICED = 1e-3, 5e-3  # m, rad: what is less is left to the robot, as it is at every command
_LONG_AGO = -1e6       # s
_SHORT, _LONG = 0.02, 5.0  # s: windows
_EVEN = 0.1            # s
_LONGER = 1.1          # from one duration that is tried to the next


def from_where_it_is(way: TimedPath, here: Pose, shape: Shape, limits: Limits,
                     period: float) -> tuple[TimedPath | Steered, float]:
    """Return a motion that begins at a pose, and its time there, s: 0, or negative.

    The gripper goes to the beginning of the way without swinging the DLO, within the limits, and
    stands still; then it goes its way as that was proved.
    """
    first = way.poses([0.0])[0]
    turn = Rotation.from_matrix(here.rotation @ first.rotation.T).as_rotvec()
    away = np.concatenate([turn, here.position - first.position])
    if np.linalg.norm(away[3:]) <= _NOTICED[0] and np.linalg.norm(turn) <= _NOTICED[1]:
        return way, 0.0
    periods, least = _periods(way, shape), _EVEN
    while least <= _LONG:
        # a window of several periods excites the vibration no more than one of one period
        windows = np.append(periods * np.maximum(np.ceil(least / periods - 1e-9), 1), least)
        if windows.max() > _LONG:
            break
        steps = int(np.ceil(windows.sum() / period))
        begin = -steps * period
        steered = Steered(way, windows, (Change(_LONG_AGO, np.zeros(1), away[None]),
                                         Change(begin, np.zeros(1), -away[None])))
        times = begin + period * np.arange(-3, steps + 1)
        if used(steered.frames(times), limits, period) <= 1:
            return steered, begin
        least *= _LONGER
    raise Refused(Cause.NOT_AT_START, f'the gripper is {np.linalg.norm(away[3:]):.3g} m and '
                  f'{np.linalg.norm(turn):.3g} rad from where the plan begins, which it cannot '
                  f'reach calmly in {3 * _LONG:g} s within its limits of speed, acceleration and '
                  'jerk (threading.*): expected it to be nearer')


def _periods(way: TimedPath, shape: Shape) -> Floats:
    """Return (2,) the periods, s, of the DLO in a Shape that must not be excited."""
    try:
        return Steered.of(way, shape).windows[:2]
    except InvalidTask:  # modes are not defined for all shapes
        rod: Any = shape.rod  # a plan's shapes know it
        return np.repeat(np.clip(slowest_period(rod), _SHORT, _LONG), 2)


def blending_as(steered: Steered, windows: Floats, time: float) -> Steered | None:
    """Return a Steered that blends further changes in over other windows.

    None as long as one of its changes is still being blended in: the motion would leap.

    Shapes: windows (k,).
    """
    if np.array_equal(steered.windows, windows):
        return steered
    last = max((change.since for change in steered.changes), default=_LONG_AGO)
    over = last + max(steered.windows.sum(), windows.sum())
    return replace(steered, windows=windows) if time >= over else None
