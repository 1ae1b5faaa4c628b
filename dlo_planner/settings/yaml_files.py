# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values of parameters from YAML files, as the node reads them."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.files import readable, writable
from dlo_planner.model.checks import instance, shown
from dlo_planner.settings.building import check_described, idle_warnings, without_effect
from dlo_planner.settings.entries import ENTRIES, as_declared, within_limits
from dlo_planner.settings.guarded_yaml import load_yaml, read_yaml, yaml_of
from dlo_planner.settings.names import unknown_parameter

_NODES = ('/**', '/*', '/dlo_planner', 'dlo_planner', '/**/dlo_planner')  # keys that mean the node
_MOST_WARNINGS = 20
_PACKAGE = Path(__file__).parents[1]


def read_values(source: str | Path,
                changes: Iterable[str] = ()) -> tuple[dict[str, Any], list[str]]:
    """Return the values of all parameters (name -> value), and warnings.

    Warned of is what has no effect: names that do not exist, sizes that another section has.
    """
    path = config_file(source)
    given = _of_node(path, read_yaml(path))
    for change in changes:
        given |= _changed(change)
    values = {name: within_limits(name, as_declared(name, given.get(name, entry.default),
                                                    entry.default), entry)
              for name, entry in ENTRIES.items()}
    try:
        check_described(given, values['rod.section'])
    except InvalidTask as error:
        raise InvalidTask(f'{path}: {error}') from None
    unknown = [name for name in given if name not in ENTRIES]
    warnings = [unknown_parameter(name, ENTRIES) for name in unknown[:_MOST_WARNINGS]]
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
    if name not in ENTRIES:
        raise InvalidTask(unknown_parameter(name, ENTRIES))
    return {name: load_yaml(text, f'parameter {name}')}
