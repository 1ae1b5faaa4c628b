# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Every way a DLO can hang from a gripper, by Runge-Kutta and nothing of this package.

Seen from its free end a hanging DLO is an initial value problem (Kirchhoff's equations), so the
direction of gravity in the end's frame, a point on the sphere, names the shape up to a turn about
the vertical. Whether it is stable is told by its focal points: the derivative of the frame at s by
the frame of the end must not be singular anywhere before the end (Jacobi's condition for a minimum
with one end clamped and the other free).
"""

import numpy as np
from scipy.sparse import csr_matrix, eye
from scipy.spatial import ConvexHull

_SMALL = 1e-5
_GRAZING = 0.02  # cosine: a cut-out passed more obliquely is not passed, as far as a grid can tell


def hanging(rod, weight, ends, steps=96):
    """Return frames (steps + 1, n, 3, 3), s growing, of uniform DLOs whose free ends are `ends`.

    Args:
        rod: Rod with constant properties; weight: (3,) N/m; ends: (n, 3, 3)
    """
    stiffness, natural = rod.stiffness, np.array([rod.natural_twist, *rod.natural_curvature])
    tip = rod.tip_mass * 9.81 * np.asarray(weight) / max(np.linalg.norm(weight), 1e-300)

    def rates(s, frames, moment):
        strain = np.einsum('nij,ni->nj', frames, moment) / stiffness + natural
        cross = np.zeros((len(frames), 3, 3))
        cross[:, 0, 1], cross[:, 0, 2] = -strain[:, 2], strain[:, 1]
        cross[:, 1, 0], cross[:, 1, 2] = strain[:, 2], -strain[:, 0]
        cross[:, 2, 0], cross[:, 2, 1] = -strain[:, 1], strain[:, 0]
        force = weight * (rod.length - s) + tip
        return frames @ cross, -np.cross(frames[:, :, 0], force)

    h = -rod.length / steps
    frames, moment, s = np.array(ends), np.zeros((len(ends), 3)), rod.length
    out = [frames]
    for _ in range(steps):
        a, p = rates(s, frames, moment)
        b, q = rates(s + h / 2, frames + h / 2 * a, moment + h / 2 * p)
        c, r = rates(s + h / 2, frames + h / 2 * b, moment + h / 2 * q)
        d, t = rates(s + h, frames + h * c, moment + h * r)
        frames = frames + h / 6 * (a + 2 * b + 2 * c + d)
        moment = moment + h / 6 * (p + 2 * q + 2 * r + t)
        s += h
        out.append(frames)
    return np.array(out[::-1])


def turned(ends, turn):
    """Return ends (n, 3, 3) turned by a small rotation vector (3,) each about its own axes."""
    x, y, z = turn
    return ends @ (np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


def hanging_and_stable(rod, weight, ends, steps=96):
    """Return the frames as `hanging` does, and whether each of the shapes is stable (n,)."""
    n = len(ends)
    every = [ends, *(turned(ends, step) for step in _SMALL * np.eye(3))]
    frames = hanging(rod, weight, np.concatenate(every), steps)
    at = frames[:, :n]
    columns = []
    for k in range(3):
        change = np.einsum('snji,snjk->snik', at, frames[:, (k + 1) * n:(k + 2) * n] - at) / _SMALL
        columns.append(np.stack([change[..., 2, 1], change[..., 0, 2], change[..., 1, 0]], axis=-1))
    focal = np.linalg.det(np.stack(columns, axis=-1))
    return at, (focal > 0).all(axis=0)


def sphere(n):
    """Return n points (n, 3) spread evenly over the sphere (Fibonacci)."""
    k = np.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, np.pi * (1 + np.sqrt(5)) * k
    r = np.sqrt(1 - z**2)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def ends_with_gravity_at(directions):
    """Return end frames (n, 3, 3) in which the world's down, -z, is at these directions (n, 3)."""
    out = np.empty((len(directions), 3, 3))
    for k, down in enumerate(directions):
        helper = np.eye(3)[np.argmin(np.abs(down))]
        x = np.cross(helper, down)
        x /= np.linalg.norm(x)
        out[k] = np.array([x, np.cross(-down, x), -down])  # rows: world axes seen in the end frame
    return out


def no_way(rod, weight, normal, arc_lengths, gets_there, grid=1500):
    """Return whether no slow motion leads through all given tangents: True confirms a refusal.

    All stable shapes are a region on the sphere of directions of gravity, and those whose tangent
    at s makes the right angle with gravity are a curve on it (a turn about the vertical does the
    rest). From the first curve's stable part one has to come to the next one's, and so on.

    Args:
        normal: (3,) wanted of the tangent at each of arc_lengths (n,), m, one after the other
        gets_there: function (frames (steps + 1, 3, 3)) -> whether the DLO is in that shape at the
            beginning when nobody takes care
        grid: points on the sphere
    """
    points = sphere(grid)
    frames, stable = hanging_and_stable(rod, weight, ends_with_gravity_at(points))
    hull = ConvexHull(points).simplices
    edges = np.vstack([hull[:, [0, 1]], hull[:, [1, 2]], hull[:, [2, 0]]])
    steps = len(frames) - 1
    near = csr_matrix((np.ones(len(edges)), edges.T), shape=(grid, grid))
    near = ((near + near.T + eye(grid)) > 0).astype(float)
    reached = None
    for s in arc_lengths:
        node = s / rod.length * steps
        low = min(int(node), steps - 1)
        tangent = frames[low:low + 2, :, 2, 0]
        misfit = tangent[0] + (node - low) * (tangent[1] - tangent[0]) - normal[2]
        crossing = edges[misfit[edges[:, 0]] * misfit[edges[:, 1]] <= 0].ravel()
        here = np.zeros(grid, dtype=bool)
        here[crossing] = True
        here &= stable
        now = here.copy() if reached is None else here & (near @ reached > 0)
        if reached is None:
            for k in np.flatnonzero(here):
                now[k] = gets_there(frames[:, k])
        while now.any():  # and along the curve
            grown = here & (near @ now > 0)
            if (grown == now).all():
                break
            now = grown
        if not now.any():
            return True
        reached = now
    return False


def no_start(rod, weight, normal, gets_there, rolls=180):
    """Return whether no roll about `normal`, along which the free end points, is a beginning.

    Args:
        gets_there: as for `no_way`
    """
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    across = np.cross(normal, helper)
    across /= np.linalg.norm(across)
    angles = np.linspace(0, 2 * np.pi, rolls, endpoint=False)[:, None]
    second = np.cos(angles) * across + np.sin(angles) * np.cross(normal, across)
    ends = np.stack([np.tile(normal, (rolls, 1)), second, np.cross(normal, second)], axis=-1)
    frames, stable = hanging_and_stable(rod, weight, ends)
    return not any(gets_there(frames[:, k]) for k in np.flatnonzero(stable))


def no_pair(rod, weight, first, second, grid=2500):
    """Return whether no stable shape passes two cut-outs, its free end at the second center.

    True confirms a refusal. For the arguments see `directions_in_first`.
    """
    return len(directions_in_first(rod, weight, first, second, grid)) == 0


def directions_in_first(rod, weight, first, second, grid=2500):
    """Return tangents (m, 3) in the first of two cut-outs, the free end at the second center.

    Those of all stable shapes, as densely as the grid. Each cut-out has to be passed in its
    direction, be it obliquely. A turn about the vertical is free, so a shape does it if the
    vertical part of x(L) - x(s1) is that of the way between the centers, where s1 is the last place
    as far from the end as they are apart.

    Args:
        first, second: CutOuts
        grid: points on the sphere
    """
    way = second.center - first.center
    apart, points = np.linalg.norm(way), sphere(grid)
    frames, stable = hanging_and_stable(rod, weight, ends_with_gravity_at(points))
    tangents = frames[..., 0]
    steps = len(frames) - 1
    places = np.concatenate([np.zeros((1, grid, 3)), np.cumsum(
        0.5 * rod.length / steps * (tangents[1:] + tangents[:-1]), axis=0)])
    away = np.linalg.norm(places[-1] - places, axis=2)
    last = steps - np.argmax(away[::-1] >= apart, axis=0)
    reaches = (away[last, np.arange(grid)] >= apart) & (last < steps)
    low, high = np.minimum(last, steps - 1), np.minimum(last + 1, steps)
    every = np.arange(grid)
    gap = away[low, every] - away[high, every]
    share = ((away[low, every] - apart) / np.where(gap > 0, gap, 1.0))[:, None]
    place = (1 - share) * places[low, every] + share * places[high, every]
    tangent = (1 - share) * tangents[low, every] + share * tangents[high, every]
    chord = places[-1] - place
    angle = np.arctan2(way[1], way[0]) - np.arctan2(chord[:, 1], chord[:, 0])

    def turned_to_way(vectors):
        x = np.cos(angle) * vectors[:, 0] - np.sin(angle) * vectors[:, 1]
        y = np.sin(angle) * vectors[:, 0] + np.cos(angle) * vectors[:, 1]
        return np.column_stack([x, y, vectors[:, 2]])

    tangent = turned_to_way(tangent)
    right = (tangent @ first.normal > _GRAZING) & (
        turned_to_way(tangents[-1]) @ second.normal > _GRAZING)
    misfit = chord[:, 2] - way[2]
    hull = ConvexHull(points).simplices
    a, b = np.vstack([hull[:, [0, 1]], hull[:, [1, 2]], hull[:, [2, 0]]]).T
    good = reaches & stable & right
    return tangent[np.unique(a[good[a] & good[b] & (misfit[a] * misfit[b] <= 0)])]
