# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The estimated push into a bore against closed forms, and where it is said."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Plan,
    Pose,
    Rod,
    replay,
)
from dlo_planner.plan.bore import Inside, pushing

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
WEIGHT = WIRE.mass_per_length * 9.81
INVERSE = InverseSimulator(DirectSimulator(WIRE, basis='local', n_elements=32))
DEPTHS = (0.0, 0.3, 0.6)
BENDS, ROOM = 0.03, 1e-3  # N m^2, m


def bore(direction=(1, 0, 0), radius=1.75e-3):
    return CutOut(Pose.looking_along((0, 0, 1), direction), radius=radius)


def beam(length, **more):
    """Return an Inside without weight that nothing outside holds."""
    count = 60
    return Inside(**{'lengths': np.diff(length * np.linspace(0, 1, count + 1) ** 1.5),
                     'stiffness': np.tile(BENDS * np.eye(2), (count, 1, 1)),
                     'natural': np.zeros((count, 2)), 'load': np.zeros((count + 1, 3)),
                     'mouth': 1e-6 * np.eye(4), 'pushed': np.zeros(4), **more})


@pytest.mark.parametrize('couple', [0.02, 0.1])
def test_a_couple_at_the_mouth_wedges_a_beam_between_rim_and_wall(couple):
    free = beam(1.0)
    load = np.zeros((61, 3))
    load[1, 1], load[0, 1] = couple / free.lengths[0], -couple / free.lengths[0]
    arm = np.sqrt(6 * BENDS * 2 * ROOM / couple)
    push = pushing(free._replace(load=load), np.full(61, ROOM), 1e-3)
    assert push == pytest.approx(1e-3 * 2 * couple / arm, rel=0.1)


@pytest.mark.parametrize('axis', [0, 1])
def test_a_bent_beam_is_held_straight_by_three_forces(axis):
    length, sag = 0.2, 6 * ROOM
    natural = np.zeros((60, 2))
    natural[:, axis] = 8 * sag / length**2
    middle = 48 * BENDS / length**3 * (sag - 2 * ROOM)
    push = pushing(beam(length, natural=natural), np.full(61, ROOM), 1e-3)
    assert push == pytest.approx(1e-3 * 2 * middle, rel=0.05)


def test_a_level_bore_rubs_by_the_weight_inside():
    for mu in (0.1, 0.3):
        plan = INVERSE.insert(bore(), depths=DEPTHS, friction=mu)
        assert plan.insertion_force[0] == 0
        shares = plan.insertion_force[1:] / (mu * WEIGHT * plan.depths[1:])
        # the part outside carries a little of what lies lower than the middle of the mouth
        assert (shares > 0.9).all() and (shares < 1.0).all()


def test_weight_along_the_bore_counts():
    mu, down, up = 0.2, np.radians(60), np.radians(20)
    for angle, sign in ((down, -1), (up, 1)):
        direction = (np.cos(angle), 0, sign * np.sin(angle))
        plan = INVERSE.insert(bore(direction), depths=(0.0, 0.4), friction=mu)
        expected = WEIGHT * 0.4 * (mu * np.cos(angle) + sign * np.sin(angle))
        assert plan.insertion_force[1] == pytest.approx(expected, abs=0.1 * mu * WEIGHT * 0.4)


def test_a_tighter_bore_holds_a_bent_wire_with_more_force():
    rod = replace(WIRE, natural_curvature=(0.0, 1.5))
    inverse = InverseSimulator(DirectSimulator(rod, basis='local', n_elements=32))
    loose, tight = (inverse.insert(bore(radius=WIRE.radius + room), depths=DEPTHS,
                                   friction=0.2).insertion_force[-1] for room in (3e-3, 3e-4))
    assert tight > 1.3 * loose > 0.2 * WEIGHT * 0.6


def test_what_is_not_stated_is_not_looked_at_and_named():
    for hole, friction in ((bore(), None), (CutOut(bore().pose), 0.3)):
        plan = INVERSE.insert(hole, depths=DEPTHS, friction=friction)
        assert np.isnan(plan.insertion_force).all()
        report = replay(INVERSE.simulator, plan)
        assert np.isnan(report.insertion_force) and 'insertion_force' in report.not_looked_at
        row, = (line for line in plan.summary().splitlines() if 'push into the bore' in line)
        assert 'not looked at' in row
    threaded = INVERSE.thread(bore(), depths=(0.0, 0.3))
    assert 'push' not in threaded.summary()
    assert 'insertion_force' not in replay(INVERSE.simulator, threaded).not_looked_at
    with pytest.raises(InvalidTask, match='friction = -1'):
        INVERSE.insert(bore(), friction=-1.0)


def test_the_estimate_travels_with_plan_and_report(tmp_path):
    plan = INVERSE.insert(bore(), depths=DEPTHS, friction=0.3)
    report = replay(INVERSE.simulator, plan)
    assert report.insertion_force == plan.insertion_force.max() > 0
    assert 'insertion_force' not in report.not_looked_at
    plan.save(tmp_path / 'plan.npz')
    np.testing.assert_array_equal(Plan.load(tmp_path / 'plan.npz').insertion_force,
                                  plan.insertion_force)
