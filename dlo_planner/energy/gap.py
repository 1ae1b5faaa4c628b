# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The gap between a DLO and obstacles: of its section, its nearest point, its depth."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.chords import lowest_of_tangents, mesh_bound, sheet_bound
from dlo_planner.energy.scene import (
    AXIS,
    EDGE,
    FACE,
    MESH,
    NODE_FACE,
    PLANE,
    SHEET,
    Scene,
    height,
    signed_distance,
)
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

# ------------------------------------------------------------------------------------------------
# Where the outside of a DLO comes nearest to an obstacle: balls about its axis, or its section.
#
# A rectangular section is the convex hull of four points, so that its four edges, lines along the
# DLO at an offset c from the axis, touch whatever is flat or wide. Between them a face may be
# nearest to an obstacle that is curved or has an edge: there the offset is the one that makes the
# distance smallest, and slides. With w = e1 + u x c (material axes, u the strains) the touching
# point moves along the DLO by R w per arc length, and R w changes by R (u x w).


_ROUNDS = 60
_FREE = 1.0 - 1e-9  # of the half size: an offset beyond is at the section's edge


@kernel
def is_face(scene, o):
    """Return whether body `o` is for a face, which is watched at chosen points only."""
    return scene.feature[o] >= FACE


@kernel
def node_range(scene, o, n):
    """Return the first and the last of nodes 0 ... n that the DLO's feature for body `o` has."""
    return scene.span[o, 0], min(scene.span[o, 1], n)


@kernel
def radius_at(scene, o, e, fraction):
    """Return the radius in m about the DLO's feature for body `o`, at `fraction` of element e."""
    if scene.feature[o] != AXIS:
        return scene.rounding[o]
    if scene.radii.shape[0] == 0:
        return scene.radius
    return scene.radii[e, 0] + fraction * (scene.radii[e, 1] - scene.radii[e, 0])


@kernel
def taper(scene, o, e):
    """Return by how much, m, that radius grows along element e."""
    if scene.radii.shape[0] == 0 or scene.feature[o] != AXIS:
        return 0.0
    return scene.radii[e, 1] - scene.radii[e, 0]


@kernel
def radius_at_node(scene, o, k):
    """Return that radius in m at node k: the larger one, where it jumps."""
    if scene.radii.shape[0] == 0 or scene.feature[o] != AXIS:
        return radius_at(scene, o, 0, 0.0)
    n = scene.radii.shape[0]
    before, behind = scene.radii[max(k - 1, 0), 1], scene.radii[min(k, n - 1), 0]
    if k == 0:
        return behind
    return before if k == n else max(before, behind)


@kernel
def gap_at(scene, o, rotation, position, radius, offset, point, normal, hessian):
    """Return the gap in m between body `o` and the DLO's section with this frame and place."""
    for i in range(3):
        point[i] = scene.origin[i] + position[i]
    if scene.feature[o] != AXIS:
        if scene.feature[o] == EDGE:
            offset[0], offset[1] = scene.offset[o, 0], scene.offset[o, 1]
        else:
            _nearest_in_section(scene, o, rotation, point, offset)
        for i in range(3):
            point[i] += rotation[i, 1] * offset[0] + rotation[i, 2] * offset[1]
    return signed_distance(scene, o, point, normal, hessian) - radius


@kernel
def node_gap(scene, o, k, rotations, positions, offset, point, normal, hessian):
    """Return the gap in m of node k; see `gap_at`."""
    if scene.feature[o] >= FACE:
        return gap_at(scene, o, rotations[k], positions[k], scene.rounding[o], offset, point,
                      normal, hessian)
    offset[0], offset[1] = scene.offset[o, 0], scene.offset[o, 1]
    for i in range(3):
        point[i] = (scene.origin[i] + positions[k, i] + rotations[k, i, 1] * offset[0]
                    + rotations[k, i, 2] * offset[1])
    return signed_distance(scene, o, point, normal, hessian) - radius_at_node(scene, o, k)


