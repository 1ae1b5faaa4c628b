# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the pages tell to write and to run is right."""

import re
import shlex
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from solids import circle, plate, rectangle, stl

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Pose,
    Rod,
    Uncertainty,
    robustness,
)
from dlo_planner.cli.main import main
from dlo_planner.settings.parameters import PARAMETERS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGES = [ROOT / 'README.md', *DOCS.glob('*.md'), *DOCS.glob('[!m]*/*.md')]  # but those made
TEXT = '\n'.join(page.read_text() for page in PAGES).replace('\\\n', ' ')


def blocks(page, language):
    return [re.sub('^   ', '', block, flags=re.M) if block.startswith('   ') else block
            for block in re.findall(rf'```{language}\n(.*?)```', (DOCS / page).read_text(), re.S)]


def test_the_sample_of_the_start_page_runs(tmp_path, monkeypatch):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks('start.md', 'python'):
        exec(compile(block, 'start.md', 'exec'), names)
    assert names['plan'].fraction == 1
    assert (tmp_path / 'plan.png').stat().st_size > 10_000


@pytest.mark.parametrize('index', [0, 1])
def test_the_files_of_the_how_to_are_understood(index, tmp_path):
    found = blocks('howto/your_cable.md', 'yaml')
    assert len(found) == 2
    (tmp_path / 'cable.yaml').write_text(found[index])
    done = CliRunner().invoke(main, ['shape', str(tmp_path / 'cable.yaml'), '--gripper', '0,0,1',
                                     '-o', str(tmp_path / 'shape.csv')])
    assert done.exit_code == 0, done.output
    last = np.loadtxt(tmp_path / 'shape.csv', delimiter=',', skiprows=1)[-1]
    assert np.isfinite(last).all()


def test_the_table_of_sags_is_right():
    text = (DOCS / 'howto' / 'your_cable.md').read_text()
    sags = re.findall(r'([\d.]+) L', re.search(r'\| sag \|(.*)', text)[1])
    loads = re.findall(r'w L\^3 / (\d+)', text)
    assert len(sags) == len(loads) == 4
    for sag, load in zip(sags, loads, strict=True):
        cable = Rod(1.0, float(load) / 9.80665, 1.0, 1.0)  # L = EI = 1, w = load
        tip = DirectSimulator(cable).solve(Pose((0, 0, 0), (0, 0, 0, 1))).positions[-1]
        assert abs(-tip[2] - float(sag)) < 0.006


def test_the_commands_of_the_how_to_find_the_cable(tmp_path, monkeypatch):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    text = (DOCS / 'howto' / 'your_cable.md').read_text().replace('\\\n', ' ')
    commands = [shlex.split(line)[1:] for line in re.findall(r'^ +(dlo-planner .*)$', text, re.M)]
    assert [command[0] for command in commands] == ['cable', 'identify', 'shape']
    real = DirectSimulator(Rod(0.8, 0.07, 0.03, 0.015, natural_curvature=(0.0, 0.2)))
    for name, way in (('level', (1, 0, 0)), ('up', (1, 0, 1))):
        points = real.solve(Pose.looking_along((0, 0, 1), way)).positions[6::3]
        pixels = [412, 96] + (points[:, [0, 2]] - [0, 1]) * [1, -1] / 0.00058
        np.savetxt(tmp_path / f'{name}.csv', pixels, delimiter=',', header='u,v', comments='')
    for command in commands:
        if command[0] == 'identify':
            written = yaml.safe_load((tmp_path / 'my_cable.yaml').read_text())
            shown = yaml.safe_load(blocks('howto/your_cable.md', 'yaml')[1])
            for one in (written, shown):
                rod = one['/**']['ros__parameters']['rod']
                assert rod.pop('torsional_stiffness') == pytest.approx(0.043, rel=0.01)
                assert rod.pop('bending_stiffness') == pytest.approx([0.057] * 2, rel=0.01)
            assert written == shown
        done = CliRunner().invoke(main, command)
        assert done.exit_code == 0, done.output
    found = (tmp_path / 'identified.yaml').read_text()
    stiffness = re.search(r'\bbending_stiffness: *\[([\d.e-]+)', found) or re.search(
        r'\bbending_stiffness:\s*- ([\d.e-]+)', found)
    assert abs(float(stiffness[1]) - 0.03) < 1e-4


