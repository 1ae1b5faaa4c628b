# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO in a compliant hand: it gives way by Hooke's law, and what is taut pulls as planned."""

import numpy as np
import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from dlo_planner import DirectSimulator, FarEnd, InvalidTask, Pose, Rod  # noqa: E402
from dlo_planner.cell.hand import Hand, InHand  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402
from dlo_planner.cell.truth import Truth  # noqa: E402

CABLE = Rod(0.5, 0.02, 4e-3, 4e-3, radius=3e-3)
LEVEL = (0, 0, 0, 1)
BEGIN, END = Pose((0.0, 0.0, 0.3), LEVEL), Pose((0.46, 0.0, 0.3), LEVEL)
TAUT = Pose((-0.0399, 0.0, 0.3), LEVEL)  # 0.1 mm of the cable is slack
PERIOD, STEP, CELLS = 0.02, 2e-3, 16


def in_hand(truth=None, **more):
    return InHand(CABLE, BEGIN, truth=truth, cells=CELLS, step=STEP, damping=0.3,
                  far_end=FarEnd(END), **more)


def taut():
    """Return what the gripper exerts on a taut cable, as planned."""
    wrench = DirectSimulator(CABLE, n_elements=64, basis='local').solve(
        TAUT, far_end=FarEnd(END)).gripper_wrench
    assert wrench[0] < -0.4
    return wrench


def drawn(cell, wrench=None):
    """Draw it taut; return where the hand is then, and how it pulls."""
    for share in np.linspace(0, 1, 31)[1:]:
        if wrench is not None:
            cell.feed(share * wrench)
        cell.move(Pose(BEGIN.position + share * (TAUT.position - BEGIN.position), LEVEL), PERIOD)
    for _ in range(30):
        cell.move(TAUT, PERIOD)
    return cell.measured.position - TAUT.position, cell.pull


def test_a_hand_is_where_it_is_to_be_if_it_is_fed_with_what_it_exerts():
    wrench = taut()
    off, pull = drawn(in_hand(), wrench)
    assert np.linalg.norm(off) < 2e-4 and pull == pytest.approx(
        np.linalg.norm(wrench[:3]), abs=0.1)
    off, pull = drawn(in_hand(hand=Hand(stiffness=200.0)))
    assert pull == pytest.approx(200.0 * np.linalg.norm(off), rel=0.02)  # Hooke's law
    assert np.linalg.norm(off) > 2e-4


def test_a_cable_that_is_too_short_is_not_torn_at():
    short = Truth(length=-0.5e-3)  # 0.4 mm more than what is slack
    stiff = Plant(CABLE, BEGIN, truth=short, cells=CELLS, step=STEP, damping=0.3,
                  far_end=FarEnd(END))
    torn = drawn(stiff)[1]
    off, pull = drawn(in_hand(short), taut())
    assert pull < np.linalg.norm(taut()[:3]) + 500.0 * np.linalg.norm(off) + 0.05 < 0.3 * torn


def test_it_sits_in_the_hand_as_truth_says():
    truth = Truth(gripper_shift=(0.0, 2e-3, 1e-3), gripper_turn=(0.0, 0.0, 0.02))
    cell = in_hand(truth)
    wrench = DirectSimulator(CABLE, n_elements=64, basis='local').solve(
        BEGIN, far_end=FarEnd(END)).gripper_wrench
    with pytest.raises(InvalidTask, match='wrench'):
        cell.feed([0.0, 1.0])
    cell.feed(wrench)
    for _ in range(30):
        cell.move(BEGIN, PERIOD)
    # springs turn it back and forth by what that changes of the wrench alone
    np.testing.assert_allclose(cell.measured.position, BEGIN.position, atol=5e-4)
    np.testing.assert_allclose(cell.points([0.0])[0] - cell.measured.position, (0, 2e-3, 1e-3),
                               atol=1e-4)
