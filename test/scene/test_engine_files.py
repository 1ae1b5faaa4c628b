# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""MJCF and URDF: what collides, where MuJoCo has it; joints, unknown geoms and faults by name."""

import numpy as np
import pytest
from cells import difference, one_of_each
from solids import block, plate, rectangle, stl, torus

from dlo_planner import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Hull,
    InvalidTask,
    Mesh,
    Plane,
    Pose,
    Sheet,
    Sphere,
    Workspace,
)
from dlo_planner.scene import Scene

mujoco = pytest.importorskip('mujoco')

CELL = '''<mujoco model="cell">
  <asset><texture name="wood" type="2d" file="no_such.png"/>
    <material name="wood" texture="wood"/></asset>
  <default><default class="rubber"><geom friction="0.8"/></default></default>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <geom name="glow" type="sphere" size=".3" contype="0" conaffinity="0"/>
    <body name="table" pos="0.5 0 0.3" euler="0 0 30">
      <geom type="box" size="0.5 0.4 0.3" material="wood" friction="1"/></body>
    <body name="lamp" pos="0.2 0.4 0.6">
      <geom type="capsule" fromto="0 0 0 0 0 .4" size="0.02"/>
      <geom name="shade" type="ellipsoid" pos="0 0 .4" size=".1 .1 .05" class="rubber"/></body>
    <geom type="cylinder" size=".1 .2" pos="3 0 0"/>
    <geom type="sphere" size=".1" pos="4 0 0"/>
  </worldbody></mujoco>'''
GRIPPER = '''<?xml version="1.0"?><robot name="gripper">
<link name="palm"><visual><geometry><mesh filename="package://gripper/palm.dae"/></geometry></visual>
  <collision><geometry><box size="0.05 0.1 0.08"/></geometry></collision></link>
<link name="finger"><collision><origin xyz="0.06 0 0"/>
  <geometry><mesh filename="package://gripper/meshes/pad.stl" scale="0.001 0.001 0.001"/></geometry>
  </collision></link>
<link name="tip"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="palm"/><child link="finger"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
<joint name="fixed" type="fixed"><parent link="finger"/><child link="tip"/><origin xyz="0.09 0 0"/>
</joint></robot>'''


def read(tmp_path, text, name='cell.xml', **asked):
    (tmp_path / name).write_text(text)
    return Scene.read(tmp_path / name, **asked)


def geom(text, more=''):
    return f'<mujoco>{more}<worldbody>{text}</worldbody></mujoco>'


def test_a_cell_is_where_mujoco_has_it(tmp_path):
    found = read(tmp_path, CELL, friction=0.25)
    turned = Pose((0.5, 0, 0.3), (0, 0, np.sin(np.pi / 12), np.cos(np.pi / 12)))
    up = (0, 0, 0, 1)
    known = (Plane((0, 0, 0), (0, 0, 1), 0.25, name='floor'),
             Cylinder((3, 0, -0.2), (3, 0, 0.2), 0.1, 0.25, name='cylinder 1'),
             Sphere((4, 0, 0), 0.1, 0.25, name='sphere 2'),
             Box(turned, (1.0, 0.8, 0.6), 1.0, name='table'),
             Capsule((0.2, 0.4, 1.0), (0.2, 0.4, 0.6), 0.02, 0.25, name='lamp/0'),
             Ellipsoid(Pose((0.2, 0.4, 1.0), up), (0.1, 0.1, 0.05), 0.8, name='shade'))
    assert [difference(one, other, 1e-12) for one, other in zip(
        found.obstacles, known, strict=True)] == [''] * 6
    assert found.notes == ('not read: 1 texture', 'not read: what collides with nothing (contype '
                           'and conaffinity 0), 1 geom')


def test_friction_of_included_files_is_known(tmp_path):
    (tmp_path / 'part.xml').write_text('<mujoco><worldbody><geom name="b" size=".1" '
                                       'friction="0.7"/><geom name="c" size=".1"/></worldbody>'
                                       '</mujoco>')
    found = read(tmp_path, geom('<geom name="a" size=".1"/>', '<include file="part.xml"/>'))
    assert {one.name: one.friction for one in found.obstacles} == {'a': 0, 'b': 0.7, 'c': 0}


