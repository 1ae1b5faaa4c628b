# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One step of a motion: statics with inertia added, Eq. 12, 13 of the paper.

Nodes carry the mass, the strains are the unknowns: the same minimization as in statics, with one
term more. Damping is Rayleigh's: in proportion to mass (drag of a calm surrounding) and to
stiffness (Kelvin and Voigt); neither changes a shape at rest.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dlo_planner.direct.guide import Grips
from dlo_planner.direct.integrator import Course, Scheme
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.statics import (
    MAX_ITERATIONS,
    TOLERANCE,
    hanging_shape,
    shape_of,
    solve,
    unknown,
)
from dlo_planner.direct.swinging import Coefficients, swing
from dlo_planner.energy.elastic import with_couples
from dlo_planner.energy.inertia import Anchor
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.passage import passes_through
from dlo_planner.energy.plastic import yields
from dlo_planner.energy.potential import placed, unknowns_of
from dlo_planner.energy.system import System, tip_wrench
from dlo_planner.minimize.methods import search
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose

_BRIEF = 1e-1, 1e-3  # of a step, of the DLO's own time: how long it is watched at the beginning
_BRIEFEST = 3e-5     # of that time: of what is watched for less rounding errors would count
_ROUNDING = 1e-17    # of the residual, per inertia's strength relative to elasticity's
_ROUGHEST = 1e-7
_AT_ONCE = 1e-13     # of the length: how exactly grips are kept in so short a time


