# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A magnet that attracts a DLO, the worked example of an effect, against closed forms.

Its derivatives are looked at with all others in `test_potential`.
"""

import numpy as np
import pytest

from dlo_planner import Rod
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.effects import potential
from dlo_planner.energy.magnet import Magnet
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.system import new_state
from dlo_planner.minimize.newton import newton

LENGTH, BENDING = 0.8, 0.7


def attracted(pole, weight, size=0.0, n=64, origin=(0.0, 0.0, 0.0)):
    """Return the System of a level DLO without weight whose tip a pole attracts."""
    around = Surroundings(Rod(LENGTH, 0.0, BENDING, 0.4), np.zeros(3))
    mesh = Discretization(around, np.linspace(0, LENGTH, n + 1), 'local', 0)
    weights = np.zeros(n + 1)
    weights[-1] = weight
    system = mesh.system(np.eye(3), np.array(origin))
    return system._replace(magnet=Magnet(np.array(pole, dtype=float), size, weights))


def fallen(system):
    found = newton(system, np.zeros_like(new_state(system).q), 1e-10, 100, True)
    assert found.residual < 1e-10
    return found


def test_far_away_it_bends_as_a_small_force_at_the_tip_does():
    weight, far = 1.0, 100.0
    found = fallen(attracted((LENGTH, 0.0, far), weight))
    force = weight / far**2
    wanted = force * LENGTH**3 / (3 * BENDING)
    assert found.state.positions[-1, 2] == pytest.approx(wanted, rel=1e-3)
    assert found.state.base_force[2] == pytest.approx(-force, rel=1e-4)


@pytest.mark.parametrize('sign', [1, -1])
def test_beside_the_tip_it_falls_where_the_field_is_stiffer_than_the_bending(sign):
    # a bar 3 EI / L^3 stiff at its tip, with a repelling pole on top of it: the tip is on a hill of
    # curvature w / a^3, and leaves it once that is more than the bar's stiffness
    size, stiff = 0.2, 3 * BENDING / LENGTH**3
    critical = stiff * size**3
    system = attracted((LENGTH, 0.0, 0.0), -(1 + 0.1 * sign) * critical, size)
    found = fallen(system)
    moved = np.linalg.norm(found.state.positions[-1] - (LENGTH, 0, 0))
    assert found.stability > -1e-7  # all sides are alike
    assert (moved > 0.01) == (sign > 0)
    assert (found.kicks > 0) == (sign > 0)


def test_its_potential_and_force_are_those_of_the_place_in_the_world(rng):
    origin, pole = np.array([0.3, -0.2, 0.1]), np.array([0.5, 0.4, 0.6])
    system = attracted(pole, 2.0, 0.1, origin=origin)
    state = new_state(system)
    state.q[:] = rng.normal(size=state.q.shape)
    energy, noise = evaluate(system, state)
    tip = origin + state.positions[-1]
    away = np.sqrt(np.sum((tip - pole) ** 2) + 0.1**2)
    np.testing.assert_allclose(state.pull[-1], 2.0 * (tip - pole) / away**3, rtol=1e-12)
    assert energy - 0.5 * np.sum(state.q**2) == pytest.approx(-2.0 / away, rel=1e-12)
    assert potential(system.effects, system, state.positions + origin) == pytest.approx(
        -2.0 / away, rel=1e-12)
    assert 1e-16 < noise < 1e-15 * (abs(energy) + 40.0)
