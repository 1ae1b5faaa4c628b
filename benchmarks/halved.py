# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random motions in contact beside runs of half the step, of a twentieth of the tolerance.

Rods are cables, hoses, copper wires, spring steel, strips and threads; obstacles are floors, walls,
bars, edges of tables, boxes and meshes; a DLO falls, is lowered, drawn, swung, thrown, or held at
both ends; instants are 0.1 to 50 ms apart. Of each motion: its status and CPU time; the greatest
distance of a node from where the finer run, of twice the elements, has it; what `error_estimate`
says, and the most by which the distance is above it, at which instant; the gain of energy, and the
deepest penetration. Where the estimate is too small, or two lengths, how far a third run, of three
times the elements, is from the second there and at the end: if no less, nothing foretells the
motion.

    python -m benchmarks.halved                     60 motions
    python -m benchmarks.halved --first 17 --many 1 one of them
    python -m benchmarks.halved --cap 60            give up what takes more than 60 s
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.moving import gained
from benchmarks.scenes import CABLE, GRAVITY, HOSE, STRIP, WIRE, deepest, pose
from dlo_planner import (
    Box,
    Capsule,
    DeadlineExceeded,
    DirectSimulator,
    InvalidTask,
    Mesh,
    Plane,
    Pose,
    Rod,
    Sphere,
)
from dlo_planner.direct.boundary_motion import GripTrajectory
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.motion import Motion
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.triangles import hull

RODS = {
    'cable': CABLE, 'hose': HOSE, 'spring steel': WIRE, 'strip': STRIP,
    'copper wire': Rod.circular(1.0, 0.0015, 8960, 110e9, 0.34),
    'thread': Rod.circular(0.3, 0.001, 1200, 2e6, 0.45),
}
WAYS = 'fall', 'lowered', 'drawn', 'swung', 'thrown', 'held'
BODIES = 'floor', 'wall', 'bar', 'edge', 'box', 'mesh', 'sphere'
S = np.linspace(0, 1, 25)  # of the length: where motions are compared


class Case(NamedTuple):
    """A motion that is to be computed, on any mesh."""

    what: str
    rod: Rod
    bodies: list[Obstacle]
    poses: list[Pose]
    ends: list[Pose] | None
    dt: float
    tolerance: float
    mesh: dict[str, Any]
    straight: bool            # whether it begins straight, else at rest in its grips
    velocity: Callable[[float], Floats] | None

    def run(self, cap: float, finer: int = 1, s: Floats | None = None) -> Motion:
        """Return the Motion; elements between `s`, steps and tolerance are so much finer."""
        poses, ends = self.poses, self.ends
        direct = DirectSimulator(self.rod, obstacles=self.bodies, gravity=GRAVITY, **self.mesh)
        free = DirectSimulator(self.rod, gravity=(0, 0, 0), **self.mesh)
        if s is not None:
            still = self.velocity is None
            poses, ends = (None if one is None else halved(one, finer, self.dt, still)
                           for one in (poses, ends))
            split = np.interp(np.arange(finer * (len(s) - 1) + 1) / finer, np.arange(len(s)), s)
            direct, free = (DirectSimulator(
                self.rod, obstacles=one.obstacles, gravity=one.gravity, basis='local',
                n_elements=8)._changed(_discretization=Discretization(
                    one.surroundings, split, 'local', 0)) for one in (direct, free))
        start = (free if self.straight else direct).solve(
            poses[0], far_end=None if ends is None else ends[0])
        return direct.simulate(poses, self.dt / finer, start, far_ends=ends,
                               velocity=self.velocity, deadline=cap,
                               tolerance=self.tolerance / (5 * finer**2 if finer > 1 else 1))


def halved(poses: list[Pose], parts: int, dt: float, still: bool) -> list[Pose]:
    """Return the poses of the same motion, `parts` times as dense."""
    way = GripTrajectory(poses, dt, still)
    return [way.at(k / parts) for k in range(parts * (len(poses) - 1) + 1)]


