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

What holds both ends of a DLO is a body, too. The DLO itself stands for it, straight on behind both
grips: two strands more, number -1 behind the gripper and N behind the far end. They are as long as
the DLO, so that nothing of it swings past their ends: its link is kept (`geometry.writhe`). They
move with the nodes there and have the directions of the grips, which do not depend on the shape.
No term keeps the nearest point in their middle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.geometry.record import Record
from dlo_planner.geometry.self_distance import heads_back
from dlo_planner.geometry.self_passage import passes_itself, passes_ray
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
    # (2, 3) from the beginning to the end of what goes straight on behind the gripper, and behind
    # the far end, m; zeros where an end is free
    rays: Floats
    pair_spring: float    # N/m


NO_RAYS = np.zeros((2, 3))  # of a DLO with a free end


def no_strands(radii: Floats, spring: float) -> Strands:
    """Return the Strands of a DLO with elements of these radii (N,), of which none is near.

    Without radii, (0,), nothing keeps its strands off each other. `spring` in N/m.
    """
    return Strands(np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0), radii,
                   NO_RAYS.copy(), spring)


def needs(effect: Strands) -> dict[str, Any]:
    """Return what the solver has to provide for."""
    return {'pairs': len(effect.pair)}


@kernel
def pair_count(effect):
    """Return how many pairs may touch."""
    if effect is None:
        return 0
    return effect.pair.shape[0]


@kernel(forceinline=True)
def _component(rays, positions, e, k):
    """Return where strand e begins and how long it is, m, along axis k."""
    n = positions.shape[0] - 1
    if e < 0:
        return positions[0, k] - rays[0, k], rays[0, k]
    if e == n:
        return positions[n, k], rays[1, k]
    return positions[e, k], positions[e + 1, k] - positions[e, k]


@kernel(forceinline=True)
def _soft(lengths, e):
    """Return what keeps the nearest point of strand e in its middle, m^2."""
    return SOFT * lengths[e] ** 2 if 0 <= e < lengths.size else 0.0


@kernel(forceinline=True)
def _ends(n, e):
    """Return the nodes that strand e moves with, of a DLO of n elements."""
    return max(e, 0), min(e + 1, n)


@kernel
def nearest_points(lengths: Floats, rays: Floats, positions: Floats, i: int, j: int
                   ) -> tuple[float, float, float]:
    """Return s and t of the nearest points of two strands, and their distance d in m.

    Shapes: lengths (N,) of the elements, rays (2, 3) as of Strands, positions (N + 1, 3).
    """
    uu = vv = uv = uw = vw = ww = 0.0
    for k in range(3):
        begin, u = _component(rays, positions, i, k)
        other_begin, v = _component(rays, positions, j, k)
        w = begin - other_begin
        uu, vv, uv, uw, vw, ww = (uu + u * u, vv + v * v, uv + u * v, uw + u * w, vw + v * w,
                                  ww + w * w)
    own, other = _soft(lengths, i), _soft(lengths, j)
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
        s, t, distance = nearest_points(system.lengths, effect.rays, positions, i, j)
        force = bears(effect, p, distance)
        # f^2 / 2k is the potential, less what does not depend on the shape
        own = 0.5 * (force ** 2 - effect.pair_force[p] ** 2) / effect.pair_spring
        energy += own
        size += abs(own) + force * distance
        if force == 0.0 or distance < _TINY * effect.pair_reach[p]:
            continue
        n = system.lengths.size
        (first, second), (third, fourth) = _ends(n, i), _ends(n, j)
        for k in range(3):
            begin, u = _component(effect.rays, positions, i, k)
            other_begin, v = _component(effect.rays, positions, j, k)
            along = force * (begin + s * u - other_begin - t * v) / distance
            pull[first, k] -= (1.0 - s) * along
            pull[second, k] -= s * along
            pull[third, k] += (1.0 - t) * along
            pull[fourth, k] += t * along
    return energy, size


@kernel
def pushes_out(effect, system, state):
    """Whether any strand is so deep in another that its spring alone says where it goes."""
    if effect is None:
        return False
    for p in range(effect.pair.shape[0]):
        _, _, distance = nearest_points(system.lengths, effect.rays, state.positions,
                                        effect.pair[p, 0], effect.pair[p, 1])
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
        _, _, distance = nearest_points(system.lengths, effect.rays, state.positions,
                                        effect.pair[p, 0], effect.pair[p, 1])
        if bears(effect, p, distance) > 0.0:
            forces += effect.pair_spring * length
    return forces


