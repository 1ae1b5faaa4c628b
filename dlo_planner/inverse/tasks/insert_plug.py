# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plug in the hand, its cable trailing to where it is held: led straight into its socket.

The plug is part of the hand, so that the cable alone is solved for, held at the plug's rear; what
the hand has to give at the plug's front is known at each waypoint. Nothing is sought: the way is
straight, and the plan is refused where it is not free.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.grips import Grips
from dlo_planner.inverse.stages import check_reach, held_at_first
from dlo_planner.inverse.task import PlanContext, Task, depths_or_none
from dlo_planner.inverse.tasks.move_to import led, limit, straight
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, number, row
from dlo_planner.model.holds import FarEnd, Hold, holds_of
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import put
from dlo_planner.plan.plan import Plan

_DEEP = 0.5      # of the plug's length: how deep it goes where that is not said
_WAYPOINTS = 6   # in the socket then
_SAME = 1e-9     # of the length, and rad: a start that is nearer to the approach is there


@dataclass(frozen=True, eq=False, repr=False)
class InsertPlug(Task):
    """Insert a plug into a socket, straight along its axis; the hand holds the plug.

    The gripper goes straight from `start` to where the plug's front is `approach` before the
    entrance, stops there, and then along the axis. If there is no `start`, the plan begins at the
    approach. `Plan.plug_wrenches` tells what the hand has to give at the plug's front at each
    waypoint, of cable and weight: what a controller of forces feeds forward, or subtracts of what
    it feels. The socket's own forces are not in it.

    The plug counts as a body beside the simulator's obstacles and those that the workspace keeps
    out, at waypoints and all along the way; obstacles that stand for the socket have to leave it a
    hole. Of the hand the workspace's `gripper_radius` counts alone, and the cable may touch the
    plug unseen.

    Attributes
    ----------
    socket : Pose
        Origin in the middle of the entrance, x axis the direction of insertion. The plug's frame is
        turned about it as the socket's.
    plug : Plug
        What the hand holds.
    depths : ndarray, shape (n,), or None
        How far the front goes beyond the entrance, m, one waypoint each, not decreasing; less than
        the plug is long, whose rest the hand holds. If None, 6 to half of that length.
    approach : float
        How far before the entrance the front is led onto the axis, m.
    far_end : FarEnd or None
        What holds the cable's far end. If None, `holds` or `initial` say it.
    holds : tuple of Hold
        What else holds the cable, standing still.
    max_force : float or None
        Largest force that the hand, and what else holds the cable, may exert on it, N. If None,
        any. The plug's weight is not in it.
    max_moment : float or None
        The same for the moment, N m.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    takes_initial: ClassVar[bool] = True
    takes_held: ClassVar[bool] = True

    socket: Pose
    plug: Plug
    depths: Floats | None = None
    approach: float = 0.1
    far_end: FarEnd | None = None
    holds: tuple[Hold, ...] = ()
    max_force: float | None = None
    max_moment: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, socket: Pose, plug: Plug, depths: ArrayLike | None = None,
                     approach: float = 0.1, far_end: FarEnd | None = None,
                     holds: Iterable[Hold] = (), max_force: float | None = None,
                     max_moment: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        instance('socket', self.socket, Pose)
        instance('plug', self.plug, Plug)
        put(self, depths=depths_or_none('depths', self.depths))
        if self.depths is not None:
            row('depths', self.depths, maximum=self.plug.length)
        instance('far_end', self.far_end, FarEnd, optional=True)
        put(self, approach=number('approach', self.approach, above=0),
            holds=items('holds', self.holds, Hold), max_force=limit('max_force', self.max_force),
            max_moment=limit('max_moment', self.max_moment))
        super().__post_init__()

    def gripper_at(self, depth: float) -> Pose:
        """Return the Pose of the gripper at which the front is `depth` m beyond the entrance."""
        front = self.socket.position + number('depth', depth) * self.socket.rotation[:, 0]
        return Pose(front, self.socket.quaternion).compose(self.plug.grasp)

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan to the last depth."""
        instance('context', context, PlanContext)
        length, before = context.rod.length, self.gripper_at(-self.approach)
        start = before if context.start is None else context.start
        holds = held_at_first(context, holds_of(self.far_end, self.holds, length))
        demands = replace(context.demands, wrench_limits=(self.max_force, self.max_moment),
                          plug=self.plug)
        depths = np.linspace(0, _DEEP * self.plug.length, _WAYPOINTS) if (
            self.depths is None) else self.depths
        for place, depth in (('before the socket', -self.approach),
                             ('in the socket', float(depths[-1]))):
            check_reach(context, demands, Grips(self.gripper_at(depth), holds),
                        f'{place} the cable')
        grips = [Grips(start, holds)]
        if np.abs(start.matrix - before.matrix).max() > _SAME * max(1.0, length):
            grips += straight(grips[0], Grips(before, holds), length)
        stop = len(grips) - 1
        for depth in (0.0, *depths[depths > 0].tolist()):
            grips += straight(grips[-1], Grips(self.gripper_at(depth), holds), length)
        plan = led(context, grips, demands, [stop] if stop else [], context.initial)
        return replace(plan, starts=self._stages(plan), plug=self.plug, plug_wrenches=np.array([
            self.plug.wrench(shape.gripper, shape.gripper_wrench,
                             context.simulator.surroundings.gravity) for shape in plan.shapes]))

    def _stages(self, plan: Plan) -> tuple[tuple[str, int], ...]:
        """Return the stages: the way there, and in the socket from the entrance on."""
        beyond = [(self.plug.front(pose).position - self.socket.position)
                  @ self.socket.rotation[:, 0] for pose in plan.grippers]
        outside = [k for k, depth in enumerate(beyond) if depth < -_SAME]
        entrance = outside[-1] + 1 if outside else 0
        if 0 < entrance < len(plan):
            return ('approach', 0), ('insert', entrance)
        return (('insert', 0),)
