# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A motion of the gripper in the dynamic simulation: where the DLO is, and how it swings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dlo_planner.direct.grasp import Simulator
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import figure, flag, instance
from dlo_planner.model.holds import Holds
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Surface
from dlo_planner.model.value import Value, brief, put
from dlo_planner.plan.checks import largest_wrench
from dlo_planner.plan.clearance import Bodies
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.goals import Through
from dlo_planner.plan.path import held_after
from dlo_planner.plan.plan import Plan, arc_length_at, means_to_touch, passages
from dlo_planner.plan.swept import least_between
from dlo_planner.plan.waypoint import length_of
from dlo_planner.progress import Progress
from dlo_planner.trajectory.modal_response import slowest_period_of
from dlo_planner.trajectory.sliding_end import Feed, Instants, pushed
from dlo_planner.trajectory.timed_path import TimedPath, holds_in

# figures of which the least is the worst
_LEAST = ('clearance', 'calm_clearance', 'calm_gap', 'bend_margin')
_PER_PERIOD = 25      # instants in a period of the DLO's slowest vibration
_FEWEST, _MOST = 150, 20_000  # instants of a run
_AT_ONCE = 1e-9       # of a plan's time
_PRESSED = 1e-3       # of the force of a contact as planned: with less it is lost


@dataclass(frozen=True, eq=False, repr=False)
class InMotion(Value):
    """Results of the dynamic simulation of a motion from rest to rest; worst values, SI units.

    Distances of a DLO that could not be simulated to the end are infinitely bad.

    Attributes
    ----------
    converged : bool
        Whether every step was solved.
    position_error : float
        Distance from the centers to be passed, between all waypoints (see `passages` of a plan); a
        center that the free end reaches in between counts from then on; nan if there is none. A DLO
        in a bore cannot miss it: there the `swing` of the part outside counts.
    swing : float
        Largest distance of the DLO from its equilibrium in the same gripper.
    arrival : float
        The same at the first instant that counts for `position_error`, or nan.
    departure : float
        The same in the slowest period after the motion's end.
    clearance : float
        Clearance from the sheets around sized cut-outs and from the obstacles given, nan if none.
        Of a DLO that is free also between the instants: a lower bound where it is not above 0.
    calm_clearance : float
        The same of the DLO that follows the same path slowly.
    contact_force : float
        Largest force of one contact with the simulator's obstacles, N; nan where a bore takes the
        DLO: friction there, its room and its edge are not looked at. Infinite: not known, of a DLO
        that touches against its plan.
    duration : float
        Duration of the motion, s.
    step : float
        Step between two instants, s.
    bend_margin : float
        Least `Shape.bend_margin`, 1/m; nan of a rod without max_bend_curvature.
    contact_lost : float
        Part of the time in which the DLO does not touch what the plan touches; nan if nothing, or
        only a bore.
    smooth_bore_force : float
        Largest force of the entrance of a bore, N, if the bore was as tight as the DLO and without
        friction: no bound, true bores push and rub many times as much. nan without a bore.
    error_estimate : float
        By how much `position_error` may be wrong, m: the largest `Shape.error_estimate` of the
        plan's shapes that pass a center, for the elements, and of a `Trajectory` what halved steps
        of time change, for the steps (Richardson); nan if nothing is passed.
    calm_gap : float
        Distance of the DLO that follows the same path slowly from the simulator's obstacles that it
        is not meant to touch; nan if there are none, or if it was simulated in contact.
    grip_force : float
        Largest force that the gripper or another hold exerts on the DLO, N; nan where the gripper
        alone holds it, or a bore takes it.
    grip_moment : float
        The same for the moment, N m.
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
    bend_margin: float = np.nan
    contact_lost: float = np.nan
    smooth_bore_force: float = np.nan
    calm_gap: float = np.nan
    grip_force: float = np.nan
    grip_moment: float = np.nan

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
        return float(self.position_error + np.nan_to_num(self.error_estimate, posinf=np.inf))

    def worse(self, other: InMotion) -> InMotion:
        """Return the worse of both, figure by figure; nan in one of them does not count."""
        both = {item.name: (getattr(self, item.name), getattr(other, item.name))
                for item in fields(self)}
        worse = {name: float((np.fmin if name in _LEAST else np.fmax)(*pair))
                 for name, pair in both.items() if name != 'converged'}
        return InMotion(converged=all(both['converged']), **worse)


def in_motion(simulator: Simulator, plan: Plan, timed: TimedPath, first: Shape,
              obstacles: tuple[Obstacle, ...], progress: Progress, *,
              touched: bool = True, calm: Sequence[Shape] | None = None) -> InMotion:
    """Return InMotion of a Plan's DLO; `calm` are its `calm_shapes`, where they are known.

    A DLO that is not meant to touch the simulator's obstacles moves as without them, and is shown
    to stay clear of them, at the instants and between. Only if that fails is it simulated in
    contact.
    """
    around = unplanned(simulator, plan)
    if not around:
        return _figures(simulator, plan, timed, first, obstacles, progress, calm=calm)
    free = _figures(simulator.without_obstacles(), plan, timed, first, obstacles, progress, around,
                    calm)
    if free.contact_force == 0 or not (touched and free.converged):
        return free
    return _figures(simulator, plan, timed, first, obstacles, progress)


def unplanned(simulator: Simulator, plan: Plan) -> tuple[Obstacle, ...]:
    """Return the obstacles of a DirectSimulator that the DLO of a Plan is not meant to touch."""
    return () if means_to_touch(plan) else simulator.obstacles


def _figures(simulator: Simulator, plan: Plan, timed: TimedPath, first: Shape,
             obstacles: tuple[Obstacle, ...], progress: Progress,
             around: tuple[Obstacle, ...] = (), calm: Sequence[Shape] | None = None) -> InMotion:
    """Return InMotion; of a DLO that comes near to `around` the contact force is infinite."""
    times = instants(simulator, timed, first)
    grippers, reached = timed.poses(times), timed.progress(times)
    simulated = _simulated(simulator, plan, Instants(grippers, reached, times[1]), first, progress,
                           calm, holds_in(timed, first.holds, times))
    obstacles = watched(simulator, plan, obstacles)
    passed, anything = any(plan.via_points), bool(plan.sheets or obstacles)
    if simulated is None:
        held = np.inf if _held_elsewhere(plan) else np.nan
        lost, near = np.inf if passed else np.nan, -np.inf if anything else np.nan
        limited, touches = simulator.rod.max_bend_curvature is not None, any(
            shape.contacts for shape in plan.shapes)
        return InMotion(False, lost, np.inf, lost, np.inf, near, near, np.inf, timed.duration,
                        times[1], lost, -np.inf if limited else np.nan, 1.0 if touches else np.nan,
                        grip_force=held, grip_moment=held)
    miss, swing, surface = simulated.position_error, simulated.swing, Surface.of(simulator.rod)
    bodies = Bodies(plan.sheets, obstacles, surface, progress.check)
    all_around = Bodies((), around, surface, progress.check)
    touched = bool(around) and not simulated.least(all_around) > 0
    return InMotion(
        True, miss.max() if passed else np.nan, swing.max(),
        swing[np.argmax(miss > 0)] if passed else np.nan, swing[times >= timed.duration].max(),
        simulated.least(bodies), bodies.least(simulated.calm),
        np.inf if touched else simulated.contact_force, timed.duration, times[1],
        _of_elements(plan), min(shape.bend_margin for shape in simulated.shapes),
        # the first one is given, and may not know its contacts
        contact_lost(plan, reached[1:], simulated.shapes[1:]), simulated.smooth_bore_force,
        all_around.least(simulated.calm), *(
            np.max([largest_wrench(shape) for shape in simulated.shapes], axis=0)
            if _held_elsewhere(plan) else (np.nan, np.nan)))


def _held_elsewhere(plan: Plan) -> bool:
    """Whether more than the gripper holds a Plan's DLO, and not a bore."""
    return bool(plan.shapes[0].holds) and held_after(plan) is None


