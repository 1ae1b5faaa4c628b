# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How hard a hand may pull a DLO that lies in fittings, by what these bear.

What the gripper pulls more than planned draws the DLO straight between it and the fitting next to
it. A straight DLO presses that into its seat with the pull times the sine of the angle at which it
comes up to the seat; a fitting in which it slides passes the pull on, and is pressed by what is
behind it as well, by all of it where nothing rubs. A DLO that is nearly level is never quite
straight, and a gripper above the seat draws it out: both count as a little below it, so that a hand
is stopped that pulls far harder than planned.
"""

from dataclasses import dataclass

import numpy as np

from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.route import Route, names_of
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.plan import Plan

_LEAST_STEEP = 0.02  # sine of the angle at which a DLO counts that comes up at less, or from above


@dataclass(frozen=True)
class Pull:
    """A force between gripper and DLO that was measured."""

    force: float    # N
    arrived: float  # s, steady clock


def pulls_borne(task: Task, plan: Plan) -> Floats:
    """Return (n,) from which forces of the gripper on, N, a fitting may be overloaded.

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
        beside = [shape.gripper.position]
        if shape.holds[0].is_ring:
            beside += [hold.pose.position for hold in shape.holds[1:2]]
        ways = [fitting.pose.position - place for place in beside]
        along, *behind = [way / np.linalg.norm(way) for way in ways]
        steep = float(along @ fitting.outwards) + sum(
            max(float(way @ fitting.outwards), 0.0) for way in behind)
        left = max(fitting.bears - float(shape.wrenches[0, :3] @ fitting.outwards), 0.0)
        planned = shape.gripper_wrench[:3]
        more = planned - left / max(steep, _LEAST_STEEP) * along
        most[index] = max(np.linalg.norm(planned), np.linalg.norm(more))
    return most
