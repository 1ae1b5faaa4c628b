# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Primitives as markers: there and back, over the wire, taken away."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import Pose
from dlo_planner.view.primitives import KINDS, Primitive
from msg_helpers.markers import deleting_marker, markers_from_primitives, primitives_after

STAMP = Time(sec=3)
POSE = Pose((1.0, -2.0, 3.5), (0.1, -0.2, 0.3, 0.9))


def example(kind, index=0):
    points = np.arange(18.0).reshape(6, 3) if kind in (
        'line', 'segments', 'points', 'triangles') else np.eye(3)[:2] if kind == 'arrow' else ()
    colors = np.linspace(0, 1, 18).reshape(6, 3) if kind == 'line' else None
    return Primitive('some thing', index, kind, (0.25, 0.5, 0.75), 0.5, points, colors, POSE,
                (1.0, 1.0, 1.0), 'text' if kind == 'text' else '')


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize('kind', KINDS)
def test_there_and_back(kind):
    item = example(kind)
    message = over_the_wire(markers_from_primitives([item], 'world', STAMP))
    assert message.markers[0].header.frame_id == 'world'
    again = primitives_after({}, message)[item.name]
    for name in ('kind', 'group', 'index', 'text', 'color', 'alpha'):
        assert getattr(again, name) == getattr(item, name)
    for name in ('points', 'size'):
        np.testing.assert_array_equal(getattr(again, name), getattr(item, name))
    np.testing.assert_allclose(again.pose.matrix, POSE.matrix, atol=1e-15)
    if item.colors is not None:
        np.testing.assert_allclose(again.colors, item.colors, atol=1e-7)  # float32


def test_what_is_deleted_is_gone():
    known = {item.name: item for item in (example('box', 0), example('box', 1))}
    gone = MarkerArray(markers=[deleting_marker('some thing', 1, 'world', STAMP)])
    assert list(primitives_after(known, gone)) == [('some thing', 0)]
    for namespace, left in (('some thing', 0), ('another', 2), ('', 0)):
        message = MarkerArray(markers=[Marker(ns=namespace, action=Marker.DELETEALL)])
        assert len(primitives_after(known, message)) == left
    assert len(known) == 2  # as it was


@pytest.mark.parametrize(('change', 'left'), [
    (lambda marker: setattr(marker.pose.position, 'x', float('nan')), 0),
    (lambda marker: setattr(marker.pose.orientation, 'w', 0.0) or setattr(
        marker.pose.orientation, 'x', 0.0) or setattr(marker.pose.orientation, 'y', 0.0)
        or setattr(marker.pose.orientation, 'z', 0.0), 0),
    (lambda marker: setattr(marker, 'type', Marker.MESH_RESOURCE), 0),
    (lambda marker: setattr(marker.color, 'a', 7.0), 1)])
def test_what_cannot_be_shown_is_left_out(change, left):
    message = markers_from_primitives([example('ball')], 'world', STAMP)
    change(message.markers[0])
    assert len(primitives_after({}, message)) == left
