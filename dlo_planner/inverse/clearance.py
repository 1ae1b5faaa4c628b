"""How much room a DLO has in its cut-outs, and beside obstacles."""

import numpy as np
from numba import njit

from dlo_planner.energy.contact import nearest_inside
from dlo_planner.energy.distance import build_scene, in_plane, signed_distance
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.ritz.kinematics import point_inside

_WIDE = 100.0    # times the length: a sheet without an end
_FLUSH = 1e-9    # of the length: a node that near to a plane is in it
_HALVINGS = 50


def sheet_of(cutout, length, obstacles=()):
    """Return the Sheet around a CutOut: one of the obstacles, or one without thickness or end.

    None for a cut-out without a size.
    """
    if cutout.radius is None and cutout.width is None:
        return None
    for obstacle in obstacles:
        if isinstance(obstacle, Sheet) and cutout in obstacle.cutouts:
            return obstacle
    pose = Pose.from_rotation(cutout.pose.position, cutout.pose.rotation)
    return Sheet(pose, _WIDE * length, _WIDE * length, 0.0, (cutout,))


def clearance(obstacles, radius, shape):
    """Return the smallest distance in m between a DLO's surface and obstacles (< 0: inside).

    Args:
        obstacles: sequence of obstacles
        radius: of the DLO, m
        shape: Shape
    """
    scene = build_scene(obstacles, radius)
    return float(_smallest(scene, np.diff(shape.s), shape.element_strains, shape.frames,
                           shape.positions, np.zeros(3), np.inf)[3])


def room_in(sheet, normal, radius, shape):
    """Return the distances (3,) in m between a DLO's surface and a Sheet, by parts of the DLO.

    The first: of what is in the plate, to the rim; by as much the cut-out may be displaced in its
    plane. The others: of what is before the plate and behind it, to its faces and edges; they are
    the smaller ones where the DLO bends back to the sheet, or passes obliquely. Infinite for a
    part that does not exist, negative where the DLO would be in the material.

    Args:
        normal: (3,) from before the plate to behind it; radius: of the DLO, m
    """
    middle = sheet.pose.position
    scene = build_scene([sheet], radius)._replace(origin=middle)
    return _smallest(scene, np.diff(shape.s), shape.element_strains, shape.frames,
                     shape.positions - middle, np.asarray(normal, dtype=float),
                     0.5 * sheet.thickness)[:3]


@njit(cache=True)
def _smallest(scene, lengths, strains, rotations, positions, normal, half):
    """Return the smallest gaps (4,): in the plate, before it, behind it, of all.

    Args:
        positions: (N + 1, 3) from the scene's origin
        normal: (3,) of a plate there; half: of its thickness, m; infinite: there is no plate
    """
    x, slope, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    flush = _FLUSH * np.sum(lengths)
    out = np.full(4, np.inf)
    for o in range(scene.kind.size):
        last_gap = last_rate = 0.0
        part = 0
        for k in range(positions.shape[0]):
            height = rate = 0.0
            for i in range(3):
                x[i] = scene.origin[i] + positions[k, i]
                height += normal[i] * positions[k, i]
            gap = signed_distance(scene, o, x, slope, bend) - scene.radius
            for i in range(3):
                rate += slope[i] * rotations[k, i, 0]
            last_part = part
            part = 0 if abs(height) <= half + flush else (1 if height < 0 else 2)
            out[part] = min(out[part], gap)
            if k and last_rate < 0.0 < rate and min(gap, last_gap) - lengths[k - 1] < out[part]:
                inside, _ = nearest_inside(scene, o, k - 1, lengths, strains, rotations,
                                           positions, slope, bend)
                out[part] = min(out[part], inside)
                out[last_part] = min(out[last_part], inside)
            last_gap, last_rate = gap, rate
        if half < np.inf:
            gap, height = _at_the_rim(scene, o, lengths, strains, rotations, positions, normal,
                                      flush)
            out[0] = min(out[0], gap)
            for part, face in ((1, -half), (2, half)):
                # where it leaves the plate belongs to what is outside as well, if anything is
                if abs(height - face) <= flush and out[part] < np.inf:
                    out[part] = min(out[part], gap)
    out[3] = np.min(out[:3])
    return out


@njit(cache=True)
def _at_the_rim(scene, o, lengths, strains, rotations, positions, normal, flush):
    """Return the smallest gap where the DLO meets the foil `o`, and that plane's height in m.

    It meets the plane where it passes from one side to the other, and with each node that is
    nearer to it than `flush` in m: which side of zero the height of an end in the plane falls on
    does not count.
    """
    smallest = np.inf
    frame, x = np.empty((3, 3)), np.empty(3)
    shift = 0.0
    for i in range(3):
        shift += normal[i] * (scene.centre[o, i] - scene.origin[i])
    last = 0.0
    for k in range(positions.shape[0]):
        height = -shift
        for i in range(3):
            x[i] = positions[k, i]
            height += normal[i] * x[i]
        if abs(height) <= flush:
            height = 0.0
        elif last * height < 0.0:
            _passage(lengths, strains, rotations, positions, k - 1, normal, shift, last, frame, x)
        if height == 0.0 or last * height < 0.0:
            smallest = min(smallest, _room_in_plane(scene, o, x))
        last = height
    return smallest, shift


@njit(cache=True)
def _passage(lengths, strains, rotations, positions, e, normal, shift, below, frame, x):
    """Fill x (3,) with the point where element e, which begins at `below`, passes the plane."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        point_inside(lengths, strains, rotations, positions, e, middle, frame, x)
        height = -shift
        for i in range(3):
            height += normal[i] * x[i]
        if height * below > 0.0:
            low = middle
        else:
            high = middle


@njit(cache=True)
def _room_in_plane(scene, o, x):
    """Return the gap in m of x (3,), from the scene's origin, to the material in its own plane."""
    y = z = 0.0
    for i in range(3):
        away = x[i] + scene.origin[i] - scene.centre[o, i]
        y += scene.axes[o, i, 1] * away
        z += scene.axes[o, i, 2] * away
    gap, _ = in_plane(scene, o, y, z, np.empty(2))
    return gap - scene.radius


def nearest(scene, shape):
    """Return [(gap in m, arc length in m, unit normal (3,))] of the DLO's nearest points.

    Args:
        scene: of `energy.distance.build_scene`, one entry per body; shape: Shape
    """
    lengths = np.diff(shape.s)
    return [_nearest(scene, o, shape.s, lengths, shape.element_strains, shape.frames,
                     shape.positions) for o in range(scene.kind.size)]


@njit(cache=True)
def _nearest(scene, o, s, lengths, strains, rotations, positions):
    x, slope, bend, normal = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(3)
    smallest, where, last_rate = np.inf, 0.0, 0.0
    for k in range(positions.shape[0]):
        rate = 0.0
        for i in range(3):
            x[i] = scene.origin[i] + positions[k, i]
        gap = signed_distance(scene, o, x, slope, bend) - scene.radius
        for i in range(3):
            rate += slope[i] * rotations[k, i, 0]
        if gap < smallest:
            smallest, where = gap, s[k]
            normal[:] = slope
        if k and last_rate < 0.0 < rate:
            gap, fraction = nearest_inside(scene, o, k - 1, lengths, strains, rotations, positions,
                                           slope, bend)
            if gap < smallest:
                smallest, where = gap, s[k - 1] + fraction * lengths[k - 1]
                normal[:] = slope
        last_rate = rate
    return smallest, where, normal
