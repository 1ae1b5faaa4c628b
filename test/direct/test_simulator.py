# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import pickle
from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.shape import State


@pytest.mark.parametrize(('options', 'named'), [
    ({'n_elements': 1}, 'n_elements = 1'),
    ({'n_elements': 2.5}, 'n_elements = 2.5'),
    ({'n_terms': 0}, 'n_terms = 0'),
    ({'basis': 'splines'}, "basis = 'splines'"),
    ({'method': 'magic'}, "method = 'magic'"),
    ({'accuracy': 0.0}, 'accuracy = 0.0'),
    ({'accuracy': np.nan}, 'accuracy = nan'),
    ({'accuracy': 1e-3, 'n_elements': 10}, 'accuracy'),
    ({'accuracy': 1e-3, 'method': 'dfp'}, "method = 'dfp'"),
    ({'gravity': (0, 0)}, 'gravity has shape (2,)'),
    ({'gravity': (0, 0, np.inf)}, 'gravity'),
])
def test_bad_options_are_named(wire, options, named):
    with pytest.raises(InvalidTask) as caught:
        DirectSimulator(wire, **options)
    assert named in str(caught.value)


def test_bad_arguments_of_solve_are_named(wire, level):
    simulator = DirectSimulator(wire)
    with pytest.raises(InvalidTask, match='gripper = None'):
        simulator.solve(None)
    with pytest.raises(InvalidTask, match='initial = 3'):
        simulator.solve(level, 3)
    other = DirectSimulator(Rod(2.0, 0.1, 1.0, 1.0)).solve(level)
    with pytest.raises(InvalidTask, match='initial has length 2 m'):
        simulator.solve(level, other)
    with pytest.raises(InvalidTask, match='rod = 5'):
        DirectSimulator(5)


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier', 'local'])
def test_arrays_have_the_documented_shapes(wire, level, basis):
    shape = DirectSimulator(wire, n_elements=20, basis=basis).solve(level)
    assert shape.s.shape == (21,)
    np.testing.assert_allclose(shape.s, np.arange(21) / 20, atol=1e-15)
    assert shape.positions.shape == shape.tangents.shape == shape.strains.shape == (21, 3)
    assert shape.frames.shape == (21, 3, 3)
    assert shape.gripper_wrench.shape == (6,)
    assert shape.contacts == ()
    with pytest.raises(AttributeError):
        shape.energy = 0.0


def test_at_runs_along_the_arcs(curly, level):
    shape = DirectSimulator(curly, n_elements=16).solve(level)
    for k in (0, 5, 16):
        pose = shape.at(shape.s[k])
        np.testing.assert_allclose(pose.position, shape.positions[k], atol=1e-12)
        np.testing.assert_allclose(pose.rotation, shape.frames[k], atol=1e-12)
    step = 1e-6
    middle = 0.37 * 1.3
    ahead, behind = shape.at(middle + step).position, shape.at(middle - step).position
    np.testing.assert_allclose((ahead - behind) / (2 * step), shape.at(middle).direction,
                               atol=1e-8)
    with pytest.raises(InvalidTask, match=r's = 1\.4'):
        shape.at(1.4)


def test_warm_start_gives_the_cold_shape(wire, level):
    simulator = DirectSimulator(wire)
    tilted = Pose((0.1, 0, 1), (0, -0.1, 0, 1))
    warm = simulator.solve(tilted, simulator.solve(level))
    cold = simulator.solve(tilted)
    np.testing.assert_allclose(warm.positions, cold.positions, atol=1e-10)
    assert not warm.jumped


def test_start_from_another_discretization(wire, level):
    coarse = DirectSimulator(wire, n_elements=10, n_terms=5).solve(level)
    local = DirectSimulator(wire, n_elements=64, basis='local').solve(level, coarse)
    np.testing.assert_allclose(local.positions[-1],
                               DirectSimulator(wire, basis='local').solve(level).positions[-1],
                               atol=1e-10)


def test_strain_at_nodes_is_second_order(wire, level):
    fine = DirectSimulator(wire, basis='local', n_elements=1024).solve(level)
    errors = [np.abs(DirectSimulator(wire, basis='local', n_elements=n).solve(level).strains
                     - fine.strains[::1024 // n]).max() for n in (32, 64)]
    assert errors[0] / errors[1] > 3.0


def test_point_mass_between_nodes_acts_where_it_is(level):
    # a weightless cantilever bends as if it ended at the mass, small deflection P a^2 (3L - a) / 6
    rod = Rod(1.0, 0.0, 1.0, 1.0, point_masses=((0.333, 1e-4),))
    shape = DirectSimulator(rod, basis='local', n_elements=100).solve(level)
    drop = 1e-4 * 9.81 * 0.333**2 * (3 - 0.333) / 6
    assert 1 - shape.positions[-1, 2] == pytest.approx(drop, rel=1e-3)


def test_shapes_travel_between_processes(wire, level):
    shape = DirectSimulator(wire, n_elements=16).solve(level)
    again = pickle.loads(pickle.dumps(shape))
    np.testing.assert_array_equal(again.positions, shape.positions)
    assert again.error_estimate == shape.error_estimate


@pytest.mark.parametrize('basis', ['chebyshev', 'local'])
def test_strains_at_nodes_of_an_uneven_mesh_are_interpolated(wire, level, basis):
    # strains that grow evenly along the elements' middles do so over the nodes, ends included
    s = np.array([0, 0.05, 0.2, 0.25, 0.6, 0.9, 1.0])
    around = DirectSimulator(wire).surroundings
    shape = DirectSimulator(wire, n_elements=6).solve(level)
    middle = 0.5 * (s[1:] + s[:-1])
    slope, start = np.array([0.7, -2.0, 3.0]), np.array([0.1, 0.2, -0.3])
    mesh = Discretization(around, s, basis, 3)
    uneven = replace(shape, s=s, element_strains=start + np.outer(middle, slope),
                     state=State(mesh))
    np.testing.assert_allclose(uneven.strains, start + np.outer(s, slope), atol=1e-12)


def test_with_set_carries_the_permanent_set_and_nothing_else(wire):
    # an elastic DLO has none: contacts and friction of the shape it comes from do not count
    direct = DirectSimulator(wire, basis='local', n_elements=24,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.5)])
    here = Pose((0, 0, 0.01), (0, 0, 0, 1))
    slid = direct.track([Pose((0.03, 0, 0.02), (0, 0, 0, 1)), here])[-1]
    assert slid.converged and slid.contacts
    wanted, found = direct.solve(here), direct.with_set(slid).solve(here)
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-9)
    drag = [sum(contact.friction for contact in shape.contacts) for shape in (found, wanted, slid)]
    weight = 9.81 * wire.mass_per_length
    np.testing.assert_allclose(drag[0], drag[1], atol=1e-6 * weight)
    assert np.linalg.norm(drag[2] - drag[1]) > 0.1 * weight


@pytest.mark.parametrize('limits', [{'yield_curvature': 0.3}, {'yield_torsion': 0.2},
                                    {'yield_curvature': 0.3, 'yield_torsion': 0.2}])
def test_elastic_means_that_nothing_yields(limits, level):
    rod = Rod(1.0, 0.1, (1.0, 2.0), 0.7, natural_curvature=(0.2, 0.5), **limits)
    direct = DirectSimulator(rod, n_elements=16).elastic()
    assert not direct.rod.yields
    free = DirectSimulator(replace(rod, yield_curvature=None, yield_torsion=None), n_elements=16)
    np.testing.assert_allclose(direct.solve(level).positions, free.solve(level).positions)
