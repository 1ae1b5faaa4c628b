# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The hole a DLO is threaded through."""

from __future__ import annotations

from dataclasses import dataclass

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put


@dataclass(frozen=True, eq=False, repr=False)
class CutOut(Value):
    """A round or rectangular hole in a thin sheet; without a size, only a center and a normal.

    Attributes
    ----------
    pose : Pose
        Frame with its origin in the center P_goal (m), and its x axis along the normal n_goal, the
        direction in which the free end travels.
    radius : float or None
        Radius of a round hole, m; None if rectangular or unspecified.
    width : float or None
        Width along the pose's y axis, m; None if round or unspecified.
    height : float or None
        Height along the pose's z axis, m; None if round or unspecified.

    Raises
    ------
    InvalidTask
        Sizes contradict each other or are not positive.
    """

    pose: Pose
    radius: float | None = None
    width: float | None = None
    height: float | None = None

    def __post_init__(self) -> None:
        instance('CutOut.pose', self.pose, Pose)
        if self.radius is not None and (self.width is not None or self.height is not None):
            raise InvalidTask(
                f'CutOut.radius = {shown(self.radius)}: expected radius (round) or width and '
                'height (rectangular), not both')
        if (self.width is None) != (self.height is None):
            raise InvalidTask(f'CutOut.width = {shown(self.width)}, CutOut.height = '
                              f'{shown(self.height)}: expected both width and height, or '
                              'neither')
        for name in ('radius', 'width', 'height'):
            if getattr(self, name) is not None:
                put(self, **{name: number(f'CutOut.{name}', getattr(self, name), above=0,
                                       unit='m')})
        super().__post_init__()

    @property
    def center(self) -> Floats:
        """Center (3,) P_goal, m, world frame."""
        return self.pose.position

    @property
    def normal(self) -> Floats:
        """Normal (3,) n_goal, a unit vector, world frame."""
        return self.pose.direction
