# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""All markers in every message, and those that are gone deleted."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sphere,
)
from dlo_planner.ros.markers import MarkerCache
from dlo_planner.view.scene import (
    axes_primitives,
    estimate_primitives,
    obstacle_primitives,
    plan_primitives,
    shape_primitives,
)
from msg_helpers.markers import primitives_after

STAMP = Time(sec=1)
LEVEL = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
SOFT = Rod(1.0, 0.5, 0.05, 0.04, radius=0.005)


@pytest.fixture(scope='module')
def touching():
    floor = Plane((0, 0, 0.95), (0, 0, 1))
    return DirectSimulator(SOFT, n_elements=24, n_terms=12, obstacles=[floor]).track([LEVEL])[0]


@pytest.fixture(scope='module')
def hanging():
    return DirectSimulator(SOFT, n_elements=24, n_terms=12).solve(LEVEL)


def shown(picture_messages, missed=()):
    """Return what a viewer shows that has missed some messages."""
    known = {}
    for index, message in enumerate(picture_messages):
        if index not in missed:
            known = primitives_after(known, message)
    return known


def groups(known):
    return {name[0] for name in known}


def show(picture, part, primitives):
    picture.show(part, 'world', STAMP, lambda: primitives)
    assert picture.flush()


def test_contacts_that_end_are_deleted_whatever_was_missed(touching, hanging):
    messages = []
    picture = MarkerCache(messages.append)
    for shape in (hanging, touching, hanging, hanging):
        show(picture, 'shape', shape_primitives(shape))
    assert 'contact' in groups(shown(messages[:2])) and 'contact force' in groups(
        shown(messages[:2]))
    for missed in ((), (2,), (0, 2)):
        assert groups(shown(messages, missed)) == {'dlo', 'scale', 'gripper'}
    everything = [(one.ns, one.id) for one in messages[-1].markers]
    assert len(set(everything)) == len(everything)


def test_parts_do_not_touch_each_other(hanging):
    messages = []
    picture = MarkerCache(messages.append)
    hole = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.03)
    stiff = DirectSimulator(Rod(1.0, 0.1, 1.0, 0.7, radius=0.01), n_elements=12, n_terms=6)
    plan = InverseSimulator(stiff).thread(hole, depths=np.linspace(0, 0.4, 6))
    show(picture, 'shape', shape_primitives(hanging, 'yield'))
    show(picture, 'plan', plan_primitives(plan, [hole]))
    show(picture, 'command', axes_primitives('command', LEVEL))
    show(picture, 'estimate', estimate_primitives(hanging, hanging.positions[1:4]))
    assert groups(shown(messages[-1:])) == {
        'dlo', 'scale', 'gripper', 'cutout', 'trajectory', 'plate', 'margin', 'rim margin',
        'ghost', 'command', 'estimate', 'observed'}
    picture.hide('command')
    assert picture.flush()
    assert 'command' not in groups(shown(messages))
    assert all(marker.header.frame_id == 'world' for marker in messages[-1].markers)
    assert {marker.action for marker in messages[-1].markers} == {Marker.ADD, Marker.DELETE}


def test_only_the_newest_is_made():
    messages, made = [], []
    picture = MarkerCache(messages.append)

    def command(number):
        made.append(number)
        return axes_primitives('command', LEVEL)

    for number in range(100):
        picture.show('command', 'world', STAMP, lambda number=number: command(number))
    assert picture.flush() and made == [99] and len(messages) == 1
    assert not picture.flush() and len(messages) == 1


def test_what_cannot_be_made_leaves_the_rest():
    messages = []
    picture = MarkerCache(messages.append)
    show(picture, 'command', axes_primitives('command', LEVEL))
    picture.show('shape', 'world', STAMP, lambda: 1 / 0)
    picture.show('obstacles', 'world', STAMP,
                 lambda: obstacle_primitives([Sphere((0, 0, 0), 0.1)]))
    with pytest.raises(ZeroDivisionError):
        picture.flush()
    assert groups(shown(messages)) == {'command', 'obstacle'}