@kernel
def forbids(effect, system, before, after):
    """Whether a strand passes through another on the way between two states, or nearly does."""
    if effect is None:
        return False
    if effect.strand_radius.size == 0:
        return False
    lengths, rays, radii = system.lengths, effect.rays, effect.strand_radius
    found = np.empty((_MANY, 2), dtype=np.int64)
    count = near_pairs(lengths, after.strains, rays, after.positions, radii, 0.0, found)
    for p in range(min(count, _MANY)):
        i, j = found[p, 0], found[p, 1]
        _, _, distance = nearest_points(lengths, rays, after.positions, i, j)
        if distance < _DEEPEST * _reach(radii, i, j):
            _, _, known = nearest_points(lengths, rays, before.positions, i, j)
            if distance < known:
                return True
    return (passes_itself(before.positions, after.positions)
            or _pass_rays(rays, rays, before.positions, after.positions))


@kernel
def _pass_rays(before, after, positions, later_positions):
    """Whether a DLO passes through what goes straight on behind its ends, by rays (2, 3)."""
    return (passes_ray(-before[0], -after[0], 0, positions, later_positions)
            or passes_ray(before[1], after[1], positions.shape[0] - 1, positions, later_positions))


@kernel(forceinline=True)
def _reach(radii, i, j):
    """Return the sum of the radii of two strands, m; behind a grip they are those before it."""
    last = radii.size - 1
    return radii[min(max(i, 0), last)] + radii[min(max(j, 0), last)]


@kernel
def may_act(effect, system, strains, positions, before):
    """Whether two strands are in each other at a shape found without, or pass on the way there."""
    if effect is None:
        return False
    if effect.strand_radius.size == 0:
        return False
    found = np.empty((1, 2), dtype=np.int64)
    return (near_pairs(system.lengths, strains, effect.rays, positions, effect.strand_radius, 0.0,
                       found) > 0
            or passes_itself(before, positions)
            or _pass_rays(effect.rays, effect.rays, before, positions))


@kernel
def watching(effect, lengths, strains, rays, positions, gap):
    """Return the Strands of pairs nearer than both radii and a gap, m, that bear on springs alone.

    Those of a step of a motion, in which springs store energy; itself where nothing bears.
    """
    if effect is None:
        return effect
    if effect.strand_radius.size == 0:
        return effect
    found = np.empty((_MANY, 2), dtype=np.int64)
    count = near_pairs(lengths, strains, rays, positions, effect.strand_radius, gap, found)
    if count > _MANY:
        found = np.empty((count, 2), dtype=np.int64)
        near_pairs(lengths, strains, rays, positions, effect.strand_radius, gap, found)
    reaches = np.empty(count)
    for p in range(count):
        reaches[p] = _reach(effect.strand_radius, found[p, 0], found[p, 1])
    return Strands(found[:count].copy(), np.zeros(count), reaches, effect.strand_radius, rays,
                   effect.pair_spring)


@kernel
def spring_energy(effect, system, state, rays):
    """Return the energy in J in springs of all that is nearer than both radii at a Configuration.

    It has strains and positions; `rays` (2, 3) as of Strands.
    """
    if effect is None:
        return 0.0
    near, energy = watching(effect, system.lengths, state[0], rays, state[1], 0.0), 0.0
    for p in range(near.pair.shape[0]):
        _, _, distance = nearest_points(system.lengths, rays, state[1], near.pair[p, 0],
                                        near.pair[p, 1])
        energy += 0.5 * effect.pair_spring * (near.pair_reach[p] - distance) ** 2
    return energy


@kernel
def escapes(effect, system, rays_before, before, state):
    """Whether a step of a motion leads strands into each other that were not watched, or through.

    Args:
        rays_before, before: (2, 3), (N + 1, 3) of the beginning, relative to the gripper, m
        state: Configuration at its end
    """
    if effect is None:
        return False
    if effect.strand_radius.size == 0:
        return False
    near, known = watching(effect, system.lengths, state.strains, effect.rays, state.positions,
                           0.0), 0
    for p in range(near.pair.shape[0]):
        for w in range(effect.pair.shape[0]):
            if (effect.pair[w, 0] == near.pair[p, 0] and effect.pair[w, 1] == near.pair[p, 1]):
                known += 1
    return (known < near.pair.shape[0] or passes_itself(before, state.positions)
            or _pass_rays(rays_before, effect.rays, before, state.positions))


