# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Loads on nodes: totals and moments of what they stand for."""

import numpy as np
import pytest

from dlo_planner import PointLoad, Rod
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.energy.loads import node_forces, node_masses, node_moments

S = np.array([0, 0.1, 0.4, 0.45, 0.9, 1.2, 1.3])


@pytest.mark.parametrize('where', [0.0, 0.13, 0.39, 0.4, 1.29, 1.3])
def test_a_point_mass_keeps_its_place_on_an_uneven_mesh(where):
    masses = node_masses(Rod(1.3, 0.0, 1.0, 1.0, point_masses=((where, 0.3),)), S)
    assert masses.sum() == pytest.approx(0.3)
    assert masses @ S == pytest.approx(0.3 * where)
    near = np.abs(S - where)
    assert (masses[near > 0.5] == 0).all() and (masses >= 0).all()


def test_masses_on_an_uneven_mesh_keep_the_first_moment():
    rod = Rod(1.3, lambda s: 1.0 + s, 1.0, 1.0, tip_mass=0.7, point_masses=((0.2, 0.5),))
    h, middle = np.diff(S), 0.5 * (S[1:] + S[:-1])
    masses = node_masses(rod, S)
    assert masses.sum() == pytest.approx(np.sum(h * (1 + middle)) + 1.2)
    assert masses @ S == pytest.approx(1.3**2 / 2 + 1.3**3 / 3 + 0.7 * 1.3 + 0.5 * 0.2)


def around(**more):
    return Surroundings(Rod(1.3, 0.1, 1.0, 1.0), (0.0, 0.0, -9.81), **more)


@pytest.mark.parametrize(('load', 'power'), [
    ((1.0, -2.0, 3.0), (0, 0, 0)), (lambda s: (1.0, -2.0 * s, 3.0 * s**2), (0, 1, 2))],
    ids=['even', 'varies'])
def test_a_distributed_load_keeps_force_and_moment(load, power):
    forces, power = node_forces(around(load=load), S), np.array(power)
    size = np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(forces.sum(axis=0), size * 1.3 ** (power + 1) / (power + 1))
    np.testing.assert_allclose(S @ forces, size * 1.3 ** (power + 2) / (power + 2))


def test_point_loads_keep_force_moment_and_place():
    loads = [PointLoad((1.0, 2.0, 3.0), s=0.5), PointLoad((0.0, 0.0, -1.0), (0.0, 0.3, 0.0))]
    forces, moments = (what(around(point_loads=loads), S) for what in (node_forces, node_moments))
    np.testing.assert_allclose(forces.sum(axis=0), (1.0, 2.0, 2.0))
    np.testing.assert_allclose(S @ forces, (0.5, 1.0, 1.5 - 1.3))
    np.testing.assert_array_equal(moments[-1], (0.0, 0.3, 0.0))
