# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO on its way through several cut-outs should be like: near all of their centers.

The squares of the misses, each with its weight, add up to what is minimized. A shape that goes on
beyond its free end does so straight.
"""

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.geometry.kinematics import nearest_place, point_inside
from dlo_planner.geometry.record import Record
from dlo_planner.geometry.so3 import inner, matrix, put_vector, rotation_vector, times_transposed
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


class Aims(Record):
    """Where the DLO should be, and how the gripper should not turn.

    Attributes
    ----------
    s : float
        Arc length that should be at the first center, m.
    centers, weights : ndarray, shapes (k, 3) and (k,)
        Centers, m; the others are passed anywhere beyond `s`. Weights in 1/m; 0: it does not count.
    normal, along : ndarray, shape (3,), and float
        Direction that the tangent at `s` should have, and its weight, 1/rad.
    before, still : ndarray, shape (3, 3), and float
        Rotation of the gripper since which it should not turn about its own axis, and the weight of
        that, 1/rad.
    """

    s: float
    centers: Floats
    weights: Floats
    normal: Floats
    along: float
    before: Floats
    still: float


@kernel
def fill_misses(aims: Aims, nodes: Floats, lengths: Floats, strains: Floats, rotations: Floats,
                positions: Floats, base: Floats, misses: Floats, where: Floats,
                places: Floats) -> None:
    """Fill by how much a shape misses Aims, times the weights.

    Parameters
    ----------
    nodes : ndarray, shape (N + 1,)
        Arc lengths of the nodes, m, read-only.
    lengths, strains, rotations, positions : ndarray
        Shapes (N,), (N, 3), (N + 1, 3, 3), (N + 1, 3) world: the shape.
    base : ndarray, shape (3, 3)
        Rotation of the gripper.
    misses : ndarray, shape (3 k + 4,)
        Filled: of the first center, of the direction, of the other centers, of the turn.
    where, places : ndarray, shapes (k,) and (k, 3, 3)
        Filled: arc lengths of the passages, m (beyond L where the DLO ends before), and there what
        `nearest_place` fills.
    """
    frame, turn = np.empty((3, 3)), np.empty(3)
    element, fraction = inside(nodes, lengths, aims.s)
    point_inside(lengths, strains, rotations, positions, element, fraction, frame, turn)
    where[0] = aims.s
    for i in range(3):
        places[0, 0, i] = turn[i] - aims.centers[0, i]
        places[0, 1, i] = frame[i, 0]
        places[0, 2, i] = 0.0
        misses[i] = aims.weights[0] * places[0, 0, i]
        misses[3 + i] = aims.along * (frame[i, 0] - aims.normal[i])
    for k in range(1, aims.weights.size):
        where[k] = aims.s
        for i in range(3):
            misses[3 + 3 * k + i] = 0.0
        if aims.weights[k] > 0.0:
            where[k] = nearest_place(nodes, lengths, strains, rotations, positions,
                                     aims.centers[k], aims.s, places[k])
            for i in range(3):
                misses[3 + 3 * k + i] = aims.weights[k] * places[k, 0, i]
    put_vector(rotation_vector(times_transposed(matrix(base), matrix(aims.before))), turn)
    misses[misses.size - 1] = aims.still * inner(turn, aims.before[:, 0])


@kernel
def fill_slopes(aims: Aims, length: float, where: Floats, places: Floats, twists: Floats,
                rows: Floats) -> None:
    """Fill the derivatives of `fill_misses` by rotation (rad) and displacement (m) of the gripper.

    Parameters
    ----------
    length : float
        Of the DLO, m.
    where, places : ndarray
        As `fill_misses` fills them.
    twists : ndarray, shape (k, 6, 6)
        Rotation and displacement of the frames there (at the end of the DLO for those beyond) by
        those of the gripper.
    rows : ndarray, shape (3 k + 4, 6)
        Filled; the last one to first order about the rotation before.
    """
    turned = np.empty((3, 6))
    rows[:] = 0.0
    for k in range(aims.weights.size):
        if not aims.weights[k] > 0.0:
            continue
        off, tangent, change = places[k, 0], places[k, 1], places[k, 2]
        _fill_turned(tangent, twists[k], turned)
        beyond = max(where[k] - length, 0.0)
        slides = k > 0 and where[k] > aims.s  # the nearest arc length changes, too
        row = 3 + 3 * k if k > 0 else 0
        for j in range(6):
            along = 0.0
            if slides:
                for i in range(3):
                    along += (tangent[i] * (twists[k, 3 + i, j] + beyond * turned[i, j])
                              + off[i] * turned[i, j])
                along /= 1.0 + inner(off, change)
            for i in range(3):
                moved = twists[k, 3 + i, j] + beyond * turned[i, j] - along * tangent[i]
                rows[row + i, j] = aims.weights[k] * moved
                if k == 0:
                    rows[3 + i, j] = aims.along * turned[i, j]
    for i in range(3):
        rows[rows.shape[0] - 1, i] = aims.still * aims.before[i, 0]


@kernel
def inside(nodes: Floats, lengths: Floats, s: float) -> tuple[int, float]:
    """Return the element in which an arc length (m) is, and the fraction of it."""
    element = min(int(np.searchsorted(nodes, s, side='right')) - 1, lengths.size - 1)
    return element, (s - nodes[element]) / lengths[element]


@kernel
def _fill_turned(tangent: Floats, twist: Floats, turned: Floats) -> None:
    """Fill the change (3, 6) of a tangent (3,) by the gripper's twist, of its frame's (6, 6)."""
    for j in range(6):
        turned[0, j] = twist[1, j] * tangent[2] - twist[2, j] * tangent[1]
        turned[1, j] = twist[2, j] * tangent[0] - twist[0, j] * tangent[2]
        turned[2, j] = twist[0, j] * tangent[1] - twist[1, j] * tangent[0]


class Aimed:
    """Aims as a penalty of shapes, see `inverse.penalties`."""

    def __init__(self, aims: Aims) -> None:
        self._aims = aims

    def residuals(self, shape: Shape) -> Floats:
        """Return (3 k + 4,)."""
        return self._missed(shape)[0]

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        """Return (3 k + 4, 6)."""
        misses, where, places = self._missed(shape)
        length, rows = float(shape.s[-1]), np.empty((misses.size, 6))
        twists = np.array([sensitivity.at(s) for s in np.minimum(where, length)])
        fill_slopes(self._aims, length, where, places, twists, rows)
        return rows

    def _missed(self, shape: Shape) -> tuple[Floats, Floats, Floats]:
        """Return what `fill_misses` fills."""
        count = self._aims.weights.size
        filled = np.empty(3 * count + 4), np.empty(count), np.empty((count, 3, 3))
        fill_misses(self._aims, shape.s, *shape.for_kernels, np.array(shape.gripper.rotation),
                    *filled)
        return filled
