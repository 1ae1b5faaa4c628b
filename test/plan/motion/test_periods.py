# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The rough slowest period, from which the steps of a motion and the look at its end follow."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.rods import with_plug
from dlo_planner.trajectory.modal_response import slowest_period

PLAIN = Rod(1.0, 0.1, 1.0, 0.75)


@pytest.mark.parametrize('rod', [
    PLAIN, Rod(1.0, 0.1, 1.0, 0.75, tip_mass=0.3),
    Rod(1.0, 0.02, 1.0, 0.75, point_masses=((0.9, 0.2),)),
    Rod(1.0, 0.02, 1.0, 0.75, point_masses=((0.5, 0.2), (0.8, 0.1))),
    Rod(1.0, lambda s: 0.01 + 0.2 * (s > 0.8), 1.0, 0.75), with_plug(PLAIN, 0.02, 0.5)])
def test_it_is_not_below_the_period_of_a_straight_dlo_and_not_far_above(rod):
    shape = DirectSimulator(rod, gravity=(0, 0, 0)).solve(Pose.identity())
    period = shape.modes(1).periods[0]
    assert 0.98 * period < slowest_period(rod) < 1.1 * period  # a plug has its own stiffness


def test_a_uniform_mass_counts_a_quarter():
    assert slowest_period(PLAIN) == pytest.approx(2 * np.pi * np.sqrt(0.025 / 3), rel=1e-12)
