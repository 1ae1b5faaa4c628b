# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Thread the free end through two cut-outs."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.threading.two_cutouts import thread_two
from dlo_planner.inverse.task import Task, depths_on, depths_or_none
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan


@dataclass(frozen=True, eq=False, repr=False)
class ThreadTwo(Task):
    """Thread through two cut-outs, whose centers count; see `InverseSimulator.thread_two`.

    Attributes
    ----------
    first : CutOut
        The one that is passed first.
    second : CutOut
        The one that is passed after it.
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through the first one, m, or None.
    """

    first: CutOut
    second: CutOut
    depths: Floats | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, first: CutOut, second: CutOut,
                     depths: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('first', self.first, CutOut)
        instance('second', self.second, CutOut)
        put(self, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan."""
        instance('context', context, PlanContext)
        return thread_two(context.without_obstacles, self.first, self.second,
                          depths_on(context.rod.length, self.depths), context.start,
                          context.demands)
