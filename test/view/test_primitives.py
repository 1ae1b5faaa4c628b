# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines, polygons, dots and triangles: where they lie, against what geometry says."""

import numpy as np
import pytest
from meshes import SOLIDS, ball
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, Mesh, Pose
from dlo_planner.view.primitives import (
    Primitive,
    bars_between,
    cut_box,
    plate,
    rectangle,
    round_bar,
    tessellate,
    triangles,
)
from dlo_planner.view.scene import obstacle_primitives

PLACE = Pose.looking_along((1.0, 2.0, 3.0), (1.0, 1.0, 0.5))
RED = (1.0, 0.0, 0.0)


def area(polygon):
    """Return the area of a flat convex polygon (n, 3)."""
    off = np.asarray(polygon)[1:] - polygon[0]
    return 0.5 * np.linalg.norm(np.cross(off[:-1], off[1:]).sum(axis=0))


def local(points):
    return (np.asarray(points) - PLACE.position) @ PLACE.rotation


def test_triangles_of_a_mesh_are_drawn_where_they_are():
    drawn, = obstacle_primitives([Mesh(*SOLIDS['ring'], PLACE)])
    corners = SOLIDS['ring'].vertices[SOLIDS['ring'].faces].reshape(-1, 3)
    np.testing.assert_allclose(local(drawn.corners), corners, atol=1e-12)
    assert len(tessellate(drawn)[1]) == len(SOLIDS['ring'].faces)


def test_a_mesh_of_many_triangles_is_drawn_coarser():
    fine = ball(0.1, 12_000)
    drawn = triangles(fine)
    assert len(drawn) < 3 * len(fine.faces)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 0.1, atol=3e-3)


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


HELIX = np.column_stack([np.cos(np.linspace(0, 7, 60)), np.sin(np.linspace(0, 7, 60)),
                         np.linspace(0, 1, 60)])


def areas(corners):
    a, b, c = corners.reshape(-1, 3, 3).transpose(1, 0, 2)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def volume(vertices, faces):
    """Return the volume inside outward triangles (Gauss)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.einsum('ij,ij->', a, np.cross(b, c))) / 6


def test_a_bar_is_closed_and_faces_outward():
    vertices, faces = round_bar(400)
    assert volume(vertices, faces) == pytest.approx(np.pi, rel=1e-3)  # length 1, radius 1


@pytest.mark.parametrize('points', [
    HELIX, HELIX[::-1], np.outer(np.linspace(1, 0, 5), (1, 0, 0)), np.eye(3)])
def test_bars_lead_from_point_to_point(points):
    turns, middles, lengths = bars_between(points)
    along = Rotation.from_quat(np.roll(turns, -1, axis=1)).apply((1.0, 0.0, 0.0))
    half = 0.5 * lengths[:, None] * along
    np.testing.assert_allclose(middles - half, points[:-1], atol=1e-12)
    np.testing.assert_allclose(middles + half, points[1:], atol=1e-12)


def test_points_on_each_other_make_no_nan():
    turns, _, lengths = bars_between(np.zeros((3, 3)))
    assert np.isfinite(turns).all() and not lengths.any()


@pytest.mark.parametrize(('cutout', 'hole'), [
    (CutOut(Pose.identity(), radius=0.02), np.pi * 0.02**2),
    (CutOut(Pose.identity(), width=0.06, height=0.02), 0.06 * 0.02)])
def test_a_plate_is_a_square_less_its_hole(cutout, hole):
    corners = plate(cutout)
    side = 2 * np.abs(corners).max()
    assert areas(corners).sum() == pytest.approx(side**2 - hole, rel=1e-3)
    assert not corners[:, 0].any()


def test_a_rectangle_has_its_area():
    assert areas(rectangle(0.3, 0.2)).sum() == pytest.approx(0.06)
