# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One step of a motion: statics with inertia added, Eq. 12, 13 of the paper.

Nodes carry the mass, the strains are the unknowns: the same minimization as in statics, with one
term more. Damping is Rayleigh's: in proportion to mass (drag of a calm surrounding) and to
stiffness (Kelvin and Voigt); neither changes a shape at rest.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.contacts import Contact
from dlo_planner.direct.culling import acting_on
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.guide import Grips
from dlo_planner.direct.history import History
from dlo_planner.direct.instant import Instant
from dlo_planner.direct.integrator import KinematicState, Scheme
from dlo_planner.direct.leg import Leg, Limits, sampled, swung
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import (
    MAX_ITERATIONS,
    TOLERANCE,
    Search,
    shape_of,
    solve,
    unknown,
)
from dlo_planner.direct.trail import Coefficients
from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.inertia import Anchor
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.passage import passes_through
from dlo_planner.energy.plastic import yields
from dlo_planner.energy.potential import placed, unknowns_of
from dlo_planner.energy.system import System
from dlo_planner.minimize.decrement import settled
from dlo_planner.minimize.methods import search
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose

_ROUNDING = 1e-17    # of the residual, per inertia's strength relative to elasticity's
_ROUGHEST = 1e-7


class Task(NamedTuple):
    """What a step minimizes: its System, both grips, and what rounding leaves of a residual."""

    system: System
    gripper: Pose
    far_end: FarEnd | None
    rounding: float


