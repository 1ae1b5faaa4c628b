# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Joint positions along a way of the tool: one configuration is followed, none is jumped to."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.arm.robot import Arm
from dlo_planner.arm.solving import Solved, Target, centered, solve
from dlo_planner.model.arrays import Floats

_ITERATIONS = 30
_JUMP = 0.5  # rad or m that a joint may go in one step
_LIMIT_ROUNDING = 1e-9


class Lost(Exception):
    """A configuration cannot be gone on with.

    Attributes
    ----------
    words : str
        Why.
    time : float
        Time in s, where.
    constraint : str
        Short name.
    amount : float
        By how much.
    rank : (float, float) or None
        Rank of two, the larger one is nearer to a solution.
    attempt : object
        Arguments with which it can be tried again, or None.
    """

    attempt: Any = None

    def __init__(self, words: str, time: float, constraint: str, amount: float,
                 rank: tuple[float, float] | None = None) -> None:
        super().__init__(words)
        self.words, self.time, self.constraint, self.amount = words, time, constraint, amount
        self.rank = (time, 0.0) if rank is None else rank


def ways_between(targets: Sequence[Target]) -> Floats:
    """Return (n,) how far, in m and rad together, each target is from the one before; 0 first."""
    places, turns = map(np.array, zip(*targets, strict=True))
    angles = Rotation.from_matrix(turns[1:] @ turns[:-1].transpose(0, 2, 1)).magnitude()
    return np.append(0.0, np.linalg.norm(np.diff(places, axis=0), axis=1) + angles)


def followed(arm: Arm, targets: Sequence[Target], times: Floats, start: Floats, centering: float,
             check: Callable[[], object]) -> Floats:
    """Return joint positions (n, m) that place the tool at n targets, each from the one before.

    Shapes: times (n,), start (m,).
    """
    chain, out, ways = arm.chain, [start], ways_between(targets)
    for k in range(1, len(targets)):
        check()
        if not ways[k]:
            out.append(out[-1])
            continue
        begin = centered(chain, out[-1], targets[k], centering * ways[k])
        found = solve(chain, begin, targets[k], _ITERATIONS)
        if not found.reached:  # joints that are heavy near their limits may have hindered it
            found = solve(chain, out[-1], targets[k], _ITERATIONS, plain=True)
        judge_reach(found, times[k])
        moved = np.abs(found.positions - out[-1])
        if moved.max() > _JUMP:
            joint = int(np.argmax(moved))
            raise Lost(f'{arm.joints[joint]} would have to go from {out[-1][joint]:.4g} to '
                       f'{found.positions[joint]:.4g} at once: the arm is stretched or folded up '
                       'there (a singularity)', times[k], 'continuity', float(moved.max() - _JUMP))
        judge_limits(arm, found.positions, times[k])
        out.append(found.positions)
    return np.array(out)


def judge_reach(found: Solved, time: float) -> None:
    """Raise Lost unless a Solved reaches its target."""
    if not found.reached:
        left, turn = (float(np.linalg.norm(part)) for part in (found.off[:3], found.off[3:]))
        raise Lost(f'the tool cannot get there: {left:.3g} m and {turn:.3g} rad are left', time,
                   'reach', left if left > 0 else turn)


def judge_limits(arm: Arm, positions: Floats, time: float) -> None:
    """Raise Lost unless joint positions (m,) are within their limits."""
    beyond = np.maximum(positions - arm.upper, arm.lower - positions)
    joint = int(np.argmax(beyond))
    if beyond[joint] > _LIMIT_ROUNDING:
        raise Lost(f'{arm.joints[joint]} = {positions[joint]:.6g} {arm.units[joint]}: expected '
                   f'{arm.lower[joint]:.6g} to {arm.upper[joint]:.6g}', time, 'joint_limit',
                   float(beyond[joint]))


def judge_steps(arm: Arm, positions: Floats, times: Floats) -> None:
    """Raise Lost if joints (n, m) get from one time (n,) to the next only faster than they can."""
    speeds = np.abs(np.diff(positions, axis=0)) / np.diff(times)[:, None]
    step, joint = np.unravel_index(np.argmax(speeds / arm.speeds), speeds.shape)
    if speeds[step, joint] > arm.speeds[joint]:
        raise too_fast(arm, int(joint), speeds[step, joint], times[step + 1], times[-1])


def too_fast(arm: Arm, joint: int, speed: float, time: float, end: float) -> Lost:
    """Return the Lost of a joint that goes the whole way, until `end` s, but too fast."""
    most, unit = arm.speeds[joint], arm.units[joint]
    return Lost(f'{arm.joints[joint]} moves at {speed:.6g} {unit}/s: expected at most {most:.6g}; '
                f'the motion would have to be {speed / most:.4g} times slower', time,
                'joint_speed', float(speed - most), (float(end), float(most / speed)))
