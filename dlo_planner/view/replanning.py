# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The cut-outs and simulators with which a plan on the page can be made anew."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask, NotConverged
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan, concatenate
from dlo_planner.progress import OnProgress

_SAME = 1e-9      # m
_SECONDS = 30.0   # of computing, after which a plan is given up
_STANDOFF = 0.1  # of the length: it has to be quick
_WAYPOINTS = 60   # most of a plan that follows a hand


def cutouts_of(plan: Plan) -> list[CutOut]:
    """Return the CutOuts that a Plan passes, as far as it tells: those without a size have none."""
    if not len(plan):
        return []
    sized = [cutout for sheet, _ in plan.sheets for cutout in sheet.cutouts]
    cutouts = []
    for center, _, normal in plan.via_points[-1]:
        if normal is not None:
            cutouts.append(next(
                (cutout for cutout in sized if np.abs(cutout.center - center).max() < _SAME),
                CutOut(Pose.looking_along(center, normal))))
    return cutouts


def simulator_of(shape: Shape) -> DirectSimulator | None:
    """Return a DirectSimulator of a Shape's rod and surroundings; None if it knows none."""
    if shape.mesh is None:
        return None
    around = shape.mesh.surroundings
    return DirectSimulator(around.rod, gravity=around.gravity, load=around.load, grip=around.grip,
                           obstacles=around.obstacles, point_loads=around.point_loads)


@dataclass(frozen=True)
class Replanner:
    """Makes plans through one cut-out like a given one, and shapes of the same DLO.

    Attributes
    ----------
    direct : DirectSimulator
    inverse : InverseSimulator
    depths : ndarray, shape (n,)
        Depths in m, of the waypoints.
    """

    direct: DirectSimulator
    inverse: InverseSimulator
    depths: Floats

    @classmethod
    def of(cls, plan: Plan, inverse: InverseSimulator | None = None) -> 'Replanner':
        """Return one for a Plan."""
        if not len(plan):
            raise InvalidTask('plan: expected one with a waypoint')
        direct = simulator_of(plan.shapes[-1]) if inverse is None else inverse.simulator
        if direct is None:
            raise InvalidTask('plan: its shapes know no rod (they come from a file): expected '
                              '`inverse` to plan anew with')
        if len(cutouts_of(plan)) != 1 or plan.shapes[-1].far_end is not None:
            raise InvalidTask('plan: expected one through one cut-out where it is to be made anew')
        deepest = float(plan.depths.max())
        return cls(direct, InverseSimulator(direct) if inverse is None else inverse,
                   np.linspace(0.0, deepest, min(len(plan), _WAYPOINTS)))

    def plan(self, cutout: CutOut, gripper: Pose, whole: bool, progress: OnProgress) -> Plan:
        """Return the Plan through a CutOut."""
        options: dict[str, Any] = {'progress': progress, 'deadline': _SECONDS}
        plan = self.inverse.thread(cutout, start=gripper, depths=self.depths, **options)
        if not whole:
            return plan
        way = self.inverse.approach(cutout, plan, gripper, **options, standoff=(
            _STANDOFF * self.inverse.simulator.rod.length))
        return concatenate(way, plan)

    def shape(self, gripper: Pose, before: Shape) -> Shape:
        """Return the Shape at a gripper's Pose, coming from another Shape."""
        shape = self.direct.track([gripper], initial=before)[0]
        if not shape.converged:
            raise NotConverged(f'no stable shape found: {shape.status}', shape)
        return shape