def at_random(seed: int) -> Case:
    """Return the case of a seed."""
    rng = np.random.default_rng([77, seed])
    kind = list(RODS)[seed % len(RODS)]
    way = WAYS[(seed // len(RODS) + seed) % len(WAYS)]
    rod = replace(RODS[kind], damping=(0.0, float(rng.choice([0.0, 1e-3]))))
    length, radius = rod.length, float(rod.radius or 0.0)
    dt = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.05))))
    count = int(np.clip(0.5 / dt, 12, 60))
    last = dt * count
    mesh = {'n_elements': 48, 'basis': 'local'} if rng.random() < 0.6 else {}
    t = np.linspace(0, 1, count + 1)
    smooth = t - np.sin(2 * np.pi * t) / (2 * np.pi)
    # how far it may fall, or be led, within the time: so far that it lands there
    drop = min(0.3 * length, 0.5 * 9.81 * last**2)
    way_of_grip = min(0.3 * length, 20 * last**2)  # (m/s^2: accelerations of some g)
    friction = rng.uniform(0.1, 0.6)
    pitch = {'lowered': 90.0, 'held': 0.0}.get(way, rng.uniform(-10, 30))
    straight = way in ('fall', 'thrown', 'lowered')
    held = pose(0, 0, 0, 0, pitch)
    ends, velocity = None, None
    if way == 'held':
        far = Pose((rng.uniform(0.6, 0.9) * length, 0, 0), (0, 0, 0, 1))
        start = DirectSimulator(rod, gravity=GRAVITY).solve(held, far_end=far)
    else:
        start = DirectSimulator(rod, gravity=(0, 0, 0) if straight else GRAVITY).solve(held)
    low = start.positions[:, 2].min() - radius
    gap = 1e-4 * length + rng.uniform(0.0, 0.7) * (drop if way in ('fall', 'thrown')
                                                   else way_of_grip)
    floor = Plane((0, 0, low - gap), (0, 0, 1), friction=friction)
    # (a strip may touch neither a mesh nor a sphere)
    what = rng.choice(BODIES[:-2] if kind == 'strip' else BODIES)
    if way == 'lowered' and what != 'wall':
        what = 'floor'  # which it lands on with its tip
    tip = start.positions[-1]
    bodies: list[Obstacle] = [floor]
    middle = start.positions[len(start.s) * 2 // 3]
    size = 0.05 * length
    under = middle + (0, 0, -radius - gap)
    if what == 'wall':
        bodies.append(Plane((tip[0] + radius + 0.3 * gap, 0, 0), (-1, 0, 0), friction=friction))
    elif what == 'bar':
        bodies = [Capsule(under + (0, -length, -size), under + (0, length, -size), size,
                          friction=friction)]
    elif what in ('edge', 'box'):
        width = 2 * length if what == 'edge' else 2 * size
        depth = np.array([-0.5 * width if what == 'edge' else 0.0, 0, -size])
        top = start.positions[start.positions[:, 0] <= middle[0]][:, 2].min()
        under = under if what == 'box' else np.array([middle[0], 0, top - radius - gap])
        bodies = [Box(Pose(under + depth, (0, 0, 0, 1)), (width, 2 * length, 2 * size),
                      friction=friction)]
    elif what == 'mesh':
        bodies = [replace(_ball(under - (0, 0, 2 * size), 2 * size), friction=friction)]
    elif what == 'sphere':
        bodies = [Sphere(under - (0, 0, 2 * size), 2 * size, friction=friction)]
    to = np.zeros(3)
    if way == 'lowered':
        to = np.array([0, 0, -rng.uniform(1.0, 1.2) * gap - 0.3 * way_of_grip])
    elif way == 'drawn':
        to = np.array([*rng.uniform(-0.4, 0.4, 2), -rng.uniform(0.5, 1.0)]) * way_of_grip
    elif way in ('swung', 'held'):
        to = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), -1.0]) * way_of_grip
    course = smooth[:, None] * to
    if way == 'swung':
        course = np.sin(np.pi * t * smooth)[:, None] * to
    if way == 'thrown':
        speed, down = rng.uniform(0.5, 3.0), -held.rotation[:, 2]

        def velocity(s: float) -> Floats:
            return np.asarray(speed * (s / length)**2 * down)
    poses = [Pose(one, held.quaternion) for one in course]
    if way == 'held':
        ends = [Pose(far.position + one, far.quaternion) for one in course]
    tolerance = 1e-3 * length * float(rng.choice([1.0, 0.3]))
    return Case(f'{seed:3d} {kind} {way} on {what}', rod, bodies, poses, ends, dt, tolerance, mesh,
                straight, velocity)


