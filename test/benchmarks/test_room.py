# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The judge of threading with the most room knows closed forms: bending, buckling, distances.

`python -m benchmarks.room` judges hundreds of plans. Its solver takes 10 s to compile.
"""

import numpy as np
import pytest

from benchmarks.room import OwnRod, room
from dlo_planner import CutOut, DirectSimulator, Pose, Rod


def solved(ratio, direction):
    stiffness = 0.01 * 9.80665 / ratio
    rod = Rod(1.0, 0.01, stiffness, 0.8 * stiffness, radius=1e-3)
    pose = Pose.looking_along((0, 0, 0), direction)
    own = OwnRod(rod)
    straight = DirectSimulator(rod, gravity=(0, 0, 0)).solve(pose)
    return own.solve(np.zeros(3), np.array(pose.quaternion), own.guess(straight, own.natural))


@pytest.mark.sweep
def test_a_stiff_cantilever_sags_by_an_eighth():
    curve = solved(1e-3, (1, 0, 0))
    assert curve.minimum
    assert curve.places[-1, 2] == pytest.approx(-1e-3 / 8, rel=1e-5)


@pytest.mark.sweep
@pytest.mark.parametrize(('ratio', 'stands'), [(7.83, True), (7.85, False)])
def test_a_column_stands_up_to_its_critical_height(ratio, stands):
    # Greenhill 1881: w L^3/EI = 7.837
    assert solved(ratio, (0, 0, 1)).minimum == stands


def line(height, tilt):
    along = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    return np.linspace(-1, 1, 20001)[:, None] * along + [0.0, 0.0, height]


@pytest.mark.parametrize(('height', 'tilt', 'left'), [
    (0.0, 0.0, 0.09), (0.0, 1.0, 0.1 * np.cos(1.0) - 0.01), (0.05, 0.0, 0.04),
    (0.105, 0.0, -np.inf)])
def test_the_room_of_a_straight_line_in_a_round_hole(height, tilt, left):
    cutout = CutOut(Pose.looking_along((0, 0, 0), (1, 0, 0)), radius=0.1)
    assert room(line(height, tilt), cutout, 0.01) == pytest.approx(left, abs=1e-6)
