# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The vibrations that a law excites."""

import numpy as np
import pytest
from calm_cases import cell, tasks
from scipy.integrate import solve_ivp

from dlo_planner import DirectSimulator, Pose, Rod
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.requirements import Limits
from dlo_planner.rods import with_plug
from dlo_planner.trajectory.modal_response import (
    Response,
    Turns,
    _turning,
    slowest_period,
    vibrated,
)
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.timed_path import TimedPath, fastest_law


@pytest.mark.parametrize('ratio', [0.0, 0.02, 0.3])
def test_oscillators_whose_frequency_changes_against_an_integrator(ratio):
    duration, count = 6.0, 4000

    def rate(t):
        return 5.0 + 0.3 * t

    def force(t):
        return np.sin(1.7 * t) * (1 + t)

    middle = (np.arange(count) + 0.5) * duration / count
    found = vibrated(duration / count, rate(middle)[:, None], np.full((count, 1), ratio),
                     Turns.none(count, 1), force(middle)[None, :, None],
                     np.zeros((2, 1, 1)))[:, 0]
    times = np.linspace(0, duration, count + 1)
    known = solve_ivp(lambda t, y: (y[1], force(t) - 2 * ratio * rate(t) * y[1]
                                    - rate(t) ** 2 * y[0]),
                      (0, duration), (0, 0), t_eval=times, rtol=1e-10, atol=1e-12).y
    size = np.abs(known[0]).max()
    np.testing.assert_allclose(found[0, :, 0], known[0], atol=2e-4 * size)
    # the speed in parts of the frequency of the step before
    np.testing.assert_allclose(found[1, 1:, 0] * rate(middle), known[1, 1:],
                               atol=2e-3 * np.abs(known[1]).max())


def test_a_step_under_steady_force_is_exact():
    w, ratio, step = 7.0, 0.1, 0.05
    found = vibrated(step, np.full((40, 1), w), np.full((40, 1), ratio), Turns.none(40, 1),
                     np.full((1, 40, 1), 3.0), np.zeros((2, 1, 1)))[:, 0]
    t = step * np.arange(41)
    free = w * np.sqrt(1 - ratio**2)
    known = 3.0 / w**2 * (1 - np.exp(-ratio * w * t) * (
        np.cos(free * t) + ratio * w / free * np.sin(free * t)))
    np.testing.assert_allclose(found[0, :, 0], known, atol=1e-12)


def test_what_vibrates_at_first_swings_on():
    w, ratio, step = 7.0, 0.1, 0.05
    found = vibrated(step, np.full((40, 1), w), np.full((40, 1), ratio), Turns.none(40, 1),
                     np.zeros((1, 40, 1)), np.array([[[2.0]], [[-0.5]]]))[:, 0, :, 0]
    t, free = step * np.arange(41), np.sqrt(1 - ratio**2)
    known = np.exp(-ratio * w * t) * (2.0 * np.cos(free * w * t)
                                      + (2.0 * ratio - 0.5) / free * np.sin(free * w * t))
    np.testing.assert_allclose(found[0], known, atol=1e-12)
    assert found[1, 0] == -0.5


@pytest.mark.every(3)
@pytest.mark.parametrize('name', ['wire', 'hose', 'leaf spring'])
def test_a_leg_takes_over_how_the_dlo_moves_at_the_end_of_the_one_before(name):
    one, other = (task.response for task in tasks(name)[-2:])
    end = np.random.default_rng(3).normal(size=one.rest.shape) * 1e-3 / one.sizes[-1].max()
    # where modes cross, the fastest that are known of both legs may be others
    end[:, np.argsort(one.rates[-1])[3:]] = 0.0
    begin = other.taken_over(one, end)
    for (at_end, at_begin), powers in (((end[0], begin[0]), 0), ((end[1], begin[1]), 1)):
        moved = np.einsum('m,mki->ki', at_end * one.rates[-1] ** powers, one.displacements[-1])
        found = np.einsum('m,mki->ki', at_begin * other.rates[0] ** powers, other.displacements[0])
        np.testing.assert_allclose(found, moved, atol=1e-3 * np.abs(moved).max())
    # and while the gripper waits, it swings on: after a period of the only mode it is back, damped
    alone = np.zeros_like(end)
    alone[0, 0] = 1e-3
    w, zeta = one.rates[-1, 0], one.damping[-1, 0]
    period = 2 * np.pi / (w * np.sqrt(1 - zeta**2))
    known = alone * np.exp(-zeta * w * period)
    np.testing.assert_allclose(one.waited(alone, period), known, atol=1e-12)


