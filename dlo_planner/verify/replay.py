# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Proof with a plan: it is run through the direct simulator, slowly and as it is executed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from os import PathLike
from typing import Any

import numpy as np

from dlo_planner.deprecated import renamed_fields
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.direct.storage import load, save
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.model.checks import flag, instance, items, shown
from dlo_planner.model.computed import figure
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.part import before
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import brief, put
from dlo_planner.pictured import Reported
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.motion.in_motion import InMotion, in_motion, least_clearance, watched
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.trajectory import Trajectory
from dlo_planner.plan.passing import means_to_touch
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.workspace import Workspace
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.verify.report_storage import report_arrays, report_contents

_AS_PLANNED = 0.01  # of the length: shapes that are farther from the planned ones are others
_MAY_BE_LEFT_OUT = ('position_error', 'misalignment', 'clearance', 'max_tracking_error', 'swing',
                    'arrival', 'departure', 'dynamic_clearance', 'dynamic_contact_force',
                    'duration', 'step',
                    'workspace_margin', 'mode_margin')


@renamed_fields(miss='position_error', dynamic_miss='max_tracking_error')
@dataclass(frozen=True, eq=False, repr=False)
class Report(Reported):
    """Result of a direct simulation of a plan: worst values over all waypoints, or in motion.

    A figure that was not computed is nan, and `not_looked_at` names it.

    The figures of a motion that could not be simulated to its end are infinitely bad.

    Attributes
    ----------
    converged : bool
        Every pose has an equilibrium that continues the one before, and it is the one of the plan:
        its `deviation` is below 1 % of the length.
    miss : float
        Distance of the DLO from a center that it should pass, m.
    misalignment : float
        Angle between the DLO and a normal along which it should pass, rad.
    residual : float
        Largest residual of the shapes.
    stability : float
        Least stability of the shapes.
    bend_margin : float
        Least bend margin of the shapes, 1/m.
    contact_force : float
        Largest force of one contact with the simulator's obstacles, N.
    clearance : float
        Clearance in m to the sized cut-outs of the plan and the obstacles given.
    deviation : float
        Largest distance between the shapes found and those of the plan, m.
    dynamic_miss : float
        `InMotion.miss`, m; here and below the worse of two motions: with the rod's damping, and
        without any.
    dynamic_clearance : float
        `InMotion.clearance`, m.
    dynamic_contact_force : float
        `InMotion.contact_force`, N.
    swing : float
        `InMotion.swing`, m.
    arrival : float
        `InMotion.arrival`, m.
    departure : float
        `InMotion.departure`, m.
    duration : float
        `InMotion.duration`, s.
    step : float
        `InMotion.step`, s.
    workspace_margin : float
        Least distance of the gripper from the limits of its workspace, m.
    mode_margin : float
        See `Trajectory`.
    tolerance : float
        Tolerance in m, of `trajectory`.
    trajectory : Trajectory or None
        Trajectory that was looked at, the one to be executed. If None, there was none.
    reason : str
        Why the trajectory must not be executed; empty if it may be.
    not_looked_at : tuple of str
        Names of the figures that are nan.
    """

    converged: bool
    position_error: float
    misalignment: float
    residual: float
    stability: float
    bend_margin: float
    contact_force: float
    clearance: float
    deviation: float = np.nan
    max_tracking_error: float = np.nan
    swing: float = np.nan
    arrival: float = np.nan
    departure: float = np.nan
    dynamic_clearance: float = np.nan
    dynamic_contact_force: float = np.nan
    duration: float = np.nan
    step: float = np.nan
    workspace_margin: float = np.nan
    mode_margin: float = np.nan
    tolerance: float = np.nan
    trajectory: Trajectory | None = None
    reason: str = 'it was not looked at in motion'
    not_looked_at: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        put(self, converged=flag('Report.converged', self.converged),
            **{item.name: figure(f'Report.{item.name}', getattr(self, item.name))
               for item in fields(self) if item.type == 'float'},
            trajectory=instance('Report.trajectory', self.trajectory, Trajectory, optional=True),
            reason=instance('Report.reason', self.reason, str),
            not_looked_at=items('Report.not_looked_at', self.not_looked_at, str))

    def __repr__(self) -> str:
        said = {'position_error': 'm', 'stability': '', 'clearance': 'm', 'deviation': 'm',
                'max_tracking_error': 'm', 'swing': 'm', 'dynamic_clearance': 'm', 'duration': 's'}
        return brief(self, 'safe' if self.safe else f'not safe: {self.reason}', *(
            f'{name.replace("_", " ")} {getattr(self, name):.3g} {unit}'.rstrip()
            for name, unit in said.items() if np.isfinite(getattr(self, name))))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the report and its trajectory, as npz or JSON (see `Plan.save`)."""
        save(path, report_arrays(self), 'Report')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Report:
        """Return the Report saved at `path`.

        Raises
        ------
        InvalidTask
            Not such a file; the message names it.
        """
        result: Report = load(path, lambda arrays: cls(**report_contents(arrays)), 'Report')
        return result

    @property
    def safe(self) -> bool:
        """Whether `trajectory` may be executed: the DLO follows it calmly and touches nothing."""
        return not self.reason


def replay(simulator: DirectSimulator, plan: Plan, *, obstacles: Iterable[Obstacle] = (),
           limits: Limits | None = None, tolerance: float | None = None,
           trajectory: Trajectory | None = None, workspace: Workspace | None = None,
           initial: Shape | None = None, progress: OnProgress = None,
           deadline: float | None = None) -> Report:
    """Simulate a Plan, and return the Report.

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
            seen = in_motion(simulator, plan, trajectory, shapes[0], obstacles, steps)
            motion = seen if motion is None else motion.worse(seen)  # it knew other obstacles
        figures |= {'trajectory': trajectory, 'tolerance': trajectory.tolerance,
                    'mode_margin': trajectory.mode_margin,
                    'max_tracking_error': motion.position_error,
                    'dynamic_clearance': motion.clearance,
                    'dynamic_contact_force': motion.contact_force,
                    **{name: getattr(motion, name) for name in (
                        'swing', 'arrival', 'departure', 'duration', 'step')}}
        figures['reason'] = _reason(figures, motion, plan)
    return Report(**figures, not_looked_at=tuple(
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

