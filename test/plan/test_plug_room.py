# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a plug in the hand first touches something on a path, beside places looked at closely."""

import numpy as np
import pytest

from dlo_planner.model.obstacles import Box, Sphere
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plug_room import PlugRoom

PLUG = Plug(0.2, 0.01, 0.1)


def path(*poses):
    """Return the path through Poses, one a second."""
    return GripperPath.through(poses, np.arange(len(poses), dtype=float), 1.0)


def closely(plug, way, sphere):
    """Return the least distance of a plug from a Sphere on a path, by many places."""
    positions, rotations = way.at(np.linspace(0, way.times[-1], 1201))
    x = np.linspace(*plug.ends, 201)
    back = plug.grasp.inverse()
    axis = back.position + x[:, None] * back.rotation[:, 0]
    places = positions[:, None] + np.einsum('nij,kj->nki', rotations, axis)
    return np.linalg.norm(places - sphere.center, axis=2).min() - sphere.radius - plug.radius


@pytest.mark.parametrize('turned', [False, True])
def test_a_touch_is_found_exactly_where_there_is_one(turned):
    rng, found = np.random.default_rng(4), []
    for _ in range(20):
        begin = Pose(rng.uniform(-0.1, 0.1, 3), (0, 0, 0, 1))
        angle = rng.uniform(-2.0, 2.0) if turned else 0.0
        end = Pose(begin.position + (0 if turned else 1) * rng.uniform(-0.3, 0.3, 3),
                   (0, np.sin(angle / 2), 0, np.cos(angle / 2)))
        way = path(begin, end)
        front = PLUG.front(Pose.from_rotation(*(part[0] for part in way.at(rng.uniform(0.1, 0.9)))))
        beside = rng.normal(size=3)
        sphere = Sphere(front.position - rng.uniform(0, 0.2) * front.rotation[:, 0]
                        + rng.uniform(0, 0.06) * beside / np.linalg.norm(beside), 0.02)
        room = closely(PLUG, way, sphere)
        touched = PlugRoom(PLUG, [sphere]).first_touch(way)
        if abs(room) > 2e-4:
            assert (touched is not None) == (room < 0), (room, touched)
        found.append(touched is not None)
    assert 3 < sum(found) < 17


def test_a_thin_body_beside_the_middle_of_the_plug_is_seen():
    needle = Box(Pose((-0.083, 0.0, 0.0), (0, 0, 0, 1)), (1e-3, 1.0, 1e-3), name='needle')
    touched = PlugRoom(PLUG, [needle]).first_touch(path(
        Pose((0, 0, 0.5), (0, 0, 1, 0)), Pose((0, 0, -0.5), (0, 0, 1, 0))))
    assert touched is None  # the plug is on the other side of the gripper
    touched = PlugRoom(PLUG, [needle]).first_touch(path(
        Pose((0, 0, 0.5), (0, 0, 0, 1)), Pose((0, 0, -0.5), (0, 0, 0, 1))))
    assert touched is not None and touched[0] == 1 and touched[2] == 'needle'


def test_where_it_stands():
    wall = Box(Pose((-0.25, 0, 0), (0, 0, 0, 1)), (0.02, 1, 1), name='wall')
    room, body = PlugRoom(PLUG, [Sphere((5, 0, 0), 0.1), wall]).at(Pose((0, 0, 0), (0, 0, 0, 1)))
    assert room == pytest.approx(0.04, abs=1e-9) and body == 'wall'
    assert PlugRoom(PLUG, []).at(Pose((0, 0, 0), (0, 0, 0, 1))) == (np.inf, '')
