# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The nearest shape within reach, of a DLO that hangs freely: the one that is found in Python."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.inverse.solvers.points import nearest as nearest_steps
from dlo_planner.inverse.solvers.points import nearest_hanging as nearest_module
from dlo_planner.inverse.solvers.points.aims import Aimed, Aims
from dlo_planner.inverse.solvers.points.nearest import (
    HALVINGS,
    Near,
    extrapolated,
    nearest_within,
    steps_to_try,
)
from dlo_planner.inverse.solvers.points.nearest_hanging import nearest_hanging

ROD = Rod(1.0, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
GRIPPER = Pose.looking_along((0.3, -0.2, 0.1), (1, 0.3, 0.4))
OPTIONS = [{'n_elements': 40, 'basis': 'local'}, {'n_elements': 48, 'n_terms': 12}]


def begun(options, off):
    """Return a simulator, its Shape, and Aims with centers `off` (3,) m from it."""
    simulator = DirectSimulator(ROD, **options)
    shape = simulator.solve(GRIPPER)
    centers = np.array([shape.frame_at(s)[1] + sign * np.array(off)
                        for s, sign in ((0.3, 1), (0.6, -1), (0.9, 1))])
    base = np.array(GRIPPER.rotation)
    return simulator, shape, Aims(0.3, centers, np.array([1.0, 2.0, 0.5]),
                                  shape.frame_at(0.3)[0][:, 0].copy(), 1e-4, base, 1e-3)


def squares(aims, shape):
    misses = Aimed(aims).residuals(shape)
    return misses @ misses


@pytest.mark.parametrize('options', OPTIONS)
@pytest.mark.parametrize(('off', 'reach'), [((0.01, -0.02, 0.005), 0.3), ((0.1, 0.2, -0.1), 0.05)])
def test_it_is_the_one_found_in_python(options, off, reach):
    simulator, shape, aims = begun(options, off)
    slow = nearest_within(simulator, Aimed(aims), Near(shape), reach, reach).shape
    quick = nearest_hanging(shape.state.mesh, aims, shape, reach, reach)
    assert squares(aims, quick) < 0.9 * squares(aims, shape)
    np.testing.assert_allclose(quick.gripper.matrix, slow.gripper.matrix, atol=1e-9)
    np.testing.assert_allclose(quick.positions, slow.positions, atol=1e-9)
    np.testing.assert_allclose(quick.gripper_wrench, slow.gripper_wrench, atol=1e-8)
    assert quick.energy == pytest.approx(slow.energy, abs=1e-10)
    assert quick.stability == pytest.approx(slow.stability, rel=1e-3)
    assert quick.iterations == slow.iterations
    assert quick.converged
    assert quick.error_estimate == pytest.approx(slow.error_estimate, rel=1e-3)
    away = np.linalg.norm(quick.gripper.position - GRIPPER.position)
    assert away < reach * (1 + 1e-6)


def test_where_it_is_the_nearest_already_it_stays():
    simulator, shape, aims = begun(OPTIONS[0], (0.0, 0.0, 0.0))
    assert nearest_hanging(shape.state.mesh, aims, shape, 0.3, 0.3) is shape


def test_where_no_trial_is_an_equilibrium_there_is_none(monkeypatch):
    simulator, shape, aims = begun(OPTIONS[0], (0.1, 0.2, -0.1))
    monkeypatch.setattr(nearest_module, 'MAX_ITERATIONS', 0)
    assert nearest_hanging(shape.state.mesh, aims, shape, 0.3, 0.3) is None


def test_steps_that_come_nearer_by_the_same_part_are_extrapolated(rng):
    goal, begin = rng.normal(size=(2, 6))
    first = 0.4 * (goal - begin)
    there = begin + first
    np.testing.assert_allclose(extrapolated(0.4 * (goal - there), first, first), goal - there,
                               atol=1e-12)
    assert np.array_equal(extrapolated(first, first, first), first)  # nothing is known
    tried = list(steps_to_try(first, begin, None))
    assert len(tried) == HALVINGS and np.array_equal(tried[1], 0.5 * first)
    assert len(list(steps_to_try(0.01 * first, 0.1 * first, (first, first)))) == HALVINGS + 1


def test_where_much_is_missed_it_comes_nearer(monkeypatch):
    simulator, shape, aims = begun(OPTIONS[0], (0.1, 0.2, -0.1))
    found = nearest_within(simulator, Aimed(aims), Near(shape), 0.5, 0.5).shape
    monkeypatch.setattr(nearest_steps, 'extrapolated', lambda step, *_: np.full(6, np.nan))
    slow = nearest_within(simulator, Aimed(aims), Near(shape), 0.5, 0.5).shape
    assert squares(aims, found) < 0.9995 * squares(aims, slow)
