# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML in and out: guarded against what anybody may write; values of parameters from files."""

import os
import re
from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, shown
from dlo_planner.model.files import readable, text_of, writable
from dlo_planner.settings.build import check_described, idle_warnings, without_effect
from dlo_planner.settings.parameters import (
    PARAMETERS,
    as_declared,
    unknown_parameter,
    within_limits,
)

_DEEPEST = 50       # nodes inside each other
_MOST = 1_000_000   # nodes, those that aliases repeat counted each time
_TAG = 'tag:yaml.org,2002:'
# Section 10.3.2 of the specification: tag -> what it looks like, its content.
_PLAIN: dict[str, tuple[str, Callable[[str], Any]]] = {
    'null': (r'null|Null|NULL|~|', lambda text: None),
    'bool': (r'true|True|TRUE|false|False|FALSE', lambda text: text.lower() == 'true'),
    'int': (r'[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+',
            lambda text: int(text, {'0o': 8, '0x': 16}.get(text[:2], 10))),
    'float': (r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?'
              r'|[-+]?(\.inf|\.Inf|\.INF)|\.nan|\.NaN|\.NAN',
              lambda text: float(text.replace('.', '', 1) if text[-1] in 'fFnN' else text))}
_LEADING_ZERO = r'[-+]?0[0-9]+'


def read_yaml(path: str | PathLike[str]) -> Any:
    """Return the content of a YAML or JSON file."""
    return load_yaml(text_of(path), str(path))


def load_yaml(text: str, name: str) -> Any:
    """Return the content of a YAML text: dicts, lists, and the scalars of the core schema.

    1:30, yes and 2026-01-01 are strings, 8e6 is a number. A whole number that begins with 0 is
    refused: 010 is ten here, and eight to readers of YAML 1.1, ROS among them. There is no
    merging (<<).
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = '' if mark is None else f', line {mark.line + 1}'
        said = ' '.join(filter(None, (error.context, error.problem)))
        raise InvalidTask(f'{name}{where}: expected YAML, {said}') from None
    except yaml.YAMLError as error:
        raise InvalidTask(f'{name}: expected YAML, {" ".join(str(error).split())}') from None


def yaml_of(content: object) -> str:
    """Return a YAML text of dicts, lists and scalars that `load_yaml` and ROS read as they were."""
    text: str = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    return text


class _Dumper(yaml.SafeDumper):
    """Quotes strings that YAML 1.1 or the core schema would take for something else."""


class _Loader(yaml.SafeLoader):
    """The core schema within limits: PyYAML's own knows YAML 1.1, and no limits."""

    yaml_implicit_resolvers: dict[str, Any] = {}
    yaml_constructors: dict[str, Any] = {}

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = self._count = 0
        self._sizes: dict[int, int] = {}  # of nodes with all that is in them

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node; refuse what is too deep or too large."""
        event, before = self.peek_event(), self._count
        self._depth += 1
        if self._depth > _DEEPEST:
            raise _fault(f'at most {_DEEPEST} levels', event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(event, yaml.AliasEvent):
            if id(node) not in self._sizes:
                raise _fault(f'no *{event.anchor} inside of itself', event)
            self._count += self._sizes[id(node)]
        else:
            self._count += 1
            self._sizes[id(node)] = self._count - before
        if self._count > _MOST:
            raise _fault(f'at most {_MOST} values, those of aliases counted each time', event)
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return the dict; refuse a key that is there twice."""
        known = set()
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, list | dict):
                raise _fault('a scalar as key', key_node)
            if key in known:
                raise _fault(f'the key {shown(key)} once', key_node)
            known.add(key)
        # not that of SafeLoader, which merges
        content: dict[Any, Any] = yaml.constructor.BaseConstructor.construct_mapping(
            self, node, deep=deep)
        return content

    def construct_plain(self, node: Any) -> Any:
        """Return a scalar of the core schema."""
        known, content = _PLAIN[node.tag.removeprefix(_TAG)]
        text = self.construct_scalar(node)
        if not re.fullmatch(known, text):
            raise _fault(f'{node.tag}, not {shown(text)}', node)
        if re.fullmatch(_LEADING_ZERO, text):
            raise _fault(f'a number without a leading 0, not {shown(text)}: to some readers that '
                         'is of base 10, to others of base 8', node)
        try:
            return content(text)
        except ValueError:  # of thousands of digits
            raise _fault('a number of less than 4,000 digits', node) from None


def _fault(expected: str, at: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=expected, problem_mark=at.start_mark)


