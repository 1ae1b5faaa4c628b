# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What ~/markers shows of a node that works."""

import pytest
from node_inside import GOAL, HERE, box, clear
from planner_process import until
from visualization_msgs.msg import MarkerArray

from dlo_planner.ros.lifecycle import LATCHED
from msg_helpers.markers import primitives_after


@pytest.fixture
def shown(inside):
    """Yield a function that returns what RViz would show now, by name."""
    known = {}

    def hear(msg):
        after = primitives_after(known, msg)
        known.clear()
        known.update(after)

    subscription = inside.node.create_subscription(MarkerArray, f'{inside.planner}/markers', hear,
                                                   LATCHED)
    yield lambda: dict(known)
    inside.node.destroy_subscription(subscription)


def groups(items):
    return {name[0] for name in items}


def caption(items):
    return items['scale', 0].text if ('scale', 0) in items else ''


def test_all_parts_are_shown_and_go(inside, node, shown):
    assert inside.set_parameters(cutouts__radius=0.02)[0].successful
    inside.shape_for(HERE)
    inside.plan_threading(HERE, GOAL)
    inside.send_obstacles([box(1, 3.0)])
    wanted = {'dlo', 'scale', 'gripper', 'cutout', 'trajectory', 'plate', 'margin', 'rim margin',
              'ghost', 'obstacle'}
    assert until(lambda: wanted <= groups(shown()))
    clear(inside, node)
    assert until(lambda: 'obstacle' not in groups(shown()))
    assert wanted - {'obstacle'} <= groups(shown())
    inside.set_parameters(cutouts__radius=0.0)


def test_the_color_is_a_parameter(inside, node, shown):
    answer = inside.set_parameters(markers__color='rainbow')[0]
    assert not answer.successful and "markers.color = 'rainbow': expected one of" in answer.reason
    assert inside.set_parameters(markers__color='yield')[0].successful
    inside.shape_for(HERE)
    assert until(lambda: 'never yields' in caption(shown()))
    assert inside.set_parameters(markers__color='curvature')[0].successful
    inside.shape_for(HERE)
    assert until(lambda: 'curvature' in caption(shown()))
