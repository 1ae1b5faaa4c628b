# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Launch files without `launch`, by stand-ins of what its first release of Jazzy (3.4.3) can do."""

import importlib.util
import sys
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

# Of launch and launch_ros 3.4.3; name -> module
ALLOWED = {
    'LaunchDescription': 'launch', 'DeclareLaunchArgument': 'launch.actions',
    'ExecuteProcess': 'launch.actions', 'IncludeLaunchDescription': 'launch.actions',
    'OpaqueFunction': 'launch.actions',
    'IfCondition': 'launch.conditions',
    'EmitEvent': 'launch.actions', 'RegisterEventHandler': 'launch.actions',
    'OnProcessExit': 'launch.event_handlers', 'Shutdown': 'launch.events',
    'PythonLaunchDescriptionSource': 'launch.launch_description_sources',
    'LaunchConfiguration': 'launch.substitutions', 'Node': 'launch_ros.actions',
    'ParameterFile': 'launch_ros.parameter_descriptions',
    'ParameterValue': 'launch_ros.parameter_descriptions'}
STANDARD = {'Path': 'pathlib'}  # of Python's own library


class LaunchConfiguration:
    """Stands for the value of an argument, as the original does."""

    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context[self.name]


def substitutions(given):
    """Judge what 3.4.3 takes where a text with substitutions is due; return a list."""
    items = [given] if isinstance(given, str | LaunchConfiguration) else list(given)
    for item in items:
        if not isinstance(item, str | LaunchConfiguration):  # a list in a list needs 3.4.5
            raise TypeError(f'Failed to normalize given item of type {type(item)}')
    return items


def text(given, arguments):
    """Return a text with its substitutions, of arguments (name -> value)."""
    return ''.join(arguments[item.name] if isinstance(item, LaunchConfiguration) else item
                   for item in substitutions(given))


class Recorded:
    """An action: what it was made with."""

    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named


def _stand_ins():
    """Return the modules of launch and launch_ros, with nothing in them but what is allowed."""
    modules = {'launch_ros': ModuleType('launch_ros')}
    for name, module in ALLOWED.items():
        kind = LaunchConfiguration if name == 'LaunchConfiguration' else type(
            name, (Recorded,), {})
        setattr(modules.setdefault(module, ModuleType(module)), name, kind)
    return modules


@contextmanager
def _instead_of_launch():
    before = {name: sys.modules.get(name) for name in _stand_ins()}
    sys.modules.update(_stand_ins())
    try:
        yield
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


def described(path):
    """Return the entities of a launch file, made with stand-ins."""
    with _instead_of_launch():
        spec = importlib.util.spec_from_file_location('launch_file', path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.generate_launch_description().positional[0]


def of_kind(entities, name):
    """Return the entities whose class has a name."""
    return [one for one in entities if type(one).__name__ == name]


def arguments_of(entities, **given):
    """Return the arguments, name -> value: those given, else their defaults; judge them."""
    values = {}
    for one in of_kind(entities, 'DeclareLaunchArgument'):
        name, = one.positional
        values[name] = given.pop(name, text(one.named['default_value'], values))
        assert values[name] in one.named.get('choices', [values[name]]), (name, values[name])
    assert not given, f'no such arguments: {given}'
    return values


def started(path, **given):
    """Return what a launch file starts, as (action, arguments), what it includes among it."""
    entities = described(path)
    values, found = arguments_of(entities, **given), []
    for one in entities:
        kind, condition = type(one).__name__, one.named.get('condition')
        if condition is not None and text(condition.positional[0], values) != 'true':
            continue
        if kind == 'OpaqueFunction':
            with _instead_of_launch():
                found += [(made, values) for made in one.named['function'](values)]
        elif kind == 'IncludeLaunchDescription':
            source, = one.positional
            handed = {name: text(value, values) for name, value in one.named['launch_arguments']}
            found += started(Path(text(source.positional[0], values)), **handed)
        elif kind in ('Node', 'ExecuteProcess'):
            found.append((one, values))
    return found


def command_line(node, values):
    """Return what follows --ros-args for a Node that is started with argument values."""
    line = ['-r', f'__node:={text(node.named["name"], values)}']
    if text(node.named.get('namespace', ''), values):
        line += ['-r', f'__ns:=/{text(node.named["namespace"], values)}']
    for one in node.named.get('parameters', ()):
        if isinstance(one, Recorded):
            line += ['--params-file', text(one.positional[0], values)]
        else:
            for name, value in one.items():
                bare = value.positional[0] if isinstance(value, Recorded) else value
                said = str(bare).lower() if isinstance(bare, bool) else text(bare, values)
                line += ['-p', f'{name}:={said}']
    for topic, other in node.named.get('remappings', ()):
        line += ['-r', f'{text(topic, values)}:={text(other, values)}']
    return line
