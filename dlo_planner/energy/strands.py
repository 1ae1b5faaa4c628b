# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contact of a DLO with itself: two of its elements, no neighbours, keep each other off.

Elements are their chords. The distance d of two chords is that of their nearest points, s and t of
their lengths from where they begin, but for a term that keeps both in the middle where the chords
are parallel and all points are as near:

    d^2 = min over s, t in [0, 1] of |w|^2 + SOFT (l_i^2 (s - 1/2)^2 + l_j^2 (t - 1/2)^2)

with w from one point to the other. So the nearest points move smoothly as the chords turn. A pair
bears f = max(0, force - spring (d - reach)), where `force` is its multiplier (augmented Lagrangian:
Nocedal and Wright, ch. 17.3) and `reach` the sum of both radii. It acts on the nodes of both
elements; there is no friction. The second derivatives couple places far apart:

    (spring + f/d) g g^T - f/d (B^T B - Q A^-1 Q^T)

with g the derivative of d by the four nodes, B that of w, Q that of the slopes by s and t of
d^2 / 2, and A their derivative by s and t; of a point at an end of its chord there is no row of Q.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.geometry.self_distance import heads_back
from dlo_planner.geometry.self_passage import passes_itself
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints

SOFT = 1e-3        # of the squared length of a chord: chords at a smaller angle than its root, in
#                    rad, are parallel
ROWS = 5           # of a pair at most, see `put_rows`
_DEEPEST = 0.9    # of the reach: strands that a step leaves nearer are not known of yet
_DEEP = 0.96       # the same: strands that are nearer are pushed out before anything else
_MANY = 256        # pairs in each other that are looked at: what has more is no shape yet
_RIGHT = 0.5 * np.pi
_TINY = 1e-12      # of the reach: chords that are nearer have no normal, and no force


class Strands(Record):
    """Pairs of elements that may touch, and the forces that keep them off."""

    pair: Ints            # (P, 2) elements, the first before the second
    pair_force: Floats    # (P,) multipliers, N
    pair_reach: Floats    # (P,) sum of both radii, m
    strand_radius: Floats  # (N,) radii of all elements, m
    pair_spring: float    # N/m


def no_strands(radii: Floats) -> Strands:
    """Return the Strands of a DLO with elements of these radii (N,), of which none is near."""
    return Strands(np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0), radii, 0.0)


def needs(effect: Strands) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    return {'pairs': len(effect.pair)}


@kernel
def pair_count(effect):
    """Return how many pairs may touch."""
    if effect is None:
        return 0
    return effect.pair.shape[0]


@kernel
def nearest_points(lengths: Floats, positions: Floats, i: int, j: int
                   ) -> tuple[float, float, float]:
    """Return s and t of the nearest points of two chords, and their distance d in m.

    Shapes: lengths (N,) of the elements, positions (N + 1, 3).
    """
    uu = vv = uv = uw = vw = ww = 0.0
    for k in range(3):
        u, v = positions[i + 1, k] - positions[i, k], positions[j + 1, k] - positions[j, k]
        w = positions[i, k] - positions[j, k]
        uu, vv, uv, uw, vw, ww = (uu + u * u, vv + v * v, uv + u * v, uw + u * w, vw + v * w,
                                  ww + w * w)
    own, other = SOFT * lengths[i] ** 2, SOFT * lengths[j] ** 2
    a, b = uu + own, vv + other
    right, second = 0.5 * own - uw, 0.5 * other + vw
    s = (right * b + uv * second) / (a * b - uv * uv)
    t = (second + uv * s) / b
    if not (0.0 <= s <= 1.0 and 0.0 <= t <= 1.0):  # it is at an edge: the best point of four
        least = np.inf
        for edge in range(4):
            at = float(edge % 2)
            if edge < 2:
                x, y = at, min(max((second + uv * at) / b, 0.0), 1.0)
            else:
                x, y = min(max((right + uv * at) / a, 0.0), 1.0), at
            value = 0.5 * (a * x * x + b * y * y) - uv * x * y - right * x - second * y
            if value < least:
                least, s, t = value, x, y
    square = (ww + uu * s * s + vv * t * t + 2.0 * (uw * s - vw * t - uv * s * t)
              + own * (s - 0.5) ** 2 + other * (t - 0.5) ** 2)
    return s, t, np.sqrt(max(square, 0.0))


