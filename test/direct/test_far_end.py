# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Both ends held: forces, buckling loads from the literature, symmetry."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipk

from dlo_planner import DirectSimulator, FarEnd, InvalidTask, Pose, Rod

HERE = Pose.identity()
ROD = Rod(1.0, 0.0, 1.0, 0.7)


def simulator(rod=ROD, basis='local', **more):
    return DirectSimulator(rod, basis=basis, gravity=(0, 0, 0), n_elements=96,
                           n_terms=None if basis == 'local' else 20, **more)


def turned(angle, x=0.0):
    return Pose((x, 0, 0), Rotation.from_rotvec([angle, 0, 0]).as_quat())


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_any_pose_is_held_and_wrenches_balance(basis, rng):
    rod = Rod(1.0, 0.05, (0.3, 0.6), 0.4, natural_curvature=(0.5, -0.3), tip_mass=0.1)
    direct = DirectSimulator(rod, basis=basis, n_terms=None if basis == 'local' else 20)
    for _ in range(6):
        gripper = Pose(rng.normal(size=3), rng.normal(size=4))
        turn = Rotation.from_rotvec(rng.uniform(-1, 1, 3)).as_matrix()
        end = Pose.from_rotation(gripper.position + gripper.rotation @ rng.uniform(-0.4, 0.7, 3),
                                 gripper.rotation @ turn)
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged
        last = shape.at(1.0)
        np.testing.assert_allclose(last.position, end.position, atol=1e-8)
        np.testing.assert_allclose(last.rotation, end.rotation, atol=1e-7)
        weight = np.array([0, 0, -9.81 * 0.15])
        np.testing.assert_allclose(
            shape.gripper_wrench[:3] + shape.far_wrench[:3] + weight, 0, atol=1e-9)
        middle = 0.5 * (shape.positions[1:] + shape.positions[:-1])
        pulls = np.diff(shape.s)[:, None] * [0, 0, -0.05 * 9.81]
        moment = (shape.gripper_wrench[3:] + shape.far_wrench[3:]
                  + np.cross(shape.positions[-1] - gripper.position,
                             shape.far_wrench[:3] + [0, 0, -0.981])
                  + np.cross(middle - gripper.position, pulls).sum(axis=0))
        np.testing.assert_allclose(moment, 0, atol=1e-9)


def test_clamped_column_against_the_elastica():
    # four quarters of the pinned elastica: shortening 1 - (2 E / K - 1), force (4 K)^2 EI / L^2
    shape = simulator().solve(HERE, far_end=Pose((0.9, 0, 0), (0, 0, 0, 1)))
    assert shape.converged
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - 0.9, 1e-6, 0.9)
    assert -shape.far_wrench[0] == pytest.approx((4 * ellipk(m)) ** 2, rel=5e-4)
    np.testing.assert_allclose(shape.far_wrench[1:3], 0, atol=1e-4)


def test_pinned_far_end_has_no_moment_and_buckles_at_eulers_load():
    shape = simulator().solve(HERE, far_end=(0.9995, 0, 0))
    assert shape.converged
    # clamped and pinned: tan x = x
    x = brentq(lambda x: np.tan(x) - x, 4.4, 4.6)
    # force along the line between the ends, some percent above the critical one at this amplitude
    assert np.linalg.norm(shape.far_wrench[:3]) == pytest.approx(x**2, rel=3e-3)
    np.testing.assert_allclose(shape.far_wrench[3:], 0, atol=1e-9)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_twist_at_which_a_straight_rod_buckles(basis):
    # free to shorten: M = 2 * 4.4934 EI / L (both ends clamped), so stability vanishes there
    critical = 8.98682 / 0.7
    angles = critical * np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.99])
    direct = simulator(basis=basis)
    shapes = direct.track([HERE] * 6, far_ends=[FarEnd(turned(a, 1.0), 'sleeve') for a in angles])
    assert all(shape.converged and not shape.jumped for shape in shapes)
    zero = np.polyfit([shape.stability for shape in shapes[-3:]], angles[-3:], 1)[1]
    assert zero == pytest.approx(critical, rel=3e-3)
    fallen = direct.track([HERE], initial=shapes[-1],
                          far_ends=[FarEnd(turned(1.02 * critical, 1.0), 'sleeve')])[0]
    assert fallen.jumped and np.abs(fallen.positions[:, 1:]).max() > 0.05


def test_michells_ring():
    # a ring of a straight rod stays flat up to the twist 2 pi sqrt(3) EI / GJ
    direct = simulator()
    angles = np.linspace(0.1, 2 * np.pi, 30)
    closing = [Pose((np.sin(a) / a, 0, (1 - np.cos(a)) / a),
                    Rotation.from_rotvec([0, -a, 0]).as_quat()) for a in angles]
    ring = direct.track([HERE] * 30, far_ends=closing)[-1]
    assert ring.converged
    assert ring.energy == pytest.approx(2 * np.pi**2, rel=1e-6)
    critical = 2 * np.pi * np.sqrt(3) / 0.7
    twists = critical * np.array([0.15, 0.3, 0.45, 0.6, 0.75, 0.85, 0.93, 0.97])
    shapes = direct.track([HERE] * 8, initial=ring, far_ends=[turned(a) for a in twists])
    for twist, shape in zip(twists, shapes, strict=True):
        assert shape.converged and not shape.jumped
        flat = np.linalg.svd(shape.positions - shape.positions.mean(axis=0))[1][2]
        assert flat < 1e-3
        assert shape.energy == pytest.approx(2 * np.pi**2 + 0.35 * twist**2, rel=1e-3)
    beyond = direct.track([HERE], initial=shapes[-1], far_ends=[turned(1.04 * critical)])[0]
    assert beyond.jumped
    assert beyond.energy < 0.5 * shapes[-1].energy


def test_twist_beyond_half_a_turn_is_followed_not_forgotten():
    direct = simulator()
    shapes = direct.track([HERE] * 4, far_ends=[turned(a, 0.9) for a in (1.5, 3.0, 4.5, 6.0)])
    torsion = [shape.element_strains[:, 0].mean() for shape in shapes]
    assert torsion == sorted(torsion)
    assert torsion[-1] > 3.0  # a pose alone would have been read as -0.28 rad


def test_out_of_reach_is_no_answer():
    assert not simulator().solve(HERE, far_end=(1.2, 0, 0)).converged


def test_nonsense_is_named():
    direct = simulator()
    with pytest.raises(InvalidTask, match='far_end'):
        direct.solve(HERE, far_end=(1, 2))
    with pytest.raises(InvalidTask, match='far_ends has 1'):
        direct.track([HERE, HERE], far_ends=[HERE])
    with pytest.raises(InvalidTask, match='grip'):
        FarEnd(HERE, 'glued')