GRIPPER = '''<robot name="gripper">
<link name="palm"><collision><geometry><box size="0.05 0.1 0.08"/></geometry></collision></link>
<link name="pad"><collision><geometry><box size="0.05 0.01 0.02"/></geometry></collision></link>
<joint name="finger" type="prismatic"><parent link="palm"/><child link="pad"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint></robot>'''


def put_files_of_a_cell(tmp_path):
    for name in ('mujoco', 'trimesh'):
        pytest.importorskip(name)
    (tmp_path / 'cell.xml').write_text('<mujoco><worldbody><geom type="box" size=".1 .1 .1" pos='
                                       '"0.5 0 0.7" name="block"/></worldbody></mujoco>')
    (tmp_path / 'gripper.urdf').write_text(GRIPPER)
    (tmp_path / 'panel.stl').write_bytes(stl(*plate(
        rectangle(400, 300), [circle(15, 64)], 4, step=40)))


def test_what_is_said_of_a_cell_is_right(tmp_path, monkeypatch, capsys):
    put_files_of_a_cell(tmp_path)
    monkeypatch.chdir(tmp_path)
    text = (DOCS / 'terminal.md').read_text().partition('## Your cell')[2]
    lines = [shlex.split(line) for line in re.findall(r'^ {4}dlo-planner (.*)$', text, re.M)]
    assert [line[0] for line in lines] == ['scene'] * 3 + ['shape', 'thread']
    for line in lines:
        quick = [] if line[0] == 'scene' else [
            '-p', 'threading.waypoints=10', '-p', 'threading.max_misalignment=0']
        done = CliRunner().invoke(main, line + quick)
        assert done.exit_code == 0, (line, done.output)
    (tmp_path / 'list.yaml').write_text(blocks('terminal.md', 'yaml')[0])
    done = CliRunner().invoke(main, ['scene', 'list.yaml'])
    assert done.exit_code == 0 and '3 obstacles, 1 cut-out' in done.output, done.output
    names = {}
    exec(compile(blocks('terminal.md', 'python')[0], 'terminal.md', 'exec'), names)
    assert '1 obstacle, 1 cut-out' in capsys.readouterr().out and names['hole'].radius < 0.015
    written = names['Scene'].read('with_wire.scene')
    assert written['wire/0'] and len(written.cutouts) == 1


def test_the_code_of_each_equation_exists():
    told = re.findall(r'Code: (`.*?)\n\n', (DOCS / 'theory.md').read_text(), re.S)
    named = re.findall(r'`([a-z_.0-9]+)\.(\w+)`', '\n'.join(told))
    assert len(named) > 12
    assert [name for module, name in named
            if not hasattr(import_module(f'dlo_planner.{module}'), name)] == []


def test_what_is_uncertain_moves_the_free_end_by_centimeters():
    said = re.search(r'move the free end of a 1.5 mm wire of 1 m by (\d) cm',
                     (DOCS / 'theory.md').read_text())
    simulator = DirectSimulator(Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34))
    plan = InverseSimulator(simulator).thread(CutOut(Pose.identity(), radius=0.01))
    off = robustness(simulator, plan, Uncertainty(
        bending_stiffness=0.05, natural_curvature=0.05, gripper_rotation=np.radians(0.2)))
    assert round(100 * off.first_order.max()) == int(said[1])


def commands(begin):
    """Return what follows the beginning of a command in blocks and in `lines` of the pages."""
    found = [*re.findall(rf'^ {{4,}}{begin} (.*)$', TEXT, re.M),
             *re.findall(rf'`{begin} ([^`]*)`', TEXT)]
    return [line.split('  #')[0].strip() for line in found if '...' not in line and '<' not in line]


