# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The best route over the sphere of hanging shapes: from curve to curve, one for each depth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dlo_planner.inverse.solvers.continuation.following import Condition, Passing
from dlo_planner.inverse.solvers.hanging.sphere import Crossings
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.plan.continuity import largest_turn

_FARTHEST_TURN, _FARTHEST_SHIFT = 0.6, 0.3  # rad, of the length: what the grid cannot tell
_WEAK, _DEAR = 0.05, 0.1  # stability below which a shape costs more, and how much
_AHEAD = 0.05             # of the length: how far a route is looked along to smooth its rolls


@dataclass(frozen=True, eq=False)
class Route:
    """A route through K curves.

    Attributes
    ----------
    depths : ndarray, shape (K,)
        Depths in m, ascending or descending.
    grippers : ndarray, shape (K, 3, 3)
        Approximate rotations of the gripper.
    end : ndarray, shape (3, 3)
        Approximate rotation of the free end at the beginning.
    length : float
        Length of the DLO, m.
    complete : bool
        Whether it goes through all curves that were given.
    ahead : float
        Part of the length over which rolls are smoothed; 0: every roll is followed as it is.
    """

    depths: Floats
    grippers: Floats
    end: Floats
    length: float
    complete: bool
    ahead: float = _AHEAD

    def roll(self, condition: Condition, passing: Passing, depth: float, target: float) -> float:
        """Return the roll (rad) to make between two depths, m.

        It leads towards the route a little ahead, so that the grid's roughness averages out.
        """
        shape, ahead = passing.shape, self.ahead * self.length
        goal = self._gripper(target + (ahead if target >= depth else -ahead))
        away = Rotation.from_matrix(goal @ shape.gripper.rotation.T).as_rotvec()
        step = abs(target - depth)
        part = 1.0 if ahead + step == 0 else min(1.0, 2 * step / (ahead + step))
        most = 0.5 * largest_turn(step / self.length)
        return float(np.clip(part * (away @ condition.axis(shape)), -most, most))

    def _gripper(self, depth: float) -> Floats:
        if len(self.depths) == 1:
            only: Floats = self.grippers[0]
            return only
        order = slice(None, None, 1 if self.depths[0] <= self.depths[-1] else -1)
        depths, turns = self.depths[order], Rotation.from_matrix(self.grippers[order])
        between: Floats = Slerp(depths, turns)(np.clip(depth, depths[0], depths[-1])).as_matrix()
        return between


def find_route(layers: Sequence[Crossings], depths: Floats, first: Floats,
               length: float) -> Route | None:
    """Return the Route of least motion of the gripper, as deep as possible; None if none begins.

    Shapes: first (m,).
    """
    costs, origins = sweep(layers, first, length)
    if not np.isfinite(first).any():
        return None
    picks = picked(origins, int(np.argmin(costs[-1])))
    grippers = np.array([layer.grippers[k] for layer, k in zip(layers, picks, strict=False)])
    return Route(np.asarray(depths[:len(picks)]), grippers, layers[0].ends[picks[0]], length,
                 len(picks) == len(layers))


def sweep(layers: Sequence[Crossings], first: Floats,
          length: float) -> tuple[list[Floats], list[Ints]]:
    """Return costs [(m,)] of the best routes to each crossing, and their origins [(m,)].

    The lists end with the last curve that can be reached: dynamic programming (Bellman 1957).
    """
    costs, origins = [first], []
    for one, other in zip(layers, layers[1:], strict=False):
        total = costs[-1][:, None] + motion(one, other, length) + _weakness(other)
        if not len(other) or not np.isfinite(total).any():
            break
        origins.append(np.argmin(total, axis=0))
        costs.append(total.min(axis=0))
    return costs, origins


def picked(origins: list[Ints], last: int) -> list[int]:
    """Return the indices, one per curve, of the best route that ends at crossing `last`."""
    picks = [last]
    for origin in reversed(origins):
        picks.append(int(origin[picks[-1]]))
    return picks[::-1]


def motion(one: Crossings, other: Crossings, length: float) -> Floats:
    """Return the cost (m1, m2) of going from each crossing to each other one."""
    trace = one.grippers.reshape(len(one), 9) @ other.grippers.reshape(len(other), 9).T
    turn = np.arccos(np.clip(0.5 * (trace - 1), -1, 1))
    shift = np.linalg.norm(one.places[:, None] - other.places, axis=2) / length
    far = (turn > _FARTHEST_TURN) | (shift > _FARTHEST_SHIFT)
    return np.where(far, np.inf, turn**2 + shift**2)


def _weakness(crossings: Crossings) -> Floats:
    return _DEAR * np.clip(1 - crossings.stability / _WEAK, 0, 1) ** 2
