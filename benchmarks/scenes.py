# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Ordinary scenes of contact: a cable on a table, over an edge, into a corner; a hose, a strip.

Each scene is a row of gripper poses 1 to 2 cm apart. Of each step: whether it converged, whether a
fall was said, its CPU time; of all shapes the deepest penetration by distances of their own, the
balance of forces, and by how much friction exceeds Coulomb's cone.

    python -m benchmarks.scenes                all scenes, 64 local elements
    python -m benchmarks.scenes laid edge      some of them
    python -m benchmarks.scenes --cap 20       no more than 20 s of CPU time for a scene
    python -m benchmarks.scenes --drawn 1      the same with other rods and frictions, of this seed
    python -m benchmarks.scenes --default      on the meshes that the default accuracy takes
    python -m benchmarks.scenes --seeds 8      sums over these and those of seeds 1 to 8: falls
                                               are chaotic, and a single one says nothing
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DeadlineExceeded,
    DirectSimulator,
    FarEnd,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle

GRAVITY = (0.0, 0.0, -9.81)
CABLE = Rod(1.0, 0.035, 1.2e-3, 9e-4, radius=0.0025)  # a USB cable of 5 mm
LIMP = Rod(1.0, 0.05, 2e-4, 1.5e-4, radius=0.003)
HOSE = Rod(2.0, 0.18, 0.25, 0.2, radius=0.01)         # a garden hose of 20 mm
WIRE = Rod.circular(0.5, 0.0015, 7850, 2.0e11, 0.3)   # steel
STRIP = Rod.rectangular(0.4, 0.02, 0.0005, 7850, 2.0e11, 0.3)
POINTS = 10   # of an element, where its distance is looked at
LIMIT = 20.0  # s of a step: what takes longer is given up
SLOW = 0.2    # s of a step that is slow

Scene = tuple[Rod, list[Obstacle], list[Pose]]


def pose(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0) -> Pose:
    """Return a gripper pose, m and degrees; `pitch` is downwards."""
    return Pose((x, y, z), Rotation.from_euler('zy', [yaw, pitch], degrees=True).as_quat())


def table(friction: float = 0.5) -> Plane:
    """Return a horizontal plane."""
    return Plane((0, 0, 0), (0, 0, 1), friction=friction)


def lowered(first: float, last: float, steps: int, pitch: float) -> list[Pose]:
    """Return poses that go down."""
    return [pose(0, 0, z, 0, pitch) for z in np.linspace(first, last, steps)]


def _laid() -> Scene:
    return CABLE, [table()], lowered(0.6, 0.03, 30, 30)


def _straight_down() -> Scene:
    return CABLE, [table()], lowered(1.02, 0.42, 31, 90)


def _limp_down() -> Scene:
    return LIMP, [table()], lowered(1.02, 0.42, 31, 90)


def _edge() -> Scene:
    box = Box(Pose((-0.3, 0, -0.2), (0, 0, 0, 1)), (0.6, 0.6, 0.4), friction=0.4)
    down = [pose(-0.5, 0, z) for z in np.linspace(0.12, 0.02, 6)]
    return CABLE, [box], down + [pose(x, 0, 0.02) for x in np.linspace(-0.48, -0.06, 22)]


def _peg() -> Scene:
    peg = Capsule((0.1, 0, -0.5), (0.1, 0, 0.5), 0.015, friction=0.3)
    return CABLE, [peg], [pose(0, y, 0.2) for y in np.linspace(-0.05, 0.25, 31)]


def _peg_on_table() -> Scene:
    peg = Capsule((0.4, 0.03, -0.1), (0.4, 0.03, 0.2), 0.01, friction=0.3)
    aside = [pose(0, y, 0.05, 0, 20) for y in np.linspace(0.01, 0.2, 20)]
    return CABLE, [table(0.4), peg], lowered(0.5, 0.05, 16, 20) + aside


def _corner() -> Scene:
    wall = Plane((0.6, 0, 0), (-1, 0, 0), friction=0.4)
    down = [pose(0.15, 0, z, 0, 40) for z in np.linspace(0.35, 0.15, 11)]
    return WIRE, [table(0.4), wall], down + [pose(x, 0, 0.15, 0, 40)
                                             for x in np.linspace(0.16, 0.3, 15)]


