# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML, in and out: from anybody, in the core schema of YAML 1.2, within limits, no key twice."""

import re
from collections.abc import Callable
from os import PathLike
from typing import Any

import yaml

from dlo_planner.errors import InvalidTask
from dlo_planner.files import text_of
from dlo_planner.model.checks import shown

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


def read_yaml(path: str | PathLike[str]) -> Any:
    """Return the content of a YAML or JSON file."""
    return load_yaml(text_of(path), str(path))


def load_yaml(text: str, name: str) -> Any:
    """Return the content of a YAML text: dicts, lists, and the scalars of the core schema.

    1:30, yes and 2026-01-01 are strings, 010 is ten, 8e6 is a number. There is no merging (<<).
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
