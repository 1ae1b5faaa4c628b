# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Validation of a plan: a run through the direct simulator, slowly and as it is executed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlo_planner.direct.grasp import GraspedInside, Simulator, held_as
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DeadlineExceeded, Infeasible, InvalidTask
from dlo_planner.model.checks import instance, items, number, shown
from dlo_planner.model.holds import have_rings
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.rod import Surface, before, followed_by
from dlo_planner.plan.checks import (
    Margin,
    PlanChecker,
    largest_wrench,
    motion_margins,
    violated,
    wrench_margins,
)
from dlo_planner.plan.clearance import Bodies
from dlo_planner.plan.continuity import apart, passes_itself
from dlo_planner.plan.goals import DirectionAt, PositionAt
from dlo_planner.plan.path import GripperPath, held_after
from dlo_planner.plan.plan import Plan, greatest_push, means_to_touch
from dlo_planner.plan.requirements import Limits
from dlo_planner.plan.swept import violation_between
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import OnProgress, Progress, interrupted_by
from dlo_planner.trajectory.dynamic_check import (
    InMotion,
    contact_lost,
    in_motion,
    unplanned,
    watched,
)
from dlo_planner.trajectory.trajectory import Trajectory
from dlo_planner.verify.report import ValidationReport

_AS_PLANNED = 0.01  # of the length: shapes that are farther from the planned ones are others
_MAY_BE_LEFT_OUT = ('position_error', 'misalignment', 'bend_margin', 'contact_force',
                    'clearance', 'max_tracking_error', 'swing', 'arrival', 'departure',
                    'dynamic_clearance', 'dynamic_contact_force', 'dynamic_bend_margin',
                    'contact_lost', 'insertion_force', 'largest_friction', 'duration', 'step',
                    'workspace_margin', 'mode_margin')
_NOT_STATED = ('whether the DLO keeps its contact was not looked at: no friction is stated, by the '
               'obstacle or as friction= of the replay')
# of a motion that keeps the limits, and is not looked at otherwise
AT_REST_ALONE = 'it is known at rest only, its motion keeps the limits of the gripper alone'
_OF_CONTACTS = ('contact_lost', 'largest_friction')  # figures of a plan that touches an obstacle


def replay(simulator: DirectSimulator | GraspedInside, plan: Plan, *,
           obstacles: Iterable[Obstacle] = (), limits: Limits | None = None,
           tolerance: float | None = None, trajectory: Trajectory | None = None,
           workspace: Workspace | None = None, initial: Shape | None = None,
           friction: float | None = None, progress: OnProgress = None,
           deadline: float | None = None) -> ValidationReport:
    """Simulate a Plan, and return the ValidationReport.

    If a motion cannot be made calm, the report is of the motion within limits alone, not `safe`;
    neither is that of a DLO that slides through a ring or tube, which is known at rest only. A DLO
    that is not meant to touch anything is simulated as if there were no obstacles, and shown to
    stay away from them, also on the way between; only where it does not, it is simulated in
    contact.

    Parameters
    ----------
    simulator : DirectSimulator or GraspedInside
        The planner's own or a better one, of the whole DLO, wherever the plan holds it.
    plan : Plan
        The shapes of an insertion are parts of the DLO; each is held at the entrance as planned.
    obstacles : iterable of obstacle, optional
        Obstacles whose clearance is computed, besides that of sized cut-outs.
    limits : Limits, optional
        Limits of a Trajectory that is made and validated. If None, there is none.
    tolerance : float, optional
        Tolerance in m, with limits, of that Trajectory.
    trajectory : Trajectory, optional
        One of this plan that is validated instead.
    workspace : Workspace, optional
        Workspace whose margin is computed.
    initial : Shape, optional
        Shape before the first pose. If None, the natural shape is set down there or, if the plan
        begins in contact, the DLO is in the first shape of the plan.
    friction : float, optional
        Largest friction that obstacles may have: the plan and its trajectory are validated without
        friction and with this, too, and the report is of the first that is not safe. If None, with
        that of the simulator's obstacles alone; a plan that touches one without friction is then
        not `safe`, and whether it keeps its contact is not said.
    progress : callable, optional
        Called as progress(done, total) after each step of each of its runs.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, there is no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense, tolerance without limits, or a motion of more than 20000
        instants; the message names it.
    DeadlineExceeded
        The deadline is over before it is known whether the plan may be executed.
    """
    if friction is not None:
        friction = number('friction', friction, minimum=0)
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    if plan.events:
        raise InvalidTask(f'plan has {len(plan.stages)} stages, between which hands open and '
                          'close: expected one of its `stage_plans`, with its first shape as '
                          'initial')
    simulator = held_as('simulator', simulator, plan.shapes[0])
    own = _Replay(simulator, plan, items('obstacles', obstacles, OBSTACLES), limits, tolerance,
                  trajectory, workspace, initial, Progress(progress, deadline),
                  friction is not None)
    report = own.report()
    if friction is None:
        return report
    reports = [report]
    for most in (0.0, friction):
        reports.append(replace(own, simulator=simulator.with_friction(most), limits=None,
                               tolerance=None, trajectory=report.trajectory).report())
    worst = next((one for one in reports if not one.safe), report)
    return replace(worst, largest_friction=friction, not_looked_at=tuple(
        name for name in worst.not_looked_at if name != 'largest_friction'))


