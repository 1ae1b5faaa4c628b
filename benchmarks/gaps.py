# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Stated clearances and depths of contacts, held against brute force by plain NumPy.

Nothing here calls a kernel: elements are sampled densely on their exact helices, distances are
computed by formulas of their own, and the lowest samples are looked at closer until nothing more is
found. `python -m benchmarks.gaps clearance 20000` draws near-critical passages, with rooms of a
thousandth of the length on either side of zero, and prints by how much the stated clearance exceeds
the real one; `python -m benchmarks.gaps contact 1000` does the same for steps in tight holes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, lru_cache
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    DirectSimulator,
    Ellipsoid,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import Bodies, clearance

SPACING = 0.1   # of the DLO's radius: a hole is wider, and so are minima beside it apart
LEAST, MOST = 60, 3000  # samples of an element
ZOOMS = 5       # looks at the lowest samples, each 20 times closer
SIDE = np.linspace(-1, 1, 9)
AROUND = np.array([(a, b) for a in SIDE for b in SIDE if max(abs(a), abs(b)) == 1])
KINDS = ('hole', 'own hole', 'two holes', 'slot', 'box', 'capsule', 'cylinder', 'ellipsoid',
         'sphere', 'strip on a box', 'strip on a capsule', 'strip in a hole', 'tapered')


# ------------------------------------------------------------------------------------------------
# The DLO: exact helices.


def helix(axes, strain, h):
    """Return (..., 3) where a helix goes in arc lengths h (...,), and (..., 3, 3) its turns."""
    size = np.linalg.norm(strain)
    turns = Rotation.from_rotvec(np.multiply.outer(h, strain)).as_matrix()
    first = np.cross(strain, (1.0, 0.0, 0.0))
    second = np.cross(strain, first)
    angle = size * h
    small = np.abs(angle) < 1e-3
    safe = np.where(small, 1.0, angle)
    by_first = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2) * h**2
    by_second = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3) * h**3
    chord = (np.multiply.outer(h, (1.0, 0.0, 0.0)) + np.multiply.outer(by_first, first)
             + np.multiply.outer(by_second, second))
    return chord @ axes.T, axes @ turns


def bent(s, strains, gripper):
    """Return frames (N + 1, 3, 3) and positions (N + 1, 3) of a DLO of such strains (N, 3)."""
    frames, positions = [gripper.rotation], [np.array(gripper.position)]
    for h, strain in zip(np.diff(s), strains, strict=True):
        way, turned = helix(frames[-1], strain, np.array([h]))
        positions.append(positions[-1] + way[0])
        frames.append(turned[0])
    return np.array(frames), np.array(positions)


def places(shape, e, fractions):
    """Return (n, 3) places of the axis of element e, and its frames (n, 3, 3)."""
    h = fractions * (shape.s[e + 1] - shape.s[e])
    way, turned = helix(shape.frames[e], shape.element_strains[e], h)
    return shape.positions[e] + way, turned


# ------------------------------------------------------------------------------------------------
# Distances, negative inside.


def _box_distance(local, half):
    beyond = np.abs(local) - half
    return (np.linalg.norm(np.maximum(beyond, 0), axis=-1)
            + np.minimum(beyond.max(axis=-1), 0))


def distance(body, points):
    """Return (...,) distances of points (..., 3) from a body."""
    if isinstance(body, Sphere):
        return np.linalg.norm(points - body.center, axis=-1) - body.radius
    if isinstance(body, (Capsule, Cylinder)):
        way = body.end - body.start
        size = np.linalg.norm(way)
        along = (points - body.start) @ (way / size)
        if isinstance(body, Capsule):
            nearest = body.start + np.multiply.outer(np.clip(along, 0, size), way / size)
            return np.linalg.norm(points - nearest, axis=-1) - body.radius
        away = points - body.start - np.multiply.outer(along, way / size)
        beside = np.linalg.norm(away, axis=-1) - body.radius
        ends = np.abs(along - size / 2) - size / 2
        outside = np.hypot(np.maximum(beside, 0), np.maximum(ends, 0))
        return outside + np.minimum(np.maximum(beside, ends), 0)
    local = (points - body.pose.position) @ body.pose.rotation
    if isinstance(body, Box):
        return _box_distance(local, body.size / 2)
    if isinstance(body, Ellipsoid):
        return _ellipsoid_distance(local, np.array(body.half_axes))
    return _sheet_distance(body, local)


