# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion of the gripper in the dynamic simulation: where the DLO is, and how it swings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from dlo_planner.deprecated import renamed_fields
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag
from dlo_planner.model.computed import figure
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.clearance import clearance, hole_clearances
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.motion.feed import Feed
from dlo_planner.plan.motion.inserted import Instants, pushed
from dlo_planner.plan.motion.periods import slowest_period
from dlo_planner.plan.motion.timed_path import TimedPath
from dlo_planner.plan.passing import held_after, worst_miss
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import Progress

_LEAST = ('clearance', 'calm_clearance')  # figures of which the least is the worst
_PER_PERIOD = 25      # instants in a period of the DLO's slowest vibration
_FEWEST, _MOST = 150, 20_000  # instants of a run
_AT_ONCE = 1e-9       # of a plan's time


@renamed_fields(miss='position_error')
@dataclass(frozen=True, eq=False, repr=False)
class InMotion(Value):
    """Results of the dynamic simulation of a motion from rest to rest; worst values, SI units.

    Distances of a DLO that could not be simulated to the end are infinitely bad.

    Attributes
    ----------
    converged : bool
        Whether every step was solved.
    position_error : float
        Distance from the centers to be passed, between all waypoints: of the nearest arc length
        between those of both waypoints; a center that the free end reaches in between counts from
        then on; nan if there is none. A DLO in a bore cannot miss it: there the `swing` of the part
        outside counts.
    swing : float
        Largest distance of the DLO from its equilibrium in the same gripper.
    arrival : float
        The same at the first instant that counts for `position_error`, or nan.
    departure : float
        The same in the slowest period after the motion's end.
    clearance : float
        Clearance from the sheets around sized cut-outs and from the obstacles given, nan if none.
    calm_clearance : float
        The same of the DLO that follows the same path slowly.
    contact_force : float
        Largest force of one contact with the simulator's obstacles, or of the mouth of a bore, N.
    duration : float
        Duration of the motion, s.
    step : float
        Step between two instants, s.
    error_estimate : float
        By how much `position_error` may be wrong, m: the largest `Shape.error_estimate` of the
        plan's shapes that pass a center, for the elements, and of a `Trajectory` what halved steps
        of time change, for the steps (Richardson); nan if nothing is passed.
    """

    converged: bool
    position_error: float
    swing: float
    arrival: float
    departure: float
    clearance: float
    calm_clearance: float
    contact_force: float
    duration: float
    step: float
    error_estimate: float = np.nan

    def __post_init__(self) -> None:
        put(self, converged=flag('InMotion.converged', self.converged),
            **{item.name: figure(f'InMotion.{item.name}', getattr(self, item.name))
               for item in fields(self) if item.name != 'converged'})

    def __repr__(self) -> str:
        return brief(self, 'converged' if self.converged else 'not converged', *(
            f'{name} {getattr(self, name):.3g} {unit}' for name, unit in (
                ('position_error', 'm'), ('swing', 'm'), ('departure', 'm'), ('clearance', 'm'),
                ('duration', 's')) if np.isfinite(getattr(self, name))))

    @property
    def bound(self) -> float:
        """Distance from the centers inside which the DLO passes, m: with the error estimate."""
        return float(self.position_error + np.nan_to_num(self.error_estimate))

    def worse(self, other: InMotion) -> InMotion:
        """Return the worse of both, figure by figure; nan in one of them does not count."""
        both = {item.name: (getattr(self, item.name), getattr(other, item.name))
                for item in fields(self)}
        worse = {name: float((np.fmin if name in _LEAST else np.fmax)(*pair))
                 for name, pair in both.items() if name != 'converged'}
        return InMotion(converged=all(both['converged']), **worse)


def in_motion(simulator: DirectSimulator, plan: Plan, timed: TimedPath, first: Shape,
              obstacles: tuple[Obstacle, ...], progress: Progress) -> InMotion:
    """Return InMotion of a Plan's DLO.

    Parameters
    ----------
    simulator : DirectSimulator
    plan : Plan
    timed : TimedPath
        TimedPath of the plan.
    first : Shape
        Shape at its beginning, at rest.
    obstacles : tuple of obstacle
        Obstacles whose clearance is wanted.
    progress : Progress

    Raises
    ------
    InvalidTask
        The motion has more than 20000 instants.
    """
    period = slowest_period(simulator.rod)
    times = np.linspace(0, timed.duration + period, _instants(timed.duration + period, period))
    grippers, reached = timed.at(times)[0], timed.progress(times)
    simulated = _simulated(simulator, plan, Instants(grippers, reached, times[1]), first, progress)
    obstacles = watched(simulator, plan, obstacles)
    passed, anything = any(plan.via_points), bool(plan.sheets or obstacles)
    if simulated is None:
        lost, near = np.inf if passed else np.nan, -np.inf if anything else np.nan
        return InMotion(False, lost, np.inf, lost, np.inf, near, near, np.inf, timed.duration,
                        times[1], lost)
    miss, swing, surface = simulated.position_error, simulated.swing, Surface.of(simulator.rod)
    return InMotion(
        True, miss.max() if passed else np.nan, swing.max(),
        swing[np.argmax(miss > 0)] if passed else np.nan, swing[times >= timed.duration].max(),
        least_clearance(plan, obstacles, surface, simulated.shapes),
        least_clearance(plan, obstacles, surface, simulated.calm),
        simulated.contact_force, timed.duration, times[1], _of_elements(plan))


