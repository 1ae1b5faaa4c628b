# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks and plates with holes, told from triangles; and plates as convex pieces."""

import numpy as np
import pytest
from cells import AT, one_of_each
from scipy.spatial import ConvexHull
from solids import block, circle, plate, rectangle, torus

from dlo_planner import Box, Pose, Sheet
from dlo_planner.model.triangles import mended
from dlo_planner.scene.plates import circle_of, pieces_of, recognized, rectangle_of

ROUND, LONG = circle(0.012, 48, (0.04, 0.01)), rectangle(0.03, 0.02, (-0.05, -0.01), 0.3)
PANEL = plate(rectangle(0.2, 0.12), [ROUND, LONG], 0.004, step=0.02)


def found(vertices, faces, pose=AT):
    return recognized(mended(pose.position + vertices @ pose.rotation.T, faces))


def test_a_plate_is_where_its_triangles_are():
    sheet = found(*PANEL)
    assert isinstance(sheet, Sheet)
    middle = AT.compose(Pose((0, 0, 0.002), (0, 0, 0, 1)))
    np.testing.assert_allclose(sheet.pose.position, middle.position, atol=1e-9)
    assert sheet.thickness == pytest.approx(0.004) and {
        round(sheet.width, 9), round(sheet.height, 9)} == {0.2, 0.12}
    np.testing.assert_allclose(np.abs(sheet.pose.direction @ AT.rotation), (0, 0, 1), atol=1e-9)
    holes = {hole.radius is None: hole for hole in sheet.cutouts}
    local = AT.inverse()
    np.testing.assert_allclose(local.compose(holes[False].pose).position, (0.04, 0.01, 0.002),
                               atol=1e-9)
    # the circle within the polygon: not wider than what the file says
    assert holes[False].radius == pytest.approx(0.012 * np.cos(np.pi / 48), rel=1e-9)
    np.testing.assert_allclose(local.compose(holes[True].pose).position, (-0.05, -0.01, 0.002),
                               atol=1e-9)
    side = local.rotation @ holes[True].pose.rotation[:, 1]
    assert abs(side @ (np.cos(0.3), np.sin(0.3), 0)) == pytest.approx(
        1.0 if holes[True].width > holes[True].height else 0.0, abs=1e-9)
    assert sorted([holes[True].width, holes[True].height]) == pytest.approx([0.02, 0.03])


def test_a_block_is_a_box():
    box = found(*block((0.1, 0.2, 0.3)))
    assert isinstance(box, Box)
    np.testing.assert_allclose(box.pose.position, AT.position, atol=1e-12)
    # each size along the axis that it has
    np.testing.assert_allclose(np.abs(AT.rotation.T @ box.pose.rotation) @ box.size,
                               (0.1, 0.2, 0.3), atol=1e-12)


@pytest.mark.parametrize(('outline', 'holes'), [
    (circle(0.1, 24), []),                                 # a disk
    (rectangle(0.2, 0.12), [circle(0.01, 6)]),             # a hexagon is no round hole
    (rectangle(0.2, 0.12), [circle(0.02, 48) * (1, 0.9)]),  # an oval one neither
    (circle(0.1, 4) * (1, 0.5), []),                       # a rhombus
    (rectangle(0.2, 0.12) + [(0.01, 0), (0, 0), (0, 0), (0, 0)], [])], ids=[
        'disk', 'hexagon', 'oval', 'rhombus', 'quadrilateral'])
def test_what_is_none_of_them_is_not_taken_for_one(outline, holes):
    assert found(*plate(outline, holes, 0.01, step=0.05)) is None


def test_a_solid_that_is_no_plate_is_none():
    assert found(*torus(0.1, 0.02, 12, 8)) is None
    vertices, faces = block((0.1, 0.2, 0.3))
    vertices = vertices + np.where(vertices == vertices.max(axis=0), 0.001, 0.0) * (0, 0, 1)
    vertices[0] += (0, 0, 0.002)  # one corner
    assert found(vertices, faces) is None


def test_what_leans_or_has_a_step_is_no_block():
    vertices, faces = block((0.1, 0.2, 0.3))
    upper = vertices[:, 2:] > 0
    assert isinstance(found(vertices, faces), Box)
    assert found(np.where(upper, vertices * (0.8, 0.9, 1), vertices), faces) is None  # a frustum
    assert found(vertices + upper * (0.02, 0, 0), faces) is None  # sheared
    vertices, faces = plate(rectangle(0.2, 0.12), [], 0.01, step=0.04)
    vertices[np.argmin(np.linalg.norm(vertices[:, :2], axis=1) + 9 * (vertices[:, 2] == 0)), 2] *= 2
    assert found(vertices, faces) is None


def test_a_circle_is_a_whole_one():
    assert circle_of(circle(0.1, 40)[:30]) is None
    assert circle_of(circle(0.1, 40)).radius == pytest.approx(0.1 * np.cos(np.pi / 40))
    assert rectangle_of(rectangle(0.1, 0.2)[:3], 1e-9) is None


def test_pieces_fill_a_sheet_but_its_holes():
    sheet = one_of_each()[7]
    assert len(sheet.cutouts) == 2
    pieces = [ConvexHull(piece) for piece in pieces_of(sheet)]
    # of a round hole what is around its polygon: 48 tan(pi / 48) r^2 instead of pi r^2
    holes = 48 * np.tan(np.pi / 48) * 0.01**2 + 0.03 * 0.02
    assert sum(piece.volume for piece in pieces) == pytest.approx(
        0.004 * (0.4 * 0.3 - holes), rel=1e-9)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1000, 3)) * (0.0, 0.4, 0.3)
    within = [sum(bool((piece.equations[:, :3] @ point + piece.equations[:, 3] < 0).all())
                  for piece in pieces) for point in points]
    assert set(within) == {0, 1}
    for point, count in zip(points, within, strict=True):
        world = sheet.pose.position + sheet.pose.rotation @ point
        inside = False
        for hole in sheet.cutouts:
            y, z = (hole.pose.rotation.T @ (world - hole.center))[1:]
            inside |= bool(np.hypot(y, z) < hole.radius if hole.radius is not None else
                           abs(y) < hole.width / 2 and abs(z) < hole.height / 2)
        assert count == 1 - inside, point
