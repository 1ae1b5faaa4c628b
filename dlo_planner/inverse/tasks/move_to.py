# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From pose to pose: the DLO goes along, its far end free or held.

Nothing is sought: between two poses the gripper goes straight, turning evenly, and the plan is
refused where the DLO would leap, touch something, bend too sharply or pull too hard.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from dlo_planner.direct.statics import between
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.continuation import Follower, GivenPoses, Passing, continue_family
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.model.checks import instance, items, number, shown
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint

_LONGEST = 0.1        # of the length, and
SHARPEST = 0.15       # rad: between two waypoints


def interpolated(one: Pose, other: Pose, length: float) -> list[Pose]:
    """Return Poses from `one`, which is left out, to `other`; none where they are the same."""
    shift = np.linalg.norm(other.position - one.position)
    turn = angle_between(one.rotation, other.rotation)
    parts = int(np.ceil(max(float(shift) / (_LONGEST * length), turn / SHARPEST) - 1e-9))
    return [between(one, other, k / parts) for k in range(1, parts + 1)]


@dataclass(frozen=True, eq=False, repr=False)
class MoveTo(Task):
    """Move the gripper from `start` through poses, one straight motion after the other.

    The plan is refused where the DLO would fall into another shape, touch an obstacle, bend more
    than `Rod.max_bend_curvature`, or where a grip bears more than is allowed. The motion of a DLO
    whose far end is held is checked at rest, not simulated in time: `Trajectory` refuses it.

    Attributes
    ----------
    poses : tuple of Pose
        Where the gripper goes, in this order; it stops at each. One or more.
    far_end : FarEnd or None
        What holds the far end, all the time. If None, it is free.
    max_force : float or None
        Largest force that the gripper, and what holds the far end, may exert, N. If None, any.
    max_moment : float or None
        The same for the moment, N m.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    takes_initial: ClassVar[bool] = True

    poses: tuple[Pose, ...]
    far_end: FarEnd | None = None
    max_force: float | None = None
    max_moment: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, poses: Iterable[Pose], far_end: FarEnd | None = None,
                     max_force: float | None = None, max_moment: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, poses=items('poses', self.poses, Pose, least=1))
        instance('far_end', self.far_end, FarEnd, optional=True)
        for name in ('max_force', 'max_moment'):
            if getattr(self, name) is not None:
                put(self, **{name: number(name, getattr(self, name), above=0)})
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan from `start` to the last pose."""
        instance('context', context, PlanContext)
        start, initial = instance('start', context.start, Pose), context.initial
        if initial is not None and initial.far_end != self.far_end:
            raise InvalidTask(f'initial = {initial!r}: expected a Shape whose far end is held as '
                              'far_end says')
        if initial is not None and len(initial.holds) > (self.far_end is not None):
            raise InvalidTask(f'initial is held by {shown(initial.holds)}: expected a Shape that '
                              'nothing holds inside, which no plan is made for')
        simulator = context.simulator.without_obstacles()
        poses, stops = [start], list[int]()
        for pose in self.poses:
            poses += interpolated(poses[-1], pose, simulator.rod.length)
            stops.append(len(poses) - 1)
        family = GivenPoses(simulator, poses, self.far_end)
        demands = replace(context.demands, wrench_limits=(self.max_force, self.max_moment))
        builder = PlanBuilder(np.zeros(len(poses)), demands, stops=stops[:-1])

        def waypoint(passing: Passing) -> Waypoint:
            return Waypoint(passing.shape)

        continue_family(builder, Follower(family, family.first(initial), 0.0,
                                          np.arange(len(poses), dtype=float)), waypoint)
        return builder.finished()