@dataclass(frozen=True)
class Instant:
    """All that the rest of a motion depends on, and what has become of the energy.

    Attributes
    ----------
    place : float
        Time / dt.
    shape : Shape
    nodes : Course
        Their (N + 1, 3) positions.
    bends : Course
        The (N, 3) strains of the elements.
    kinetic : float
        Kinetic energy, J.
    potential : float
        Potential energy, J.
    work : float
        Work done by the grips so far, J.
    power : float
        Power of the grips now, W.
    losses : ndarray, shape (3,)
        Energy lost to damping, plasticity and friction so far, J.
    damping : float
        Power taken by damping now, W.
    touched : bool
        Whether the DLO has touched an obstacle.
    """

    place: float
    shape: Shape
    nodes: Course
    bends: Course
    kinetic: float
    potential: float
    work: float
    power: float
    losses: np.ndarray
    damping: float
    touched: bool = False

    @property
    def balance(self) -> float:
        """Energy that is there, less what was put in, plus what was taken out, J."""
        return self.kinetic + self.potential - self.work + self.losses.sum()


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
    discretization
        Discretization.
    grips : Grips
    dt
        Time step in s, unit of `place`.
    method
        One of METHODS, by which steps are minimized; beginnings are by Newton's.
    """

    def __init__(self, discretization, grips: Grips, dt, method='newton'):
        self.discretization, self.grips, self.dt = discretization, grips, dt
        self.method = method
        rod = discretization.rod
        self.masses = node_masses(rod, discretization.s)
        # of the rod: 0.56 of the period of its slowest vibration, without tip mass
        self._own_time = np.sqrt((self.masses.sum() or 1.0) * rod.length**3
                                 / min(rod.stiffness[1:]))
        self._known = {}  # Coefficients of the Schemes so far

    def step(self, before, place, scheme, patience=MAX_ITERATIONS):
        """Return the Instant at `place`, one step of `scheme` later; converged or not.

        Once the DLO has touched an obstacle its forces may be impulses, of which a scheme that
        carries accelerations along would make energy: from then on steps are an implicit
        Euler's, of first order, which take the energy of impacts and some of vibrations.

        Parameters
        ----------
        patience
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

    def _step(self, before, place, scheme, patience):
        gripper, far_end = self.grips.at(place)
        if self.discretization.hangs and far_end is None and self.method == 'newton':
            return self._swung(before, place, scheme, gripper, patience)
        return self.step_from(before, place, scheme, self.guess(before, scheme.dt), patience)

    def guess(self, before, dt):
        """Return the strains (N, 3) with which the search for those dt (s) later begins."""
        bends = before.bends
        if self.discretization.surroundings.obstacles:
            # where the DLO is known to be outside of obstacles
            return bends.position.copy()  # a Shape's are read-only, another type for kernels
        return bends.position + dt * (bends.velocity + 0.5 * dt * bends.acceleration)

    def step_from(self, before, place, scheme, guess, patience=MAX_ITERATIONS):
        """Return the Instant at `place`, for which the search begins with strains (N, 3)."""
        mesh, history, clear = self.discretization, before.shape.state.history, True
        system, gripper, far_end, rounding = self.moving(before.nodes, before.bends, history,
                                                         place, scheme)
        if mesh.surroundings.obstacles:
            clear = self._is_clear(system, before.shape, guess, gripper)
        q = np.empty((mesh.n_unknowns, 3))
        unknowns_of(system, guess, q)
        if self.method == 'newton':
            found = solve(mesh, system, gripper, q, history, patience if clear else 0,
                          rounding=rounding)
        else:
            found = search(system, q, self.method, TOLERANCE + rounding)
        shape = shape_of(mesh, gripper, found, history, far_end, rounding)
        shape = replace(shape, state=shape.state.estimating(unknown),
                        converged=shape.converged and clear)
        nodes = scheme.after(before.nodes, shape.positions)
        bends = scheme.after(before.bends, shape.element_strains)
        return self._after(before, place, scheme, replace(
            before, shape=shape, nodes=nodes, bends=bends, kinetic=self._kinetic(nodes.velocity),
            damping=self._damping(nodes.velocity, bends.velocity)))

    def _swung(self, before, place, scheme, gripper, patience):
        """Return the Instant of a DLO that hangs freely."""
        mesh = self.discretization
        rounding = self._rounding(scheme)
        found, nodes, bends, kinetic, damping = swing(
            mesh.static, gripper.rotation, gripper.position, self._coefficients(scheme),
            before.nodes.arrays, before.bends.arrays, TOLERANCE + rounding, patience, True)
        shape = hanging_shape(mesh, gripper, found, rounding)
        return self._after(before, place, scheme, replace(
            before, shape=shape, nodes=Course(shape.positions, *nodes),
            bends=Course(shape.element_strains, *bends), kinetic=kinetic, damping=damping))

    def _rounding(self, scheme):
        """Return how large a residual rounding errors may leave."""
        return min(_ROUNDING * scheme.stiffness * self._own_time**2, _ROUGHEST)

    def _coefficients(self, scheme):
        """Return the Coefficients of a Scheme."""
        known = self._known.get(scheme)
        if known is None:
            known = self._known[scheme] = Coefficients(
                *(float(one) for one in (scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma,
                                         scheme.dt, scheme.stiffness, scheme.drag,
                                         *self.discretization.rod.damping)), self.masses)
        return known

    def moving(self, nodes, bends, history, place, scheme):
        """Return the Task of a step."""
        gripper, far_end = self.grips.at(place)
        system = self._moving(gripper, far_end, history, nodes, bends, scheme)
        return Task(system, gripper, far_end, self._rounding(scheme))

    def _is_clear(self, system, old, strains, gripper):
        """Whether nothing is run through by the Shape `old` as it is when the gripper goes on."""
        new, shift = placed(system, strains), gripper.position
        return not passes_through(system.scene, system.lengths, old.element_strains.copy(),
                                  old.frames.copy(), old.positions - shift, new.rotations,
                                  new.positions)

    def _after(self, before, place, scheme, there):
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
        losses = before.losses + (half * (before.damping + there.damping),
                                  shape.dissipated - before.shape.dissipated,
                                  _rubbed(before.shape, shape))
        return replace(there, place=place, potential=shape.energy, work=before.work + work,
                       power=power, losses=losses)

    def begin(self, shape, velocity=None):
        """Return the Instant at time 0 of a DLO that is free to move from now on.

        Its acceleration is what a very short first step, of constant acceleration, finds.

        Parameters
        ----------
        shape
            Shape.
        velocity
            (N + 1, 3) of the nodes, m/s. If None, at rest.
        """
        mesh = self.discretization
        brief = self._brief(self.dt)
        strains = np.array(shape.element_strains)
        here = placed(mesh.system(shape.gripper.rotation), strains)
        positions = here.positions + shape.gripper.position
        rest = np.zeros_like(positions), np.zeros_like(strains)
        nodes, bends = (Course.begun(where, still, still) for where, still in
                        zip((positions, here.strains), rest, strict=True))
        if velocity is not None:
            nodes, bends = self._set_going(nodes, bends, shape.state.history, velocity, brief, 0.0)
        nodes, bends, state = self._accelerated(nodes, bends, shape.state.history, brief, 0.0)
        begun = Instant(0.0, replace(shape, state=shape.state.estimating(unknown)), nodes, bends,
                        0.0, shape.energy, 0.0, 0.0, np.zeros(3), 0.0)
        return self._with(begun, nodes, bends, state)

    def renewed(self, instant, dt):
        """Return an Instant with the velocities and accelerations that its grips and forces allow.

        A scheme that keeps the length by positions alone carries small parts of both along that
        do not: harmless as long as the steps stay the same, not where they change. What that
        makes wrong is of second order in the steps of dt (s) that follow, as the scheme is.
        """
        time, history, brief = instant.place * self.dt, instant.shape.state.history, self._brief(dt)
        nodes, bends = self._set_going(instant.nodes.uniform(), instant.bends.uniform(), history,
                                       instant.nodes.velocity, brief, time)
        nodes, bends, state = self._accelerated(nodes, bends, history, brief, time)
        return self._with(instant, nodes, bends, state)

    def _brief(self, dt):
        """Return the Scheme by which the DLO is watched before steps of dt (s)."""
        short = max(_BRIEF[0] * dt, _BRIEFEST * self._own_time)
        return Scheme.named('paper', min(short, _BRIEF[1] * self._own_time))

    def _with(self, instant, nodes, bends, state):
        """Return an Instant with other Courses; the State has the forces of the grips."""
        power = self.grips.power(instant.place,
                                 np.concatenate([state.base_force, state.base_moment]),
                                 -tip_wrench(state), nodes.position[-1])
        return replace(instant, nodes=nodes, bends=bends, power=power,
                       kinetic=self._kinetic(nodes.velocity),
                       damping=self._damping(nodes.velocity, bends.velocity))

    def _accelerated(self, nodes, bends, history, brief, time):
        """Return the Courses with their accelerations, and the kernels' State very soon after."""
        state, gripper = self._shortly((nodes, bends), bends.position, history, brief,
                                       time + brief.dt)
        return (*(Course.begun(one.position, one.velocity, brief.after(one, there).acceleration)
                  for one, there in ((nodes, state.positions + gripper.position),
                                     (bends, state.strains))), state)

    def _set_going(self, nodes, bends, history, velocity, brief, time):
        """Return Courses with the velocities nearest to `velocity` that the grips allow."""
        found = []
        for sign in (1.0, -1.0):
            pushed = replace(nodes, velocity=sign * velocity)
            # what damps acts against either way: it would not cancel
            state, gripper = self._shortly((pushed, None), bends.position, history, brief,
                                           time + sign * brief.dt)
            found.append((state.positions + gripper.position, state.strains))
        rates = [(ahead - back) / (2 * brief.dt) for ahead, back in zip(*found, strict=True)]
        return replace(nodes, velocity=rates[0]), replace(bends, velocity=rates[1])

    def _shortly(self, moving, strains, history, brief, time):
        """Return the kernels' State and the gripper's Pose a very short time later (or before).

        Parameters
        ----------
        moving
            Course of the nodes and that of the strains; instead of this None: nothing is damped.
        strains
            (N, 3) with which the search begins.
        """
        mesh = self.discretization
        gripper, far_end = self.grips.at(time / self.dt)
        system = self._moving(gripper, far_end, history, *moving, brief)
        q = np.empty((mesh.n_unknowns, 3))
        unknowns_of(system, strains.copy(), q)
        return solve(mesh, system, gripper, q, history, exact=_AT_ONCE).state, gripper

    def _moving(self, gripper, far_end, history, nodes, bends, scheme):
        """Return the System of a step: the static one, with inertia and damping."""
        mesh = self.discretization
        drag, viscosity = mesh.rod.damping if bends is not None else (0.0, 0.0)
        where, velocity = scheme.anchor(nodes)
        strength = scheme.stiffness + drag * scheme.drag
        anchor = where - drag * velocity / strength - gripper.position
        system = mesh.system(gripper.rotation, gripper.position, history, far_end)
        system = system._replace(anchor=Anchor(anchor, self.masses * strength))
        return system if viscosity == 0.0 else _viscous(system, bends, viscosity, scheme)

    def _kinetic(self, velocity):
        return 0.5 * float(self.masses @ np.sum(velocity**2, axis=1))

    def _damping(self, velocity, rate):
        """Return the power that damping takes, W."""
        drag, viscosity = self.discretization.rod.damping
        system = self.discretization.static
        viscous = np.sum(system.lengths[:, None] * system.stiffness * rate**2)
        return 2 * drag * self._kinetic(velocity) + viscosity * float(viscous)


def _viscous(system, bends, viscosity, scheme):
    """Return a System with damping of its strains.

    K b u' with u' = rate + drag (u - bent) is a spring of its own, drawn to where u' = 0.
    """
    bent, rate = scheme.anchor(bends)
    firm = viscosity * scheme.drag
    calm = bent - rate / scheme.drag
    if not yields(system.plastic):  # two springs make one
        natural = (system.natural + firm * calm) / (1 + firm)
        return system._replace(natural=natural, stiffness=system.stiffness * (1 + firm))
    # here it is one with what never yields
    elastic = with_couples(system.elastic, firm * system.stiffness * (calm - system.natural))
    return system._replace(elastic=elastic._replace(part=elastic.part + firm))


def _rubbed(before, after):
    """Return the work done against friction between two Shapes, J."""
    return sum(float(contact.friction @ (before.frame_at(contact.s)[1] - contact.position))
               for contact in after.contacts if contact.friction.any())
