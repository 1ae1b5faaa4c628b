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

Friction acts on the surfaces, where the two points of a pair touch, along two tangents that turn
with them. By how much they have slid along each other is counted from a shape near by (`put_slip`),
where it is `rub_slip`. A pair rubs with

    t = the nearest to `rub_force` - `rub_spring` slip in the disk of radius `rub_limit`

which near that shape is the derivative of a potential: its limit is given. The search
(`direct.self_contact`) sets limit and shape anew until t obeys Coulomb's law. What is straight
behind a grip does not rub.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_planner.geometry.record import Record, replaced
from dlo_planner.geometry.self_distance import heads_back
from dlo_planner.geometry.self_passage import passes_itself, passes_ray
from dlo_planner.geometry.so3 import coefficients_in, jacobians_with, matrix, times
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints

SOFT = 1e-3        # of the squared length of a chord: chords at a smaller angle than its root, in
#                    rad, are parallel
ACROSS = 5         # rows of a pair at most, see `put_rows`
ROWS = ACROSS + 2  # with those of friction
_TOUCHED = 0.1     # of the reach: surfaces as far apart have not rubbed on each other yet
_DEEPEST = 0.9    # of the reach: strands that a step leaves nearer are not known of yet
_DEEP = 0.96       # the same: strands that are nearer are pushed out before anything else
_MANY = 256        # pairs in each other that are looked at: what has more is no shape yet
_RIGHT = 0.5 * np.pi
# of the reach: chords that are nearer have no normal, and no force; and of the square of a chord:
# what of it is not along the normal tells no direction
_TINY = 1e-12


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
    # Of Q pairs, all of them or none: friction before on the first strand, N, along the tangents of
    # `tangents`; its limits, N; slip since then, m, at the shape with these nodes
    rub_force: Floats     # (Q, 2)
    rub_limit: Floats     # (Q,)
    rub_slip: Floats      # (Q, 2)
    rub_places: Floats    # (N + 1, 3) m; none without Q
    rub_frames: Floats    # (N + 1, 3, 3)
    rub_spring: float     # N/m; 0: nobody knows how far they slid


NO_RAYS = np.zeros((2, 3))  # of a DLO with a free end


def no_strands(radii: Floats, spring: float) -> Strands:
    """Return the Strands of a DLO with elements of these radii (N,), of which none is near.

    Without radii, (0,), nothing keeps its strands off each other. `spring` in N/m.
    """
    return smooth_strands(np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros(0), radii,
                          NO_RAYS.copy(), spring)


@kernel
def smooth_strands(pair: Ints, force: Floats, reach: Floats, radii: Floats, rays: Floats,
                   spring: float) -> Strands:
    """Return the Strands that do not rub on each other; arguments as the first fields."""
    return Strands(pair, force, reach, radii, rays, spring, np.zeros((0, 2)), np.zeros(0),
                   np.zeros((0, 2)), np.zeros((0, 3)), np.zeros((0, 3, 3)), 0.0)



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
    more = _add_friction(effect, system.lengths, state)
    return energy + more, size + abs(more)


@kernel
def _add_friction(effect, lengths, state):
    """Add friction to `state.pull`, its couples to `state.slope`; return its potential in J."""
    energy, spring, none = 0.0, effect.rub_spring, np.zeros((4, 3))
    touch, values = new_touch(), np.empty((lengths.size, 3))
    for p in range(effect.rub_limit.size):
        limit = effect.rub_limit[p]
        if limit == 0.0:
            continue
        size = put_trial(effect, lengths, state, p, touch)
        if size < 0.0:
            continue
        part = 1.0 if size <= limit else limit / size
        if spring > 0.0:
            first, second = effect.rub_force[p]
            energy += 0.5 * ((size * size if part == 1.0 else limit * (2.0 * size - limit))
                             - first * first - second * second) / spring
        for k in range(3):
            along = part * (touch.trial[0] * touch.axes[1, k] + touch.trial[1] * touch.axes[2, k])
            for m in range(4):
                touch.forces[m, k] = touch.shares[m] * along
                state.pull[touch.nodes[m], k] -= touch.forces[m, k]
        put_couples(touch)
        put_load_row(lengths, state, touch.nodes, none, touch.couples, values)
        for e in range(lengths.size):
            for k in range(3):
                state.slope[e, k] -= values[e, k]
    return energy


@kernel
def put_friction(effect: Strands, lengths: Floats, state: Any, out: Floats) -> None:
    """Fill out (Q, 2) with the friction of pairs at a Configuration, N, along their tangents."""
    touch = new_touch()
    for p in range(out.shape[0]):
        size, limit = put_trial(effect, lengths, state, p, touch), effect.rub_limit[p]
        part = 0.0 if size < 0.0 else 1.0 if size <= limit else limit / size
        out[p, 0], out[p, 1] = part * touch.trial[0], part * touch.trial[1]


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
def may_forbid(effect):
    """Whether strands are kept off each other."""
    return False if effect is None else effect.strand_radius.size > 0


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
    return smooth_strands(found[:count].copy(), np.zeros(count), reaches, effect.strand_radius,
                          rays, effect.pair_spring)