@kernel
def near_gaps(scene, o, lengths, multiplier, strains, rotations, positions, near):
    """Return (N + 1,) the gaps in m of nodes to body `o`, infinite where they need no look.

    That is where they are told to be larger than `near` and there is no multiplier (N + 1,), N; and
    of a face, which is watched at chosen points only.
    """
    gaps, x, normal, hessian = (np.full(lengths.size + 1, np.inf), np.empty(3), np.empty(3),
                                np.empty((3, 3)))
    if is_face(scene, o):
        return gaps
    # read once: a sweep would take five times as long
    axes, center, origin, offset, flat = (scene.axes[o], scene.center[o], scene.origin,
                                          scene.offset[o], scene.kind[o] == PLANE)
    longest = longest_stretch(scene, o, strains)
    begin, end = node_range(scene, o, lengths.size)
    k = max(1, begin)
    while k <= end:
        for i in range(3):
            x[i] = (origin[i] + positions[k, i] + rotations[k, i, 1] * offset[0]
                    + rotations[k, i, 2] * offset[1])
        away = height(axes, center, x) if flat else signed_distance(scene, o, x, normal, hessian)
        gaps[k] = away - radius_at_node(scene, o, k)
        k = next_touching(lengths, multiplier, k, (gaps[k] - near) * longest)
    return gaps


@kernel
def next_touching(lengths, multiplier, node, gap):
    """Return the next node after `node` that may touch an obstacle, N + 1 if none does.

    No node is nearer to it by more than the DLO between them is long. Far obstacles cost nothing.
    """
    last = lengths.size
    distance = 0.0
    while node <= last:
        if node < last:
            distance += lengths[node]
        node += 1
        if distance >= gap or node <= last and multiplier[node] > 0.0:
            break
    return node


@kernel
def _nearest_in_section(scene, o, rotation, place, offset):
    """Fill the offset (2,) of the point of a section that is nearest to a sphere or capsule.

    Along the capsule's axis, the squared distance of its points from the section is convex, with a
    slope that is linear in parts: Newton's method, safeguarded, finds its zero.
    """
    away, axis = np.zeros(3), np.zeros(3)  # material axes
    for i in range(3):
        for j in range(3):
            away[i] += rotation[j, i] * (scene.center[o, j] - place[j])
            axis[i] += rotation[j, i] * scene.axes[o, j, 0]
    half = scene.size[o, 0]
    low, high, t = -half, half, 0.0
    for _ in range(_ROUNDS):
        slope, curve = axis[0] * (away[0] + t * axis[0]), axis[0] * axis[0]
        for i in range(2):
            across = away[1 + i] + t * axis[1 + i]
            offset[i] = min(max(across, -scene.offset[o, i]), scene.offset[o, i])
            slope += axis[1 + i] * (across - offset[i])
            if across != offset[i]:
                curve += axis[1 + i] * axis[1 + i]
        if slope == 0.0 or high - low <= 1e-15 * half:
            break
        if slope > 0.0:
            high = t
        else:
            low = t
        target = t - slope / curve if curve > 0.0 else np.inf
        if not low < target < high:
            # the end itself, if all of the way there is not enough
            end = high if slope < 0.0 else low
            target = end if abs(end) == half and abs(end - t) > 1e-15 * half else 0.5 * (low + high)
        if abs(target - t) <= 1e-16 * half:
            break
        t = target


@kernel
def along_at(rotation, strain, offset, along, turn):
    """Fill the motion (3,) of a point of the section per arc length, and its change `turn` (3,)."""
    w0 = 1.0 + strain[1] * offset[1] - strain[2] * offset[0]
    w1, w2 = -strain[0] * offset[1], strain[0] * offset[0]
    # u x w
    t0 = strain[1] * w2 - strain[2] * w1
    t1 = strain[2] * w0 - strain[0] * w2
    t2 = strain[0] * w1 - strain[1] * w0
    for i in range(3):
        along[i] = rotation[i, 0] * w0 + rotation[i, 1] * w1 + rotation[i, 2] * w2
        turn[i] = rotation[i, 0] * t0 + rotation[i, 1] * t1 + rotation[i, 2] * t2