def _cable_corner() -> Scene:
    wall = Box(Pose((0.9, 0, 0.1), (0, 0, 0, 1)), (0.1, 0.5, 0.3), friction=0.4)
    on = [pose(x, 0, 0.06, 0, 20) for x in np.linspace(0.02, 0.3, 15)]
    return CABLE, [table(0.4), wall], lowered(0.5, 0.06, 16, 20) + on


def _hose() -> Scene:
    on = [pose(x, 0, 0.25, 0, 30) for x in np.linspace(0.03, 0.21, 7)]
    aside = [pose(0.21, 0.03 * k, 0.25, 4 * k, 30) for k in range(1, 8)]
    return HOSE, [table(0.6)], lowered(1.0, 0.25, 16, 30) + on + aside


def _dragged() -> Scene:
    back = [pose(-0.02 * k, 0.02 * k, 0.04, 0, 20) for k in range(1, 16)]
    return CABLE, [table(0.3)], lowered(0.5, 0.04, 16, 20) + back


def _strip() -> Scene:
    return STRIP, [table(0.3)], lowered(0.25, 0.06, 20, 45)


def _hole() -> Scene:
    cutout = CutOut(Pose((0.3, 0, 0), (0, 0, 0, 1)), radius=0.006)
    on = [pose(x, 0, 0.002) for x in np.linspace(-0.25, -0.06, 20)]
    aside = [pose(-0.06, y, 0.002) for y in np.linspace(0.005, 0.04, 8)]
    return WIRE, [Sheet.around(cutout, 0.3, 0.3, 0.002, 0.2)], on + aside


def _bar() -> Scene:
    bar = Capsule((0.25, -0.3, 0), (0.25, 0.3, 0), 0.01, friction=0.3)
    down = [pose(0, 0, z) for z in np.linspace(0.2, -0.08, 15)]
    return CABLE, [bar], down + [pose(x, 0, -0.08) for x in np.linspace(-0.015, -0.165, 11)]


def _channel() -> Scene:
    sides: list[Obstacle] = [Box(Pose((0.5, y, 0.02), (0, 0, 0, 1)), (0.6, 0.02, 0.04),
                                 friction=0.4) for y in (0.03, -0.03)]
    turned = [pose(0, 0, 0.06, 2 * k, 25) for k in range(1, 8)]
    return CABLE, [table(0.4), *sides], lowered(0.5, 0.06, 23, 25) + turned


def _ball() -> Scene:
    ball = Sphere((0.35, 0.01, -0.1), 0.08, friction=0.3)
    return CABLE, [ball], [pose(0, 0, z) for z in np.linspace(0.25, -0.13, 20)]


SCENES: dict[str, Callable[[], Scene]] = {
    'laid': _laid, 'straight-down': _straight_down, 'limp-down': _limp_down, 'edge': _edge,
    'peg': _peg, 'peg-on-table': _peg_on_table, 'corner': _corner,
    'cable-corner': _cable_corner, 'hose': _hose, 'dragged': _dragged, 'strip': _strip,
    'hole': _hole, 'bar': _bar, 'channel': _channel, 'ball': _ball}


def _both_down() -> tuple[Scene, list[Pose]]:
    down = np.linspace(0.6, 0.05, 20)
    return (CABLE, [table(0.4)], [pose(0, 0, z) for z in down]), [pose(0.7, 0, z) for z in down]


def _one_down() -> tuple[Scene, list[Pose]]:
    poses = [pose(0, 0, z, 0, 20) for z in np.linspace(0.6, 0.05, 20)]
    return (CABLE, [table(0.4)], poses), [pose(0.8, 0, 0.03)] * 20


def _drawn_aside() -> tuple[Scene, list[Pose]]:
    poses = [pose(0, y, 0.05, 0, 20) for y in np.linspace(0, 0.3, 20)]
    return (CABLE, [table(0.4)], poses), [pose(0.8, 0, 0.05, 0, -20)] * 20


def _over_a_bar() -> tuple[Scene, list[Pose]]:
    bar, down = Capsule((0.8, -1, 0), (0.8, 1, 0), 0.03, friction=0.3), np.linspace(0.6, -0.1, 20)
    return (HOSE, [bar], [pose(0, 0, z) for z in down]), [pose(1.5, 0, z) for z in down]


