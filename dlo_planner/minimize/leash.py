# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a DLO may change on the way to the next minimum before the search is given up.

Nor may it fall off a saddle: then it is no continuation of what it was. A step of the gripper that
is too long for the shape to follow is made again in parts; most of the work of finding that out
would be the way down to a shape that is not wanted.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.ritz.matrix3 import put_matrix, times, times_transposed
from dlo_planner.ritz.record import Record


class Leash(Record):
    """What a descent may not leave.

    Attributes
    ----------
    nodes : ndarray of int, shape (k,)
        Which are looked at; empty: it may go anywhere.
    frames : ndarray, shape (k, 3, 3)
        Their frames before, in the gripper as it is now.
    most : float
        By how much any of them may turn, rad.
    """

    nodes: Ints
    frames: Floats
    most: float


@kernel
def no_leash() -> Leash:
    """Return a Leash that lets a descent go anywhere."""
    return Leash(np.empty(0, dtype=np.int64), np.empty((0, 3, 3)), np.inf)


@kernel
def leash_on(frames, before, base, nodes, most):
    """Return the Leash of a DLO that hung in another gripper.

    Args:
        frames: (N + 1, 3, 3) of it there, read-only; before: (3, 3) of that gripper, read-only
        base: (3, 3) of the gripper as it is now, read-only
        nodes: (k,) which are looked at
        most: rad
    """
    carried = times_transposed(_of(base), _of(before))
    turned = np.empty((nodes.size, 3, 3))
    for k in range(nodes.size):
        put_matrix(times(carried, _of(frames[nodes[k]])), turned[k])
    return Leash(nodes, turned, most)


@kernel
def _of(m):
    """Return the tuple of a read-only array (3, 3)."""
    return m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2]


@kernel
def largest_turn_between(frames: Floats, others: Floats, base: Floats, other_base: Floats,
                         nodes: Ints) -> float:
    """Return the largest rotation in rad, in the gripper, of a DLO's nodes between two shapes.

    Args:
        frames, others: (N + 1, 3, 3), read-only, of the nodes in both
        base, other_base: (3, 3), read-only, of the grippers
        nodes: (k,) which are looked at
    """
    leash = leash_on(frames, base, other_base, nodes, np.inf)
    least = 3.0
    for k in range(nodes.size):
        least = min(least, _trace(others[nodes[k]], leash.frames[k]))
    return _angle(least)


@kernel
def _trace(a, b):
    """Return the trace of a b^T."""
    total = 0.0
    for i in range(3):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return total


@kernel
def _angle(trace):
    """Return the angle in rad of a rotation with a trace."""
    return np.arccos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))


@kernel
def left(leash, rotations):
    """Whether a DLO with frames `rotations` (N + 1, 3, 3) has left its Leash."""
    if leash.nodes.size == 0 or leash.most > np.pi:
        return False
    least = 1.0 + 2.0 * np.cos(leash.most)
    for k in range(leash.nodes.size):
        frame, total = rotations[leash.nodes[k]], 0.0
        for i in range(3):
            for j in range(3):
                total += frame[i, j] * leash.frames[k, i, j]
        if total < least:
            return True
    return False
