# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random contacts for random DLOs: held and honest, or refused and the refusal confirmed.

python test/random_contacts.py [how many] [seed]

The family of a contact is integrated here by Runge-Kutta (Kirchhoff's equations from the contact
to the gripper, for many forces at once); the direct simulation tells what can be held.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from tally import arguments, tally, timed  # noqa: E402

from dlo_planner import (  # noqa: E402
    Box,
    Capsule,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sphere,
)
from dlo_planner.direct.shape import UNKNOWN  # noqa: E402
from dlo_planner.inverse.contact_family import STABLE  # noqa: E402
from dlo_planner.model.rod import part_of_rod  # noqa: E402

MASS, GRAVITY = 0.05, np.array([0, 0, -9.81])
HOW = ({'basis': 'local'}, {'basis': 'chebyshev'}, {'accuracy': 1e-5})
_STEPS = 64


def random_task(rng):
    """Return Rod, obstacle, contact (Pose) and arc length: round, flat, bent, with a weight."""
    kind = rng.integers(4)
    stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
    if kind == 0:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 if kind >= 2 else np.zeros(2)
    rod = Rod(1.0, MASS, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
              natural_curvature=tuple(bent),
              natural_twist=rng.normal() * 0.5 if kind == 3 else 0.0,
              tip_mass=rng.uniform(0, 0.02) if kind == 3 else 0.0, radius=rng.choice([2e-3, 1e-2]))
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    if rng.random() < 0.7:
        normal[2] = abs(normal[2])
    along = np.cross(normal, rng.normal(size=3))
    along /= np.linalg.norm(along)
    frame = np.column_stack([along, np.cross(normal, along), normal])
    contact = Pose.from_rotation(rng.normal(size=3), frame)
    return rod, _touched(rng, contact), contact, rng.uniform(0.2, 0.9)


def _touched(rng, contact):
    place, normal = contact.position, contact.rotation[:, 2]
    kind, radius = rng.integers(4), np.exp(rng.uniform(np.log(0.01), np.log(0.3)))
    if kind == 0:
        return Sphere(place - radius * normal, radius)
    if kind == 1:
        axis = contact.rotation[:, 1] + 0.3 * rng.normal() * contact.rotation[:, 0]
        axis /= np.linalg.norm(axis)
        middle = place - radius * normal
        return Capsule(middle - 0.5 * axis, middle + 0.5 * axis, radius)
    if kind == 2:
        return Plane(place, normal)
    return Box(Pose.from_rotation(place - 0.05 * normal, contact.rotation),
               (rng.uniform(0.02, 0.2), 0.3, 0.1))


def distance(obstacle, x):
    """Return the distances (n,) of points x (n, 3) from the surface of an obstacle."""
    if isinstance(obstacle, Sphere):
        return np.linalg.norm(x - obstacle.center, axis=1) - obstacle.radius
    if isinstance(obstacle, Capsule):
        axis = obstacle.end - obstacle.start
        part = np.clip((x - obstacle.start) @ axis / (axis @ axis), 0, 1)
        nearest = obstacle.start + part[:, None] * axis
        return np.linalg.norm(x - nearest, axis=1) - obstacle.radius
    if isinstance(obstacle, Plane):
        return (x - obstacle.point) @ obstacle.normal
    beyond = np.abs((x - obstacle.pose.position) @ obstacle.pose.rotation) - obstacle.size / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def family(rod, contact, s, forces):
    """Return nodes (n,), strains (k, n - 1, 3), frames (k, n, 3, 3), positions (k, n, 3).

    Args:
        forces: (k,) N of contact
    """
    frame, normal = contact.rotation, contact.rotation[:, 2]
    axis = contact.position + rod.radius * normal
    tail = DirectSimulator(part_of_rod(rod, s, 1), basis='local', n_elements=_STEPS).solve(
        Pose.from_rotation(axis, frame))
    k = len(forces)
    natural = np.array([rod.natural_twist, *rod.natural_curvature])
    pull, weight = np.asarray(forces)[:, None] * normal, rod.mass_per_length * GRAVITY

    def rates(at, frames, moment):
        strain = np.einsum('nij,ni->nj', frames, moment) / rod.stiffness + natural
        cross = np.zeros((k, 3, 3))
        cross[:, 0, 1], cross[:, 0, 2] = -strain[:, 2], strain[:, 1]
        cross[:, 1, 0], cross[:, 1, 2] = strain[:, 2], -strain[:, 0]
        cross[:, 2, 0], cross[:, 2, 1] = -strain[:, 1], strain[:, 0]
        force = weight * (rod.length - at) + rod.tip_mass * GRAVITY + pull
        return frames @ cross, -np.cross(frames[:, :, 0], force), frames[:, :, 0], strain

    h = -s / _STEPS
    state = [np.tile(frame, (k, 1, 1)), np.tile(-tail.gripper_wrench[3:], (k, 1)),
             np.tile(axis, (k, 1))]
    frames, positions, strains = [state[0]], [state[2]], []
    for step in range(_STEPS):
        at = s + step * h
        a = rates(at, *state[:2])
        b = rates(at + h / 2, *(v + h / 2 * r for v, r in zip(state[:2], a, strict=False)))
        c = rates(at + h / 2, *(v + h / 2 * r for v, r in zip(state[:2], b, strict=False)))
        d = rates(at + h, *(v + h * r for v, r in zip(state[:2], c, strict=False)))
        state = [v + h / 6 * (p + 2 * q + 2 * r + t)
                 for v, p, q, r, t in zip(state, a, b, c, d, strict=False)]
        strains.append(0.5 * (b[3] + c[3]))
        frames.append(state[0])
        positions.append(state[2])

    def whole(before, beyond):
        before = np.array(before[::-1]).swapaxes(0, 1)
        return np.concatenate([before, np.tile(beyond, (k, *np.ones(beyond.ndim, int)))], axis=1)

    nodes = np.concatenate([np.linspace(0, s, _STEPS + 1), s + tail.s[1:]])
    return (nodes, whole(strains, tail.element_strains), whole(frames, tail.frames[1:]),
            whole(positions, tail.positions[1:]))


