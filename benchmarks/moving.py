# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions in contact with friction: DLOs that are let fall, drawn and swung over obstacles.

Two are named: `drop`, a cable that is held level 15 cm above a floor and let go there but for its
gripper, and `draw`, one that lies on a table and is drawn 0.3 m over it. The others are drawn at
random: rods of field stiffness, one to three obstacles, friction, a series or local unknowns. Of
each motion: its status, CPU time and steps; the largest gain of energy, by sums of its own, of what
has moved; the deepest penetration, by distances of its own, and by how much friction exceeds its
cone.

    python -m benchmarks.moving                the two that are named, on the default mesh
    python -m benchmarks.moving --random 30    that many random ones
    python -m benchmarks.moving --random 1 --first 17    one of them
    python -m benchmarks.moving --cap 60       give up what takes more than 60 s of CPU time
"""

from __future__ import annotations

import argparse
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.scenes import CABLE, GRAVITY, beyond_cones, deepest, pose, table
from dlo_planner import Box, Capsule, DeadlineExceeded, DirectSimulator, Plane, Pose, Rod, Sphere
from dlo_planner.direct.motion import Motion
from dlo_planner.direct.shape import Shape
from dlo_planner.model.obstacles import Obstacle

DT = 0.01  # s, between instants


class Scene(NamedTuple):
    """A motion that is to be computed."""

    what: str
    rod: Rod
    bodies: list[Obstacle]
    poses: list[Pose]
    start: Shape
    mesh: dict[str, Any]  # options of `DirectSimulator`


def drop(mesh: dict[str, Any]) -> Scene:
    """Return a level cable, straight at first, that falls on a floor while its gripper stays."""
    held = pose(0, 0, 0.15)
    start = DirectSimulator(CABLE, gravity=(0, 0, 0), **mesh).solve(held)
    return Scene('drop', CABLE, [table(0.4)], [held] * 101, start, mesh)


def draw(mesh: dict[str, Any]) -> Scene:
    """Return a cable that lies on a table and is drawn back by 0.3 m in 1 s."""
    direct = DirectSimulator(CABLE, obstacles=[table(0.3)], gravity=GRAVITY, **mesh)
    start = direct.track([pose(0, 0, z, 0, 20) for z in np.linspace(0.5, 0.04, 16)])[-1]
    t = np.linspace(0, 1, 101)
    back = 0.3 * (t - np.sin(2 * np.pi * t) / (2 * np.pi))
    return Scene('draw', CABLE, [table(0.3)], [pose(-x, 0, 0.04, 0, 20) for x in back], start, mesh)


NAMED = {'drop': drop, 'draw': draw}


def at_random(seed: int) -> Scene:
    """Return a motion of a seed: how it begins touches nothing, but for a hair's breadth."""
    rng = np.random.default_rng([45, seed])
    length = rng.uniform(0.3, 1.5)
    radius = rng.uniform(0.001, 0.005)
    mass = 1500 * np.pi * radius**2
    limp = np.exp(rng.uniform(np.log(3.0), np.log(300.0)))  # weight L^2 / EI
    stiffness = 9.81 * mass * length**3 / limp
    rod = Rod(length, mass, stiffness, 0.75 * stiffness, radius=radius,
              damping=(0.0, float(rng.choice([0.0, 1e-3]))))
    mesh: dict[str, Any] = {'n_elements': 64} | ({'basis': 'local'} if rng.random() < 0.5 else {})
    what = ('fall', 'drawn', 'swung')[seed % 3]
    pitch = rng.uniform(-20, 40)
    held = pose(0, 0, 0, 0, pitch)
    start = DirectSimulator(rod, gravity=(0, 0, 0) if what == 'fall' else GRAVITY,
                            **mesh).solve(held)
    low = start.positions[:, 2].min() - radius
    bodies: list[Obstacle] = [Plane((0, 0, low - rng.uniform(0.02, 0.3) * length), (0, 0, 1),
                                    friction=rng.uniform(0.1, 0.6))]
    for _ in range(rng.integers(0, 3)):
        body = _beside(rng, start, radius, length)
        if body is not None:
            bodies.append(body)
    t = np.linspace(0, 1, 101)
    smooth = t - np.sin(2 * np.pi * t) / (2 * np.pi)
    if what == 'fall':
        ways = np.zeros((101, 3))
    elif what == 'drawn':
        to = np.array([*rng.uniform(-0.4, 0.4, 2), -rng.uniform(0.2, 0.6)]) * length
        ways = smooth[:, None] * to
    else:
        swing = np.array([*rng.uniform(-0.3, 0.3, 2), -0.3]) * length
        ways = np.sin(2 * np.pi * t * smooth)[:, None] * swing * smooth[:, None]
    ways[:, 2] = np.maximum(ways[:, 2], bodies[0].point[2] + 4 * radius)  # type: ignore[union-attr]
    return Scene(f'{what} {seed}', rod, bodies, [Pose(way, held.quaternion) for way in ways],
                 start, mesh)