@kernel
def add_moments_behind(effect, system, state, wrench, wrenches):
    """Add the moments of what bears behind grips to wrenches (6,) and (A, 6) of gripper and holds.

    Its forces these have, as if it acted on the ends of the DLO.
    """
    if effect is None:
        return
    n, positions = system.lengths.size, state.positions
    for p in range(effect.pair.shape[0]):
        i, j = effect.pair[p, 0], effect.pair[p, 1]
        if i >= 0 and j < n:
            continue
        s, t, distance = nearest_points(system.lengths, effect.rays, positions, i, j)
        force = bears(effect, p, distance)
        if force == 0.0 or distance < _TINY * effect.pair_reach[p]:
            continue
        lever, along = np.empty(3), np.empty(3)
        for k in range(3):
            begin, u = _component(effect.rays, positions, i, k)
            other_begin, v = _component(effect.rays, positions, j, k)
            along[k] = force * (begin + s * u - other_begin - t * v) / distance
            lever[k] = ((s - 1.0) * effect.rays[0, k] if i < 0 else t * effect.rays[1, k])
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            moment = lever[a] * along[b] - lever[b] * along[a]
            if i < 0:
                wrench[3 + k] -= moment
            else:
                wrenches[wrenches.shape[0] - 1, 3 + k] += moment


@kernel
def near_pairs(lengths: Floats, strains: Floats, rays: Floats, positions: Floats, radii: Floats,
               gap: float, found: Ints) -> int:
    """Fill found (n, 2) with pairs nearer than both radii and a gap, m; return how many there are.

    More than n are counted, and not filled in. A place is no neighbour of an earlier one if the
    DLO, on its way from there, heads back towards that (`geometry.self_distance`); and none of
    what is straight behind a grip if the DLO, on its way from that, goes backwards.
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
                _, _, distance = nearest_points(lengths, rays, positions, i, j)
                if distance < near:
                    if count < found.shape[0]:
                        found[count, 0], found[count, 1] = i, j
                    count += 1
            j += 1
    for ray in range(2):
        if not _is_there(rays[ray]):
            continue
        back = False
        for m in range(n):
            e = m if ray == 0 else n - 1 - m  # from the grip on
            along = 0.0
            for k in range(3):
                along += rays[ray, k] * (positions[e + 1, k] - positions[e, k])
            back = back or along < 0.0
            i, j = (-1, e) if ray == 0 else (e, n)
            if back and nearest_points(lengths, rays, positions, i, j)[2] < (
                    _reach(radii, i, j) + gap):
                if count < found.shape[0]:
                    found[count, 0], found[count, 1] = i, j
                count += 1
    return count


@kernel
def _is_there(ray):
    """Whether a DLO goes on behind an end."""
    return ray[0] != 0.0 or ray[1] != 0.0 or ray[2] != 0.0


@kernel
def nodes_of(effect, n, p):
    """Return the four nodes, rising, that the strands of pair p move with, of n elements."""
    first, second = _ends(n, effect.pair[p, 0])
    third, fourth = _ends(n, effect.pair[p, 1])
    return first, second, third, fourth


@kernel
def put_rows(effect, system, state, p, rows, weights):
    """Fill what pair p adds to second derivatives: a sum of weights times rows row^T.

    Returns how many there are. Shapes: rows (ROWS, 4, 3) forces on the nodes that both strands move
    with, see `nodes_of`; weights (ROWS,), N/m.
    """
    i, j = effect.pair[p, 0], effect.pair[p, 1]
    positions = state.positions
    s, t, distance = nearest_points(system.lengths, effect.rays, positions, i, j)
    force = bears(effect, p, distance)
    if force == 0.0 or distance < _TINY * effect.pair_reach[p]:
        return 0
    u, v, w = np.empty(3), np.empty(3), np.empty(3)
    uu = vv = uv = ww = 0.0
    for k in range(3):
        begin, u[k] = _component(effect.rays, positions, i, k)
        other_begin, v[k] = _component(effect.rays, positions, j, k)
        w[k] = begin + s * u[k] - other_begin - t * v[k]
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
        scale = 1.0 / np.sqrt(uu + _soft(system.lengths, i))
        _put_distance_row(s, t, u, scale, rows[count])
        for k in range(3):
            rows[count, 0, k] -= scale * w[k]
            rows[count, 1, k] += scale * w[k]
        weights[count] = tension
        count += 1
    if 0.0 < t < 1.0:
        b = vv + _soft(system.lengths, j)
        mixed = 0.0
        if count > begin:
            mixed = -uv / np.sqrt(uu + _soft(system.lengths, i))
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
