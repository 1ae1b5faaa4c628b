# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Insert the DLO into a bore."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.threading.insertion import insert
from dlo_planner.inverse.task import Task, depths_on, depths_or_none
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import put
from dlo_planner.plan.bore import insertion_force
from dlo_planner.plan.plan import Plan

_INSERTED = 0.99  # of the length, at most


@dataclass(frozen=True, eq=False, repr=False)
class Insert(Task):
    """Insert into a bore of about the DLO's diameter; see `InverseSimulator.insert`.

    Attributes
    ----------
    bore : CutOut
        Its center is that of the mouth, its normal points inwards; its radius is that of the bore.
    depths : ndarray, shape (n,) or None
        Arc lengths that are inside, m. If None, chosen by the solver.
    friction : float or None
        Coulomb's coefficient in the bore. If None, not known: `Plan.insertion_force` is nan.
    """

    bore: CutOut
    depths: Floats | None = None
    friction: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, bore: CutOut, depths: ArrayLike | None = None,
                     friction: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('bore', self.bore, CutOut)
        put(self, depths=depths_or_none('depths', self.depths))
        if self.friction is not None:
            put(self, friction=number('friction', self.friction, minimum=0))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        depths = depths_on(context.rod.length, self.depths)
        if depths[-1] > _INSERTED * context.rod.length:
            raise InvalidTask(f'depths[{len(depths) - 1}] = {depths[-1]:g}: expected at most '
                              f'{_INSERTED:g} of the length')
        if context.simulator.surroundings.point_loads:
            raise InvalidTask('simulator.point_loads: expected none for an insertion, a part of '
                              'the DLO is in the bore')
        plan = insert(context.without_obstacles, self.bore, depths, context.start, context.demands)
        return replace(plan, insertion_force=np.array([
            insertion_force(context.without_obstacles, self.bore, self.friction, depth, shape)
            for depth, shape in zip(plan.depths, plan.shapes, strict=True)]))
