# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values as plain Python and back.

Each names its class under `type`; it may leave that out where the field that it stands in can hold
values of one class alone, as `Thread.cutout` can.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from inspect import isabstract
from os import PathLike
from types import NoneType, UnionType
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from dlo_planner.direct.shape import Shape, pack, unpack
from dlo_planner.direct.storage import NOT_FINITE, array_of, described, flattened, nested
from dlo_planner.errors import InvalidRod, InvalidTask
from dlo_planner.model.checks import did_you_mean, known_keys, shown
from dlo_planner.model.files import readable, writable
from dlo_planner.model.plain_poses import pose_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import FrozenDict, Value
from dlo_planner.plan.plan import Plan, plan_of, plan_tree

_TYPE = 'type'
_DICT = 'dict'  # type of a dict that is no value
_DEEPEST = 20  # values inside values
_POSE = {'position', 'quaternion', 'orientation'}


class FieldKind(NamedTuple):
    """What a field of a value holds, by its type."""

    kind: type[Value]  # the one class of its values
    several: bool      # whether it is a tuple of them


def value_fields(cls: type[Value]) -> dict[str, FieldKind]:
    """Return the fields of a class that hold values of one class.

    None, where types of somebody's own class are known to type checkers alone.
    """
    try:
        hints = get_type_hints(cls)
    except NameError:
        return {}
    found: dict[str, FieldKind] = {}
    for name, hint in hints.items():
        options = [part for part in (get_args(hint) if get_origin(hint) in (Union, UnionType)
                                     else (hint,)) if part is not NoneType]
        several = get_origin(options[0]) is tuple
        kind = get_args(options[0])[0] if several else options[0]
        if len(options) > 1:
            continue
        if (isinstance(kind, type) and issubclass(kind, Value) and is_dataclass(kind)
                and not isabstract(kind) and not issubclass(kind, Shape | Plan)):
            found[name] = FieldKind(kind, several)
    return found


def to_plain(content: object) -> Any:
    """Return a content as dicts, lists, numbers, strings, booleans and None."""
    if isinstance(content, Pose):
        return {'position': content.position.tolist(), 'quaternion': content.quaternion.tolist()}
    if isinstance(content, Shape | Plan):
        tree = pack(content) if isinstance(content, Shape) else plan_tree(content)
        return {_TYPE: type(content).__name__,
                **{name: described(array) for name, array in flattened(tree).items()}}
    if isinstance(content, Value) and is_dataclass(content):
        return {_TYPE: type(content).__name__,
                **{item.name: to_plain(getattr(content, item.name))
                   for item in fields(content) if item.init}}
    if isinstance(content, np.ndarray | np.generic):
        return content.tolist()
    if isinstance(content, FrozenDict):
        return {_TYPE: _DICT, **{str(key): to_plain(part) for key, part in content.items()}}
    if isinstance(content, Mapping):
        return {str(key): to_plain(part) for key, part in content.items()}
    if isinstance(content, tuple | list):
        return [to_plain(part) for part in content]
    if content is None or isinstance(content, bool | int | float | str):
        return content
    raise InvalidTask(f'{shown(content)} cannot be written: expected values, numbers and texts')


def from_plain(name: str, content: object, depth: int = 0,
               expected: FieldKind | None = None) -> object:
    """Return what `to_plain` was given; lists stay lists, which values take for arrays.

    `expected` says which values stand here, for those that do not name their class.
    """
    if depth > _DEEPEST:
        raise InvalidTask(f'{name[:40]}...: expected values in at most {_DEEPEST} others')
    if isinstance(content, Value):
        return content
    if isinstance(content, Mapping):
        return _value(name, content, depth, expected)
    if isinstance(content, list | tuple):
        if expected == (Pose, False):
            return pose_of(name, content)
        each = None if expected is None else expected._replace(several=False)
        return [from_plain(f'{name}[{k}]', part, depth + 1, each)
                for k, part in enumerate(content)]
    return content


def judge_keys(name: str, content: Mapping[str, Any], cls: type[Value]) -> None:
    """Raise InvalidTask for a key that a value of a class, or one in it, does not have."""
    if issubclass(cls, Pose):
        pose_of(name, content)
        return
    _judge_own_keys(name, content, cls)
    for field, (kind, several) in value_fields(cls).items():
        given = content.get(field)  # who reads it judges what it is
        for part in given if several and isinstance(given, list | tuple) else [given]:
            if isinstance(part, Mapping) and part.get(_TYPE) in (None, kind.__name__):
                judge_keys(f'{name}.{field}', part, kind)


