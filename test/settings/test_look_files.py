# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Looks from files: columns are told by their names, and what would have to be guessed is not."""

import numpy as np
import pytest
import yaml

from dlo_planner import DirectSimulator, DoubtfulInput, FarEnd, InvalidTask, Pose, Rod
from dlo_planner.settings.looks import Photograph, read_observations

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
POINTS = np.array([[0.2, 0.0, 0.98], [0.5, 0.01, 0.86]])


def look(tmp_path, text, name='seen.csv', unit='m'):
    (tmp_path / name).write_text(text)
    one, = read_observations([tmp_path / name], [LEVEL], unit)
    return one


@pytest.mark.parametrize(('text', 'unit'), [
    ('x,y,z\n0.2,0,0.98\n0.5,0.01,0.86\n', 'm'),
    ('# x,y,z\n0.2,0,0.98\n0.5,0.01,0.86\n', 'm'),
    ('# of a tracker\nX,Y,Z\n\n0.2,0,0.98\n# the second\n0.5,0.01,0.86\n', 'm'),
    ('0.2,0,0.98\n0.5,0.01,0.86\n', 'm'),
    ('0.2 0 0.98\n0.5 0.01 0.86\n', 'm'),
    ('z;x;id;y\n0,98;0,2;left;0\n0,86;0,5;right;1e-2\n', 'm'),
    ('"y","z","x"\n"0","0.98","0.2"\n"0.01","0.86","0.5"\n', 'm'),
    ('x [mm]\ty [mm]\tz (m)\n200\t0\t0.98\n500\t10\t0.86\n', 'm'),
    ('x_mm,y_cm,z\n200,0,98\n500,1,86\n', 'cm'),
    ('x;y;z\n200;0;980\n500,0;10,0;860,0\n', 'mm'),
    ('sep=;\nx;y;z\n0,2;0;0,98\n0,5;0,01;0,86\n', 'm'),  # for Excel
    ('id;x / mm;Y/mm;z mm\n1;200;0;980\n2;500;10;860\n', 'm'),
    ('x,y,z,id\n[mm],[cm],m,\n200,0,0.98,a\n500,1,0.86,b\n', 'm'),  # a line of units
    ('x,y,z\nmm,mm,mm\n200,0,980\n500,10,860\n', 'm'),
    ('tip_x,tip_y,tip_z,tip_w\n0.2,0,0.98,1\n0.5,0.01,0.86,1\n', 'm'),
    ('pose.position.x [mm];pose.position.y;pose.position.z\n200;0;0,98\n500;0,01;0,86\n', 'm'),
    ('x,y,z\n0.2,0,0.98\nnan,NaN,nan\n,,\n0.5,0.01,0.86\n', 'm')])
@pytest.mark.filterwarnings('ignore::dlo_planner.errors.DoubtfulInput')
def test_columns_are_what_they_are_called(tmp_path, text, unit):
    one = look(tmp_path, text, unit=unit)
    np.testing.assert_allclose(one.points, POINTS, atol=1e-12)
    assert one.s is None and one.gripper == LEVEL


def test_what_the_terminal_writes_of_a_shape_is_read_as_its_points(tmp_path):
    from dlo_planner.cli.io import write  # noqa: PLC0415
    shape = DirectSimulator(Rod(1.0, 0.02, 0.05, 0.04)).solve(LEVEL)
    write(shape, [tmp_path / 'wire.csv'])
    one, = read_observations([tmp_path / 'wire.csv'], [LEVEL])
    np.testing.assert_array_equal(one.points, shape.positions)
    np.testing.assert_array_equal(one.s, shape.s)


@pytest.mark.parametrize(('text', 'said'), [
    ('0.1,0.2,0,0.98\n', 'it has 4 columns; say what they are'),
    ('0.1,0.2\n', 'it has 2 columns'),
    ('0,1,0,2,1,0\n', 'decimal comma, columns have to be separated by semicolons'),
    ('x,y,z\n0,2,0,0,98\n', 'line 2: expected 3 columns .* decimal comma'),
    ('x;y;z\n0.2;0;0,98\n', 'decimal points or decimal commas, it has both'),
    ('x,y,z\n0.2,0\n', 'line 2: expected 3 columns as in the first line, x, y, z, got 2'),
    ('x,y,z\n0.2,0,nan\n', "line 2: z = 'nan': expected a finite number"),
    ('x,y,z\n0.2,0,one\n', "line 2: z = 'one'"),
    ('x,y,z\n0.2,0,1_0\n', "line 2: z = '1_0': expected a finite number"),
    ('x,y,z,x\n1,2,3,4\n', "column 'x': expected once"),
    ('x [ft],y,z\n1,2,3\n', 'expected a unit out of m, cm, mm, in'),
    ('x,0.2,z\n1,2,3\n', 'numbers alone, or names of columns alone'),
    ('s,a,b\n1,2,3\n', 'expected columns x, y and z, .* or its pixels u, v, got s, a, b'),
    ('s,xx,y,z\n0.1,0.2,0,1\n', 'expected a column x, .* did you mean x?'),
    ('time,x,y,z\n0,0.2,0,1\n1,0.3,0,1\n', 'column time changes: expected points of a DLO at rest'),
    ('x,y,z\n', 'expected lines of x, y, z'), ('', 'expected lines of x, y, z'),
    ('a.x,a.y,a.z,b_x,b_y,b_z\n1,2,3,4,5,6\n', 'one place in each line, got a.x and b_x'),
    ('a.x,a.y,b.z\n1,2,3\n', 'expected columns x, y and z'),
    ('x,y,z\nnan,nan,nan\n', "line 2: x = 'nan'"),
    ('x,y,z\n0.2,,0.98\n', "line 2: y = ''"),
    ('x,y,z\nmm,ft,mm\n1,2,3\n', r"'y \[ft\]': expected a unit out of m"),
    ('x,y,"z\n1,2,3\n', 'a quote is not closed'),
    (f'x,y,z\n0.2,0,{"1" * 200_000}\n', 'line 2: expected lines of x, y, z, field larger'),
    ('x,y,z\n1_0,2,3\n', "line 2: x = '1_0'")])
