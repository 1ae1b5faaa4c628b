# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses as people write them in files and on a command line: numbers, or names and numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import known_keys, row, shown
from dlo_planner.model.pose import Pose

_LEVEL = (0.0, 0.0, 0.0, 1.0)
_KEYS = ('position', 'orientation', 'quaternion')  # the last two mean the same


def pose_of_numbers(name: str, numbers: Sequence[float]) -> Pose:
    """Return the Pose of 3 (level), 6 (place, direction) or 7 numbers (place, quaternion)."""
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
    """Return the Pose that a part of a file says: numbers, or as geometry_msgs/Pose."""
    if isinstance(content, Pose):
        return content
    if isinstance(content, list | tuple):
        return pose_of_numbers(name, content)
    if not isinstance(content, Mapping):
        raise InvalidTask(f'{name} = {shown(content)}: expected position and orientation, or '
                          '3, 6 or 7 numbers')
    known_keys(name, content, _KEYS)
    if 'position' not in content:
        raise InvalidTask(f'{name} = {shown(content)}: expected position, and orientation')
    turned = [key for key in _KEYS[1:] if key in content]
    if len(turned) == 2:
        raise InvalidTask(f'{name}: expected orientation or quaternion, which mean the same, not '
                          'both')
    try:
        return Pose(_numbers(f'{name}.position', content['position'], 'xyz'),
                    _numbers(f'{name}.{turned[0]}', content[turned[0]], 'xyzw') if turned
                    else _LEVEL)
    except InvalidTask as error:  # which knows the class, not where it stands
        said = str(error)
        raise InvalidTask(said if said.startswith(name) else f'{name}: {said}') from None


def _numbers(name: str, content: Any, keys: str) -> Any:
    """Return the numbers of {x: ..., y: ...}, of which those left out are 0; else what it is."""
    if not isinstance(content, Mapping):
        return content
    known_keys(name, content, keys)
    given = {**dict.fromkeys(keys, 0.0), **content}
    if keys == 'xyzw' and 'w' not in content and not any(content.values()):
        given['w'] = 1.0
    return [given[key] for key in keys]