def energies(rod, nodes, strains):
    """Return the elastic energies (k,) in J of shapes with these strains (k, n - 1, 3)."""
    bent = strains - np.array([rod.natural_twist, *rod.natural_curvature])
    return 0.5 * np.einsum('e,kei,i->k', np.diff(nodes), bent**2, rod.stiffness)


def held(direct, contact, s, gripper, guess, force, stable=1e-3):
    """Return whether the direct simulation holds the contact with this force, stably."""
    shape = direct.solve(gripper, guess)
    at = [one for one in shape.contacts if abs(one.s - s) < 0.02]
    axis = contact.position + direct.rod.radius * contact.rotation[:, 2]
    return (shape.converged and shape.stability > stable and bool(at)
            and abs(sum(one.force for one in at) - force) < 0.1 * force
            and np.linalg.norm(shape.positions_at([s])[0] - axis) < 1e-3)


def scan(direct, contact, s, below=np.inf, decades=8, per_decade=10, stable=1e-3):
    """Return the forces that can be held with less than an elastic energy, of a dense scan, N."""
    rod, obstacle = direct.rod, direct.obstacles[0]
    scale = 9.81 * (rod.mass_per_length + rod.tip_mass) + min(rod.bending_stiffness)
    forces = scale * np.logspace(-3, decades - 3, decades * per_decade)
    with np.errstate(all='ignore'):  # enormous forces end in nothing
        nodes, strains, frames, positions = family(rod, contact, s, forces)
        better = energies(rod, nodes, strains) < below
    template, found = direct.solve(Pose.identity()), []
    for k in np.flatnonzero(better & np.isfinite(positions).all(axis=(1, 2))):
        if (distance(obstacle, positions[k]) - rod.radius).min() < -1e-8:
            continue
        gripper = Pose.from_rotation(positions[k, 0], frames[k, 0])
        guess = replace(template, gripper=gripper, s=nodes, positions=positions[k],
                        frames=frames[k], element_strains=strains[k], contacts=(),
                        state=UNKNOWN)
        if held(direct, contact, s, gripper, guess, forces[k], stable):
            found.append(forces[k])
    return found


def outcome(rod, obstacle, contact, s, how):
    """Return 'held', 'confirmed', or what is wrong; and the CPU time of planning, s."""
    direct = DirectSimulator(rod, obstacles=[obstacle], **how)
    plain = DirectSimulator(rod, obstacles=[obstacle], basis='local')
    plan, seconds = timed(lambda: InverseSimulator(direct).hold_contact(
        contact, s, min_force=0.0))
    if isinstance(plan, Infeasible):
        found = scan(plain, contact, s)
        if found:
            return f'refused for nothing: {plan}; {found[0]:g} to {found[-1]:g} N hold', seconds
        return 'confirmed', seconds
    shape = plan.shapes[0]
    force = sum(one.force for one in shape.contacts)
    if not held(direct, contact, s, shape.gripper, shape, force):
        return 'not held', seconds
    fine = DirectSimulator(rod, obstacles=[obstacle], basis='local', n_elements=256)
    true = fine.solve(shape.gripper, shape)
    samples = np.linspace(0.05, 1, 20)
    error = np.abs(true.positions_at(samples) - shape.positions_at(samples)).max()
    if error > 10 * shape.error_estimate + true.error_estimate + 1e-8:
        return (f'dishonest: off by {error:.2g} m, estimates {shape.error_estimate:.2g} and '
                f'{true.error_estimate:.2g} m'), seconds
    found = scan(plain, contact, s, 0.999 * shape.elastic_energy, 5, stable=1.2 * STABLE)
    if found:
        return f'not the least: {found} N, not {force:.3g} N', seconds
    return 'held', seconds


def main():
    """Print how many were held, how many refusals were confirmed, and everything else."""
    number, seed = arguments(200, 0)
    rng = np.random.default_rng(seed)
    tally(outcome(*random_task(rng), HOW[index % 3]) for index in range(number))


if __name__ == '__main__':
    main()
