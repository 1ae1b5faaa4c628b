# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Thread the free end through one cut-out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import Infeasible
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.threading.one_cutout import (
    NO_WAY,
    certificate,
    thread,
    trim_to_clearance,
)
from dlo_planner.inverse.solvers.threading.through_depths import Threading
from dlo_planner.inverse.task import Task, depths_on, depths_or_none
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, flag, instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import put
from dlo_planner.plan.builder import kept_between
from dlo_planner.plan.plan import Plan

_HALVINGS = 6  # of the depth between the last waypoint that is reached and the next one


def deepest(planned: Callable[[Floats], Plan], depths: Floats) -> Plan:
    """Return the Plan of the depths that can be reached, and of the deepest one found.

    Its `fraction` is the deepest depth as a part of the last requested one.

    Shapes: depths (n,).
    """
    try:
        return planned(depths)
    except Infeasible as error:
        count = 0 if error.plan is None else len(error.plan)
        if not count:
            raise
    good, bad, plan = depths[:count], depths[count], None
    for _ in range(_HALVINGS):
        tried = np.append(good, 0.5 * (good[-1] + bad))
        try:
            plan, good = planned(tried), tried
        except Infeasible:
            bad = tried[-1]
    plan = planned(good) if plan is None else plan
    return replace(plan, fraction=float(good[-1] / depths[-1]))


@dataclass(frozen=True, eq=False, repr=False)
class Thread(Task):
    """Thread through one cut-out; `InverseSimulator.thread` says what the attributes mean.

    Attributes
    ----------
    cutout : CutOut
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through, m. If None, chosen by the solver.
    method : str
        'coupled' or 'nested'.
    gripper_clearance : float or None
        Distance in m that the gripper keeps from the sheet. If None, any.
    as_deep_as_possible : bool
        Whether the plan may end before the last depth.
    """

    takes_initial: ClassVar[bool] = True

    cutout: CutOut
    depths: Floats | None = None
    method: str = 'coupled'
    gripper_clearance: float | None = None
    as_deep_as_possible: bool = False

    if TYPE_CHECKING:  # what may be given
        def __init__(self, cutout: CutOut, depths: ArrayLike | None = None,
                     method: str = 'coupled', gripper_clearance: float | None = None,
                     as_deep_as_possible: bool = False) -> None: ...

    def __post_init__(self) -> None:
        instance('cutout', self.cutout, CutOut)
        if self.gripper_clearance is not None:
            put(self, gripper_clearance=number('gripper_clearance', self.gripper_clearance,
                                               minimum=0))
        choice('method', self.method, ('coupled', 'nested'))
        flag('as_deep_as_possible', self.as_deep_as_possible)
        put(self, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        depths, demands = depths_on(context.rod.length, self.depths), context.demands

        def planned(depths: Floats) -> Plan:
            try:
                return thread(context.without_obstacles, Threading(
                    self.cutout, depths, context.start, context.initial, demands, self.method))
            except Infeasible as error:
                if error.constraint in NO_WAY:
                    error.prove = partial(certificate, context.without_obstacles, self.cutout,
                                          depths)
                raise

        plan = deepest(planned, depths) if self.as_deep_as_possible else planned(depths)
        if self.gripper_clearance is None:
            return plan
        kept = trim_to_clearance(plan, self.cutout, self.gripper_clearance, self.depths is None)
        return kept if len(kept) == len(plan) else kept_between(kept, demands)
