# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plug in a compliant hand: with the planned wrench fed forward it is where it is to be."""

import numpy as np
import pytest

pytest.importorskip('mujoco')

from benchmarks.plugs import DEPTHS, FAR_END, IN, PLUG, ROD, inserted, planned
from dlo_planner.cell.plug import Hand, HeldPlug
from dlo_planner.model.pose import Pose, displaced
from dlo_planner.tasks import InsertPlug

CELLS, SLOWER = 12, 1.0  # coarser and quicker than the benchmark
TASK = InsertPlug(Pose.looking_along((0.2, 0.2, 0.05), (0, -1, 0)), PLUG, DEPTHS, far_end=FAR_END)


@pytest.mark.parametrize('feed', [True, False])
def test_a_plug_that_sits_off_goes_in(feed):
    error = displaced(Pose.identity(), np.array([0.01, 0.02, 0.02, 1e-3, 1e-3, -1e-3]))
    depth, _, felt = inserted(TASK, planned(TASK), error, feed, CELLS, SLOWER)
    assert depth > DEPTHS[-1] - IN
    assert felt.largest > 0 and felt.above < 0.05


def test_a_hand_gives_way_to_what_is_not_fed_forward():
    plan = planned(TASK)
    k = plan.stages[-1].first - 1  # before the socket, in the air
    gripper, wrench = plan.grippers[k], plan.plug_wrenches[k]
    cell = HeldPlug(ROD, PLUG, gripper, far_end=FAR_END, cells=CELLS)
    off = []
    for fed in (wrench, None):
        cell.led(gripper, 0.6, fed)
        off.append(cell.front.position - PLUG.front(gripper).position)
    # by Hooke's law, and as the hand turns about its own frame, which is a plug away from the front
    there = plan.plug_poses[k].position - gripper.position
    turn = (wrench[3:] + np.cross(there, wrench[:3])) / Hand().rotational
    sunk = -wrench[:3] / Hand().stiffness - np.cross(turn, there)
    assert np.linalg.norm(sunk) > 5e-4
    np.testing.assert_allclose(off[1], sunk, atol=0.25 * np.linalg.norm(sunk))
    assert np.linalg.norm(off[0]) < 0.2 * np.linalg.norm(sunk)  # of a coarse chain
