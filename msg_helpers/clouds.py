# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points <-> sensor_msgs/PointCloud2."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike
from sensor_msgs.msg import PointCloud2, PointField

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, shown
from msg_helpers.poses import header

_TYPES = {PointField.FLOAT32: 'f4', PointField.FLOAT64: 'f8'}
_AXES = 'xyz'
_MOST_FIELDS = 64
_MOST_POINTS = 1_000_000
_LONGEST_STEP = 4096  # bytes of a point
_SHOWN = 40  # characters of a field's name in a message


def points_from_cloud(msg: PointCloud2, name: str) -> Floats:
    """Return the points (n, 3), m, of a PointCloud2, in the order and frame of the message.

    A point with a coordinate that is not finite was not seen, and is left out.
    """
    instance('msg', msg, PointCloud2)
    for what, count, most in (
            ('fields', len(msg.fields), _MOST_FIELDS),
            ('point_step', msg.point_step, _LONGEST_STEP),
            ('height x width', msg.height * msg.width, _MOST_POINTS)):
        if count > most:
            raise InvalidTask(f'{name}.{what} = {count}: expected {most} at most')
    known = {field.name: field for field in msg.fields}
    for axis in _AXES:
        if axis not in known or known[axis].datatype not in _TYPES:
            raise InvalidTask(f'{name}.fields: expected {axis} as FLOAT32 or FLOAT64, got '
                              f'{shown(sorted(one[:_SHOWN] for one in known))}')
        if known[axis].offset > _LONGEST_STEP:
            raise InvalidTask(f'{name}.fields: the offset of {axis} is {known[axis].offset}: '
                              f'expected {_LONGEST_STEP} at most')
    order = '>' if msg.is_bigendian else '<'
    formats = [order + _TYPES[known[axis].datatype] for axis in _AXES]
    offsets = [int(known[axis].offset) for axis in _AXES]
    least = max(offset + np.dtype(one).itemsize
                for offset, one in zip(offsets, formats, strict=True))
    if msg.point_step < least:
        raise InvalidTask(f'{name}.point_step = {msg.point_step}: expected {least} bytes at least')
    if msg.row_step < msg.width * msg.point_step:
        raise InvalidTask(f'{name}.row_step = {msg.row_step}: expected width times point_step, '
                          f'{msg.width * msg.point_step} bytes, at least')
    if len(msg.data) < msg.height * msg.row_step:
        raise InvalidTask(f'{name}.data has {len(msg.data)} bytes: expected height times row_step, '
                          f'{msg.height * msg.row_step}')
    kind = np.dtype({'names': list(_AXES), 'formats': formats, 'offsets': offsets,
                     'itemsize': int(msg.point_step)})
    points = np.ndarray((msg.height, msg.width), kind,
                        bytes(memoryview(msg.data)[:msg.height * msg.row_step]),
                        strides=(msg.row_step, msg.point_step)).reshape(-1)
    out = np.stack([points[axis].astype(float) for axis in _AXES], axis=1)
    result: Floats = out[np.isfinite(out).all(axis=1)]
    return result


def cloud_msg(points: ArrayLike, frame_id: str, stamp: Time | None = None) -> PointCloud2:
    """Return points (n, 3), m, as a PointCloud2 of FLOAT32 x, y, z, one row."""
    data = array('points', points, (None, 3)).astype('<f4')
    size = data.itemsize
    return PointCloud2(
        header=header(frame_id, stamp), height=1, width=len(data), is_bigendian=False,
        is_dense=True, point_step=3 * size, row_step=3 * size * len(data),
        fields=[PointField(name=axis, offset=k * size, datatype=PointField.FLOAT32, count=1)
                for k, axis in enumerate(_AXES)], data=data.tobytes())