@pytest.mark.every(2)
@pytest.mark.parametrize(('name', 'k'), [('wire', 0), ('wire', 1), ('hose', 1),
                                         ('leaf spring', 0)])
def test_the_real_dlo_deviates_as_predicted(name, k):
    direct, _ = cell(name)
    task = tasks(name)[k]
    law = fastest_law(task.leg, Limits())  # quick: it swings by centimeters
    times, u, (y, _) = task.response.excited(law, task.response.rest)
    predicted = np.einsum('tmki,tm->tki', task.response.between(
        task.response.displacements, u), y)
    way = TimedPath(GripperPath(task.leg.knots[[0, -1]], (task.leg,)), (law,), Limits())
    found_times = np.linspace(0, way.duration, 400)
    grippers = way.at(found_times)[0]
    first = direct.solve(grippers[0], task.response.shapes[0])
    motion = direct.simulate(grippers, found_times[1], first)
    assert motion.converged
    s = task.response.shapes[0].s
    found = np.array([shape.positions_at(s[[16, 32]]) - calm.positions_at(s[[16, 32]])
                      for shape, calm in zip(motion.shapes, direct.track(grippers, initial=first),
                                             strict=True)])
    known = np.array([[np.interp(found_times, times, predicted[:, node, axis])
                       for axis in range(3)] for node in (16, 32)])
    off = np.linalg.norm(found - np.moveaxis(known, 2, 0), axis=2).max(axis=0)
    most = np.linalg.norm(found, axis=2).max()
    assert most > 2e-3
    assert off.max() < 0.1 * most


def test_what_counts_is_across_the_dlo():
    response = tasks('wire')[1].response
    s = np.linspace(0.1, 0.9, response.parameters.size)
    across, tangents, ahead = response.sideways(s)
    for k, moved in enumerate(across):
        along = response.shapes[k].frame_at(s[k])[0][:, 0]
        np.testing.assert_allclose(tangents[k], along)
        np.testing.assert_allclose(moved @ along, 0, atol=1e-12)
        whole = np.hypot(np.linalg.norm(moved, axis=1), ahead[k])
        assert (whole <= response.sizes[k] * (1 + 1e-9)).all()
        assert (np.linalg.norm(moved, axis=1) <= response.sizes[k] * (1 + 1e-9)).all()


def test_modes_that_turn_into_one_another_swing_on_in_the_same_direction():
    # one mass on equal springs: the axes of its two modes turn, what it does does not notice
    u = np.linspace(0, 1, 17)
    law = TimeLaw(np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.5, 0.0]), [0.3])
    found = []
    for turned in (0.0, 1.5):
        cosine, sine = np.cos(turned * u), np.sin(turned * u)
        modes = np.zeros((17, 2, 1, 3))
        modes[:, 0, 0, 0], modes[:, 0, 0, 1] = cosine, sine
        modes[:, 1, 0, 0], modes[:, 1, 0, 1] = -sine, cosine
        response = Response(u, (), np.full((17, 2), 9.0), np.zeros((17, 2)), modes,
                            modes[:, :, 0, 0], np.zeros((17, 2)), modes[:, :, 0], np.ones(1),
                            _turning(np.ones(1), modes) / np.diff(u)[:, None, None])
        _, places, (y, _) = response.excited(law, response.rest)
        found.append(np.einsum('tmki,tm->ti', response.between(modes, places), y))
    still, turning = found
    assert np.abs(still[:, 1]).max() == 0
    np.testing.assert_allclose(turning, still, atol=0.01 * np.abs(still).max())


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
