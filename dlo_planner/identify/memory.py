# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The looks that an estimate remembers: those from the last poses, and older ones linearized."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

_POSES = 3        # of the gripper, whose looks are remembered
_LOOKS = 32       # remembered at each of them


@dataclass(frozen=True, eq=False)
class Group:
    """Looks at one pose of the gripper, oldest first.

    Attributes
    ----------
    gripper : Pose
        Pose as commanded.
    looks : tuple of (ndarray, ndarray or None)
        Of each look: (points (m, 3), arc lengths from the gripper (m,) or None).
    shape : Shape
        Shape from which the next search begins.
    noise : float
        Noise in m, see `Observer`, of these looks.
    sway : float
        Sway in m, see `Observer`, of these looks.
    """

    gripper: Pose
    looks: tuple[tuple[Floats, Floats | None], ...]
    shape: Shape
    noise: float
    sway: float

    def takes(self, other: Group) -> bool:
        """Return whether looks of another Group can be added to this one."""
        return (self.gripper, self.noise, self.sway) == (other.gripper, other.noise, other.sway)

    def stacked(self) -> Iterator[tuple[Floats, np.ndarray | None]]:
        """Yield points (m, 3) and arc lengths (m,) or None, look by look only if they sway."""
        if self.sway:
            yield from self.looks
            return
        for known in (True, False):
            some = [look for look in self.looks if (look[1] is not None) == known]
            if some:
                points, s = zip(*some, strict=True)
                yield np.concatenate(points), np.concatenate(s) if known else None


@dataclass(frozen=True, eq=False)
class Memory:
    """The information in an estimate; the state x in standard deviations of the prior.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Mean of the prior and of forgotten looks.
    matrix : ndarray, shape (n, n)
        Their information matrix.
    groups : tuple of Group
        The looks that are remembered, oldest first.
    """

    x: Floats
    matrix: Floats
    groups: tuple[Group, ...]

    def with_linear(self, rows: Floats, right: Floats) -> Memory:
        """Return the Memory with k measurements of unit variance: rows (k, n) @ x = right (k,)."""
        matrix = self.matrix + rows.T @ rows
        return replace(self, matrix=matrix,
                       x=solved(matrix, self.matrix @ self.x + rows.T @ right))

    def with_look(self, new: Group) -> tuple[Memory, Group | None]:
        """Return the Memory with a Group of one new look, and the Group to be forgotten or None.

        Looks at the same pose, with the same noise and sway, are joined in one Group.
        """
        old = self.groups
        if old and old[-1].takes(new):
            last = replace(old[-1], looks=(*old[-1].looks, *new.looks), shape=new.shape)
            if len(last.looks) <= _LOOKS:
                return replace(self, groups=(*old[:-1], last)), None
            half = _LOOKS // 2
            first = replace(last, looks=last.looks[:half])
            return replace(self, groups=(*old[:-1], replace(last, looks=last.looks[half:]))), first
        groups = (*old, new)
        if len(groups) <= _POSES:
            return replace(self, groups=groups), None
        return replace(self, groups=groups[1:]), groups[0]


def solved(matrix: Floats, right: Floats) -> Floats:
    """Return x (n,) with matrix (n, n) @ x = right (n,)."""
    return cast(Floats, np.linalg.solve(matrix, right))