def test_commands_that_pages_show_are_understood(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ('my_cable.yaml', 'identified.yaml', 'insert.yaml', 'plan.npz', 'seen.csv',
                 'level.csv', 'up.csv', 'cell.xml', 'panel.stl', 'panel.yaml', 'gripper.urdf'):
        (tmp_path / name).touch()
    shown = {tuple(shlex.split(line)) for line in commands('dlo-planner')}
    assert {name for name, *_ in shown} >= {'doctor', 'scene', 'shape', 'thread', 'replay',
                                            'identify', 'map', 'cable', 'plan'}
    for name, *arguments in shown:
        if '--help' not in arguments:
            main.get_command(None, name).make_context(name, arguments)


@pytest.mark.sweep
def test_the_commands_of_the_page_of_the_terminal_run(tmp_path, monkeypatch):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    page = (DOCS / 'terminal.md').read_text().replace('\\\n', ' ')
    shown = [shlex.split(line) for line in re.findall(r'^ {4}dlo-planner (.*)$', page, re.M)]
    help_text = CliRunner().invoke(main, ['plan', '--help']).output
    (tmp_path / 'insert.yaml').write_text(
        re.search(r'insert\.yaml:\n((?: {4,}.*\n)+)', help_text)[1])
    put_files_of_a_cell(tmp_path)
    points = DirectSimulator(Rod.circular(0.5, 0.006, 1600.0, 2e7, 0.4)).solve(
        Pose((0, 0, 1), (0, 0, 0, 1))).positions[6::3]
    np.savetxt(tmp_path / 'seen.csv', points, delimiter=',', header='x,y,z', comments='')
    shown.sort(key=lambda line: line[0] != 'cable')  # which the others need
    for line in shown:
        words = [word.replace('my.yaml', 'my_cable.yaml') for word in line]
        done = CliRunner().invoke(main, words)
        assert done.exit_code == 0, (words, done.output)
        assert all((tmp_path / name).stat().st_size
                   for option, name in pairwise(words) if option == '-o')


def test_the_first_command_of_the_start_page_runs(tmp_path, monkeypatch):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    line = re.search(r'^    dlo-planner (shape .*)$', (DOCS / 'start.md').read_text(), re.M)[1]
    done = CliRunner().invoke(main, shlex.split(line))
    assert done.exit_code == 0 and 'converged' in done.output, done.output
    assert (tmp_path / 'wire.png').stat().st_size > 10_000


def test_ros_is_told_names_that_exist():
    executables = {path.name for path in (ROOT / 'scripts').iterdir()} | {'dlo-planner'}
    ran = {line.split()[0] for line in commands('ros2 run dlo_planner')}
    assert ran >= {'planner_node', 'cell', 'viewer'} and ran <= executables
    launched = [line.split() for line in commands('ros2 launch dlo_planner')]
    assert {name for name, *_ in launched} >= {'planner.launch.py', 'view.launch.py'}
    for name, *arguments in launched:
        source = (ROOT / 'launch' / name).read_text()
        assert not [one for one in arguments if not one.startswith('--')  # of ros2 itself
                    and f"'{one.split(':=')[0]}'" not in source]
    assert set(re.findall(r'rod:=(\w+)', TEXT)) <= {one.stem for one in
                                                    (ROOT / 'config').glob('*.yaml')}
    set_by_hand = {line.split()[1] for line in commands('ros2 param set')}
    assert set_by_hand and set_by_hand <= set(PARAMETERS)


def test_scripts_find_the_package_where_it_is_not_installed():
    named = set(re.findall(r'python (test/[\w/]+(?:\.py)?)', TEXT))
    assert len(named) > 3 and not [name for name in named if not (ROOT / name).exists()]
    scripts = [path for path in (ROOT / 'test').rglob('*.py')
               if "\nif __name__ == '__main__':" in path.read_text()
               and path.name != 'user.py']  # a user has installed it
    assert {path.name for path in scripts} >= {'__main__.py', 'closed_loops.py'}
    for path in scripts:
        before, _, _ = path.read_text().partition('\nfrom dlo_planner')
        assert 'sys.path[:' in before, path.name
