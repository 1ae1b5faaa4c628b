# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""STL, OBJ, PLY, GLB and 3MF: units, parts and their names, what is no solid is refused."""

import re

import numpy as np
import pytest
from solids import block, circle, plate, rectangle, stl, torus

from dlo_planner import Box, Hull, InvalidTask, Mesh, Pose, Sheet
from dlo_planner.scene import Scene

trimesh = pytest.importorskip('trimesh')

BLOCK = block((1, 2, 3))
ASSUMED = 'states no unit: mm are assumed'


def read(tmp_path, name, content, **asked):
    (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return Scene.read(tmp_path / name, **asked)


def exported(kind, vertices, faces):
    found = trimesh.Trimesh(vertices, faces, process=False).export(file_type=kind)
    return found.encode() if isinstance(found, str) else found


def obj(*parts):
    """Return the text of an OBJ with (name, vertices, faces), each of two materials."""
    lines, first = ['mtllib no_such.mtl'], 1
    for name, vertices, faces in parts:
        rows = [' '.join(map(str, face)) for face in faces + first]
        lines += [f'o {name}', *('v ' + ' '.join(map(str, one)) for one in vertices),
                  'usemtl red', *(f'f {row}' for row in rows[:5]),
                  'usemtl blue', *(f'f {row}' for row in rows[5:])]
        first += len(vertices)
    return '\n'.join([*lines, ''])


def test_a_fixture_of_fifty_thousand_triangles(tmp_path):
    vertices, faces = torus(100, 20, 250, 100)
    found = read(tmp_path, 'fixture.stl', stl(vertices, faces), friction=0.3)
    one = found['fixture']
    assert isinstance(one, Mesh) and len(one.faces) == 50_000 and one.smooth
    assert one.friction == 0.3 and ASSUMED in found.notes[0]
    assert len(found.notes) == 2 and 'holes through it' in found.notes[1]
    np.testing.assert_allclose(np.ptp(one.vertices, axis=0), (0.24, 0.24, 0.04), rtol=1e-3)


def test_a_plate_has_its_holes(tmp_path):
    outline, hole = rectangle(200, 120), circle(12, 48, (40, 10))
    found = read(tmp_path, 'panel.stl', stl(*plate(outline, [hole], 4, step=20)), unit='mm')
    assert isinstance(found['panel'], Sheet) and found.notes == ()
    assert found.cutouts == found['panel'].cutouts
    np.testing.assert_allclose(found.cutouts[0].center, (0.04, 0.01, 0.002), atol=1e-7)
    assert found.cutouts[0].radius == pytest.approx(0.012 * np.cos(np.pi / 48), rel=1e-5)
    np.testing.assert_allclose(found.cutouts[0].normal, (0, 0, 1), atol=1e-9)


@pytest.mark.parametrize(('unit', 'factor'), [(None, 1e-3), ('m', 1), ('cm', 0.01),
                                              ('in', 0.0254)])
@pytest.mark.parametrize('kind', ['stl', 'ply', 'obj'])
def test_what_states_no_unit_is_in_mm_unless_it_is_said(tmp_path, kind, unit, factor):
    content = exported(kind, *BLOCK)
    found = read(tmp_path, f'it.{kind}', content, unit=unit)
    assert sorted(found['it'].size) == pytest.approx(sorted(factor * np.array((1, 2, 3))))
    assert (ASSUMED in ' '.join(found.notes)) == (unit is None)


def test_parts_of_an_obj_are_its_objects_whatever_their_materials(tmp_path):
    one, other = block((20, 20, 20)), torus(30, 5, 12, 8)
    found = read(tmp_path, 'it.obj', obj(('base', *one), ('ring', other[0] + (99, 0, 0), other[1])))
    assert isinstance(found['base'], Box) and isinstance(found['ring'], Mesh)
    assert len(found.obstacles) == 2


def test_files_that_state_their_unit(tmp_path):
    pytest.importorskip('lxml')
    pytest.importorskip('networkx')
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(*torus(0.1, 0.02, 20, 10)), node_name='ring')
    turn = trimesh.transformations.rotation_matrix(0.4, (0, 0, 1), (1, 0, 0))
    scene.add_geometry(trimesh.Trimesh(*block((0.1, 0.2, 0.3))), node_name='post', transform=turn)
    found = read(tmp_path, 'cell.glb', scene.export(file_type='glb'))
    assert {one.name for one in found.obstacles} == {'ring', 'post'}
    note, other = found.notes
    assert 'in glTF y leads upwards' in note and other.startswith("'ring': holes through it")
    numbers = [float(one) for one in re.search(r'pose of (\S+)', note)[1].split(',')]
    up = Pose(numbers[:3], numbers[3:]).rotation @ (0, 1, 0)
    np.testing.assert_allclose(up, (0, 0, 1), atol=1e-5)
    np.testing.assert_allclose(found['post'].pose.position, turn[:3, 3], atol=1e-6)
    jig = trimesh.Scene()
    jig.add_geometry(trimesh.Trimesh(*block((50, 20, 10))), node_name='jig', geom_name='jig')
    content = jig.export(file_type='3mf')
    found = read(tmp_path, 'jig.3mf', content)
    assert sorted(found['jig'].size) == pytest.approx([0.01, 0.02, 0.05]) and found.notes == ()
    found = read(tmp_path, 'jig.3mf', content, unit='cm')
    assert sorted(found['jig'].size) == pytest.approx([0.1, 0.2, 0.5])
    assert found.notes == ('jig.3mf says mm, read in cm as was asked for',)


