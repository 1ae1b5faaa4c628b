# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a user demands of a plan: limits of the motion, and the rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, instance, number
from dlo_planner.model.value import Value, put
from dlo_planner.plan.workspace import Workspace
from dlo_planner.uncertainty.parameters import Uncertainty


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


STABILITY = 3e-4  # what is less stable moves by its length for some 0.1 mrad of the gripper


@dataclass(frozen=True, eq=False, repr=False)
class Requirements(Value):
    """The demands on every plan, and the time for its computation.

    Attributes
    ----------
    workspace : Workspace or None
        Where the gripper may be. If None, anywhere.
    limits : Limits
        Limits of the gripper's motion. Its speeds make `Plan.times`; `Trajectory` and `replay` take
        all of it.
    allow_plastic : bool
        Whether a plan may bend or twist the DLO beyond its yield limits.
    tolerance : float or None
        Largest `Plan.position_error` of a waypoint, m. If None, any. Tasks that hit their places
        exactly are not touched by it.
    deadline : float or None
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.
    stability : float
        Least `Shape.stability` of a waypoint, of every task. What is less stable hardly stands:
        its motion per turn of the gripper goes as 1 / stability, and stiffness or weight that is
        off by as large a part may let it fall. A robot that holds 1 mrad, of a DLO known to 1 %,
        wants 0.01; 0 allows whatever is stable.
    uncertainty : Uncertainty or None
        What is not known of the DLO and the robot, for `Plan.margin` and the goal of `Thread`. If
        None, that of a DLO that was weighed and bent, in a robot that is calibrated: stiffness to
        2 %, mass to 1 %, natural curvature to 0.004 / L, the gripper to 1 mrad and L / 1000.
    margin : float or None
        Least `Plan.margin` of a waypoint in a cut-out that has a size, m. If None, any.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    workspace: Workspace | None = None
    limits: Limits = field(default_factory=Limits)
    allow_plastic: bool = True
    tolerance: float | None = None
    deadline: float | None = None
    stability: float = STABILITY
    uncertainty: Uncertainty | None = None
    margin: float | None = None

    def __post_init__(self) -> None:
        instance('Requirements.workspace', self.workspace, Workspace, optional=True)
        instance('Requirements.limits', self.limits, Limits)
        flag('Requirements.allow_plastic', self.allow_plastic)
        if self.tolerance is not None:
            put(self, tolerance=number('Requirements.tolerance', self.tolerance, minimum=0))
        put(self, stability=number('Requirements.stability', self.stability, minimum=0, maximum=1))
        instance('Requirements.uncertainty', self.uncertainty, Uncertainty, optional=True)
        if self.margin is not None:
            put(self, margin=number('Requirements.margin', self.margin, unit='m'))
        if self.deadline is not None:
            put(self, deadline=number('Requirements.deadline', self.deadline, above=0))
        super().__post_init__()
