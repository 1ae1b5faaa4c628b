# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a curve of the joints promises: the tool's place, limits, speeds, distances of links."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate._interpolate import PPoly

from dlo_planner.arm.following import judge_limits, too_fast
from dlo_planner.arm.robot import Arm
from dlo_planner.arm.solving import Target
from dlo_planner.arm.starts import judge_self_collision
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import angle_between

_SPEED_ROUNDING = 1e-9
_HALVINGS = 12   # of a step, until links are known to stay clear of each other on it
_SURE = 1.05     # times the way between samples: what joints may go back and forth


def tool_errors(arm: Arm, curve: PPoly, targets: Sequence[Target], times: Floats) -> Floats:
    """Return (n, 2) by how many m and rad the tool is off its targets at `times` (n,)."""
    out = []
    for positions, (place, turn) in zip(curve(times), targets, strict=True):
        here, axes = arm.chain.placement(positions)
        out.append((np.linalg.norm(here - place), angle_between(axes, turn)))
    return np.array(out)


def judge_curve(arm: Arm, curve: PPoly, still: Sequence[Floats], fastest: Sequence[Floats]) -> None:
    """Raise Lost unless positions and speeds keep the limits at their extremes."""
    times = np.unique(np.concatenate(still))
    for time, positions in zip(times, curve(times), strict=True):
        judge_limits(arm, positions, time)
    used = []
    for joint, times in enumerate(fastest):
        speeds = np.abs(curve(times, 1)[:, joint])
        top = int(np.argmax(speeds))
        used.append((speeds[top] / arm.speeds[joint], joint, speeds[top], times[top]))
    part, joint, speed, time = max(used)
    if part > 1 + _SPEED_ROUNDING:
        raise too_fast(arm, joint, speed, time, curve.x[-1])


def smallest_distance(arm: Arm, curve: PPoly, check: Callable[[], object]) -> float:
    """Return the smallest distance between links on the way, m, as far as there are samples.

    Between two samples of a pair's distance it is no less than half of their sum, less half of what
    the joints' way moves a link at most. A step in which that is too little is halved.
    """
    collision = arm.collision
    if not collision.pairs:
        return np.nan if collision.missing else np.inf
    spot = _Spots(arm, curve)
    least, steps = np.inf, [(*step, 0) for step in zip(curve.x, curve.x[1:], strict=False)]
    while steps:
        check()
        begin, end, halvings = steps.pop()
        middle = 0.5 * (begin + end)
        (here, one), (there, other) = spot(begin), spot(end)
        least = min(least, one, other)
        through = curve(middle)
        way = _SURE * collision.way(np.abs(through - here) + np.abs(there - through))
        if one + other - way <= 2 * arm.self_clearance and halvings < _HALVINGS:
            steps += [(middle, end, halvings + 1), (begin, middle, halvings + 1)]
    return least


class _Spots:
    """Joint positions and the smallest distance at a time, computed once."""

    def __init__(self, arm: Arm, curve: PPoly) -> None:
        self._arm, self._curve = arm, curve
        self._known: dict[float, tuple[Floats, float]] = {}

    def __call__(self, time: float) -> tuple[Floats, float]:
        if time not in self._known:
            positions = self._curve(time)
            self._known[time] = positions, judge_self_collision(self._arm, positions, time)
        return self._known[time]