def test_solids_of_a_file_are_obstacles_of_their_own(tmp_path):
    boxes = [block((10, 10, 10), (20 * k, 0, 0)) for k in range(3)]
    hollow = block((10, 10, 10)), block((4, 4, 4))
    far = np.array((0, 50, 0))
    vertices = np.concatenate([*(one for one, _ in boxes), *(one + far for one, _ in hollow)])
    faces = [one + 8 * k for k, (_, one) in enumerate(boxes)]
    faces[2] = faces[2][:, ::-1]  # one that somebody turned inside out
    faces += [hollow[0][1] + 24, hollow[1][1][:, ::-1] + 32]  # a cavity: the walls of it look in
    found = read(tmp_path, 'it.stl', stl(vertices, np.concatenate(faces)))
    assert sorted(one.name for one in found.obstacles) == [f'it/{k}' for k in range(4)]
    boxes = [one for one in found.obstacles if isinstance(one, Box)]
    assert sorted(one.pose.position.round(6).tolist() for one in boxes) == [
        [0, 0, 0], [0.02, 0, 0], [0.04, 0, 0]]
    hollow, = (one for one in found.obstacles if isinstance(one, Mesh))
    assert len(hollow.faces) == 24


def test_what_is_not_closed_is_its_hull_where_that_is_said(tmp_path):
    ring, faces = torus(100, 20, 12, 8)
    box = block((10, 10, 10), (300, 0, 0))
    content = stl(np.concatenate([ring, box[0]]), np.concatenate([faces[1:], box[1] + len(ring)]))
    found = read(tmp_path, 'it.stl', content, unit='mm', hulls=True, friction=0.2)
    hull, = (one for one in found.obstacles if isinstance(one, Hull))
    assert found.notes == (f'{hull.name!r} is not closed, and read as its convex hull',)
    np.testing.assert_allclose(np.ptp(hull.points, axis=0), (0.24, 0.24, 0.04), rtol=1e-6)
    assert hull.friction == 0.2 and len(found.obstacles) == 2
    (tmp_path / 'list.yaml').write_text('- file: {path: it.stl, unit: mm, hulls: true}')
    assert Scene.read(tmp_path / 'list.yaml').notes == found.notes
    with pytest.raises(InvalidTask, match='taken as the convex hull of it, by hulls=True'):
        read(tmp_path, 'it.stl', content, unit='mm')


def test_where_a_file_stands(tmp_path):
    pose = Pose.looking_along((0.4, 0, 1), (0, 1, 0))
    found = read(tmp_path, 'it.stl', stl(*block((10, 20, 30), (5, 0, 0))), pose=pose)
    np.testing.assert_allclose(found['it'].pose.position, (0.4, 0.005, 1.0), atol=1e-9)


def test_a_hole_that_is_no_cutout_is_said(tmp_path):
    disc, hole = circle(100, 64), circle(14, 32)
    found = read(tmp_path, 'disc.stl', stl(*plate(disc, [hole], 4, step=20)), unit='mm')
    assert not found.cutouts
    assert [note[:29] for note in found.notes] == ["'disc': holes through it, but"]
    assert not read(tmp_path, 'full.stl', stl(*plate(disc, [], 4, step=20)), unit='mm').notes


@pytest.mark.parametrize(('name', 'content', 'said'), [
    ('short.stl', stl(*torus(100, 20, 50, 20))[:9000], 'it is cut off, its head says 2000 '
     'triangles, which are 100084 bytes, and it has 9000'),
    ('open.stl', stl(BLOCK[0], BLOCK[1][1:]),
     "'open': Mesh is not watertight: 11 triangles have 3 open edges"),
    ('text.stl', 'hello', 'expected triangles, it has none'),
    ('short.ply', exported('ply', *BLOCK)[:300], 'expected triangles of a .ply file'),
    ('short.glb', exported('glb', *BLOCK)[:300], 'expected triangles of a .glb file'),
    ('no.3mf', b'PK', 'expected triangles of a .3mf file'), ('empty.obj', '', 'expected triangles'),
    ('points.ply', exported('ply', *BLOCK).replace(b'face 12', b'face 0'),
     'expected triangles')])
def test_what_is_no_solid_is_refused_with_the_reason(tmp_path, name, content, said):
    with pytest.raises(InvalidTask, match=f'{name}.*{said}'):
        read(tmp_path, name, content)


def test_a_size_that_no_cell_has_is_said(tmp_path):
    found = read(tmp_path, 'it.stl', stl(*block((100, 200, 300))), unit='m')
    assert found.notes == ('it.stl is 300 m large in m: is that meant?',)
