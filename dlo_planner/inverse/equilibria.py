# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All hanging shapes of a DLO: its equilibria, as points on a sphere.

Nothing holds the free end: force and moment are zero there, and the direction of gravity in the
end's frame defines an equilibrium. It follows element by element (an initial value problem), up to
a turn about the vertical, which changes nothing. The equilibria of a DLO are therefore a sphere
(compare Bretl and McCarthy 2014 for a DLO that is held at both ends), and each task is a set of
curves on it. A search on the sphere cannot overlook a route, as one that follows a single shape
can.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import ConvexHull

from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.equilibrium import shape_of
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.potential import configuration_at, evaluate
from dlo_planner.energy.problem import Configuration, Problem, new_configuration, with_gripper
from dlo_planner.geometry.so3 import (
    applied,
    coefficients,
    cross,
    matrix,
    plus,
    put_matrix,
    rotation_and_chord,
    rotation_and_chord_with,
    slope,
    times_transposed,
    transposed_applied,
    vector,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.convergence import Minimum
from dlo_planner.minimize.hessian import assemble, factorize, new_hessian
from dlo_planner.minimize.lanczos import lowest_mode
from dlo_planner.model.arrays import Bools, Floats, Ints
from dlo_planner.model.pose import Pose, angle_between, turned_by
from dlo_planner.model.rod import Rod
from dlo_planner.model.supports import Surroundings

_ROUNDS = 30


def hanging(system: Problem, end: Floats) -> tuple[Configuration, Floats]:
    """Return a Configuration and the gripper's rotation (3, 3) that `integrate_from_tip` finds."""
    strains, base = integrate_from_tip(system, end)
    return configuration_at(system._replace(base=base), strains), base


@kernel
def integrate_from_tip(system: Problem, end: Floats) -> tuple[Floats, Floats]:
    """Return strains (N, 3) and gripper rotation in equilibrium, from the end's rotation (3, 3)."""
    n = system.lengths.size
    lengths, natural, stiffness = system.lengths, system.natural, system.stiffness
    pull = system.effects.load.pull
    strains = np.empty((n, 3))
    frame, force, moment = matrix(end), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    u = np.empty(3)
    for e in range(n - 1, -1, -1):
        h = lengths[e]
        force = plus(force, vector(pull[e + 1]))
        for i in range(3):
            if e == n - 1:
                u[i] = natural[e, i]
            elif e < n - 2:
                u[i] = 2 * strains[e + 1, i] - strains[e + 2, i]
        # in the frame at the element's end
        far_force = transposed_applied(frame, force)
        far_moment = transposed_applied(frame, moment)
        for _ in range(_ROUNDS):
            x, y, z = h * u[0], h * u[1], h * u[2]
            arc = coefficients(x * x + y * y + z * z)
            turn, _ = rotation_and_chord_with(x, y, z, h, arc)
            bend = slope(x, y, z, h, applied(turn, far_force), applied(turn, far_moment), arc)
            change = 0.0
            for i in range(3):
                wanted = natural[e, i] - bend[i] / stiffness[e, i]
                change = max(change, abs(wanted - u[i]))
                u[i] = wanted
            if change * h < 1e-15:
                break
        strains[e] = u
        turn, chord = rotation_and_chord(h * u[0], h * u[1], h * u[2], h)
        frame = times_transposed(frame, turn)
        moment = plus(moment, cross(applied(frame, chord), force))
    rotation = np.empty((3, 3))
    put_matrix(frame, rotation)
    return strains, rotation


_POINTS = 2500
_PARALLEL = 1e-9  # relative: loads along one axis
_LEVEL = 1e-3     # a horizontal part below this leaves the heading free, and
_HEADINGS = 12    # so many are looked at
_OPPOSITES = 0.1  # least singular value of mixed frames: those 2.9 rad apart have no mean


@dataclass(frozen=True, eq=False)
class HangingShapes:
    """The equilibria of a DLO whose loads are all along one axis, on a grid of n points."""

    up: Floats  # (3,) unit vector along the loads, either way
    s: Floats  # (N + 1,) arc lengths of the nodes, m
    frames: Floats  # (n, N + 1, 3, 3) frames of the nodes
    positions: Floats  # (n, N + 1, 3) positions of the nodes, m from the gripper
    # (n,) smallest eigenvalue of the Hessian, as `Shape.stability`; -1 if negative
    stability: Floats
    edges: Ints  # (m, 2) indices of neighbors on the sphere
    # how far apart they are, of a unit vector: a curve that comes as near to one may miss all edges
    spacing: float

    def at(self, s: float | Floats) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and tangents (n, 3) at the arc length `s`, m, one or (n,)."""
        k = np.clip(np.searchsorted(self.s, s, side='right') - 1, 0, self.s.size - 2)
        share = np.reshape((s - self.s[k]) / (self.s[k + 1] - self.s[k]), (-1, 1))
        rows = np.arange(len(self.frames))
        low, high = self.positions[rows, k], self.positions[rows, k + 1]
        first, last = self.frames[rows, k, :, 0], self.frames[rows, k + 1, :, 0]
        tangent = (1 - share) * first + share * last
        return ((1 - share) * low + share * high,
                tangent / np.linalg.norm(tangent, axis=1)[:, None])


def hanging_shapes(surroundings: Surroundings, s: Floats) -> HangingShapes | None:
    """Return a DLO's HangingShapes, s (N + 1,); None if loads are not along one axis, or zero."""
    mesh = Discretization(surroundings, s, 'local', 0)
    up = common_axis(mesh.static.pull)
    if up is None:
        return None
    directions, edges = sphere(_POINTS)
    frames, positions, stability = _hang(mesh.static, frames_with(directions, up))
    return HangingShapes(up, s, frames, positions, stability, edges, 2 / np.sqrt(_POINTS))


def common_axis(load: Floats) -> Floats | None:
    """Return the unit vector (3,) along the strongest of loads (n, 3) if all are, either way.

    None if they are not, or if there is no load.
    """
    size = np.linalg.norm(load, axis=1)
    strongest = load[np.argmax(size)]
    if not size.max() > 0:
        return None
    along: Floats = strongest / np.linalg.norm(strongest)
    if np.linalg.norm(np.cross(load, along), axis=1).max() > _PARALLEL * size.max():
        return None
    return along


@lru_cache(maxsize=2)
def sphere(n: int) -> tuple[Floats, Ints]:
    """Return n points (n, 3) spread evenly over the unit sphere, and their neighbors (m, 2)."""
    k = np.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, np.pi * (1 + np.sqrt(5)) * k  # a Fibonacci lattice
    points = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn),
                              z])
    hull: Ints = ConvexHull(points).simplices
    edges = np.vstack([hull[:, [0, 1]], hull[:, [1, 2]], hull[:, [2, 0]]])
    return points, np.unique(np.sort(edges, axis=1), axis=0)


