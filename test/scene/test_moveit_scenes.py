# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""MoveIt's .scene: read in both forms, refused by line and object, written as MoveIt reads it."""

import numpy as np
import pytest
from cells import difference, one_of_each

from dlo_planner import Box, Capsule, Cylinder, Hull, InvalidTask, Pose, Sheet, Sphere
from dlo_planner.scene import Scene

LEVEL = '0 0 0 1'
BOX = f'1\nbox\n0.1 0.2 0.3\n0 0 0\n{LEVEL}\n0 0 0 0\n'


def read(tmp_path, text, **asked):
    (tmp_path / 'it.scene').write_text(text)
    return Scene.read(tmp_path / 'it.scene', **asked)


def test_a_hundred_objects(tmp_path):
    rng, lines, known = np.random.default_rng(0), ['shop floor'], []
    kinds = [('box\n0.1 0.2 0.3', lambda pose: Box(pose, (0.1, 0.2, 0.3))),
             ('sphere\n0.05', lambda pose: Sphere(pose.position, 0.05)),
             ('cylinder\n0.02 0.4', lambda pose: Cylinder(
                 pose.position - 0.2 * pose.rotation[:, 2],
                 pose.position + 0.2 * pose.rotation[:, 2], 0.02))]
    for k in range(100):
        at, inner = (Pose(rng.uniform(-2, 2, 3), rng.normal(size=4)) for _ in range(2))
        text, made = kinds[k % 3]
        rows = [' '.join(map(repr, row.tolist())) for pose in (at, inner)
                for row in (pose.position, pose.quaternion)]
        lines += [f'* part {k}', *rows[:2], '1', text, *rows[2:], '0.5 0.5 0.5 1', '0']
        known.append(made(at.compose(inner)))
    found = read(tmp_path, '\n'.join([*lines, '.', '']))
    assert [one.name for one in found.obstacles] == [f'part {k}' for k in range(100)]
    assert [difference(one, other, 1e-14) for one, other in zip(
        found.obstacles, known, strict=True) if difference(one, other, 1e-14)[:4] != 'name'] == [
            ] and found.notes == ()


def test_the_older_form_has_no_poses_of_objects(tmp_path):
    text = f'old\n* a table\n2\nbox\n1 1 0.1\n0 0 0.5\n{LEVEL}\n0 0 0 0\nsphere\n0.1\n1 2 3\n' \
           f'{LEVEL}\n0 0 0 0\n* other\n{BOX}.\n'
    found = read(tmp_path, text)
    assert [one.name for one in found.obstacles] == ['a table/0', 'a table/1', 'other']
    assert found.obstacles[:2] == (Box(Pose((0, 0, 0.5), (0, 0, 0, 1)), (1, 1, 0.1)),
                                   Sphere((1, 2, 3), 0.1))


def test_what_is_written_is_read_as_it_was(tmp_path):
    scene = Scene(one_of_each())
    scene.write(tmp_path / 'cell.scene')
    found = Scene.read(tmp_path / 'cell.scene')
    assert [difference(one, other, 1e-15) for one, other in zip(
        scene.obstacles, found.obstacles, strict=True)] == [''] * 11
    assert len(found.cutouts) == 2


class Stream:
    """Reads as std::istream does: words (>>), and the rest of a line (getline)."""

    def __init__(self, text):
        self.rest = text

    def line(self):
        found, _, self.rest = self.rest.partition('\n')
        return found

    def word(self):
        found = self.rest.split(None, 1)[0]
        self.rest = self.rest.lstrip()[len(found):]
        return found

    def numbers(self, count):
        return [float(self.word()) for _ in range(count)]


