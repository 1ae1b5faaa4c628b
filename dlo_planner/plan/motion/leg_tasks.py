# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The legs of a motion with what is known of the DLO on each: as it is given, and otherwise stiff.

A wrong stiffness changes more than frequencies: the DLO hangs otherwise, and the same way of the
gripper excites its vibrations otherwise. So its modes are looked at as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.varying import scaled
from dlo_planner.plan.leg import Leg
from dlo_planner.plan.motion.calm import LegTask
from dlo_planner.plan.motion.leg_response import Response
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.passing import held_after, holes_passed
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import Plan

_ELEMENTS = 32   # of the DLO whose modes are looked at
_WRONG = (0.9, 1.1)  # factors of the stiffness with which a DLO is calm, too


def leg_tasks(simulator: DirectSimulator, plan: Plan, path: GripperPath, limits: Limits,
              first: Shape, check: Callable[[], None]) -> list[LegTask | None]:
    """Return a LegTask for each leg of a path; None for a dwell, or where modes are not known.

    Parameters
    ----------
    simulator : DirectSimulator
    plan : Plan
    path : GripperPath
    limits : Limits
    first : Shape
        Shape at the beginning, at rest.
    check : callable
        Called before each shape on a leg; it may raise.
    """
    quick, bore = _quick(simulator), held_after(plan)
    wrong = [_Wrong(quick, factor) for factor in _WRONG]
    shape: Shape | None = None
    tasks: list[LegTask | None] = []
    for leg in path.legs:
        check()
        # what a bore holds vibrates quickly outside, and little
        if leg.still or bore is not None and leg.knots[-1] > plan.times[bore]:
            tasks.append(None)
            continue
        try:
            shape = shape or quick.solve(first.gripper, first)
            response = Response.of(quick, leg, shape, check=check)
        except InvalidTask:  # a shape without modes: neutral, or in contact with friction
            return [None] * len(path.legs)
        shape = response.shapes[-1]
        tasks.append(LegTask(leg, response, limits, holes_passed(plan, response.parameters),
                             leg is path.legs[-1],
                             tuple(one.on(response, leg, check) for one in wrong)))
    return tasks


@dataclass
class _Wrong:
    """A DLO whose stiffness is wrong, leg by leg.

    Parameters
    ----------
    quick : DirectSimulator
        DirectSimulator of the DLO as it is given.
    factor : float
        Factor of its stiffness.
    """

    quick: DirectSimulator
    factor: float

    def __post_init__(self) -> None:
        rod = self.quick.rod
        self._simulator = self.quick.with_rod(replace(
            rod, bending_stiffness=scaled(rod.bending_stiffness, self.factor),
            torsional_stiffness=scaled(rod.torsional_stiffness, self.factor)))
        self._shape: Shape | None = None

    def on(self, response: Response, leg: Leg, check: Callable[[], None]) -> Response:
        """Return the Response on a leg, where that of the DLO as it is given is `response`.

        Where such a DLO falls or has no modes, the same with other frequencies.
        """
        begin = response.shapes[0]
        try:
            if self._shape is None:
                self._shape = self._simulator.solve(begin.gripper, begin)
            wrong = Response.of(self._simulator, leg, self._shape, response.parameters,
                                check)
            if all(shape.converged and not shape.jumped for shape in wrong.shapes):
                self._shape = wrong.shapes[-1]
                return wrong
        except InvalidTask:
            pass
        self._shape = None
        return response.faster(np.sqrt(self.factor))


def _quick(simulator: DirectSimulator) -> DirectSimulator:
    """Return a DirectSimulator of the same DLO on a fixed, coarse mesh, for its modes."""
    around = simulator.surroundings
    return DirectSimulator(around.rod, n_elements=_ELEMENTS, basis='local', gravity=around.gravity,
                           load=around.load, point_loads=around.point_loads,
                           obstacles=around.obstacles)
