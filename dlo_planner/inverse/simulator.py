# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The inverse simulator: from a task to gripper poses."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from dlo_planner.direct.grasp import GraspedInside, grasped_at
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.task import PlanContext, Task, checked_speed
from dlo_planner.inverse.tasks.approach import Approach
from dlo_planner.inverse.tasks.contact import HoldContact, SlideContact
from dlo_planner.inverse.tasks.insert import Insert
from dlo_planner.inverse.tasks.minimize import Minimize, Penalty, PenaltyResult
from dlo_planner.inverse.tasks.thread import Thread
from dlo_planner.inverse.tasks.thread_sequence import ThreadSequence
from dlo_planner.inverse.tasks.thread_two import ThreadTwo
from dlo_planner.model.checks import flag, instance, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.builder import kept_between
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.requirements import Requirements
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import OnProgress, Progress, interrupted_by


class InverseSimulator(Value):
    """Finds the gripper poses that make the DLO's shape do a task.

    `plan` takes any task; the methods are shorthands for most tasks of this package, which say what
    their arguments mean. These all of them have:

        start           Pose of the gripper before
        linear_speed    m/s, and angular_speed, rad/s: limits for the plan's times
        progress        called as progress(done, total) after each waypoint
        deadline        seconds of computing, after which DeadlineExceeded is raised; None: no limit

    A waypoint is refused if it leaves the workspace, touches an obstacle against the task, bends
    more sharply than `Rod.max_bend_curvature`, lies in itself, hardly stands
    (`Requirements.stability`), or yields although it must not: `Infeasible` names the waypoint, the
    constraint and the amount, and carries the plan up to it. Workspace and contacts are checked
    between waypoints as well, on the path of `Trajectory`; the waypoint is then the next one. The
    DLO is not checked between the waypoints of contact tasks and of `insert`, whose shapes are
    parts of it. If a task leaves a choice, it is made so that these demands are kept. An argument
    that makes no sense raises InvalidTask, which names it.

    Parameters
    ----------
    simulator : DirectSimulator
        Its rod, gravity, discretization and permanent set are used. The contact tasks touch its
        obstacles, the others avoid them. A Sheet among them with the hole of a cut-out is the
        sheet around this cut-out.
    workspace : Workspace, optional
        Where the gripper may be. If None, anywhere.
    allow_plastic : bool, optional
        Whether a plan may bend the DLO beyond its yield limits. Planning itself is elastic: where
        `Plan.yields`, `replay` with `simulator` shows what the DLO does.
    """

    _PARTS = ('simulator', 'requirements', '_given')

    simulator: DirectSimulator
    requirements: Requirements
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
             requirements: Requirements | None = None, progress: OnProgress = None,
             deadline: float | None = None) -> Plan:
        """Return the Plan of a task; the other methods are shorthands of this one.

        Parameters
        ----------
        task : Task
            Any of the package, as `Thread` or `LayOnLine`, or one of your own.
        start : Pose, optional
            Pose of the gripper now. If None, the plan begins at the best pose.
        initial : Shape, optional
            Shape of the DLO now, for tasks with `takes_initial`.
        requirements : Requirements, optional
            Demands on the plan. If None, those of this simulator.
        progress : callable, optional
            Called as progress(done, total) after each waypoint.
        deadline : float, optional
            Seconds of computing after which DeadlineExceeded is raised. If None, those of the
            requirements.

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
            The deadline is over.
        """
        instance('task', task, Task)
        instance('requirements', requirements, Requirements, optional=True)
        demanded = requirements or self.requirements
        if deadline is not None:
            demanded = replace(demanded, deadline=number('deadline', deadline, above=0))
        context = self._context(task, start, initial, demanded, progress)
        with interrupted_by(context.progress.check):
            return task.solve(context)

    def thread(self, cutout: CutOut, *, start: Pose | None = None, initial: Shape | None = None,
               depths: ArrayLike | None = None, method: str = 'coupled',
               gripper_clearance: float | None = None, as_deep_as_possible: bool = False,
               max_misalignment: float | None = None, hold_at: float | None = None,
               linear_speed: float = 0.1, angular_speed: float = 0.5, progress: OnProgress = None,
               deadline: float | None = None) -> Plan:
        """Plan the threading through one cut-out, anywhere and in any direction in 3-D.

        At each depth the DLO passes the center P_goal, along the normal n_goal (paper, section
        5.2) where that leaves half of the room in the hole as `Plan.margin`. One rotation of the
        gripper is free then (a round straight DLO may roll): the first waypoint turns as little as
        possible from `start`, each other one from the one before (about the mean of the gripper's
        axis and the normal it does not turn at all).

        A DLO that is soft for its weight hardly stands so, or not at all. It passes obliquely where
        that leaves more margin, by a tenth of the room at least: at each depth in the direction
        that leaves the most, among all shapes that it can come to from the one that hangs straight
        down. `Plan.misalignment` is the angle against the normal, `Plan.via_points` have the
        direction.

        Parameters
        ----------
        cutout : CutOut
        start : Pose, optional
            Pose of the gripper before, for its roll. If None, as upright as it can be.
        initial : Shape, optional
            Shape of the DLO before, with a free far end; the DLO has to get from it into the first
            shape of the plan. Its permanent set counts. If None, the DLO is set down there in its
            natural shape.
        depths : array_like, shape (n,), optional
            Arc lengths that have gone through, m, not decreasing, in [0, L]; None: 40 of them from
            0 to 0.95 L.
        method : str, optional
            'coupled' solves equilibrium and alignment as one Newton system; 'nested' is the paper's
            minimization of c arccos(t . n)^2 around the direct simulation.
        gripper_clearance : float, optional
            Distance in m that the gripper's origin has to keep from the sheet. If no depths are
            given, the plan ends at this distance.
        as_deep_as_possible : bool, optional
            If not all depths can be reached, the plan ends with the deepest one found, and
            `Plan.fraction` says how deep that is.
        max_misalignment : float, optional
            Largest angle against the normal at which the DLO may pass, rad. With 0 it passes along
            the normal, or the task is refused. If None, any. A cut-out without a size is passed
            along its normal.
        hold_at : float, optional
            Where the gripper holds the DLO, m from its beginning, less than its length. The part in
            front of the gripper is threaded, depths are of its free end and at most its length. The
            part behind hangs from the gripper: it has to keep clear of the sheet, of obstacles and
            of the part in front, at the waypoints and between, and it chooses nothing. If None or
            0, at its beginning.

        Raises
        ------
        InvalidTask, Infeasible
            Infeasible where a waypoint has no stable solution, or the gripper comes too near.
        """
        task = Thread(cutout, depths, method, gripper_clearance, as_deep_as_possible,
                      max_misalignment, hold_at)
        return self._shorthand(task, start, initial, linear_speed, angular_speed, progress,
                               deadline)

    def insert(self, bore: CutOut, *, start: Pose | None = None, depths: ArrayLike | None = None,
               friction: float | None = None, hold_at: float | None = None,
               max_misalignment: float | None = None,
               linear_speed: float = 0.1, angular_speed: float = 0.5, progress: OnProgress = None,
               deadline: float | None = None) -> Plan:
        """Plan the insertion into a bore of about the DLO's diameter (paper, section 5.2).

        The walls carry what is inside; what is outside transmits neither force nor moment to the
        entrance. Where the DLO is naturally bent, the bore still has to keep the part inside
        straight: `Plan.bore_moment`. Where a point mass or the tip's mass comes to the entrance,
        the plan stays at that depth for some waypoints, in which the entrance takes over its
        weight. A uniform DLO's gripper travels along the curve of its first shape (Zheng et al.
        1991).

        Parameters
        ----------
        bore : CutOut
            Its center is that of the entrance, its normal points inwards; its radius, where stated,
            is that of the bore.
        depths : array_like, optional
            As for `thread`, less than the length.
        friction : float, optional
            Coulomb's coefficient in the bore. With it and the bore's radius the force is estimated
            that pushes the DLO in (`Plan.insertion_force`). If None, it is not known.
        hold_at : float, optional
            Where the gripper holds the DLO, m from its beginning, as for `thread`: what is in front
            of the gripper is inserted, depths are of its free end. Such a plan is not simulated in
            motion. If None or 0, at its beginning.
        max_misalignment : float, optional
            Largest angle against the bore, rad, at which a DLO that is too soft to go in along it
            may hang into a bore that is wide for its depth, touching nothing. 0: along the bore
            only. If None, any.

        Returns
        -------
        Plan
            It may have more waypoints than `depths`. Its shapes, and their stability, are of the
            part outside, held at the entrance. `Shape.far_wrench` is what the entrance exerts on
            that part: zero, except where it takes over a mass. Of a DLO that goes in obliquely they
            are of the whole, which nothing holds but the gripper.

        Raises
        ------
        InvalidTask, Infeasible
            Infeasible where a waypoint has no stable solution, or the gripper would have to jump to
            it.
        """
        return self._shorthand(Insert(bore, depths, friction, hold_at, max_misalignment), start,
                               None, linear_speed, angular_speed, progress, deadline)

    def approach(self, cutout: CutOut, plan: Plan, start: Pose, *,
                 standoff: float | None = None, initial: Shape | None = None,
                 linear_speed: float = 0.1, angular_speed: float = 0.5,
                 tolerance: float | None = None, progress: OnProgress = None,
                 deadline: float | None = None) -> Plan:
        """Plan the motion from the gripper's present pose to where a threading begins.

        The gripper backs off along the normal, turns where the DLO cannot reach the sheet (by way
        of another direction where the DLO would fall), and comes straight to where the free end is
        `standoff` before the hole, aligned, and then in it.

        Parameters
        ----------
        cutout : CutOut
        plan : Plan
            Plan of its threading.
        start : Pose
            Pose of the gripper now, the DLO behind the sheet.
        standoff : float, optional
            Distance in m between the free end and the cut-out where the last straight motion
            begins. If None, of 0.05, 0.1 and 0.15 of the length the one with which the settled
            motion (`Trajectory`) of this plan and `plan` is the quickest, 0.1 if none can be made
            calm; that takes some seconds.
        initial : Shape, optional
            Shape of the DLO now, as for `thread`. If None, the one it falls into from its natural
            shape.
        tolerance : float, optional
            Tolerance of that motion, m; see `Trajectory`.
        linear_speed, angular_speed, progress, deadline : optional
            See the class. Where the deadline ends the search of a standoff, the best until then
            counts.

        Returns
        -------
        Plan
            Its `clearance` is the distance of the DLO from the sheet's plane, its last pose is the
            first of `plan`.

        Raises
        ------
        InvalidTask, Infeasible
            Infeasible where the DLO is beyond the sheet at the start, has no stable shape on the
            path, or does not come into the shape in which the plan begins.
        """
        if not len(instance('plan', plan, Plan)):
            raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
        instance('start', start, Pose)
        return self._shorthand(Approach(cutout, plan.shapes[0], standoff, plan, tolerance), start,
                               initial, linear_speed, angular_speed, progress, deadline)

    def thread_two(self, first: CutOut, second: CutOut, *, start: Pose | None = None,
                   depths: ArrayLike | None = None, linear_speed: float = 0.1,
                   angular_speed: float = 0.5, progress: OnProgress = None,
                   deadline: float | None = None) -> Plan:
        """Plan the threading through two cut-outs, whose centers count (paper, section 5.2).

        From where the free end reaches the second center, both are hit at once; before, the first
        one is passed along the direction that it then has, so that the path is continuous. A plan
        whose first depth is beyond that may begin in any shape that passes both. Where the DLO
        takes no such shape, as a soft cable mostly does not, and both cut-outs have a size, it
        passes beside the centers, within the cut-outs: both lose the same part of their room.

        Parameters
        ----------
        first, second : CutOut
            The cut-outs, in the order in which they are passed.
        depths : array_like, optional
            As for `thread`, from the first cut-out on.

        Returns
        -------
        Plan
            `position_errors` are both distances, `position_error` is the larger one,
            `misalignment` is 0.

        Raises
        ------
        InvalidTask, Infeasible
            Infeasible where a waypoint has no stable solution.
        """
        return self._shorthand(ThreadTwo(first, second, depths), start, None, linear_speed,
                               angular_speed, progress, deadline)

    def thread_sequence(self, cutouts: Iterable[CutOut], *, weights: ArrayLike | None = None,
                        start: Pose | None = None, depths: ArrayLike | None = None,
                        linear_speed: float = 0.1, angular_speed: float = 0.5,
                        progress: OnProgress = None, deadline: float | None = None) -> Plan:
        """Plan the threading through any number of cut-outs, as near to their centers as possible.

        One is passed along its normal, as by `thread`, and two at once, as by `thread_two`. More
        cannot be hit exactly: the sum of the squared weighted distances is made least, a cut-out
        counting more and more as the free end comes near.

        Parameters
        ----------
        cutouts : iterable of CutOut
            The cut-outs, in the order in which they are passed.
        weights : array_like, shape (k,), optional
            Weights of their distances. If None, as 1 / room that the DLO has in them, so that a
            wide one may be missed farther; where that leaves too little room in one, it counts
            more. All alike where one has no size.
        depths : array_like, optional
            As for `thread`, from the first cut-out on.

        Returns
        -------
        Plan
            `Plan.position_errors` says by how much each is missed.

        Raises
        ------
        InvalidTask, Infeasible
            Infeasible where a waypoint has no stable solution.
        """
        return self._shorthand(ThreadSequence(cutouts, weights, depths), start, None, linear_speed,
                               angular_speed, progress, deadline)

    def hold_contact(self, contact: Pose, s: float, *, condition: str | None = 'least_energy',
                     forces: ArrayLike | None = None, min_force: float | None = None,
                     start: Pose | None = None, linear_speed: float = 0.1,
                     angular_speed: float = 0.5, progress: OnProgress = None,
                     deadline: float | None = None) -> Plan:
        """Plan how to hold the DLO in contact with an obstacle (paper, section 5.3, Fig. 16).

        Arc length, place and direction at the contact leave the force of contact free: a family of
        gripper poses, found without a search. Its admissible parts are intervals of the force: the
        shape is stable, with the contact as a constraint, by 0.02 at least, it is in no obstacle,
        and it keeps this simulator's demands. The choice from them is the minimum to 0.1 %, and
        the direct simulation confirms it. The DLO beyond the contact has the shape that it takes
        when it is released from its natural one.

        Parameters
        ----------
        contact : Pose
            Pose on the surface of one of the simulator's obstacles: x axis = direction of the DLO,
            z axis = outward normal. A DLO that is not round lies there with the axes (t, n, b) of
            its material frame along the contact's: a strip whose width is along n lies flat.
        s : float
            Arc length of the contact, m.
        condition : str or None, optional
            Which one of the family: 'least_energy' (bending), 'least_force' (`min_force`, where
            that can be held), 'least_motion' (from `start`), 'largest_clearance' (from the other
            obstacles; without any, the least energy). If None, a motion through the interval that
            has the least energy, in order of the force, its steps below 0.12 (rad plus parts of
            the length).
        forces : array_like, shape (n,), optional
            Forces in N: only these are examined. If None, all.
        min_force : float, optional
            Least force of the contact, N: what presses less loses it where friction, or the DLO in
            motion, lifts it. If None, a tenth of weight + EI / L^2. With 0 a thousandth of that
            is enough.

        Raises
        ------
        InvalidTask
            An argument makes no sense, or the contact is not on a surface.
        Infeasible
            No force is admissible. The constraint is the demand that the best one breaks
            ('contact_force': it is below `min_force`), or 'contact': the amount is how far, in m,
            the DLO would be in an obstacle, or off the best of these shapes.
        """
        return self._shorthand(HoldContact(contact, s, condition, forces, min_force), start, None,
                               linear_speed, angular_speed, progress, deadline)

    def slide_contact(self, contact: Pose, lengths: ArrayLike, *, condition: str = 'least_motion',
                      forces: ArrayLike | None = None, min_force: float | None = None,
                      start: Pose | None = None, mode: str = 'aligned', linear_speed: float = 0.1,
                      angular_speed: float = 0.5, progress: OnProgress = None,
                      deadline: float | None = None) -> Plan:
        """Plan how to draw the DLO over an obstacle, with its direction kept (Fig. 15) or not.

        Parameters
        ----------
        contact : Pose
            As for `hold_contact`.
        lengths : array_like, shape (n,)
            Arc lengths between gripper and contact, m, one after the other.
        condition : str, optional
            As for `hold_contact`; 'least_motion' is from one waypoint to the next, the first one
            has the least energy if there is no `start`. The others choose the first waypoint; each
            further one is the local minimum that is nearest to the one before.
        forces, min_force : optional
            As for `hold_contact`.
        mode : str, optional
            'aligned': the DLO keeps its place and direction at the contact; 'straight': the gripper
            keeps its orientation and goes straight from the first waypoint towards the contact, or
            away from it (footnote 19 of the paper). Place and direction of the contact then drift:
            `Plan.misalignment` and `Plan.position_error` say by how much. `condition` and `forces`
            choose the first waypoint.

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        Infeasible
            As for `hold_contact`; or 'continuity': no admissible shapes lead from one waypoint to
            the next, the amount is the gripper's jump (rad plus parts of the length), with
            'straight' how far the DLO falls, in m. Or 'contact': how far the arc length that
            touches is from the requested one, in m.
        """
        return self._shorthand(SlideContact(contact, lengths, condition, forces, mode, min_force),
                               start, None, linear_speed, angular_speed, progress, deadline)

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

        Raises
        ------
        InvalidTask
            An argument makes no sense; the message names it.
        Infeasible
            The DLO does not follow; the waypoint is the one to which the gripper is going.
        """
        steps = Progress(progress, deadline)
        for stage in plan.stage_plans if instance('plan', plan, Plan).events else (plan,):
            kept_between(stage, self.demands(stage, steps))
        return plan

    def demands(self, plan: Plan, progress: Progress | None = None,
                requirements: Requirements | None = None) -> PlanChecker:
        """Return the demands by which a Plan is judged, which touches what it touches.

        requirements: None: those of this simulator.
        """
        touching = any(shape.contacts for shape in instance('plan', plan, Plan).shapes)
        instance('progress', progress, Progress, optional=True)
        instance('requirements', requirements, Requirements, optional=True)
        judge = PlanContext(self._given, self.simulator, touching=touching,
                            requirements=requirements or self.requirements,
                            progress=progress or Progress()).demands
        judge = replace(judge, wrench_limits=plan.wrench_limits, plug=plan.plug)
        at = grasped_at(plan.shapes[0]) if len(plan) else None
        return judge if at is None else judge.made_with(
            GraspedInside.of(self.simulator.without_obstacles(), at))

    def _shorthand(self, task: Task, start: Pose | None, initial: Shape | None,
                   linear_speed: float, angular_speed: float, progress: OnProgress,
                   deadline: float | None) -> Plan:
        limits = replace(
            self.requirements.limits,
            linear_speed=checked_speed('linear_speed', linear_speed, self.simulator.rod.length),
            angular_speed=checked_speed('angular_speed', angular_speed))
        return self.plan(task, start=start, initial=initial, progress=progress, deadline=deadline,
                         requirements=replace(self.requirements, limits=limits))

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
