# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The free end laid tangentially on a line, alone or with the last part of the DLO.

Each frame of the free end has one equilibrium (`inverse.equilibria`), so the end and its tangent
can be exactly on the line. A longer part is bent by its weight: its tangents are along the line as
nearly as they can be, in the mean square. Where on the line the end lies does not change the shape.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.continuation import Aligned, Step
from dlo_planner.inverse.equilibria import Candidate, start_candidates
from dlo_planner.inverse.route import first_feasible
from dlo_planner.inverse.task import MOST, PlanContext, Task
from dlo_planner.inverse.waypoint_newton import goal_shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number, row
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.goal_rows import DIRECTION, POSITION, ROLL, GoalTable
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

_TANGENTS = 9        # of the part, evenly: as `KeepTangent`
_PLACES = 5          # of it that a plan says
_FREE = 1e-3         # weight of the roll, which decides only what is left free
_REACH = 1.0         # rad, and of the length: how far from the aligned end the gripper may go
_TOLERANCE = 1e-3    # of the length


@dataclass(frozen=True, eq=False, repr=False)
class LayOnLine(Task):
    """Lay the free end of a hanging DLO tangentially on a line, in space or on a plane.

    Nothing is touched: a line on a plane that is an obstacle has to be as far above it as the DLO
    is thick. The gripper comes to the first waypoint by `MoveTo`, for instance.

    Attributes
    ----------
    line : Pose
        A point of the line; its x axis is the direction in which the DLO ends.
    length : float
        The last part of the DLO that lies along the line, m: its end is on the line, its tangents
        deviate from it by the least mean square. If 0, the end and its tangent alone, exactly.
    positions : ndarray, shape (n,)
        Where on the line the end lies, m from the point in that direction, waypoint by waypoint.
    tolerance : float or None
        Largest distance of that part from its place on the line, m. If None, 0.001 of the DLO's
        length.
    angle_tolerance : float
        Largest angle between the DLO and the line there, rad.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    takes_initial: ClassVar[bool] = True

    line: Pose
    length: float = 0.0
    positions: Floats = (0.0,)  # type: ignore[assignment]  # an array from then on
    tolerance: float | None = None
    angle_tolerance: float = 0.05

    if TYPE_CHECKING:  # what may be given
        def __init__(self, line: Pose, length: float = 0.0, positions: ArrayLike = (0.0,),
                     tolerance: float | None = None, angle_tolerance: float = 0.05) -> None: ...

    def __post_init__(self) -> None:
        instance('line', self.line, Pose)
        put(self, length=number('length', self.length, minimum=0),
            positions=row('positions', self.positions, most=MOST),
            angle_tolerance=number('angle_tolerance', self.angle_tolerance, above=0))
        if self.tolerance is not None:
            put(self, tolerance=number('tolerance', self.tolerance, above=0))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan; the roll of the DLO is the first one that keeps all demands."""
        instance('context', context, PlanContext)
        simulator = context.without_obstacles
        if self.length > simulator.rod.length:
            raise InvalidTask(f'length = {self.length:g}: expected at most the DLO\'s, '
                              f'{simulator.rod.length:g} m')
        most = _TOLERANCE * simulator.rod.length if self.tolerance is None else self.tolerance
        if context.requirements.tolerance is not None:
            most = min(most, context.requirements.tolerance)
        demands = replace(context.demands.made_with(simulator), tolerance=most,
                          angle_tolerance=self.angle_tolerance)
        return first_feasible(
            partial(self._plan, simulator, begin, demands, context.initial)
            for begin in start_candidates(simulator, self.line.direction, context.start))

    def _plan(self, simulator: DirectSimulator, begin: Candidate, demands: PlanChecker,
              initial: Shape | None) -> Plan:
        builder = PlanBuilder(np.zeros(self.positions.size), demands, initial=initial)
        builder.check()
        branch = Aligned(simulator, self.line.direction)
        point = branch.from_guess(begin.shape, begin.depth, begin.reference)
        if point is not None and self.length:
            shape = self._nearest(simulator, point.shape)
            point = None if shape is None else point._replace(shape=shape)
        refusal = branch.refusal(builder, None, Step(point, begin.depth))
        if refusal is not None or point is None:
            assert refusal is not None  # else there is one
            raise refusal
        for position in self.positions:
            builder.add(self._waypoint(point.shape, position))
        return builder.finished()

    def _nearest(self, simulator: DirectSimulator, shape: Shape) -> Shape | None:
        """Return the Shape whose last part is the nearest to the line, near one that ends there."""
        whole, rotation = simulator.rod.length, np.array(shape.gripper.rotation)
        kinds = np.array([POSITION, *[DIRECTION] * _TANGENTS, ROLL])
        goals = GoalTable(
            kinds, np.array([whole, *np.linspace(whole - self.length, whole, _TANGENTS), 0.0]),
            np.vstack([shape.positions[-1], np.tile(self.line.direction, (_TANGENTS, 1)),
                       rotation[:, 0]]), np.tile(rotation, (kinds.size, 1, 1)),
            np.array([1 / whole, *[_TANGENTS**-0.5] * _TANGENTS, _FREE]))
        found = goal_shape(simulator, shape, goals, goals.s, origin=shape.gripper.position,
                           reach=(_REACH, _REACH * whole))
        return found and found.shape

    def _waypoint(self, shape: Shape, position: float) -> Waypoint:
        whole, direction = float(shape.s[-1]), self.line.direction
        end = self.line.position + position * direction
        waypoint = waypoint_at(carried(shape, end - shape.positions[-1]), end, whole, direction)
        for before in np.linspace(0, self.length, _PLACES)[1:] if self.length else ():
            waypoint = waypoint.with_via_point(end - before * direction, whole - before, direction)
        return waypoint
