# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The requirements of a user on a plan, for every task."""

from dataclasses import dataclass, field

from dlo_planner.model.checks import flag, instance, number
from dlo_planner.model.value import Value, put
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.workspace import Workspace

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

    def __post_init__(self) -> None:
        instance('Requirements.workspace', self.workspace, Workspace, optional=True)
        instance('Requirements.limits', self.limits, Limits)
        flag('Requirements.allow_plastic', self.allow_plastic)
        if self.tolerance is not None:
            put(self, tolerance=number('Requirements.tolerance', self.tolerance, minimum=0))
        put(self, stability=number('Requirements.stability', self.stability, minimum=0, maximum=1))
        if self.deadline is not None:
            put(self, deadline=number('Requirements.deadline', self.deadline, above=0))
        super().__post_init__()