def step_error(simulator: Simulator, plan: Plan, timed: TimedPath, first: Shape,
               motion: InMotion, progress: Progress) -> float:
    """Return by how much the steps of time move the DLO past the centers, m; inf: not known.

    The integrator is of second order: halved steps change by three quarters of the error.
    """
    if held_after(plan) is not None or not any(plan.via_points):
        return 0.0
    count = 2 * round((timed.duration + slowest_period_of(simulator, first)) / motion.step) + 1
    times = 0.5 * motion.step * np.arange(count)
    if unplanned(simulator, plan):  # which it was seen to stay away from
        simulator = simulator.without_obstacles()
    finer = simulator.simulate(timed.poses(times), times[1], first, progress=progress.done,
                               holds=holds_in(timed, first.holds, times))
    if not finer.converged:
        return np.inf
    missed = float(misses(plan, timed.progress(times), finer.shapes).max())
    return 4 / 3 * abs(missed - motion.position_error)


def misses(plan: Plan, reached: Floats, shapes: Sequence[Shape]) -> Floats:
    """Return the distances (n,) of shapes at times of a plan from the centers to be passed, m."""
    last = np.clip(np.searchsorted(plan.times, reached, side='right') - 1, 0, len(plan) - 2)
    goals = [goals_between(plan, k) for k in range(len(plan) - 1)]
    return np.array([worst_miss(shape, goals[k]) for k, shape in zip(last, shapes, strict=True)])


