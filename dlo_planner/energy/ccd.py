# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a DLO that moves from one shape to another passes through an obstacle on the way.

The motion between the two is taken as straight, point by point. Convex obstacles: an element is
safe if it moves less than it is away, or if all of it stays above a plane that lies between it and
the obstacle's middle. Meshes: an element may go as far as it is away, and again from there; into
one by no more than a point behind the triangle that it meets still knows its way out. Sheets:
nodes change sides of a face, and elements pierce it, only through a cut-out or around the border.
Of a rectangular DLO all that holds for its edges; for the solid between them, where a round bar or
an edge could pass, the plane has to be below all four.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.gap import (
    closest_point_in_element,
    gap_at,
    node_gap,
    node_range,
    radius_at_node,
    stretch,
)
from dlo_planner.energy.scene import (
    AXIS,
    FACE,
    MESH,
    NODE_FACE,
    PLANE,
    SHEET,
    Scene,
    in_its_frame,
    in_plane,
)
from dlo_planner.geometry.bvh import line_to_surface, nearest_on_surface
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.geometry.smooth_distance import smooth_distance
from dlo_planner.geometry.so3 import matrix, rotation_vector, transposed_times
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats

_FLUSH = 1e-9  # of the length: what is that near to a surface lies in it
_SAG = 0.1     # of the radius: beside a mesh a piece bends by no more
_PIECES = 16   # of an element there, at most
_NEXT = 0.05   # of the radius: an axis that near to a triangle has met it
_LEAPS = 200   # of a piece: what slides along for so long is not told to be free


@kernel
def sweeps_through(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats, old: Floats,
                   turned: Floats, new: Floats) -> bool:
    """Return whether the motion from `old` to `new` crosses an obstacle.

    Args:
        strains: (N, 3), rotations: (N + 1, 3, 3) of the old shape; turned: (N + 1, 3, 3) of the new
        old, new: (N + 1, 3) node positions; relative to `scene.origin`
    """
    flush = _FLUSH * np.sum(lengths)
    farthest = 0.0
    for k in range(old.shape[0]):
        farthest = max(farthest, np.sqrt(np.sum((new[k] - old[k]) ** 2)))
    for o in range(scene.kind.size):
        if scene.kind[o] == SHEET:
            if _through_sheet(scene, o, flush, _line(scene, o, rotations, old),
                              _line(scene, o, turned, new)):
                return True
        elif scene.kind[o] == MESH:
            if _through_mesh(scene, o, farthest, lengths, strains, rotations, old, turned, new):
                return True
        elif scene.kind[o] != PLANE and scene.feature[o] != NODE_FACE and _through_solid(
                scene, o, flush, farthest, lengths, strains, rotations, old, turned, new):
            return True
    return False


@kernel
def _line(scene, o, rotations, positions):
    """Return (n, 3) the places of the DLO's feature for body `o` at its nodes."""
    if scene.feature[o] == AXIS:
        return positions
    begin, end = node_range(scene, o, positions.shape[0] - 1)
    line = np.empty((end - begin + 1, 3))
    for k in range(begin, end + 1):
        for i in range(3):
            line[k - begin, i] = (positions[k, i] + rotations[k, i, 1] * scene.offset[o, 0]
                          + rotations[k, i, 2] * scene.offset[o, 1])
    return line


@kernel
def _corners(scene, o, rotation, position, corners):
    """Fill corners (4, 3) with what a section may touch body `o` with; return how many there are.

    A face's section is the hull of four points; else it is one point.
    """
    count = 4 if scene.feature[o] == FACE else 1
    for c in range(count):
        n, b = scene.offset[o, 0], scene.offset[o, 1]
        if c % 2:
            n = -n
        if c > 1:
            b = -b
        for i in range(3):
            corners[c, i] = position[i] + rotation[i, 1] * n + rotation[i, 2] * b
    return count


