# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the outside of a DLO comes nearest to an obstacle: balls about its axis, or its section.

A rectangular section is the convex hull of four points, so that its four edges, lines along the DLO
at an offset c from the axis, touch whatever is flat or wide. Between them a face may be nearest to
an obstacle that is curved or has an edge: there the offset is the one that makes the distance
smallest, and slides. With w = e1 + u x c (material axes, u the strains) the touching point moves
along the DLO by R w per arc length, and R w changes by R (u x w).
"""

import numpy as np

from dlo_planner.energy.distance import signed_distance
from dlo_planner.energy.scene import AXIS, EDGE, FACE, NODE_FACE
from dlo_planner.kernels import kernel

_ROUNDS = 60
_FREE = 1.0 - 1e-9  # of the half size: an offset beyond is at the section's edge


@kernel
def is_face(scene, o):
    """Return whether body `o` is for a face, which is watched at chosen points only."""
    return scene.feature[o] >= FACE


@kernel
def nodes_of(scene, o, n):
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
    """Return the gap in m between body `o` and the DLO's section with this frame and place.

    Args:
        position: (3,) of the axis, from the scene's origin, m
        radius: m, about the feature there
        offset: (2,) filled: of the touching feature from the axis, along n and b, m
        point: (3,) filled: its place in the world, m
        normal: (3,), bend: (3, 3) filled: derivatives of the distance there
    """
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
    """Return how many coordinates of a touching point are free to slide: across first, then along.

    Args:
        free_along: whether the point slides along the DLO
        moves: (3, 3) filled: row i is the point's motion by coordinate i
        curves: (3, 3) filled: second derivatives of the gap by them
    """
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