class Stepper:
    """Makes the steps of one DLO in moving grips.

    Parameters
    ----------
    discretization : Discretization
    grips : Grips
    dt : float
        Time step in s, unit of `place`.
    method : str, optional
        One of METHODS, by which steps are minimized; beginnings are by Newton's.
    watched : ndarray, shape (m,) or None, optional
        Nodes whose places are recorded after each step. If None, some.
    """

    def __init__(self, discretization: Discretization, grips: Grips, dt: float,
                 method: str = 'newton', watched: Ints | None = None) -> None:
        self.discretization, self.grips, self.dt = discretization, grips, dt
        self.method = method
        self.watched = sampled(discretization.s) if watched is None else watched
        # whether one kernel makes steps, many at once, as long as nothing acts
        self.swings = (grips.far_end is None and method == 'newton' and discretization.free.hangs)
        rod = discretization.rod
        self.masses = node_masses(rod, discretization.s)
        # of the rod: 0.56 of the period of its slowest vibration, without tip mass
        self.own_time = np.sqrt((self.masses.sum() or 1.0) * rod.length**3
                                 / min(rod.stiffness[1:]))
        self._known: dict[Any, Coefficients] = {}  # of the Schemes so far

    def swings_from(self, now: Instant) -> bool:
        """Return whether nothing acts on the DLO at an Instant, nor has: then `along` goes on."""
        mesh = self.discretization
        if mesh.hangs or not self.swings:
            return self.swings
        if not now.free:
            return False
        strains, here = now.bends.position[None], now.nodes.position[None]
        return not acting_on(mesh, strains, here, here)[0]

    def step(self, before: Instant, place: float, scheme: Scheme,
             patience: int = MAX_ITERATIONS) -> Instant:
        """Return the Instant at `place`, one step of `scheme` later; converged or not.

        Once the DLO has touched an obstacle its forces may be impulses, of which a scheme that
        carries accelerations along would make energy: from then on steps are an implicit
        Euler's, of first order, which take the energy of impacts and some of vibrations.

        Parameters
        ----------
        patience : int, optional
            Newton steps after which it counts as not solved.
        """
        if scheme.first_order:
            return self._step(before, place, scheme, patience)
        if not (before.touched or before.shape.contacts):
            after = self._step(before, place, scheme, patience)
            if not after.shape.contacts:
                return after
        calm = replace(before, nodes=before.nodes.uniform(), bends=before.bends.uniform())
        euler = Scheme.named('euler', scheme.dt)
        return replace(self._step(calm, place, euler, patience), touched=True)

    def _step(self, before: Instant, place: float, scheme: Scheme, patience: int) -> Instant:
        if self.swings and self.discretization.hangs:
            leg = self.along(before, (), np.array([place]), scheme, Limits(patience))
            assert leg is not None  # nothing can act
            return leg.last if leg.refused is None else leg.refused
        after = self.step_from(before, place, scheme, self.guess(before, scheme.dt), patience)
        if after.shape.converged:
            return after
        if self.discretization.surroundings.obstacles:
            # from where the DLO is known to be outside of obstacles
            still = before.bends.position.copy()  # a Shape's are read-only, another type
            return self.step_from(before, place, scheme, still, patience)
        # rates change by vibrations too quick for the step, too, which tell nothing of its end
        evenly = before.bends.position + scheme.dt * before.bends.velocity
        return self.step_from(before, place, scheme, evenly, patience)

    def guess(self, before: Instant, dt: float) -> Floats:
        """Return the strains (N, 3) with which the search for those dt (s) later begins."""
        bends = before.bends
        if before.touched:  # an impact's acceleration is not the next step's
            return bends.position + dt * bends.velocity
        return bends.position + dt * (bends.velocity + 0.5 * dt * bends.acceleration)

    def step_from(self, before: Instant, place: float, scheme: Scheme, guess: Floats,
                  patience: int = MAX_ITERATIONS) -> Instant:
        """Return the Instant at `place`, for which the search begins with strains (N, 3)."""
        mesh, history, clear = self.discretization, before.shape.state.history, True
        system, gripper, far_end, rounding = self.moving(before.nodes, before.bends, history,
                                                         place, scheme)
        if mesh.surroundings.obstacles:
            clear = self._is_clear(system, before.shape, guess, gripper)
        q = np.empty((mesh.n_unknowns, 3))
        unknowns_of(system, guess, q)
        if self.method == 'newton':
            found = solve(mesh, system, gripper, q, history,
                          Search(patience if clear else 0, rounding=rounding))
        else:
            found = search(system, q, self.method, TOLERANCE + rounding)
        shape = shape_of(mesh, gripper, found, history, far_end, rounding)
        if not shape.converged and (true := settled(found)) is not found:
            shape = shape_of(mesh, gripper, true, history, far_end, rounding)
        shape = replace(shape, state=shape.state.estimating(unknown),
                        converged=shape.converged and clear)
        nodes = scheme.after(before.nodes, shape.positions)
        bends = scheme.after(before.bends, shape.element_strains)
        return self._after(before, place, scheme, replace(
            before, shape=shape, nodes=nodes, bends=bends, kinetic=self.kinetic(nodes.velocity)))

    def along(self, now: Instant, past: Sequence[Any], places: Floats, scheme: Scheme,
              limits: Limits) -> Leg | None:
        """Return the Leg of steps that end at `places` (n,), each the end of one of a Scheme.

        Only where it `swings_from` now. It ends before something acts; None if that is at once.

        Parameters
        ----------
        now : Instant
            Where they begin.
        past : sequence
            The last but one and the last pair of a time and node positions before; empty: not
            known, and no local errors.
        limits : Limits
            Until when to go on.
        """
        return swung(self, now, past, places, self.coefficients(scheme), limits)

    def rounding(self, scheme: Scheme) -> float:
        """Return how large a residual rounding errors may leave."""
        return min(_ROUNDING * scheme.stiffness * float(self.own_time**2), _ROUGHEST)

    def coefficients(self, scheme: Scheme, damping: Any = None) -> Coefficients:
        """Return the Coefficients of a Scheme; `damping` if it is not the rod's."""
        damping = self.discretization.rod.damping if damping is None else damping
        known = self._known.get((scheme, damping))
        if known is None:
            known = self._known[scheme, damping] = Coefficients(
                *(float(one) for one in (scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma,
                                         scheme.dt, scheme.stiffness, scheme.velocity_gain,
                                         scheme.third,
                                         *damping)), self.masses)
        return known

    def moving(self, nodes: KinematicState, bends: KinematicState, history: History | None,
               place: float,
               scheme: Scheme) -> Task:
        """Return the Task of a step."""
        grips = self.grips.at(place)
        system = self.moving_system(grips, history, (nodes, bends), scheme,
                                    self.discretization.rod.damping)
        return Task(system, *grips, self.rounding(scheme))

    def _is_clear(self, system: System, old: Shape, strains: Floats, gripper: Pose) -> bool:
        """Whether nothing is run through by the Shape `old` as it is when the gripper goes on."""
        new, shift = placed(system, strains), gripper.position
        return not passes_through(system.scene, system.lengths, old.element_strains.copy(),
                                  old.frames.copy(), old.positions - shift, new.rotations,
                                  new.positions)

    def _after(self, before: Instant, place: float, scheme: Scheme, there: Instant) -> Instant:
        """Return the Instant `there`, at `place`, with its energy accounted for."""
        shape = there.shape
        power = self.grips.power(place, shape.gripper_wrench, shape.far_wrench,
                                 shape.positions[-1])
        half = 0.5 * scheme.dt
        work = half * (before.power + power)
        if scheme.first_order:  # its forces are the same all the step long
            then = self.grips.power(before.place, shape.gripper_wrench, shape.far_wrench,
                                    shape.positions[-1])
            work = half * (then + power)
        losses = before.losses + (self._damped(before, there, scheme.dt),
                                  shape.dissipated - before.shape.dissipated,
                                  _rubbed(before.shape, shape))
        return replace(there, place=place, potential=shape.energy, work=before.work + work,
                       power=power, losses=losses,
                       pushed=before.pushed + _pushed(before.shape, shape))

    def moving_system(self, grips: tuple[Pose, FarEnd | None], history: History | None,
                      courses: tuple[KinematicState, KinematicState], scheme: Scheme,
                      damping: Any) -> System:
        """Return the System of a step: the static one, with inertia and damping."""
        mesh, (gripper, far_end), (nodes, bends) = self.discretization, grips, courses
        drag, viscosity = damping
        where, velocity = scheme.anchor(nodes)
        strength = scheme.stiffness + drag * scheme.velocity_gain
        anchor = where - drag * velocity / strength - gripper.position
        system = mesh.system(gripper.rotation, gripper.position, history, far_end)
        system = system._replace(anchor=Anchor(anchor, self.masses * strength))
        return system if viscosity == 0.0 else _viscous(system, bends, viscosity, scheme)

    def kinetic(self, velocity: Floats) -> float:
        """Return the kinetic energy, J."""
        return 0.5 * float(self.masses @ np.sum(velocity**2, axis=1))

    def _damped(self, before: Instant, there: Instant, dt: float) -> float:
        """Return the energy that damping takes at least in a step, J, see `swinging.damped`."""
        damping: Any = self.discretization.rod.damping
        (drag, viscosity), system = damping, self.discretization.static
        moved, bent = (other.position - one.position for one, other in
                       ((before.nodes, there.nodes), (before.bends, there.bends)))
        slow = float(self.masses @ np.sum(moved**2, axis=1))
        quick = float(np.sum(system.lengths[:, None] * system.stiffness * bent**2))
        return float(drag * slow + viscosity * quick) / dt


