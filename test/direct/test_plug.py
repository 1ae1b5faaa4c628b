# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rigid body at the tip: weight, inertia, and that it does not bend."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, InvalidRod, PointLoad, Pose, Rod
from dlo_planner.energy.loads import node_masses
from dlo_planner.rods import with_plug

HERE = Pose.identity()
LENGTH, MASS = 0.03, 0.02


@pytest.fixture
def cable():
    return Rod.circular(1.0, 2e-3, 1200.0, 5e6, 0.4, tip_mass=0.001)


@pytest.mark.parametrize('options', [{}, {'basis': 'local', 'n_elements': 60}, {'accuracy': 1e-5}])
def test_it_is_the_weight_and_moment_of_its_mass(cable, options):
    plugged = DirectSimulator(with_plug(cable, LENGTH, MASS, center=0.01), **options).solve(HERE)
    assert plugged.converged
    # the same cable without it, and at its tip the weight on a rigid arm
    turn = plugged.at(1.0).rotation
    arm = 0.01 * turn[:, 0]
    weight = np.array([0.0, 0.0, -9.81 * MASS])
    loads = [PointLoad(weight, np.cross(arm, weight))]
    bare = DirectSimulator(cable, accuracy=1e-6, point_loads=loads).solve(HERE)
    off = np.linalg.norm(plugged.at(1.0).position - bare.positions[-1])
    assert off < 2 * plugged.error_estimate + 1e-6
    straight = plugged.at(1.0).position + LENGTH * turn[:, 0]
    np.testing.assert_allclose(plugged.positions[-1], straight, atol=1e-6)


@pytest.mark.parametrize(('inertia', 'expected'), [(None, MASS * (3 * 1e-6 + LENGTH**2) / 12),
                                                   (2e-6, 2e-6), (0.0, 0.0)])
def test_mass_center_and_inertia_on_every_mesh(cable, inertia, expected):
    rod = with_plug(cable, LENGTH, MASS, inertia=inertia)
    for options in ({}, {'n_elements': 100}, {'basis': 'local', 'n_elements': 17}):
        s = DirectSimulator(rod, **options).solve(HERE).s
        own = node_masses(rod, s) - node_masses(with_plug(cable, LENGTH, 0.0), s)
        assert own.sum() == pytest.approx(MASS)
        assert own @ s / MASS == pytest.approx(1.015)
        assert own @ (s - 1.015) ** 2 == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(('change', 'words'), [
    ({'length': 0.0}, 'length'), ({'mass': -1.0}, 'mass'), ({'radius': 0.0}, 'radius'),
    ({'center': 0.04}, 'center'), ({'inertia': 5e-6}, 'inertia = 5e-06: .* <= 4.5e-06')])
def test_what_is_wrong_is_named(cable, change, words):
    with pytest.raises(InvalidRod, match=words):
        with_plug(cable, **{'length': LENGTH, 'mass': MASS} | change)
