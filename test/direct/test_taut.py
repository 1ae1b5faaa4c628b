# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Cables that are nearly taut between their grips, from nothing but the poses of these."""

import re

import numpy as np
import pytest
from references.kirchhoff import true_held_rod
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, FarEnd, Hold, PointLoad, Pose, Rod
from dlo_planner.direct import taut


def cable(load, **more):
    """Return a rod of 1 m whose weight is `load` times EI / L^2."""
    stiffness = 9.81 / load
    return Rod(1.0, 1.0, stiffness, 0.75 * stiffness, **more)


def spans(count, least=1e-4, most=2e-3, tilt=0.5, seed=3):
    """Yield a gripper, and a far end less than a length away by `least` to `most`, both tilted."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        slack = np.exp(rng.uniform(np.log(least), np.log(most)))
        way, across = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        along = np.column_stack([way, across, np.cross(way, across)])

        def tilted(along=along):
            turn = rng.normal(size=3)
            turn *= rng.uniform(0, tilt) / np.linalg.norm(turn)
            return along @ Rotation.from_rotvec(turn).as_matrix()

        yield (Pose.from_rotation((0.1, -0.2, 0.3), tilted()),
               FarEnd(Pose.from_rotation((0.1, -0.2, 0.3) + (1 - slack) * way, tilted()),
                      ('clamped', 'pinned')[k % 2]))


@pytest.mark.parametrize('load', [10.0, 100.0, 2000.0])
def test_nearly_taut_cables_are_found_at_once(load):
    direct = DirectSimulator(cable(load))
    for tilt in (0.5, 1.5):
        for gripper, end in spans(20, tilt=tilt):
            shape = direct.solve(gripper, far_end=end)
            assert shape.converged and shape.stability > 0.01, shape
            # without obstacles, the Newton steps are what it costs; from the straight one: to 1000
            assert shape.iterations <= 60
            np.testing.assert_allclose(shape.positions[-1], end.pose.position, atol=1e-9)
            weight = np.array([0, 0, -9.81])
            np.testing.assert_allclose(shape.gripper_wrench[:3] + shape.far_wrench[:3], -weight,
                                       atol=1e-9 * np.abs(shape.far_wrench).max())


@pytest.mark.parametrize('load', [10.0, 100.0, 2000.0])
def test_nearly_taut_cables_against_scipy(load):
    rod = cable(load)
    direct = DirectSimulator(rod)
    for gripper, end in spans(2, seed=8):
        shape = direct.solve(gripper, far_end=end)
        true = true_held_rod(rod, shape, tol=1e-6, far_pinned=end.grip == 'pinned')
        off = np.linalg.norm(true - shape.positions, axis=1).max()
        assert off < direct.accuracy and off < 10 * shape.error_estimate


def test_a_cable_that_is_drawn_taut_ends_where_it_is_found():
    rod = cable(10.0)
    direct, tilt = DirectSimulator(rod), Rotation.from_rotvec([0.3, 0.3, 0.0]).as_quat()
    gripper = Pose((0, 0, 0), tilt * [-1, -1, 1, 1])
    ends = [FarEnd(Pose((1 - slack, 0, 0), tilt)) for slack in np.geomspace(0.2, 5e-4, 16)]
    drawn = direct.track([gripper] * 16, far_ends=ends)
    assert all(shape.converged and not shape.jumped for shape in drawn)
    assert max(shape.iterations for shape in drawn) <= 12
    found = direct.solve(gripper, far_end=ends[-1])
    apart = max(np.linalg.norm(np.subtract(found.at(s).position, drawn[-1].at(s).position))
                for s in np.linspace(0, 1, 40))
    assert apart < found.error_estimate + drawn[-1].error_estimate


@pytest.mark.parametrize('grip', ['clamped', 'pinned'])
def test_whatever_acts_on_a_nearly_taut_dlo(grip):
    rod = cable(100.0, natural_curvature=(2.0, -3.0), natural_twist=3.0, tip_mass=0.5)
    direct = DirectSimulator(rod, grip=grip, point_loads=[PointLoad((1.0, 3.0, -2.0), s=0.3)])
    for gripper, end in spans(8):
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged, shape
        if grip == 'pinned':
            np.testing.assert_allclose(shape.gripper_wrench[3:], 0, atol=1e-6)


def test_a_trial_of_the_solver_far_off_is_no_error(monkeypatch):
    gripper, end = next(spans(1))
    expected = DirectSimulator(cable(100.0)).solve(gripper, far_end=end)
    seek, tried = taut.root, []

    def far_off(left, begin, **more):
        for off in (1e4, -1e4):
            tried.append(left(np.add(begin, [off, 0, 0])))
        return seek(left, begin, **more)

    monkeypatch.setattr(taut, 'root', far_off)
    shape = DirectSimulator(cable(100.0)).solve(gripper, far_end=end)
    assert tried and np.isfinite(tried).all()
    np.testing.assert_array_equal(shape.positions, expected.positions)


def test_a_mesh_too_coarse_for_the_slack_is_named():
    rod, (gripper, end) = cable(1e-3), next(spans(1, least=1e-4, most=1e-4))
    shape = DirectSimulator(rod, basis='local', n_elements=64).solve(gripper, far_end=end)
    assert not shape.converged
    named = re.search(r'too coarse for a slack of 0.0001 m.*? (\d+) elements$', shape.status)
    finer = DirectSimulator(rod, basis='local', n_elements=int(named[1]))
    assert finer.solve(gripper, far_end=end).status == 'converged'
    assert DirectSimulator(rod).solve(gripper, far_end=end).status == 'converged'


@pytest.mark.parametrize('slack', [1e-3, 1e-4, 3e-5])
def test_a_taut_dlo_is_near_though_it_resists_by_large_forces(slack):
    # a step that leaves little of its way leaves forces larger than all that were there before
    rod = Rod(1.0, 0.05, 0.02, 0.015, radius=3e-3)
    simulator = DirectSimulator(rod, n_elements=64, basis='local')

    def place(x):
        return Pose.looking_along((x, 0, 0), (1, 0, 0))

    def end(slack):
        return FarEnd(place(1 - slack), 'pinned')

    holds = [Hold(place(0.4 * (1 - slack)), 'pinned', 0.4)]
    shape = simulator.solve(place(0), holds=holds, far_end=end(slack))
    for by in (0.02, 0.1):  # of the slack
        there = simulator.solve(place(0), shape, holds=holds, far_end=end((1 - by) * slack))
        assert there.converged
        assert [(one.strategy, one.end) for one in there.tried] == [('near', 'found')]


def test_where_quick_steps_lead_nowhere_grips_lead_a_dlo_there_in_small_ones():
    direct = DirectSimulator(Rod.circular(1.0, 1.5e-3, density=8960, youngs_modulus=110e9,
                                          poisson_ratio=0.34),
                             gravity=(0, 0, 0), n_elements=64, basis='local')
    first, second = (FarEnd(Pose(*one), 'sleeve') for one in (
        ((0, 0, 0.913848865290), (0, 0.999999999999, 0, -1.570796e-6)),
        ((-0.166119963625, 0, 0.975963194841), (0, 0.470131936221, 0, 0.882596149179))))
    gripper = Pose.looking_along((0, 0, 0), (1, 0, 0))
    shape = direct.solve(gripper, direct.solve(gripper, far_end=first), far_end=second)
    assert shape.converged
    assert shape.energy == pytest.approx(0.50029, rel=1e-4)


@pytest.mark.parametrize(('near', 'turn'), [(0.808, 3.70), (0.957, 4.77), (0.861, -2.66)])
def test_a_leaf_spring_that_two_clamps_on_a_line_turn_and_press_is_found_at_once(near, turn):
    """It buckles sideways from exactly straight, and is soft in one plane alone (1 : 1,600)."""
    strip = Rod.rectangular(0.4, 0.02, 0.0005, 7850, 2e11, 0.3)
    direct = DirectSimulator(strip, gravity=(0, 0, 0), n_elements=64, basis='local')
    gripper = Pose.looking_along((0, 0, 0), (1, 0, 0))

    def end(share):
        return FarEnd(Pose.from_rotation(
            ((1 - (1 - near) * share) * 0.4, 0, 0),
            Rotation.from_rotvec((turn * share, 0, 0)).as_matrix() @ gripper.rotation))

    at_once = direct.solve(gripper, far_end=end(1.0))
    assert at_once.converged and at_once.stability > 0
    shape = None
    for share in np.linspace(0.01, 1.0, 100):
        shape = direct.solve(gripper, shape, far_end=end(share))
        assert shape.converged
    # it may lie in another fold than the one that it comes to from beside its natural shape
    assert at_once.energy < shape.energy * (1 + 1e-6)
