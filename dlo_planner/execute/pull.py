# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How hard a hand may pull a DLO that lies in fittings, by what these bear.

What the gripper pulls more than planned draws the DLO straight between it and the fitting next to
it, which is pressed into its seat by as much of that as the gripper stands below it. A gripper that
stands above the seat draws the DLO out: that is no matter of what the fitting `bears`.
"""

from dataclasses import dataclass

import numpy as np

from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.route import Route, names_of
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.plan import Plan

_LEAST_STEEP = 0.02  # rad: what is led more nearly level counts as that, as it bends a little


@dataclass(frozen=True)
class Pull:
    """A force between gripper and DLO that was measured."""

    force: float    # N
    arrived: float  # s, steady clock


def pulls_borne(task: Task, plan: Plan) -> Floats:
    """Return (n,) from which forces of the gripper on, N, a fitting may bear more than it can.

    At each waypoint of a Plan, or a stage, of a task; inf where nothing that is next to the gripper
    says what it `bears`.
    """
    most = np.full(len(plan), np.inf)
    if not isinstance(task, Route):
        return most
    fittings = dict(zip(names_of(task.fittings), task.fittings, strict=True))
    for index, shape in enumerate(plan.shapes):
        fitting = fittings.get(shape.holds[0].by) if shape.holds else None
        if fitting is None or fitting.bears is None:
            continue
        way = fitting.pose.position - shape.gripper.position
        steep = max(float(way @ fitting.outwards / np.linalg.norm(way)), _LEAST_STEEP)
        left = fitting.bears - float(shape.wrenches[0, :3] @ fitting.outwards)
        most[index] = np.linalg.norm(shape.gripper_wrench[:3]) + max(left, 0.0) / steep
    return most
