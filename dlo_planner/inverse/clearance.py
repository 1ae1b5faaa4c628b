"""How much room a DLO has in a cut-out, and its gripper before it."""

import numpy as np
from numba import njit

from dlo_planner.energy.contact import nearest_inside
from dlo_planner.energy.distance import build_scene, signed_distance
from dlo_planner.model.obstacles import Sheet
from dlo_planner.model.pose import Pose

_WIDE = 100.0  # times the length: a sheet without an end


def sheet_of(cutout, length):
    """Return a Sheet without thickness or end around a CutOut that has a size; else None."""
    if cutout.radius is None and cutout.width is None:
        return None
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
                           shape.positions))


@njit(cache=True)
def _smallest(scene, lengths, strains, rotations, positions):
    x, normal, bend = np.empty(3), np.empty(3), np.empty((3, 3))
    smallest = np.inf
    for o in range(scene.kind.size):
        last_gap = last_slope = 0.0
        for k in range(positions.shape[0]):
            for i in range(3):
                x[i] = scene.origin[i] + positions[k, i]
            gap = signed_distance(scene, o, x, normal, bend) - scene.radius
            slope = 0.0
            for i in range(3):
                slope += normal[i] * rotations[k, i, 0]
            smallest = min(smallest, gap)
            if k and last_slope < 0.0 < slope and min(gap, last_gap) - lengths[k - 1] < smallest:
                inside, _ = nearest_inside(scene, o, k - 1, lengths, strains, rotations,
                                           positions, normal, bend)
                smallest = min(smallest, inside)
            last_gap, last_slope = gap, slope
    return smallest
