# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits of a gripper's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number
from dlo_planner.model.value import Value, put


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Value):
    """Limits of the gripper's motion, each for the length of a vector; a limit may be infinite.

    Attributes
    ----------
    linear_speed : float
        Linear speed in m/s.
    angular_speed : float
        Angular speed in rad/s.
    linear_acceleration : float
        Linear acceleration in m/s^2.
    angular_acceleration : float
        Angular acceleration in rad/s^2.
    linear_jerk : float
        Linear jerk in m/s^3.
    angular_jerk : float
        Angular jerk in rad/s^3.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    linear_speed: float = 0.1
    angular_speed: float = 0.5
    linear_acceleration: float = 0.5
    angular_acceleration: float = 2.0
    linear_jerk: float = 5.0
    angular_jerk: float = 20.0

    def __post_init__(self) -> None:
        for name, value in list(self.__dict__.items()):
            put(self, **{name: np.inf if isinstance(value, float) and value == np.inf
                         else number(f'Limits.{name}', value, above=0)})
        super().__post_init__()

    @property
    def sizes(self) -> Floats:
        """Limits (3, 2) of speed, acceleration, jerk (rows), linear and angular (columns)."""
        return np.array([[self.linear_speed, self.angular_speed],
                         [self.linear_acceleration, self.angular_acceleration],
                         [self.linear_jerk, self.angular_jerk]])
