# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random motions of rods that slide along obstacles; as a script: how many of them complete."""

import sys
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent.parent)]

from dlo_planner import (  # noqa: E402
    Box,
    Cylinder,
    DirectSimulator,
    Plane,
    Pose,
    Rod,
    Sphere,
)


def random_slide(seed):
    """Return a simulator, a way and the time (s) of each of its parts, all at random."""
    rng = np.random.default_rng(seed)
    stiffness = 0.3 * 10 ** rng.uniform(-2.5, 0)
    weight = 8 * stiffness * 10 ** rng.uniform(-1, 1)
    rod = Rod(1.0, stiffness, rng.uniform(0.2, 1) * stiffness, weight / 9.81,
              radius=rng.uniform(0.002, 0.01), damping=(0, 10 ** rng.uniform(-3, -1.5)))
    friction = [0.0, 0.0, 0.3][rng.integers(3)]
    obstacles = [one_of_them(rng, friction) for _ in range(rng.integers(1, 4))]
    mesh = [{}, {'n_elements': 32}, {'n_elements': 32, 'basis': 'local'},
            {'n_elements': 24}][rng.integers(4)]
    way = [Pose.looking_along((0, 0, 0), (1, 0, 0))]
    for _ in range(2):
        place = rng.uniform((-0.2, -0.1, -0.1), (0.2, 0.1, 0.3))
        way.append(Pose.looking_along(place, (1, rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5))))
    dt = [0.5, 2.0, 10.0, 60.0][rng.integers(4)]
    return DirectSimulator(rod, obstacles=obstacles, **mesh), [*way, way[0]], dt


def one_of_them(rng, friction):
    kind = rng.integers(4)
    place = np.array([rng.uniform(*ends) for ends in ((0.3, 0.9), (-0.15, 0.15), (-0.5, -0.15))])
    if kind == 0:
        return Sphere(place, rng.uniform(0.03, 0.1), friction=friction)
    if kind == 1:
        return Cylinder(place - [0, 1, 0], place + [0, 1, 0], rng.uniform(0.01, 0.08),
                        friction=friction)
    if kind == 2:
        return Box(Pose(place, (0, 0, 0, 1)), rng.uniform(0.05, 0.12, 3), friction=friction)
    return Plane((0, 0, rng.uniform(-0.5, -0.2)), (0, 0, 1), friction=friction)


def main(first: int, last: int) -> None:
    """Print which of the motions of some seeds are not complete, and how many are."""
    began, complete = time.process_time(), 0
    for seed in range(first, last):
        simulator, way, dt = random_slide(seed)
        motion = simulator.simulate(way, dt)
        complete += motion.status == 'complete'
        if motion.status != 'complete':
            print(f'{seed}: {motion.status} at {motion.times[-1]:.3g} of {3 * dt:g} s')
    print(f'{complete} of {last - first} complete, {time.process_time() - began:.0f} s of CPU')


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
