# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bring the DLO into a shape that penalties describe."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from dlo_planner.errors import NotConverged
from dlo_planner.inverse.context import PlanContext
from dlo_planner.inverse.solvers.penalty_function import Penalty
from dlo_planner.inverse.solvers.search import (
    PenaltyResult,
    judged_penalties,
    least_penalty,
)
from dlo_planner.inverse.task import Task
from dlo_planner.model.checks import instance, integer
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint


@dataclass(frozen=True, eq=False, repr=False)
class Minimize(Task):
    """Minimize penalties of the shape, beginning at `start`; see `minimize_penalty`.

    Attributes
    ----------
    penalties : tuple
        One or several: values like `PositionAt`, or functions of a Shape.
    max_iterations : int
        Equilibria at most.
    """

    touches: ClassVar[bool] = True
    takes_initial: ClassVar[bool] = True

    penalties: tuple[Penalty, ...]
    max_iterations: int = 200

    if TYPE_CHECKING:  # what may be given
        def __init__(self, penalties: Penalty | Sequence[Penalty],
                     max_iterations: int = 200) -> None: ...

    def __post_init__(self) -> None:
        put(self, penalties=tuple(judged_penalties(self.penalties)),
            max_iterations=integer('max_iterations', self.max_iterations, minimum=1,
                                   maximum=1_000_000))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan of one waypoint, at the minimum of the penalty.

        Raises
        ------
        NotConverged
            The search did not converge.
        Infeasible
            It ended at a shape that breaks a demand, or hardly stands.
        """
        instance('context', context, PlanContext)
        result = self.result(context)
        hardly = result.shape.stability < context.requirements.stability  # the builder refuses it
        if not (result.converged or hardly and result.shape.converged):
            raise NotConverged(f'penalties: the search ended with a slope of {result.slope:.3g} '
                               f'after {result.iterations} iterations', result.shape)
        builder = context.builder([0.0])
        builder.add(Waypoint(result.shape))
        return builder.finished()

    def result(self, context: PlanContext) -> PenaltyResult:
        """Return the PenaltyResult, converged or not."""
        instance('context', context, PlanContext)
        return least_penalty(context.simulator, self, instance('start', context.start, Pose),
                             context.initial, context.progress, context.requirements.stability)
