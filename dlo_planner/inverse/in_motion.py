"""A motion of the gripper in the dynamic simulation: where the DLO is, and how it swings."""

from dataclasses import dataclass, fields

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.clearance import clearance, room_in
from dlo_planner.inverse.continuity import apart
from dlo_planner.inverse.passing import worst_miss
from dlo_planner.inverse.periods import slowest_period
from dlo_planner.model.checks import figure, flag
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import Value, brief, put

_PER_PERIOD = 25      # instants in a period of the DLO's slowest vibration
_FEWEST, _MOST = 150, 20_000  # instants of a run


@dataclass(frozen=True, eq=False, repr=False)
class InMotion(Value):
    """What the dynamic simulation says of a motion from rest to rest; worst values, SI units.

    Distances of a DLO that could not be simulated to the end are infinitely bad.

    Attributes:
        converged: whether every step was solved
        miss: distance from the centres to be passed, between all waypoints: of the nearest arc
            length between those of both waypoints; a centre that the free end only comes to on that
            way counts from then on; nan if there is none
        swing: largest distance of the DLO from its equilibrium in the same gripper
        arrival: the same at the first instant that counts for `miss`, or nan
        departure: the same in the slowest period after the motion's end
        clearance: from the sheets around sized cut-outs and from the obstacles given, nan if none
        calm_clearance: the same of the DLO that follows slowly on the same way
        contact_force: largest force of one contact with the simulator's obstacles, N
        duration: of the motion, s; step: between two instants looked at, s
    """

    converged: bool
    miss: float
    swing: float
    arrival: float
    departure: float
    clearance: float
    calm_clearance: float
    contact_force: float
    duration: float
    step: float

    def __post_init__(self):
        put(self, converged=flag('InMotion.converged', self.converged),
            **{item.name: figure(f'InMotion.{item.name}', getattr(self, item.name))
               for item in fields(self) if item.name != 'converged'})

    def __repr__(self):
        return brief(self, 'converged' if self.converged else 'not converged', *(
            f'{name} {getattr(self, name):.3g} {unit}' for name, unit in (
                ('miss', 'm'), ('swing', 'm'), ('departure', 'm'), ('clearance', 'm'),
                ('duration', 's')) if np.isfinite(getattr(self, name))))

    def worse(self, other: 'InMotion') -> 'InMotion':
        """Return the worse of both figures, each by itself."""
        least = {'converged', 'clearance', 'calm_clearance'}
        return InMotion(**{item.name: (min if item.name in least else max)(
            getattr(self, item.name), getattr(other, item.name)) for item in fields(self)})


def in_motion(simulator, plan, way, first, obstacles, progress):
    """Return InMotion of a Plan's DLO.

    Args:
        simulator: DirectSimulator; plan: Plan
        way: TimedPath of the plan
        first: Shape at its beginning, at rest
        obstacles: tuple of obstacles whose clearance is wanted
        progress: Progress

    Raises:
        InvalidTask: the motion has more than 20000 instants
    """
    period = slowest_period(simulator.rod)
    times = np.linspace(0, way.duration + period, _instants(way.duration + period, period))
    grippers, done = way.at(times)[0], way.progress(times)
    motion = simulator.simulate(grippers, times[1], first, progress=progress.done)
    passed, watched = any(plan.passes), bool(plan.sheets or obstacles)
    if not (motion.converged and first.converged):
        lost, near = np.inf if passed else np.nan, -np.inf if watched else np.nan
        return InMotion(False, lost, np.inf, lost, np.inf, near, near, np.inf, way.duration,
                        times[1])
    calm = simulator.track(grippers, progress.done, first)
    swing = np.array([apart(*pair) for pair in zip(motion.shapes, calm, strict=True)])
    last = np.clip(np.searchsorted(plan.times, done, side='right') - 1, 0, len(plan) - 2)
    miss = np.array([worst_miss(shape, plan.passes[k], plan.passes[k + 1])
                     for k, shape in zip(last, motion.shapes, strict=True)])
    surface = Surface.of(simulator.rod)
    near, calm_near = (least_clearance(plan, obstacles, surface, shapes)
                       for shapes in (motion.shapes, calm))
    return InMotion(
        True, miss.max() if passed else np.nan, swing.max(),
        swing[np.argmax(miss > 0)] if passed else np.nan, swing[times >= way.duration].max(),
        near, calm_near,
        max((contact.force for shape in motion.shapes for contact in shape.contacts), default=0.0),
        way.duration, times[1])


def _instants(duration, period):
    count = max(_FEWEST, int(np.ceil(_PER_PERIOD * duration / period))) + 1
    if count > _MOST:
        raise InvalidTask(f'limits: the motion takes {duration:.3g} s, {count} steps of '
                          f'1/{_PER_PERIOD} of the slowest period of {period:.3g} s: expected at '
                          f'most {_MOST} steps')
    return count


def least_clearance(plan, obstacles, surface, shapes):
    """Return the least clearance in m of Shapes from a Plan's sheets and obstacles, nan if none."""
    rooms = [clearance(obstacles, surface, shape) for shape in shapes if obstacles]
    rooms += [room_in(*sheet, surface, shape).min() for sheet in plan.sheets for shape in shapes]
    return float(min(rooms, default=np.nan))