@kernel
def bears(effect, p, distance):
    """Return the force in N of pair p at a distance."""
    return max(0.0, effect.pair_force[p] - effect.pair_spring * (distance - effect.pair_reach[p]))


@kernel
def add_forces(effect, system, state):
    """Add what pairs act with to `state.pull`; return the potential in J, and its size."""
    if effect is None:
        return 0.0, 0.0
    energy = size = 0.0
    positions, pull = state.positions, state.pull
    for p in range(effect.pair.shape[0]):
        i, j = effect.pair[p, 0], effect.pair[p, 1]
        s, t, distance = nearest_points(system.lengths, positions, i, j)
        force = bears(effect, p, distance)
        # f^2 / 2k is the potential, less what does not depend on the shape
        own = 0.5 * (force ** 2 - effect.pair_force[p] ** 2) / effect.pair_spring
        energy += own
        size += abs(own) + force * distance
        if force == 0.0 or distance < _TINY * effect.pair_reach[p]:
            continue
        for k in range(3):
            w = ((1.0 - s) * positions[i, k] + s * positions[i + 1, k]
                 - (1.0 - t) * positions[j, k] - t * positions[j + 1, k])
            along = force * w / distance
            pull[i, k] -= (1.0 - s) * along
            pull[i + 1, k] -= s * along
            pull[j, k] += (1.0 - t) * along
            pull[j + 1, k] += t * along
    return energy, size


@kernel
def pushes_out(effect, system, state):
    """Whether any strand is so deep in another that its spring alone says where it goes."""
    if effect is None:
        return False
    for p in range(effect.pair.shape[0]):
        _, _, distance = nearest_points(system.lengths, state.positions, effect.pair[p, 0],
                                        effect.pair[p, 1])
        if distance < _DEEP * effect.pair_reach[p]:
            return True
    return False


@kernel
def roundoff(effect, system, state, length):
    """Return forces in N whose relative rounding errors those of pairs have."""
    if effect is None:
        return 0.0
    forces = 0.0
    for p in range(effect.pair.shape[0]):
        _, _, distance = nearest_points(system.lengths, state.positions, effect.pair[p, 0],
                                        effect.pair[p, 1])
        if bears(effect, p, distance) > 0.0:
            forces += effect.pair_spring * length
    return forces


@kernel
def forbids(effect, system, before, after):
    """Whether a strand passes through another on the way between two states, or nearly does."""
    if effect is None:
        return False
    lengths, radii = system.lengths, effect.strand_radius
    found = np.empty((_MANY, 2), dtype=np.int64)
    count = near_pairs(lengths, after.strains, after.positions, radii, 0.0, found)
    for p in range(min(count, _MANY)):
        i, j = found[p, 0], found[p, 1]
        _, _, distance = nearest_points(lengths, after.positions, i, j)
        if distance < _DEEPEST * (radii[i] + radii[j]):
            _, _, known = nearest_points(lengths, before.positions, i, j)
            if distance < known:
                return True
    return passes_itself(before.positions, after.positions)


@kernel
def may_act(effect, system, strains, positions, before):
    """Whether any two strands are in each other at a shape that was found without."""
    if effect is None:
        return False
    found = np.empty((1, 2), dtype=np.int64)
    return near_pairs(system.lengths, strains, positions, effect.strand_radius, 0.0, found) > 0


@kernel
def near_pairs(lengths: Floats, strains: Floats, positions: Floats, radii: Floats, gap: float,
               found: Ints) -> int:
    """Fill found (n, 2) with pairs nearer than both radii and a gap, m; return how many there are.

    More than n are counted, and not filled in. A place is no neighbour of an earlier one if the
    DLO, on its way from there, heads back towards that (`geometry.self_distance`).
    """
    n, count = lengths.size, 0
    turns = np.zeros(n + 1)
    for e in range(n):
        turns[e + 1] = turns[e] + lengths[e] * np.hypot(strains[e, 1], strains[e, 2])
    if turns[n] <= _RIGHT:
        return 0
    for i in range(n):
        j = i + 1
        while j < n and (turns[j + 1] - turns[i] <= _RIGHT or not heads_back(positions, i, j)):
            j += 1
        while j < n:
            square = 0.0
            for k in range(3):
                square += (positions[i, k] + positions[i + 1, k] - positions[j, k]
                           - positions[j + 1, k]) ** 2
            near = radii[i] + radii[j] + gap
            if 0.5 * np.sqrt(square) - 0.5 * (lengths[i] + lengths[j]) < near:
                _, _, distance = nearest_points(lengths, positions, i, j)
                if distance < near:
                    if count < found.shape[0]:
                        found[count, 0], found[count, 1] = i, j
                    count += 1
            j += 1
    return count