def write_value(path: str | PathLike[str], value: Value | Mapping[str, Any]) -> None:
    """Write a value, or a dict of some, as JSON."""
    target, text = writable(path), json.dumps(_finite(to_plain(value)), allow_nan=False)
    try:
        target.write_text(text, encoding='utf-8')
    except OSError as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, {error}') from None


def read_value(path: str | PathLike[str], kind: type[Value]) -> Value:
    """Return the value of a class that `write_value` wrote; raise InvalidTask."""
    file = readable(path)
    try:
        content = json.loads(file.read_text(encoding='utf-8'))
        value = from_plain(kind.__name__, _not_finite(content))
    except (OSError, ValueError, RecursionError) as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a JSON file that holds a '
                          f'{kind.__name__}, {error}') from None
    if not isinstance(value, kind):
        raise InvalidTask(f'path = {shown(str(path))}: expected a file that holds a '
                          f'{kind.__name__}, it holds a {type(value).__name__}')
    return value


def _finite(content: Any) -> Any:
    """Return plain content with words in place of what is not finite."""
    if isinstance(content, dict):
        return {key: _finite(part) for key, part in content.items()}
    if isinstance(content, list):
        return [_finite(part) for part in content]
    return str(content) if isinstance(content, float) and not np.isfinite(content) else content


def _not_finite(content: Any) -> Any:
    """Return what `_finite` was given."""
    if isinstance(content, dict):
        return {key: _not_finite(part) for key, part in content.items()}
    if isinstance(content, list):
        return [_not_finite(part) for part in content]
    return NOT_FINITE.get(content, content) if isinstance(content, str) else content


def _judge_own_keys(name: str, content: Mapping[str, Any], cls: Any) -> None:
    known_keys(name, {key: part for key, part in content.items() if key != _TYPE},
               sorted(item.name for item in fields(cls) if item.init))


def _value(name: str, content: Mapping[str, Any], depth: int,
           expected: FieldKind | None = None) -> object:
    kind, alone = content.get(_TYPE), None
    if _TYPE not in content:
        alone = None if expected is None or expected.several else expected.kind
        if alone is Pose or 'position' in content and (alone is None or content.keys() <= _POSE):
            return pose_of(name, content)
    if isinstance(kind, str) and kind in ('Shape', 'Plan'):
        return _packed(name, kind, content)
    if isinstance(kind, str) and kind == _DICT:
        return {key: from_plain(f'{name}.{key}', part, depth + 1)
                for key, part in content.items() if key != _TYPE}
    known: dict[str, Any] = {cls.__name__: cls for cls in classes_below(Value) if is_dataclass(cls)}
    if alone is None and (not isinstance(kind, str) or kind not in known):
        raise InvalidTask(f'{name}.type = {shown(kind)}: expected the name of a class of tasks, '
                          'penalties, cut-outs or obstacles that has been imported'
                          f'{did_you_mean(kind, known)}')
    cls: Any = known[str(kind)] if alone is None else alone
    _judge_own_keys(name, content, cls)
    missing = [item.name for item in fields(cls) if item.init and item.name not in content
               and item.default is item.default_factory is MISSING]
    if missing:
        raise InvalidTask(f'{name}: expected {", ".join(missing)}')
    held = value_fields(cls)
    given = {key: from_plain(f'{name}.{key}', part, depth + 1, held.get(key))
             for key, part in content.items() if key != _TYPE}
    try:
        return cls(**given)
    except TypeError as error:
        raise InvalidTask(f'{name}: {error}') from None
    except (InvalidTask, InvalidRod) as error:  # which know the class, not where it stands
        raise type(error)(f'{name}: {error}') from None


def _packed(name: str, kind: str, content: Mapping[str, Any]) -> Shape | Plan:
    try:
        tree = nested({key: array_of(key, part) for key, part in content.items() if key != _TYPE})
        return plan_of(tree) if kind == 'Plan' else unpack(tree)
    except Exception as error:  # whatever another content makes of the reader
        raise InvalidTask(f'{name}: expected a {kind} as `Task.to_dict` writes it, {error}'
                          ) from None


def classes_below(cls: type[Value]) -> Iterator[type[Value]]:
    """Yield all classes derived from a class."""
    for one in cls.__subclasses__():
        yield one
        yield from classes_below(one)