def _ellipsoid_distance(local, half):
    """By bisection of the multiplier, outside; inside, the least over bisections is not needed."""
    low = np.full(local.shape[:-1], -half.min() ** 2 * (1 - 1e-12))
    high = np.linalg.norm(local, axis=-1) * half.max() + 1e-300
    for _ in range(100):
        t = 0.5 * (low + high)
        size = ((half * local / (half**2 + t[..., None])) ** 2).sum(axis=-1)
        low, high = np.where(size > 1, t, low), np.where(size > 1, high, t)
    nearest = half**2 * local / (half**2 + (0.5 * (low + high))[..., None])
    inside = ((local / half) ** 2).sum(axis=-1) < 1
    return np.linalg.norm(local - nearest, axis=-1) * np.where(inside, -1, 1)


def _sheet_distance(sheet, local):
    """Of a plate whose holes are far from its border and from each other."""
    plane, height = local[..., 1:], np.abs(local[..., 0]) - sheet.thickness / 2
    out = _box_distance(plane, np.array([sheet.width, sheet.height]) / 2)
    for one in sheet.cutouts:
        away = plane - (sheet.pose.rotation.T @ (one.center - sheet.pose.position))[1:]
        if one.radius is not None:
            room = one.radius - np.linalg.norm(away, axis=-1)
        else:
            turn = sheet.pose.rotation[:, 1:].T @ one.pose.rotation[:, 1:]
            room = (np.array([one.width, one.height]) / 2 - np.abs(away @ turn)).min(axis=-1)
        out = np.maximum(out, room)
    outside = np.hypot(np.maximum(out, 0), np.maximum(height, 0))
    return outside + np.minimum(np.maximum(out, height), 0)


# ------------------------------------------------------------------------------------------------
# The least gap.


def gaps_along(shape, surface, body, e, fractions):
    """Return (n,) the gaps at fractions of an element; of a strip, of points all around it."""
    axis, frames = places(shape, e, fractions)
    if surface.half is None:
        radius = surface.radius
        if surface.rod is not None:
            ends = surface.radii(shape.s)[e]
            radius = ends[0] + fractions * (ends[1] - ends[0])
        return distance(body, axis) - radius
    outside = axis[:, None] + np.einsum('nij,cj->nci', frames[:, :, 1:], AROUND * surface.half)
    return distance(body, outside).min(axis=1)


def least(shape, surface, body, near=np.inf):
    """Return the least gap of a DLO to a body, by samples; inf where none comes within `near`."""
    best = np.inf
    reach = np.diff(shape.s) + 2 * surface.radius * (surface.half is not None)
    nodes = distance(body, shape.positions) - surface.radius
    bounds = np.minimum(nodes[1:], nodes[:-1]) - reach  # no gap changes by more than the way
    for e in np.argsort(bounds):
        if bounds[e] > min(near, best):
            break
        many = int(np.clip(reach[e] / (SPACING * surface.radius), LEAST, MOST))
        found = np.linspace(0, 1, many + 1)
        gaps = gaps_along(shape, surface, body, e, found)
        best = min(best, gaps.min())
        lowest = gaps <= np.minimum(np.append(gaps[1:], np.inf), np.append(np.inf, gaps[:-1]))
        for k in np.flatnonzero(lowest & (gaps - 2 * reach[e] / many < best)):
            middle, width = found[k], 1 / many
            for _ in range(ZOOMS):
                closer = np.clip(np.linspace(middle - width, middle + width, 41), 0, 1)
                gaps_closer = gaps_along(shape, surface, body, e, closer)
                middle, width = closer[gaps_closer.argmin()], width / 20
                best = min(best, gaps_closer.min())
    return best


# ------------------------------------------------------------------------------------------------
# Near-critical cases.

LENGTH = 1.0
SAME = 8  # cases of one shape


@cache
def _template(n):
    rod = Rod(LENGTH, 0.0, 1.0, 1.0, radius=1e-3)
    return DirectSimulator(rod, gravity=(0, 0, 0), basis='local', n_elements=n).solve(
        Pose.identity())