@dataclass(frozen=True)
class _Replay:
    """The arguments of `replay`, and its steps."""

    simulator: Simulator
    plan: Plan
    obstacles: tuple[Obstacle, ...]
    limits: Limits | None
    tolerance: float | None
    trajectory: Trajectory | None
    workspace: Workspace | None
    initial: Shape | None
    progress: Progress
    stated: bool  # the friction of all obstacles

    def __post_init__(self) -> None:
        instance('limits', self.limits, Limits, optional=True)
        instance('initial', self.initial, Shape, optional=True)
        instance('trajectory', self.trajectory, Trajectory, optional=True)
        instance('workspace', self.workspace, Workspace, optional=True)
        if self.tolerance is not None and self.limits is None:
            raise InvalidTask(f'tolerance = {shown(self.tolerance)}: expected limits with it, '
                              'within which the motion is made')

    def report(self) -> ValidationReport:
        """Return the ValidationReport."""
        plan, shapes = self.plan, self._at_rest()
        figures = _figures_at_rest(self.simulator, plan, shapes, self.obstacles)
        if self.workspace is not None:
            figures['workspace_margin'] = float(min(self.workspace.min_margin(gripper)[1]
                                                    for gripper in plan.grippers))
        trajectory, refused = self.trajectory, ''
        if have_rings(plan.shapes[0].holds):
            return self._sliding(figures, shapes)
        if trajectory is None and self.limits is not None:
            trajectory, refused = self._trajectory(self.limits, shapes[0])
            if refused:
                figures.setdefault('reason', refused)
        if trajectory is not None:
            try:
                motion = self._in_motion(trajectory, shapes[0], touched=not refused)
                figures |= _figures_in_motion(trajectory, motion, figures['contact_lost'])
                figures['reason'] = _reason(figures, motion, plan)
            except DeadlineExceeded:
                if not refused:
                    raise
        return self._judged(figures, shapes)

    def _sliding(self, figures: dict[str, Any], shapes: Sequence[Shape]) -> ValidationReport:
        """Return the report of a DLO that slides through something, which is known at rest only."""
        trajectory = self.trajectory
        if trajectory is None and self.limits is not None:
            trajectory = Trajectory(self.plan, self.limits, tolerance=np.inf)
        if trajectory is not None:
            names = ', '.join(hold.by for hold in self.plan.shapes[0].holds if hold.is_ring)
            figures |= {'trajectory': trajectory, 'tolerance': trajectory.tolerance}
            figures.setdefault('reason', f'the DLO slides through {names}: {AT_REST_ALONE}')
        return self._judged(figures, shapes)

    def _judged(self, figures: dict[str, Any], shapes: Sequence[Shape]) -> ValidationReport:
        """Return the report of figures, which names what is nan; `shapes`: at rest."""
        plan = self.plan
        if figures['contact_lost'] == 0 and not (self.stated or _all_rub(self.simulator, shapes)):
            figures['contact_lost'] = np.nan
            if figures.get('reason') == '':
                figures['reason'] = _NOT_STATED
        left_out = [name for name in _MAY_BE_LEFT_OUT if np.isnan(figures.get(name, np.nan))
                    and (name not in _OF_CONTACTS or any(shape.contacts for shape in plan.shapes))
                    and (name != 'insertion_force' or held_after(plan) is not None)]
        _, unknown = greatest_push(plan)
        if unknown:
            left_out = [*(name for name in left_out if name != 'insertion_force'),
                        f'insertion_force: {unknown}']
        return ValidationReport(**figures, not_looked_at=tuple(left_out))

    def _at_rest(self) -> Sequence[Shape]:
        """Return the shapes of the DLO that follows the plan slowly."""
        plan, simulator, initial = self.plan, self.simulator, self.initial
        if any(shape.s[-1] != simulator.rod.length for shape in plan.shapes):
            return _parts(simulator, plan, self.progress)
        if initial is None and plan.shapes[0].contacts:
            initial = plan.shapes[0]
        # a bore is no hold of the whole DLO
        holds = [shape.holds for shape in plan.shapes] if held_after(plan) is None else ()
        around = unplanned(simulator, plan)
        if around:
            free = simulator.without_obstacles()
            shapes: Sequence[Shape] = free.track(plan.grippers, self.progress.done, initial,
                                                 holds=holds)
            if self._clear(free, shapes, around):
                return shapes
        shapes = simulator.track(plan.grippers, self.progress.done, initial, holds=holds)
        return shapes

    def _clear(self, free: Simulator, shapes: Sequence[Shape],
               around: tuple[Obstacle, ...]) -> bool:
        """Whether a DLO that goes slowly through Shapes stays away from obstacles, between too."""
        surface = Surface.of(free.rod)
        if not Bodies((), around, surface, self.progress.check).least(shapes) > 0:
            return False
        demands = PlanChecker((1.0, 1.0), self.progress.silent(), obstacles=around,
                                   surface=surface, simulator=free)
        return len(shapes) < 2 or self.plan.times[-1] <= self.plan.times[0] or violation_between(
            GripperPath.of(self.plan), shapes, (), demands) is None

    def _trajectory(self, limits: Limits, first: Shape) -> tuple[Trajectory, str]:
        """Return a calm Trajectory and '', or one within limits alone and why it is not calm."""
        try:
            with interrupted_by(self.progress.check):
                return Trajectory(self.plan, limits, tolerance=self.tolerance,
                                  simulator=self.simulator, obstacles=self.obstacles,
                                  initial=first, progress=self.progress.done), ''
        except Infeasible as error:
            return Trajectory(self.plan, limits, tolerance=np.inf), str(error)

    def _in_motion(self, trajectory: Trajectory, first: Shape, *, touched: bool) -> InMotion:
        """Return InMotion of a Trajectory; one that was given knew another simulator.

        `touched`: see `in_motion`.
        """
        known, given = trajectory.motion, self.trajectory is not None
        if known is not None and not (given and (
                means_to_touch(self.plan) or watched(self.simulator, self.plan, self.obstacles))):
            return known
        motion = in_motion(self.simulator, self.plan, trajectory, first, self.obstacles,
                           self.progress, touched=touched)
        return motion if known is None else known.worse(motion)


