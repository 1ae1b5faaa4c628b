# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How hard a hand may pull a DLO that lies in a fitting."""

import numpy as np
import pytest
from scipy.optimize import brentq

from dlo_planner import DirectSimulator, FarEnd, Hold, InverseSimulator, Pose, Rod
from dlo_planner.execute.pull import pulls_borne
from dlo_planner.tasks import Clip, Fork, MoveTo, Route

SEAT = Pose.looking_along((0.3, 0.0, 0.0), (-1.0, 0.0, 0.0))
END = FarEnd(Pose.looking_along((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))
CABLE = Rod(0.8, 0.02, 4e-3, 2e-3)
HELD = Hold(SEAT, 'pinned', 0.495, by='clip 1')


def hand(height, slack):
    """Return the gripper's Pose at a height beside the seat, m, the DLO between a little slack."""
    along = np.array([np.sqrt(1 - (height / 0.49) ** 2), 0.0, height / 0.49])
    return Pose.looking_along(SEAT.position + (1 - slack) * HELD.s * along, -along)


def led(height, held=HELD, far_end=END):
    simulator = DirectSimulator(CABLE, n_elements=64, basis='local')
    plan = InverseSimulator(simulator).plan(MoveTo(
        [hand(height, 3e-4)], far_end=far_end, holds=[held]), start=hand(height, 2e-3))
    return simulator, plan


# a fork, in which the DLO slides, and an end below it, which it is a little too long for
BELOW = FarEnd(Pose.looking_along(SEAT.position - (0.2865, 0.0, 0.1), (-1.0, 0.0, 0.0)), 'pinned')
SLIDES = Hold(SEAT, 'ring', 0.495, by='fork 1')


@pytest.mark.parametrize(('height', 'held', 'far_end', 'fitting'), [
    (-0.12, HELD, END, Clip), (-0.05, HELD, END, Clip), (-0.12, SLIDES, BELOW, Fork)])
def test_a_fitting_bears_what_it_can_where_the_hand_pulls_as_hard_as_it_may(
        height, held, far_end, fitting):
    simulator, plan = led(height, held, far_end)
    most = pulls_borne(Route([fitting(SEAT, bears=1.5)], far_end=far_end), plan)
    assert most.shape == (len(plan),)
    first = plan.shapes[-1]

    def shape(slack):
        return simulator.track([hand(height, slack)], initial=first, holds=[first.holds])[0]

    def beyond(slack):  # what was planned where it was slacker
        return np.linalg.norm(shape(slack).gripper_wrench[:3]) - most[0]
    there = shape(brentq(beyond, 1e-6, 3e-4, rtol=1e-3))
    push = there.wrenches[0, :3] @ np.array([0.0, 0.0, 1.0])
    assert push == pytest.approx(1.5, rel=0.05)


def test_what_a_fitting_bears_is_that_of_where_the_hand_is():
    simulator = DirectSimulator(CABLE, n_elements=64, basis='local')
    plan = InverseSimulator(simulator).plan(
        MoveTo([hand(-0.04, 1e-3)], far_end=END, holds=[HELD]), start=hand(-0.14, 1e-3))
    most = pulls_borne(Route([Clip(SEAT, bears=1.5)], far_end=END), plan)
    assert (np.diff(most) > 0).all() and most[-1] > 2 * most[0]  # as it rises to the seat
    for k in (0, len(plan) // 2, -1):
        way = plan.grippers[k].position - SEAT.position
        way /= np.linalg.norm(way)

        def shape(slack, way=way, k=k):
            pose = Pose(SEAT.position + (1 - slack) * HELD.s * way, plan.grippers[k].quaternion)
            return simulator.track([pose], initial=plan.shapes[k], holds=[plan.shapes[k].holds])[0]
        tight = brentq(lambda slack, shape=shape, k=k: np.linalg.norm(
            shape(slack).gripper_wrench[:3]) - most[k], 1e-6, 1e-3, rtol=1e-3)
        push = shape(tight).wrenches[0, :3] @ np.array([0.0, 0.0, 1.0])
        assert push == pytest.approx(1.5, rel=0.05)


def test_a_hand_above_the_seat_may_pull_hard_and_what_bears_anything_bounds_no_pull():
    _, plan = led(0.15)
    task = Route([Clip(SEAT, bears=1.5)], far_end=END)
    assert (pulls_borne(task, plan) > 50.0).all()  # far more than planned
    for other in (Route([Clip(SEAT)], far_end=END), MoveTo([SEAT]),
                  Route([Fork(SEAT, bears=1.5)], far_end=END)):  # which is called fork 1
        assert np.isinf(pulls_borne(other, plan)).all()
