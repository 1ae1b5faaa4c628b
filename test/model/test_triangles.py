# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Triangles that enclose a solid: what is mended, what is refused, and in which words."""

import numpy as np
import pytest
from meshes import SOLIDS, blocks

from dlo_planner import Hull, InvalidTask, Mesh, Pose
from dlo_planner.model.triangles import volume

RING = SOLIDS['ring']


@pytest.mark.parametrize(('faces', 'said'), [
    (RING.faces[1:], r'not watertight: 575 triangles have 3 open edges; expected two triangles at'),
    (np.vstack([RING.faces, RING.faces[:1]]), '3 edges of more than two'),
    (RING.faces[:, ::-1], 'inside out: its volume is -.* expected triangles that are counterclock'),
    (np.vstack([RING.faces[:3, ::-1], RING.faces[3:]]), r'at \d+ edges both triangles are seen in'),
    (RING.faces + 1, r'faces\[\d+\] = .*: expected indices of vertices, 0 to 287'),
    (RING.faces + 0.5, 'faces = .*: expected whole numbers'),
    (np.vstack([RING.faces, [(5, 5, 6)]]), r'faces\[576\] = \[5, 5, 6\]: expected a triangle')])
def test_what_encloses_nothing_is_refused(faces, said):
    with pytest.raises(InvalidTask, match=said):
        Mesh(RING.vertices, faces)


def test_vertices_at_one_place_are_one():
    soup = RING.vertices[RING.faces].reshape(-1, 3)  # as STL has it
    faces = np.arange(len(soup)).reshape(-1, 3)
    mesh = Mesh.mended(soup, faces)
    assert mesh.vertices.shape == RING.vertices.shape
    assert volume(*mesh.surface) == pytest.approx(volume(*RING))


def test_triangles_that_are_seen_from_within_are_turned(rng):
    turned = RING.faces.copy()
    some = rng.random(len(turned)) < 0.4
    turned[some] = turned[some][:, ::-1]
    for faces in (turned, RING.faces[:, ::-1]):
        mesh = Mesh.mended(RING.vertices, np.vstack([faces, faces[:2], [(5, 5, 6)]]))
        assert volume(*mesh.surface) == pytest.approx(volume(*RING))


def test_a_cavity_stays_one():
    lines = [(0, 1, 2, 3)] * 3
    filled = np.ones((3, 3, 3))
    filled[1, 1, 1] = 0
    hollow = blocks(lines, filled)
    assert volume(*Mesh.mended(*hollow).surface) == pytest.approx(26)


def test_holes_are_not_filled():
    with pytest.raises(InvalidTask, match='3 open edges'):
        Mesh.mended(RING.vertices, RING.faces[1:])


@pytest.mark.parametrize('points', [np.eye(3), np.zeros((5, 3)), [(0, 0, 0), (1, 0, 0), (0, 1, 0),
                                                                 (1, 1, 0)]])
def test_a_hull_has_a_volume(points):
    with pytest.raises(InvalidTask, match='Hull.points = .*: expected four points or more that do'):
        Hull(points)


def test_a_hull_is_seen_from_outside_and_has_no_points_inside():
    corners = SOLIDS['box'].vertices
    hull = Hull(np.vstack([corners, 0.5 * corners]), Pose.identity(), 0.2)
    assert len(hull.surface.vertices) == 8
    assert volume(*hull.surface) == pytest.approx(0.1 * 0.2 * 0.3)
    assert hull.bodies[0].inner == pytest.approx(0.05)


def test_files_of_triangles(tmp_path):
    trimesh = pytest.importorskip('trimesh')
    for name in ('ring.stl', 'ring.obj', 'ring.ply', 'ring.glb'):
        trimesh.Trimesh(*RING, process=False).export(tmp_path / name)
        mesh = Mesh.read(tmp_path / name, 'mm', friction=0.3, smooth=False)
        assert len(mesh.faces) == len(RING.faces)
        assert volume(*mesh.surface) == pytest.approx(1e-9 * volume(*RING), rel=1e-5)
        assert (mesh.friction, mesh.smooth) == (0.3, False)
    assert np.abs(Mesh.read(tmp_path / 'ring.glb').vertices).max() == pytest.approx(0.13)  # says m
    with pytest.raises(InvalidTask, match=r"unit = None: expected the unit of .*ring.stl', which"):
        Mesh.read(tmp_path / 'ring.stl')


def test_a_file_that_says_its_unit(tmp_path):
    trimesh = pytest.importorskip('trimesh')
    for needed in ('lxml', 'networkx'):
        pytest.importorskip(needed)
    solid = trimesh.Trimesh(*RING, process=False)
    solid.units = 'mm'
    solid.export(tmp_path / 'ring.3mf')
    assert np.abs(Mesh.read(tmp_path / 'ring.3mf').vertices).max() == pytest.approx(0.13e-3)


@pytest.mark.parametrize(('name', 'content', 'said'), [
    ('a.stl', b'rubbish', 'expected'), ('a.stl', b'\0' * 300, 'expected triangles, it has none'),
    ('a.obj', b'v 0 0 0\n', 'it has none'),
    ('a.step', b'x', 'expected a file that ends with one of'),
    ('a.obj', b'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n', r'path = .*not watertight: 1 triangles')])
def test_odd_files_are_refused_by_name(tmp_path, name, content, said):
    pytest.importorskip('trimesh')
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidTask, match=said):
        Mesh.read(tmp_path / name, 'mm')
