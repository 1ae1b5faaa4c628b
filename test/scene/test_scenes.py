# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenes as values: names, cut-outs, lists in YAML, the DLO as capsules."""

import pickle

import numpy as np
import pytest
from cells import difference, one_of_each
from solids import block, stl

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    DoubtfulInput,
    InvalidTask,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
    Workspace,
)
from dlo_planner.model.obstacles import OBSTACLES
from dlo_planner.rods import Piecewise
from dlo_planner.scene import Scene
from dlo_planner.scene.content import moved

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
BALL = Sphere((0, 0, 0), 0.1)


def read(tmp_path, text, name='cell.yaml', **asked):
    (tmp_path / name).write_text(text)
    return Scene.read(tmp_path / name, **asked)


def test_each_obstacle_has_a_name_of_its_own():
    scene = Scene([BALL, Sphere((1, 0, 0), 0.1, name='ball'), BALL])
    assert [one.name for one in scene.obstacles] == ['sphere 0', 'ball', 'sphere 2']
    assert scene['ball'].center[0] == 1
    with pytest.raises(InvalidTask, match="'bal': expected one of the 3 .*, did you mean ball"):
        scene['bal']
    with pytest.raises(InvalidTask, match="2 are called 'ball'"):
        Scene([scene['ball'], scene['ball']])
    both = scene.joined(Scene([scene['ball']]))
    assert both.obstacles[3].name == 'ball (2)'
    assert both.notes == ("another 'ball' is called 'ball (2)'",)


def test_each_kind_of_obstacle_has_an_example():
    assert {*map(type, one_of_each())} == {*OBSTACLES}


def test_a_scene_that_is_moved_is_as_far_from_what_moved_with_it():
    by = Pose((0.3, -0.2, 0.1), np.array((0.1, 0.3, -0.2, 0.9)))
    points = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    for one in one_of_each():
        before, after = (Workspace(keep_out=[body]) for body in (one, moved(one, by)))
        for point in points:
            here = Pose(point, (0, 0, 0, 1))
            assert after.min_margin(by.compose(here))[1] == pytest.approx(
                before.min_margin(here)[1], abs=1e-9)
        larger = Workspace(keep_out=[moved(one, scale=2.0)])
        assert larger.min_margin(Pose(2 * points[0], (0, 0, 0, 1)))[1] == pytest.approx(
            2 * before.min_margin(Pose(points[0], (0, 0, 0, 1)))[1], abs=1e-9)


def test_a_scene_is_a_value():
    scene = Scene(one_of_each())
    assert pickle.loads(pickle.dumps(scene)) == scene == Scene(list(one_of_each()))
    assert repr(scene) == 'Scene(11 obstacles, 2 cut-outs)' and hash(scene) == hash(
        Scene(one_of_each(), notes=['read so']))
    assert scene != Scene(one_of_each()[:4])


def test_cut_outs_are_called_by_their_sheets():
    scene = Scene(one_of_each(), [CutOut(LEVEL)])
    assert scene.cutout_names == ('panel 1/0', 'panel 1/1', 'cut-out 2')
    assert scene.cutout('panel 1/1').width == 0.03
    assert Scene([Sheet.around(CutOut(LEVEL, radius=0.01), name='lid')]).cutout_names == ('lid',)
    with pytest.raises(InvalidTask, match="'panel': expected one of the cut-outs panel 1/0"):
        scene.cutout('panel')
    with pytest.raises(InvalidTask, match='there is none'):
        Scene([BALL]).cutout('panel')


def test_a_hole_that_is_turned_round_leads_back():
    scene = Scene(one_of_each())
    turned = scene.turned('panel 1/0')
    before, after = scene.cutout('panel 1/0'), turned.cutout('panel 1/0')
    np.testing.assert_allclose(after.normal, -before.normal, atol=1e-12)
    np.testing.assert_allclose(after.center, before.center, atol=1e-15)
    assert after in turned['panel 1'].cutouts and turned.cutouts[1] == scene.cutouts[1]