def as_moveit_reads(text):
    """Return {object: (pose, [(shape, numbers, pose)], subframes)}, in the order MoveIt has."""
    stream, objects = Stream(text), {}
    stream.line()
    while (mark := stream.word()) == '*':
        name, pose, shapes = stream.line().strip(), stream.numbers(7), []
        for _ in range(int(stream.word())):
            kind = stream.word()
            if kind == 'mesh':
                counts = [int(stream.word()) for _ in range(2)]
                sizes = [stream.numbers(3 * count) for count in counts]
            else:
                sizes = stream.numbers({'sphere': 1, 'box': 3, 'cylinder': 2, 'plane': 4}[kind])
            shapes.append((kind, sizes, stream.numbers(7)))
            stream.numbers(4)
        frames = [(stream.word(), stream.numbers(7)) for _ in range(int(stream.word()))]
        objects[name] = pose, shapes, frames
    assert mark == '.'
    return objects


def test_moveit_would_read_what_is_written(tmp_path):
    Scene(one_of_each()).write(tmp_path / 'cell.scene')
    objects = as_moveit_reads((tmp_path / 'cell.scene').read_text())
    assert list(objects) == ['floor', 'sphere 1', 'bar', 'a rod', 'table', 'egg', 'panel 1',
                             'paper', 'ring', 'stone']
    kinds = [kind for kind, *_ in objects['bar'][1]]
    assert kinds == ['cylinder', 'sphere', 'sphere'] * 2
    assert {kind for kind, *_ in objects['panel 1'][1]} == {'mesh'}
    pose, ((kind, sizes, _),), _ = objects['table']
    assert kind == 'box' and sizes == [1, 2, 0.1] and pose[:3] == [0.3, 0.2, 0.5]
    # the hull around an ellipsoid contains it
    (_, (corners, _), _), = objects['egg'][1]
    around = Hull(np.reshape(corners, (-1, 3)))
    turns = np.random.default_rng(0).normal(size=(2000, 3))
    on_it = (0.1, 0.2, 0.05) * turns / np.linalg.norm(turns, axis=1)[:, None]
    vertices, faces = around.surface
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    heights = (on_it @ normals.T - (normals * a).sum(axis=1)) / np.linalg.norm(normals, axis=1)
    assert heights.max() < 0


def test_a_cylinder_with_a_ball_at_each_end_is_a_capsule(tmp_path):
    shapes = f'cylinder\n0.1 2\n0 0 1\n{LEVEL}\n0 0 0 0\n' + ''.join(
        f'sphere\n0.1\n0 0 {z}\n{LEVEL}\n0 0 0 0\n' for z in (0, 2))
    found = read(tmp_path, f's\n* bar\n1 0 0\n{LEVEL}\n3\n{shapes}0\n.\n')
    assert found.obstacles == (Capsule((1, 0, 0), (1, 0, 2), 0.1),) and found['bar']
    shapes = shapes.replace('0 0 2', '0 0 2.1')
    apart = read(tmp_path, f's\n* bar\n1 0 0\n{LEVEL}\n3\n{shapes}0\n.\n')
    assert [type(one) for one in apart.obstacles] == [Cylinder, Sphere, Sphere]


