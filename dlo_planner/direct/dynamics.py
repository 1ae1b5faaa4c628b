# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion of the DLO under moving grips, in steps as long as their error and the energy allow."""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.beginning import check_velocity
from dlo_planner.direct.integrator import Scheme
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.statics import MAX_ITERATIONS, equilibrium
from dlo_planner.direct.stepping import Instant, Stepper

_HALVINGS = 12       # of an interval between two instants, at most
_PATIENCE = 60       # Newton steps after which it is better to halve the step
_NOISE = 1e-5        # of weight times length and of a bend by 1 rad: the same, at rest
_PART = 1 / 600      # of the tolerance: what one step may add to the error
_WELL_WITHIN = 0.6   # of that: a step of twice the length, with 8 times the error, may be tried
_CALM = 16           # steps that all were well within, before it is
_OF_CONTACT = 3      # halvings for its error of a step since the DLO touched an obstacle
_STILL = 1e-7        # of the length: what moves no farther rests
_GAIN = 1e-3         # of the energy that has moved: what a motion may gain by rounding and errors


class Run(NamedTuple):
    """What the steps of a motion came to.

    Attributes
    ----------
    reached : list of Instant
        Instants at 0, 1, 2 ...; the last one is the one that was not solved.
    steps : list of int
        Halvings of all steps.
    local : float
        Sum of their local errors, m.
    status : str
        Status of `Motion`.
    message : str
        Message of `Motion`.
    """

    reached: list[Instant]
    steps: list[int]
    local: float
    status: str = 'complete'
    message: str = ''


@dataclass(frozen=True)
class Recipe:
    """What a motion was computed with, so that it can be repeated.

    Attributes
    ----------
    instants : int
        Number of instants.
    integrator : str
        One of INTEGRATORS.
    tolerance : float
        Tolerance in m; infinite: only what cannot be solved or gains energy is halved.
    steps : tuple
        Numbers of halvings of the steps made, in their order.
    """

    instants: int
    integrator: str
    tolerance: float
    steps: tuple = ()


def simulate(stepper, start, velocity, instants, integrator, tolerance, progress, initial):
    """Return the Motion that begins with the Shape `start`; see `DirectSimulator.simulate`.

    Parameters
    ----------
    stepper
        Stepper.
    velocity
        (N + 1, 3) of the nodes, or None: at rest.
    progress
        Progress.
    initial
        Shape of which `start` was made, or None: it is an equilibrium.
    """
    first = stepper.begin(start, velocity)
    if velocity is not None:
        check_velocity(stepper.masses, velocity, first.nodes.velocity)
    if not start.converged:
        ended = Run([first], [], 0.0, 'unsolved', 'the shape at time 0 was not found')
        return _motion(stepper, ended, tolerance, None)
    plan = Recipe(instants, integrator, tolerance)
    made = _run(stepper, first, plan, progress)
    estimate = partial(_error, stepper, start, initial, velocity,
                       replace(plan, steps=tuple(made.steps)),
                       [instant.place for instant in made.reached],
                       [instant.shape.positions for instant in made.reached])
    return _motion(stepper, made, tolerance, estimate)


def run(stepper, first, instants, tolerance, progress):
    """Return the Instants at 0, 1, 2 ... of a motion that goes on from `first`.

    And whether all steps were solved; the last Instant is the one that was not.
    """
    plan = Recipe(instants, 'generalized_alpha', tolerance)
    made = _run(stepper, first, plan, progress)
    return made.reached, made.status == 'complete'


def _run(stepper, first, plan, progress):
    """Return the Run that begins with the Instant `first`."""
    whole = 1 << _HALVINGS
    now, past = first, _before(first.nodes, stepper.dt)
    reached, steps, local, level, calm = [first], [], 0.0, 0, 0
    books = _Books(first, stepper.discretization)
    while len(reached) < plan.instants:
        begin, at = len(reached) - 1, 0
        while at < whole:
            size = whole >> level
            place = begin + (at + size) / whole
            last_try = level == _HALVINGS or plan.integrator == 'paper'
            after = _step(stepper, now, steps, level, place, plan.integrator,
                          MAX_ITERATIONS if last_try else _PATIENCE)
            progress.check()
            tail = [*past, (place * stepper.dt, after.nodes.position)]
            error = _scheme(stepper, plan.integrator, level).error(*zip(*tail, strict=True))
            if not last_try and not (after.shape.converged and books.hold(after)
                                     and (error <= _PART * plan.tolerance
                                          or after.touched and level >= _OF_CONTACT)):
                level, calm = level + 1, 0
                continue
            if not (after.shape.converged
                    and (books.hold(after) or plan.integrator == 'paper')):
                status = 'energy' if after.shape.converged else 'unsolved'
                after = replace(after, shape=replace(after.shape, converged=False))
                return Run([*reached, after], steps, local, status,
                           _reason(status, stepper, now, place))
            books.enter(after)
            local += error
            steps.append(level)
            now, past = after, tail[1:]
            at += size
            calm = calm + 1 if 8 * error < _WELL_WITHIN * _PART * plan.tolerance else 0
            if level and at % (2 * size) == 0 and calm >= _CALM:
                level, calm = level - 1, 0
        reached.append(now)
        progress.done(len(reached), plan.instants)
    return Run(reached, steps, local)


