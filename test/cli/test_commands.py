# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The command `dlo-planner`: what it prints and writes, and with what status it ends."""

import csv
import json
import os
import re
import shlex
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from solids import block, stl

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Limits,
    Plan,
    Plane,
    Pose,
    Rod,
    Shape,
    replay,
)
from dlo_planner.cli.doctor import findings
from dlo_planner.cli.io import read_poses
from dlo_planner.cli.main import BAD_INPUT, FAULT, INTERRUPTED, NO_SOLUTION, main
from dlo_planner.direct.grasp import grasped_at
from dlo_planner.parallel import CapabilityMap
from dlo_planner.results import ValidationReport
from dlo_planner.scene import Scene
from dlo_planner.settings.build import rod_of
from dlo_planner.settings.yaml_files import read_values

COMMANDS = ['cable', 'shape', 'thread', 'plan', 'replay', 'identify', 'map', 'scene', 'doctor']
QUICK = ['-p', 'simulator.n_elements=16', '-p', 'simulator.n_terms=6', '-p', 'rod.diameter=0.0015',
         '-p', 'threading.waypoints=6', '-p', 'threading.deepest=0.3',
         '-p', 'threading.max_misalignment=0']  # obliquely, so few would miss on the way


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(main, [str(one) for one in arguments])


def quick():
    """Return the DirectSimulator that QUICK describes."""
    return DirectSimulator(Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34), n_elements=16, n_terms=6)


@pytest.fixture
def planned():
    result = run('thread', 'copper_wire', *QUICK, '--hole', '0.4,0,1', '--radius', '0.02',
                 '-o', 'plan.npz', '-o', 'plan.csv', '-o', 'way.poses.yaml', '-o', 'way.poses.json')
    assert result.exit_code == 0, result.output
    return result


# ---- shape ----------------------------------------------------------------------------------