def test_a_box_with_a_hole_that_a_subframe_states_is_a_sheet(tmp_path):
    hole = f'dlo:cutout:radius=0.03\n0 0 0.1\n0 {-0.5 ** 0.5} 0 {0.5 ** 0.5}\n'  # x axis up
    found = read(tmp_path, f's\n* lid\n0 0 1\n{LEVEL}\n{BOX}2\n{hole}lift here\n0 0 0\n{LEVEL}\n.\n'
                 .replace('lift here', 'lift_here'), friction=0.2)
    sheet, = found.obstacles
    assert isinstance(sheet, Sheet) and sheet.thickness == 0.3 and sheet.friction == 0.2
    assert sorted([sheet.width, sheet.height]) == [0.1, 0.2]
    assert found.cutouts == sheet.cutouts and sheet.cutouts[0].radius == 0.03
    np.testing.assert_allclose(sheet.cutouts[0].center, (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(sheet.cutouts[0].normal, (0, 0, 1), atol=1e-12)


def test_a_cone_is_read_as_what_contains_it_and_that_is_said(tmp_path):
    found = read(tmp_path, f's\n* horn\n0 0 0\n{LEVEL}\n1\ncone\n0.1 0.4\n0 0 1\n{LEVEL}\n0 0 0 0\n'
                 '0\n.\n')
    hull, = found.obstacles
    assert 'horn' in found.notes[0] and 'pyramid' in found.notes[0]
    points = hull.points @ hull.pose.rotation.T + hull.pose.position
    assert points[:, 2].min() == pytest.approx(0.8) and points[:, 2].max() == pytest.approx(1.2)
    base = points[points[:, 2] < 1]
    middles = 0.5 * (base + np.roll(base, 1, axis=0))
    assert np.linalg.norm(middles[:, :2], axis=1).min() == pytest.approx(0.1)


@pytest.mark.parametrize(('text', 'said'), [
    ('', 'line 1: expected .* the file ends here: it is cut off'),
    ('s\n* t\n0 0 0\n', "line 3, object 't': expected a pose, .* it is cut off"),
    (f's\n* t\n0 0 0\n{LEVEL}\n{BOX}0\n', "object 't': .* or . at the end, the file ends here"),
    (f's\n* t\n0 0 0\n{LEVEL}\n{BOX}0\nx\n', r"line 12, .*or \. at the end, got 'x'"),
    (f's\n* t\n0,5 0 0\n{LEVEL}\n', "line 3, object 't': .*with a decimal point, got '0,5'"),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\noctree\n', "line 6, .*expected one of sphere, .*octree"),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\nbx\n', 'did you mean box'),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\nsphere\n-1\n', 'expected sizes above 0 of a sphere'),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\nsphere\nnan\n', 'finite numbers'),
    (f's\n* t\n0 0 0\n{LEVEL}\n-1\n', 'expected the number of shapes, got -1'),
    ('s\n* t\n0 0 0\n0 0 0 0\n1\n', 'Pose.quaternion'), ('s\n*\n0 0 0\n', "name after \\*"),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\nplane\n0 0 0 1\n', 'a, b, c of a plane that are not all 0'),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\nmesh\n3 1\n0 0 0 1 0 0 0 1 0\n0 1 3\n', 'indices from 0 to 2'),
    (f's\n* t\n0 0 0\n{LEVEL}\n1\nmesh\n3 1\n0 0 0 1 0 0 0 1 0\n0 1 2\n0 0 0\n{LEVEL}\n0 0 0 0\n0\n'
     '.\n', "line 13, object 't': Mesh is not watertight: 1 triangles have 3 open edges"),
    (f's\n* t\n0 0 0\n{LEVEL}\n{BOX}1\ndlo:cutout:radius=x\n0 0 0\n{LEVEL}\n.\n',
     "subframe 'dlo:cutout:radius=x': expected dlo:friction"),
    (f's\n* t\n0 0 0\n{LEVEL}\n{BOX}1\ndlo:cutout:radius=1\n0 0 0\n{LEVEL}\n.\n',
     "expected its cut-outs straight through its box")])
def test_what_is_wrong_is_named_with_its_line_and_object(tmp_path, text, said):
    with pytest.raises(InvalidTask, match=f'it.scene.*{said}'):
        read(tmp_path, text)


def test_another_encoding_is_named(tmp_path):
    (tmp_path / 'it.scene').write_bytes(b'Zelle\n* T\xfcr\n0 0 0\n')
    with pytest.raises(InvalidTask, match='line 2: expected UTF-8, it is Latin-1'):
        Scene.read(tmp_path / 'it.scene')


def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path):
    Scene(one_of_each()[:8]).write(tmp_path / 'cell.scene')
    text = (tmp_path / 'cell.scene').read_text()
    for end in range(0, len(text) - 2, 977):
        with pytest.raises(InvalidTask):
            read(tmp_path, text[:end])


def test_lengths_in_another_unit(tmp_path):
    one, = read(tmp_path, f's\n* t\n0 0 500\n{LEVEL}\n{BOX}0\n.\n', unit='mm').obstacles
    assert one == Box(Pose((0, 0, 0.5), (0, 0, 0, 1)), np.array((1e-4, 2e-4, 3e-4)))