def step_error(simulator: DirectSimulator, plan: Plan, timed: TimedPath, first: Shape,
               motion: InMotion, progress: Progress) -> float:
    """Return by how much the steps of time move the DLO past the centers, m; inf: not known.

    The integrator is of second order: halved steps change by three quarters of the error.

    Parameters
    ----------
    simulator, plan, timed, first, progress : object
        See `in_motion`.
    motion : InMotion
        Result of the same with its steps.
    """
    if held_after(plan) is not None or not any(plan.via_points):
        return 0.0
    count = 2 * round((timed.duration + slowest_period(simulator.rod)) / motion.step) + 1
    times = 0.5 * motion.step * np.arange(count)
    finer = simulator.simulate(timed.at(times)[0], times[1], first, progress=progress.done)
    if not finer.converged:
        return np.inf
    missed = float(_misses(plan, timed.progress(times), finer.shapes).max())
    return 4 / 3 * abs(missed - motion.position_error)


def _misses(plan: Plan, reached: Floats, shapes: Sequence[Shape]) -> Floats:
    """Return the distances (n,) of shapes at times of a plan from the centers to be passed, m."""
    last = np.clip(np.searchsorted(plan.times, reached, side='right') - 1, 0, len(plan) - 2)
    return np.array([worst_miss(shape, plan.via_points[k], plan.via_points[k + 1])
                     for k, shape in zip(last, shapes, strict=True)])


def _of_elements(plan: Plan) -> float:
    """Return the largest error estimate of the shapes that pass a center, m; nan if none does."""
    return max((shape.error_estimate for shape, passes in zip(
        plan.shapes, plan.via_points, strict=True) if passes), default=np.nan)


@dataclass(frozen=True)
class _Simulated:
    """A simulated motion at n instants.

    Attributes
    ----------
    shapes : sequence of Shape
    calm : sequence of Shape
        Shapes of the DLO that follows slowly.
    position_error : ndarray, shape (n,)
        Position error in m.
    swing : ndarray, shape (n,)
        Swing in m.
    contact_force : float
        Largest contact force, N.
    """

    shapes: Sequence[Shape]
    calm: Sequence[Shape]
    position_error: Floats
    swing: Floats
    contact_force: float

    def then(self, other: _Simulated) -> _Simulated:
        """Return this motion and another, which begins at the instant at which this one ends."""
        return _Simulated([*self.shapes, *other.shapes[1:]], [*self.calm, *other.calm[1:]],
                          np.append(self.position_error, other.position_error[1:]),
                          np.append(self.swing, other.swing[1:]),
                          max(self.contact_force, other.contact_force))


def _simulated(simulator: DirectSimulator, plan: Plan, instants: Instants, first: Shape,
               progress: Progress) -> _Simulated | None:
    """Return a motion simulated to its end, None if that failed."""
    bore = held_after(plan)
    if bore is None:
        return _without_bore(simulator, plan, instants, first, progress)[0]
    # the bore takes the DLO at the last instant at which it is still before the mouth
    at = int(np.searchsorted(instants.u, plan.times[bore] + _AT_ONCE * np.ptp(plan.times),
                             'right')) - 1
    feed, before, velocity = Feed.of(simulator, plan), None, None
    if at > 0:
        before, motion = _without_bore(simulator, plan, instants.part(0, at + 1), first, progress)
        if before is None:
            return None
        first, velocity = motion.shapes[-1], motion.velocities[-1]
    outside = pushed(feed, instants.part(at), first, velocity, progress)
    if not outside.converged:
        return None
    swing = np.array([apart(*pair) for pair in zip(outside.shapes, outside.calm, strict=True)])
    within = _Simulated(outside.shapes, outside.calm, swing, swing, outside.forces.max())
    return within if before is None else before.then(within)


def _without_bore(simulator: DirectSimulator, plan: Plan, instants: Instants, first: Shape,
                  progress: Progress) -> tuple[_Simulated | None, Motion]:
    """Return the simulated motion of a DLO that no bore holds, or None, and the Motion."""
    grippers = instants.grippers
    motion = simulator.simulate(grippers, instants.dt, first, progress=progress.done)
    if not (motion.converged and first.converged):
        return None, motion
    calm = simulator.track(grippers, progress.done, first)
    swing = np.array([apart(*pair) for pair in zip(motion.shapes, calm, strict=True)])
    errors = _misses(plan, instants.u, motion.shapes)
    force = max((contact.force for shape in motion.shapes for contact in shape.contacts),
                default=0.0)
    return _Simulated(motion.shapes, calm, errors, swing, force), motion


def watched(simulator: DirectSimulator, plan: Plan,
            obstacles: tuple[Obstacle, ...]) -> tuple[Obstacle, ...]:
    """Return the obstacles (tuple) whose clearance is wanted: those given, and of an insertion all.

    The part outside of a bore is simulated without contacts.
    """
    return obstacles if held_after(plan) is None else (*obstacles, *simulator.obstacles)


def _instants(duration: float, period: float) -> int:
    count = max(_FEWEST, int(np.ceil(_PER_PERIOD * duration / period))) + 1
    if count > _MOST:
        raise InvalidTask(f'limits: the motion takes {duration:.3g} s, {count} steps of '
                          f'1/{_PER_PERIOD} of the slowest period of {period:.3g} s: expected at '
                          f'most {_MOST} steps')
    return count


def least_clearance(plan: Plan, obstacles: Sequence[Obstacle], surface: Surface,
                    shapes: Iterable[Shape]) -> float:
    """Return the least clearance in m of Shapes from a Plan's sheets and obstacles, nan if none."""
    rooms = [clearance(obstacles, surface, shape) for shape in shapes if obstacles]
    rooms += [float(hole_clearances(sheet, normal, surface, shape).min())
              for sheet, normal in plan.sheets for shape in shapes]
    return float(min(rooms, default=np.nan))
