# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random DLOs pressed onto and drawn over random obstacles: friction in every step.

python test/random_friction.py [how many scenes] [seed]

A step is right if it has converged and Coulomb's law holds at each of its contacts: the friction
lies across the normal, is not above mu N, and what slides is held back against its way.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from random_contacts import distance  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from tally import arguments, tally, timed  # noqa: E402

from dlo_planner import Box, Capsule, DirectSimulator, Plane, Pose, Rod, Sphere  # noqa: E402

HOW = ({'basis': 'local'}, {'basis': 'chebyshev'}, {'basis': 'local', 'n_elements': 32},
       {'accuracy': 1e-4})
MU = 0.05, 0.8
_GAP = 5e-3      # m, of the DLO above the obstacle, before it is pressed down
_PRESSED, _DRAWN = 4, 8
_LAW = 1e-6


def random_scene(rng, how):
    """Return a simulator, its Shape above an obstacle and Poses: down onto it, then across it."""
    while True:
        rod, obstacle, poses = _drawn(rng)
        if distance(obstacle, np.array([pose.position for pose in poses])).min() < 2 * rod.radius:
            continue  # the gripper would be in it
        simulator = DirectSimulator(rod, obstacles=[obstacle], **how)
        shape = simulator.solve(poses[0])
        if shape.converged and not shape.contacts:
            return simulator, shape, poses[1:]


def _drawn(rng):
    stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
    if rng.random() < 0.5:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 * (rng.random() < 0.5)
    rod = Rod(1.0, 0.05, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
              natural_curvature=tuple(bent), radius=rng.choice([5e-4, 2e-3, 1e-2]))
    attitude = Rotation.from_euler('zyx', rng.uniform((-3, -0.5, -3), (3, 1.4, 3)))
    start = Pose((0, 0, 0), attitude.as_quat())
    hanging = DirectSimulator(rod, basis='local').solve(start)
    s = rng.uniform(0.3, 1.0)
    tangent = hanging.at(s).rotation[:, 0]
    normal = np.cross(np.cross(tangent, [0, 0, 1.0] + 0.3 * rng.normal(size=3)), tangent)
    normal /= np.linalg.norm(normal)
    obstacle = random_obstacle(rng, hanging.positions_at([s])[0] - (rod.radius + _GAP) * normal,
                               normal, tangent)
    across = rng.normal(size=3)
    across -= (across @ normal) * normal
    across /= np.linalg.norm(across)
    step, turned = np.exp(rng.uniform(np.log(2e-3), np.log(3e-2))), 0.05 * rng.normal(size=3)
    poses = [Pose(-0.015 * k * normal, start.quaternion) for k in range(_PRESSED + 1)]
    for k in range(1, _DRAWN + 1):
        poses.append(Pose(poses[_PRESSED].position + k * step * across,
                          (Rotation.from_rotvec(k * turned) * attitude).as_quat()))
    return rod, obstacle, poses


def random_obstacle(rng, place, normal, tangent, friction=None):
    """Return a ball, bar, plane or box whose surface is at a place (3,), with this normal (3,)."""
    kind, mu = rng.integers(4), np.exp(rng.uniform(*np.log(MU)))
    mu = mu if friction is None else friction
    radius = np.exp(rng.uniform(np.log(0.01), np.log(0.3)))
    if kind == 0:
        return Sphere(place - radius * normal, radius, mu)
    if kind == 1:
        axis = np.cross(normal, tangent) + 0.5 * rng.normal() * tangent
        axis /= np.linalg.norm(axis)
        middle = place - radius * normal
        return Capsule(middle - 0.5 * axis, middle + 0.5 * axis, radius, mu)
    if kind == 2:
        return Plane(place, normal, mu)
    size = np.array([rng.uniform(0.02, 0.2), 0.3, 0.1])
    frame = np.column_stack([tangent, np.cross(normal, tangent), normal])
    frame = (Rotation.from_matrix(frame) * Rotation.from_rotvec(0.3 * rng.normal(size=3)))
    return Box(Pose(place - frame.apply([0, 0, 0.05]), frame.as_quat()), size, mu)


def outcome(shape, mu):
    """Return what is wrong with a step, or 'converged'."""
    if not shape.converged:
        return f'not converged: {shape.status}'
    for contact in shape.contacts:
        size = np.linalg.norm(contact.friction)
        if not size <= mu * contact.force * (1 + _LAW):
            return f'above the limit: {size / contact.force:.9g} of {mu:.9g}'
        if abs(contact.friction @ contact.normal) > 1e-9 * contact.force:
            return 'not across the normal'
    return 'converged'


def steps_of(simulator, shape, poses, name):
    """Yield outcome and CPU time of every step through the poses of a scene."""
    obstacle = simulator.obstacles[0]
    for k, pose in enumerate(poses):
        after, seconds = timed(partial(simulator.solve, pose, shape))
        kind = outcome(after, obstacle.friction)
        if kind != 'converged':
            kind += f' ({name}, {type(obstacle).__name__}, step {k})'
        elif not after.contacts:
            kind = 'away'
        yield kind, seconds
        if after.converged:
            shape = after


def steps(number, seed):
    """Yield outcome and CPU time of every step of a number of scenes."""
    for index in range(number):
        scene = random_scene(np.random.default_rng((seed, index)), HOW[index % len(HOW)])
        yield from steps_of(*scene, f'scene {index}')


def main():
    """Print how many steps have converged, and everything else."""
    tally(steps(*arguments(127, 0)))


if __name__ == '__main__':
    main()