def test_what_collides_by_a_pair_is_read(tmp_path):
    ball = '<geom name="{}" size=".1" contype="0" conaffinity="0"/>'
    found = read(tmp_path, '<mujoco><worldbody>' + ''.join(map(ball.format, 'abc'))
                 + '</worldbody><contact><pair geom1="a" geom2="b"/></contact></mujoco>')
    assert [one.name for one in found.obstacles] == ['a', 'b']


def distances(path, points):
    """Return MuJoCo's distances (n,) of points from all geoms of a file that are no planes."""
    spec = mujoco.MjSpec.from_file(str(path))
    for k, point in enumerate(points):
        spec.worldbody.add_geom(name=f'probe {k}', type=mujoco.mjtGeom.mjGEOM_SPHERE,
                                size=(1e-6, 0, 0), pos=point)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    probes = [model.geom(f'probe {k}').id for k in range(len(points))]
    others = [k for k in range(model.ngeom) if k not in probes]
    return np.array([min(mujoco.mj_geomDistance(model, data, probe, other, 9.0, None)
                         for other in others) for probe in probes]) + 1e-6


def test_mujoco_has_what_is_written_at_the_same_distance(tmp_path):
    solid = [one for one in one_of_each() if not isinstance(one, Plane | Mesh | Hull)]
    points = np.random.default_rng(0).uniform(-1.5, 2.0, (60, 3))
    for k, one in enumerate(solid):
        path = tmp_path / f'{k}.xml'
        Scene([one]).write(path)
        space = Workspace(keep_out=[one])
        known = np.array([space.min_margin(Pose(point, (0, 0, 0, 1)))[1] for point in points])
        outside = known > 1e-3
        # convex pieces around a round hole are 0.2 % wider than it, an ellipsoid is searched
        np.testing.assert_allclose(distances(path, points)[outside], known[outside], atol=1e-4,
                                   err_msg=repr(one))


def test_what_is_written_is_read_as_it_was(tmp_path):
    scene = Scene(one_of_each())
    scene.write(tmp_path / 'cell.xml')
    found = Scene.read(tmp_path / 'cell.xml')
    within = [1e-7 if isinstance(one, Mesh | Hull) else 1e-14 for one in scene.obstacles]
    assert [difference(*both) for both in zip(scene.obstacles, found.obstacles, within,
                                              strict=True)] == [''] * 11


def test_a_box_with_a_site_as_its_hole_is_a_sheet(tmp_path):
    body = ('<body name="panel" pos="0.8 0 0.9"><geom type="box" size="0.002 0.2 0.3"/>'
            '<site name="{}" type="{}" size="{}" pos="0 0.05 0" {}/></body>')
    for text, sizes in ((body.format('cutout 1', 'cylinder', '0.012 .1', 'euler="0 90 0"'),
                         {'radius': 0.012}),
                        (body.format('a/cutout', 'box', '.1 0.01 0.02', ''),
                         {'width': 0.02, 'height': 0.04})):
        sheet, = read(tmp_path, geom(text)).obstacles
        assert isinstance(sheet, Sheet) and sheet.name == 'panel'
        assert [round(size, 12) for size in (sheet.thickness, sheet.width, sheet.height)] == [
            0.004, 0.4, 0.6]
        hole, = sheet.cutouts
        assert {name: getattr(hole, name) for name in sizes} == sizes
        np.testing.assert_allclose(hole.center, (0.8, 0.05, 0.9), atol=1e-12)
        np.testing.assert_allclose(np.abs(hole.normal), (1, 0, 0), atol=1e-12)
    elsewhere = read(tmp_path, geom(body.format('seam', 'box', '.1 .01 .02', '')))
    assert isinstance(elsewhere['panel'], Box) and elsewhere.cutouts == ()


