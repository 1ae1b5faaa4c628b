# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fittings of the cell's plant: what lies in them is held, and what shuts a fork comes later."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from dlo_planner import Box, FarEnd, Hold, InvalidTask, Pose, Rod  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402

CABLE = Rod(0.5, 0.02, 4e-3, 4e-3, radius=3e-3)
LEVEL = (0, 0, 0, 1)
BEGIN, END = Pose((0.0, 0.0, 0.3), LEVEL), Pose((0.48, 0.0, 0.3), LEVEL)
PERIOD = 0.02


def seat():
    """Return where the middle of the cable hangs."""
    return Plant(CABLE, BEGIN, cells=32, step=2e-3, damping=0.2, far_end=FarEnd(END)).points(
        [0.21])[0]


@cache
def middle():
    return tuple(seat())


def plant(grip='pinned', off=(0.0, 0.0, 0.0), obstacles=()):
    place = Pose(np.array(middle()) + off, LEVEL)
    return Plant(CABLE, BEGIN, obstacles, cells=32, step=2e-3, damping=0.2, far_end=FarEnd(END),
                 fittings=[Hold(place, grip, s=0.25, by='clip 1')])


@pytest.mark.parametrize('grip', ['pinned', 'clamped'])
def test_what_lies_in_a_clip_is_held_there_from_then_on(grip):
    cell = plant(grip)
    before = cell.points(np.linspace(0, 0.5, 11))
    for _ in range(10):  # it is open: nothing is held
        cell.move(BEGIN, PERIOD)
    np.testing.assert_allclose(cell.points(np.linspace(0, 0.5, 11)), before, atol=1e-5)
    at = cell.snap(0)
    assert at == pytest.approx(0.21, abs=1e-4)  # whatever the planner took it for
    frame = cell.grasped(0)
    np.testing.assert_allclose(frame.position, middle(), atol=3e-4)
    for k in range(25):
        cell.move(Pose((0.0, 0.0, 0.3 + 2e-3 * k), LEVEL), PERIOD)
    np.testing.assert_allclose(cell.grasped(0).position, frame.position, atol=3e-4)
    turned = float(frame.rotation[:, 0] @ cell.grasped(0).rotation[:, 0])
    assert (turned > 1 - 1e-5) == (grip == 'clamped')
    beyond = cell.points([0.4])[0] - before[8]
    assert np.linalg.norm(beyond) < (1e-3 if grip == 'clamped' else 5e-3)


def test_a_clip_leads_into_its_seat_what_it_has_taken():
    cell = plant(off=(0.0, 0.0, -2e-3))
    cell.snap(0)
    for _ in range(25):
        cell.move(BEGIN, PERIOD, hands={0: cell.fittings[0].pose})
    away = cell.grasped(0).position - cell.fittings[0].pose.position
    assert np.linalg.norm(away) < 1e-4


def test_a_lid_is_there_when_it_is_told_to_be():
    lid = Box(Pose(np.array(middle()) + (0.0, 0.0, 0.012), LEVEL), (0.02, 0.02, 0.01))
    for there in (True, False):
        cell = plant(obstacles=[lid])
        cell.put(0, there)
        for k in range(40):
            cell.move(Pose((0.0, 0.0, 0.3 + 1e-3 * k), LEVEL), PERIOD)
        assert (cell.largest_forces[0] > 0.1) == there


def test_a_fitting_that_lets_slide_is_none_of_the_engines():
    with pytest.raises(InvalidTask, match='expected clamped or pinned ones'):
        Plant(CABLE, BEGIN, fittings=[Hold(BEGIN, 'ring', s=0.2, by='fork 1')])
