# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is too large is refused before it is looked at, and nothing long goes out."""

import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner import InvalidTask
from dlo_planner.execute.causes import Cause, Refused
from dlo_planner.model.checks import shown
from dlo_planner.ros.inputs import Frames, bodies_in, brief_text, pose_in
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.parameters import PARAMETERS
from msg_helpers.poses import pose_from_stamped

VALUES = {name: entry.default for name, entry in PARAMETERS.items()}
SCENE = Scene.of(VALUES)
LONG = 'x' * 10_000_000


def told(kind, call, *arguments):
    """Return what a call refuses with."""
    with pytest.raises(kind) as refused:
        call(*arguments)
    assert len(str(refused.value)) < 400
    return refused.value


def test_a_long_frame_is_neither_looked_up_nor_said():
    msg = PoseStamped(header=Header(frame_id=LONG))
    error = told(Refused, pose_in, SCENE, msg, 'gripper_pose')
    assert error.cause == Cause.INVALID_FRAME
    assert str(error) == ('gripper_pose.header.frame_id has 10000000 characters: expected 256 at '
                          'most')
    told(InvalidTask, pose_from_stamped, msg, 'world', 'pose')
    assert 'expected \'world\'' in str(told(Refused, Frames().origin, Header(
        frame_id='x' * 256), 'world', 'pose'))


def test_long_names_and_many_markers_are_refused():
    error = told(Refused, bodies_in, SCENE, MarkerArray(markers=[
        Marker(), Marker(ns=LONG, action=Marker.DELETE)]), 'obstacles')
    assert error.cause == Cause.INVALID_OBSTACLES
    assert 'obstacles.markers[1].ns has 10000000 characters' in str(error)
    delete = Marker(action=Marker.DELETE)
    assert bodies_in(SCENE, MarkerArray(markers=[delete] * 10_000), 'obstacles') == {}
    error = told(Refused, bodies_in, SCENE, MarkerArray(markers=[delete] * 10_001), 'obstacles')
    assert 'obstacles.markers has 10001 entries: expected 10000 at most' in str(error)


@pytest.mark.parametrize(('name', 'value'), [
    ('rod.name', LONG), ('markers.color', LONG), ('gravity', [0.0] * 100_000)])
def test_long_parameters_are_refused_by_name(name, value):
    error = told(InvalidTask, Scene.of, {**VALUES, name: value})
    assert f'parameter {name} has {len(value)}' in str(error)


def test_what_goes_out_is_short():
    assert brief_text('short') == 'short'
    assert len(brief_text(LONG)) < 2100 and '(10000000 characters)' in brief_text(LONG)
    assert len(shown(LONG)) <= 120 and len(shown(LONG.encode())) <= 120
    assert shown('short') == "'short'" and shown('y' * 119).endswith(' ...')