def test_joints_stand_where_they_are_told_to(tmp_path):
    (tmp_path / 'gripper' / 'meshes').mkdir(parents=True)
    vertices, faces = block((60, 10, 20))
    (tmp_path / 'gripper' / 'meshes' / 'pad.stl').write_bytes(stl(vertices, faces))
    found = read(tmp_path, GRIPPER, 'gripper/it.urdf', joints={'slide': 0.03}, friction=0.4)
    assert [one.name for one in found.obstacles] == ['palm', 'finger', 'tip']
    up = (0, 0, 0, 1)
    assert difference(found['palm'], Box(Pose((0, 0, 0), up), (0.05, 0.1, 0.08), 0.4, name='palm'),
                      1e-12) == ''
    pad = found['finger']
    assert isinstance(pad, Box)  # of its triangles
    np.testing.assert_allclose(pad.pose.position, (0.06, 0.03, 0), atol=1e-8)
    assert sorted(pad.size.round(7).tolist()) == [0.01, 0.02, 0.06]
    np.testing.assert_allclose(found['tip'].center, (0.09, 0.03, 0), atol=1e-12)
    assert found.notes == ('not read: 1 visual, collisions alone are obstacles',)
    for joints, said in ((None, r"nobody says where 1 joint of it stands: 'slide' \(slide, 0 to "
                                r"0\.04 m\)\. Say it by joints={.slide.: 0}, .*slide=0"),
                         ({'slide': 0.05}, r"joints\['slide'\] = 0\.05: expected 0 to 0\.04"),
                         ({'slid': 0.0}, "joints: 'slid': expected one of 'slide', .* mean slide"),
                         ({'slide': [0, 1]}, r"joints\['slide'\] has 2 numbers")):
        with pytest.raises(InvalidTask, match=said):
            read(tmp_path, GRIPPER, 'gripper/it.urdf', joints=joints)
    vertices, faces = block((60, 10, 20))
    (tmp_path / 'gripper' / 'meshes' / 'pad.stl').write_bytes(stl(vertices, faces[1:]))
    with pytest.raises(InvalidTask, match=r"it.urdf: 'finger': Mesh is not .* --hulls"):
        read(tmp_path, GRIPPER, 'gripper/it.urdf', joints={'slide': 0.03})
    hull = read(tmp_path, GRIPPER, 'gripper/it.urdf', joints={'slide': 0.03}, hulls=True)
    assert isinstance(hull['finger'], Hull) and "'finger' is not closed" in hull.notes[-1]
    np.testing.assert_allclose(hull['finger'].pose.position + hull['finger'].points.mean(axis=0),
                               (0.06, 0.03, 0), atol=1e-8)
    (tmp_path / 'gripper' / 'meshes' / 'pad.stl').unlink()
    with pytest.raises(InvalidTask, match=r"mesh 'package://.*pad\.stl': expected a file"):
        read(tmp_path, GRIPPER, 'gripper/it.urdf', joints={'slide': 0.03})
    (tmp_path / 'gripper' / 'meshes' / 'pad.dae').touch()
    with pytest.raises(InvalidTask, match=r'pad\.dae\': expected one of \.stl .* assimp convert'):
        read(tmp_path, GRIPPER.replace('pad.stl', 'pad.dae'), 'gripper/it.urdf',
             joints={'slide': 0.03})


def test_links_without_a_mass_stand_where_they_are(tmp_path):
    text = '''<robot name="r"><link name="base"/><link name="wrist"/><link name="hand">
<inertial><mass value="0"/><inertia ixx="1" iyy="0" izz="0" ixy="0" iyz="0" ixz="0"/></inertial>
<collision><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="wrist"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="fix" type="fixed"><parent link="wrist"/><child link="hand"/><origin xyz="0 0 1"/>
</joint></robot>'''
    ball, = read(tmp_path, text, joints={'turn': np.pi / 2}).obstacles
    assert ball.name == 'hand'
    np.testing.assert_allclose(ball.center, (0, -1, 0), atol=1e-12)


def test_a_joint_that_mimics_another_one_stands_by_it(tmp_path):
    finger = ('<link name="{0}"><collision><geometry><sphere radius="0.01"/></geometry></collision>'
              '</link><joint name="{0}_joint" type="prismatic"><parent link="palm"/>'
              '<child link="{0}"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" '
              'velocity="1"/>{1}</joint>')
    text = '<robot name="r"><link name="palm"/>' + finger.format('left', '') + finger.format(
        'right', '<mimic joint="left_joint" multiplier="-1" offset="0.1"/>') + finger.format(
        'third', '<mimic joint="right_joint"/>') + (
            '<link name="end"/><joint name="end_joint" type="fixed"><parent link="palm"/>'
            '<child link="end"/><mimic joint="left_joint"/></joint></robot>')
    found = read(tmp_path, text, joints={'left_joint': 0.02})
    assert {one.name: one.center[1].round(12) for one in found.obstacles} == {
        'left': 0.02, 'right': 0.08, 'third': 0.08}
    apart = read(tmp_path, text, joints={'left_joint': 0.02, 'right_joint': 0.5})
    assert apart['right'].center[1] == 0.5 and apart['third'].center[1] == 0.5
    with pytest.raises(InvalidTask, match=r"where 1 joint of it stands: 'left_joint' \(slide"):
        read(tmp_path, text)
    with pytest.raises(InvalidTask, match="MuJoCo does not read it: .* 'multiplier'"):
        read(tmp_path, text.replace('"-1" offset', '"x" offset'), joints={'left_joint': 0.0})


