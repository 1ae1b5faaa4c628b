# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch files: only what the launch of Jazzy's first releases (3.4.3) can do."""

import ast

import pytest
import yaml
from launching import (
    ALLOWED,
    STANDARD,
    Recorded,
    arguments_of,
    command_line,
    described,
    of_kind,
    started,
    substitutions,
)
from planner_process import ROOT

FILES = sorted([*(ROOT / 'launch').glob('*.launch.py'), *(ROOT / 'examples').rglob('*.launch.py')])
NAMES = [str(path.relative_to(ROOT)) for path in FILES]
PLANNER = ROOT / 'launch' / 'planner.launch.py'


@pytest.mark.parametrize('path', FILES, ids=NAMES)
def test_only_known_names_are_imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        assert not isinstance(node, ast.Import), f'{path.name}: import names of modules'
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                known = {**ALLOWED, **STANDARD}.get(alias.name)
                assert known == node.module, f'{path.name}: {alias.name}'


@pytest.mark.parametrize('path', FILES, ids=NAMES)
def test_every_value_is_one_that_the_first_jazzy_takes(path):
    for entity in [*described(path), *(one for one, _ in started(path))]:
        for name, value in entity.named.items():
            for one in values_in(name, value):
                substitutions(one)


def values_in(name, value):
    """Return what has to be a text with substitutions, of an argument of an action."""
    if name in ('cmd', 'arguments'):
        return value
    if name in ('remappings', 'launch_arguments'):
        return [part for pair in value for part in pair]
    if name == 'parameters':
        files = [one.positional[0] if isinstance(one, Recorded) else one for one in value
                 if not isinstance(one, dict)]
        return files + [content for one in value if isinstance(one, dict)
                        for content in one.values() if not isinstance(content, Recorded)]
    return [] if isinstance(value, Recorded) or callable(value) else [value]


@pytest.mark.parametrize('path', FILES, ids=NAMES)
def test_each_argument_explains_itself(path):
    arguments = of_kind(described(path), 'DeclareLaunchArgument')
    assert arguments
    for one in arguments:
        said = one.named['description']
        assert said[0].isupper() and said.endswith('.') and len(said) > 5, one.positional
    values = arguments_of(described(path))
    assert set(values) == {one.positional[0] for one in arguments}


def planner_of(**given):
    """Return what follows --ros-args of the planner that is started with arguments."""
    (node, values), = started(PLANNER, **given)
    assert (node.named['package'], node.named['executable']) == ('dlo_planner', 'planner_node')
    return command_line(node, values)


def test_each_rod_of_config_can_be_chosen_and_nothing_else():
    rod = next(one for one in described(PLANNER) if one.positional == ('rod',))
    there = sorted(path.stem for path in (ROOT / 'config').glob('*.yaml'))
    assert rod.named['choices'] == there
    assert rod.named['default_value'] in there
    for choice in there:
        assert str(ROOT / 'config' / f'{choice}.yaml') in planner_of(rod=choice)


def test_the_planner_is_what_its_arguments_say():
    plain = planner_of()
    assert plain == ['-r', '__node:=dlo_planner', '--params-file',
                     str(ROOT / 'config' / 'copper_wire.yaml'), '-p', 'autostart:=true']
    line = planner_of(params_file='/mine.yaml', name='wires', namespace='cell1', autostart='false',
                      through='joints', arm='tool0', controller='/jtc', gripper_pose='/tcp',
                      gripper_command='/servo_node/pose', tracker='/trackdlo/results')
    assert line == [
        '-r', '__node:=wires', '-r', '__ns:=/cell1', '--params-file', '/mine.yaml',
        '-p', 'autostart:=false', '-p', 'arm.tool_link:=tool0', '-p', 'execute.through:=joints',
        '-r', '~/gripper_pose:=/tcp', '-r', '~/observed_points:=/trackdlo/results',
        '-r', '~/gripper_command:=/servo_node/pose',
        '-r', '~/joint_commands_ahead:=/jtc/joint_trajectory']


@pytest.mark.parametrize('path', sorted((ROOT / 'config').glob('*.yaml')), ids=lambda p: p.stem)
def test_config_counts_whatever_the_node_is_called(path):
    assert list(yaml.safe_load(path.read_text())) == ['/**']