def test_yaml_has_what_was_written(tmp_path):
    scene = Scene(one_of_each(), [CutOut(LEVEL, radius=0.02)])
    scene.write(tmp_path / 'cell.yaml')
    found = Scene.read(tmp_path / 'cell.yaml')
    assert [difference(*both, 1e-15) for both in zip(scene.obstacles, found.obstacles,
                                                     strict=True)] == [''] * 11
    assert found.cutout_names == scene.cutout_names and found.cutouts[2] == scene.cutouts[2]
    with pytest.warns(DoubtfulInput, match='1 cut-outs that are in no sheet are not written'):
        scene.write(tmp_path / 'cell.scene')


def test_files_in_a_list_have_unit_place_friction_and_name(tmp_path):
    part = 's\n* bolt\n0 0 100\n0 0 0 1\n1\nsphere\n10\n0 0 0\n0 0 0 1\n0 0 0 0\n0\n.\n'
    (tmp_path / 'bolt.scene').write_text(part)
    text = '''obstacles:
- box: {name: table, pose: [0, 0, 0.2], size: [1, 1, 0.4]}
- sphere: {center: [0, 0, 1], radius: 0.1, friction: 0}
- file: {path: bolt.scene, unit: mm, pose: [1, 0, 0], friction: 0.7, name: screw}
- file: bolt.scene
'''
    found = read(tmp_path, text, friction=0.4)
    assert [(one.name, one.friction) for one in found.obstacles] == [
        ('table', 0.4), ('sphere 1', 0.0), ('screw', 0.7), ('bolt', 0.4)]
    np.testing.assert_allclose(found['screw'].center, (1, 0, 0.1))
    assert found['screw'].radius == pytest.approx(0.01) and found['bolt'].radius == 10
    alone = read(tmp_path, 'obstacles: {file: bolt.scene}')
    assert [one.name for one in alone.obstacles] == ['bolt']
    (tmp_path / 'two.yaml').write_text('- sphere: {center: [0, 0, 0], radius: 1, name: a}\n'
                                       '- sphere: {center: [0, 0, 0], radius: 2}\n')
    several = read(tmp_path, '- file: {path: two.yaml, name: left}\n- file: two.yaml\n')
    assert [one.name for one in several.obstacles] == ['left/a', 'left/1', 'a', 'sphere 3']


def test_all_triangles_of_a_file_are_one_mesh_where_that_is_said(tmp_path):
    pytest.importorskip('trimesh')
    one, other = block((10, 10, 10)), block((10, 10, 10), (20, 0, 0))
    (tmp_path / 'it.stl').write_bytes(stl(np.concatenate([one[0], other[0]]),
                                          np.concatenate([one[1], other[1] + 8])))
    found = read(tmp_path, '- mesh: {path: it.stl, unit: mm, pose: [0, 0, 1], name: both}',
                 friction=0.3)
    assert len(found['both'].faces) == 24 and found['both'].friction == 0.3
    assert found['both'].pose.position[2] == 1


@pytest.mark.parametrize(('text', 'said'), [
    ('- file: {unit: mm}', r'\[0\]\.file = .*: expected a path'),
    ('- file: {path: cell.yaml}', r'at most 8 files that name each other'),
    ('- mesh: {path: 3, unit: m}', r'mesh\.path = 3: expected the name'),
    ('- mesh: {path: no.stl, unit: m}', r'\[0\]\.mesh: path = .*no.stl'),
    ('- mesh: {path: a.stl, units: m}', r'mesh\.units: expected one of'),
    ('- file: {path: no.scene}', "no.scene': expected a file, there is none"),
    ('- file: {path: a.scene, units: mm}', r'\[0\]\.file\.units: .* did you mean unit'),
    ('- file: {path: a.scene, unit: ft}', r"file\.unit = 'ft'"),
    ('- file: {path: a.scene, joints: 3}', r'file\.joints = 3: expected joints'),
    ('obstacles: []\ncutout: []', r'\.cutout: expected one of obstacles, cutouts'),
    ('cutouts: 3', 'cutouts = 3: expected a list'), ('3', 'expected a list of obstacles'),
    ('- spher: {radius: 1}', 'did you mean sphere')])