def _of_elements(plan: Plan) -> float:
    """Return the largest error estimate of the shapes that pass a center, m; nan if none does."""
    return max((shape.error_estimate for shape, passes in zip(
        plan.shapes, plan.via_points, strict=True) if passes), default=np.nan)


@dataclass(frozen=True)
class _Simulated:
    """A simulated motion at n instants."""

    shapes: Sequence[Shape]
    calm: Sequence[Shape]  # shapes of the DLO that follows slowly
    position_error: Floats  # (n,) position error in m
    swing: Floats  # (n,) swing in m
    contact_force: float  # largest contact force, N; nan in a bore
    smooth_bore_force: float = np.nan  # see `InMotion`
    # (n, N + 1, 3) or None velocities of the nodes, m/s; None where the DLO touches something, or
    # gets shorter
    velocities: Floats | None = None
    step: float = 0.0  # seconds between two instants

    def least(self, near: Bodies) -> float:
        """Return the smallest distance from bodies in m, between the instants too where known."""
        if self.velocities is None:
            return near.least(self.shapes)
        return least_between(near, self.shapes, self.velocities, self.step)

    def then(self, other: _Simulated) -> _Simulated:
        """Return this motion and another, which begins at the instant at which this one ends."""
        return _Simulated([*self.shapes, *other.shapes[1:]], [*self.calm, *other.calm[1:]],
                          np.append(self.position_error, other.position_error[1:]),
                          np.append(self.swing, other.swing[1:]),
                          other.contact_force, other.smooth_bore_force)


def _simulated(simulator: Simulator, plan: Plan, instants: Instants, first: Shape,
               progress: Progress, calm: Sequence[Shape] | None,
               holds: Sequence[Holds]) -> _Simulated | None:
    """Return a motion simulated to its end, None if that failed."""
    bore = held_after(plan)
    if bore is None:
        return _without_bore(simulator, plan, instants, first, progress, calm, holds)[0]
    # the bore takes the DLO at the last instant at which it is still before the entrance
    at = int(np.searchsorted(instants.u, plan.times[bore] + _AT_ONCE * np.ptp(plan.times),
                             'right')) - 1
    whole: DirectSimulator = instance('simulator', simulator, DirectSimulator)
    feed, before, velocity = Feed.of(whole, plan), None, None
    if at > 0:
        before, motion = _without_bore(simulator, plan, instants.part(0, at + 1), first, progress)
        if before is None:
            return None
        first, velocity = motion.shapes[-1], motion.velocities[-1]
    outside = pushed(feed, instants.part(at), first, velocity, progress)
    if not outside.converged:
        return None
    swing = np.array([apart(*pair) for pair in zip(outside.shapes, outside.calm, strict=True)])
    within = _Simulated(outside.shapes, outside.calm, swing, swing, np.nan, outside.forces.max())
    return within if before is None else before.then(within)


def calm_shapes(simulator: Simulator, plan: Plan, timed: TimedPath, first: Shape,
                progress: Progress) -> Sequence[Shape] | None:
    """Return the Shapes of a DLO that follows slowly, at the instants of `in_motion`.

    They are the same whatever damps it. None of one that a bore takes.
    """
    if held_after(plan) is not None:
        return None
    times = instants(simulator, timed, first)
    return simulator.track(timed.poses(times), progress.done, first,
                           holds=holds_in(timed, first.holds, times))


