"""Proof with a plan: it is run through the direct simulator, slowly and at its own pace."""

from dataclasses import dataclass, fields

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.clearance import clearance, room_in
from dlo_planner.inverse.plan import Plan
from dlo_planner.inverse.trajectory import Limits, Trajectory
from dlo_planner.model.checks import figure, flag, instance, items, number
from dlo_planner.model.obstacles import OBSTACLES
from dlo_planner.model.part import before
from dlo_planner.model.value import Value, brief, put

_PER_PERIOD = 25           # steps in a period of the DLO's slowest vibration
_STEPS = 150, 2000         # at least, at most
_DOUBLINGS, _HALVINGS = 4, 3  # of the pace that is tried


@dataclass(frozen=True, eq=False, repr=False)
class Report(Value):
    """What the direct simulator says of a plan; worst values over all waypoints.

    Attributes:
        converged: every pose has an equilibrium that continues the one before
        miss: distance of the DLO from a centre that it should pass, m
        misalignment: angle against a normal along which it should pass, rad
        residual, stability, bend_margin: of the shapes
        contact_force: largest force of one contact, N
        clearance: m, to the cut-outs and obstacles given; infinite without
        dynamic_miss: distance from the centres in motion, m (nan if not asked for)
        duration: of that motion, s
        fastest: shortest duration found whose dynamic miss stays within the tolerance, s (nan if
            not asked for, infinite if there is none within 16 times the duration)
    """

    converged: bool
    miss: float
    misalignment: float
    residual: float
    stability: float
    bend_margin: float
    contact_force: float
    clearance: float
    dynamic_miss: float = np.nan
    duration: float = np.nan
    fastest: float = np.nan

    def __post_init__(self):
        put(self, converged=flag('Report.converged', self.converged),
            **{item.name: figure(f'Report.{item.name}', getattr(self, item.name))
               for item in fields(self) if item.name != 'converged'})

    def __repr__(self):
        said = {'miss': 'm', 'stability': '', 'clearance': 'm', 'dynamic_miss': 'm',
                'duration': 's', 'fastest': 's'}
        return brief(self, 'converged' if self.converged else 'not converged', *(
            f'{name.replace("_", " ")} {getattr(self, name):.3g} {unit}'.rstrip()
            for name, unit in said.items() if np.isfinite(getattr(self, name))))


def replay(simulator, plan, *, obstacles=(), limits=None, tolerance=None,
           initial=None) -> Report:
    """Return the Report of a Plan.

    Args:
        simulator: DirectSimulator, the planner's own or a better one
        plan: Plan; of an insertion, whose shapes are parts of the DLO, each is held at the mouth
            as planned, and it is not run dynamically
        obstacles: whose clearance is wanted besides the cut-outs' with a size
        limits: Limits; the plan is run dynamically at the pace that they allow (None: it is not)
        tolerance: m; with it, the fastest pace that keeps the dynamic miss within is sought
        initial: Shape before the first pose; None: the natural shape is set down there

    Raises:
        InvalidTask: limits with an insertion
    """
    instance('simulator', simulator, DirectSimulator)
    if not len(instance('plan', plan, Plan)):
        raise InvalidTask(f'plan = {plan!r}: expected a Plan with a waypoint')
    obstacles = items('obstacles', obstacles, OBSTACLES)
    instance('limits', limits, Limits, optional=True)
    instance('initial', initial, Shape, optional=True)
    if tolerance is not None:
        tolerance = number('tolerance', tolerance, above=0)
    whole = all(shape.s[-1] == simulator.rod.length for shape in plan.shapes)
    if limits is not None and not whole:
        raise InvalidTask('limits: expected None for an insertion; it is not run dynamically')
    shapes = simulator.track(plan.grippers, initial=initial) if whole else [
        simulator.with_rod(before(simulator.rod, shape.s[-1])).solve(
            shape.gripper, shape, far_end=shape.far_end) for shape in plan.shapes]
    misses, angles = [0.0], [0.0]
    for shape, passes in zip(shapes, plan.passes, strict=True):
        for centre, s, normal in passes:
            axes, position = shape.frame_at(s)
            misses.append(np.linalg.norm(position - centre))
            if normal is not None:
                angles.append(np.arctan2(np.linalg.norm(np.cross(axes[:, 0], normal)),
                                         axes[:, 0] @ normal))
    radius = simulator.rod.radius or 0.0
    rooms = [clearance(obstacles, radius, shape) for shape in shapes if len(obstacles)]
    rooms += [room_in(*sheet, radius, shape).min() for sheet in plan.sheets for shape in shapes]
    figures = {
        'converged': all(shape.converged and not shape.jumped for shape in shapes),
        'miss': float(max(misses)), 'misalignment': float(max(angles)),
        'residual': max(shape.residual for shape in shapes),
        'stability': min(shape.stability for shape in shapes),
        'bend_margin': min(shape.bend_margin for shape in shapes),
        'contact_force': max((contact.force for shape in shapes for contact in shape.contacts),
                             default=0.0),
        'clearance': float(min(rooms, default=np.inf))}
    if limits is not None:
        way = Trajectory(plan, limits)
        figures['duration'] = float(way.duration)
        figures['dynamic_miss'] = _dynamic_miss(simulator, plan, way, 1.0, shapes[0])
        if tolerance is not None:
            figures['fastest'] = float(way.duration * _fastest(
                lambda scale: _dynamic_miss(simulator, plan, way, scale, shapes[0]) <= tolerance))
    return Report(**figures)


def _dynamic_miss(simulator, plan, way, scale, first):
    """Return the largest miss when the way takes `scale` times as long, between all waypoints."""
    duration = scale * way.duration
    steps = int(np.clip(np.ceil(_PER_PERIOD * duration / _period(simulator.rod)), *_STEPS))
    times = np.linspace(0, 1, steps + 1)
    grippers = way.at(times * way.duration)[0]
    motion = simulator.simulate(grippers, duration / steps, first)
    if not motion.converged:
        return np.inf
    done = way.progress(times * way.duration)
    largest = 0.0
    for time, shape in zip(done, motion.shapes, strict=True):
        k = min(int(np.searchsorted(plan.times, time, side='right')) - 1, len(plan) - 2)
        span = plan.times[k + 1] - plan.times[k]
        share = np.clip((time - plan.times[k]) / span, 0, 1) if span > 0 else 1.0
        for (centre, s, _), (_, later, _) in zip(plan.passes[k], plan.passes[k + 1], strict=False):
            position = shape.frame_at((1 - share) * s + share * later)[1]
            largest = max(largest, float(np.linalg.norm(position - centre)))
    return largest


def _period(rod):
    """Return the period (s) of the slowest vibration of a Rod held at one end, about."""
    s = np.linspace(0, rod.length, 33)
    mass = rod.length * rod.masses_per_length(s).mean() / 4 + rod.tip_mass
    # a tip mass on a cantilever; its own mass counts for about a quarter
    return 2 * np.pi * np.sqrt(max(mass, 1e-12) * rod.length**3 / (3 * min(rod.bending_stiffness)))


def _fastest(good):
    """Return the smallest scale found that is `good`, by doubling and halving."""
    if good(1.0):
        high, low = 1.0, None
        for _ in range(_DOUBLINGS):
            if not good(high / 2):
                low = high / 2
                break
            high /= 2
    else:
        low, high = 1.0, None
        for _ in range(_DOUBLINGS):
            if good(2 * low):
                high = 2 * low
                break
            low *= 2
    if high is None:
        return np.inf
    for _ in range(_HALVINGS if low is not None else 0):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if good(middle) else (middle, high)
    return high