# The same with a second grip at the tip, and where that goes
HELD: dict[str, Callable[[], tuple[Scene, list[Pose]]]] = {
    'both-down': _both_down, 'one-down': _one_down, 'drawn-aside': _drawn_aside,
    'over-a-bar': _over_a_bar}


def drawn(name: str, seed: int) -> Scene:
    """Return a scene with other frictions, 0.2 to 0.8, and a stiffer or softer rod, if round."""
    rod, bodies, poses = SCENES[name]() if name in SCENES else HELD[name]()[0]
    rng = np.random.default_rng([seed, *name.encode()])
    stiffer, heavier = np.exp(rng.uniform(-1.0, 1.0)), np.exp(rng.uniform(-0.5, 0.5))
    other = Rod(rod.length, heavier * rod.mass_per_length,
                stiffer * np.array(rod.bending_stiffness), stiffer * rod.torsional_stiffness,
                radius=rod.radius)
    if rod.section is not None and rod.section.kind == 'rectangular':
        other = rod
    return other, [replace(one, friction=rng.uniform(0.2, 0.8)) for one in bodies], poses


# ------------------------------------------------------------------------------------------------
# The judge: distances, balance and cones by their definitions.


def distances(points: Floats, body: Obstacle) -> Floats | None:
    """Return (n,) how far points (n, 3) are from a body, m; None of one that is not known here."""
    if isinstance(body, Plane):
        normal = np.array(body.normal) / np.linalg.norm(body.normal)
        return (points - body.point) @ normal
    if isinstance(body, Sphere):
        return np.linalg.norm(points - body.center, axis=1) - body.radius
    if isinstance(body, Capsule):
        way = np.subtract(body.end, body.start)
        part = np.clip((points - body.start) @ way / (way @ way), 0.0, 1.0)
        return np.linalg.norm(points - body.start - part[:, None] * way, axis=1) - body.radius
    if isinstance(body, Box):
        out = np.abs((points - body.pose.position) @ body.pose.rotation) - 0.5 * np.array(body.size)
        return np.linalg.norm(np.maximum(out, 0.0), axis=1) + np.minimum(out.max(axis=1), 0.0)
    return None


def deepest(shape: Shape, rod: Rod, bodies: Iterable[Obstacle]) -> float:
    """Return how deep the surface of a round DLO is in a body, m; nan of other DLOs."""
    if rod.section is not None and rod.section.kind == 'rectangular':
        return float('nan')
    s = np.linspace(0.0, rod.length, POINTS * len(shape.element_strains) + 1)
    points = shape.positions_at(s[s > 2e-3 * rod.length])
    depth = 0.0
    for body in bodies:
        away = distances(points, body)
        if away is not None:
            depth = max(depth, float(rod.radius or 0.0) - float(away.min()))
    return depth


def unbalanced(shape: Shape, rod: Rod) -> float:
    """Return the sum of all forces on a DLO, of their sizes."""
    weight = rod.mass_per_length * rod.length * np.array(GRAVITY)
    loads = [np.asarray(one.vector) for one in shape.contacts]
    total = weight + shape.gripper_wrench[:3] + sum(loads, np.zeros(3))
    if shape.far_end is not None:
        total += shape.far_wrench[:3]
    return float(np.linalg.norm(total) / (np.linalg.norm(weight)
                                          + sum(float(np.linalg.norm(one)) for one in loads)))


def beyond_cones(shape: Shape, bodies: list[Obstacle]) -> float:
    """Return by how much friction exceeds its limit, of the normal force."""
    return max((float(np.linalg.norm(one.friction)) / one.force - bodies[one.obstacle].friction
                for one in shape.contacts if one.force > 1e-6), default=0.0)


