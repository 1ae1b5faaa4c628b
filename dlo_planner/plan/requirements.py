# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The requirements of a user on a plan, for every task."""

from dataclasses import dataclass, field

from dlo_planner.model.checks import flag, instance, number
from dlo_planner.model.value import Value, put
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.workspace import Workspace


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

    def __post_init__(self) -> None:
        instance('Requirements.workspace', self.workspace, Workspace, optional=True)
        instance('Requirements.limits', self.limits, Limits)
        flag('Requirements.allow_plastic', self.allow_plastic)
        if self.tolerance is not None:
            put(self, tolerance=number('Requirements.tolerance', self.tolerance, minimum=0))
        if self.deadline is not None:
            put(self, deadline=number('Requirements.deadline', self.deadline, above=0))
        super().__post_init__()
