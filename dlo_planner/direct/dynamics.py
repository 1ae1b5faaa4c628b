# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion of the DLO under moving grips, in steps as long as their error and the energy allow."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.beginning import check_velocity
from dlo_planner.direct.books import given_back
from dlo_planner.direct.instant import Instant
from dlo_planner.direct.integrator import KinematicState
from dlo_planner.direct.leg import MOST, Leg, Limits, leg_of
from dlo_planner.direct.motion import Boxed, Motion
from dlo_planner.direct.motion_error import HALVINGS, Begun, Recipe, Trace, error_of
from dlo_planner.direct.setting_off import begin, renewed
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import MAX_ITERATIONS
from dlo_planner.direct.stepping import Stepper
from dlo_planner.model.arrays import Floats
from dlo_planner.progress import Progress

_PATIENCE = 60       # Newton steps after which it is better to halve the step
_NOISE = 1e-5        # of weight times length and of a bend by 1 rad: the same, at rest
_PART = 1 / 600      # of the tolerance: what one step may add to the error
_WELL_WITHIN = 0.6   # of that: a step of twice the length, with 8 times the error, may be tried
_CALM = 16           # steps that all were well within, before it is
_OF_CONTACT = 3      # halvings for its error of a step since the DLO touched an obstacle
_GAIN = 1e-3         # of the energy that has moved: what a motion may gain by rounding and errors


class Run(NamedTuple):
    """What the steps of a motion came to.

    Attributes
    ----------
    reached : list of Instant
        Instants at 0, 1, 2 ...; the last one is where it ended: not solved, or the last before a
        step that gained energy.
    steps : list of int
        Halvings of all steps.
    local : float
        Sum of their local errors, m.
    status : str
        Status of `Motion`.
    message : str
        Message of `Motion`.
    samples : ndarray, shape (k, m, 3), or None
        Places after each step, see `Leg`.
    """

    reached: list[Instant]
    steps: list[int]
    local: float
    status: str = 'complete'
    message: str = ''
    samples: Floats | None = None


def simulate(stepper: Stepper, begun: Begun, plan: Recipe, progress: Progress) -> Motion:
    """Return the Motion that begins so; see `DirectSimulator.simulate`."""
    first = begin(stepper, begun.start, begun.velocity)
    if begun.velocity is not None:
        check_velocity(stepper.masses, begun.velocity, first.nodes.velocity)
    if not begun.start.converged:
        ended = Run([first], [], 0.0, 'unsolved', 'the shape at time 0 was not found')
        return _motion(stepper, ended, plan.tolerance, None)
    made = _run(stepper, first, plan, progress)
    trace = Trace([instant.place for instant in made.reached],
                  [instant.positions for instant in made.reached], made.samples)
    estimate = partial(error_of, stepper, begun, replace(plan, steps=tuple(made.steps)), trace)
    return _motion(stepper, made, plan.tolerance, estimate)


def run(stepper: Stepper, first: Instant, instants: int, tolerance: float,
        progress: Progress) -> tuple[list[Instant], bool]:
    """Return the Instants at 0, 1, 2 ... of a motion that goes on from `first`.

    And whether all steps were good; the last Instant is where it ended, see `Run`.
    """
    plan = Recipe(instants, 'generalized_alpha', tolerance)
    made = _run(stepper, first, plan, progress)
    return made.reached, made.status == 'complete'


def _run(stepper: Stepper, first: Instant, plan: Recipe, progress: Progress) -> Run:
    """Return the Run that begins with the Instant `first`."""
    pace, reached = _Pace(stepper, first, plan), [first]
    while len(reached) < plan.instants:
        leg = pace.go_on(progress)
        progress.check()
        for instant in leg.kept:
            reached.append(instant)
            progress.done(len(reached), plan.instants)
        after = leg.refused
        if pace.stuck and after is not None:
            status = 'energy' if after.shape.converged else 'unsolved'
            end = replace(after, shape=replace(after.shape, converged=False))
            if status == 'energy':  # what has made energy is no instant of this DLO
                end = pace.now
            return pace.run(reached if end.place == reached[-1].place else [*reached, end], status,
                            _reason(status, stepper, pace.now, after.place))
    return pace.run(reached)


