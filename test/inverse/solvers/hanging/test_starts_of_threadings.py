# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where threadings begin: shapes by integration from the free end, and rolls that differ."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Rod
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.inverse.equilibria import integrate_from_tip, is_axisymmetric, least_turn

ROD = Rod(1.0, 0.1, (0.5, 1.0), 0.4, natural_curvature=(0.6, -0.3), natural_twist=0.5,
          tip_mass=0.02)


def test_the_march_from_the_end_is_an_equilibrium(rng):
    end = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    direct = DirectSimulator(ROD, basis='local', n_elements=12)
    system = direct.mesh.system(np.eye(3))
    strains, base = integrate_from_tip(system, np.ascontiguousarray(end))
    turned = system._replace(base=base)
    state = new_configuration(turned)
    state.q[:] = (strains - turned.natural) / turned.scale
    evaluate(turned, state)
    np.testing.assert_allclose(state.gradient, 0, atol=1e-13)
    np.testing.assert_allclose(state.rotations[-1], end, atol=1e-13)


def test_the_least_turn_is_about_the_axis_across(rng):
    for _ in range(20):
        one, other = rng.normal(size=(2, 3))
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        turn = least_turn(one, other)
        np.testing.assert_allclose(turn @ one, other, atol=1e-12)
        angle = Rotation.from_matrix(turn).magnitude()
        assert angle == pytest.approx(np.arccos(np.clip(one @ other, -1, 1)))
        np.testing.assert_allclose(least_turn(one, one), np.eye(3), atol=1e-15)
        np.testing.assert_allclose(least_turn(one, -one) @ one, -one, atol=1e-12)


@pytest.mark.parametrize(('more', 'alike'), [
    ({}, True), ({'natural_curvature': (0.3, 0.0)}, False), ({'natural_twist': 0.5}, False),
    ({'natural_curvature': lambda s: (0.0, max(0.0, s - 0.9))}, False),
    ({'bending_stiffness': (0.5, 0.6)}, False), ({'tip_mass': 0.1}, True)])
def test_rolls_are_alike_where_the_dlo_is_straight_and_round(more, alike):
    rod = Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 0.5,
                 'torsional_stiffness': 0.4, **more})
    assert is_axisymmetric(rod) == alike