@kernel
def rubbing_since(effect, lengths, pair, friction, places, frames, coefficient):
    """Return Strands whose friction counts from the beginning of a step of a motion.

    Its springs are as stiff as those that keep strands apart, its limits those of the forces then.

    Args:
        pair, friction: (R, 2) of pairs that rubbed then, and what they did, N, as of `rub_force`
        places, frames: (N + 1, 3), (N + 1, 3, 3) of the nodes then, m
    """
    count = effect.pair.shape[0]
    before, limits, axes = np.zeros((count, 2)), np.empty(count), np.empty((3, 3))
    for p in range(count):
        limits[p] = coefficient * _pressure(effect, lengths, places, p, axes)
        for r in range(pair.shape[0]):
            if pair[r, 0] == effect.pair[p, 0] and pair[r, 1] == effect.pair[p, 1]:
                before[p, 0], before[p, 1] = friction[r, 0], friction[r, 1]
    return replaced(effect, 'rub_force', before, 'rub_limit', limits,
                    'rub_slip', np.zeros((count, 2)), 'rub_places', places.copy(),
                    'rub_frames', frames.copy(), 'rub_spring', effect.pair_spring)


@kernel
def _pressure(effect, lengths, positions, p, axes):
    """Return the force in N that presses the surfaces of pair p together; `axes` (3, 3): space."""
    i, j = effect.pair[p, 0], effect.pair[p, 1]
    if i < 0 or j >= lengths.size:
        return 0.0
    s, t, distance = nearest_points(lengths, effect.rays, positions, i, j)
    force = bears(effect, p, distance)
    if force == 0.0 or distance < _TINY * effect.pair_reach[p]:
        return 0.0
    # (a part of it keeps nearest points in the middle, and does not press)
    return force * tangents(positions, i, s, j, t, axes) / distance