@kernel
def stretch(scene, o, strain):
    """Return how long at most a feature is per length of the axis."""
    if scene.feature[o] == AXIS:
        return 1.0
    size = np.sqrt(strain[0] ** 2 + strain[1] ** 2 + strain[2] ** 2)
    return 1.0 + size * np.sqrt(scene.offset[o, 0] ** 2 + scene.offset[o, 1] ** 2)


@kernel
def longest_stretch(scene, o, strains):
    """Return a length of the axis per length that no feature for body `o` exceeds; 0: not known."""
    if scene.feature[o] == AXIS:
        return 1.0 if scene.radii.shape[0] == 0 else 0.0
    longest = 1.0
    for e in range(strains.shape[0]):
        longest = max(longest, stretch(scene, o, strains[e]))
    return 1.0 / longest


@kernel
def sliding(scene, o, free_along, rotation, strain, offset, normal, hessian, moves, curves):
    """Return how many coordinates of a touching point may slide: across first, then along."""
    count = 0
    along, turn = np.empty(3), np.empty(3)
    if scene.feature[o] >= FACE:
        for i in range(2):
            if abs(offset[i]) < _FREE * scene.offset[o, i]:
                for j in range(3):
                    moves[count, j] = rotation[j, 1 + i]
                count += 1
    across = count
    if free_along and scene.feature[o] != NODE_FACE:
        along_at(rotation, strain, offset, along, turn)
        for j in range(3):
            moves[count, j] = along[j]
        count += 1
    for i in range(count):
        for j in range(count):
            curves[i, j] = 0.0
            for k in range(3):
                for m in range(3):
                    curves[i, j] += moves[i, k] * hessian[k, m] * moves[j, m]
    if count > across:
        for k in range(3):
            curves[across, across] += normal[k] * turn[k]
        c = 0
        for i in range(2):
            if scene.feature[o] >= FACE and abs(offset[i]) < _FREE * scene.offset[o, i]:
                # d(R w)/dc_i = R (u x e_i)
                t0 = -strain[2] if i == 0 else strain[1]
                t1 = 0.0 if i == 0 else -strain[0]
                t2 = strain[0] if i == 0 else 0.0
                mixed = 0.0
                for k in range(3):
                    mixed += normal[k] * (rotation[k, 0] * t0 + rotation[k, 1] * t1
                                          + rotation[k, 2] * t2)
                curves[c, across] += mixed
                curves[across, c] += mixed
                c += 1
    return count


@kernel
def slope_along(scene, o, rotation, strain, offset, normal, hessian):
    """Return dg/ds and d2g/ds2 of the gap along the DLO; a face's offset gives way."""
    moves, curves = np.empty((3, 3)), np.empty((3, 3))
    along, turn = np.empty(3), np.empty(3)
    along_at(rotation, strain, offset, along, turn)
    slope = 0.0
    curve = 0.0
    for i in range(3):
        slope += normal[i] * along[i]
    count = sliding(scene, o, True, rotation, strain, offset, normal, hessian, moves, curves)
    for i in range(count - 1):
        if curves[i, i] > 0.0:
            for j in range(i + 1, count):
                factor = curves[j, i] / curves[i, i]
                for k in range(i + 1, count):
                    curves[j, k] -= factor * curves[i, k]
    if count and scene.feature[o] != NODE_FACE:
        curve = curves[count - 1, count - 1]
    return slope, curve


# ------------------------------------------------------------------------------------------------
# The least gap along an element, whatever minima it has there: by branch and bound.
#
# Between two points of an element the DLO is no farther from its chord than w^2/8 times its
# curvature in a length w, on an exact helix. No distance changes by more than the place does. So
# what a chord keeps at least (`energy.chords`), less that height, is a lower bound of all gaps
# between. Where it is not sufficient one point more is looked at. The bound is as good as the
# square of the length: some ten points are enough, and where an element bends just as the obstacle
# does the bound need not be as close.


