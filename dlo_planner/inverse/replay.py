"""Proof with a plan: it is run through the direct simulator, slowly and at its own pace."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.continuity import apart
from dlo_planner.inverse.in_motion import InMotion, TooLong, fastest_scale, least_clearance
from dlo_planner.inverse.limits import Limits
from dlo_planner.inverse.plan import Plan
from dlo_planner.inverse.trajectory import Trajectory
from dlo_planner.model.checks import figure, flag, instance, items, number
from dlo_planner.model.obstacles import OBSTACLES
from dlo_planner.model.part import before
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import Value, brief, put
from dlo_planner.progress import OnProgress, Progress

_AS_PLANNED = 0.01  # of the length: shapes that are farther from the planned ones are others
_MAY_BE_LEFT_OUT = ('miss', 'misalignment', 'clearance', 'dynamic_miss', 'swing',
                    'dynamic_clearance', 'duration', 'step', 'fastest')


@dataclass(frozen=True, eq=False, repr=False)
class Report(Value):
    """What the direct simulator says of a plan; worst values over all waypoints, or in motion.

    A figure that nothing was looked at for is nan, and named in `not_looked_at`.

    Attributes:
        converged: every pose has an equilibrium that continues the one before, and it is the one
            of the plan: its `deviation` is below 1 % of the length
        miss: distance of the DLO from a centre that it should pass, m
        misalignment: angle against a normal along which it should pass, rad
        residual, stability, bend_margin: of the shapes
        contact_force: largest force of one contact with the simulator's obstacles, N
        clearance: m, to the sized cut-outs of the plan and the obstacles given
        deviation: largest distance between the shapes found and those of the plan, m
        dynamic_miss: distance from the centres in motion, m, between all waypoints: of the nearest
            arc length between those of both waypoints; a centre that the free end only comes to on
            that way counts from then on
        swing: largest distance of the DLO in motion from its equilibrium in the same gripper, m
        dynamic_clearance: as `clearance`, in motion
        duration: of that motion, s; step: of its simulation, s
        fastest: shortest duration found in which `dynamic_miss` (`swing` for a plan that has no
            centres to pass) stays within the tolerance, s; infinite if there is none within 16
            times the duration, nan if finding it takes a motion of more than 20000 steps
        not_looked_at: names of the figures that are nan

    In a motion that could not be simulated to its end, the figures are infinitely bad.
    """

    converged: bool
    miss: float
    misalignment: float
    residual: float
    stability: float
    bend_margin: float
    contact_force: float
    clearance: float
    deviation: float = np.nan
    dynamic_miss: float = np.nan
    swing: float = np.nan
    dynamic_clearance: float = np.nan
    duration: float = np.nan
    step: float = np.nan
    fastest: float = np.nan
    not_looked_at: tuple[str, ...] = ()

    def __post_init__(self):
        put(self, converged=flag('Report.converged', self.converged),
            **{item.name: figure(f'Report.{item.name}', getattr(self, item.name))
               for item in fields(self)
               if item.name not in ('converged', 'not_looked_at')},
            not_looked_at=items('Report.not_looked_at', self.not_looked_at, str))

    def __repr__(self):
        said = {'miss': 'm', 'stability': '', 'clearance': 'm', 'deviation': 'm',
                'dynamic_miss': 'm', 'swing': 'm', 'duration': 's', 'fastest': 's'}
        return brief(self, 'converged' if self.converged else 'not converged', *(
            f'{name.replace("_", " ")} {getattr(self, name):.3g} {unit}'.rstrip()
            for name, unit in said.items() if np.isfinite(getattr(self, name))))


def replay(simulator: DirectSimulator, plan: Plan, *, obstacles: Iterable = (),
           limits: Limits | None = None, tolerance: float | None = None,
           initial: Shape | None = None, progress: OnProgress = None,
           deadline: float | None = None) -> Report:
    """Return the Report of a Plan.

    Args:
        simulator: DirectSimulator, the planner's own or a better one
        plan: Plan; of an insertion, whose shapes are parts of the DLO, each is held at the mouth
            as planned, and it is not run dynamically
        obstacles: whose clearance is wanted besides the cut-outs' with a size
        limits: Limits; the plan is run dynamically at the pace that they allow (None: it is not)
        tolerance: m, with limits; the fastest pace that keeps the dynamic miss within is sought
        initial: Shape before the first pose; None: the natural shape is set down there or, if the
            plan begins in contact, the DLO is in the first shape of the plan
        progress: called as progress(done, total) after each step of each of its runs
        deadline: s of computing after which DeadlineExceeded is raised; None: no limit

    Raises:
        InvalidTask: an argument makes no sense, limits with an insertion, tolerance without
            limits, or a motion of more than 20000 steps; the message names it
        DeadlineExceeded: as asked for
    """
    clamping('simulator', simulator)
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    obstacles = items('obstacles', obstacles, OBSTACLES)
    instance('limits', limits, Limits, optional=True)
    instance('initial', initial, Shape, optional=True)
    if tolerance is not None:
        tolerance = number('tolerance', tolerance, above=0)
        if limits is None:
            raise InvalidTask(f'tolerance = {tolerance!r}: expected limits with it, whose pace it '
                              'is about')
    whole = all(shape.s[-1] == simulator.rod.length for shape in plan.shapes)
    if limits is not None and not whole:
        raise InvalidTask('limits: expected None for an insertion; it is not run dynamically')
    progress = Progress(progress, deadline)
    if initial is None and plan.shapes[0].contacts:
        initial = plan.shapes[0]
    shapes = simulator.track(plan.grippers, progress.done, initial) if whole else _parts(
        simulator, plan, progress)
    figures = _at_rest(simulator, plan, shapes, obstacles)
    if limits is not None:
        figures |= _in_motion(InMotion(simulator, plan, Trajectory(plan, limits), shapes[0],
                                       obstacles, progress), tolerance)
    return Report(**figures, not_looked_at=tuple(
        name for name in _MAY_BE_LEFT_OUT if np.isnan(figures.get(name, np.nan))))


def _parts(simulator, plan, progress):
    """Return the shapes of an insertion, of what is outside the bore."""
    shapes = []
    for shape in plan.shapes:
        part = simulator.with_rod(before(simulator.rod, shape.s[-1]))
        shapes.append(part.solve(shape.gripper, shape, far_end=shape.far_end))
        progress.done(len(shapes), len(plan))
    return shapes


def _at_rest(simulator, plan, shapes, obstacles):
    """Return the figures of the quasi-static replay."""
    misses, angles = [], []
    for shape, passes in zip(shapes, plan.passes, strict=True):
        for centre, s, normal in passes:
            axes, position = shape.frame_at(s)
            misses.append(np.linalg.norm(position - centre))
            if normal is not None:
                angles.append(np.arctan2(np.linalg.norm(np.cross(axes[:, 0], normal)),
                                         axes[:, 0] @ normal))
    deviation = max(apart(*pair) for pair in zip(shapes, plan.shapes, strict=True))
    return {
        'converged': all(shape.converged and not shape.jumped for shape in shapes)
        and bool(deviation <= _AS_PLANNED * simulator.rod.length),
        'miss': _worst(misses), 'misalignment': _worst(angles),
        'residual': max(shape.residual for shape in shapes),
        'stability': min(shape.stability for shape in shapes),
        'bend_margin': min(shape.bend_margin for shape in shapes),
        'contact_force': max((contact.force for shape in shapes for contact in shape.contacts),
                             default=0.0),
        'clearance': least_clearance(plan, obstacles, Surface.of(simulator.rod), shapes),
        'deviation': deviation}


def _in_motion(motion, tolerance):
    """Return the figures of the dynamic replay."""
    figures = motion.figures(1.0)
    if tolerance is None:
        return figures
    judged = 'swing' if np.isnan(figures['dynamic_miss']) else 'dynamic_miss'
    try:
        scale = fastest_scale(lambda scale: motion.figures(scale, judged)[judged] <= tolerance,
                              bool(figures[judged] <= tolerance))
    except TooLong:  # so slow a motion is not looked at
        return figures
    return figures | {'fastest': float(figures['duration'] * scale)}


def _worst(values):
    return float(max(values, default=np.nan))

