"""Keeping contact with an obstacle (paper, section 5.3, Fig. 15, 16).

Given are the arc length at which the DLO touches, the point, and its direction there. What hangs
beyond is then determined; the force of contact, along the surface's normal, is not: each force
gives another gripper pose, by one march from the contact to the gripper (`inverse.marching`),
without any search. That is the one-parameter family of Fig. 16; an extra condition chooses from it.
"""

from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.discretisation import Discretisation
from dlo_planner.direct.statics import equilibrium, shape_of
from dlo_planner.energy.potential import evaluate, new_state
from dlo_planner.inverse.clearance import clearance
from dlo_planner.inverse.draft import Draft
from dlo_planner.inverse.marching import march_from_end
from dlo_planner.inverse.plan import waypoint_at
from dlo_planner.model.part import part_of_rod
from dlo_planner.model.pose import Pose

CONDITIONS = ('least_energy', 'least_force', 'least_motion', 'largest_clearance')
_SAME_FORCE, _SAME_PLACE = 1e-3, 1e-4  # relative; of the length: what counts as confirmed
_NEAR = 0.02                           # of the length: contacts that are counted as the one


@dataclass(frozen=True, eq=False)
class Holding:
    """One way to hold a contact.

    Attributes:
        gripper: Pose; shape: Shape that the direct simulator, with its obstacles, finds there
        force: N, of the contact, along the normal
        s: arc length of the contact, m
        place: (3,) of the DLO's axis there, m; direction: (3,) of the DLO
        confirmed: the direct simulation has the contact with this force at this place, stably
    """

    gripper: Pose
    shape: object
    force: float
    s: float
    place: np.ndarray
    direction: np.ndarray
    confirmed: bool


def family(simulator, contact, s, forces):
    """Return the Holdings of contact at arc length `s` with each of `forces` (n,), N.

    Args:
        simulator: DirectSimulator with the obstacle among its obstacles
        contact: Pose on the obstacle's surface: x axis = DLO's direction, z axis = outward normal
    """
    here, node = _mesh(simulator, s)
    beyond = _tail(here, node, contact)
    axis = contact.position + (simulator.rod.radius or 0.0) * contact.rotation[:, 2]
    return [_with_force(simulator, here, node, beyond, axis, contact, force) for force in forces]


def choose(holdings, condition, before, obstacles, radius):
    """Return the Holding that a condition of CONDITIONS prefers; `before`: Pose or None."""
    def cost(one):
        if condition == 'least_energy':
            return one.shape.elastic_energy
        if condition == 'least_force':
            return one.force
        if condition == 'largest_clearance':
            others = [obstacle for k, obstacle in enumerate(obstacles)
                      if all(contact.obstacle != k for contact in one.shape.contacts)]
            return -clearance(others, radius, one.shape) if others else 0.0
        away = one.gripper.position - before.position
        turn = 1 - 0.25 * (1 + np.trace(one.gripper.rotation @ before.rotation.T))
        return float(away @ away) / one.shape.s[-1] ** 2 + turn

    return min(holdings, key=cost)


def hold_contact(simulator, contact, s, forces, condition, start, brief):
    """Return the Plan; see `InverseSimulator.hold_contact`."""
    draft = Draft([simulator.rod.length - s], brief)
    found = _admissible(simulator, contact, s, forces, draft, brief)
    if condition is not None:
        found = [choose(found, condition, start, simulator.obstacles, brief.radius)]
    draft = Draft([simulator.rod.length - s] * len(found), brief)
    for one in found:
        draft.add(_waypoint(one))
    return draft.finished()


def slide_contact(simulator, contact, lengths, forces, condition, start, brief):
    """Return the Plan; see `InverseSimulator.slide_contact`."""
    draft, before = Draft([simulator.rod.length - s for s in lengths], brief), start
    for s in lengths:
        found = _admissible(simulator, contact, s, forces, draft, brief)
        how = 'least_energy' if condition == 'least_motion' and before is None else condition
        one = choose(found, how, before, simulator.obstacles, brief.radius)
        draft.add(_waypoint(one))
        before = one.gripper
    return draft.finished()


def _admissible(simulator, contact, s, forces, draft, brief):
    """Return the confirmed Holdings that keep all demands; raise Infeasible if there is none."""
    found = [one for one in family(simulator, contact, s, forces) if one.confirmed]
    if not found:
        raise draft.refusal(
            'contact', s, f'no contact force of {min(forces):g} to {max(forces):g} N keeps the DLO '
            f'touching at s = {s:g} m in a stable shape that the direct simulation confirms')
    broken = [brief.broken(_waypoint(one)) for one in found]
    kept = [one for one, what in zip(found, broken, strict=True) if what is None]
    if not kept:
        constraint, amount, why = min(broken, key=lambda what: what[1])
        raise draft.refusal(constraint, amount, f'none of {len(found)} contact forces will do; '
                            f'with the best of them, {why}')
    return kept


def _waypoint(one):
    """Return the Waypoint of a Holding."""
    return waypoint_at(one.shape, one.place, one.s, one.direction)


def _mesh(simulator, s):
    """Return a Discretisation without obstacles in which `s` is a node, and that node."""
    length = simulator.rod.length
    plain = replace(simulator.surroundings, obstacles=())
    elements = 64 if simulator.accuracy is not None else simulator._discretisation.s.size - 1
    node = int(np.clip(round(elements * s / length), 2, elements - 2))
    nodes = np.concatenate([np.linspace(0, s, node + 1),
                            np.linspace(s, length, elements - node + 1)[1:]])
    return Discretisation(plain, nodes, 'local', 0), node


def _tail(here, node, contact):
    """Return the rotation (3, 3) of the free end of what hangs beyond the contact."""
    around = here.surroundings
    s = here.s[node]
    load = around.load
    part = replace(around, rod=part_of_rod(here.rod, s, 1),
                   load=(lambda x: load(s + x)) if callable(load) else load)
    tail = Discretisation(part, here.s[node:] - s, 'local', 0)
    shape, _ = equilibrium(tail, contact, tail.natural)
    return shape.frames[-1]


def _with_force(simulator, here, node, end, axis, contact, force):
    """Return the Holding with this force, checked by the direct simulator."""
    system = here.system(np.eye(3))
    pull = system.pull.copy()
    direction = contact.rotation[:, 0]
    pull[node] -= force * contact.rotation[:, 2]
    strains, base = march_from_end(system._replace(pull=pull), np.array(end, order='C'))
    system = here.system(base)
    state = new_state(system)
    state.q[:] = here.unknowns(strains)
    evaluate(system, state)
    gripper = Pose.from_rotation(axis - state.positions[node], base)
    guess = shape_of(here, gripper, (state, np.inf, -np.inf, 0, 0, system, 0.0))
    shape = simulator.solve(gripper, guess)
    s = here.s[node]
    at = [one for one in shape.contacts if abs(one.s - s) < _NEAR * here.s[-1]]
    found = sum(one.force for one in at)
    off = np.linalg.norm(shape.positions_at([s])[0] - axis)
    confirmed = (shape.converged and bool(at)
                 and abs(found - force) <= _SAME_FORCE * force
                 and off <= _SAME_PLACE * here.s[-1])
    return Holding(gripper, shape, float(force), float(s), axis, direction, bool(confirmed))
