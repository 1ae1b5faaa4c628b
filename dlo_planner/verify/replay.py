# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Proof with a plan: it is run through the direct simulator, slowly and as it is executed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.model.checks import instance, items, shown
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.part import before
from dlo_planner.model.surface import Surface
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.motion.in_motion import InMotion, in_motion, least_clearance, watched
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.trajectory import Trajectory
from dlo_planner.plan.passing import means_to_touch
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.verify.report import ValidationReport

_AS_PLANNED = 0.01  # of the length: shapes that are farther from the planned ones are others
_MAY_BE_LEFT_OUT = ('position_error', 'misalignment', 'clearance', 'max_tracking_error', 'swing',
                    'arrival', 'departure', 'dynamic_clearance', 'dynamic_contact_force',
                    'duration', 'step',
                    'workspace_margin', 'mode_margin')


def replay(simulator: DirectSimulator, plan: Plan, *, obstacles: Iterable[Obstacle] = (),
           limits: Limits | None = None, tolerance: float | None = None,
           trajectory: Trajectory | None = None, workspace: Workspace | None = None,
           initial: Shape | None = None, progress: OnProgress = None,
           deadline: float | None = None) -> ValidationReport:
    """Simulate a Plan, and return the ValidationReport.

    If a motion cannot be made calm, the report is of the motion within limits alone, not `safe`.

    Parameters
    ----------
    simulator : DirectSimulator
        DirectSimulator, the planner's own or a better one.
    plan : Plan
        Plan. The shapes of an insertion are parts of the DLO; each is held at the mouth as
        planned.
    obstacles : iterable of obstacle, optional
        Obstacles whose clearance is wanted besides the cut-outs' with a size.
    limits : Limits, optional
        Limits; a Trajectory is made within them, and looked at (None: none is).
    tolerance : float, optional
        Tolerance in m, with limits, of that Trajectory.
    trajectory : Trajectory, optional
        One of this plan that is looked at instead.
    workspace : Workspace, optional
        Workspace whose margin is wanted, or None.
    initial : Shape, optional
        Shape before the first pose. If None, the natural shape is set down there or, if the plan
        begins in contact, the DLO is in the first shape of the plan.
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
        The deadline is over.
    """
    clamping('simulator', simulator)
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    obstacles = items('obstacles', obstacles, OBSTACLES)
    instance('limits', limits, Limits, optional=True)
    instance('initial', initial, Shape, optional=True)
    instance('trajectory', trajectory, Trajectory, optional=True)
    instance('workspace', workspace, Workspace, optional=True)
    if tolerance is not None and limits is None:
        raise InvalidTask(f'tolerance = {shown(tolerance)}: expected limits with it, within which '
                          'the motion is made')
    whole = all(shape.s[-1] == simulator.rod.length for shape in plan.shapes)
    steps = Progress(progress, deadline)
    if initial is None and plan.shapes[0].contacts:
        initial = plan.shapes[0]
    shapes = simulator.track(plan.grippers, steps.done, initial) if whole else _parts(
        simulator, plan, steps)
    figures = _at_rest(simulator, plan, shapes, obstacles)
    if workspace is not None:
        figures['workspace_margin'] = float(min(workspace.min_margin(gripper)[1]
                                                for gripper in plan.grippers))
    given = trajectory is not None
    if limits is not None and not given:
        try:
            trajectory = Trajectory(plan, limits, tolerance=tolerance, simulator=simulator,
                                    initial=shapes[0], obstacles=obstacles, progress=steps.done,
                                    deadline=steps.left())
        except Infeasible as error:
            figures['reason'] = str(error)
            trajectory = Trajectory(plan, limits, tolerance=np.inf)
    if trajectory is not None:
        motion = trajectory.motion
        if motion is None or given and watched(simulator, plan, obstacles):
            simulated = in_motion(simulator, plan, trajectory, shapes[0], obstacles, steps)
            # its own motion knew other obstacles
            motion = simulated if motion is None else motion.worse(simulated)
        figures |= {'trajectory': trajectory, 'tolerance': trajectory.tolerance,
                    'mode_margin': trajectory.mode_margin,
                    'max_tracking_error': motion.position_error,
                    'dynamic_clearance': motion.clearance,
                    'dynamic_contact_force': motion.contact_force,
                    **{name: getattr(motion, name) for name in (
                        'swing', 'arrival', 'departure', 'duration', 'step')}}
        figures['reason'] = _reason(figures, motion, plan)
    return ValidationReport(**figures, not_looked_at=tuple(
        name for name in _MAY_BE_LEFT_OUT if np.isnan(figures.get(name, np.nan))))


def _reason(figures: Mapping[str, Any], motion: InMotion, plan: Plan) -> str:
    """Return why the motion of a Plan must not be executed, '' if it may be."""
    missed = plan.position_error.max()  # as planned: more than two cut-outs are not hit exactly
    if not figures['converged']:
        return 'the DLO does not follow the poses, even slowly'
    if not motion.converged:
        return 'the motion could not be simulated to its end'
    if 'reason' in figures:
        return str(figures['reason'])
    if figures.get('workspace_margin', 0.0) < 0:
        return f'the gripper is {-figures["workspace_margin"]:.3g} m beyond its workspace'
    if motion.clearance < 0:
        return f'in motion the DLO is {-motion.clearance:.3g} m in the sheet or an obstacle'
    if motion.contact_force > 0 and not means_to_touch(plan):
        return f'in motion the DLO touches something, with {motion.contact_force:.3g} N'
    if motion.position_error > missed + figures['tolerance']:
        return (f'in motion the DLO misses by {motion.position_error:.3g} m: expected at most '
                f'{missed + figures["tolerance"]:.3g} m')
    if not np.isfinite(figures['tolerance']):
        return 'its trajectory has no tolerance, nothing was made calm'
    return ''


def _parts(simulator: DirectSimulator, plan: Plan, progress: Progress) -> list[Shape]:
    """Return the shapes of an insertion, of what is outside the bore."""
    shapes = []
    for shape in plan.shapes:
        part = simulator.with_rod(before(simulator.rod, shape.s[-1]))
        shapes.append(part.solve(shape.gripper, shape, far_end=shape.far_end))
        progress.done(len(shapes), len(plan))
    return shapes


def _at_rest(simulator: DirectSimulator, plan: Plan, shapes: Sequence[Shape],
             obstacles: Sequence[Obstacle]) -> dict[str, Any]:
    """Return the figures of the quasi-static replay."""
    errors, angles = [], []
    for shape, points in zip(shapes, plan.via_points, strict=True):
        for center, s, normal in points:
            axes, position = shape.frame_at(s)
            errors.append(float(np.linalg.norm(position - center)))
            if normal is not None:
                angles.append(float(np.arctan2(np.linalg.norm(np.cross(axes[:, 0], normal)),
                                               axes[:, 0] @ normal)))
    deviation = max(apart(*pair) for pair in zip(shapes, plan.shapes, strict=True))
    return {
        'converged': all(shape.converged and not shape.jumped for shape in shapes)
        and bool(deviation <= _AS_PLANNED * simulator.rod.length),
        'position_error': _worst(errors), 'misalignment': _worst(angles),
        'residual': max(shape.residual for shape in shapes),
        'stability': min(shape.stability for shape in shapes),
        'bend_margin': min(shape.bend_margin for shape in shapes),
        'contact_force': max((contact.force for shape in shapes for contact in shape.contacts),
                             default=0.0),
        'clearance': least_clearance(plan, obstacles, Surface.of(simulator.rod), shapes),
        'deviation': deviation}


def _worst(values: Iterable[float]) -> float:
    return float(max(values, default=np.nan))
