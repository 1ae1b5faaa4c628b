# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Rolls spread evenly over the waypoints of a plan.

Where a DLO is hardly stable, the gripper is rolled at each waypoint by itself, as little as
necessary: in jerks, each a corner of its path. The sum of these rolls is how far it has to be
rolled at each depth. A smooth curve along it (Whittaker 1923) is about the same path without
corners.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.inverse.solvers.continuation.following import Condition, Passing
from dlo_planner.model.arrays import Floats

_FIRM = (1e3, 1e2, 1e1, 1.0)  # how much smoothness counts: features of 35 to 6 waypoints go
_NO_ROLL = 1e-3               # rad between two waypoints


@dataclass(frozen=True, eq=False)
class EvenRolls:
    """How far the gripper has rolled at n depths; a route for `following.follow`.

    Attributes
    ----------
    depths : ndarray, shape (n,)
        Depths in m.
    turned : ndarray, shape (n,)
        Rotation about the free axis at each depth, rad.
    """

    depths: Floats
    turned: Floats

    def roll(self, condition: Condition, passing: Passing, depth: float, target: float) -> float:
        """Return the roll (rad) to make between two depths, m."""
        del condition, passing
        return float(np.diff(np.interp((depth, target), self.depths, self.turned))[0])


def even_rolls(condition: Condition, depths: Floats,
               passings: Sequence[Passing]) -> Iterator[EvenRolls]:
    """Yield EvenRolls, ever less smooth, along the rolls between n Passings at n depths."""
    rolls = [Rotation.from_matrix(after.shape.gripper.rotation @ before.shape.gripper.rotation.T)
             .as_rotvec() @ condition.axis(before.shape)
             for before, after in zip(passings, passings[1:], strict=False)]
    if len(rolls) < 2 or np.abs(rolls).max() < _NO_ROLL:
        return
    turned = np.append(0.0, np.cumsum(rolls))
    bends = np.diff(np.eye(turned.size), 2, axis=0)
    for firm in _FIRM:
        yield EvenRolls(depths, np.linalg.solve(np.eye(turned.size) + firm * bends.T @ bends,
                                                turned))
