"""Motion of the DLO under a moving gripper: statics with inertia added, Eq. 12, 13 of the paper.

Nodes carry the mass, the strains are the unknowns: the same minimisation as in statics, with one
term more. Damping is Rayleigh's: in proportion to mass (drag of a calm surrounding) and to
stiffness (Kelvin and Voigt); neither changes a shape at rest.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.accuracy import past_of
from dlo_planner.direct.approach import approach
from dlo_planner.direct.continuation import between
from dlo_planner.direct.integrator import Course, Scheme
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.statics import elastic_energy, shape_of, solve
from dlo_planner.energy.loads import node_masses
from dlo_planner.energy.potential import unknowns_of
from dlo_planner.errors import InvalidTask
from dlo_planner.minimize.newton import newton
from dlo_planner.model.pose import angle_between

_SAME_POSE = 1e-6      # of the length, and rad: poses nearer to each other are the same
_DEEP = 1e-3           # of the length: a DLO so far inside an obstacle is no state of a motion
_FIRST_INSTANT = 0.01  # of a step: how long the DLO is watched to find its first acceleration


def simulate(discretisation, grippers, dt, initial, history, integrator, progress):
    """Return the Motion that begins at rest with `initial`; see `DirectSimulator.simulate`.

    Args:
        history: History that the DLO has if `initial` is none of its own

    Raises:
        InvalidTask: `initial` is held elsewhere than the motion begins, or lies in an obstacle
    """
    scheme = Scheme.named(integrator, dt)
    masses = node_masses(discretisation.rod, discretisation.s)
    history = past_of(discretisation, initial, history)
    first = _at_first(discretisation, grippers[0], initial, history)
    nodes, bends = _let_go(discretisation, grippers, masses, np.array(first.element_strains),
                           history, dt)
    shapes = [replace(first, _estimate=_unknown)]
    velocities = [nodes.velocity]
    energies = [_energies(discretisation, shapes[0], history, masses, nodes.velocity)]
    for gripper in grippers[1:]:
        shape = _step(discretisation, gripper, shapes[-1], history, masses, nodes, bends, scheme)
        history = shape._history
        nodes = scheme.after(nodes, shape.positions)
        bends = scheme.after(bends, shape.element_strains)
        shapes.append(shape)
        velocities.append(nodes.velocity)
        energies.append(_energies(discretisation, shape, history, masses, nodes.velocity))
        if progress is not None:
            progress(len(shapes), len(grippers))
        if not shape.converged:
            break  # what would follow from a wrong shape is worth nothing
    kinetic, potential = np.array(energies).T
    return Motion(dt * np.arange(len(shapes)), shapes, np.array(velocities), kinetic, potential)


def _at_first(discretisation, gripper, initial, history):
    """Return the Shape at time 0: that of `initial`, on this mesh and in these surroundings."""
    length = discretisation.s[-1]
    shift = np.linalg.norm(initial.gripper.position - gripper.position)
    turn = angle_between(initial.gripper.rotation, gripper.rotation)
    if shift > _SAME_POSE * length or turn > _SAME_POSE:
        raise InvalidTask('initial: expected a Shape whose gripper is at grippers[0], where the '
                          f'motion begins; it is {shift:.3g} m away and {turn:.3g} rad turned')
    if initial._discretisation is discretisation:
        first = initial
    else:
        system = discretisation.system(gripper.rotation, gripper.position, history)
        q = discretisation.unknowns(discretisation.strains_from(initial.s, initial.element_strains))
        found = solve(discretisation, system, gripper, q, history, 0, False)
        # nothing was solved yet that could have failed
        first = replace(shape_of(discretisation, gripper, found, history), converged=True)
    if first.converged and first.violation > _DEEP * length:
        raise InvalidTask(f'initial: expected a Shape outside of all obstacles, it is '
                          f'{first.violation:.3g} m inside one')
    return first


def _step(discretisation, gripper, before, history, masses, nodes, bends, scheme):
    """Return the Shape at the end of a step of `scheme` in which the gripper comes to `gripper`."""
    system = _moving(discretisation, gripper, history, masses, nodes, bends, scheme)
    guess, clear = bends.position + scheme.dt * bends.velocity, True
    if discretisation.surroundings.obstacles:
        # where obstacles are, the search begins where the DLO is known to be outside of them
        guess, clear = approach(discretisation, before, bends.position, gripper, None, history)
    q = np.empty((discretisation.n_unknowns, 3))
    unknowns_of(system, guess, q)
    shape = shape_of(discretisation, gripper,
                     solve(discretisation, system, gripper, q, history), history)
    return replace(shape, _estimate=_unknown, converged=shape.converged and clear)


def _moving(discretisation, gripper, history, masses, nodes, bends, scheme):
    """Return the System of a step: the static one, with inertia and damping."""
    drag, viscosity = discretisation.rod.damping
    where, velocity = scheme.anchor(nodes)
    strength = scheme.stiffness + drag * scheme.drag
    anchor = where - drag * velocity / strength - gripper.position
    system = discretisation.system(gripper.rotation, gripper.position, history)
    system = system._replace(anchor=anchor, anchor_weight=masses * strength)
    if viscosity == 0.0:
        return system
    # K b u' with u' = rate + drag (u - bent): a spring of its own, drawn to where u' = 0
    bent, rate = scheme.anchor(bends)
    firm = viscosity * scheme.drag
    calm = bent - rate / scheme.drag
    layers = system.layers
    if not layers.share.size:  # two springs make one
        natural = (system.natural + firm * calm) / (1 + firm)
        return system._replace(natural=natural, stiffness=system.stiffness * (1 + firm))
    # here it is one with what never yields
    couple = layers.couple + firm * system.stiffness * (calm - system.natural)
    return system._replace(layers=layers._replace(firm=layers.firm + firm, couple=couple))


def _let_go(discretisation, grippers, masses, strains, history, dt):
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
    system = _moving(discretisation, pulled, history, masses, nodes, bends, brief)
    unknowns_of(system, here.strains, q)
    found = solve(discretisation, system, pulled, q, history)[0]
    return (Course.at_rest(positions, brief.after(nodes, found.positions + pulled.position)
                           .acceleration),
            Course.at_rest(here.strains, brief.after(bends, found.strains).acceleration))


def _energies(discretisation, shape, history, masses, velocity):
    elastic = elastic_energy(discretisation, shape.element_strains, history.set)
    weight = discretisation.system(np.eye(3)).pull
    return (0.5 * float(masses @ np.sum(velocity**2, axis=1)),
            elastic + float(np.sum(weight * shape.positions)))


def _unknown():
    return np.inf
