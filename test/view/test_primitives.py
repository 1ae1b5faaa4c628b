# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Tessellation as lines, polygons and dots: where they lie, against what geometry says."""

import numpy as np
import pytest

from dlo_planner import Pose
from dlo_planner.view.primitives import Primitive, cut_box, tessellate

PLACE = Pose.looking_along((1.0, 2.0, 3.0), (1.0, 1.0, 0.5))
RED = (1.0, 0.0, 0.0)


def area(polygon):
    """Return the area of a flat convex polygon (n, 3)."""
    off = np.asarray(polygon)[1:] - polygon[0]
    return 0.5 * np.linalg.norm(np.cross(off[:-1], off[1:]).sum(axis=0))


def local(points):
    return (np.asarray(points) - PLACE.position) @ PLACE.rotation


def test_a_box_has_six_faces_of_its_size():
    lines, faces, _ = tessellate(Primitive('obstacle', 0, 'box', RED, pose=PLACE,
                                           size=(1.0, 2.0, 3.0)))
    assert sorted(round(area(face), 12) for face in faces) == [2.0, 2.0, 3.0, 3.0, 6.0, 6.0]
    np.testing.assert_allclose(np.abs(local(np.concatenate(faces))), np.tile((0.5, 1.0, 1.5),
                                                                             (24, 1)), atol=1e-12)
    lengths = sorted(round(float(np.linalg.norm(line[1] - line[0])), 12) for line in lines)
    assert lengths == [1.0] * 4 + [2.0] * 4 + [3.0] * 4


def test_a_ball_is_round_and_closed():
    _, faces, _ = tessellate(Primitive('obstacle', 0, 'ball', RED, pose=PLACE, size=(0.4,) * 3))
    np.testing.assert_allclose(np.linalg.norm(local(np.concatenate(faces)), axis=1), 0.2,
                               atol=1e-12)
    assert sum(map(area, faces)) == pytest.approx(4 * np.pi * 0.2**2, rel=0.02)


def test_a_cylinder_stands_along_z():
    _, faces, _ = tessellate(Primitive('obstacle', 0, 'cylinder', RED, pose=PLACE,
                                       size=(0.2, 0.2, 1.0)))
    corners = local(np.concatenate(faces))
    assert np.ptp(corners[:, 2]) == pytest.approx(1.0)
    assert np.hypot(*corners[:, :2].T).max() == pytest.approx(0.1)
    assert sum(map(area, faces)) == pytest.approx(2 * np.pi * 0.1 * (1.0 + 0.1), rel=0.03)


def test_an_arrow_ends_where_it_points():
    item = Primitive('gripper', 0, 'arrow', RED, points=[(0, 0, 0), (0, 0, 2)],
                     size=(0.1, 0.2, 0.3))
    shaft, head = tessellate(item).lines
    np.testing.assert_array_equal(shaft, item.points)
    np.testing.assert_array_equal(head[1], (0, 0, 2))
    assert (head[[0, 2], 2] < 2).all() and (head[[0, 2], 2] > 1).all()
    nothing = Primitive('gripper', 0, 'arrow', RED, points=[(1, 1, 1), (1, 1, 1)], size=(0.1,) * 3)
    assert tessellate(nothing).lines == []


@pytest.mark.parametrize(('kind', 'points'), [('line', 4), ('segments', 4), ('triangles', 6),
                                              ('points', 5), ('text', 0)])
def test_what_lies_in_a_frame_is_carried_with_it(kind, points):
    given = np.random.default_rng(1).normal(size=(points, 3))
    found = tessellate(Primitive('x', 0, kind, RED, points=given, pose=PLACE, text='x'))
    placed = np.concatenate([*found.lines, *found.faces, found.dots, np.zeros((0, 3))])
    np.testing.assert_allclose(placed, given @ PLACE.rotation.T + PLACE.position, atol=1e-12)


def test_a_plane_cuts_a_box_where_geometry_says():
    low, high = np.zeros(3), np.array([1.0, 2.0, 3.0])
    assert area(cut_box((9, 9, 0.5), (0, 0, 1), low, high)) == pytest.approx(2.0)
    cube = cut_box((0.5, 0.5, 0.5), (1, 1, 1), np.zeros(3), np.ones(3))  # a regular hexagon
    assert len(cube) == 6
    assert area(cube) == pytest.approx(0.75 * np.sqrt(3))
    edges = np.linalg.norm(cube - np.roll(cube, 1, axis=0), axis=1)
    np.testing.assert_allclose(edges, np.sqrt(0.5))
    assert len(cut_box((0, 0, 4.0), (0, 0, 1), low, high)) == 0