@kernel
def _move(scene, o, k, rotations, old, turned, new, before, after):
    """Return how far (m) the section at node k moves at most; `before`, `after`: (4, 3) scratch."""
    largest = 0.0
    if scene.feature[o] == AXIS:
        for i in range(3):
            largest += (new[k, i] - old[k, i]) ** 2
        return np.sqrt(largest)
    count = _corners(scene, o, rotations[k], old[k], before)
    _corners(scene, o, turned[k], new[k], after)
    for c in range(count):
        change = 0.0
        for i in range(3):
            change += (after[c, i] - before[c, i]) ** 2
        largest = max(largest, np.sqrt(change))
    return largest


@kernel
def _through_solid(scene, o, flush, farthest, lengths, strains, rotations, old, turned, new):
    """Whether an element goes through a convex body; no node moves by more than `farthest`."""
    normal, hessian, x = np.empty(3), np.empty((3, 3)), np.empty(3)
    rotation, offset, point = np.empty((3, 3)), np.zeros(2), np.empty(3)
    before, after = np.empty((4, 3)), np.empty((4, 3))
    simple = scene.feature[o] == AXIS and scene.radii.shape[0] == 0
    margin = farthest + 0.5 * np.max(lengths)
    last_gap = last_move = last_radius = clear = 0.0
    begin, last = node_range(scene, o, lengths.size)
    for k in range(begin, last + 1):
        if k > begin:
            clear -= lengths[k - 1]
        if simple and clear > 0.0:  # nothing gets so far
            last_gap, last_move, last_radius = clear + margin, farthest, scene.radius
            continue
        radius = radius_at_node(scene, o, k)
        move = _move(scene, o, k, rotations, old, turned, new, before, after)
        gap_here = node_gap(scene, o, k, rotations, old, offset, point, normal, hessian)
        clear = gap_here - margin
        near, moved, thick = min(gap_here, last_gap), max(move, last_move), max(radius, last_radius)
        last_gap, last_move, last_radius = gap_here, move, radius
        if k == begin:
            continue
        e = k - 1
        # this far in a point still knows its way out
        depth = 0.5 * (scene.inner[o] + min(thick, radius))
        # no point of an element is farther than half its length from one of its nodes
        if moved <= near - 0.5 * lengths[e] * stretch(scene, o, strains[e]) + depth:
            continue
        gap, fraction = closest_point_in_element(scene, o, e, 0.0, lengths, strains, rotations,
                                                 old, normal, hessian)
        deep = max(gap + depth, flush)  # what is deeper inside may only come out
        if moved <= deep:
            continue
        point_inside(lengths, strains, rotations, old, e, fraction, rotation, x)
        gap_at(scene, o, rotation, x, 0.0, offset, point, normal, hessian)
        for end in range(e, e + 2):
            for c in range(_corners(scene, o, turned[end], new[end], after)):
                above = 0.0
                for i in range(3):
                    above += normal[i] * (scene.origin[i] + after[c, i] - point[i])
                if above < -deep:
                    return True
    return False


@kernel
def _through_mesh(scene, o, farthest, lengths, strains, rotations, old, turned, new):
    """Whether an element goes through a mesh; no node's axis moves by more than `farthest`."""
    normal, hessian, offset, point = np.empty(3), np.empty((3, 3)), np.zeros(2), np.empty(3)
    before, after, bend = np.empty((4, 3)), np.empty((4, 3)), np.empty((lengths.size, 3))
    for e in range(lengths.size):
        turn = rotation_vector(transposed_times(matrix(turned[e]), matrix(turned[e + 1])))
        for i in range(3):
            bend[e, i] = turn[i] / lengths[e]
    simple = scene.feature[o] == AXIS and scene.radii.shape[0] == 0
    clear = last_away = last_move = last_radius = 0.0
    begin, last = node_range(scene, o, lengths.size)
    for k in range(begin, last + 1):
        if k > begin:
            clear -= lengths[k - 1]
        if simple and clear > 0.0:  # nothing gets so far
            last_away, last_move, last_radius = np.inf, farthest, scene.radius
            continue
        radius = radius_at_node(scene, o, k)
        move = _move(scene, o, k, rotations, old, turned, new, before, after)
        # a smooth distance is never more than the exact one
        away = gap_at(scene, o, rotations[k], old[k], 0.0, offset, point, normal, hessian)
        clear = away - farthest - np.max(lengths)
        e, near, moved = k - 1, min(away, last_away), max(move, last_move)
        thick, last_away, last_move, last_radius = max(radius, last_radius), away, move, radius
        # no point of an element is farther than half its length from one of its nodes
        if k > begin and moved > near - 0.5 * lengths[e] * stretch(scene, o, strains[e]) and (
                _element_enters(scene, o, e, thick, lengths, strains, rotations, old, bend, turned,
                                new)):
            return True
    return False


