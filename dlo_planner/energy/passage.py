"""Whether a DLO that moves from one shape to another passes through an obstacle on the way.

The motion between the two is taken as straight, point by point. Convex obstacles: an element is
safe if it moves less than it is away, or if all of it stays above a plane that lies between it and
the obstacle's middle. Sheets: nodes change sides, and elements pierce the middle plane, only
through a cut-out or around the border.
"""

import numpy as np

from dlo_planner.energy.contact import nearest_inside
from dlo_planner.energy.distance import BOX, PLANE, SHEET, in_plane, signed_distance
from dlo_planner.kernels import kernel
from dlo_planner.ritz.kinematics import point_inside

_FLUSH = 1e-9  # of the length: what is that near to a surface lies in it


@kernel
def passes_through(scene, lengths, strains, rotations, old, new):
    """Return whether the motion from `old` to `new` crosses an obstacle.

    Args:
        strains: (N, 3), rotations: (N + 1, 3, 3) of the old shape
        old, new: (N + 1, 3) node positions; relative to `scene.origin`
    """
    flush = _FLUSH * np.sum(lengths)
    farthest = 0.0
    for k in range(old.shape[0]):
        farthest = max(farthest, np.sqrt(np.sum((new[k] - old[k]) ** 2)))
    for o in range(scene.kind.size):
        if scene.kind[o] == SHEET:
            if _through_sheet(scene, o, flush, old, new):
                return True
        elif scene.kind[o] != PLANE and _through_solid(scene, o, flush, farthest, lengths,
                                                       strains, rotations, old, new):
            return True
    return False


@kernel
def _through_solid(scene, o, flush, farthest, lengths, strains, rotations, old, new):
    """Whether an element goes through a convex body; no node moves by more than `farthest`."""
    normal, bend = np.empty(3), np.empty((3, 3))
    rotation, x = np.empty((3, 3)), np.empty(3)
    inner = scene.size[o, 2]
    if scene.kind[o] == BOX:
        inner = np.min(scene.size[o])
    depth = 0.5 * (inner + scene.radius)  # this far in a point still knows its way out
    margin = farthest + 0.5 * np.max(lengths) - depth
    last_gap = last_move = clear = 0.0
    for k in range(lengths.size + 1):
        if k:
            clear -= lengths[k - 1]
        if clear > 0.0:  # nothing gets so far
            last_gap, last_move = clear + margin, farthest
            continue
        change = 0.0
        for i in range(3):
            change += (new[k, i] - old[k, i]) ** 2
            x[i] = scene.origin[i] + old[k, i]
        move = np.sqrt(change)
        here = signed_distance(scene, o, x, normal, bend) - scene.radius
        clear = here - margin
        near, moved = min(here, last_gap), max(move, last_move)
        last_gap, last_move = here, move
        if k == 0:
            continue
        e = k - 1
        # no point of an element is farther than half its length from one of its nodes
        if moved <= near - 0.5 * lengths[e] + depth:
            continue
        gap, fraction = nearest_inside(scene, o, e, lengths, strains, rotations, old, normal, bend)
        deep = max(gap + depth, flush)  # what is deeper inside may only come out
        if moved <= deep:
            continue
        point_inside(lengths, strains, rotations, old, e, fraction, rotation, x)
        for end in range(e, e + 2):
            above = 0.0
            for i in range(3):
                above += normal[i] * (new[end, i] - x[i])
            if above < -deep:
                return True
    return False


@kernel
def _through_sheet(scene, o, flush, old, new):
    p, q = np.empty(3), np.empty(3)
    before, after = np.empty(3), np.empty(3)
    last_before, last_after = np.empty(3), np.empty(3)
    for k in range(old.shape[0]):
        for i in range(3):
            p[i] = scene.origin[i] + old[k, i] - scene.centre[o, i]
            q[i] = scene.origin[i] + new[k, i] - scene.centre[o, i]
        for i in range(3):
            before[i] = after[i] = 0.0
            for j in range(3):
                before[i] += scene.axes[o, j, i] * p[j]
                after[i] += scene.axes[o, j, i] * q[j]
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
    """Whether the line from p to q has a point in the middle plane, be it an end of it."""
    return p[0] * q[0] < 0.0 or min(abs(p[0]), abs(q[0])) <= flush


@kernel
def _where(p, q, flush):
    """Return y and z where the line from p to q, which meets the middle plane, does so."""
    if abs(p[0]) <= flush:
        return p[1], p[2]
    if abs(q[0]) <= flush:
        return q[1], q[2]
    share = p[0] / (p[0] - q[0])
    return p[1] + share * (q[1] - p[1]), p[2] + share * (q[2] - p[2])


@kernel
def _open(scene, o, flush, p, q):
    """Whether the line from p to q meets the middle plane outside the material."""
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