_HEAP = 64      # points that wait at a time; each halves what is left at least every second time
_MOST = 2000    # points of one element: what is then not known is told as the bound
_CLOSELY = 32   # points, after which twice the slack is left, and so on
_SLACK = 128.0  # times what is asked for, at most
_SHARE = 0.02   # of a piece: nearer to its ends it is not cut
_THIN = 1e-10   # of an element: what is shorter is a point


@kernel
def least_gap(scene, o, e, low, high, below, exact, lengths, strains, rotations, positions):
    """Return the least gap in m of element e between two fractions, where, and a lower bound.

    No gap between them is less than the gap returned, or than `below` m, by more than 128 `exact`
    m, as a rule by less than `exact`; where that cannot be told in time the bound is less than the
    gap.
    """
    at, gaps, radii = np.empty(_HEAP), np.empty(_HEAP), np.empty(_HEAP)
    places, normals = np.empty((_HEAP, 3)), np.empty((_HEAP, 3))
    sides = np.empty((_HEAP, 2, 3))
    bend = _bend(scene, o, strains[e])
    size = lengths[e]
    slopes = np.empty(2)
    here, top, looks = 0, 1, 2  # the point at the left, and the next one of those that wait
    at[0], at[1] = low, high
    for k in range(2):
        _look(scene, o, e, k, lengths, strains, rotations, positions, at, gaps, radii, places,
              normals, sides)
    best, where = gaps[0], low
    if gaps[1] < best:
        best, where = gaps[1], high
    bound = np.inf
    while True:
        width = (at[top] - at[here]) * size
        _slopes(scene, o, here, top, radii, places, normals, sides, slopes)
        if scene.kind[o] == SHEET:
            least = sheet_bound(scene, o, places[here], places[top]) - max(radii[here], radii[top])
        elif scene.kind[o] == MESH:
            least = mesh_bound(scene, o, places[here], gaps[here] + radii[here], places[top],
                               gaps[top] + radii[top]) - max(radii[here], radii[top])
        else:
            least = lowest_of_tangents(gaps[here], slopes[0], gaps[top], slopes[1])
        least -= 0.125 * bend * width * width
        slack = exact * min(2.0 ** (looks // _CLOSELY), _SLACK)
        done = least >= min(best, below) - slack
        if not done and (at[top] - at[here] <= _THIN or looks >= _MOST or top + 1 >= _HEAP):
            bound, done = min(bound, least), True
        if done:
            if top == 1:
                break
            _take(here, top, at, gaps, radii, places, normals, sides)
            top -= 1
            continue
        share = 0.5
        if looks % 2 == 0 and slopes[0] < 0.0 < slopes[1]:  # where its slope should be zero
            share = min(max(slopes[0] / (slopes[0] - slopes[1]), _SHARE), 1.0 - _SHARE)
        top += 1
        at[top] = at[here] + share * (at[top - 1] - at[here])
        _look(scene, o, e, top, lengths, strains, rotations, positions, at, gaps, radii, places,
              normals, sides)
        looks += 1
        if gaps[top] < best:
            best, where = gaps[top], at[top]
    return best, where, min(best, bound)


@kernel
def _look(scene, o, e, k, lengths, strains, rotations, positions, at, gaps, radii, places, normals,
          sides):
    """Fill in what is known of point k of those of `least_gap`.

    That is gap, radius and, in the world, a place of the section and the normal there; of a face
    the place of the axis and both directions across, as long as its half sizes.
    """
    rotation, x, offset, point = np.empty((3, 3)), np.empty(3), np.zeros(2), np.empty(3)
    hessian = np.empty((3, 3))
    point_inside(lengths, strains, rotations, positions, e, at[k], rotation, x)
    radii[k] = radius_at(scene, o, e, at[k])
    gaps[k] = gap_at(scene, o, rotation, x, radii[k], offset, point, normals[k], hessian)
    for i in range(3):
        if scene.feature[o] >= FACE:
            places[k, i] = scene.origin[i] + x[i]
            for side in range(2):
                sides[k, side, i] = rotation[i, 1 + side] * scene.offset[o, side]
        else:
            places[k, i] = point[i]


@kernel
def _take(here, top, at, gaps, radii, places, normals, sides):
    """Copy what is known of point `top` to point `here`."""
    at[here], gaps[here], radii[here] = at[top], gaps[top], radii[top]
    for i in range(3):
        places[here, i], normals[here, i] = places[top, i], normals[top, i]
        for side in range(2):
            sides[here, side, i] = sides[top, side, i]


@kernel
def _slopes(scene, o, here, top, radii, places, normals, sides, slopes):
    """Fill slopes (2,): of the gap along the chord between two points, per its length, at both.

    A face's point may be anywhere across: of the slopes the one that leaves the least gap.
    """
    for end in range(2):
        k = here if end == 0 else top
        slope = radii[here] - radii[top]
        for i in range(3):
            slope += normals[k, i] * (places[top, i] - places[here, i])
        if scene.feature[o] >= FACE:
            turned = 0.0
            for side in range(2):
                along = 0.0
                for i in range(3):
                    along += normals[k, i] * (sides[top, side, i] - sides[here, side, i])
                turned += abs(along)
            slope += turned if end == 1 else -turned
        slopes[end] = slope


@kernel
def _bend(scene, o, strain):
    """Return the largest curvature in 1/m of the ways along the DLO that a feature may take."""
    if scene.feature[o] == AXIS:
        return np.sqrt(strain[1] ** 2 + strain[2] ** 2)
    n, b = scene.offset[o, 0], scene.offset[o, 1]
    bend = _bend_beside(strain, n, b)
    if scene.feature[o] >= FACE:
        bend = max(bend, _bend_beside(strain, -n, b), _bend_beside(strain, n, -b),
                   _bend_beside(strain, -n, -b))
    return bend


@kernel
def _bend_beside(strain, n, b):
    """Return |u x w|, by which the motion of a point of the section at (n, b) turns, 1/m."""
    w0 = 1.0 + strain[1] * b - strain[2] * n
    w1, w2 = -strain[0] * b, strain[0] * n
    t0 = strain[1] * w2 - strain[2] * w1
    t1 = strain[2] * w0 - strain[0] * w2
    t2 = strain[0] * w1 - strain[1] * w0
    return np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)


# ------------------------------------------------------------------------------------------------
# The point of a DLO that is nearest to an obstacle: inside one element, or wherever it rolls to.
#
# The curve and its tangent are continuous, so the nearest point passes from an element to the next
# as the shape changes. A contact that stopped at a node would come free of the obstacle there, or
# be pressed into it by the sag of the element beside.


_END = 1e-12    # of an element: nearer to its end a point is the end
_LEAST = 1e-15  # the same: a step that is no step any more
_CLOSE = 1e-8   # of an element: a minimum that is less by no more is the same
_APART = 1e-6   # the same: two minima that are no farther apart are one
_ENTERED = 1e-6  # the same: where a point begins to roll that comes in through a node
_PARTS = 4       # of an element beside a mesh that is looked at before minima are sought
_LOOKS = 8       # along an element beside a mesh


@kernel
def closest_point(scene, contacts, c, lengths, strains, rotations, positions, normal, hessian):
    """Return gap, element and fraction of a point of Contacts: it rolls, or is fixed where it is.

    Fills normal (3,) and hessian (3, 3) of the distance there.
    """
    o, e, fraction = contacts.obstacle[c], contacts.element[c], contacts.fraction[c]
    if fraction <= 0.0:
        return follow_closest_point(scene, o, e, -fraction, lengths, strains, rotations, positions,
                                    normal, hessian)
    gap = gap_inside(scene, o, e, fraction, lengths, strains, rotations, positions, normal, hessian)
    return gap, e, fraction


@kernel
def gap_inside(scene, o, e, fraction, lengths, strains, rotations, positions, normal, hessian):
    """Return the gap of a point of element e; fill normal (3,) and hessian (3, 3) of it."""
    rotation, x, offset, point = np.empty((3, 3)), np.empty(3), np.zeros(2), np.empty(3)
    point_inside(lengths, strains, rotations, positions, e, fraction, rotation, x)
    radius = radius_at(scene, o, e, fraction)
    return gap_at(scene, o, rotation, x, radius, offset, point, normal, hessian)


@kernel
def follow_closest_point(scene, o, e, begin, lengths, strains, rotations, positions, normal,
                         hessian):
    """Return gap, element and fraction of the point that is nearest to obstacle o, from element e.

    Where the distance still falls at an end of the element, it is followed into the next ones, to
    its first minimum. `begin`: see `closest_point_in_element`. Fills normal (3,) and hessian (3, 3)
    of the distance there.
    """
    gap, fraction = closest_point_in_element(scene, o, e, begin, lengths, strains, rotations,
                                             positions, normal, hessian)
    if scene.feature[o] == NODE_FACE or 0.0 < fraction < 1.0:
        return gap, e, fraction
    step = -1 if fraction == 0.0 else 1
    first, last = node_range(scene, o, lengths.size)
    while first <= e + step < last and fraction == max(step, 0):
        if begin > 0.0:  # it is followed to the minimum that is next, wherever the least one is
            begin = _ENTERED if step > 0 else 1.0 - _ENTERED
        its_gap, its_fraction = closest_point_in_element(scene, o, e + step, begin, lengths,
                                                         strains, rotations, positions, normal,
                                                         hessian)
        if its_fraction == max(-step, 0):  # it rises again: the minimum is the node between
            break
        e, gap, fraction = e + step, its_gap, its_fraction
    return gap, e, fraction


@kernel
def closest_point_in_element(scene, o, e, begin, lengths, strains, rotations, positions, normal,
                             hessian):
    """Return gap and fraction of the point of element e that is nearest to obstacle o.

    Where the gap may have several minima, beside a hole or a mesh, it is the one next to the
    fraction `begin` of the element or, if that is 0, the least of all (of a mesh, of those looked
    at). Fills normal (3,) and hessian (3, 3) of the
    distance there.
    """
    start = begin if begin > 0.0 else 0.5
    if begin <= 0.0 and scene.kind[o] == MESH:
        start = _lowest_look(scene, o, e, 0.0, 1.0, lengths, strains, rotations, positions)
    gap, fraction = _minimum_from(scene, o, e, start, lengths, strains, rotations, positions,
                                  normal, hessian)
    if begin > 0.0 or scene.kind[o] != SHEET or scene.feature[o] == NODE_FACE:
        return gap, fraction
    close = _CLOSE * lengths[e]
    least, where, _ = least_gap(scene, o, e, 0.0, 1.0, gap, close, lengths, strains, rotations,
                                positions)
    if least < gap - close:
        gap, fraction = _minimum_from(scene, o, e, where, lengths, strains, rotations, positions,
                                      normal, hessian)
    return gap, fraction


@kernel
def minima_in_element(scene, o, e, lengths, strains, rotations, positions, gaps, fractions):
    """Fill gaps (2,), m, and fractions (2,) of the minima inside element e; return how many.

    Beside a hole of a sheet there may be one before and one behind the place where the element is
    nearest to the hole's axis: to both sides of it a straight line has no more than one. Minima at
    the ends of an element are not counted. Beside a mesh each half of the element is looked at;
    what is nearer together than half an element is one. Beside a convex body there is one if any:
    a second one would need an element that bends away from two edges, and that is less deep than it
    bends there.
    """
    normal, hessian = np.empty(3), np.empty((3, 3))
    count, middle, where, close = 0, 1.0, 0.5, _CLOSE * lengths[e]
    if scene.kind[o] == SHEET:
        middle = _nearest_to_axis(scene, o, e, positions)
    elif scene.kind[o] == MESH:
        middle = 0.5
    for part in range(2 if middle < 1.0 else 1):
        if scene.kind[o] == SHEET:
            low, high = (0.0, min(middle, 1.0)) if part == 0 else (middle, 1.0)
            _, where, _ = least_gap(scene, o, e, low, high, np.inf, close, lengths, strains,
                                    rotations, positions)
        elif scene.kind[o] == MESH:
            where = _lowest_look(scene, o, e, 0.5 * part, 0.5 * (part + 1), lengths, strains,
                                 rotations, positions)
            if part == 1 and where == 0.5:  # it falls on into the first half
                continue
        gap, fraction = _minimum_from(scene, o, e, where, lengths, strains, rotations, positions,
                                      normal, hessian)
        if 0.0 < fraction < 1.0 and (count == 0 or fraction - fractions[0] > _APART):
            gaps[count], fractions[count] = gap, fraction
            count += 1
    return count


@kernel
def _lowest_look(scene, o, e, low, high, lengths, strains, rotations, positions):
    """Return the fraction between two of element e with the least gap, of some that are looked at.

    Where the gap is large the next ones are left out: it changes by no more than the place does.
    """
    normal, hessian = np.empty(3), np.empty((3, 3))
    step, at, least, where = 1.0 / _LOOKS, low, np.inf, low
    size = lengths[e] * stretch(scene, o, strains[e])
    while True:
        gap = gap_inside(scene, o, e, at, lengths, strains, rotations, positions, normal, hessian)
        if gap < least:
            least, where = gap, at
        if at >= high:
            break
        at = min(at + max(step, (gap - least) / size), high)
    return where


@kernel
def clear_between(scene, o, e, first, second, lengths, strains, rotations, positions):
    """Whether element e is told not to touch body `o` between its nodes, whose gaps are given, m.

    No gap is less than half of what two of them exceed the way between them by.
    """
    normal, hessian = np.empty(3), np.empty((3, 3))
    way = lengths[e] * stretch(scene, o, strains[e]) + abs(taper(scene, o, e))
    if first + second >= way:
        return True
    last = first
    for part in range(1, _PARTS + 1):
        gap = second
        if part < _PARTS:
            gap = gap_inside(scene, o, e, part / _PARTS, lengths, strains, rotations, positions,
                             normal, hessian)
        if last + gap < way / _PARTS:
            return False
        last = gap
    return True


@kernel
def _nearest_to_axis(scene, o, e, positions):
    """Return the fraction of an element's chord that is nearest to the axis of a hole; 1: no such.

    Of several holes the one that its middle is nearest to.
    """
    way, away, nearest, fraction = np.empty(2), np.empty(2), np.inf, 1.0
    for hole in range(scene.hole_of.size):
        if scene.hole_of[hole] != o:
            continue
        size = along = square = 0.0
        for i in range(2):
            way[i] = away[i] = 0.0
            for j in range(3):
                way[i] += scene.axes[o, j, 1 + i] * (positions[e + 1, j] - positions[e, j])
                away[i] += scene.axes[o, j, 1 + i] * (scene.center[o, j] - scene.origin[j]
                                                      - positions[e, j])
            away[i] += scene.hole_center[hole, i]
            size += way[i] * way[i]
            along += way[i] * away[i]
            square += (away[i] - 0.5 * way[i]) ** 2
        if square < nearest and size > 0.0:
            nearest, fraction = square, along / size
    return fraction if fraction > 0.0 else 1.0


@kernel
def _minimum_from(scene, o, e, begin, lengths, strains, rotations, positions, normal, hessian):
    """Return gap and fraction of a minimum of the gap along element e, near the fraction `begin`.

    Fills normal (3,) and hessian (3, 3) of the distance there. A safeguarded Newton iteration for
    the zero of dg/ds; the nearest end of the element if there is none inside.
    """
    rotation, x = np.empty((3, 3)), np.empty(3)
    offset, point = np.zeros(2), np.empty(3)
    axial, grows = scene.feature[o] == AXIS, taper(scene, o, e) / lengths[e]
    low, high, fraction, last = 0.0, 1.0, begin, 1.0
    if scene.feature[o] == NODE_FACE:
        low = fraction = 1.0
    for iteration in range(60):
        point_inside(lengths, strains, rotations, positions, e, fraction, rotation, x)
        radius = radius_at(scene, o, e, fraction)
        if axial:
            for i in range(3):
                x[i] += scene.origin[i]
            gap = signed_distance(scene, o, x, normal, hessian) - radius
            slope, curve = along_the_dlo(normal, hessian, rotation, strains[e])
            slope -= grows
        else:
            gap = gap_at(scene, o, rotation, x, radius, offset, point, normal, hessian)
            slope, curve = slope_along(scene, o, rotation, strains[e], offset, normal, hessian)
        if slope > 0.0:
            high = fraction
        else:
            low = fraction
        if high - low < 1e-15:
            break
        step = -slope / (curve * lengths[e]) if curve > 0.0 else np.copysign(np.inf, -slope)
        if abs(step) < _LEAST or 0.5 * last <= abs(step) < _END:
            break  # rounding errors alone are left; to halve the bracket would lead away from here
        target = fraction + step
        if (iteration == 0 and not 0.0 < target < 1.0
                and scene.kind[o] != SHEET):  # its gap may fall and rise again before the end
            target = 0.0 if target <= 0.0 else 1.0  # look at the end itself
        elif not (low < target < high and abs(step) < 0.5 * last):
            # (where the curvature jumps, as at an obstacle's edge, Newton's steps go to and fro)
            target = 0.5 * (low + high)
        last = abs(target - fraction)
        fraction = target
    if fraction < _END or fraction > 1.0 - _END:
        fraction = 0.0 if fraction < _END else 1.0
    return gap, fraction


@kernel
def along_the_dlo(normal: Floats, hessian: Floats, rotation: Floats,
                  strain: Floats) -> tuple[float, float]:
    """Return dg/ds and d2g/ds2 of the gap along the DLO, where its frame is `rotation`."""
    slope = curve = 0.0
    for i in range(3):
        # t' = kappa_b n - kappa_n b
        change = strain[2] * rotation[i, 1] - strain[1] * rotation[i, 2]
        slope += normal[i] * rotation[i, 0]
        curve += normal[i] * change
        for j in range(3):
            curve += rotation[i, 0] * hessian[i, j] * rotation[j, 0]
    return slope, curve


# ------------------------------------------------------------------------------------------------
# How deep a DLO lies in obstacles.


@kernel
def penetration(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats,
                positions: Floats) -> float:
    """Return how deep in m the surface of a DLO lies in an obstacle, at most; 0 if it is clear.

    Args:
        strains: (N, 3), 1/m; rotations: (N + 1, 3, 3); positions: (N + 1, 3), m, relative to
            `scene.origin`
    """
    deepest = 0.0
    normal, hessian, offset, point = np.empty(3), np.empty((3, 3)), np.zeros(2), np.empty(3)
    for o in range(scene.kind.size):
        begin, end = node_range(scene, o, lengths.size)
        last = np.inf
        for k in range(begin, end + 1):
            gap = node_gap(scene, o, k, rotations, positions, offset, point, normal, hessian)
            if k > 0:
                deepest = max(deepest, -gap)
            e = k - 1
            # no point of an element is farther than half its length from one of its nodes
            if k > begin and scene.feature[o] != NODE_FACE and (
                    min(gap, last) - 0.5 * lengths[e] * stretch(scene, o, strains[e]) < -deepest):
                inside, _ = closest_point_in_element(scene, o, e, 0.0, lengths, strains, rotations,
                                                     positions, normal, hessian)
                deepest = max(deepest, -inside)
            last = gap
    return deepest


@kernel
def penetrations_of_points(scene: Scene, places: Floats) -> Floats:
    """Return (n,) how deep in m places (n, 3), world, lie in an obstacle, at most; 0 if in none."""
    deep = np.empty(places.shape[0])
    for k in range(deep.size):
        deep[k] = penetration_of_point(scene, places[k])
    return deep


@kernel
def penetration_of_point(scene: Scene, place: Floats) -> float:
    """Return how deep in m a place (3,), world, lies in an obstacle, at most; 0 if in none."""
    deepest = 0.0
    normal, hessian = np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        deepest = max(deepest, -signed_distance(scene, o, place, normal, hessian))
    return deepest
