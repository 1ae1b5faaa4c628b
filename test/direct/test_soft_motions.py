# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions in which inertia is far stronger than elasticity go on, and are right."""

import numpy as np
import pytest
from references.planar_motions import LEVEL, tilted
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, FarEnd, Pose, Rod
from dlo_planner.direct.integrator import within_energy_budget

DT = 0.02


def soft(softness, **more):
    """Return a rod of 1 m, w L^3 / EI = `softness`."""
    stiffness = 0.05 * 9.81 / softness
    return Rod(1.0, 0.05, stiffness, 0.75 * stiffness, **more)


def tumbled(pace, n):
    """Return n poses, DT apart, of a gripper that is turned and moved, at rest at first."""
    x = pace * DT * np.arange(n)
    places = np.sin(np.outer(x, [1.0, 0.7, 1.3])) ** 2 * np.array([0.1, 0.05, 0.1])
    turns = np.sin(x)[:, None] ** 2 * np.array([0.3, 1.0, 0.4])
    return [Pose(place, Rotation.from_rotvec(turn).as_quat())
            for place, turn in zip(places, turns, strict=True)]


def apart(motion, other):
    """Return the largest distance of a node from every second one of a finer motion, m."""
    return max(np.linalg.norm(one.positions - two.positions[::2], axis=1).max()
               for one, two in zip(motion.shapes, other.shapes, strict=True))


@pytest.mark.parametrize(('softness', 'pace', 'more'), [
    (1e3, 10.0, {}), (1e3, 7.0, {'tip_mass': 0.03}), (3e3, 7.0, {}), (1e4, 7.0, {}),
    (3e3, 10.0, {'damping': (1.0, 1e-3)})])
def test_a_whipped_rod_goes_on_within_its_estimate(softness, pace, more):
    rod, grippers = soft(softness, **more), tumbled(pace, 20)
    motion, finer = (DirectSimulator(rod, n_elements=n, basis='local').simulate(
        grippers, DT, tolerance=tolerance) for n, tolerance in ((16, 1e-3), (32, 2e-4)))
    assert motion.converged, motion.message
    assert finer.converged, finer.message
    assert max(shape.residual for shape in motion.shapes) < 1e-6
    assert apart(motion, finer) < 1.5 * motion.error_estimate[-1] < 0.5
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert -2e-3 * moved < motion.numerical_loss.min()
    assert motion.numerical_loss.max() < 0.02 * moved


def test_both_ends_of_a_soft_rod_are_moved_fast():
    up = 0.15 * np.sin(3 * 2 * np.pi * DT * np.arange(6)) ** 2
    grippers = [Pose((0, 0, z), LEVEL.quaternion) for z in up]
    ends = [FarEnd(Pose((0.7, y, 0), Rotation.from_euler('z', 2 * y).as_quat()), 'pinned')
            for y in up]
    rod = soft(3e3, damping=(0.5, 2e-3))
    motion, finer = (DirectSimulator(rod, n_elements=n, basis='local').simulate(
        grippers, DT, far_ends=ends, tolerance=tolerance)
        for n, tolerance in ((24, 1e-3), (48, 2e-4)))
    assert motion.converged, motion.message
    assert finer.converged, finer.message
    assert apart(motion, finer) < 1.5 * motion.error_estimate[-1] < 0.5
    for shape, end in zip(motion.shapes, ends, strict=True):
        assert np.linalg.norm(shape.positions[-1] - end.pose.position) < 1e-9


def test_rates_that_are_renewed_are_no_gain_of_a_step():
    # a gripper jerks a rod at rest: the first steps lose energy, and their rates are renewed
    up = 0.1 * np.sin(3 * 2 * np.pi * DT * np.arange(8)) ** 2
    motion = DirectSimulator(soft(1e4), n_elements=24, basis='local').simulate(
        [tilted(-3 * z, (0.0, z)) for z in up], DT)
    assert motion.converged, motion.message
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert motion.numerical_loss.min() > -2e-3 * moved


def test_one_step_does_not_use_up_what_a_motion_may_gain():
    def energies(balance):
        return np.array([0.0, balance, *np.zeros(7)])

    budget = np.zeros(5)
    budget[2] = 1e3  # potential energy has been as high: 1 J may be gained
    left, balance = 1.0, 0.0
    for _ in range(8):
        kept = budget.copy()
        assert not within_energy_budget(budget, energies(balance + 0.6 * left), 1e-3, 0.0)
        np.testing.assert_array_equal(budget, kept)
        assert within_energy_budget(budget, energies(balance + 0.4 * left), 1e-3, 0.0)
        balance, left = balance + 0.4 * left, 0.6 * left
    # however little is left, a step that gains nothing is none that gains
    assert within_energy_budget(budget, energies(balance), 1e-3, 0.0)
    assert within_energy_budget(budget, energies(-5.0), 1e-3, 0.0)
    assert not within_energy_budget(budget, energies(-4.0), 1e-3, 0.0)
