# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch files: only what the launch of Jazzy's first releases (3.4.3) can do."""

import ast
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from planner_process import ROOT

FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
# Of launch and launch_ros 3.4.3; name -> module
ALLOWED = {
    'LaunchDescription': 'launch', 'DeclareLaunchArgument': 'launch.actions',
    'IfCondition': 'launch.conditions',
    'EmitEvent': 'launch.actions', 'RegisterEventHandler': 'launch.actions',
    'OnProcessExit': 'launch.event_handlers', 'Shutdown': 'launch.events',
    'LaunchConfiguration': 'launch.substitutions', 'Node': 'launch_ros.actions',
    'ParameterFile': 'launch_ros.parameter_descriptions',
    'ParameterValue': 'launch_ros.parameter_descriptions', 'Path': 'pathlib'}


class LaunchConfiguration:
    """Stands for the value of an argument, as the original does."""

    def __init__(self, name):
        self.name = name


def substitutions(given):
    """Judge what 3.4.3 takes where a text with substitutions is due; return a list."""
    items = [given] if isinstance(given, str | LaunchConfiguration) else list(given)
    for item in items:
        if not isinstance(item, str | LaunchConfiguration):  # a list in a list needs 3.4.5
            raise TypeError(f'Failed to normalize given item of type {type(item)}')
    return items


def text(given, **arguments):
    return ''.join(arguments[item.name] if isinstance(item, LaunchConfiguration) else item
                   for item in substitutions(given))


class Recorded:
    """An action: what it was made with."""

    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named


def stand_ins():
    """Return the modules of launch and launch_ros, with nothing in them but what is allowed."""
    modules = {'launch_ros': ModuleType('launch_ros')}
    for name, module in ALLOWED.items():
        if module.startswith('launch'):
            kind = LaunchConfiguration if name == 'LaunchConfiguration' else type(
                name, (Recorded,), {})
            setattr(modules.setdefault(module, ModuleType(module)), name, kind)
    return modules


@pytest.fixture
def description(monkeypatch, request):
    """Return the entities of the launch file given as parameter, made with stand-ins."""
    for name, module in stand_ins().items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location('launch_file', ROOT / 'launch' / request.param)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.generate_launch_description().positional[0]


def of_kind(entities, name):
    return [one for one in entities if type(one).__name__ == name]


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_only_known_names_are_imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        assert not isinstance(node, ast.Import), f'{path.name}: import names of modules'
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                assert ALLOWED.get(alias.name) == node.module, f'{path.name}: {alias.name}'


@pytest.mark.parametrize('description', [path.name for path in FILES], indirect=True)
def test_every_value_is_one_that_the_first_jazzy_takes(description):
    for entity in description:
        for value in entity.named.values():
            if isinstance(value, Recorded):
                continue
            if isinstance(value, list) and any(isinstance(one, Recorded) for one in value):
                for one in of_kind(value, 'ParameterFile'):
                    substitutions(one.positional[0])
            elif isinstance(value, list) and any(isinstance(one, dict) for one in value):
                for one in value:  # parameters by name
                    for content in one.values():
                        substitutions([content])
            elif isinstance(value, str | LaunchConfiguration | list):
                substitutions(value)


@pytest.mark.parametrize('description', ['planner.launch.py'], indirect=True)
def test_each_rod_of_config_can_be_chosen_and_nothing_else(description):
    rod = next(one for one in of_kind(description, 'DeclareLaunchArgument')
               if one.positional == ('rod',))
    there = sorted(path.stem for path in (ROOT / 'config').glob('*.yaml'))
    assert rod.named['choices'] == there
    assert rod.named['default_value'] in there
    node = of_kind(description, 'Node')[0]
    file = node.named['parameters'][0].positional[0]
    for choice in there:
        named = Path(text(file, rod=choice, namespace=''))
        assert named == ROOT / 'config' / f'{choice}.yaml' and named.is_file()


@pytest.mark.parametrize('path', sorted((ROOT / 'config').glob('*.yaml')), ids=lambda p: p.stem)
def test_config_counts_whatever_the_node_is_called(path):
    assert list(yaml.safe_load(path.read_text())) == ['/**']