@kernel
def _element_enters(scene, o, e, radius, lengths, strains, rotations, old, bend, turned, new):
    """Whether element e goes through a mesh; bend: (N, 3) strains of the new shape.

    It is looked at in pieces, so short that each is nearly straight.
    """
    most = 0.0
    for i in range(1, 3):
        most += max(strains[e, i] ** 2, bend[e, i] ** 2)
    sag = 0.125 * np.sqrt(most) * lengths[e] ** 2 * stretch(scene, o, strains[e])
    pieces = min(1 + int(np.sqrt(sag / (_SAG * radius))), _PIECES) if radius > 0.0 else _PIECES
    sag /= pieces**2
    ends = np.empty((2, 2, 3))  # of a piece, before and after, in the frame of the body
    for piece in range(pieces + 1):
        ends[0] = ends[1]
        _place_in_frame(scene, o, lengths, strains, rotations, old, e, piece / pieces, ends[1, 0])
        _place_in_frame(scene, o, lengths, bend, turned, new, e, piece / pieces, ends[1, 1])
        if piece and _piece_enters(scene, o, ends, sag, radius):
            return True
    return False


@kernel
def _place_in_frame(scene, o, lengths, strains, rotations, positions, e, fraction, place):
    """Fill place (3,) with a point of element e, in the frame of body `o`."""
    rotation, x = np.empty((3, 3)), np.empty(3)
    point_inside(lengths, strains, rotations, positions, e, fraction, rotation, x)
    for i in range(3):
        x[i] += scene.origin[i]
        if scene.feature[o] != AXIS:
            x[i] += rotation[i, 1] * scene.offset[o, 0] + rotation[i, 2] * scene.offset[o, 1]
    in_its_frame(scene, o, x, place)


@kernel
def _piece_enters(scene, o, ends, sag, radius):
    """Whether a piece that is straight to within `sag` goes through a mesh.

    Its axis goes on as far as it is away. Where it meets a triangle it may go deeper by a quarter
    of how thick the solid is there, and half the DLO's radius; what is deep already may come out.

    Args:
        ends: (2, 2, 3) both ends, each before and after
    """
    trees, root = scene.trees, scene.root[o]
    p, q, middle, move = np.empty(3), np.empty(3), np.empty(3), 0.0
    normal, hessian = np.empty(3), np.empty((3, 3))
    for end in range(2):
        square = 0.0
        for i in range(3):
            square += (ends[end, 1, i] - ends[end, 0, i]) ** 2
        move = max(move, np.sqrt(square))
    if move == 0.0:
        return False
    gone = 0.0
    for _ in range(_LEAPS):
        for i in range(3):
            p[i] = ends[0, 0, i] + gone / move * (ends[0, 1, i] - ends[0, 0, i])
            q[i] = ends[1, 0, i] + gone / move * (ends[1, 1, i] - ends[1, 0, i])
        if scene.smooth[o] >= 0:  # which is never more than the exact one, and costs less
            length = 0.0
            for i in range(3):
                length += (q[i] - p[i]) ** 2
                middle[i] = 0.5 * (p[i] + q[i])
            about = smooth_distance(trees, root, scene.grids, scene.smooth[o], middle, normal,
                                    hessian)
            about -= 0.5 * np.sqrt(length) + sag
            if radius < about < np.inf:
                gone += about
                if gone >= move:
                    return False
                continue
        away, met = line_to_surface(trees, root, p, q, move - gone + 2.0 * sag)
        if met < 0:
            return False
        if away - sag <= _NEXT * radius:
            deep = 0.5 * (trees.inner[met] + radius)
            return move - gone > deep and not _comes_out(trees, root, ends)
        gone += away - sag
        if gone >= move:
            return False
    return True