def _step(stepper, now, steps, level, place, integrator, patience):
    scheme = _scheme(stepper, integrator, level)
    if (steps[-1] if steps else 0) != level and not now.touched:
        now = stepper.renewed(now, scheme.dt)
    return stepper.step(now, place, scheme, patience)


def _scheme(stepper, integrator, level):
    return Scheme.named(integrator, stepper.dt / (1 << level))


def _before(nodes, dt):
    """Return three times with node positions, the last one now, as if it had moved on evenly."""
    return [(-k * dt, nodes.position - k * dt * nodes.velocity
             + 0.5 * (k * dt) ** 2 * nodes.acceleration) for k in (2, 1, 0)]


class _Books:
    """Says whether a motion gains energy: of that which has moved so far, at most a small part."""

    def __init__(self, first, mesh):
        self._noise = _NOISE * (np.abs(mesh.load).sum() * mesh.rod.length
                                + max(mesh.rod.stiffness[1:]) / mesh.rod.length)
        self._least = first.balance
        self._low = self._high = first.potential
        self._most = first.kinetic

    def enter(self, instant):
        """Take an Instant as one of the motion."""
        self._least = min(self._least, instant.balance)
        self._low = min(self._low, instant.potential)
        self._high = max(self._high, instant.potential)
        self._most = max(self._most, instant.kinetic)

    def hold(self, instant):
        """Whether an Instant has no more energy than there can be."""
        moved = (max(self._most, instant.kinetic) + max(self._high, instant.potential)
                 - min(self._low, instant.potential) + instant.losses.sum())
        return instant.balance - self._least <= _GAIN * moved + self._noise


def _reason(status, stepper, now, place):
    times = f'from {now.place * stepper.dt:.6g} s to {place * stepper.dt:.6g} s'
    if status == 'energy':
        return f'a step {times} gains energy, however short it is'
    shape = now.shape
    return (f'the step {times} could not be solved, however short it is; before it the sharpest '
            f'bend was {np.abs(shape.element_strains).max():.3g} 1/m, '
            f'{len(shape.contacts)} contacts')


def _motion(stepper, made, tolerance, estimate):
    reached, message = made.reached, made.message
    places = np.array([instant.place for instant in reached])
    if made.status == 'complete' and made.local > tolerance:
        message = (f'the local errors of its steps add up to {made.local:.3g} m, more than the '
                   f'tolerance of {tolerance:.3g} m: see error_estimate')
    given = {} if estimate is None else {'_estimate': estimate}
    return Motion(
        stepper.dt * places, [instant.shape for instant in reached],
        np.array([instant.nodes.velocity for instant in reached]),
        *(np.array([getattr(instant, name) for instant in reached])
          for name in ('kinetic', 'potential', 'work', 'losses')),
        tolerance, made.status, message, **given)


def _error(stepper, start, initial, velocity, plan, places, positions):
    """Return (n,) how far, in m, nodes are from the true ones at most until each instant.

    The same motion with every element and every step halved; what that changes is three quarters
    of a second-order error, half of a first-order one.
    """
    coarse = stepper.discretization
    mesh = coarse.finer
    finer = Stepper(mesh, stepper.grips, stepper.dt)
    shape = _finer_start(mesh, start, initial)
    if velocity is not None:
        velocity = np.column_stack([np.interp(mesh.s, coarse.s, one) for one in velocity.T])
    found = np.full(len(places), np.inf)
    now = finer.begin(shape, velocity)
    found[0] = np.linalg.norm(now.nodes.position[::2] - positions[0], axis=1).max()
    whole, at, k, before = 2 << _HALVINGS, 0, 1, []
    for level in plan.steps:
        for _ in range(2):
            at += whole >> (level + 1)
            now = _step(finer, now, before, level + 1, at / whole, plan.integrator, MAX_ITERATIONS)
            before = [level + 1]
            if not now.shape.converged:
                return found
        if at == k * whole:
            found[k] = np.linalg.norm(now.nodes.position[::2] - positions[k], axis=1).max()
            k += 1
    rounding = 1e-15 * coarse.s.size * coarse.s[-1]
    second = plan.integrator != 'paper' and not coarse.surroundings.obstacles
    return (4 / 3 if second else 2.0) * np.maximum.accumulate(found) + rounding


def _finer_start(mesh, start, initial):
    """Return the Shape at time 0 on a mesh whose elements are halves of those of `start`.

    A DLO at rest hangs otherwise there: this is a part of the error, and no reason to swing. So is
    one that was at rest in other surroundings, as `initial` may have been.
    """
    known = start if initial is None else initial
    strains = _at_rest_on(known, mesh)
    if strains is None:
        strains = np.repeat(start.element_strains, 2, axis=0)
    state = replace(start.state, mesh=mesh, history=mesh.past(start.state.history))
    return replace(start, element_strains=strains, state=state)


def _at_rest_on(shape, mesh):
    """Return the strains (N, 3) on a mesh with which a Shape rests; None: it does not rest."""
    own = shape.state.mesh
    if own is None:
        return None
    found = [equilibrium(each, shape.gripper, strains, 'newton', each.past(shape.state.history),
                         shape.far_end)[0]
             for each, strains in ((own, np.array(shape.element_strains)),
                                   (own.finer, np.repeat(shape.element_strains, 2, axis=0)))]
    moved = np.abs(found[0].positions - shape.positions).max()
    if not (found[0].converged and found[1].converged and moved <= _STILL * own.s[-1]):
        return None
    return mesh.strains_from(found[1].s, found[1].element_strains)
