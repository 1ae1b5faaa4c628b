# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bring the gripper from its present pose to the beginning of a threading."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.threading.approach import approach
from dlo_planner.inverse.task import Task
from dlo_planner.model.checks import instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan

_FARTHEST = 100  # of the length: from where the gripper may come


@dataclass(frozen=True, eq=False, repr=False)
class Approach(Task):
    """Bring the free end before a cut-out and into it; see `InverseSimulator.approach`.

    Attributes
    ----------
    cutout : CutOut
    first : Shape
        Shape in which the threading begins: the first one of its Plan.
    standoff : float
        Distance in m between the free end and the cut-out where the last straight motion
        begins.
    """

    takes_initial: ClassVar[bool] = True

    cutout: CutOut
    first: Shape
    standoff: float = 0.05

    def __post_init__(self) -> None:
        instance('cutout', self.cutout, CutOut)
        instance('first', self.first, Shape)
        put(self, standoff=number('standoff', self.standoff, minimum=0))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan from `start` to the gripper of `first`."""
        instance('context', context, PlanContext)
        start, farthest = instance('start', context.start, Pose), _FARTHEST * context.rod.length
        for name, pose in (('start', start), ('plan.grippers[0]', self.first.gripper)):
            away = np.linalg.norm(pose.position - self.cutout.center)
            if away > farthest:
                raise InvalidTask(f'{name} = {pose!r}: expected at most {farthest:g} m from the '
                                  f'cut-out, is {away:.3g} m')
        number('standoff', self.standoff, maximum=farthest)
        return approach(context.without_obstacles, self, start, context.initial, context.demands)
