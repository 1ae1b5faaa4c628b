# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The base of tasks, and the context in which one is solved."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.plain_tasks import from_plain, to_plain
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number, row, shown
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod, Surface
from dlo_planner.model.value import Value
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.plan import Plan
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
        if self.initial.holds:
            raise InvalidTask(f'initial is held by {shown(self.initial.holds)}: expected a Shape '
                              'that the gripper alone holds, as it is in the plan')
        return free if left is self.given else left.elastic().without_obstacles()

    @cached_property
    def demands(self) -> PlanChecker:
        """The requirements as a PlanBuilder judges them, for this DLO and this computation."""
        required, rod = self.requirements, self.simulator.rod
        speeds = (checked_speed('linear_speed', required.limits.linear_speed, rod.length),
                  checked_speed('angular_speed', required.limits.angular_speed))
        around, touched = self.simulator.obstacles, self.touching
        return PlanChecker(
            speeds, self.progress, required.workspace, () if touched else around,
            around if touched else (), Surface.of(rod), tolerance=required.tolerance,
            stability=required.stability, uncertainty=required.uncertainty,
            margin=required.margin,
            yield_limits=_yield_limits(self.given.rod), allow_plastic=required.allow_plastic,
            simulator=None if touched else self.simulator.without_obstacles())

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


_WAYPOINTS = 40
_DEEPEST = 0.95  # of the length, where no depths are given
MOST = 10_000    # waypoints of a plan, or forces


class Task(Value, ABC):
    """Base of all tasks: `@dataclass(frozen=True, eq=False, repr=False)` with two methods.

    `__post_init__` checks the attributes, once, and ends with `super().__post_init__()`; `solve`
    returns the Plan. Such a task can be planned, pickled, compared, and written as plain Python
    or YAML; a user's own class as well.

    Attributes
    ----------
    touches : ClassVar
        Whether plans of the class mean to touch the simulator's obstacles; if not, they avoid them.
    takes_initial : ClassVar
        Whether plans of the class depend on the present shape, `initial`.
    takes_held : ClassVar
        Whether plans of the class may begin with a DLO that more than the gripper holds, as
        `initial` says then.
    threads : ClassVar
        Whether the DLO passes its `passed` cut-outs freely, begun at a standoff before the first.
    hangs_after : ClassVar
        Whether the DLO hangs freely when it is done, as before.
    deepest : ClassVar
        Largest depth, of the length, where the task has `depths` that may be left open; None: it
        has none.
    grasps_inside : ClassVar
        Whether a parameter may say that the gripper holds the DLO inside (`hold_at`).
    replanned : ClassVar
        Attributes that are others where the task is planned again on the way, at other depths.
    """

    touches: ClassVar[bool] = False
    takes_initial: ClassVar[bool] = False
    takes_held: ClassVar[bool] = False
    threads: ClassVar[bool] = False
    hangs_after: ClassVar[bool] = True
    deepest: ClassVar[float | None] = None
    grasps_inside: ClassVar[bool] = False
    replanned: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    @property
    def passed(self) -> tuple[CutOut, ...]:
        """The cut-outs that the DLO passes, in their order, or the bore that it goes into."""
        one = getattr(self, 'cutout', None) or getattr(self, 'bore', None)
        return () if one is None else (one,)

    @property
    def held_inside(self) -> float | None:
        """Where the gripper holds the DLO inside, m from its beginning; None: at its beginning."""
        return None

    @property
    def outwards(self) -> Floats | None:
        """(3,) away from an obstacle that the DLO is led straight onto; None: it is not."""
        return None

    @abstractmethod
    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan.

        Raises
        ------
        InvalidTask
            The task makes no sense for this DLO; the message names the argument.
        Infeasible
            There is no such plan; carries the part of it that there is.
        """

    def to_dict(self) -> dict[str, Any]:
        """Return the task as dicts, lists, numbers and strings, for JSON and YAML.

        Each value in it is a dict with the name of its class under 'type'; a Pose is
        {'position', 'quaternion'}.

        Raises
        ------
        InvalidTask
            The task holds a function, which cannot be written.
        """
        content: dict[str, Any] = to_plain(self)
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> 'Task':
        """Return the task that `to_dict` wrote; its class has to be imported.

        Raises
        ------
        InvalidTask
            The content does not describe a task; the message says what is missing.
        """
        task = from_plain('content', instance('content', content, Mapping))
        if not isinstance(task, cls):
            raise InvalidTask(f'content = {shown(content)}: expected a {cls.__name__}')
        return task


def depths_or_none(name: str, depths: object) -> Floats | None:
    """Return depths (n,), m, which must not decrease; or None, for the default of `depths_on`."""
    if depths is None:
        return None
    depths = row(name, depths, most=MOST, minimum=0)
    if (np.diff(depths) < 0).any():
        bad = int(np.argmax(np.diff(depths) < 0)) + 1
        raise InvalidTask(f'{name}[{bad}] = {depths[bad]}: expected not less than the one before')
    return depths


def depths_on(length: float, depths: Floats | None) -> Floats:
    """Return the depths (n,) of a task, m, on a DLO of this length; None: 40 of them to 0.95 L."""
    if depths is None:
        return np.linspace(0, _DEEPEST * length, _WAYPOINTS)
    return row('depths', depths, most=MOST, minimum=0, maximum=length)
