# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The inverse simulator: from a task to gripper poses."""

from collections.abc import Sequence
from dataclasses import replace

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.shorthands import Shorthands
from dlo_planner.inverse.task import PlanContext, Task
from dlo_planner.inverse.tasks import Minimize
from dlo_planner.inverse.tasks.minimize import Penalty, PenaltyResult
from dlo_planner.model.checks import flag, instance
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import brief, put
from dlo_planner.plan.builder import kept_between
from dlo_planner.plan.checks import PlanRequirements
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.requirements import Requirements
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import OnProgress, Progress


class InverseSimulator(Shorthands):
    """Finds the gripper poses that make the DLO's shape do a task.

    A waypoint is refused if it leaves the workspace, touches an obstacle against the task, bends
    more sharply than `Rod.max_bend_curvature`, lies in itself, hardly stands
    (`Requirements.stability`), or yields although it must not: `Infeasible` names the waypoint, the
    constraint and the amount. Workspace and contacts are checked between
    waypoints as well, on the path of `Trajectory`; the waypoint is then the next one. The DLO is
    not checked between the waypoints of contact tasks and of `insert`, whose shapes are parts of
    it. If a task leaves a choice, it is made so that these demands are kept.

    Parameters
    ----------
    simulator : DirectSimulator
        Its rod, gravity, discretization and permanent set are used. The contact tasks touch its
        obstacles, the others avoid them. A Sheet among them with the hole of a cut-out is the
        sheet around this cut-out.
    workspace : Workspace, optional
        Where the gripper may be. If None, anywhere.
    allow_plastic : bool, optional
        Whether a plan may bend the DLO beyond its yield limits. Planning itself is elastic:
        `replay` with `simulator` shows the permanent set.
    """

    _PARTS = ('simulator', 'requirements', '_given')

    _given: DirectSimulator

    def __init__(self, simulator: DirectSimulator, *, workspace: Workspace | None = None,
                 allow_plastic: bool = True) -> None:
        clamping('simulator', simulator)
        instance('workspace', workspace, Workspace, optional=True)
        if simulator.method != 'newton':
            raise InvalidTask(f'simulator.method = {simulator.method!r}: expected \'newton\', '
                              'the method of all plans')
        if simulator.surroundings.has_moments:
            raise InvalidTask('simulator.point_loads: expected forces alone for a plan, dead '
                              'moments have no potential')
        put(self, _given=simulator, simulator=simulator.elastic(), requirements=Requirements(
            workspace, allow_plastic=flag('allow_plastic', allow_plastic)))

    @property
    def workspace(self) -> Workspace | None:
        """Where the gripper may be, if the requirements of a plan do not say otherwise."""
        return self.requirements.workspace

    def __repr__(self) -> str:
        return brief(self, repr(self.simulator), '' if self.workspace is None else
                     repr(self.workspace))

    def plan(self, task: Task, *, start: Pose | None = None, initial: Shape | None = None,
             requirements: Requirements | None = None, progress: OnProgress = None) -> Plan:
        """Return the Plan of a task; the other methods are shorthands of this one.

        Parameters
        ----------
        task : Task
            `Thread`, `ThreadTwo`, `ThreadSequence`, `Insert`, `Approach`, `HoldContact`,
            `SlideContact`, `Minimize`, or one of your own.
        start : Pose, optional
            Pose of the gripper now. If None, the plan begins at the best pose.
        initial : Shape, optional
            Shape of the DLO now, for tasks with `takes_initial`.
        requirements : Requirements, optional
            Demands on the plan. If None, those of this simulator.
        progress : callable, optional
            Called as progress(done, total) after each waypoint.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        Infeasible
            There is no such plan; names the constraint, the waypoint and the amount, and carries
            the plan up to it.
        NotConverged
            The search of a `Minimize` did not converge.
        DeadlineExceeded
            The deadline of the requirements is over.
        """
        instance('task', task, Task)
        instance('requirements', requirements, Requirements, optional=True)
        return self._plan(task, start, initial, requirements or self.requirements, progress)

    def minimize_penalty(self, penalties: Penalty | Sequence[Penalty], start: Pose, *,
                         initial: Shape | None = None, max_iterations: int = 200,
                         progress: OnProgress = None,
                         deadline: float | None = None) -> PenaltyResult:
        """Return the PenaltyResult of `minimize_penalty` for this simulator (paper, section 5.1).

        The function of the same name explains the arguments.

        Raises
        ------
        InvalidTask, NotConverged
            As in `plan`.
        Infeasible
            The result breaks a demand.
        """
        task = Minimize(penalties, max_iterations)
        context = self._context(task, instance('start', start, Pose), initial,
                                replace(self.requirements, deadline=deadline), progress)
        result = task.result(context)
        context.builder([0.0]).add(Waypoint(result.shape))
        return result

    def check(self, plan: Plan, *, progress: OnProgress = None,
              deadline: float | None = None) -> Plan:
        """Return a Plan if it keeps all demands between its waypoints too.

        The whole path of its `Trajectory` is checked: the gripper stays in the workspace and, if
        the plan does not mean to touch anything, the DLO stays clear of the obstacles and of the
        sheets around the cut-outs. Plans made here have been checked; a plan that was concatenated
        or truncated has another path.

        Parameters
        ----------
        plan : Plan
        progress : callable, optional
            As for `thread`.
        deadline : float, optional
            As for `thread`.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        Infeasible
            The DLO does not follow; the waypoint is the one to which the gripper is going.
        """
        return kept_between(plan, self.demands(plan, Progress(progress, deadline)))

    def demands(self, plan: Plan, progress: Progress | None = None) -> PlanRequirements:
        """Return the demands by which a Plan is judged, which touches what it touches."""
        touching = any(shape.contacts for shape in instance('plan', plan, Plan).shapes)
        instance('progress', progress, Progress, optional=True)
        return PlanContext(self._given, self.simulator, requirements=self.requirements,
                           touching=touching, progress=progress or Progress()).demands

    def _context(self, task: Task, start: Pose | None, initial: Shape | None,
                 requirements: Requirements, progress: OnProgress) -> PlanContext:
        """Return the PlanContext of a task; check the arguments that are not part of the task."""
        instance('start', start, Pose, optional=True)
        instance('initial', initial, Shape, optional=True)
        if initial is not None and not task.takes_initial:
            raise InvalidTask(f'initial = {initial!r}: expected None, the plan of a '
                              f'{type(task).__name__} does not depend on the present shape')
        return PlanContext(self._given, self.simulator, start, initial, requirements, task.touches,
                           Progress(progress, requirements.deadline))
