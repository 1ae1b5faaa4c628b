# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a task, as the parameters `threading.*` ask for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks import (
    Approach,
    Insert,
    Thread,
    ThreadSequence,
    ThreadTwo,
    threading_of,
)
from dlo_planner.inverse.tasks.thread import trim_to_clearance
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.progress import OnProgress
from dlo_planner.settings.building import limits_of, tolerance_of

MOST_INSERTED = 0.99  # of the length, by `Insert`


@dataclass(frozen=True)
class Wanted:
    """What is asked of the way; attributes are the parameters `threading.*` of the same names.

    `limits` are all those of the motion. With a standoff below 0 it is found; a tolerance of None
    is the default one.
    """

    waypoints: int
    deepest: float
    limits: Limits
    standoff: float
    gripper_clearance: float
    tolerance: float | None = None

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> 'Wanted':
        """Return that of parameter values."""
        return cls(values['threading.waypoints'], values['threading.deepest'], limits_of(values),
                   values['threading.standoff'], values['threading.gripper_clearance'],
                   tolerance_of(values))


@dataclass(frozen=True)
class Present:
    """Where the gripper and the DLO are now; None where that is not known.

    Attributes
    ----------
    gripper : Pose or None
        Pose of the gripper.
    shape : Shape or None
        Shape of the DLO, which matters where the plan begins at the gripper's pose.
    """

    gripper: Pose | None = None
    shape: Shape | None = None


def way_through(inverse: InverseSimulator, cutouts: Sequence[CutOut], wanted: Wanted,
                present: Present = Present(), *, progress: OnProgress = None,  # noqa: B008 - frozen
                deadline: float | None = None) -> Plan:
    """Return the Plan through one, two, or more cut-outs, as `plan_task` does."""
    return plan_task(inverse, threading_of(cutouts), wanted, present, progress=progress,
                     deadline=deadline)


def plan_task(inverse: InverseSimulator, task: Task, wanted: Wanted,
              present: Present = Present(), *, miss: float | None = None,  # noqa: B008 - frozen
              progress: OnProgress = None, deadline: float | None = None) -> Plan:
    """Return the Plan of a task, where `wanted` says what the task leaves open.

    With a standoff, a threading begins at the gripper's present pose. So does a plan of one pose,
    from which there would be no motion.
    """
    start, task = present.gripper, _with_depths(task, wanted, inverse.simulator.rod.length)
    options: dict[str, Any] = {'progress': progress, 'requirements': replace(
        inverse.requirements, deadline=deadline, limits=wanted.limits, tolerance=miss)}
    threads = isinstance(task, Thread | ThreadTwo | ThreadSequence)
    before = present.shape if task.takes_initial and not threads else None
    plan = inverse.plan(task, start=start, initial=before, **options)
    if len(plan) == 1:
        first = present.shape
        if first is None and start is not None:
            first = inverse.simulator.track([start])[0]
        if first is None:
            raise InvalidTask('start = None: expected the pose of the gripper now, where a plan of '
                              f'one pose, as of this {type(task).__name__}, begins')
        plan = inverse.plan(_From(first, plan, task.touches), start=start, **options)
    elif isinstance(task, Thread | ThreadTwo | ThreadSequence):
        plan = _with_way_there(inverse, task, plan, wanted, present, options)
    if miss is not None and not plan.position_error.max() <= miss:
        worst = int(plan.position_error.argmax())
        raise Infeasible(f'waypoint {worst} misses its place by {plan.position_error[worst]:.3g} '
                         f'm: expected {miss:g} m at most', worst, 'tolerance',
                         float(plan.position_error[worst]) - miss, plan)
    return plan


def _with_depths(task: Task, wanted: Wanted, length: float) -> Task:
    """Return a task with the depths that are wanted, if it has none of its own."""
    if not isinstance(task, Thread | ThreadTwo | ThreadSequence | Insert) or (
            task.depths is not None):
        return task
    most = min(wanted.deepest, MOST_INSERTED) if isinstance(task, Insert) else wanted.deepest
    return replace(task, depths=np.linspace(0.0, most * length, wanted.waypoints))


def _with_way_there(inverse: InverseSimulator, task: Thread | ThreadTwo | ThreadSequence,
                    plan: Plan, wanted: Wanted, present: Present,
                    options: Mapping[str, Any]) -> Plan:
    """Return the plan of a threading, trimmed, and with the way to where it begins."""
    first = cutouts_of(task)[0]
    if wanted.gripper_clearance and getattr(task, 'gripper_clearance', None) is None:
        plan = inverse.check(trim_to_clearance(plan, first, wanted.gripper_clearance, True))
    if not wanted.standoff or present.gripper is None:
        return plan
    standoff = None if wanted.standoff < 0 else wanted.standoff
    way = inverse.plan(Approach(first, plan.shapes[0], standoff, plan, wanted.tolerance),
                       start=present.gripper, initial=present.shape, **options)
    return inverse.check(concatenate(way, plan))


def cutouts_of(task: Task | None) -> tuple[CutOut, ...]:
    """Return the cut-outs that the DLO passes in a task, in their order; none for other tasks."""
    if isinstance(task, ThreadTwo):
        return task.first, task.second
    if isinstance(task, ThreadSequence):
        return task.cutouts
    one = getattr(task, 'cutout', None) or getattr(task, 'bore', None)
    return () if one is None else (one,)


@dataclass(frozen=True, eq=False, repr=False)
class _From(Task):
    """Go from a Shape to the one pose of a plan, straight."""

    first: Shape
    to: Plan
    touching: bool

    @property
    def touches(self) -> bool:  # type: ignore[override]  # as those of the plan do
        """Whether the plan means to touch obstacles."""
        return self.touching

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan of two poses."""
        plan, builder = self.to, context.builder([0.0, *self.to.depths])
        builder.add(Waypoint(self.first))
        builder.add(Waypoint(plan.shapes[0], float(plan.misalignment[0]),
                             float(plan.position_error[0]), plan.via_points[0]))
        return builder.finished()
