# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses, obstacles and observations from files and options."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import DloPlannerError, InvalidTask
from dlo_planner.files import text_of
from dlo_planner.identify.observation import Observation
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import row, shown
from dlo_planner.model.obstacles import OBSTACLES, Obstacle, Sheet
from dlo_planner.model.pose import Pose
from dlo_planner.settings.guarded_yaml import read_yaml

_LEVEL = (0.0, 0.0, 0.0, 1.0)


def pose_of_numbers(name: str, numbers: Sequence[float]) -> Pose:
    """Return the Pose of 3 (level), 6 (place, direction) or 7 numbers (place, quaternion).

    Raises
    ------
    InvalidTask
        Another count, or no pose.
    """
    given = row(name, numbers)
    if given.size == 3:
        return Pose(given, _LEVEL)
    if given.size == 6:
        return Pose.looking_along(given[:3], given[3:])
    if given.size == 7:
        return Pose(given[:3], given[3:])
    raise InvalidTask(f'{name} = {shown(given.tolist())}: expected 3, 6 or 7 numbers: a place, '
                      'and a direction or a quaternion')


def pose_of(name: str, content: object) -> Pose:
    """Return the Pose that a part of a YAML file says: numbers, or as geometry_msgs/Pose.

    Raises
    ------
    InvalidTask
        It is no pose.
    """
    if isinstance(content, list):
        return pose_of_numbers(name, content)
    if not isinstance(content, dict) or 'position' not in content:
        raise InvalidTask(f'{name} = {shown(content)}: expected position and orientation, or '
                          '3, 6 or 7 numbers')
    turned = content.get('orientation', content.get('quaternion', _LEVEL))
    return Pose(_numbers(f'{name}.position', content['position'], 'xyz'),
                _numbers(f'{name}.orientation', turned, 'xyzw'))


def read_poses(path: Path) -> list[Pose]:
    """Return the Poses of a YAML or JSON file: a list of poses, as `-o x.poses.yaml` writes it."""
    content = read_yaml(path)
    if isinstance(content, dict):
        content = content.get('poses')
    if not isinstance(content, list) or not content:
        raise InvalidTask(f'{path}: expected a list of poses')
    return [pose_of(f'{path}[{k}]', one) for k, one in enumerate(content)]


def read_obstacles(path: Path) -> tuple[Obstacle, ...]:
    """Return the obstacles of a YAML file.

    Raises
    ------
    InvalidTask
        Naming what is wrong.
    """
    content = read_yaml(path)
    if not isinstance(content, list):
        raise InvalidTask(f'{path}: expected a list of obstacles')
    return tuple(_obstacle(f'{path}[{k}]', one) for k, one in enumerate(content))


def read_observations(paths: Sequence[Path], grippers: Sequence[Pose]) -> list[Observation]:
    """Return Observations: of YAML files, each with its grippers; of CSV files x, y, z.

    Parameters
    ----------
    paths : sequence of Path
        Paths of the files.
    grippers : sequence of Pose
        Poses, one for each CSV file.

    Raises
    ------
    InvalidTask
        Naming what is wrong.
    """
    tables = [path for path in paths if path.suffix.lower() == '.csv']
    if len(tables) != len(grippers):
        raise InvalidTask(f'--gripper was given {len(grippers)} times: expected once for each of '
                          f'the {len(tables)} CSV files')
    left, out = iter(grippers), []
    for path in paths:
        if path.suffix.lower() == '.csv':
            out.append(Observation(next(left), _table(path)))
        else:
            out += _observations(path)
    return out


def _observations(path: Path) -> list[Observation]:
    content = read_yaml(path)
    if isinstance(content, dict):
        content = content.get('observations', [content])
    if not isinstance(content, list) or not content:
        raise InvalidTask(f'{path}: expected a list of observations')
    out = []
    for k, one in enumerate(content):
        if not isinstance(one, dict) or not {'gripper', 'points'} <= one.keys():
            raise InvalidTask(f'{path}[{k}]: expected gripper: and points:')
        out.append(Observation(pose_of(f'{path}[{k}].gripper', one['gripper']), one['points'],
                               one.get('s')))
    return out


def _table(path: Path) -> Floats:
    """Return (n, 3) of a CSV file, its heading left out."""
    rows: list[list[float]] = []
    try:
        table = list(csv.reader(text_of(path).splitlines()))
    except csv.Error as error:
        raise InvalidTask(f'{path}: expected lines of x, y, z, {error}') from None
    for number, cells in enumerate(table, start=1):
        try:
            rows.append([float(cell) for cell in cells[:3]])
        except ValueError:
            if number > 1:
                raise InvalidTask(f'{path}, line {number}: expected x, y, z') from None
    if not rows or any(len(one) != 3 for one in rows):
        raise InvalidTask(f'{path}: expected lines of x, y, z in m')
    return np.array(rows)


def _obstacle(name: str, content: object) -> Obstacle:
    if not isinstance(content, dict) or len(content) != 1:
        raise InvalidTask(f'{name} = {shown(content)}: expected one of {", ".join(_KINDS)}')
    kind, attributes = next(iter(content.items()))
    if kind not in _KINDS or not isinstance(attributes, dict):
        raise InvalidTask(f'{name}: expected one of {", ".join(_KINDS)}, with its values')
    known = [item.name for item in _fields_of(_KINDS[kind])]
    for key in attributes:
        if key not in known:
            raise InvalidTask(f'{name}.{kind}.{key}: expected one of {", ".join(known)}')
    for item in _fields_of(_KINDS[kind]):
        if item.default is MISSING and item.name not in attributes:
            raise InvalidTask(f'{name}.{kind}: expected {item.name}')
    try:
        return _KINDS[kind](**{key: pose_of(f'{name}.pose', part) if key == 'pose' else part
                               for key, part in attributes.items()})
    except DloPlannerError as error:
        raise InvalidTask(f'{name}: {error}') from None


def _fields_of(kind: Any) -> tuple[Field[Any], ...]:
    return fields(kind)


_KINDS: dict[str, Callable[..., Obstacle]] = {
    one.__name__.lower(): one for one in OBSTACLES if one is not Sheet}  # that has holes


def _numbers(name: str, content: Any, keys: str) -> ArrayLike:
    if isinstance(content, dict):
        if not set(content) <= set(keys):
            raise InvalidTask(f'{name} = {shown(content)}: expected {", ".join(keys)}')
        given = {**dict.fromkeys(keys, 0.0), **content}
        if keys == 'xyzw' and not content.get('w') and not any(content.values()):
            given['w'] = 1.0
        return [given[key] for key in keys]
    return row(name, content)