class _Pace:
    """Makes the steps of a motion, as long as they may be.

    Attributes
    ----------
    now : Instant
        At the end of the last good step.
    stuck : bool
        Whether the next step is not good, however short it is.
    """

    def __init__(self, stepper: Stepper, first: Instant, plan: Recipe) -> None:
        self.now, self.stuck = first, False
        self._stepper, self._plan = stepper, plan
        self._fixed = plan.integrator == 'paper'
        self._past = _before(first.nodes, stepper.dt)
        self._at = self._level = self._calm = 0  # time in the shortest steps; halvings; steps
        self._steps: list[int] = []
        self._errors: list[float] = []
        self._samples: list[Floats] = []
        self._books = np.array([first.balance, first.potential, first.potential, first.kinetic,
                                first.balance])
        self._began = first.balance
        mesh = stepper.discretization
        self._noise = _NOISE * (np.abs(mesh.load).sum() * mesh.rod.length
                                + max(mesh.rod.stiffness[1:]) / mesh.rod.length)

    def run(self, reached: list[Instant], status: str = 'complete', message: str = '') -> Run:
        """Return the Run so far."""
        return Run(reached, self._steps, float(sum(self._errors)), status, message,
                   np.concatenate(self._samples) if self._samples else None)

    def go_on(self, progress: Progress) -> Leg:
        """Return the Leg of the next steps, which are entered here."""
        level = self._level
        last_try = level == HALVINGS or self._fixed
        leg = self._steps_of(level, last_try)
        if (leg.refused is not None and last_try and not self._fixed
                and self._stepper.discretization.surroundings.obstacles):
            leg = leg._replace(refused=None) if len(leg.errors) else self._longer(leg, progress)
        if leg.refused is not None:
            self.stuck = last_try
            self._level, self._calm = min(level + 1, HALVINGS), 0
        elif level and self._calm >= _CALM and self._at % (2 << (HALVINGS - level)) == 0:
            self._level, self._calm = level - 1, 0
        return leg

    def _longer(self, leg: Leg, progress: Progress) -> Leg:
        """Return the Leg of a step that is good though the shortest, of `leg`, is not, or `leg`.

        The shorter a step over obstacles is, the larger are the forces of what is pressed in, and
        the more sets of contacts are tried: a step that was too long for a few Newton steps, and
        ends elsewhere, may be found by many.
        """
        left = (1 << HALVINGS) - self._at % (1 << HALVINGS)  # until the next instant
        for level in range(HALVINGS - 1, _OF_CONTACT - 1, -1):
            if 1 << (HALVINGS - level) > left:
                break
            progress.check()
            longer = self._steps_of(level, True, 1)
            if len(longer.errors):
                return longer
        return leg

    def _steps_of(self, level: int, patient: bool, most: int = MOST) -> Leg:
        """Return the Leg of the next steps, `most` of them at most, which are entered here."""
        plan, stepper = self._plan, self._stepper
        scheme = plan.scheme(stepper.dt, level)
        now, books = self.now, self._books.copy()
        if self._steps and self._steps[-1] != level and not now.touched:
            fresh = renewed(stepper, now, scheme.dt)
            gained = fresh.balance - now.balance
            if gained <= max(self._began - now.balance, 0.0) + self._noise:  # else it is made up
                now = fresh
                given_back(books, now.balance, self._began)
        limits = Limits(
            MAX_ITERATIONS if patient else _PATIENCE,
            np.inf if level == HALVINGS or self._fixed else _PART * plan.tolerance, _GAIN,
            np.inf if self._fixed else self._noise, books, level >= _OF_CONTACT, self._began)
        size = 1 << (HALVINGS - level)
        count = min(most, self._length(size))
        places = (self._at + size * np.arange(1, count + 1)) / (1 << HALVINGS)
        leg = leg_of(stepper, now, self._past, places, scheme, limits)
        made = len(leg.errors)
        if made:
            self.now, self._past, self._books = leg.last, leg.past, books
            self._at += made * size
            self._steps += [level] * made
            self._errors += leg.errors.tolist()
            self._samples.append(leg.samples)
        rough = np.flatnonzero(8 * leg.errors >= _WELL_WITHIN * _PART * plan.tolerance)
        self._calm = made - 1 - int(rough[-1]) if rough.size else self._calm + made
        return leg

    def _length(self, size: int) -> int:
        """Return how many steps are to be made before their length may change."""
        most = min(MOST, (((self._plan.instants - 1) << HALVINGS) - self._at) // size)
        if not self._level:
            return most
        calm = max(_CALM - self._calm, 1)
        return min(most, calm + (self._at // size + calm) % 2)


def _before(nodes: KinematicState, dt: float) -> list[tuple[float, Floats]]:
    """Return two times with node positions, dt apart, as if they had moved on evenly till now."""
    return [(-k * dt, nodes.position - k * dt * nodes.velocity
             + 0.5 * (k * dt) ** 2 * nodes.acceleration) for k in (2, 1)]


def _reason(status: str, stepper: Stepper, now: Instant, place: float) -> str:
    times = f'from {now.place * stepper.dt:.6g} s to {place * stepper.dt:.6g} s'
    if status == 'energy':
        return f'a step {times} gains energy, however short it is'
    shape = now.shape
    return (f'the step {times} could not be solved, however short it is; before it the sharpest '
            f'bend was {np.abs(shape.element_strains).max():.3g} 1/m, '
            f'{len(shape.contacts)} contacts')


def _motion(stepper: Stepper, made: Run, tolerance: float,
            estimate: Callable[[], Floats] | None) -> Motion:
    reached, message = made.reached, made.message
    places = np.array([instant.place for instant in reached])
    if made.status == 'complete' and made.local > tolerance:
        message = (f'the local errors of its steps add up to {made.local:.3g} m, more than the '
                   f'tolerance of {tolerance:.3g} m: see error_estimate')
    given = {} if estimate is None else {'_estimate': estimate}
    kinetic, potential, work, losses = (
        np.array([getattr(instant, name) for instant in reached])
        for name in ('kinetic', 'potential', 'work', 'losses'))
    # a motion that is not complete is not converged
    shapes: Any = Boxed(len(reached), partial(_shapes, reached), made.status == 'complete')
    return Motion(
        stepper.dt * places, shapes,
        np.array([instant.velocities for instant in reached]), kinetic, potential, work,
        losses, tolerance, made.status, message, **given)


def _shapes(reached: list[Instant]) -> tuple[Shape, ...]:
    return tuple(instant.shape for instant in reached)
