# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a motion is from the true one: it is made again, every element and every step halved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_planner.direct.instant import Instant
from dlo_planner.direct.integrator import Scheme
from dlo_planner.direct.leg import MOST, Leg, Limits, leg_of
from dlo_planner.direct.setting_off import begin, renewed
from dlo_planner.direct.statics import equilibrium
from dlo_planner.direct.stepping import Stepper
from dlo_planner.energy.potential import placed
from dlo_planner.model.arrays import Floats

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization
    from dlo_planner.direct.shape import Shape

HALVINGS = 12  # of an interval between two instants, at most
_SHORTER = 4   # halvings of a step of the finer motion that is not solved
_STILL = 1e-7  # of the length: what moves no farther rests


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
    steps : tuple of int
        Numbers of halvings of the steps made, in their order.
    """

    instants: int
    integrator: str
    tolerance: float
    steps: tuple[int, ...] = ()

    def scheme(self, dt: float, halvings: int) -> Scheme:
        """Return the Scheme of a step of dt (s), halved so often."""
        return Scheme.named(self.integrator, dt / (1 << halvings))


class Begun(NamedTuple):
    """How a motion begins: the Shape that was given, if any, that on its mesh, velocities."""

    initial: Shape | None
    start: Shape
    velocity: Floats | None


class Trace(NamedTuple):
    """Where a motion was: places of the instants, positions there, samples (see `Leg`)."""

    places: list[float]
    positions: list[Floats]
    samples: Floats | None


def error_of(stepper: Stepper, begun: Begun, plan: Recipe, trace: Trace) -> Floats:
    """Return (n,) how far, in m, nodes are from the true ones at most until each instant.

    Looked at are all nodes at the instants and some of them after each step. What halving
    everything changes is three quarters of a second-order error, half of a first-order one
    (Richardson's extrapolation).
    """
    coarse = stepper.discretization
    mesh = coarse.finer
    finer = Stepper(mesh, stepper.grips, stepper.dt, watched=2 * stepper.watched)
    velocity = begun.velocity
    if velocity is not None:
        velocity = np.column_stack([np.interp(mesh.s, coarse.s, one) for one in velocity.T])
    now = begin(finer, finer_start(mesh, begun), velocity)
    found = np.full(len(trace.places), np.inf)
    found[0] = worst = _apart(now.nodes.position[::2], trace.positions[0])
    made = at = 0  # steps, and time in the shortest ones
    for level, steps in groupby(plan.steps):
        left, size = 2 * len(list(steps)), 1 << (HALVINGS - level)
        scheme = plan.scheme(stepper.dt, level + 1)
        if made and not now.touched:
            now = renewed(finer, now, scheme.dt)
        while left:
            places = (at + size * np.arange(1, min(left, MOST) + 1)) / (2 << HALVINGS)
            leg = leg_of(finer, now, (), places, scheme, Limits())
            if leg.refused is not None and not leg.errors.size:
                leg = _in_parts(finer, now, float(places[0]), scheme)
            if not leg.errors.size:
                return _estimate(coarse, plan, found)
            count = len(leg.errors)
            ends = np.arange(1 - made % 2, count, 2)  # two of these are one of the others
            if trace.samples is not None and ends.size:
                worst = max(worst, _apart(leg.samples[ends], trace.samples[(made + ends) // 2]))
            for instant in leg.kept:
                k = round(instant.place)
                worst = found[k] = max(worst, _apart(instant.nodes.position[::2],
                                                     trace.positions[k]))
            now, made, at, left = leg.last, made + count, at + size * count, left - count
    if now.place == trace.places[-1]:  # of one that ended early, between two instants
        found[-1] = max(worst, _apart(now.nodes.position[::2], trace.positions[-1]))
    return _estimate(coarse, plan, found)


def _in_parts(stepper: Stepper, now: Instant, place: float, scheme: Scheme) -> Leg:
    """Return the Leg of one step that is not solved at once, made in shorter ones.

    Its errors are empty if it is not solved so either.
    """
    for halvings in range(1, _SHORTER + 1):
        parts = 1 << halvings
        brief = replace(scheme, dt=scheme.dt / parts)
        begun = now if now.touched else renewed(stepper, now, brief.dt)
        last = begun
        for at in now.place + (place - now.place) * np.arange(1, parts + 1) / parts:
            leg = leg_of(stepper, last, (), np.array([at]), brief, Limits())
            if leg.refused is not None:
                break
            last = leg.last
        if leg.refused is None:
            last = last if last.touched else renewed(stepper, last, scheme.dt)
            return leg._replace(kept=[last] if place == round(place) else [], last=last)
    return leg._replace(errors=np.zeros(0))


def _estimate(coarse: Discretization, plan: Recipe, found: Floats) -> Floats:
    """Return the errors (n,) that differences `found` (n,) from a finer motion tell, m."""
    rounding = 1e-15 * coarse.s.size * coarse.s[-1]
    second = plan.integrator != 'paper' and not coarse.surroundings.obstacles
    errors: Floats = (4 / 3 if second else 2.0) * np.maximum.accumulate(found) + rounding
    return errors


def _apart(one: Floats, other: Floats) -> float:
    """Return the largest distance between places (..., 3), m."""
    return float(np.linalg.norm(one - other, axis=-1).max())


def finer_start(mesh: Discretization, begun: Begun) -> Shape:
    """Return the Shape at time 0 on a mesh whose elements are halves of those of the motion.

    A DLO at rest hangs otherwise there: this is a part of the error, and no reason to swing. So is
    one that was at rest in other surroundings, as `initial` may have been.
    """
    start = begun.start
    strains = _at_rest_on(begun.initial or start, mesh)
    if strains is None:
        strains = np.repeat(start.element_strains, 2, axis=0)
    state = replace(start.state, mesh=mesh, history=mesh.past(start.state.history))
    there = placed(mesh.system(start.gripper.rotation), strains)
    return replace(start, s=mesh.s, element_strains=strains, frames=there.rotations,
                   positions=there.positions + start.gripper.position, state=state)


def _at_rest_on(shape: Shape, mesh: Discretization) -> Floats | None:
    """Return the strains (N, 3) on a mesh with which a Shape rests; None: it does not rest."""
    own = shape.state.mesh
    if own is None:
        return None
    coarse, fine = (
        equilibrium(each, shape.gripper, strains, 'newton', each.past(shape.state.history),
                    shape.far_end)[0]
        for each, strains in ((own, np.array(shape.element_strains)),
                              (own.finer, np.repeat(shape.element_strains, 2, axis=0))))
    moved = np.abs(coarse.positions - shape.positions).max()
    if not (coarse.converged and fine.converged and moved <= _STILL * own.s[-1]):
        return None
    result: Floats = mesh.strains_from(fine.s, fine.element_strains)
    return result