@lru_cache(maxsize=2)
def any_shape(*seed):
    """Return a Shape of 16 to 200 elements, even or graded, bent and twisted as it comes."""
    rng = np.random.default_rng(seed)
    n = int(rng.choice([16, 24, 40, 64, 100, 200]))
    s = np.linspace(0, LENGTH, n + 1)
    if rng.random() < 0.5:
        s = LENGTH * np.concatenate([[0], np.cumsum(rng.uniform(0.3, 3.0, n))])
        s /= s[-1] / LENGTH
    t = 0.5 * (s[1:] + s[:-1]) / LENGTH
    strains = np.zeros((n, 3))
    for k in range(3):
        size = rng.choice([0.0, 1.0, 3.0, 8.0]) / LENGTH
        strains[:, k] = size * (rng.normal() + rng.normal() * np.cos(np.pi * t)
                                + rng.normal() * np.cos(2 * np.pi * t))
    gripper = Pose.from_rotation(rng.normal(size=3), Rotation.random(random_state=rng).as_matrix())
    frames, positions = bent(s, strains, gripper)
    return replace(_template(n), s=s, gripper=gripper, element_strains=strains, frames=frames,
                   positions=positions)


def straight(gripper, length):
    """Return a straight Shape of two elements."""
    n = 2
    s = np.linspace(0, length, n + 1)
    frames, positions = bent(s, np.zeros((n, 3)), gripper)
    return replace(_template(n), s=s, gripper=gripper, element_strains=np.zeros((n, 3)),
                   frames=frames, positions=positions)


def _frame_somewhere(rng, shape):
    e = int(rng.integers(1, shape.s.size - 2))
    (place,), (axes,) = places(shape, e, rng.uniform(0, 1, 1))
    return place, axes


def _about(rng, normal):
    return Rotation.from_rotvec(rng.uniform(0, 2 * np.pi) * normal).as_matrix()


def _hole(rng, shape, surface, *, others=0, square=False):
    """Return a Sheet of which the DLO passes a hole, obliquely, with about no room."""
    place, axes = _frame_somewhere(rng, shape)
    tilt = rng.choice([0.3, 0.8, 1.1, 1.4]) * rng.random()
    angle = rng.uniform(0, 2 * np.pi)
    normal = axes @ [np.cos(tilt), np.sin(tilt) * np.cos(angle), np.sin(tilt) * np.sin(angle)]
    pose = Pose.from_rotation((0, 0, 0), _about(rng, normal)
                              @ Pose.looking_along((0, 0, 0), normal).rotation)
    thick = rng.choice([0.0, 0.2, 1.0, 3.0, 8.0]) * surface.radius * rng.uniform(0.5, 1.0)
    radius = surface.radius * rng.uniform(1.02, 3.0)
    off = rng.uniform(-1, 1, 2) * max(radius - surface.radius, 0) * rng.choice([0.0, 0.3, 0.9])
    center = place + pose.rotation[:, 1:] @ off + rng.uniform(-0.5, 0.5) * thick * normal
    for _ in range(4):  # until it passes with about no room
        sheet = _sheet(pose, center, radius, thick, others, square)
        gap = _roughly(shape, surface, sheet)
        wanted = rng.uniform(-1, 1) * rng.choice([1e-3, 1e-4, 1e-5]) * LENGTH
        radius = min(max(radius + wanted - gap, 1.02 * surface.radius), 3.0 * surface.radius)
    return sheet


def _sheet(pose, center, radius, thick, others, square):
    at = Pose(center, pose.quaternion)
    size = {'width': 2.0 * radius, 'height': 3.0 * radius} if square else {'radius': radius}
    holes = [CutOut(at, **size)]
    for k in range(others):
        beside = center + pose.rotation[:, 1 + k % 2] * (1.0 + 0.2 * k) * 2.5 * radius
        holes.append(CutOut(Pose(beside, pose.quaternion), radius=radius))
    return Sheet(at, 0.3 * LENGTH, 0.3 * LENGTH, thick, tuple(holes))