def frames_with(directions: Floats, up: Floats) -> Floats:
    """Return (n, 3, 3) frames in which the world's `up` has these components (n, 3)."""
    across = np.cross(np.eye(3)[np.argmin(np.abs(directions), axis=1)], directions)
    across /= np.linalg.norm(across, axis=1)[:, None]
    local = np.stack([across, np.cross(directions, across), directions], axis=1)  # rows
    frames: Floats = _upright(up) @ local
    return frames


def _upright(up: Floats) -> Floats:
    """Return a rotation (3, 3) whose last column is `up`."""
    side = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(up, side), up])


@kernel
def _hang(system: Problem, ends: Floats) -> tuple[Floats, Floats, Floats]:
    """Return frames (n, N + 1, 3, 3), positions (n, N + 1, 3) and stability (n,)."""
    n, nodes = ends.shape[0], system.lengths.size + 1
    frames, positions = np.empty((n, nodes, 3, 3)), np.empty((n, nodes, 3))
    stability = np.empty(n)
    state = new_configuration(system)
    hessian = new_hessian(system)
    for k in range(n):
        strains, base = integrate_from_tip(system, ends[k])
        here = with_gripper(system, base, system.origin)
        state.q[:] = (strains - system.natural) / system.scale
        evaluate(here, state)
        assemble(here, state, hessian)
        frames[k] = state.rotations
        positions[k] = state.positions
        if factorize(here, hessian, 0.0) > 0:
            stability[k] = -1.0
        else:
            stability[k], _ = lowest_mode(here, hessian, 0.0, 1e-2)
    return frames, positions, stability


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where a curve on the sphere crosses its grid: m shapes that do a task, about."""

    grippers: Floats  # (m, 3, 3) rotations of the gripper
    ends: Floats  # (m, 3, 3) rotations of the free end
    places: Floats  # (m, 3) the gripper's origin from the point that is at the goal, m
    stability: Floats  # (m,)
    pairs: Ints  # (m, 2) indices of the two grid points
    shares: Floats  # (m,) shares of the way between them

    def __len__(self) -> int:
        return len(self.grippers)

    def chosen(self, which: Bools | Ints | list[int]) -> Crossings:
        """Return the same crossings, `which` of them (a mask or indices)."""
        return Crossings(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def with_others(self, others: Crossings) -> Crossings:
        """Return the crossings of this curve and those of another grid."""
        return Crossings(*(np.concatenate([getattr(self, name), getattr(others, name)])
                           for name in self.__dataclass_fields__))


def crossings(shapes: HangingShapes, vectors: Floats, goal: Floats, s: float | Floats) -> Crossings:
    """Return the stable Crossings of the curve where vectors (n, 3), turned upright, are `goal`."""
    up = shapes.up
    misfit = vectors @ up - goal @ up
    a, b = shapes.edges.T
    with np.errstate(invalid='ignore'):
        crossed = ((misfit[a] <= 0) != (misfit[b] <= 0)) & np.isfinite(misfit[a] + misfit[b])
    crossed &= (shapes.stability[a] > 0) & (shapes.stability[b] > 0)
    a, b = a[crossed], b[crossed]
    share = misfit[a] / (misfit[a] - misfit[b])
    # a curve may be too small for the grid: about a vertical goal it is
    near = _touching(shapes, misfit, float(np.linalg.norm(goal)))
    a, b, share = np.append(a, near), np.append(b, near), np.append(share, np.zeros(near.size))
    places = -shapes.at(s)[0]
    turns = [headings_to(vectors[k], goal, up) for k in (a, b)]
    which = np.repeat(np.arange(a.size), len(turns[0]) // max(a.size, 1)) if a.size else a
    a, b, share = a[which], b[which], share[which]
    blend = share[:, None, None]

    def both(frames: Floats) -> tuple[Floats, Bools]:
        return _nearest_rotations(
            (1 - blend) * (turns[0] @ frames[a]) + blend * (turns[1] @ frames[b]))

    place = ((1 - share)[:, None] * np.einsum('kij,kj->ki', turns[0], places[a])
             + share[:, None] * np.einsum('kij,kj->ki', turns[1], places[b]))
    (grippers, one), (ends, other) = both(shapes.frames[:, 0]), both(shapes.frames[:, -1])
    return Crossings(grippers, ends, place,
                     (1 - share) * shapes.stability[a] + share * shapes.stability[b],
                     np.column_stack([a, b]), share).chosen(one & other)


def _touching(shapes: HangingShapes, misfit: Floats, scale: float) -> Ints:
    """Return the stable points of the grid where |misfit| is least among neighbors, and small."""
    size = np.where(np.isfinite(misfit), np.abs(misfit), np.inf)
    least = size < scale * shapes.spacing
    a, b = shapes.edges.T
    np.logical_and.at(least, a, size[a] <= size[b])
    np.logical_and.at(least, b, size[b] <= size[a])
    return np.flatnonzero(least & (shapes.stability > 0))


def headings_to(vectors: Floats, goal: Floats, up: Floats) -> Floats:
    """Return (m, 3, 3) turns about `up` that bring vectors (m, 3) to `goal`.

    Where the goal is vertical every heading does: then each vector has _HEADINGS turns, in a row.
    """
    upright = _upright(up)
    x, y, _ = (vectors @ upright).T
    gx, gy, gz = goal @ upright
    if np.hypot(gx, gy) > _LEVEL * np.linalg.norm(goal):
        angles = np.arctan2(gy, gx) - np.arctan2(y, x)
    else:
        angles = np.tile(2 * np.pi / _HEADINGS * np.arange(_HEADINGS), len(vectors))
    cosine, sine = np.cos(angles), np.sin(angles)
    turns = np.zeros((angles.size, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = cosine
    turns[:, 1, 0], turns[:, 0, 1], turns[:, 2, 2] = sine, -sine, 1.0
    return upright @ turns @ upright.T


def _nearest_rotations(frames: Floats) -> tuple[Floats, Bools]:
    """Return the rotations (m, 3, 3) nearest to mixed ones, and which (m,) are not opposites."""
    left, sizes, right = np.linalg.svd(frames)
    rotations = left @ right
    good: Bools = (sizes[:, -1] > _OPPOSITES) & (np.linalg.det(rotations) > 0)
    return rotations, good


_ALIKE = 1e-9  # part of the stiffness, rad along the length: what makes no difference
_ROLLS = 24  # of the free end, tried
_OPPOSITE = 1e-9  # 1 + cosine of two unit vectors


class Candidate(NamedTuple):
    """A shape with which a plan can begin."""

    shape: Shape  # near the first one
    reference: Floats  # (3, 3) rotation of the gripper since which it must not roll
    depth: float  # depth of the shape, m


def start_candidates(simulator: DirectSimulator, direction: Floats,
                     start: Pose | None) -> Iterator[Candidate]:
    """Yield the Candidates whose free ends point along a unit vector (3,), at depth 0.

    The free end's roll about it is a choice. With the first candidate the gripper is not
    rolled: seen along its own axis it stands as `start` does (or upright, without one). A curved
    DLO may have several such rolls; the one that turns the gripper least comes first. The others
    follow in steps, unless the DLO is round and straight, so that all rolls are alike.
    """
    upright = Pose.looking_along((0.0, 0.0, 0.0), direction).rotation
    preferred = upright
    if start is not None:
        preferred = least_turn(start.direction, direction) @ start.rotation
    discretization = simulator.discretization(Pose.from_rotation((0, 0, 0), upright), None)
    system = discretization.system(upright)

    def end_rolled(angle: float) -> tuple[Floats, Floats, Floats]:
        """Return strains, gripper rotation, and the reference of its roll."""
        strains, base = integrate_from_tip(system, turned_by(angle * direction) @ preferred)
        return strains, base, least_turn(preferred[:, 0], base[:, 0]) @ preferred

    def roll(angle: float) -> float:
        _, base, reference = end_rolled(angle)
        across = reference.T @ base[:, 1]
        return float(np.arctan2(across[2], across[1]))

    def turn_against_start(angle: float) -> float:
        return angle_between(end_rolled(angle)[1], preferred)

    if is_axisymmetric(simulator.rod):
        # rolled about itself, the DLO carries the gripper along
        strains, base, reference = end_rolled(-roll(0.0))
        yield Candidate(_shape_at(discretization, strains, base), reference, 0.0)
        return
    angles = np.linspace(-np.pi, np.pi, _ROLLS + 1)
    rolls = [roll(angle) for angle in angles]
    roots = [brentq(roll, angles[k], angles[k + 1], xtol=1e-12) for k in range(_ROLLS)
             if rolls[k] * rolls[k + 1] <= 0 and abs(rolls[k] - rolls[k + 1]) < np.pi]
    for root in sorted(roots, key=turn_against_start):
        strains, base, reference = end_rolled(root)
        yield Candidate(_shape_at(discretization, strains, base), reference, 0.0)
    for angle in sorted(angles[:-1:2], key=turn_against_start):
        strains, base, _ = end_rolled(angle)
        yield Candidate(_shape_at(discretization, strains, base), base, 0.0)


def shape_with_end(mesh: Discretization, end: Floats) -> Shape:
    """Return the Shape (a guess) whose free end has the frame `end` (3, 3)."""
    end = np.array(end, order='C')
    return _shape_at(mesh, *integrate_from_tip(mesh.system(end), end))


def is_axisymmetric(rod: Rod) -> bool:
    """Whether a Rod is straight and equally stiff all around: its roll makes no difference."""
    s = np.linspace(0, rod.length, 65)
    natural, (_, one, other) = rod.mean_natural_strains(s), rod.mean_stiffnesses(s).T
    return (bool((abs(one - other) <= _ALIKE * one).all())
            and np.abs(natural).max() * rod.length <= _ALIKE)


def least_turn(one: Floats, other: Floats) -> Floats:
    """Return the rotation (3, 3) about the axis across both that takes unit vector one to other."""
    (a, b, c), (d, e, f) = one.tolist(), other.tolist()
    x, y, z, cosine = b * f - c * e, c * d - a * f, a * e - b * d, a * d + b * e + c * f
    if 1.0 + cosine < _OPPOSITE:  # any perpendicular axis
        across = np.cross(one, np.eye(3)[np.argmin(np.abs(one))])
        return turned_by(across / np.linalg.norm(across) * np.pi)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Floats = np.eye(3) + cross + cross @ cross / (1.0 + cosine)  # Rodrigues
    return turn


def _shape_at(discretization: Discretization, strains: Floats, base: Floats) -> Shape:
    """Return a Shape with these strains, whether in equilibrium or not (a guess)."""
    gripper = Pose.from_rotation((0.0, 0.0, 0.0), base)
    system = discretization.system(base)
    state = configuration_at(system, strains)
    return shape_of(discretization, gripper,
                    Minimum(state, np.inf, -np.inf, 0, 0, system))
