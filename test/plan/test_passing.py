# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a DLO is from the centers that it passes between two waypoints."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.trajectory.dynamic_check import worst_miss


@pytest.fixture(scope='module')
def shape():
    return DirectSimulator(Rod(1.0, 0.1, 2.0, 1.5)).solve(Pose((0, 0, 1), (0, 0, 0, 1)))


def passed(center, s):
    return [(np.array(center), s, None)]


@pytest.mark.parametrize(('s', 'then'), [(0.4, 0.7), (0.7, 0.4), (0.55, 0.55)])
def test_any_arc_length_between_may_be_in_the_center(shape, s, then):
    frame = shape.at(0.55)
    center = frame.position + 0.003 * frame.rotation[:, 1]
    assert worst_miss(shape, passed(center, s), passed(center, then)) == pytest.approx(3e-3)


def test_no_arc_length_beyond_is(shape):
    center = shape.positions_at([0.8])[0]
    away = np.linalg.norm(shape.positions_at([0.7])[0] - center)
    for s, then in ((0.4, 0.7), (0.7, 0.4)):
        assert worst_miss(shape, passed(center, s), passed(center, then)) == pytest.approx(away)


def test_a_center_of_one_waypoint_alone_counts_once_the_free_end_is_beyond_it(shape):
    first, end = shape.positions_at([0.5])[0], shape.at(1.0)
    ahead = end.position + 0.05 * end.direction
    reached = shape.positions_at([0.9])[0] + 2e-3 * shape.at(0.9).rotation[:, 1]
    for center, away in ((ahead, 0.0), (reached, 2e-3)):
        later = [*passed(first, 0.5), *passed(center, 0.85)]
        for one, other in ((passed(first, 0.5), later), (later, passed(first, 0.5))):
            assert worst_miss(shape, one, other) == pytest.approx(away, abs=1e-9)