def _all_rub(simulator: Simulator, shapes: Sequence[Shape]) -> bool:
    """Whether all obstacles of a simulator that Shapes touch have friction: somebody stated it."""
    return all(simulator.obstacles[one.obstacle].friction > 0
               for shape in shapes for one in shape.contacts)


def _figures_in_motion(trajectory: Trajectory, motion: InMotion, lost: float) -> dict[str, Any]:
    """Return the figures of a Trajectory and of its motion; `lost`: of the contacts at rest."""
    return {'trajectory': trajectory, 'tolerance': trajectory.tolerance,
            'mode_margin': trajectory.mode_margin, 'max_tracking_error': motion.position_error,
            'dynamic_bend_margin': motion.bend_margin,
            'contact_lost': float(np.fmax(lost, motion.contact_lost)),
            'dynamic_clearance': motion.clearance, 'dynamic_contact_force': motion.contact_force,
            **{name: getattr(motion, name) for name in (
                'swing', 'arrival', 'departure', 'duration', 'step')}}


def _reason(figures: Mapping[str, Any], motion: InMotion, plan: Plan) -> str:
    """Return why the motion of a Plan must not be executed, '' if it may be."""
    missed = plan.position_error.max()  # as planned: more than two cut-outs are not hit exactly
    if not figures['converged']:
        why = f": {figures['reason']}" if figures.get('reason') else ''
        return f'the DLO does not follow the poses, even slowly{why}'
    if 'reason' in figures:
        return str(figures['reason'])
    moved = {**vars(motion), 'contact_lost': figures['contact_lost']}  # at rest, too
    broken = violated((
        Margin('workspace', figures.get('workspace_margin', np.inf), 'the gripper is {over:.3g} m '
               'beyond its workspace'),
        *motion_margins(moved, missed, figures['tolerance'], means_to_touch(plan),
                         limits=plan.wrench_limits)))
    if broken is not None:
        return broken.message
    if not np.isfinite(figures['tolerance']):
        return 'its trajectory has no tolerance: vibrations were not suppressed'
    return ''