for _name, (_known, _) in _PLAIN.items():
    for _kind in (_Loader, _Dumper):
        _kind.add_implicit_resolver(_TAG + _name, re.compile(f'({_known})\\Z'), None)
    _Loader.add_constructor(_TAG + _name, _Loader.construct_plain)
for _name, _method in (('str', yaml.SafeLoader.construct_yaml_str),
                       ('seq', yaml.SafeLoader.construct_yaml_seq),
                       ('map', yaml.SafeLoader.construct_yaml_map)):
    _Loader.add_constructor(_TAG + _name, _method)
_Loader.add_constructor(None, yaml.SafeLoader.construct_undefined)


_NODES = ('/**', '/*', '/dlo_planner', 'dlo_planner', '/**/dlo_planner')  # keys that mean the node
_MOST_WARNINGS = 20
_PACKAGE = Path(__file__).parents[1]


def read_values(source: str | Path,
                changes: Iterable[str] = ()) -> tuple[dict[str, Any], list[str]]:
    """Return the values of all parameters (name -> value), and warnings of what has no effect."""
    path = config_file(source)
    given = _of_node(path, read_yaml(path))
    for change in changes:
        given |= _changed(change)
    values = {name: within_limits(name, as_declared(name, given.get(name, entry.default),
                                                    entry.default), entry)
              for name, entry in PARAMETERS.items()}
    try:
        check_described(given, values['rod.section'])
    except InvalidTask as error:
        raise InvalidTask(f'{path}: {error}') from None
    unknown = [name for name in given if name not in PARAMETERS]
    warnings = [unknown_parameter(name, PARAMETERS) for name in unknown[:_MOST_WARNINGS]]
    if len(unknown) > _MOST_WARNINGS:  # what is near to a name is slow to find
        warnings.append(f'{len(unknown) - _MOST_WARNINGS} more parameters do not exist')
    return values, warnings + idle_warnings(given, values['rod.section'])


def write_values(path: Path, values: Mapping[str, object]) -> None:
    """Write values of parameters, those with an effect, as a YAML file for the node."""
    tree: dict[str, Any] = {}
    idle = without_effect(str(values['rod.section']))
    for name, value in values.items():
        if name in idle:
            continue
        *parents, last = name.split('.')
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[last] = value
    content = {'/**': {'ros__parameters': tree}}
    writable(path).write_text(yaml_of(content), encoding='utf-8')


def config_file(source: str | Path) -> Path:
    """Return the path of a YAML file, or of the one in config/ that has this name."""
    if os.path.exists(instance('config', source, (str, Path))):
        return readable(source)
    known = config_files()
    if str(source) in known:
        return known[str(source)]
    raise InvalidTask(f'config = {shown(str(source))}: expected a YAML file, or one of '
                      f'{", ".join(known) or "the files of config/, which is not installed"}')


def config_files() -> dict[str, Path]:
    """Return the YAML files in config/ by their names: of the sources, or where it is installed."""
    folders = [_PACKAGE.parent / 'config', *(
        parent / 'share' / 'dlo_planner' / 'config' for parent in _PACKAGE.parents)]
    folder = next((one for one in folders if (one / 'copper_wire.yaml').is_file()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob('*.yaml'))}


def _of_node(path: Path, content: object) -> dict[str, object]:
    """Return the parameters (nested dicts) of a file's content that are the node's."""
    if not isinstance(content, dict) or not any(key in _NODES for key in content):
        raise InvalidTask(f'{path}: expected parameters under /**: and ros__parameters:')
    out: dict[str, object] = {}
    for key, inside in content.items():
        if key not in _NODES:
            continue
        if not isinstance(inside, dict) or not isinstance(inside.get('ros__parameters'), dict):
            raise InvalidTask(f'{path}: expected ros__parameters: under {key}:')
        try:
            out |= _flat(inside['ros__parameters'])
        except InvalidTask as error:
            raise InvalidTask(f'{path}: {error}') from None
    return out


def _flat(tree: Mapping[str, object], before: str = '') -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in tree.items():
        for full, one in (_flat(value, f'{before}{name}.') if isinstance(value, dict) and value
                          else {f'{before}{name}': value}).items():
            if full in flat:  # as a.b: and as b: under a:
                raise InvalidTask(f'parameter {full}: expected once, it is there twice')
            flat[full] = one
    return flat


def _changed(change: str) -> dict[str, object]:
    name, sign, text = change.partition('=')
    name = name.removesuffix(':').strip()
    if not sign or not name:
        raise InvalidTask(f'parameter {change!r}: expected name=value')
    if name not in PARAMETERS:
        raise InvalidTask(unknown_parameter(name, PARAMETERS))
    return {name: load_yaml(text, f'parameter {name}')}