@kernel
def _comes_out(trees, root, ends):
    """Whether both ends of a piece are in a surface, and less deep after a motion."""
    place = np.empty(3)
    for end in range(2):
        depths = np.empty(2)
        for k in range(2):
            t, feature, square = nearest_on_surface(trees, root, ends[end, k], np.inf, place)
            out = 0.0
            for i in range(3):
                out += (ends[end, k, i] - place[i]) * trees.normal[t, feature, i]
            depths[k] = np.sqrt(square) if out < 0.0 else -np.sqrt(square)
        if depths[0] <= 0.0 or depths[1] >= depths[0]:
            return False
    return True


@kernel
def _through_sheet(scene, o, flush, old, new):
    p, q = np.empty(3), np.empty(3)
    before, after = np.empty(3), np.empty(3)
    last_before, last_after = np.empty(3), np.empty(3)
    for k in range(old.shape[0]):
        for i in range(3):
            p[i] = scene.origin[i] + old[k, i] - scene.center[o, i]
            q[i] = scene.origin[i] + new[k, i] - scene.center[o, i]
        for i in range(3):
            before[i] = after[i] = 0.0
            for j in range(3):
                before[i] += scene.axes[o, j, i] * p[j]
                after[i] += scene.axes[o, j, i] * q[j]
        before[0] -= scene.size[o, 0]  # from the face of a layer
        after[0] -= scene.size[o, 0]
        # what is in the material already may come out
        if (abs(before[0]) > flush and _meets(before, after, flush)
                and not _open(scene, o, flush, before, after)):
            return True
        if k and _meets(last_after, after, flush):
            was = _meets(last_before, before, flush)
            was_in = was and not _open(scene, o, flush, last_before, before)
            if not was_in and not _open(scene, o, flush, last_after, after):
                return True
            if was and not _same_opening(scene, o, flush, last_before, before, last_after,
                                         after):
                return True
        last_before[:] = before
        last_after[:] = after
    return False


@kernel
def _meets(p, q, flush):
    """Whether the line from p to q has a point in the face's plane, be it an end of it."""
    return p[0] * q[0] < 0.0 or min(abs(p[0]), abs(q[0])) <= flush


@kernel
def _where(p, q, flush):
    """Return y and z where the line from p to q, which meets the face's plane, does so."""
    if abs(p[0]) <= flush:
        return p[1], p[2]
    if abs(q[0]) <= flush:
        return q[1], q[2]
    share = p[0] / (p[0] - q[0])
    return p[1] + share * (q[1] - p[1]), p[2] + share * (q[2] - p[2])


@kernel
def _open(scene, o, flush, p, q):
    """Whether the line from p to q meets the face's plane outside the material."""
    y, z = _where(p, q, flush)
    away, _ = in_plane(scene, o, y, z, np.empty(2))
    return away > 0.0


@kernel
def _same_opening(scene, o, flush, p, q, r, s):
    """Whether the ways from p to q and from r to s, both open, use the same opening."""
    y0, z0 = _where(p, q, flush)
    y1, z1 = _where(r, s, flush)
    slope = np.empty(2)
    started_open, _ = in_plane(scene, o, y0, z0, slope)
    if started_open <= 0.0:
        return True
    for k in range(1, 8):
        away, _ = in_plane(scene, o, y0 + k / 8 * (y1 - y0), z0 + k / 8 * (z1 - z0), slope)
        if away <= 0.0:
            return False
    return True
