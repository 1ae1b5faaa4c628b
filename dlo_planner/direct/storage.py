# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes and motions as npz or JSON files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dlo_planner.direct.contacts import Contact
from dlo_planner.direct.history import History
from dlo_planner.direct.json_arrays import read_json, write_json
from dlo_planner.direct.state import State
from dlo_planner.errors import InvalidTask
from dlo_planner.files import readable, writable
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import shown
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Constant

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.shape import Shape

T = TypeVar('T')
ShapeT = TypeVar('ShapeT', bound='Shape')

_FORMAT = 2  # 1: files of 0.1.0, which do not say what they hold
_MOST = 2**32  # bytes in a file, unpacked
_PAST, _WAY = 'past_', ('s', 'positions', 'tangents')
_RENAMED = {'Report': 'ValidationReport'}  # in older files
_ARRAYS = ('s', 'positions', 'frames', 'element_strains', 'gripper_wrench', 'far_wrench')
_NUMBERS = ('energy', 'elastic_energy', 'residual', 'stability', 'iterations', 'converged',
            'jumped', 'evaluations', 'violation', 'dissipated')


def pack(shape: Shape, prefix: str = '') -> dict[str, NDArray[Any]]:
    """Return a dict of arrays that hold all of a Shape but the rod and its surroundings."""
    packed = {name: getattr(shape, name) for name in _ARRAYS + _NUMBERS}
    packed['gripper'] = np.concatenate([shape.gripper.position, shape.gripper.quaternion])
    packed['error_estimate'] = shape.error_estimate
    if shape.far_end is not None:
        end = shape.far_end
        packed['far_end'] = np.concatenate([end.pose.position, end.pose.quaternion])
        packed['far_grip'] = end.grip
    packed['contacts'] = np.array([[c.obstacle, c.s, *c.position, *c.normal, c.force, *c.friction,
                                    c.penetration] for c in shape.contacts]).reshape(-1, 13)
    if shape.state.history is not None:
        past = shape.state.history
        packed |= {_PAST + name: array for name, array in past.left.items()}
        packed |= {_PAST + name: getattr(past, name) for name in _WAY}
    return {prefix + key: np.asarray(value) for key, value in packed.items()}


def unpack(shape_class: type[ShapeT], stored: Mapping[str, Any], prefix: str = '') -> ShapeT:
    """Return the Shape whose arrays are in the mapping `stored` under `prefix`."""
    def get(name: str) -> Any:
        return stored[prefix + name]

    gripper = get('gripper')
    far_end = None
    if prefix + 'far_end' in stored:
        end = get('far_end')
        far_end = FarEnd(Pose(end[:3], end[3:]), str(get('far_grip')))
    contacts = tuple(Contact(int(row[0]), row[1], row[2:5], row[5:8], row[8], row[9:12], row[12])
                     for row in get('contacts'))
    mark = prefix + _PAST
    past = {key[len(mark):]: stored[key] for key in stored if key.startswith(mark)}
    history = _history(past, get('frames')).judged(float(get('s')[-1])) if past else None
    estimate = float(get('error_estimate'))
    values = {name: get(name) for name in _ARRAYS}
    values |= {name: get(name).item() for name in _NUMBERS}
    return shape_class(gripper=Pose(gripper[:3], gripper[3:]), contacts=contacts, far_end=far_end,
                       state=State(history=history, estimate=Constant(estimate)), **values)


def _history(past: dict[str, Any], frames: Floats) -> History:
    """Return the History of arrays by name; those of older files lack some."""
    s, positions = past.pop('s'), past.pop('positions')
    tangents = past.pop('tangents', frames[:len(positions), :, 0])
    past['set'] = past['set'].reshape(len(past['set']), -1)  # files of 0.1.0: layers apart
    for name in ('point_shear', 'point_slid'):  # not in files of 1.0
        past.setdefault(name, np.zeros_like(past['point_anchor']))
    return History(s, past, positions, tangents)


def save(path: str | PathLike[str], arrays: Mapping[str, Any], kind: str) -> None:
    """Write a mapping of arrays: as JSON where `path` ends with .json, else as compressed npz.

    Both keep every number exactly.

    Parameters
    ----------
    kind : str
        Name of the value that they hold, e.g. 'Plan'.

    Raises
    ------
    InvalidTask
        Nothing can be written there.
    """
    target = writable(path)
    if not _is_json(path) and target.suffix != '.npz':
        target = writable(target.with_name(f'{target.name}.npz'))
    marked = {'format': _FORMAT, 'kind': kind, **arrays}
    try:
        if _is_json(path):
            write_json(target, {name: np.asarray(one) for name, one in marked.items()})
        else:
            np.savez_compressed(target, **marked)
    except (OSError, ValueError) as error:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file to write, '
                          f'{error}') from None


def load(path: str | PathLike[str], read: Callable[[dict[str, NDArray[Any]]], T], kind: str) -> T:
    """Return what `read` makes of the mapping of arrays in a file that `save` wrote for a `kind`.

    Raises
    ------
    InvalidTask
        Not such a file; the message names it.
    """
    readable(path)
    written = 'a JSON' if _is_json(path) else 'an npz'
    try:
        arrays = read_json(path) if _is_json(path) else _read_npz(path)
        known, held = int(arrays.pop('format', -1)), str(arrays.pop('kind', kind))
        held = _RENAMED.get(held, held)
    except Exception as error:  # whatever another file makes of the reader
        raise InvalidTask(f'path = {shown(str(path))}: expected {written} file, {error}') from None
    if not 1 <= known <= _FORMAT:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file saved by this package, '
                          f'format {_FORMAT}, it has {known if known >= 0 else "none"}')
    if held != kind:
        raise InvalidTask(f'path = {shown(str(path))}: expected a file that holds a {kind}, it '
                          f'holds a {held}')
    try:
        return read(arrays)
    except Exception as error:  # the same
        raise InvalidTask(f'path = {shown(str(path))}: expected another kind of file, or it is '
                          f'damaged: {error}') from None


def _is_json(path: str | PathLike[str]) -> bool:
    return Path(path).suffix.lower() == '.json'


def _read_npz(path: str | PathLike[str]) -> dict[str, NDArray[Any]]:
    with np.load(path) as stored:
        size = sum(one.file_size for one in stored.zip.infolist())
        if size > _MOST:
            raise ValueError(f'of at most {_MOST} bytes, not {size}')
        return dict(stored)
