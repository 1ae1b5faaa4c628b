# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The context in which a task is solved: the DLO, its present state, the demands on its plan."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.requirements import Requirements
from dlo_planner.progress import Progress

_FASTEST = 1e6   # lengths of the DLO and rad per s: times of a plan have to differ


@dataclass(frozen=True)
class PlanContext:
    """The argument of a task's `solve`.

    Attributes
    ----------
    given : DirectSimulator
        DirectSimulator of the DLO, which may yield; its obstacles count.
    simulator : DirectSimulator
        The same, elastic: plans are made with it.
    start : Pose or None
        Pose of the gripper now. If None, not known.
    initial : Shape or None
        Shape of the DLO now. If None, not known.
    requirements : Requirements
    touching : bool
        Whether the plan means to touch the obstacles, which it avoids otherwise.
    progress : Progress
        Takes reports, and raises DeadlineExceeded when the deadline is over.
    """

    given: DirectSimulator
    simulator: DirectSimulator
    start: Pose | None = None
    initial: Shape | None = None
    requirements: Requirements = field(default_factory=Requirements)
    touching: bool = False
    progress: Progress = field(default_factory=Progress)

    @property
    def rod(self) -> Rod:
        """The DLO."""
        return self.simulator.rod

    @cached_property
    def without_obstacles(self) -> DirectSimulator:
        """The simulator without obstacles; of the DLO as `initial` leaves it, if there is one."""
        free = self.simulator.without_obstacles()
        if self.initial is None:
            return free
        left = self.given.left_by(self.initial)
        if self.initial.far_end is not None:
            raise InvalidTask('initial is held at its far end: expected a Shape whose far end is '
                              'free, as it is in the plan')
        return free if left is self.given else left.elastic().without_obstacles()

    @cached_property
    def demands(self) -> PlanRequirements:
        """The requirements as a PlanBuilder judges them, for this DLO and this computation."""
        required, rod = self.requirements, self.simulator.rod
        speeds = (checked_speed('linear_speed', required.limits.linear_speed, rod.length),
                  checked_speed('angular_speed', required.limits.angular_speed))
        touched = self.touching
        return PlanRequirements(
            speeds, self.progress, required.workspace, () if touched else self.simulator.obstacles,
            Surface.of(rod), None if required.allow_plastic else _yield_limits(self.given.rod),
            None if touched else self.simulator.without_obstacles(), required.tolerance,
            required.stability)

    def builder(self, depths: ArrayLike) -> PlanBuilder:
        """Return a PlanBuilder: it takes one Waypoint per depth, in order, and judges each.

        Parameters
        ----------
        depths : array_like, shape (n,)
            Depths in m that have gone through a cut-out; zeros where there is none.
        """
        return PlanBuilder(depths, self.demands)


def checked_speed(name: str, value: object, length: float = 1.0) -> float:
    """Return a speed (m/s or rad/s) that plans can be timed with; length: of the DLO, m."""
    return number(name, value, above=0, maximum=_FASTEST * length)


def _yield_limits(rod: Rod) -> Floats | None:
    """Return the strains (3,) at which a Rod yields, 1/m; None: it does not."""
    if not rod.yields:
        return None
    torsion = rod.yield_torsion or np.inf
    bending: Any = rod.yield_curvature or (np.inf, np.inf)  # a pair, whatever was given
    return np.array([torsion, *bending])