def _parts(simulator: Simulator, plan: Plan, progress: Progress) -> list[Shape]:
    """Return the shapes of an insertion, of the part outside the bore."""
    shapes: list[Shape] = []
    if isinstance(simulator, GraspedInside):
        backs, front = simulator.behind(plan.grippers), simulator.parts[1]
        for back, shape in zip(backs, plan.shapes, strict=True):
            end = before(front.rod, shape.s[-1] - simulator.at)
            on = front.with_rod(end).solve(shape.gripper, simulator.parts_of(shape)[1],
                                           holds=shape.holds)
            shapes.append(simulator.with_rod(followed_by(
                simulator.rod, simulator.at, end)).joined(back, on))
            progress.done(len(shapes), len(plan))
        return shapes
    for shape in plan.shapes:
        part = simulator.with_rod(before(simulator.rod, shape.s[-1]))
        shapes.append(part.solve(shape.gripper, shape, holds=shape.holds))
        progress.done(len(shapes), len(plan))
    return shapes


def _figures_at_rest(simulator: Simulator, plan: Plan, shapes: Sequence[Shape],
                     obstacles: Sequence[Obstacle]) -> dict[str, Any]:
    """Return the figures of the quasi-static replay."""
    errors, angles = [], []
    for shape, goals in zip(shapes, plan.goals, strict=True):
        for goal in goals:
            missed = float(np.linalg.norm(goal.residuals(shape)))
            if isinstance(goal, PositionAt):
                errors.append(missed)
            elif isinstance(goal, DirectionAt):  # the difference of two unit vectors
                angles.append(2 * np.arcsin(min(0.5 * missed, 1.0)))
    deviation = max(apart(*pair) for pair in zip(shapes, plan.shapes, strict=True))
    passed, strained = _passage(shapes), _strained(plan, shapes)
    return {
        **({'reason': passed or strained} if passed or strained else {}),
        'converged': not passed and all(shape.converged and not shape.jumped for shape in shapes)
        and bool(deviation <= _AS_PLANNED * simulator.rod.length),
        'position_error': _worst(errors), 'misalignment': _worst(angles),
        'residual': max(shape.residual for shape in shapes),
        'stability': min(shape.stability for shape in shapes),
        'bend_margin': min(shape.bend_margin for shape in shapes),
        'contact_lost': contact_lost(plan, plan.times, shapes),
        'contact_force': np.nan if held_after(plan) is not None else max(
            (contact.force for shape in shapes for contact in shape.contacts), default=0.0),
        'insertion_force': greatest_push(plan)[0],
        'clearance': Bodies(plan.sheets, obstacles, Surface.of(simulator.rod)).least(shapes),
        'deviation': deviation}


def _passage(shapes: Sequence[Shape]) -> str:
    """Return in words where a DLO that goes slowly through Shapes passes through itself, or ''."""
    for k, shape in enumerate(shapes):
        if shape.passed_itself is True or k > 0 and shapes[k - 1].s[-1] != shape.s[-1] and (
                passes_itself(None, shapes[k - 1], shape)):
            return f'on the way to waypoint {k} the DLO passes through itself'
    return ''


def _strained(plan: Plan, shapes: Sequence[Shape]) -> str:
    """Return in words where a grip exerts more on Shapes than a Plan allows, or ''."""
    for k, shape in enumerate(shapes):
        broken = violated(wrench_margins(plan.wrench_limits, largest_wrench(shape)))
        if broken is not None:
            return f'at waypoint {k} {broken.message}'
    return ''


def _worst(values: Iterable[float]) -> float:
    return float(max(values, default=np.nan))