def run(name: str, cap: float, seed: int | None = None, default: bool = False) -> str:
    """Return the row of a scene; with a `seed` it is `drawn`; on 64 elements, or the `default`."""
    rod, bodies, poses, ends = _scene(name, seed)
    direct = _simulator(rod, bodies, default)
    times: list[float] = []
    failed = fell = 0
    depth = wrong = cone = 0.0
    for shape, time in _steps(direct, poses, ends):
        times.append(time)
        if shape is None:
            failed += 1
            break
        failed, fell = failed + (not shape.converged), fell + shape.jumped
        if shape.converged:
            depth = np.fmax(depth, deepest(shape, rod, bodies))
            wrong, cone = max(wrong, unbalanced(shape, rod)), max(cone, beyond_cones(shape, bodies))
        if sum(times) > cap:
            break
    first, rest = times[0], np.array(times[1:] or [np.nan])
    return (f'{name:14s} {len(times):3d} of {len(poses):2d}  failed {failed:2d}  fell {fell:2d}  '
            f'first {1e3 * first:6.0f} ms, then median {1e3 * np.median(rest):7.1f} '
            f'90 % {1e3 * np.quantile(rest, 0.9):7.0f} most {1e3 * rest.max():7.0f} ms  '
            f'deep {depth:7.1e} m  forces {wrong:7.1e}  cone {cone:8.1e}')


def _scene(name: str, seed: int | None) -> tuple[Rod, list[Obstacle], list[Pose],
                                                 list[Pose] | None]:
    """Return a scene, `drawn` if there is a seed, with the poses of a grip of the tip or None."""
    ends = HELD[name]()[1] if name in HELD else None
    if seed is not None:
        return *drawn(name, seed), ends
    return *(HELD[name]()[0] if name in HELD else SCENES[name]()), ends


def _simulator(rod: Rod, bodies: list[Obstacle], default: bool) -> DirectSimulator:
    """Return what follows a scene, on 64 local elements, or those that the `default` takes."""
    if default:
        return DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY)
    return DirectSimulator(rod, obstacles=bodies, gravity=GRAVITY, basis='local', n_elements=64)


def summed(names: Iterable[str], seeds: int, default: bool) -> str:
    """Return a row of sums over all steps but the first, of scenes as they are and by each seed."""
    times: list[float] = []
    failed, medians, estimates = 0, [], []
    for name in names:
        for seed in range(seeds + 1):
            rod, bodies, poses, ends = _scene(name, seed or None)
            steps = list(_steps(_simulator(rod, bodies, default), poses, ends))
            medians.append(np.median([time for _, time in steps[1:]]))
            for shape, time in steps[1:]:
                times.append(time)
                failed += shape is None or not shape.converged
                if shape is not None and shape.jumped and shape.contacts:
                    estimates.append(shape.error_estimate)
    slow = int(np.sum(np.array(times) > SLOW))
    return (f'{len(times)} steps  {slow} above {SLOW} s ({slow / len(times):.2%})  '
            f'worst {1e3 * max(times):.0f} ms  sum {sum(times):.1f} s  '
            f'largest median {1e3 * max(medians):.0f} ms  failed {failed}  '
            f'falls {len(estimates)}, {int(np.sum(np.isinf(estimates)))} without an estimate')


def _steps(direct: DirectSimulator, poses: list[Pose],
           ends: list[Pose] | None = None) -> Iterator[tuple[Shape | None, float]]:
    """Yield each Shape, None of what takes too long, and its CPU time in s; `ends`: of the tip."""
    before: Shape | None = None
    for k, one in enumerate(poses):
        begin = process_time()
        held = None if ends is None else [FarEnd(ends[k])]
        try:
            shape = direct.track([one], far_ends=held, initial=before, deadline=LIMIT)[0]
        except DeadlineExceeded:
            yield None, process_time() - begin
            return
        yield shape, process_time() - begin
        if shape.converged or shape.nearly:
            before = shape


def main() -> None:
    """Print the rows of the scenes that are named."""
    parser = argparse.ArgumentParser(description='Ordinary scenes of contact')
    parser.add_argument('names', nargs='*', choices=[*SCENES, *HELD, []], help='all without')
    parser.add_argument('--cap', type=float, default=60.0, help='s of CPU time for a scene')
    parser.add_argument('--default', action='store_true', help='meshes of the default accuracy')
    parser.add_argument('--drawn', type=int, metavar='SEED', help='with other rods and frictions')
    parser.add_argument('--seeds', type=int, metavar='N', help='sums over these scenes, and those '
                        'drawn by seeds 1 to N')
    given = parser.parse_args()
    if given.seeds is not None:
        for kind in (SCENES, HELD):
            print(summed([name for name in kind if name in (given.names or kind)], given.seeds,
                         given.default), flush=True)
        return
    for name in given.names or [*SCENES, *HELD]:
        print(run(name, given.cap, given.drawn, given.default), flush=True)


if __name__ == '__main__':
    main()