def test_a_mesh_is_its_triangles_and_where_it_is_open_its_hull(tmp_path):
    ring, faces = torus(0.1, 0.02, 12, 8)
    text = geom('<geom name="it" type="mesh" mesh="m" pos="1 0 0"/>',
                '<asset><mesh name="m" vertex="{}" {}/></asset>')
    rows = ' '.join(map(str, ring.ravel())), ' '.join(map(str, faces.ravel()))
    found = read(tmp_path, text.format(rows[0], f'face="{rows[1]}"'))
    assert isinstance(found['it'], Mesh) and len(found['it'].faces) == len(faces)
    opened = ' '.join(map(str, faces[1:].ravel()))
    found = read(tmp_path, text.format(rows[0], f'face="{opened}"'))
    assert isinstance(found['it'], Hull)
    assert found.notes == ("'it' is not closed, and read as its convex hull",)
    vertices, sides = plate(rectangle(0.2, 0.1), [], 0.01)
    panel = read(tmp_path, text.format(' '.join(map(str, vertices.ravel())),
                                       f'face="{" ".join(map(str, sides.ravel()))}"'))
    assert isinstance(panel['it'], Box)


@pytest.mark.parametrize(('text', 'said'), [
    ('<mujoco><worldbody><geomm/></worldbody></mujoco>', "MuJoCo does not read it: .*'geomm'"),
    ('<mujoco><worldbody><geom size=".1"/>', 'expected XML, no element found: line 1'),
    ('<sdf/>', r'expected MJCF \(<mujoco>\) or URDF \(<robot>\), got <sdf>'),
    (geom(''), 'expected geoms that collide, it has none'),
    (geom('<geom name="hills" type="hfield" hfield="h"/>',
          '<asset><hfield name="h" nrow="4" ncol="4" size="1 1 1 .1"/></asset>'),
     "geom 'hills' is a height field: expected one of box, .*, sphere; a closed mesh"),
    (geom('<body name="b"><freejoint/><geom size=".1"/></body>'),
     r"'joint 0 of body b' \(free\)"),
    (geom('<body><site name="cutout" type="sphere"/><geom size=".1"/></body>'),
     "site 'cutout' is a sphere: expected a cylinder, or a box"),
    (geom('<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="no.stl"/></asset>'),
     "Error opening file 'no.stl'"),
    ('<robot name="r"><link name="a"><visual/></link></robot>',
     '^[^:]*: expected <collision> in a <link>, it has none, and 1 <visual>')])
def test_what_is_wrong_is_named(tmp_path, text, said):
    with pytest.raises(InvalidTask, match=said if said[0] == '^' else f'cell.xml.*{said}'):
        read(tmp_path, text)


def test_another_encoding_is_named(tmp_path):
    text = '<?xml version="1.0" encoding="UTF-8"?>' + geom('<geom name="T\xfcr" size=".1"/>')
    assert read(tmp_path, text)['T\xfcr']
    (tmp_path / 'cell.xml').write_bytes(text.replace('UTF-8', 'ISO-8859-1').encode('latin-1'))
    with pytest.raises(InvalidTask, match='line 1: expected UTF-8, it is Latin-1'):
        Scene.read(tmp_path / 'cell.xml')


def test_lengths_in_another_unit(tmp_path):
    one, = read(tmp_path, geom('<geom type="box" size="10 20 30" pos="0 0 500"/>'),
                unit='mm').obstacles
    assert difference(one, Box(Pose((0, 0, 0.5), (0, 0, 0, 1)), (0.02, 0.04, 0.06),
                               name='box 0'), 1e-12) == ''
