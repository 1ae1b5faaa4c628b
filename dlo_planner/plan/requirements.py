# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a user requires of a plan, whatever its task."""

from dataclasses import dataclass, field

from dlo_planner.model.checks import flag, instance, number
from dlo_planner.model.value import Value, put
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.workspace import Workspace


@dataclass(frozen=True, eq=False, repr=False)
class Requirements(Value):
    """What every plan has to keep, and how long it may be computed.

    Attributes:
        workspace: where the gripper may be; None: anywhere
        limits: of the gripper's motion. Its speeds make `Plan.times`; `Trajectory` and `replay`
            take all of it
        allow_plastic: whether a plan may bend or twist the DLO beyond its yield limits
        tolerance: largest `Plan.position_error` of a waypoint, m; None: any. Tasks that hit their
            places exactly are not touched by it
        deadline: s of computing after which DeadlineExceeded is raised; None: no limit

    Raises:
        InvalidTask: an argument makes no sense; the message names it
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
        for name, limit in (('tolerance', {'minimum': 0}), ('deadline', {'above': 0})):
            if getattr(self, name) is not None:
                put(self, **{name: number(f'Requirements.{name}', getattr(self, name), **limit)})
        super().__post_init__()
