# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles in YAML files: by their class and its fields, the same for all of them."""

import pytest
from meshes import SOLIDS

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    InvalidTask,
    Mesh,
    Plane,
    Pose,
    Sheet,
    Sphere,
)
from dlo_planner.scene import Scene

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
TEXT = """
- plane: {point: [0, 0, 0.2], normal: [0, 0, 1], friction: 0.3}
- sphere: {center: [1, 0, 0], radius: 1e-1}
- capsule: {start: [0, 0, 0], end: [1, 0, 0], radius: 0.1}
- cylinder: {start: [0, 0, 0], end: [1, 0, 0], radius: 0.1, friction: 0.2}
- box: {pose: [0, 0, 1], size: [1, 2, 3]}
- sheet: {pose: [0, 0, 1], width: 1, height: 2,
          cutouts: [{type: CutOut, pose: {position: [0, 0, 1]}, radius: 0.1}]}
"""
KNOWN = (Plane((0, 0, 0.2), (0, 0, 1), 0.3), Sphere((1, 0, 0), 0.1),
         Capsule((0, 0, 0), (1, 0, 0), 0.1), Cylinder((0, 0, 0), (1, 0, 0), 0.1, 0.2),
         Box(LEVEL, (1, 2, 3)), Sheet(LEVEL, 1.0, 2.0, cutouts=[CutOut(LEVEL, radius=0.1)]))


def test_a_mesh_is_read_from_its_file(tmp_path):
    pytest.importorskip('trimesh').Trimesh(*SOLIDS['ring'], process=False).export(
        tmp_path / 'ring.stl')
    mesh, = read(tmp_path, f'- mesh: {{path: {tmp_path}/ring.stl, unit: mm, pose: [0, 0, 1], '
                 'friction: 0.2}')
    assert (len(mesh.faces), mesh.pose, mesh.friction, mesh.smooth) == (576, LEVEL, 0.2, True)
    for text, said in (('{path: a.stl, unit: mm, size: 1}', 'mesh.size: expected one of path'),
                       ('{path: none.stl, unit: mm}', 'mesh: path = .*: expected a file'),
                       (f'{{path: {tmp_path}/ring.stl}}', 'mesh: unit = None: expected the unit')):
        with pytest.raises(InvalidTask, match=said):
            read(tmp_path, f'- mesh: {text}')


def test_triangles_may_stand_in_the_file(tmp_path):
    tetrahedron = ('{vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], '
                   'faces: [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]}')
    mesh, hull = read(tmp_path, f'- mesh: {tetrahedron}\n'
                      '- hull: {points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}')
    assert mesh == Mesh(hull.points, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


def read(tmp_path, text):
    path = tmp_path / 'scene.yaml'
    path.write_text(text)
    return Scene.read(path).obstacles


def test_each_kind_is_read(tmp_path):
    assert read(tmp_path, TEXT) == KNOWN


@pytest.mark.parametrize(('text', 'said'), [
    ('- cylinder: {start: [0, 0, 0], end: [1, 0, 0]}', 'cylinder: expected radius'),
    ('- sphere: {center: [0, 0, 0], radius: 1, radios: 2}', 'sphere.radios: expected one of'),
    ('- cylinder: {start: [0, 0, 0], end: [0, 0, 0], radius: 1}', 'Cylinder.end'),
    ('- sheet: {}', 'sheet: expected pose, width'),
    ('- [sphere]', 'expected one of file, plane, sphere, .*, with its values'),
    ('- cone: {}', 'expected one of')])
def test_what_is_wrong_is_named(tmp_path, text, said):
    with pytest.raises(InvalidTask, match=said):
        read(tmp_path, text)
