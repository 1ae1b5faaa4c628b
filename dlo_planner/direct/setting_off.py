# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How a DLO moves when its steps begin: velocities and accelerations that grips and forces allow.

They come from very short steps, ahead and back.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from dlo_planner.direct.history import History
from dlo_planner.direct.instant import Instant, There
from dlo_planner.direct.integrator import KinematicState, Scheme
from dlo_planner.direct.leg import set_going
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import Search, solve, unknown
from dlo_planner.direct.stepping import Stepper
from dlo_planner.energy.potential import placed, unknowns_of
from dlo_planner.energy.system import tip_wrench
from dlo_planner.model.arrays import Floats

_AT_FIRST = 0.1      # of a step: it may be halved yet
_BRIEF = 1e-1, 1e-3  # of a step, of the DLO's own time: how long it is watched
_BRIEFEST = 3e-5     # of that time: of what is watched for less rounding errors would count
_AT_ONCE = 1e-13     # of the length: how exactly grips are kept in so short a time


def begin(stepper: Stepper, shape: Shape, velocity: Floats | None = None) -> Instant:
    """Return the Instant at time 0 of a DLO that is free to move from now on.

    Its acceleration is what a very short first step, of constant acceleration, finds.

    Parameters
    ----------
    stepper : Stepper
    shape : Shape
    velocity : ndarray, shape (N + 1, 3), optional
        Velocities of the nodes, m/s. If None, at rest.
    """
    strains = np.array(shape.element_strains)
    here = placed(stepper.discretization.system(shape.gripper.rotation), strains)
    positions = here.positions + shape.gripper.position
    rest = np.zeros_like(positions), np.zeros_like(strains)
    nodes, bends = (KinematicState.begun(where, still, still) for where, still in
                    zip((positions, here.strains), rest, strict=True))
    begun = Instant(0.0, replace(shape, state=shape.state.estimating(unknown)), nodes, bends,
                    0.0, shape.energy, 0.0, 0.0, np.zeros(3))
    if velocity is not None:
        begun = begun.changed(nodes=replace(nodes, velocity=np.array(velocity)))
    return _let_go(stepper, begun, _AT_FIRST * stepper.dt, velocity is not None)


def renewed(stepper: Stepper, instant: Instant, dt: float) -> Instant:
    """Return an Instant with the velocities and accelerations that its grips and forces allow.

    A scheme that keeps the length by positions alone carries small parts of both along that do not:
    harmless as long as the steps stay the same, not where they change. What that makes wrong is of
    second order in the steps of dt (s) that follow, as the scheme is.
    """
    return _let_go(stepper, instant, dt, True)


def _let_go(stepper: Stepper, instant: Instant, dt: float, going: bool) -> Instant:
    """Return an Instant with the accelerations that its grips and forces allow before steps of dt.

    If `going`, with such velocities, too.
    """
    short = max(_BRIEF[0] * dt, _BRIEFEST * stepper.own_time)
    brief = Scheme.named('paper', min(short, _BRIEF[1] * stepper.own_time))
    if stepper.swings_from(instant):
        return set_going(stepper, instant, brief, going)
    watch = _Watch(stepper, brief, instant.place * stepper.dt, instant.shape.state.history)
    nodes, bends = instant.nodes.uniform(), instant.bends.uniform()
    if going:
        nodes, bends = watch.set_going(nodes, bends, nodes.velocity)
    return watch.accelerated(instant, nodes, bends)


class _Watch:
    """Watches a DLO for a very short time, by a Scheme of such steps.

    Parameters
    ----------
    stepper : Stepper
    brief : Scheme
    time : float
        Now, s.
    history : History or None
        What the DLO remembers.
    """

    def __init__(self, stepper: Stepper, brief: Scheme, time: float,
                 history: History | None) -> None:
        self._stepper, self._brief, self._time, self._history = stepper, brief, time, history

    def accelerated(self, instant: Instant, nodes: KinematicState,
                    bends: KinematicState) -> Instant:
        """Return an Instant with these KinematicStates, and accelerations."""
        stepper, brief = self._stepper, self._brief
        damping: Any = stepper.discretization.rod.damping
        there = self._shortly(nodes, bends, 1.0, damping)
        nodes, bends = (
            KinematicState.begun(one.position, one.velocity, brief.after(one, ahead).acceleration)
            for one, ahead in ((nodes, there.positions), (bends, there.strains)))
        power = stepper.grips.power(instant.place, there.wrench, there.far_wrench,
                                    nodes.position[-1])
        return replace(instant, nodes=nodes, bends=bends, power=power,
                       kinetic=stepper.kinetic(nodes.velocity))

    def set_going(self, nodes: KinematicState, bends: KinematicState,
                  velocity: Floats) -> tuple[KinematicState, KinematicState]:
        """Return KinematicStates with the velocities nearest to `velocity` that the grips allow."""
        # what damps acts against either way: it would not cancel
        ahead, back = (self._shortly(replace(nodes, velocity=sign * velocity), bends.uniform(),
                                     sign, (0.0, 0.0)) for sign in (1.0, -1.0))
        double = 2 * self._brief.dt
        return (replace(nodes, velocity=(ahead.positions - back.positions) / double),
                replace(bends, velocity=(ahead.strains - back.strains) / double))

    def _shortly(self, nodes: KinematicState, bends: KinematicState, sign: float,
                 damping: tuple[float, float]) -> There:
        """Return what is There a very short time later (sign = 1) or before (-1)."""
        stepper, brief = self._stepper, self._brief
        mesh, place = stepper.discretization, (self._time + sign * brief.dt) / stepper.dt
        grips = gripper, _ = stepper.grips.at(place)
        system = stepper.moving_system(grips, self._history, (nodes, bends), brief, damping)
        q = np.empty((mesh.n_unknowns, 3))
        unknowns_of(system, bends.position.copy(), q)
        state = solve(mesh, system, gripper, q, self._history,
                      Search(exact=_AT_ONCE, rounding=stepper.rounding(brief))).state
        return There(state.positions + gripper.position, state.strains,
                     np.concatenate([state.base_force, state.base_moment]), -tip_wrench(state))