def _roughly(shape, surface, body):
    """Return a gap by few samples of what is near."""
    nodes = distance(body, shape.positions) - surface.radius
    best, fractions = np.inf, np.linspace(0, 1, 21)
    for e in np.argsort(np.minimum(nodes[1:], nodes[:-1]))[:5]:
        best = min(best, gaps_along(shape, surface, body, e, fractions).min())
    return best


def _beside(rng, shape, surface, make):
    """Return a body beside the DLO, shifted until there is about no room; make(place, out)."""
    place, axes = _frame_somewhere(rng, shape)
    angle = rng.uniform(0, 2 * np.pi)
    out = axes @ [0.3 * rng.normal(), np.cos(angle), np.sin(angle)]
    out /= np.linalg.norm(out)
    away = 0.02
    for _ in range(4):
        body = make(place + away * out)
        wanted = rng.uniform(-1, 1) * rng.choice([1e-3, 1e-4, 1e-5]) * LENGTH
        away += wanted - _roughly(shape, surface, body)
    return body


def case(kind, index, seed=0):
    """Return a Shape, a Surface and a body of one kind."""
    shape = any_shape(seed, KINDS.index(kind), index // SAME, 1)
    rng = np.random.default_rng([seed, KINDS.index(kind), index])
    surface = Surface(LENGTH * 10 ** rng.uniform(-3.3, -2.0))
    if kind.startswith('strip'):
        surface = Surface.of(Rod.rectangular(LENGTH, *(LENGTH * rng.uniform(0.002, 0.02, 2)),
                                             1000.0, 1e8, 0.3))
    if kind == 'tapered':
        radii = rng.uniform(5e-4, 5e-3, 5) * LENGTH
        surface = Surface.of(Rod(LENGTH, 0.0, 1.0, 1.0, radius=tuple(
            zip(np.linspace(0, LENGTH, 5), radii, strict=True))))
    if kind in ('hole', 'own hole', 'tapered', 'strip in a hole'):
        return shape, surface, _hole(rng, shape, surface)
    if kind in ('two holes', 'slot'):
        return shape, surface, _hole(rng, shape, surface, others=2 if kind == 'two holes' else 0,
                                     square=kind == 'slot')
    turn = Rotation.random(random_state=rng).as_matrix()
    size = LENGTH * 10 ** rng.uniform(-2.7, -1.3, 3)

    def make(place):
        if kind == 'sphere':
            return Sphere(place, size[0])
        if kind.endswith('capsule'):
            return Capsule(place - size[1] * turn[0], place + size[1] * turn[0], size[0])
        if kind == 'cylinder':
            return Cylinder(place - size[1] * turn[0], place + size[1] * turn[0], size[0])
        pose = Pose.from_rotation(place, turn)
        return Ellipsoid(pose, size) if kind == 'ellipsoid' else Box(pose, size)

    return shape, surface, _beside(rng, shape, surface, make)


def stated(kind, shape, surface, body):
    """Return the clearance that is stated."""
    if kind != 'own hole':
        return clearance([body], surface, shape)
    return Bodies([(body, body.pose.direction)], [], surface).exact(shape)


def overstated(kind: str, count: int, seed: int = 0) -> Iterator[tuple[float, float, int]]:
    """Yield by how much stated clearances exceed real ones, the real one, and the case's seed."""
    for index in range(count):
        shape, surface, body = case(kind, index, seed)
        real = least(shape, surface, body)
        said = stated(kind, shape, surface, body)
        # of a strip that an edge cuts it is said that it is in the body, not how deep its faces are
        cut = kind in ('strip on a box', 'strip in a hole') and said < 0.0 and real < 0.0
        yield min(0.0, said - real) if cut else said - real, real, index


def print_clearances(kinds, count, seed) -> None:
    """Print a table of what is overstated."""
    print('| kind | cases | within a thousandth | overstated by more than 1e-6 L | at most, L '
          '| understated at most, L |\n|---|---|---|---|---|---|')
    for kind in kinds:
        off, real, index = np.array(list(overstated(kind, count, seed))).T
        near = np.abs(real) < 1.01e-3 * LENGTH
        wrong = off > 1e-6 * LENGTH
        print(f'| {kind} | {count} | {near.sum()} | {wrong.sum()} | {off.max() / LENGTH:.2g} | '
              f'{-off.min() / LENGTH:.2g} |', flush=True)
        if wrong.any():
            print('  worst cases:', [int(index[k]) for k in np.argsort(-off)[:5]])


# ------------------------------------------------------------------------------------------------
# Contacts: how deep a DLO really is where a step converged.


def steps_in_a_hole(rng, steps=8):
    """Yield Shapes, with the simulator's obstacle, of steps of a DLO that is pressed in a hole."""
    n = int(rng.choice([16, 24, 32, 48, 64]))
    radius = LENGTH * 10 ** rng.uniform(-3.0, -2.3)
    stiff = 10 ** rng.uniform(-2, 0)
    rod = Rod(LENGTH, 0.05 if rng.random() < 0.7 else 0.0, stiff, 0.8 * stiff, radius=radius)
    tilt, angle = rng.choice([0.1, 0.5, 0.9, 1.2]) * rng.random(), rng.uniform(0, 2 * np.pi)
    gripper = Pose.looking_along((0, 0, 0), (1, 0, 0.3 * rng.normal()))
    free = DirectSimulator(rod, basis='local', n_elements=n).solve(gripper)
    axes, place = free.frame_at(rng.uniform(0.3, 0.9))
    normal = axes @ [np.cos(tilt), np.sin(tilt) * np.cos(angle), np.sin(tilt) * np.sin(angle)]
    pose = Pose.looking_along(place, normal)
    thick = rng.choice([0.0, 0.0, 0.5, 2.0, 6.0]) * radius
    room = rng.choice([1.02, 1.1, 1.5, 2.5]) * radius
    hole = radius
    for _ in range(6):  # as wide as its passage needs, and a little more
        sheet = Sheet(pose, 0.4, 0.4, thick, (CutOut(pose, radius=hole),))
        hole = max(hole - _roughly(free, Surface(radius), sheet) + 1e-4 * LENGTH, room)
    sheet = Sheet(pose, 0.4, 0.4, thick, (CutOut(pose, radius=hole),),
                  float(rng.choice([0.0, 0.0, 0.3])))
    simulator = DirectSimulator(rod, basis='local', n_elements=n, obstacles=[sheet])
    way, turn = 0.004 * LENGTH * rng.normal(size=3), 0.02 * rng.normal(size=3)
    shape = simulator.solve(gripper)
    for _ in range(steps):
        gripper = Pose.from_rotation(
            gripper.position + way,
            Rotation.from_rotvec(turn).as_matrix() @ gripper.rotation)
        shape = simulator.solve(gripper, shape)
        yield shape, sheet
        if not shape.converged:
            return


def print_contacts(count, seed) -> None:
    """Print how deep DLOs are in obstacles that they are said to touch."""
    deep, said, touched, failed, index, used = [], [], 0, 0, 0, 0.0
    while len(deep) < count:
        rng = np.random.default_rng([seed, 77, index])
        begun = process_time()
        shapes = list(steps_in_a_hole(rng))
        used += process_time() - begun
        for shape, sheet in shapes:
            failed += not shape.converged
            if shape.converged and shape.contacts:
                touched += 1
                real = -least(shape, Surface(shape.rod.radius), sheet, 0.0)
                if real - shape.violation > 1e-6 * LENGTH:
                    print(f'  chain {index}: {len(shape.s) - 1} elements, really {real:.3g} m '
                          f'deep, {shape.violation:.2g} said', flush=True)
                deep.append(real)
                said.append(shape.violation)
        index += 1
    over = np.array(deep) - np.array(said)
    print(f'{len(deep)} steps in contact of {index} ways, {failed} not converged; deeper than said '
          f'by more than 1e-6 L: {(over > 1e-6 * LENGTH).sum()}, at most {over.max():.3g} m; '
          f'{used:.1f} s of CPU')


def main(arguments: list[str] | None = None) -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('what', choices=['clearance', 'contact'])
    parser.add_argument('count', type=int)
    parser.add_argument('--kinds', nargs='+', default=list(KINDS))
    parser.add_argument('--seed', type=int, default=0)
    given = parser.parse_args(arguments)
    if given.what == 'clearance':
        print_clearances(given.kinds, given.count, given.seed)
    else:
        print_contacts(given.count, given.seed)


if __name__ == '__main__':
    main()