def _without_bore(simulator: Simulator, plan: Plan, instants: Instants, first: Shape,
                  progress: Progress, calm: Sequence[Shape] | None = None,
                  holds: Sequence[Holds] = ()) -> tuple[_Simulated | None, Motion]:
    """Return the simulated motion of a DLO that no bore holds, or None, and the Motion."""
    grippers = instants.grippers
    motion = simulator.simulate(grippers, instants.dt, first, progress=progress.done, holds=holds)
    if not (motion.converged and first.converged):
        return None, motion
    if calm is None:
        calm = simulator.track(grippers, progress.done, first, holds=holds)
    swing = np.array([apart(*pair) for pair in zip(motion.shapes, calm, strict=True)])
    errors = misses(plan, instants.u, motion.shapes)
    force = max((contact.force for shape in motion.shapes for contact in shape.contacts),
                default=0.0)
    # in contact velocities jump: no cubic polynomials tell what is between
    velocities = None if simulator.obstacles else motion.velocities
    return _Simulated(motion.shapes, calm, errors, swing, force,
                      velocities=velocities, step=instants.dt), motion


def watched(simulator: Simulator, plan: Plan,
            obstacles: tuple[Obstacle, ...]) -> tuple[Obstacle, ...]:
    """Return the obstacles (tuple) whose clearance is wanted: those given, and of an insertion all.

    The part outside of a bore is simulated without contacts.
    """
    return obstacles if held_after(plan) is None else (*obstacles, *simulator.obstacles)


def instants(simulator: Simulator, timed: TimedPath, begin: Shape | None = None) -> Floats:
    """Return the times (n,), s, that are looked at: to a slowest period after the end.

    `begin`: as of `slowest_period_of`.
    """
    period = slowest_period_of(simulator, begin)
    duration = timed.duration + period
    count = max(_FEWEST, int(np.ceil(_PER_PERIOD * duration / period))) + 1
    if count > _MOST:
        raise InvalidTask(f'limits: the motion takes {duration:.3g} s, {count} steps of '
                          f'1/{_PER_PERIOD} of the slowest period of {period:.3g} s: expected at '
                          f'most {_MOST} steps')
    return np.linspace(0, duration, count)


def goals_between(plan: Plan, k: int) -> list[tuple[Through, bool]]:
    """Return what a Plan's DLO passes between a waypoint and the next.

    And whether at one of both alone: then it counts only while the free end is beyond it.
    """
    length, both = float(plan.shapes[k].s[-1]), plan.via_points[k:k + 2]
    out = []
    for center in {tuple(center.tolist()): center for passes in both for center, _, _ in passes
                   }.values():
        known = [s for s in (arc_length_at(center, passes) for passes in both) if s is not None]
        out.append((passages([(center, min(known), None)], length)[0], len(known) == 1))
    return out


def worst_miss(shape: Shape, goals: Iterable[tuple[Through, bool]]) -> float:
    """Return the largest residual of `goals_between` in m, 0 if there is none."""
    worst = 0.0
    for goal, alone in goals:
        s, (off, _, _) = goal.nearest(shape)
        if not alone or s < shape.s[-1]:
            worst = max(worst, length_of(off))
    return worst


def contact_lost(plan: Plan, u: Floats, shapes: Sequence[Shape]) -> float:
    """Return which part of some Shapes do not touch what a Plan touches there; nan: nothing.

    An obstacle counts between two waypoints that both touch it, whatever its friction is, and is
    touched by a thousandth of the force there. Not before the first waypoint that names where the
    DLO touches: pressed ever so lightly, as it is on its way down there, it may bounce.

    Shapes: u (n,).
    """
    forces = [_pushes(shape) for shape in plan.shapes]
    named = (k for k, passes in enumerate(plan.via_points) if passes and forces[k])
    first = next(named, 0)
    last = np.clip(np.searchsorted(plan.times, u, side='right') - 1, 0, len(plan) - 1)
    later = np.minimum(last + (u > plan.times[last]), len(plan) - 1)
    kept = []
    for k, j, shape in zip(last, later, shapes, strict=True):
        least = {body: _PRESSED * min(force, forces[j][body])
                 for body, force in forces[k].items() if body in forces[j]}
        if least and k >= first:
            there = _pushes(shape)
            kept.append(all(there.get(body, 0.0) > force for body, force in least.items()))
    return 1 - float(np.mean(kept)) if kept else np.nan


def _pushes(shape: Shape) -> dict[Any, float]:
    """Return how strongly obstacles, as if without friction, or their indices push a Shape, N."""
    bodies, forces = shape.obstacles, dict[Any, float]()
    for contact in shape.contacts:
        body = replace(bodies[contact.obstacle], friction=0.0) if bodies else contact.obstacle
        forces[body] = forces.get(body, 0.0) + contact.force
    return forces