@kernel
def renew_friction(effect, lengths, now, places, frames, coefficient):
    """Let friction be that of the slips and forces at a Configuration, from where it counts on.

    Returns by how much it changes with that, of the largest force that presses.

    Args:
        places, frames: (N + 1, 3), (N + 1, 3, 3) of the nodes at the beginning of the step, m
    """
    if effect is None:
        return 0.0
    count, touch, largest, changed = effect.rub_limit.size, new_touch(), 0.0, 0.0
    if count == 0:
        return 0.0
    acting, lawful = np.empty((count, 2)), np.empty((count, 2))
    put_friction(effect, lengths, now, acting)
    for p in range(count):
        force = _pressure(effect, lengths, now.positions, p, touch.axes)
        effect.rub_limit[p] = coefficient * force
        largest = max(largest, force)
        if put_slip(effect, lengths, now, p, places, frames, touch) >= 0.0:
            effect.rub_slip[p, 0], effect.rub_slip[p, 1] = touch.slip[0], touch.slip[1]
    effect.rub_places[:] = now.positions
    effect.rub_frames[:] = now.rotations
    put_friction(effect, lengths, now, lawful)
    for p in range(count):
        for q in range(2):
            changed = max(changed, abs(lawful[p, q] - acting[p, q]))
    return changed / largest if largest > 0.0 else changed


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

    Its forces these have, as if it acted on the ends of the DLO; of friction they have the forces,
    and not the couples, with which it is in balance.
    """
    if effect is None:
        return
    touch = new_touch()
    for p in range(effect.rub_limit.size):
        limit = effect.rub_limit[p]
        size = put_trial(effect, system.lengths, state, p, touch) if limit > 0.0 else -1.0
        if size < 0.0:
            continue
        part = 1.0 if size <= limit else limit / size
        for k in range(3):
            along = part * (touch.trial[0] * touch.axes[1, k] + touch.trial[1] * touch.axes[2, k])
            for m in range(4):
                touch.forces[m, k] = touch.shares[m] * along
        put_couples(touch)
        for m in range(4):
            for k in range(3):
                wrench[3 + k] -= touch.couples[m, k]
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

    Returns how many there are. Shapes: rows (ACROSS, 4, 3) forces on the nodes that both strands
    move with, see `nodes_of`; weights (ACROSS,), N/m. Without friction.
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


@kernel
def put_friction_rows(effect, system, state, p, rows, weights):
    """Fill what friction of pair p adds to second derivatives, as weights (2,) times row row^T.

    Returns how many rows (2, N, 3), by the strains, there are. What slides has its limit; that
    couples turn with the strands is not counted.
    """
    if p >= effect.rub_limit.size:
        return 0
    limit, spring = effect.rub_limit[p], effect.rub_spring
    if limit == 0.0 or spring == 0.0:
        return 0
    touch = new_touch()
    size = put_trial(effect, system.lengths, state, p, touch)
    if size < 0.0:
        return 0
    count = 1 if size > limit else 2
    for q in range(count):
        weights[q] = spring if count == 2 else spring * limit / size
        for k in range(3):
            way = touch.axes[1 + q, k]
            if count == 1:  # across what it slides
                way = (touch.trial[0] * touch.axes[2, k]
                       - touch.trial[1] * touch.axes[1, k]) / size
            for m in range(4):
                touch.forces[m, k] = touch.shares[m] * way
        put_couples(touch)
        put_load_row(system.lengths, state, touch.nodes, touch.forces, touch.couples, rows[q])
    return count


class Touch(Record):
    """Two surfaces that touch: four nodes that they move with, and work space."""

    nodes: Ints      # (4,) rising
    shares: Floats   # (4,) of them: of the second strand they are negative
    axes: Floats     # (3, 3) normal and two tangents, see `tangents`
    arms: Floats     # (4, 3) m, from the axis to the surface
    slip: Floats     # (2,) m, of the first on the second strand, along the tangents
    trial: Floats    # (2,) N, friction without a limit
    forces: Floats   # (4, 3) N, and couples, N m
    couples: Floats


@kernel
def new_touch():
    """Return an empty Touch."""
    return Touch(np.empty(4, dtype=np.int64), np.empty(4), np.empty((3, 3)), np.empty((4, 3)),
                 np.zeros(2), np.zeros(2), np.empty((4, 3)), np.empty((4, 3)))


@kernel
def put_trial(effect, lengths, state, p, touch):
    """Fill the Touch of pair p; return the size of its friction without a limit, N, or -1: none."""
    if put_slip(effect, lengths, state, p, effect.rub_places, effect.rub_frames, touch) < 0.0:
        return -1.0
    for q in range(2):
        touch.trial[q] = (effect.rub_force[p, q]
                          - effect.rub_spring * (effect.rub_slip[p, q] + touch.slip[q]))
    return np.sqrt(touch.trial[0] ** 2 + touch.trial[1] ** 2)


@kernel
def put_couples(touch):
    """Fill the couples of forces on the surfaces."""
    for m in range(4):
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            touch.couples[m, k] = (touch.arms[m, a] * touch.forces[m, b]
                                   - touch.arms[m, b] * touch.forces[m, a])


@kernel
def tangents(positions: Floats, i: int, s: float, j: int, t: float, out: Floats) -> float:
    """Fill out (3, 3) with the normal of a pair and two tangents; return its distance, m.

    The normal is from strand j to i, the first tangent as nearly along strand i as can be.
    """
    square = along = chord = 0.0
    for k in range(3):
        u = positions[i + 1, k] - positions[i, k]
        chord += u * u
        out[1, k] = u
        out[0, k] = (positions[i, k] + s * u - positions[j, k]
                     - t * (positions[j + 1, k] - positions[j, k]))
        square += out[0, k] ** 2
        along += out[0, k] * u
    width, size = np.sqrt(square), 0.0
    for k in range(3):
        out[1, k] -= along / square * out[0, k]
        size += out[1, k] ** 2
    for k in range(3):
        out[0, k] /= width
    if not size > _TINY * chord:  # it is along the normal there: any direction is as good
        least = 0
        for k in range(1, 3):
            if abs(out[0, k]) < abs(out[0, least]):
                least = k
        size = 0.0
        for k in range(3):
            out[1, k] = (1.0 if k == least else 0.0) - out[0, least] * out[0, k]
            size += out[1, k] ** 2
    for k in range(3):
        out[1, k] /= np.sqrt(size)
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        out[2, k] = out[0, a] * out[1, b] - out[0, b] * out[1, a]
    return width


@kernel
def put_slip(strands, lengths, now, p, places, frames, touch):
    """Fill by how much the surfaces of pair p have slid along each other since a shape before.

    That is where the two points that touch now were then, seen from the DLO beside them. Returns by
    how much these were apart along the normal, m; -1 of what is behind a grip.

    Args:
        now: Configuration
        places, frames: (N + 1, 3), (N + 1, 3, 3) of the nodes then, m
        touch: Touch, which is filled but for forces and couples
    """
    i, j = strands.pair[p, 0], strands.pair[p, 1]
    if i < 0 or j >= lengths.size:
        return -1.0
    s, t, distance = nearest_points(lengths, strands.rays, now.positions, i, j)
    if distance < _TINY * strands.pair_reach[p]:
        return -1.0
    width = tangents(now.positions, i, s, j, t, touch.axes)
    # (what springs bear alone lies in each other: both surfaces are where they would meet)
    thick = min(1.0, width / _reach(strands.strand_radius, i, j))
    nodes, shares, arms, away, turned = (touch.nodes, touch.shares, touch.arms, np.zeros(3),
                                         np.zeros(3))
    nodes[0], nodes[1], nodes[2], nodes[3] = i, i + 1, j, j + 1
    shares[0], shares[1], shares[2], shares[3] = 1.0 - s, s, t - 1.0, -t
    arm = np.empty(3)
    for m in range(4):
        node = nodes[m]
        for k in range(3):
            arms[m, k] = thick * (-strands.strand_radius[i] if m < 2
                                  else strands.strand_radius[j]) * touch.axes[0, k]
        _turn(now.rotations[node], frames[node], arms[m], arm)
        for k in range(3):
            away[k] += shares[m] * (places[node, k] + arm[k])
    for m in range(4):
        _turn(frames[nodes[m]], now.rotations[nodes[m]], away, arm)
        for k in range(3):
            turned[k] += 0.5 * abs(shares[m]) * arm[k]
    apart = touch.slip[0] = touch.slip[1] = 0.0
    for k in range(3):
        apart += touch.axes[0, k] * turned[k]
        for q in range(2):
            touch.slip[q] -= touch.axes[1 + q, k] * turned[k]
    return abs(apart)


@kernel
def put_slips(strands: Strands, lengths: Floats, now: Any, places: Floats, frames: Floats,
              slips: Floats, touched: Floats) -> None:
    """Fill slips (P, 2) of all pairs since a shape before, m, as `put_slip`.

    And whether they touched there then, touched (P,): 1; less of what nearly did, 0 of what was
    apart, which has come to touch at the end of the step.
    """
    touch = new_touch()
    for p in range(strands.pair.shape[0]):
        apart = put_slip(strands, lengths, now, p, places, frames, touch)
        if apart < 0.0:
            slips[p, 0] = slips[p, 1] = touched[p] = 0.0
            continue
        slips[p, 0], slips[p, 1] = touch.slip[0], touch.slip[1]
        # (of the force, a part keeps nearest points in the middle, and does not press)
        i, j = strands.pair[p, 0], strands.pair[p, 1]
        s, t, distance = nearest_points(lengths, strands.rays, now.positions, i, j)
        width = tangents(now.positions, i, s, j, t, touch.axes)
        touched[p] = (width / distance
                      * max(0.0, 1.0 - apart / (_TOUCHED * strands.pair_reach[p])))


@kernel(forceinline=True)
def _turn(before, after, vector, out):
    """Fill out (3,) with a vector (3,) that turns as a frame (3, 3) does."""
    x = before[0, 0] * vector[0] + before[1, 0] * vector[1] + before[2, 0] * vector[2]
    y = before[0, 1] * vector[0] + before[1, 1] * vector[1] + before[2, 1] * vector[2]
    z = before[0, 2] * vector[0] + before[1, 2] * vector[1] + before[2, 2] * vector[2]
    for k in range(3):
        out[k] = after[k, 0] * x + after[k, 1] * y + after[k, 2] * z


@kernel
def put_load_row(lengths, state, places, forces, couples, values):
    """Fill values (N, 3) with the work of forces and couples (4, 3) on nodes, by the strains.

    `places` (4,) are the nodes, rising.
    """
    moment, force, last = np.zeros(3), np.zeros(3), 3
    for r in range(lengths.size):
        e = lengths.size - 1 - r
        while last >= 0 and places[last] > e:  # it lies beyond the element
            x, f = state.positions[places[last]], forces[last]
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                force[k] += f[k]
                moment[k] += couples[last, k] + x[a] * f[b] - x[b] * f[a]
            last -= 1
        if last == 3:
            for k in range(3):
                values[e, k] = 0.0
            continue
        h, u, x = lengths[e], state.strains[e], state.positions[e + 1]
        turning, chord = jacobians_with(h * u[0], h * u[1], h * u[2], h,
                                        coefficients_in(state.arcs[e]))
        frame = matrix(state.rotations[e])
        turned, moved = times(frame, turning), times(frame, chord)
        m0 = moment[0] - x[1] * force[2] + x[2] * force[1]  # about the end of the element
        m1 = moment[1] - x[2] * force[0] + x[0] * force[2]
        m2 = moment[2] - x[0] * force[1] + x[1] * force[0]
        for k in range(3):
            values[e, k] = h * (turned[k] * m0 + turned[3 + k] * m1 + turned[6 + k] * m2
                                + moved[k] * force[0] + moved[3 + k] * force[1]
                                + moved[6 + k] * force[2])