@kernel
def put_rows(effect, system, state, p, rows, weights):
    """Fill what pair p adds to second derivatives: a sum of weights times rows row^T.

    Returns how many there are. Shapes: rows (ROWS, 4, 3) forces on nodes i, i + 1, j, j + 1;
    weights (ROWS,), N/m.
    """
    i, j = effect.pair[p, 0], effect.pair[p, 1]
    positions = state.positions
    s, t, distance = nearest_points(system.lengths, positions, i, j)
    force = bears(effect, p, distance)
    if force == 0.0 or distance < _TINY * effect.pair_reach[p]:
        return 0
    u, v, w = np.empty(3), np.empty(3), np.empty(3)
    uu = vv = uv = ww = 0.0
    for k in range(3):
        u[k], v[k] = positions[i + 1, k] - positions[i, k], positions[j + 1, k] - positions[j, k]
        w[k] = positions[i, k] + s * u[k] - positions[j, k] - t * v[k]
        uu, vv, uv, ww = uu + u[k] * u[k], vv + v[k] * v[k], uv + u[k] * v[k], ww + w[k] * w[k]
    tension, width = force / distance, np.sqrt(ww)
    if width < _TINY * effect.pair_reach[p]:
        return 0
    _put_distance_row(s, t, w, 1.0 / width, rows[0])
    # of B^T B, too, what lies along w
    weights[0] = (effect.pair_spring + tension) * ww / distance ** 2 - tension
    count = 1
    # two directions across w
    least = 0
    for k in range(1, 3):
        if abs(w[k]) < abs(w[least]):
            least = k
    across, other = np.zeros(3), np.empty(3)
    across[least] = 1.0
    along, size = w[least] / ww, 0.0
    for k in range(3):
        across[k] -= along * w[k]
        size += across[k] ** 2
    for k in range(3):
        across[k] /= np.sqrt(size)
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        other[k] = (w[a] * across[b] - w[b] * across[a]) / width
    for direction in (across, other):
        _put_distance_row(s, t, direction, 1.0, rows[count])
        weights[count] = -tension
        count += 1
    # the nearest points move along both chords
    begin = count
    if 0.0 < s < 1.0:
        scale = 1.0 / np.sqrt(uu + SOFT * system.lengths[i] ** 2)
        _put_distance_row(s, t, u, scale, rows[count])
        for k in range(3):
            rows[count, 0, k] -= scale * w[k]
            rows[count, 1, k] += scale * w[k]
        weights[count] = tension
        count += 1
    if 0.0 < t < 1.0:
        b = vv + SOFT * system.lengths[j] ** 2
        mixed = 0.0
        if count > begin:
            mixed = -uv / np.sqrt(uu + SOFT * system.lengths[i] ** 2)
        scale = 1.0 / np.sqrt(b - mixed * mixed)
        _put_distance_row(s, t, v, -scale, rows[count])
        for k in range(3):
            rows[count, 2, k] += scale * w[k]
            rows[count, 3, k] -= scale * w[k]
        if count > begin:
            for node in range(4):
                for k in range(3):
                    rows[count, node, k] -= scale * mixed * rows[begin, node, k]
        weights[count] = tension
        count += 1
    return count


@kernel
def _put_distance_row(s, t, direction, scale, row):
    """Fill row (4, 3) with the derivative by the nodes of a direction (3,) times w."""
    for k in range(3):
        value = scale * direction[k]
        row[0, k], row[1, k] = (1.0 - s) * value, s * value
        row[2, k], row[3, k] = -(1.0 - t) * value, -t * value