def test_a_shape_is_that_of_the_library():
    result = run('shape', 'copper_wire', *QUICK, '-g', '0.1,0,1', '-o', 'wire.npz', '-o',
                 'wire.csv', '-o', 'wire.json', '-o', 'wire.png')
    assert result.exit_code == 0, result.output
    assert 'status' in result.output and 'converged' in result.output
    shape = quick().solve(Pose((0.1, 0, 1), (0, 0, 0, 1)))
    for name in ('wire.npz', 'wire.json'):
        np.testing.assert_allclose(Shape.load(name).positions, shape.positions, atol=1e-9)
    with Path('wire.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 17
    np.testing.assert_allclose([float(rows[-1][key]) for key in 'xyz'], shape.positions[-1],
                               atol=1e-9)
    assert float(rows[-1]['s']) == 1.0
    for names, values in (
            (['tension'], shape.tension[:, None]), (['torque'], shape.torque[:, None]),
            (['shear_n', 'shear_b'], shape.shear),
            (['moment_n', 'moment_b'], shape.bending_moment)):
        np.testing.assert_allclose([[float(row[name]) for name in names] for row in rows], values,
                                   atol=1e-9)
    assert Path('wire.png').read_bytes().startswith(b'\x89PNG')


def test_the_dlo_follows_several_poses_also_from_a_file():
    Path('way.yaml').write_text('- {position: [0, 0, 1], orientation: {y: 0.6, w: 0.8}}\n'
                                '- [0, 0, 0.9, 1, 0, -1]\n')
    result = run('shape', 'copper_wire', *QUICK, '--grippers', 'way.yaml', '-o', 'last.npz')
    assert result.exit_code == 0, result.output
    assert read_poses(Path('way.yaml'))[0].quaternion.tolist() == [0.0, 0.6, 0.0, 0.8]
    gripper = Shape.load('last.npz').gripper
    np.testing.assert_allclose(gripper.matrix, Pose.looking_along((0, 0, 0.9), (1, 0, -1)).matrix,
                               atol=1e-12)


def test_obstacles_are_read_and_touched():
    Path('table.yaml').write_text('- plane: {point: [0, 0, 0.9], normal: [0, 0, 1]}\n'
                                  '- sphere: {center: [9, 0, 0], radius: 0.1}\n'
                                  '- capsule: {start: [9, 1, 0], end: [9, 2, 0], radius: 0.1}\n'
                                  '- box: {pose: [9, 5, 0], size: [1, 1, 1], friction: 0.2}\n')
    result = run('shape', 'copper_wire', *QUICK, '-g', '0,0,1', '--obstacles', 'table.yaml')
    assert result.exit_code == 0, result.output
    assert 'largest contact force' in result.output
    Path('bad.yaml').write_text('- sphere: {center: [9, 0, 0]}\n')
    result = run('shape', 'copper_wire', '-g', '0,0,1', '--obstacles', 'bad.yaml')
    assert result.exit_code == BAD_INPUT and 'bad.yaml[0].sphere: expected radius' in result.output


SHEET = '''obstacles:
- box: {pose: [9, 5, 0], size: [1, 1, 1]}
- sheet: {name: panel, pose: [0.4, 0, 1], width: 0.3, height: 0.2, thickness: 0.004,
          cutouts: [{pose: [0.4, 0, 1], radius: 0.02}]}
'''


def test_a_scene_is_listed_and_written():
    Path('cell.yaml').write_text(SHEET)
    result = run('scene', 'cell.yaml', '--friction', '0.3', '-o', 'cell.scene', '-o', 'cell.xml',
                 '-o', 'cell.png')
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert Path('cell.png').stat().st_size > 10_000
    assert lines[0] == '2 obstacles, 1 cut-out'
    assert lines[2].split() == ['box', '0', 'Box', '9', '5', '0', '1', 'x', '1', 'x', '1', '0.3']
    assert lines[5].split() == ['panel', '0.4,0,1,1,0,0', 'radius', '0.02']
    again = run('scene', 'cell.scene', '--scene-unit', 'mm', '--scene-at', '0,0,0.5')
    assert 'box 0  Box    0.009 0.005 0.5  0.001 x 0.001 x 0.001' in again.output
    Path('it.stl').write_bytes(stl(*block((1000, 1000, 20), (0, 0, 890))))
    result = run('shape', 'copper_wire', *QUICK, '-g', '0,0,1', '--scene', 'it.stl', '-o',
                 'wire.scene')
    assert result.exit_code == 0 and 'largest contact force' in result.output, result.output
    assert 'it.stl: 1 obstacle, 0 cut-outs' in result.output
    assert 'note: it.stl states no unit: mm are assumed' in result.output
    assert run('scene', 'wire.scene').output.startswith('16 obstacles, 0 cut-outs')
    unknown = run('thread', 'copper_wire', '--scene', 'wire.scene', '--hole', 'panel')
    assert unknown.exit_code == BAD_INPUT and "--hole = 'panel': expected" in unknown.output
    assert len(Scene.read('wire.scene').obstacles) == 16


def test_a_scene_that_is_not_understood_is_bad_input():
    Path('arm.xml').write_text('<mujoco><worldbody><body><joint name="a b" type="hinge"/>'
                               '<geom size=".1"/></body></worldbody></mujoco>')
    for given, said in ((['arm.xml'], '--joint "a b=0"'),
                        (['arm.xml', '--joint', 'a b'], "--joint 'a b': expected NAME=VALUE"),
                        (['arm.xml', '-o', 'it.stl'], '.svg .pdf .scene .xml .yaml')):
        result = run('scene', *given)
        assert result.exit_code == BAD_INPUT and said in result.output, result.output
    assert run('scene', 'arm.xml', '--joint', 'a b=0.1').exit_code == 0


def test_a_hole_is_meant_by_its_name_from_both_sides():
    Path('cell.yaml').write_text(SHEET)
    quick = [*QUICK, '--scene', 'cell.yaml', '-o', 'plan.csv']
    for hole, side in (('panel', -1), ('panel:back', 1)):
        result = run('thread', 'copper_wire', *quick, '--hole', hole)
        assert result.exit_code == 0 and 'clearance' in result.output, result.output
        with open('plan.csv', encoding='utf-8') as file:
            row = next(csv.DictReader(file))
        assert np.sign(float(row['x']) - 0.4) == side and float(row['clearance']) > 0.01
    result = run('thread', 'copper_wire', *quick, '--hole', 'panl')
    assert result.exit_code == BAD_INPUT and 'did you mean panel?' in result.output


def test_the_file_of_the_parameters_counts_as_well():
    Path('floor.yaml').write_text('- plane: {point: [0, 0, 0.9], normal: [0, 0, 1]}\n')
    result = run('shape', 'copper_wire', *QUICK, '-g', '0,0,1', '-p', 'scene.file=floor.yaml',
                 '-p', 'obstacles.friction=0.3')
    assert result.exit_code == 0 and 'largest contact force' in result.output


def test_a_held_far_end():
    result = run('shape', 'copper_wire', *QUICK, '-g', '0,0,1', '--far-end', '0.8,0,1', '-o',
                 'held.npz')
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(Shape.load('held.npz').positions[-1], (0.8, 0, 1), atol=1e-6)


def test_out_of_reach_is_no_solution():
    result = run('shape', 'copper_wire', *QUICK, '-g', '0,0,1', '--far-end', '1.8,0,1')
    assert result.exit_code == NO_SOLUTION
    assert 'out of reach' in result.output


# ---- thread, replay -------------------------------------------------------------------------


def test_a_plan_is_written_as_poses_and_as_a_table(planned):
    plan = Plan.load('plan.npz')
    assert len(plan) == 6
    poses = yaml.safe_load(Path('way.poses.yaml').read_text())
    assert poses == json.loads(Path('way.poses.json').read_text())
    assert len(poses) == 6
    for known, gripper in zip(poses, plan.grippers, strict=True):
        assert [known['position'][key] for key in 'xyz'] == gripper.position.tolist()
        assert [known['orientation'][key] for key in 'xyzw'] == gripper.quaternion.tolist()
    with Path('plan.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [float(row['time']) for row in rows] == plan.times.tolist()
    assert 'stability' in planned.output


def test_a_plan_is_proved(planned):
    result = run('replay', 'copper_wire', 'plan.npz', *QUICK, '-o', 'report.json', '-o',
                 'report.csv')
    assert result.exit_code == 0, result.output
    report = ValidationReport.load('report.json')
    assert report.safe and report.trajectory is not None
    assert re.search(r'safe +yes', result.output)
    with Path('report.csv').open(newline='') as file:
        said = {row['quantity']: row['value'] for row in csv.DictReader(file)}
    assert float(said['stability']) == pytest.approx(report.stability, rel=1e-3)


def test_both_ends_are_carried():
    Path('carry.yaml').write_text(
        '{type: Carry, to: [0, 0.1, 0.6], far_end_to: [0.35, 0.15, 0.6], '
        'far_end: {pose: [0.35, 0, 0.6]}, max_force: 20}', encoding='utf-8')
    result = run('plan', 'rubber_hose', 'carry.yaml', '--start', '0,0,0.6', '--prove', '-o',
                 'carried.csv', '-o', 'carried.npz')
    assert result.exit_code == 0, result.output
    assert re.search(r'far_end, last +0.35, 0.15, 0.6 +m', result.output)
    assert re.search(r'force of a grip +[0-9.]+ +N', result.output)
    assert 'push into the bore' not in result.output and re.search(r'safe +yes', result.output)
    with Path('carried.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    for k, y in ((0, 0.0), (-1, 0.15)):
        assert float(rows[k]['far_end y']) == pytest.approx(y, abs=1e-9)
    assert max(float(row['far_end vy']) for row in rows) > 0.05
    refused = run('plan', 'rubber_hose', 'carry.yaml', '--start', '0,0,0.6', '-p', 'rod.length=0.3')
    assert refused.exit_code == NO_SOLUTION and 'the DLO would be too short' in refused.output


def test_hand_over_hand_each_stage_is_proved_and_written():
    Path('grasps.yaml').write_text(
        '{type: ThreadInGrasps, length: 0.2, hold_at: 0.8, cutout: {pose: [0, 0, 1], radius: 0.02}'
        ', feed: [-0.7, 0, 0.9, 1, 0, -0.5]}', encoding='utf-8')
    result = run('plan', 'copper_wire', 'grasps.yaml', '-p', 'threading.waypoints=12', '--prove',
                 '-o', 'grasps.npz', '-o', 'motion.csv')
    assert result.exit_code == 0, result.output
    plan = Plan.load('grasps.npz')
    assert [stage.name for stage in plan.stages] == [
        'thread', 'hand over 1', 'second alone 1', 'pull 1']
    said = [line for line in result.output.splitlines() if line in (
        'thread:', 'close second at s = 0.9 m', 'hand over 1:', 'open first at s = 0.8 m',
        'second alone 1:', 'close first at s = 0.75 m', 'pull 1:')]
    assert len(said) == 7 and said[1].startswith('close') and said[3].startswith('open')
    assert len(re.findall(r'safe +yes', result.output)) == 3
    assert [path.name for path in sorted(Path().glob('motion*'))] == [
        f'motion_{k}.csv' for k in (1, 2, 4)]
    with Path('motion_4.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]['second x']) - float(rows[0]['second x']) == pytest.approx(0.05, abs=0.02)
    again = run('replay', 'copper_wire', 'grasps.npz', '-o', 'report.npz')
    assert again.exit_code != 0 and 'expected none for a plan with 4 stages' in again.output


def test_a_plug_is_inserted():
    Path('plug.yaml').write_text(
        '{type: InsertPlug, socket: {position: [-0.2, 0, 0.6], quaternion: [0, 0, 1, 0]}, '
        'plug: {length: 0.05, radius: 0.01, mass: 0.1}, depths: [0, 0.02], '
        'far_end: {pose: [0.25, 0, 0.6]}}', encoding='utf-8')
    result = run('plan', 'rubber_hose', 'plug.yaml', '--start', '0,0,0.6', '-o', 'plug.npz')
    assert result.exit_code == 0, result.output
    assert re.search(r'stages +approach, insert', result.output)
    assert re.search(r"force at the plug's front +[0-9.]+ +N", result.output)
    plan = Plan.load('plug.npz')
    assert plan.plug.mass == 0.1 and np.isfinite(plan.plug_wrenches).all()
    refused = run('plan', 'rubber_hose', 'plug.yaml', '--start', '0,0,0.6', '-p', 'rod.length=0.3')
    assert refused.exit_code == NO_SOLUTION and 'the cable would be too short' in refused.output


def test_a_plan_that_leaves_the_workspace_is_not_safe(planned):
    result = run('replay', 'copper_wire', 'plan.npz', *QUICK, '-p', 'workspace.upper=[-9, 9, 9]')
    assert result.exit_code == NO_SOLUTION
    assert re.search(r'safe +no', result.output)
    assert 'beyond its workspace' in result.output


def test_what_cannot_be_threaded_says_where_and_why():
    result = run('thread', 'copper_wire', '--hole', '0,0,1')
    assert result.exit_code == NO_SOLUTION
    assert '(stability, by 0.24' in result.output


def test_it_may_begin_at_the_gripper():
    result = run('thread', 'copper_wire', *QUICK, '-p', 'threading.standoff=0.05', '--hole',
                 '0.4,0,1', '--start', '-0.9,0.1,1', '-o', 'plan.npz')
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(Plan.load('plan.npz').grippers[0].position, (-0.9, 0.1, 1))


@pytest.mark.every(2)
@pytest.mark.parametrize('stated', [('--hold-at', '0.4'), ('-p', 'rod.grasped_at=0.4')])
def test_it_is_held_where_that_is_stated(stated):
    result = run('thread', 'copper_wire', *QUICK, '--hole', '0.4,0,1', '--radius', '0.02', *stated,
                 '-o', 'plan.npz', '-p', 'threading.standoff=0.05', '--start', '-0.4,0.1,1')
    assert result.exit_code == 0, result.output
    assert re.search(r'held, from its beginning +0.4 +m', result.output)
    plan = Plan.load('plan.npz')
    assert all(grasped_at(shape) == 0.4 for shape in plan.shapes)
    assert plan.depths[-1] == pytest.approx(0.3 * 0.6)
    known = InverseSimulator(quick()).thread(CutOut(Pose.looking_along(
        (0.4, 0, 1), (1, 0, 0)), radius=0.02), depths=np.linspace(0, 0.18, 6), hold_at=0.4,
        start=Pose.looking_along((-0.4, 0.1, 1), (1, 0, 0)))
    np.testing.assert_allclose([pose.matrix for pose in plan.grippers[-6:]],
                               [pose.matrix for pose in known.grippers], atol=1e-9)
    if stated[0] == '-p':
        result = run('shape', 'copper_wire', '-g', '0,0,1', *stated)
        assert result.exit_code == 0 and re.search('held, .* 0.4 ', result.output)
    else:
        result = run('replay', 'copper_wire', 'plan.npz', *QUICK)
        assert 'converged                        yes' in result.output


@pytest.mark.parametrize(('arguments', 'said'), [
    (('thread', 'copper_wire', '--hole', '0,0,1', '--hold-at', '1'), '--hold-at = 1.0: expected'),
    (('thread', 'copper_wire', '--hole', '0,0,1', '--hole', '1,0,1', '--hold-at', '0.4'),
     'rod.grasped_at = 0.4: expected 0 for the plan of a ThreadTwo'),
    (('thread', 'copper_wire', '--hole', '0,0,1', '--hole', '1,0,1', '--max-misalignment', '0.4'),
     '--max-misalignment: expected one --hole with it'),
    (('thread', 'copper_wire', '--hole', '0,0,1', '--margin', '0.001'),
     '--margin: expected --radius with it'),
    (('shape', 'copper_wire', '-g', '0,0,1', '--far-end', '0.5,0,1', '-p', 'rod.grasped_at=0.4'),
     'rod.grasped_at = 0.4: expected 0 for --far-end'),
    (('shape', 'copper_wire', '-g', '0,0,1', '-p', 'rod.grasped_at=1'),
     'parameter rod.grasped_at = 1.0: expected a finite number > 0 and < 1'),
    (('map', 'copper_wire', '--x', '0.5', '--z', '1', '--radius', '0.1', '-p',
      'rod.grasped_at=0.4'), 'rod.grasped_at = 0.4: expected 0 for map')])
def test_what_an_option_cannot_ask_for_is_refused_by_name(arguments, said):
    result = run(*arguments)
    assert result.exit_code == BAD_INPUT and said in result.output, result.output


def test_several_holes_are_passed():
    result = run('thread', 'copper_wire', *QUICK, '--hole', '0,0,1', '--hole', '0.2,0,1', '-o',
                 'plan.npz')
    assert result.exit_code == 0, result.output
    assert len(Plan.load('plan.npz').via_points[-1]) == 2


def test_any_task_is_planned_from_its_file():
    text = re.search(r'insert.yaml:\n((?:    .*\n)+)', run('plan', '--help').output)[1]
    Path('insert.yaml').write_text(text)
    result = run('plan', 'copper_wire', 'insert.yaml', *QUICK, '-o', 'plan.npz')
    assert result.exit_code == 0, result.output
    assert Plan.load('plan.npz').depths.tolist() == [0, 0.02, 0.04, 0.06]
    Path('insert.yaml').write_text(text.replace('bore', 'boar'))
    result = run('plan', 'copper_wire', 'insert.yaml', *QUICK)
    assert result.exit_code == BAD_INPUT and 'boar: expected one of bore' in result.output


# ---- cable, identify, map -------------------------------------------------------------------


def test_what_is_identified_is_a_file_for_the_next_command():
    true = Rod.circular(1.0, 1.5e-3, 8960.0, 1.2 * 110e9, 0.34)
    simulator = DirectSimulator(true, n_elements=64)
    looks = [Pose((0, 0, 1), (0, 0, 0, 1)), Pose.looking_along((0, 0, 1), (1, 0, 1))]
    Path('looks.yaml').write_text(yaml.safe_dump([
        {'gripper': {'position': one.position.tolist(), 'orientation': one.quaternion.tolist()},
         'points': simulator.solve(one).positions[8::8].tolist()} for one in looks[:1]]))
    np.savetxt('seen.csv', simulator.solve(looks[1]).positions[8::8], delimiter=',',
               header='x,y,z', comments='')
    result = run('identify', 'copper_wire', 'looks.yaml', 'seen.csv', '-g', '0,0,1,1,0,1', '-p',
                 'rod.diameter=0.0015', '--find', 'bending_stiffness', '-o', 'found.yaml', '-o',
                 'fit.png')
    assert result.exit_code == 0, result.output
    assert 'expected two pixels' in run('identify', 'copper_wire', 'seen.csv', '-g', '0,0,1',
                                        '--pixels', '1,2,0').output
    assert Path('fit.png').read_bytes().startswith(b'\x89PNG')
    assert re.search(r'bending_stiffness\[0\] +0\.03', result.output)
    assert run('shape', 'found.yaml', '-g', '0,0,1', '-o', 'again.npz').exit_code == 0
    np.testing.assert_allclose(Shape.load('again.npz').positions[-1],
                               simulator.solve(looks[0]).positions[-1], atol=1e-3)


def test_points_that_no_such_dlo_has_are_not_explained():
    assert run('shape', 'copper_wire', '-g', '0,0,1', '-o', 'wire.csv').exit_code == 0
    with Path('wire.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    swapped = [[row['x'], row['z'], row['y']] for row in rows]
    Path('swapped.csv').write_text('\n'.join(['x,y,z', *map(','.join, swapped)]))
    given = ['-g', '0,0,1', '--find', 'bending_stiffness', '-o', 'found.yaml']
    result = run('identify', 'copper_wire', 'swapped.csv', *given)
    assert result.exit_code == NO_SOLUTION
    assert 'does not explain the points' in result.output and 'check the axes' in result.output
    assert not Path('found.yaml').exists()
    # what the terminal writes of a shape is read by its heading, s first
    result = run('identify', 'copper_wire', 'wire.csv', *given)
    assert result.exit_code == 0 and re.search(r'misfit +[0-9.]+e-1', result.output)
    assert Path('found.yaml').exists()


def test_doubts_are_said_whatever_python_was_told_of_warnings():
    Path('seen.csv').write_text('x,y,z,S1\n0.2,0,1,0.2\n')
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        result = run('identify', 'copper_wire', 'seen.csv', '-g', '0,0,1', '--noise', '-1')
    assert result.output.count("warning: seen.csv, line 1: column 'S1' is not read") == 1


def test_grams_for_kilograms_are_doubted():
    result = run('cable', '--diameter', '0.006', '--mass-per-length', '45', '--length', '0.5',
                 '--sag', '0.12', '-o', 'my.yaml')
    assert result.exit_code == 0 and result.output.count('warning: rod: density 1.59e+06') == 1
    result = run('shape', 'my.yaml', '-g', '0,0,1')
    assert result.output.count('warning: rod: density 1.59e+06') == 1


@pytest.mark.parametrize('limpness', [0.5, 4.0, 40.0])
def test_a_cable_hangs_down_by_its_sag(limpness):
    def level(s, y):  # the elastica: d^2 theta / du^2 = limpness (1 - u) cos theta, s = L u
        return [y[1], limpness * (1 - s) * np.cos(y[0]), np.sin(y[0])]

    def moment_at_the_end(start):
        return solve_ivp(level, (0, 1), [0, start, 0], rtol=1e-10, atol=1e-12).y[1, -1]

    start = brentq(moment_at_the_end, -limpness, 0)
    sag = -0.4 * solve_ivp(level, (0, 1), [0, start, 0], rtol=1e-10, atol=1e-12).y[2, -1]
    given = ['cable', '--diameter', '0.006', '--mass-per-length', '0.05', '--length', '0.4', '-o',
             'my.yaml']
    result = run(*given, '--sag', sag)
    assert result.exit_code == 0, result.output
    rod = rod_of(read_values('my.yaml')[0])
    assert rod.bending_stiffness[0] == pytest.approx(0.05 * 9.81 * 0.4**3 / limpness, rel=1e-3)
    assert rod.torsional_stiffness == pytest.approx(0.75 * rod.bending_stiffness[0])
    assert (rod.length, rod.mass_per_length, rod.radius) == (0.4, 0.05, 0.003)
    for wrong in (-0.1, 0.41):
        refused = run(*given, '--sag', wrong)
        assert refused.exit_code == BAD_INPUT and '--sag' in refused.output


def test_points_need_their_gripper():
    Path('seen.csv').write_text('x,y,z\n0.1,0,1\n')
    result = run('identify', 'copper_wire', 'seen.csv')
    assert result.exit_code == BAD_INPUT and '--gripper' in result.output
    Path('seen.csv').write_text('x,y,z\n0.1,0\n')
    result = run('identify', 'copper_wire', 'seen.csv', '-g', '0,0,1')
    assert result.exit_code == BAD_INPUT and 'x, y, z' in result.output


def test_a_map_has_a_line_for_each_cutout():
    result = run('map', 'copper_wire', *QUICK, '--x', '0.3:0.5:2', '--z', '1', '--radius', '0.02',
                 '--along', '1,0,0', '--along', '0,0,1', '-o', 'map.csv', '-o', 'map.png')
    assert result.exit_code == 0, result.output
    with Path('map.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [(float(row['x']), float(row['direction_z'])) for row in rows] == [
        (0.3, 0.0), (0.3, 1.0), (0.5, 0.0), (0.5, 1.0)]
    threaded = [row['outcome'] == 'threaded' for row in rows]
    assert threaded[0] and threaded[2]
    assert re.search(rf'threaded +{sum(threaded)} +cut-outs', result.output)


def test_a_map_of_nothing_is_no_solution():
    result = run('map', 'copper_wire', *QUICK, '-p', 'workspace.lower=[5, 5, 5]', '-p',
                 'workspace.upper=[6, 6, 6]', '--x', '0.3', '--z', '1', '--radius', '0.02')
    assert result.exit_code == NO_SOLUTION
    assert 'workspace' in result.output


# ---- doctor ---------------------------------------------------------------------------------


def test_the_doctor_names_what_is_missing_and_what_to_do(monkeypatch):
    from importlib.util import find_spec  # noqa: PLC0415
    monkeypatch.setattr('dlo_planner.cli.doctor.find_spec',
                        lambda name: None if name in ('viser', 'rclpy') else find_spec(name))
    said = {one.name: one for one in findings()}
    assert said['numpy'].state == 'ok'
    assert said['extra view'].state == 'note'
    assert said['extra view'].remedy == "pip install 'dlo_planner[view]'"
    assert said['ROS'].state == 'note' and 'setup.bash' in said['ROS'].remedy
    assert 'copper_wire' in said['DLOs by name'].found
    assert 'kernels' in said['compiled kernels'].name


def test_the_doctor_ends_badly_where_something_is_bad(monkeypatch):
    monkeypatch.setattr('dlo_planner.cli.doctor._ros', lambda: None)
    monkeypatch.setattr('dlo_planner.cli.doctor.findings', lambda: iter(list(findings())[:5]))
    assert run('doctor').exit_code == 0
    monkeypatch.setattr('dlo_planner.cli.doctor._NEEDED', {'numpy': (99, 0), 'nonsense': (1, 0)})
    result = run('doctor')
    assert result.exit_code == NO_SOLUTION
    assert 'pip install --upgrade "numpy>=99.0"' in result.output
    assert 'pip install nonsense' in result.output


# ---- all of them ----------------------------------------------------------------------------


@pytest.mark.parametrize(('arguments', 'named'), [
    (['shape', 'bamboo', '-g', '0,0,1'], 'copper_wire, rubber_hose'),
    (['shape', 'copper_wire'], '--gripper'),
    (['shape', 'copper_wire', '-g', '0,0'], '3, 6 or 7 numbers'),
    (['shape', 'copper_wire', '-g', 'a,b,c'], 'X,Y,Z'),
    (['shape', 'copper_wire', '-g', '0,0,nan'], 'gripper'),
    (['shape', 'copper_wire', '-g', '0,0,1', '-p', 'rod.lenght=1'], 'rod.length'),
    (['shape', 'copper_wire', '-g', '0,0,1', '-p', 'rod.diameter=-1'], 'rod.diameter'),
    (['shape', 'copper_wire', '-g', '0,0,1', '-o', 'wire.txt'], 'wire.txt'),
    (['shape', 'copper_wire', '-g', '0,0,1', '-o', 'nowhere/wire.npz'], 'nowhere'),
    (['thread', 'copper_wire'], '--hole'),
    (['map', 'copper_wire', '--x', '1:2', '--z', '1', '--radius', '0.1'], 'FIRST:LAST:COUNT'),
    (['nonsense'], 'nonsense')])
def test_bad_input_is_named(arguments, named):
    result = run(*arguments)
    assert result.exit_code == BAD_INPUT, result.output
    assert named in result.output
    assert 'residual' not in result.output  # refused before anything is computed
    assert not list(Path().iterdir())


def test_a_file_that_holds_something_else():
    quick().solve(Pose((0, 0, 1), (0, 0, 0, 1))).save('shape.npz')
    result = run('replay', 'copper_wire', 'shape.npz')
    assert result.exit_code == BAD_INPUT and 'holds a Plan, it holds a Shape' in result.output


def examples():
    """Yield the examples that the helps show, as lists of arguments."""
    for name in (None, *COMMANDS):
        text = run(*([name] if name else []), '--help').output.replace('\\\n', ' ')
        for line in re.findall(r'^ +dlo-planner (.*)', text, re.MULTILINE):
            arguments = shlex.split(re.split(r'  {3,}[a-z]', line)[0])
            if 'COMMAND' not in arguments:
                yield name, arguments


def test_every_help_has_examples_that_are_right():
    for name in ('my_cable.yaml', 'table.yaml', 'plan.npz', 'seen.csv', 'looks.yaml',
                 'insert.yaml', 'cell.scene', 'cell.xml', 'fixture.stl', 'gripper.urdf',
                 'panel.stl', 'photo.csv'):
        Path(name).touch()
    shown = list(examples())
    assert {name for name, _ in shown} == {None, *COMMANDS}
    for _, (name, *arguments) in shown:
        command = main.get_command(None, name)
        command.make_context(name, arguments)  # it would raise a UsageError


SOFT = ['-p', 'rod.diameter=0.0007', '-p', 'rod.length=1.0']


def test_an_oblique_plan_and_what_would_help():
    wire = ['thread', 'copper_wire', *SOFT, '-p', 'threading.waypoints=12',
            '--hole', '0,0,1,1,0,-0.5', '--radius', '0.02']
    oblique = run(*wire)
    assert oblique.exit_code == 0, oblique.output
    assert float(re.search(r'misalignment +([\d.e-]+) +deg', oblique.output)[1]) > 10
    assert re.search(r'margin +[\d.e-]+ +m\n', oblique.output)
    assert 'note: margin' not in oblique.output
    narrow = run('thread', 'rubber_hose', '--hole', '0,0,1', '--radius', '0.012')
    assert narrow.exit_code == 0, narrow.output
    assert re.search(r'margin +-[\d.e-]+ +m\n', narrow.output)
    assert 'note: margin is the clearance less two deviations' in narrow.output
    along = run(*wire, '--max-misalignment', '0')
    assert along.exit_code == NO_SOLUTION and 'stability' in along.output
    wide = run('thread', 'rubber_hose', '--hole', '0,0,1', '--radius', '0.012', '--margin', '0.05',
               '--max-misalignment', '0')
    assert wide.exit_code == NO_SOLUTION and 'margin = 0.05 m' in wide.output
    up = run('thread', 'copper_wire', *SOFT, '--hole', '0,0,1,1,0,0.6', '--radius', '0.02')
    assert up.exit_code == NO_SOLUTION
    assert re.search(r'it would pass if held at most [\d.]+ m from its end', up.output)
    for option, value in (('--max-misalignment', '2'), ('--margin', '-1'), ('--margin', '0')):
        wrong = run(*wire, option, value)
        assert wrong.exit_code == BAD_INPUT and option in wrong.output


def test_exit_codes_are_told():
    assert '2  bad input' in run('--help').output and '3  no solution' in run('--help').output
    for name in ('shape', 'thread', 'plan', 'replay', 'identify', 'map'):
        assert 'Exit code 3:' in run(name, '--help').output
    assert '0.1.0' in run('--version').output


# ---- what nobody expected ---------------------------------------------------------------------


@pytest.mark.parametrize('error', [KeyError('inside'), ValueError('a\nb'), RecursionError('deep'),
                                   MemoryError(), AssertionError()])
def test_an_unexpected_error_is_a_line(monkeypatch, error):
    def broken(*_):
        raise error

    monkeypatch.setattr('dlo_planner.cli.commands.checked', broken)
    result = run('shape', 'copper_wire', '-g', '0,0,1')
    assert result.exit_code == FAULT and 'Traceback' not in result.output
    first, second = result.output.splitlines()
    assert first.startswith(f'Error: unexpected {type(error).__name__}:')
    assert '--traceback' in second
    for told in ({'args': ['--traceback']}, {'env': {'DLO_PLANNER_TRACEBACK': '1'}}):
        shown = CliRunner().invoke(main, [*told.get('args', []), 'shape', 'copper_wire', '-g',
                                          '0,0,1'], env=told.get('env'))
        assert shown.exception is error


def test_a_file_that_cannot_be_written_and_an_interrupt_are_no_faults(monkeypatch):
    def raising(error):
        def broken(*_):
            raise error

        monkeypatch.setattr('dlo_planner.cli.commands.checked', broken)
        return run('shape', 'copper_wire', '-g', '0,0,1')

    full = raising(OSError(28, 'No space left on device', 'wire.npz'))
    assert full.exit_code == BAD_INPUT and full.output.count('\n') == 1
    assert 'wire.npz' in full.output
    stopped = raising(KeyboardInterrupt())
    assert stopped.exit_code == INTERRUPTED and stopped.output == ''


@pytest.mark.parametrize('changes', [
    'rod.yield_curvature=[1.0]', 'rod.bending_stiffness=[1, 2, 3]', 'rod.damping=[1.0]',
    'rod.natural_curvature=[1.0]', 'gravity=[1.0]', 'workspace.lower=[1.0]',
    'rod.natural_curvature_terms=[1.0]'])
def test_lists_of_another_length_are_refused_by_name(changes):
    stated = [word for one in ('section=stiffness', 'mass_per_length=0.01', 'torsional_stiffness=1',
                               'bending_stiffness=[1, 1]') for word in ('-p', f'rod.{one}')]
    result = run('thread', 'copper_wire', *QUICK, *stated, '-p', changes, '--hole', '0.4,0,1')
    assert result.exit_code == BAD_INPUT, result.output
    assert changes.split('=')[0].split('.')[-1] in result.output


@pytest.mark.parametrize('output', ['pipe.npz', 'pipe.csv', 'pipe.png', 'pipe.poses.yaml'])
def test_a_pipe_is_not_written_to(output):
    os.mkfifo(output)
    result = run('shape', 'copper_wire', '-g', '0,0,1', '-o', output)
    assert result.exit_code == BAD_INPUT and f'{output}' in result.output
    assert 'it is a pipe' in result.output


# ---- each option has its effect ---------------------------------------------------------------

STRAIGHT = ['thread', 'copper_wire', *QUICK, '--hole', '0.4,0,1']


@pytest.mark.parametrize('grip', ['clamped', 'pinned', 'sleeve', 'aligned'])
def test_the_far_end_is_held_by_the_grip(grip):
    result = run('shape', 'copper_wire', *QUICK, '-g', '0,0,1', '--far-end', '0.8,0,1,1,0,0.3',
                 '--grip', grip, '-o', 'held.npz')
    assert result.exit_code == 0, result.output
    shape = Shape.load('held.npz')
    assert shape.far_end.grip == grip
    assert (np.abs(shape.far_wrench[3:]).max() < 1e-9) == (grip == 'pinned')


def test_the_radius_of_holes_counts():
    for given in (['--radius', '0.02'], ['-p', 'cutouts.radius=0.03'],
                  ['--radius', '0.02', '-p', 'cutouts.radius=0.03']):
        assert run(*STRAIGHT, *given, '-o', 'plan.npz').exit_code == 0
        (sheet, _), = Plan.load('plan.npz').sheets
        assert sheet.cutouts[0].radius == (0.02 if '--radius' in given else 0.03)


@pytest.mark.parametrize('given', [['--deadline', '1e-4'],
                                   ['-p', 'threading.planning_deadline=0.01', '-p',
                                    'threading.waypoints=2000']])
def test_planning_ends_with_its_deadline(given):
    result = run(*STRAIGHT, *given)
    assert result.exit_code == NO_SOLUTION and 'deadline' in result.output


def test_a_plan_that_is_proved_says_so_and_its_deadline_counts():
    safe = run(*STRAIGHT, '--prove', '-o', 'motion.csv', '-o', 'motion.json', '-o', 'plan.npz',
               '-o', 'way.poses.json')
    assert safe.exit_code == 0 and re.search(r'safe +yes', safe.output)
    assert 'safe' not in run(*STRAIGHT).output
    trajectory = replay(quick(), Plan.load('plan.npz'), limits=Limits()).trajectory
    with Path('motion.csv').open(newline='') as file:
        rows = [{key: float(text) for key, text in row.items()} for row in csv.DictReader(file)]
    assert rows == [dict(zip(rows[0], one, strict=True)) for one in zip(
        *json.loads(Path('motion.json').read_text()).values(), strict=True)]
    poses, velocities, _ = trajectory.at([row['time'] for row in rows])
    assert rows[-1]['time'] == pytest.approx(trajectory.duration, rel=1e-9)
    assert rows[-1]['time'] > Plan.load('plan.npz').times[-1] - 1e-9
    assert np.diff([row['time'] for row in rows]).max() < 0.0202  # execute.rate is 50 a second
    np.testing.assert_allclose([[row[key] for key in 'xyz'] for row in rows],
                               [pose.position for pose in poses], atol=1e-6)
    np.testing.assert_allclose([[row[key] for key in ('vx', 'vy', 'vz')] for row in rows],
                               velocities[:, :3], atol=1e-6)
    assert len(json.loads(Path('way.poses.json').read_text())) == len(rows)
    unproved = run(*STRAIGHT, '--prove', '-p', 'threading.deadline=0.1', '-p',
                   'threading.linear_speed=1e-3', '-o', 'never.csv')
    assert unproved.exit_code == NO_SOLUTION and 'deadline' in unproved.output
    assert not Path('never.csv').exists()


def test_a_motion_that_is_not_safe_is_not_written(monkeypatch):
    def not_safe(*given, **options):
        return replace(replay(*given, **options), reason='it is too wild')

    monkeypatch.setattr('dlo_planner.cli.commands.replayed', not_safe)
    refused = run(*STRAIGHT, '--prove', '-o', 'never.csv', '-o', 'never.npz')
    assert refused.exit_code == NO_SOLUTION and 'nothing was written' in refused.output
    assert not list(Path().glob('never.*'))


def test_a_proof_takes_obstacles_limits_and_tolerance(planned):
    plan = Plan.load('plan.npz')
    lowest = min(shape.positions[:, 2].min() for shape in plan.shapes)
    floor = float(lowest) - 0.01  # nearer than the hole's rim
    Path('floor.yaml').write_text(f'- plane: {{point: [0, 0, {floor}], normal: [0, 0, 1]}}\n')
    limits = {'linear_speed': 0.07, 'angular_speed': 0.3, 'linear_acceleration': 0.4,
              'angular_acceleration': 1.5, 'linear_jerk': 3.0, 'angular_jerk': 15.0}
    given = [word for name, value in limits.items()
             for word in ('-p', f'threading.{name}={value}')]
    result = run('replay', 'copper_wire', 'plan.npz', *QUICK, *given, '-p',
                 'threading.tolerance=0.004', '-p', 'workspace.gripper_radius=0.003',
                 '--obstacles', 'floor.yaml', '-o', 'report.npz')
    assert result.exit_code == 0, result.output
    report = ValidationReport.load('report.npz')
    assert report.tolerance == 0.004
    assert {name: getattr(report.trajectory.limits, name) for name in limits} == limits
    # of the DLO, and of the gripper
    assert report.clearance == pytest.approx(0.01 - 0.75e-3, abs=1e-5)
    assert report.clearance < plan.clearance.min()
    assert report.workspace_margin == pytest.approx(
        min(pose.position[2] for pose in plan.grippers) - floor - 0.003, abs=1e-9)
    slow = run('replay', 'copper_wire', 'plan.npz', *QUICK, '-p', 'threading.deadline=0.1', '-p',
               'threading.linear_speed=1e-3')
    assert slow.exit_code == NO_SOLUTION and 'deadline' in slow.output


def seen_upside_down():
    """Write what is seen of a wire that is drawn up to a ceiling, and return its options."""
    table = '- plane: {point: [0, 0, 1.1], normal: [0, 0, -1]}\n'
    Path('ceiling.yaml').write_text(table)
    rod = Rod.circular(1.0, 1.5e-3, 8960.0, 1.2 * 110e9, 0.34)
    shape = DirectSimulator(rod, gravity=(0, 0, 9.81), obstacles=[
        Plane((0, 0, 1.1), (0, 0, -1))]).solve(Pose((0, 0, 1), (0, 0, 0, 1)))
    np.savetxt('seen.csv', shape.positions[6::6], delimiter=',')
    return ['identify', 'copper_wire', 'seen.csv', '-g', '0,0,1', '-p', 'rod.diameter=0.0015', '-p',
            'gravity=[0, 0, 9.81]', '--obstacles', 'ceiling.yaml', '--find', 'bending_stiffness']


def test_what_is_found_is_what_was_asked_for_in_its_surroundings():
    given, said = seen_upside_down(), []
    for noise in ('1e-3', '1e-2'):
        result = run(*given, '--noise', noise)
        assert result.exit_code == 0, result.output
        assert 'natural_curvature' not in result.output
        said.append(re.search(r'bending_stiffness(\[0\])? +([\d.e-]+) +\+- ([\d.e-]+)',
                              result.output))
    stiffness = 1.2 * 110e9 * np.pi / 4 * 0.75e-3**4
    assert float(said[0][2]) == pytest.approx(stiffness, rel=2e-3)
    assert float(said[1][3]) == pytest.approx(10 * float(said[0][3]), rel=0.1)


def test_a_map_is_of_the_cell_that_was_asked_for(monkeypatch):
    drawn = []
    plot = CapabilityMap.plot
    monkeypatch.setattr(CapabilityMap, 'plot', lambda self, **given: drawn.append(
        tuple(given.values())) or plot(self, **given))
    Path('block.yaml').write_text('- box: {pose: [0.4, 0.1, 1], size: [0.1, 0.1, 0.1]}\n')
    given = ['map', 'copper_wire', *QUICK, '--x', '0.4', '--y', '-0.1:0.1:2', '--z', '1',
             '--radius', '0.02', '--start', '-0.6,-0.1,1', '--folder', 'kept',
             '--obstacles', 'block.yaml',
             '--axis', 'x', '--quantity', 'clearance', '-o', 'map.csv', '-o', 'map.png']
    result = run(*given)
    assert result.exit_code == 0, result.output
    assert drawn == [('x', 'clearance')]
    with Path('map.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [float(row['y']) for row in rows] == [-0.1, 0.1]
    assert {row['start'] for row in rows} != {'-1'}  # from that pose there is a way
    assert [row['outcome'] == 'threaded' for row in rows] == [True, False]  # one is blocked
    parts = {path: path.stat().st_mtime_ns for path in Path('kept').iterdir()}
    assert parts and run(*given).exit_code == 0  # it goes on from there
    assert {path: path.stat().st_mtime_ns for path in Path('kept').iterdir()} == parts
