# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of several arms: what holds where, and what each is told of the coming time."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker

from dlo_planner import FarEnd, Hold, InvalidTask, Pose
from msg_helpers.markers import holds_msg
from msg_helpers.poses import pose_from_msg
from msg_helpers.trajectories import poses_ahead, stamped_poses

LEVEL = (0, 0, 0, 1)
WAYS = {name: [Pose((x, y, 1.0), LEVEL) for x in (0.0, 0.1, 0.2)]
        for name, y in (('gripper', 0.0), ('first', 0.3), ('second', 0.6))}


def test_each_arm_finds_its_poses_by_its_name():
    msg = poses_ahead([0.0, 0.02, 0.04], WAYS['gripper'], 'world', 12.5, {
        name: WAYS[name] for name in ('first', 'second')})
    assert msg.joint_names == ['gripper', 'first', 'second'] and msg.header.frame_id == 'world'
    for name, way in WAYS.items():
        times, poses = stamped_poses(msg, name)
        np.testing.assert_allclose(times, [12.5, 12.52, 12.54], atol=1e-9)
        assert poses == way
    assert stamped_poses(msg)[1] == WAYS['gripper']  # as one that knows of no others takes it
    with pytest.raises(InvalidTask, match="expected one of .*first.*second"):
        stamped_poses(msg, 'third')
    msg.points[1].transforms.pop()
    with pytest.raises(InvalidTask, match='a transform in each for each joint'):
        stamped_poses(msg, 'second')


def test_a_way_of_another_length_is_refused_by_the_name_of_its_arm():
    with pytest.raises(InvalidTask, match='first has 2 entries: expected 3, as times'):
        poses_ahead([0.0, 0.02, 0.04], WAYS['gripper'], 'world', 0.0, {
            'first': WAYS['first'][:2]})


def test_what_holds_is_an_arrow_with_name_grip_and_place():
    holds = [Hold(Pose((0.1, 0.2, 0.3), (0, 0, 0.6, 0.8)), 'ring', 0.25, 0.5, by='fork 1'),
             FarEnd(Pose((0.5, 0.0, 0.0), LEVEL), 'pinned')]
    first, *arrows = holds_msg(holds, 'world', Time(sec=3)).markers
    assert first.action == Marker.DELETEALL  # what was shown before is gone
    assert [(one.ns, one.text) for one in arrows] == [('fork 1', 'ring at 0.25 m'),
                                                      ('far_end', 'pinned at the tip')]
    for hold, one in zip(holds, arrows, strict=True):
        assert (one.type, one.header.frame_id, one.header.stamp.sec) == (Marker.ARROW, 'world', 3)
        np.testing.assert_allclose(pose_from_msg(one.pose).matrix, hold.pose.matrix, atol=1e-12)
        assert one.scale.x > 0 and one.color.a == 1.0
    assert len(holds_msg((), 'world', Time()).markers) == 1