def _beside(rng: np.random.Generator, start: Shape, radius: float,
            length: float) -> Obstacle | None:
    """Return a body below a place of the DLO, or beside; None if it would touch the DLO."""
    at = start.positions[rng.integers(len(start.s) // 4, len(start.s))]
    size, friction = rng.uniform(0.03, 0.1) * length, rng.uniform(0.1, 0.6)
    where = at + np.array([*rng.uniform(-0.1, 0.1, 2), -rng.uniform(0.1, 0.3)]) * length
    kind = rng.integers(3)
    away = np.linalg.norm(start.positions - where, axis=1).min() - radius
    across = np.array([np.cos(turn := rng.uniform(0, np.pi)), np.sin(turn), 0.0]) * 2 * size
    if away < 3.5 * size:
        return None
    if kind == 0:
        return Sphere(where, size, friction=friction)
    if kind == 1:
        return Capsule(where - across, where + across, 0.5 * size, friction=friction)
    return Box(Pose(where, (0, 0, 0, 1)), (2 * size, 2 * size, size), friction=friction)


def gained(motion: Motion, rod: Rod) -> float:
    """Return the largest gain of energy until an instant, of all that has moved."""
    nodes = motion.shapes[0].s
    share = rod.mass_per_length * np.convolve(np.diff(nodes), (0.5, 0.5))
    kinetic = np.array([0.5 * share @ np.sum(one**2, axis=1) for one in motion.velocities])
    stored = np.array([one.elastic_energy - share @ one.positions @ GRAVITY
                       for one in motion.shapes])
    energy = kinetic + stored - motion.work + motion.dissipated
    moved = kinetic.max() + np.ptp(stored) + motion.dissipated[-1]
    return float((energy - energy[0]).max() / moved)


def run(scene: Scene, cap: float) -> str:
    """Return the row of a motion."""
    direct = DirectSimulator(scene.rod, obstacles=scene.bodies, gravity=GRAVITY, **scene.mesh)
    begin = process_time()
    try:
        motion = direct.simulate(scene.poses, DT, scene.start, deadline=cap)
    except DeadlineExceeded:
        return f'{scene.what:9s} not within {cap:g} s'
    seconds = process_time() - begin
    shapes = motion.shapes[1:] if motion.status == 'complete' else motion.shapes[1:-1]
    depth = max((deepest(one, scene.rod, scene.bodies) for one in shapes), default=0.0)
    cone = max((beyond_cones(one, scene.bodies) for one in shapes), default=0.0)
    bear = max((len(one.contacts) for one in shapes), default=0)
    return (f'{scene.what:9s} {motion.status:9s} {motion.times[-1]:5.3f} s in {seconds:6.2f} s  '
            f'{bear:3d} bear  gain {gained(motion, scene.rod):8.1e}  '
            f'deep {depth / scene.rod.length:7.1e} L  cone {cone:8.1e}  {motion.message}')


def main() -> None:
    """Print the rows of the motions that are asked for."""
    parser = argparse.ArgumentParser(description='Motions in contact')
    parser.add_argument('names', nargs='*', choices=[*NAMED, []], help='both without')
    parser.add_argument('--random', type=int, default=0, help='how many random ones instead')
    parser.add_argument('--first', type=int, default=0, help='seed of the first of them')
    parser.add_argument('--cap', type=float, default=60.0, help='s of computing for a motion')
    given = parser.parse_args()
    if given.random:
        for seed in range(given.first, given.first + given.random):
            print(run(at_random(seed), given.cap), flush=True)
        return
    for name in given.names or NAMED:
        print(run(NAMED[name]({}), given.cap), flush=True)


if __name__ == '__main__':
    main()
