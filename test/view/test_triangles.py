# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, Pose
from dlo_planner.view.primitives import bars_between, plate, rectangle, round_bar

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
