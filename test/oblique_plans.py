# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan that passes a hole obliquely: of a wire that is too soft to pass it along the normal."""

from dataclasses import dataclass

import numpy as np

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod
from dlo_planner.direct.shape import carried
from dlo_planner.inverse.task import Task
from dlo_planner.plan.waypoint import Holes, waypoint_at

WIRE = Rod(0.2, 0.0174, 1.22e-4, 1.0e-4, radius=1.5e-3)  # measured: w L^3/EI = 11
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=10e-3)
DEPTHS = np.linspace(0.0, 0.08, 9)
# elevation of the gripper, rad, by depth, m: the DLO is by 0.46 to 1.01 rad oblique then
DEEP, ELEVATIONS = (0.0, 0.02, 0.04, 0.06, 0.08), (0.262, 0.744, 0.980, 1.075, 1.155)


@dataclass(frozen=True, eq=False, repr=False)
class Obliquely(Task):
    """The gripper points up, by depth, and the DLO passes the center in whatever direction."""

    cutout: CutOut
    depths: np.ndarray

    def __post_init__(self):
        super().__post_init__()

    def solve(self, context):
        """Return the Plan."""
        simulator, length = context.without_obstacles, context.rod.length
        center = self.cutout.center
        holes = Holes((self.cutout,), length, context.demands.obstacles, context.demands.surface)
        builder, shape = context.builder(self.depths), None
        for depth in self.depths:
            up = np.interp(depth, DEEP, ELEVATIONS)
            gripper = Pose.looking_along((0, 0, 0), (np.cos(up), 0, np.sin(up)))
            shape = simulator.track([gripper], initial=shape)[0]
            there = carried(shape, center - shape.frame_at(length - depth)[1])
            along = there.frame_at(length - depth)[0][:, 0]
            builder.add(holes.passed(waypoint_at(there, center, length - depth, along)._replace(
                misalignment=float(np.arccos(along @ self.cutout.normal)))))
        return builder.finished()


def oblique_plan(rod=WIRE, cutout=HOLE):
    """Return the Plan of a DLO through a hole."""
    return InverseSimulator(DirectSimulator(rod)).plan(Obliquely(cutout, DEPTHS))
