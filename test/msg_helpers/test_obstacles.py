# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles as markers: there and back, taken away, refused by name."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import Box, Capsule, InvalidTask, Pose, Sphere
from msg_helpers.markers import obstacle_markers
from msg_helpers.obstacles import obstacles_after

TURNED = Pose((0.1, -0.2, 0.3), (0.1, -0.2, 0.3, 0.9))
ALL = [Box(TURNED, (0.1, 0.2, 0.3)), Sphere((1, 2, 3), 0.4),
       Capsule((0.1, 0.2, 0.3), (0.5, -0.2, 0.6), 0.02)]


def shown(obstacles, before=0):
    return obstacle_markers(obstacles, before, 'world', Time())


def after(message, known=()):
    return obstacles_after(dict(known), message, 'world', 'obstacles')


def test_there_and_back():
    box, sphere, capsule = after(shown(ALL)).values()
    np.testing.assert_allclose(box.pose.matrix, ALL[0].pose.matrix, atol=1e-12)
    np.testing.assert_allclose(box.size, ALL[0].size)
    np.testing.assert_allclose(sphere.center, ALL[1].center)
    assert sphere.radius == pytest.approx(0.4)
    ends = [tuple(np.round(end, 9)) for end in (capsule.start, capsule.end)]
    assert sorted(ends) == sorted(tuple(np.round(end, 9)) for end in (ALL[2].start, ALL[2].end))
    assert capsule.radius == pytest.approx(0.02)


def test_what_is_gone_is_taken_away():
    known = after(shown(ALL))
    assert len(after(shown(ALL[:1], before=3), known)) == 1
    one = Marker(ns='obstacle', id=1, action=Marker.DELETE)
    assert list(after(MarkerArray(markers=[one]), known)) == [('obstacle', 0), ('obstacle', 2)]
    for namespace, left in (('obstacle', 0), ('', 0), ('other', 3)):
        everything = Marker(ns=namespace, action=Marker.DELETEALL)
        assert len(after(MarkerArray(markers=[everything]), known)) == left


@pytest.mark.parametrize(('field', 'value', 'named'), [
    ('type', Marker.ARROW, 'type = 0'), ('action', 7, 'action = 7')])
def test_what_is_no_obstacle_is_named(field, value, named):
    message = shown(ALL)
    setattr(message.markers[1], field, value)
    with pytest.raises(InvalidTask, match=rf'markers\[1\].*{named}'):
        after(message)


@pytest.mark.parametrize(('number', 'axis', 'value', 'named'), [
    (0, 'x', 0.0, 'above 0'), (0, 'y', float('nan'), 'above 0'), (1, 'x', 1.0, 'sphere'),
    (2, 'x', 1.0, 'round cylinder')])
def test_absurd_sizes_are_named(number, axis, value, named):
    message = shown(ALL)
    setattr(message.markers[number].scale, axis, value)
    with pytest.raises(InvalidTask, match=rf'markers\[{number}\].*{named}'):
        after(message)


def test_another_frame_is_named():
    message = shown(ALL)
    message.markers[2].header.frame_id = 'map'
    with pytest.raises(InvalidTask, match=r"markers\[2\].header.frame_id = 'map'"):
        after(message)