@pytest.mark.filterwarnings('ignore::dlo_planner.errors.DoubtfulInput')
def test_what_would_have_to_be_guessed_is_refused(tmp_path, text, said):
    with pytest.raises(InvalidTask, match=f'seen.csv.*{said}'):
        look(tmp_path, text)


def test_a_column_that_is_not_read_is_said(tmp_path):
    with pytest.warns(DoubtfulInput, match="column 'S1' is not read, did you mean s?"):
        look(tmp_path, 'x,y,z,S1\n0.2,0,1,0.2\n')


def test_lines_that_are_left_out_are_said(tmp_path):
    with pytest.warns(DoubtfulInput, match=r'left out as not seen, .*: line 2, 4$'):
        one = look(tmp_path, 's,x,y,z\n0,,,\n0.2,0.2,0,0.98\n0.3,nan,nan,nan\n0.5,0.5,0.01,0.86\n')
    np.testing.assert_allclose(one.points, POINTS)
    np.testing.assert_allclose(one.s, (0.2, 0.5))


@pytest.mark.parametrize('ending', ['.txt', '.dat', '.xyz'])
def test_tables_by_other_endings(tmp_path, ending):
    one = look(tmp_path, '200 0 980\n500 10 860\n', f'seen{ending}', 'mm')
    np.testing.assert_allclose(one.points, POINTS)


def test_points_of_a_scan(tmp_path):
    pytest.importorskip('trimesh')
    head = ('ply\nformat ascii 1.0\nelement vertex 2\n'
            + ''.join(f'property float {axis}\n' for axis in 'xyz') + 'end_header\n')
    one = look(tmp_path, head + '200 0 980\n500 10 860\n', 'seen.ply', 'mm')
    np.testing.assert_allclose(one.points, POINTS, rtol=1e-6)
    with pytest.raises(InvalidTask, match='seen.ply: expected points of a .ply file'):
        look(tmp_path, head + '200 0\n', 'seen.ply')


def test_other_files_are_no_points(tmp_path):
    with pytest.raises(InvalidTask, match=r'seen.pcd: expected a file that ends with .*\.ply'):
        look(tmp_path, '', 'seen.pcd')


def test_two_of_three_axes_are_a_picture(tmp_path):
    with pytest.warns(DoubtfulInput, match='without y, which counts as not measured'):
        one = look(tmp_path, 'z,x,s\n0.98,0.2,0.21\n0.86,0.5,0.53\n')
    np.testing.assert_array_equal(np.abs(one.normal), (0, 1, 0))
    np.testing.assert_array_equal(one.points[:, [0, 2]], POINTS[:, [0, 2]])
    assert one.s.tolist() == [0.21, 0.53]


def test_pixels_of_a_photograph_are_places_beside_its_gripper(tmp_path):
    size, (u, v) = 0.0005, (412.0, 96.0)
    for name, points in (('one.csv', POINTS), ('other.csv', POINTS + [0.1, 0, 0.1])):
        pixels = np.column_stack([u + points[:, 0] / size, v - (points[:, 2] - 1.0) / size])
        np.savetxt(tmp_path / name, pixels, delimiter=',', header='u,v', comments='')
    paths, pictures = [tmp_path / 'one.csv', tmp_path / 'other.csv'], [Photograph(u, v, size)]
    one, other = read_observations(paths, [LEVEL] * 2, photographs=pictures)  # without a warning
    np.testing.assert_allclose(one.points[:, [0, 2]], POINTS[:, [0, 2]], atol=1e-12)
    np.testing.assert_array_equal(one.normal, [0, 1, 0])
    np.testing.assert_allclose(other.points[:, 2] - one.points[:, 2], 0.1, atol=1e-12)
    one, other = read_observations(paths, [LEVEL] * 2, photographs=[
        *pictures, Photograph(u, v, 2 * size)])
    np.testing.assert_allclose(other.points[:, 0], 2 * (POINTS[:, 0] + 0.1), atol=1e-12)
    for wrong in ([], 3 * pictures):
        with pytest.raises(InvalidTask, match=r'--pixels was given [03] times: .* each of the 2'):
            read_observations(paths, [LEVEL] * 2, photographs=wrong)


