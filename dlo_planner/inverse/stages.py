# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What tasks of a DLO share that more than the gripper holds: its beginning, reach, and stages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dlo_planner.direct.grips import Grips
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.task import PlanContext
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.holds import Holds, alike, spans_of, unreached
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.plan import Plan, PlanStatus, in_stages

_SAME = 1e-6  # m, of 1 m or of the length, and rad: holds that are nearer are one


def held_as_said(initial: Shape | None, holds: Holds) -> None:
    """Raise InvalidTask unless `initial`, if there is one, is held where these Holds are."""
    if initial is None:
        return
    if not alike(initial.holds, holds) or any(
            np.abs(one.pose.matrix - other.pose.matrix).max() > _SAME * max(1.0, initial.s[-1])
            for one, other in zip(initial.holds, holds, strict=True)):
        raise InvalidTask(f'initial is held by {shown(initial.holds)}: expected a Shape that is '
                          f'held as the task says, {shown(holds)}')


def held_at_first(context: PlanContext, stated: Holds) -> Holds:
    """Return what holds the DLO at the beginning: as stated, else as the `initial` Shape says.

    Raises InvalidTask where both do, and differ.
    """
    if context.initial is None:
        return stated
    if stated:
        held_as_said(context.initial, stated)
    return context.initial.holds


def check_reach(context: PlanContext, demands: PlanChecker, grips: Grips, where: str) -> None:
    """Raise Infeasible where neighbors are out of reach of each other; `where`: in words."""
    length = context.rod.length
    loaded = bool(np.any(context.simulator.surroundings.gravity))
    said = unreached(grips.holds, grips.gripper, length, loaded)
    if said:
        missing = max(span.distance - span.length for span in spans_of(
            grips.holds, grips.gripper, length))
        raise Infeasible(f'{where} would be too short: {said}', 0, 'equilibrium',
                         max(missing, 0.0), PlanBuilder([0.0], demands).partial())


def upwards(gravity: Floats) -> Floats:
    """Return the direction (3,) against gravity (3,); z where there is none."""
    size = float(np.linalg.norm(gravity))
    return -np.asarray(gravity) / size if size > 0 else np.array([0.0, 0.0, 1.0])


def again(error: Infeasible, words: str) -> Infeasible:
    """Return the same refusal with some words before it, the amount said once."""
    return Infeasible(words + str(error).rpartition(' (')[0], error.waypoint, error.constraint,
                      error.amount, error.plan, error.unit)


class Stages:
    """The stages of a plan so far, one after the other; `speeds`: m/s and rad/s."""

    def __init__(self, speeds: tuple[float, float]) -> None:
        self.plans, self._names, self._speeds = list[Plan](), list[str](), speeds

    def add(self, name: str, plan: Plan) -> Shape:
        """Add a stage; return its end."""
        self.plans.append(plan)
        self._names.append(name)
        return plan.shapes[-1]

    def cut(self, kept: int) -> None:
        """Forget all stages but the first ones."""
        del self.plans[kept:], self._names[kept:]

    def plan(self, make: Callable[[], object], done: Callable[[Plan], float]) -> Plan:
        """Return the Plan of all stages that `make` adds.

        What it refuses carries all stages until then: `done` is which part of the task they are.
        """
        try:
            make()
        except Infeasible as error:
            raise self._with_evidence(error, done) from None
        return in_stages(self.plans, self._names, self._speeds)

    def _with_evidence(self, error: Infeasible, done: Callable[[Plan], float]) -> Infeasible:
        if not self.plans:
            return error
        plans, names, refused = list(self.plans), list(self._names), error.plan
        held = bool(self.plans[-1].shapes[-1].holds)
        if refused is not None and len(refused) and bool(refused.shapes[0].holds) >= held:
            plans.append(refused)
            names.append('refused')
        whole = in_stages(plans, names, self._speeds)
        error.waypoint += sum(map(len, self.plans))
        error.plan = replace(whole, status=PlanStatus.PARTIAL, fraction=done(whole))
        return error