def test_what_is_wrong_in_a_list_is_named(tmp_path, text, said):
    with pytest.raises(InvalidTask, match=said):
        read(tmp_path, text)


@pytest.mark.parametrize(('name', 'said'), [
    ('cell.step', 'triangles of it: CAD programs export STL'),
    ('cell.usd', 'its triangles as GLB'), ('cell.sdf', 'URDF or MJCF of it'),
    ('cell.urdf.xacro', 'xacro cell.urdf.xacro > cell.urdf'),
    ('cell.txt', r'ends with one of \.scene \.xml \.mjcf \.urdf \.stl .* \.yaml')])
def test_other_files_are_refused_with_what_would_be_right(tmp_path, name, said):
    with pytest.raises(InvalidTask, match=f'{name}: expected .*{said}'):
        read(tmp_path, '', name)


def test_what_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(InvalidTask, match=r'one of \.scene \.xml \.yaml'):
        Scene([BALL]).write(tmp_path / 'cell.urdf')


@pytest.mark.parametrize('radius', [0.004, Piecewise(lambda s: 0.002 + 0.004 * s, ())])
def test_capsules_contain_the_dlo(radius):
    rod = Rod(0.6, 0.05, 0.02, 0.015, radius=radius, natural_curvature=(0, 9), natural_twist=3)
    shape = DirectSimulator(rod, n_elements=12, n_terms=6).solve(LEVEL)
    scene = Scene([Plane((0, 0, 0), (0, 0, 1))]).with_dlo(shape, 'hose')
    capsules = [one for one in scene.obstacles if isinstance(one, Capsule)]
    assert [one.name for one in capsules] == [f'hose/{k}' for k in range(12)]
    for s in np.linspace(0, 0.6, 241):
        place = shape.at(s).position
        own = float(rod.radii([s])[0])
        room = [one.radius - np.linalg.norm(place - one.start - np.clip(
            (place - one.start) @ (one.end - one.start) / ((one.end - one.start) ** 2).sum(), 0, 1)
            * (one.end - one.start)) for one in capsules]
        assert max(room) >= own - 1e-12
    # and hold no more than a bend of an element asks for
    assert max(one.radius for one in capsules) < 0.0075


def test_a_dlo_without_a_radius_is_no_capsule():
    shape = DirectSimulator(Rod(0.6, 0.05, 0.02, 0.015), n_elements=8, n_terms=4).solve(LEVEL)
    with pytest.raises(InvalidTask, match='expected the shape of a rod with a radius'):
        Scene().with_dlo(shape)


@pytest.mark.parametrize('scene', [
    Scene([obstacle for obstacle in one_of_each()]), Scene([Plane((0, 0, 0.2), (0, 0, 1))]),
    Scene(), Scene((), [CutOut(LEVEL, radius=0.1)])], ids=['all', 'a plane', 'nothing', 'a hole'])
def test_a_scene_is_drawn_in_space(scene):
    pyplot = pytest.importorskip('matplotlib.pyplot')
    pyplot.switch_backend('Agg')
    axes = scene.plot().axes[0]
    assert axes.name == '3d' and len(axes.collections) >= len(scene.obstacles)
    low, high = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).T
    places = [one.center for one in scene.cutouts]
    assert all((low < place).all() and (place < high).all() for place in places)
    own = pyplot.figure().add_subplot(projection='3d')
    assert scene.plot(own) is own.figure
    pyplot.close('all')


def test_a_table_lists_what_there_is():
    lines = Scene(one_of_each(), notes=['mm are assumed']).summary().splitlines()
    assert lines[0] == '11 obstacles, 2 cut-outs' and lines[-1] == 'note: mm are assumed'
    assert lines[1].split() == ['name', 'kind', 'at', '[m]', 'size', '[m]', 'friction']
    assert [line.split('  ')[0] for line in lines[2:13]] == [
        one.name for one in Scene(one_of_each()).obstacles]
    assert lines[7].split()[-6:] == ['1', 'x', '2', 'x', '0.1', '0.5']
    assert 'radius 0.01' in lines[14] and '0.03 x 0.02' in lines[15]
    assert isinstance(Scene(one_of_each())['table'], Box)
