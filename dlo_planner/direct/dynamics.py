"""Motion of the DLO under a moving gripper: statics with inertia added, Eq. 12, 13 of the paper.

Nodes carry the mass, the strains are the unknowns: the same minimisation as in statics, with one
term more. Damping is Rayleigh's: in proportion to mass (drag of a calm surrounding) and to
stiffness (Kelvin and Voigt); neither changes a shape at rest.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.continuation import between
from dlo_planner.direct.integrator import Course, Scheme
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.statics import CONVERGED, TOLERANCE, shape_of
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.minimize.newton import NEUTRAL, newton

_MAX_ITERATIONS = 1000
_FIRST_INSTANT = 0.01  # of a step: how long the DLO is watched to find its first acceleration


def simulate(discretisation, grippers, dt, initial, integrator, progress):
    """Return the Motion that begins at rest with `initial`; see `DirectSimulator.simulate`."""
    scheme = Scheme.named(integrator, dt)
    masses = node_masses(discretisation.rod, discretisation.s)
    strains = discretisation.strains_from(initial.s, initial.element_strains)
    nodes, bends = _let_go(discretisation, grippers, masses, strains, dt)
    shapes = [replace(initial, _estimate=_unknown)]
    velocities = [nodes.velocity]
    energies = [_energies(discretisation, shapes[0], masses, nodes.velocity)]
    for gripper in grippers[1:]:
        shape = _step(discretisation, gripper, masses, nodes, bends, scheme)
        nodes = scheme.after(nodes, shape.positions)
        bends = scheme.after(bends, shape.element_strains)
        shapes.append(shape)
        velocities.append(nodes.velocity)
        energies.append(_energies(discretisation, shape, masses, nodes.velocity))
        if progress is not None:
            progress(len(shapes), len(grippers))
        if not shape.converged:
            break  # what would follow from a wrong shape is worth nothing
    kinetic, potential = np.array(energies).T
    return Motion(dt * np.arange(len(shapes)), shapes, np.array(velocities), kinetic, potential)


def _step(discretisation, gripper, masses, nodes, bends, scheme):
    """Return the Shape at the end of a step of `scheme` in which the gripper comes to `gripper`."""
    drag, viscosity = discretisation.rod.damping
    where, velocity = scheme.anchor(nodes)
    strength = scheme.stiffness + drag * scheme.drag
    anchor = where - drag * velocity / strength - gripper.position
    bent, rate = scheme.anchor(bends)
    # K (u - n) + K b u' with u' = rate + drag (u - bent): again a spring, stiffer, to elsewhere
    stiffer = 1 + viscosity * scheme.drag
    system = discretisation.system(gripper.rotation)
    natural = (system.natural + viscosity * (scheme.drag * bent - rate)) / stiffer
    system = system._replace(natural=natural, stiffness=system.stiffness * stiffer,
                             anchor=anchor, anchor_weight=masses * strength)
    q = np.empty((discretisation.n_unknowns, 3))
    unknowns_of(system, bends.position + scheme.dt * bends.velocity, q)
    state, residual, stability, iterations, _ = newton(system, q, TOLERANCE, _MAX_ITERATIONS,
                                                       True)
    shape = shape_of(discretisation, gripper, system, state, residual, stability, iterations)
    # the nodes beyond the clamp pull with weight and inertia; the clamped one is the gripper's
    wrench = np.concatenate([state.pull.sum(axis=0), state.base_moment])
    return replace(shape, gripper_wrench=wrench, _estimate=_unknown,
                   converged=bool(residual < CONVERGED and stability > -NEUTRAL))


def _let_go(discretisation, grippers, masses, strains, dt):
    """Return the Courses of nodes and strains of a DLO at rest that is free to move from now on.

    Its acceleration is what a very short first step, of constant acceleration, finds; the gripper
    too starts from rest and makes its first step with a constant acceleration.
    """
    gripper = grippers[0]
    brief = Scheme.named('paper', _FIRST_INSTANT * dt)
    system = discretisation.system(gripper.rotation)
    q = np.empty((discretisation.n_unknowns, 3))
    unknowns_of(system, strains, q)
    here = newton(system, q, np.inf, 0, False)[0]
    positions = here.positions + gripper.position
    nodes = Course.at_rest(positions, np.zeros_like(positions))
    bends = Course.at_rest(here.strains, np.zeros_like(here.strains))
    pulled = between(gripper, grippers[min(1, len(grippers) - 1)], _FIRST_INSTANT**2)
    shape = _step(discretisation, pulled, masses, nodes, bends, brief)
    return (Course.at_rest(positions, brief.after(nodes, shape.positions).acceleration),
            Course.at_rest(here.strains, brief.after(bends, shape.element_strains).acceleration))


def _energies(discretisation, shape, masses, velocity):
    rod, lengths = discretisation.rod, np.diff(discretisation.s)
    bent = shape.element_strains - discretisation.natural
    elastic = 0.5 * float(np.sum(lengths[:, None] * rod.stiffness * bent**2))
    height = -float(np.sum(masses[:, None] * shape.positions * discretisation.gravity))
    return 0.5 * float(masses @ np.sum(velocity**2, axis=1)), elastic + height


def _unknown():
    return np.inf
