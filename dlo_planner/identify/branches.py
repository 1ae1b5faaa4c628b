# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""From which shapes the search for a DLO that is held at both ends begins, by what was seen of it.

Such a DLO has several equilibria in the same grips: bent up or down, over one side or the other,
with turns of one end. What is set down in its grips comes to one of them. Its points tell which one
is meant: a curve through them, with the twist that the grips leave, is near it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline, CubicSpline
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.energy.potential import configuration_at
from dlo_planner.identify.observation import Observation
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose

_BINS = 8        # of the length: points in one are one, so that their noise bends the curve little
_BESIDE = 0.02   # of the length: points so near to a grip, whose place is known, do not count
_TURNS = (0, 1, -1)  # of the far end about its tangent, more than is needed to come into its grip
_TURNED = ('clamped', 'sleeve')  # grips in which the DLO does not turn about its tangent
_ALONG = np.array([1.0, 0.0, 0.0])


def seen_starts(direct: DirectSimulator, one: Observation, gripper: Pose,
                far_end: FarEnd) -> Iterator[Shape]:
    """Yield Shapes, in no equilibrium, that go through the points of an Observation."""
    s = np.array(direct.mesh.s)
    tangents = _tangents(s, one, gripper, far_end)
    frames = _carried(tangents, gripper.rotation)
    angle = 0.0
    if far_end.grip in _TURNED:  # how far the end is then from how it is held
        end = _least_turn(frames[-1, :, 0], far_end.pose.direction) @ frames[-1]
        axis = end.T @ far_end.pose.rotation
        angle = float(np.arctan2(axis[2, 1] - axis[1, 2], axis[1, 1] + axis[2, 2]))
    for turns in _TURNS if far_end.grip in _TURNED else _TURNS[:1]:
        twisted = frames @ Rotation.from_rotvec(np.outer(
            (angle + 2 * np.pi * turns) * s / s[-1], _ALONG)).as_matrix()
        yield _shape(direct, gripper, _strains(s, twisted), far_end)


def _tangents(s: Floats, one: Observation, gripper: Pose, far_end: FarEnd) -> Floats:
    """Return unit vectors (N + 1, 3) along a curve through grips and points, at s (N + 1,)."""
    ends = gripper.position, far_end.pose.position
    points = np.array(one.points)
    at = _arc_lengths(points, *ends, s[-1]) if one.s is None else np.array(one.s)
    if one.normal is not None:  # what is not measured is taken as straight between the grips
        straight = ends[0] + np.outer(at / s[-1], ends[1] - ends[0])
        points = points + np.outer((straight - points) @ one.normal, one.normal)
    inside = (at > _BESIDE * s[-1]) & (at < (1 - _BESIDE) * s[-1])
    bins = np.floor(_BINS * at / s[-1])
    groups = [inside & (bins == k) for k in np.unique(bins[inside])]
    knots = np.array([0.0, *(at[group].mean() for group in groups), s[-1]])
    places = np.array([ends[0], *(points[group].mean(axis=0) for group in groups), ends[1]])
    last = (2, np.zeros(3)) if far_end.grip == 'pinned' else (1, far_end.pose.direction)
    curve: BSpline = CubicSpline(knots, places, bc_type=((1, gripper.direction), last))
    out = curve(s, 1)
    size = np.linalg.norm(out, axis=1, keepdims=True)
    tangents: Floats = np.where(size > 0, out / np.where(size > 0, size, 1.0), gripper.direction)
    return tangents


def _arc_lengths(points: Floats, begin: Floats, end: Floats, length: float) -> Floats:
    """Return arc lengths (m,), m, of points without: along the way from one to the nearest left."""
    left, here, gone = list(range(len(points))), begin, 0.0
    out = np.zeros(len(points))
    while left:
        away = np.linalg.norm(points[left] - here, axis=1)
        k = left.pop(int(np.argmin(away)))
        gone += float(away.min())
        out[k], here = gone, points[k]
    whole: float = gone + float(np.linalg.norm(end - here))
    return out * (length / whole) if whole > 0 else out


def _carried(tangents: Floats, rotation: Floats) -> Floats:
    """Return frames (N + 1, 3, 3) with these tangents, each turned as little as it can be."""
    frames = [_least_turn(rotation[:, 0], tangents[0]) @ rotation]
    for before, after in zip(tangents[:-1], tangents[1:], strict=True):
        frames.append(_least_turn(before, after) @ frames[-1])
    return np.array(frames)


def _least_turn(one: Floats, other: Floats) -> Floats:
    """Return the rotation (3, 3) about their common normal that takes a unit vector to another."""
    axis = np.cross(one, other)
    sine = float(np.linalg.norm(axis))
    if sine == 0:  # the same, or opposite: about which normal is then all the same
        return np.eye(3) if one @ other > 0 else np.array(Rotation.from_rotvec(
            np.pi * np.linalg.svd(one[None])[2][1]).as_matrix())
    turn: Floats = Rotation.from_rotvec(axis / sine * np.arctan2(sine, one @ other)).as_matrix()
    return turn


def _strains(s: Floats, frames: Floats) -> Floats:
    """Return the strains (N, 3) that turn each frame into the next, 1/m."""
    turns = np.swapaxes(frames[:-1], 1, 2) @ frames[1:]
    strains: Floats = Rotation.from_matrix(turns).as_rotvec() / np.diff(s)[:, None]
    return strains


def _shape(direct: DirectSimulator, gripper: Pose, strains: Floats, far_end: FarEnd) -> Shape:
    """Return a Shape, which is in no equilibrium, of strains (N, 3)."""
    mesh = direct.mesh
    found = configuration_at(mesh.system(gripper.rotation, culled=True), strains)
    frames, positions = np.array(found.rotations), gripper.position + found.positions
    end = FarEnd(Pose.from_rotation(positions[-1], frames[-1]), far_end.grip)
    return Shape(gripper, mesh.s, positions, frames, strains, np.nan, np.nan, np.zeros(6), np.nan,
                 np.nan, 0, converged=False, far_end=end)