@pytest.mark.parametrize(('name', 'text', 'said'), [
    ('seen.csv', 'x,y,z\n0,0,1\n', '--pixels was given 1 times: .* each of the 0 tables'),
    ('seen.csv', 'u,v,x\n1,2,0.1\n', 'expected pixels u, v or places, it has x too'),
    ('seen.jpg', '', 'expected points, not the picture: .* --pixels')])
def test_what_is_no_photograph_is_refused(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(InvalidTask, match=said):
        read_observations([tmp_path / name], [LEVEL], photographs=[Photograph(1, 2, 0.001)])


def test_arrays_of_numpy(tmp_path):
    np.save(tmp_path / 'seen.npy', 1e3 * POINTS)
    one, = read_observations([tmp_path / 'seen.npy'], [LEVEL], 'mm')
    np.testing.assert_allclose(one.points, POINTS)
    named = np.zeros(2, dtype=[('id', 'i4'), ('z', 'f4'), ('x', 'f8'), ('y', 'f8'), ('s', 'f8')])
    named['x'], named['y'], named['z'], named['s'] = *POINTS.T, (0.2, 0.5)
    np.save(tmp_path / 'seen.npy', named)
    one, = read_observations([tmp_path / 'seen.npy'], [LEVEL])
    np.testing.assert_allclose(one.points, POINTS, rtol=1e-7)
    assert one.s.tolist() == [0.2, 0.5]
    np.save(tmp_path / 'seen.npy', np.ones((2, 4)))
    with pytest.raises(InvalidTask, match=r'seen.npy has shape \(2, 4\)'):
        read_observations([tmp_path / 'seen.npy'], [LEVEL])
    (tmp_path / 'seen.npy').write_bytes(b'x,y,z')
    with pytest.raises(InvalidTask, match='expected an array of NumPy'):
        read_observations([tmp_path / 'seen.npy'], [LEVEL])


def looks(tmp_path, *contents):
    (tmp_path / 'looks.yaml').write_text(yaml.safe_dump(list(contents)))
    return read_observations([tmp_path / 'looks.yaml'], [])


def test_a_look_says_its_far_end_its_picture_and_its_unit(tmp_path):
    shape = DirectSimulator(Rod(1.0, 0.02, 0.05, 0.04)).solve(LEVEL)
    shape.save(tmp_path / 'before.npz')
    given = {'gripper': [0, 0, 1], 'points': (1e3 * POINTS).tolist(), 's': [200, 530], 'unit': 'mm'}
    place = {'position': {'x': 0.5, 'z': 1.0}}
    found = looks(tmp_path, given, *({**given, 'far_end': end} for end in (
        {'pose': place, 'grip': 'sleeve'}, place, [0.5, 0, 1], [0.5, 0, 1, 0, 0, 0, 1])),
                  {**given, 'normal': [0, 2, 0], 'initial': 'before.npz'})
    for one in found:
        np.testing.assert_allclose(one.points, POINTS)
        np.testing.assert_allclose(one.s, (0.2, 0.53))
    at = Pose((0.5, 0, 1), (0, 0, 0, 1))
    assert [one.far_end for one in found] == [
        None, FarEnd(at, 'sleeve'), FarEnd(at), FarEnd(at, 'pinned'), FarEnd(at), None]
    assert found[-1].normal.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(found[-1].initial.positions, shape.positions)


@pytest.mark.parametrize(('more', 'said'), [
    ({'fare_nd': 1}, r'looks.yaml\[0\].fare_nd: expected one of .*, did you mean far_end?'),
    ({'far_end': {'pose': [0, 0, 1], 'gripp': 'pinned'}}, r'far_end.gripp: .* did you mean grip'),
    ({'far_end': {'grip': 'pinned'}}, r'far_end: expected pose:'),
    ({'far_end': {'pose': [0, 0, 1], 'grip': 'glued'}}, r"far_end: FarEnd.grip = 'glued'"),
    ({'gripper': {'positon': [0, 0, 1]}}, r'gripper.positon: .* did you mean position'),
    ({'gripper': {'position': [0, 0, 1], 'orientation': {'w': 0.0}}}, r'gripper: Pose.quaternion'),
    ({'unit': 'ft'}, r"unit = 'ft'"), ({'points': [[1, 2]]}, r'points has shape \(1, 2\)'),
    ({'initial': 3}, 'initial = 3: expected the name of a file'),
    ({'s': [0.1]}, r'looks.yaml\[0\]: Observation.s')])
def test_what_a_look_does_not_have_is_named(tmp_path, more, said):
    with pytest.raises(InvalidTask, match=said):
        looks(tmp_path, {'gripper': [0, 0, 1], 'points': POINTS.tolist(), **more})


def test_keys_beside_a_list_of_observations_are_refused(tmp_path):
    (tmp_path / 'looks.yaml').write_text('observations: []\nunit: mm\n')
    with pytest.raises(InvalidTask, match=r'looks.yaml.unit: expected one of observations'):
        read_observations([tmp_path / 'looks.yaml'], [])