def _viscous(system: System, bends: KinematicState, viscosity: float, scheme: Scheme) -> System:
    """Return a System with damping of its strains.

    K b u' with u' = rate + velocity_gain (u - bent) is a spring of its own, drawn to where u' = 0.
    """
    bent, rate = scheme.anchor(bends)
    firm = viscosity * scheme.velocity_gain
    calm = bent - rate / scheme.velocity_gain
    if not yields(system.plastic):  # two springs make one
        natural = (system.natural + firm * calm) / (1 + firm)
        return system._replace(natural=natural, stiffness=system.stiffness * (1 + firm))
    # here it is one with what never yields
    elastic = with_couples(system.elastic, firm * system.stiffness * (calm - system.natural))
    return system._replace(elastic=elastic._replace(part=elastic.part + firm))


def _pushed(before: Shape, after: Shape) -> float:
    """Return the work that contacts have done between two Shapes, J, 0 where they took some.

    A force across the end of a chord has a part along it, where the DLO slides on a convex
    obstacle; an impact's takes energy.
    """
    return max(0.0, sum(float(contact.force * (contact.normal @ _moved(before, contact)))
                        for contact in after.contacts))


def _moved(before: Shape, contact: Contact) -> Floats:
    """Return how far the point of a Contact has moved since `before`, (3,), m."""
    moved: Floats = contact.position - before.frame_at(contact.s)[1]
    return moved


def _rubbed(before: Shape, after: Shape) -> float:
    """Return the work done against friction between two Shapes, J."""
    return sum(float(contact.friction @ -_moved(before, contact))
               for contact in after.contacts if contact.friction.any())