def _ball(center: Floats, radius: float) -> Mesh:
    """Return the hull of 60 points of a sphere."""
    k = np.arange(60) + 0.5
    z, turn = 1 - 2 * k / 60, np.pi * (1 + 5**0.5) * k
    points = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], 1)
    ball = hull('ball', radius * points)
    return Mesh(ball.vertices + center, ball.faces)


def apart(one: Motion, other: Motion, parts: int) -> Floats:
    """Return (n,) the greatest distance until each instant that both have, m."""
    places = [[shape.positions_at(S * shape.s[-1]) for shape in motion.shapes]
              for motion in (one, other)]
    coarse, fine = places[0], places[1][::parts]
    n = min(len(coarse), len(fine))
    far = np.linalg.norm(np.array(coarse[:n]) - np.array(fine[:n]), axis=2).max(axis=1)
    return np.maximum.accumulate(far)


def judge(case: Case, cap: float) -> str:
    """Return the row of a case."""
    size = case.rod.length
    begin = process_time()
    head = f'{case.what:34s} dt {case.dt:7.1e} x {len(case.poses) - 1:2d}'
    try:
        motion = case.run(cap=cap)
    except DeadlineExceeded:
        return f'{head} not within {cap:g} s'
    seconds = process_time() - begin
    begin = process_time()
    estimate = motion.error_estimate / size
    later = process_time() - begin
    complete = motion.status == 'complete'
    shapes = motion.shapes[1:] if complete else motion.shapes[1:-1]
    depth = max((deepest(one, case.rod, case.bodies) for one in shapes), default=0.0)
    bear = max((len(one.contacts) for one in shapes), default=0)
    row = (f'{head} {motion.status:9s} {seconds:5.1f} + {later:4.1f} s {bear:3d} bear '
           f'gain {gained(motion, case.rod):8.1e} deep {depth / size:7.1e} L')
    s = motion.shapes[0].s
    try:
        finer = case.run(3 * cap, 2, s)
        far = apart(motion, finer, 2) / size
    except DeadlineExceeded:
        return f'{row} estimate {estimate[-1]:7.1e} finer not within {3 * cap:g} s'
    n = len(far) if complete and finer.status == 'complete' else len(far) - 1
    far, said = far[:n], estimate[:n]
    k = int(np.argmax(far / (said + 1e-7)))
    ratio = far[k] / said[k]
    row += (f' off {far[-1]:7.1e} said {said[-1]:7.1e} most {ratio:6.2f} at {k:2d}'
            f' ({far[k]:7.1e})')
    if finer.status != 'complete':
        row += f' finer {finer.status}'
    if (ratio > 2 and far[k] > 1e-6) or said[-1] > 0.5:
        try:
            finest = case.run(3 * cap, 3, s)
            between = np.maximum.accumulate(_between(finest, finer))[:n] / size
            row += f' finer ones apart {between[min(k, len(between) - 1)]:7.1e}'
            row += f' {between[-1]:7.1e}'
        except DeadlineExceeded:
            row += ' finest not in time'
    return row + ('' if complete else f'  {motion.message}')


def _between(finest: Motion, finer: Motion) -> Floats:
    """Return (n,) the distances of two finer motions at the instants of the first one, m."""
    places = [np.array([shape.positions_at(S * shape.s[-1]) for shape in motion.shapes[::parts]])
              for motion, parts in ((finest, 3), (finer, 2))]
    n = min(map(len, places))
    return np.linalg.norm(places[0][:n] - places[1][:n], axis=2).max(axis=1)


def main() -> None:
    """Print the rows of the motions that are asked for."""
    parser = argparse.ArgumentParser(description='Motions in contact beside halved steps')
    parser.add_argument('--many', type=int, default=60)
    parser.add_argument('--first', type=int, default=0, help='seed of the first of them')
    parser.add_argument('--cap', type=float, default=30.0, help='s of computing for a motion')
    given = parser.parse_args()
    for seed in range(given.first, given.first + given.many):
        try:
            print(judge(at_random(seed), given.cap), flush=True)
        except InvalidTask as error:  # drawn at random, some begin in an obstacle
            print(f'{seed:3d} {error}', flush=True)


if __name__ == '__main__':
    main()
