# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bring the gripper from its present pose to the beginning of a threading."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import DeadlineExceeded, Infeasible, InvalidTask
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.threading.approach import approach
from dlo_planner.inverse.task import Task
from dlo_planner.model.checks import instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.assembly import concatenate
from dlo_planner.plan.motion.trajectory import quickest_plan
from dlo_planner.plan.plan import Plan

_FARTHEST = 100  # of the length: from where the gripper may come
_STANDOFFS = 0.1, 0.05, 0.15  # of the length: the first one where motion does not tell


@dataclass(frozen=True, eq=False, repr=False)
class Approach(Task):
    """Bring the free end before a cut-out and into it; see `InverseSimulator.approach`.

    Attributes
    ----------
    cutout : CutOut
    first : Shape
        Shape in which the threading begins: the first one of its Plan.
    standoff : float or None
        Distance in m between the free end and the cut-out where the last straight motion begins.
        If None, of 0.05, 0.1 and 0.15 of the length the one whose calm motion (`Trajectory`) is the
        quickest, within the requirements' limits; 0.1 if none can be made calm.
    through : Plan or None
        The threading that follows, a part of that motion. If None, the motion ends before it.
    tolerance : float or None
        Tolerance of that motion, m; see `Trajectory`.
    """

    takes_initial: ClassVar[bool] = True

    cutout: CutOut
    first: Shape
    standoff: float | None = None
    through: Plan | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        instance('cutout', self.cutout, CutOut)
        instance('first', self.first, Shape)
        instance('through', self.through, Plan, optional=True)
        if self.standoff is not None:
            put(self, standoff=number('standoff', self.standoff, minimum=0))
        if self.tolerance is not None:
            put(self, tolerance=number('tolerance', self.tolerance, above=0))
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
        if self.standoff is not None:
            number('standoff', self.standoff, maximum=farthest)
            return self._at(self.standoff, context)
        ways: list[Plan] = []
        refused: Infeasible | None = None
        for part in _STANDOFFS:
            try:
                ways.append(self._at(part * context.rod.length, context))
            except Infeasible as error:
                refused = refused or error
        if not ways:
            assert refused is not None  # of the first one
            raise refused
        return ways[self._quickest(ways, context)]

    def _at(self, standoff: float, context: PlanContext) -> Plan:
        assert context.start is not None  # judged before
        return approach(context.without_obstacles, replace(self, standoff=standoff), context.start,
                        context.initial, context.demands)

    def _quickest(self, ways: Sequence[Plan], context: PlanContext) -> int:
        """Return the index of the plan whose calm motion is the quickest, 0 if none is calm."""
        plans = [one if self.through is None else concatenate(one, self.through) for one in ways]
        try:
            return quickest_plan(plans, context.requirements.limits, self.tolerance,
                                 context.simulator, context.progress.silent())
        except (Infeasible, InvalidTask, DeadlineExceeded):  # it can be gone through all the same
            return 0
