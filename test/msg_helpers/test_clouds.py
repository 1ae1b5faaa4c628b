# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points through PointCloud2."""

import struct

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from dlo_planner import InvalidTask
from msg_helpers.clouds import cloud_msg, points_from_cloud

POINTS = np.array([[0.5, -1.25, 2.0], [0.0, 0.25, -0.125], [1.0, 1.0, 1.0]])


def test_there_and_back():
    msg = cloud_msg(POINTS, 'camera')
    assert (msg.header.frame_id, msg.width, msg.height) == ('camera', 3, 1)
    np.testing.assert_array_equal(points_from_cloud(msg, 'cloud'), POINTS)
    msg.width, msg.row_step, msg.data = 0, 0, b''
    assert points_from_cloud(msg, 'cloud').shape == (0, 3)


def test_rows_paddings_doubles_and_the_other_byte_order():
    # z, an intensity, x, y, 4 bytes of nothing; 2 rows with 3 bytes at the end of each
    kinds = (('z', 0, PointField.FLOAT64), ('intensity', 8, PointField.UINT16),
             ('x', 10, PointField.FLOAT64), ('y', 18, PointField.FLOAT32))
    fields = [PointField(name=name, offset=offset, datatype=kind, count=1)
              for name, offset, kind in kinds]
    rows = [[(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)], [(7.0, 8.0, 9.0), (np.nan, 0.0, 0.0)]]
    data = b''.join(b''.join(struct.pack('>dHdf4x', z, 7, x, y) for x, y, z in row) + b'abc'
                    for row in rows)
    msg = PointCloud2(height=2, width=2, fields=fields, is_bigendian=True, point_step=26,
                      row_step=55, data=data)
    np.testing.assert_array_equal(points_from_cloud(msg, 'cloud'),
                                  [[1, 2, 3], [4, 5, 6], [7, 8, 9]])


@pytest.mark.parametrize(('change', 'named'), [
    ({'fields': []}, r'cloud.fields: expected x as FLOAT32 or FLOAT64, got \[\]'),
    ({'data': b'abc'}, 'cloud.data has 3 bytes: expected height times row_step, 36'),
    ({'point_step': 8}, 'cloud.point_step = 8: expected 12 bytes at least'),
    ({'row_step': 20}, 'cloud.row_step = 20: expected width times point_step, 36 bytes'),
    ({'width': 4}, 'cloud.row_step = 36'),
    ({'height': 2}, 'cloud.data has 36 bytes'),
])
def test_what_does_not_fit_is_refused(change, named):
    msg = cloud_msg(POINTS, 'camera')
    for name, value in change.items():
        setattr(msg, name, value)
    with pytest.raises(InvalidTask, match=named):
        points_from_cloud(msg, 'cloud')


def fields(**changed):
    """Return x, y, z; `changed`: offsets."""
    return [PointField(name=axis, offset=changed.get(axis, 4 * k), datatype=PointField.FLOAT32,
                       count=1) for k, axis in enumerate('xyz')]


@pytest.mark.parametrize(('msg', 'named'), [
    (PointCloud2(fields=fields(x=2**32 - 1), point_step=12), 'the offset of x is 4294967295'),
    (PointCloud2(fields=fields(z=2**31), point_step=2**32 - 1, width=1), 'point_step = 4294967295'),
    (PointCloud2(fields=fields(), point_step=12, width=2**32 - 1, height=2**32 - 1),
     'height x width = 18446744065119617025: expected 1000000 at most'),
    (PointCloud2(fields=fields() * 22), 'fields = 66: expected 64 at most'),
    (PointCloud2(fields=[PointField(name='x' * 10_000_000)]), 'expected x as FLOAT32')])
def test_what_is_too_large_is_refused_before_it_is_looked_at(msg, named):
    with pytest.raises(InvalidTask, match=named) as refused:
        points_from_cloud(msg, 'cloud')
    assert str(refused.value).startswith('cloud.') and len(str(refused.value)) < 300
