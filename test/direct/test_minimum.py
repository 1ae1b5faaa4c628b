# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The known traps: where plain Newton's method ends somewhere else than in a minimum."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Pose, Rod

UP = Pose.looking_along((0, 0, 0), (0, 0, 1))
CRITICAL = 7.8373  # w L^3 / EI: Greenhill's column, falls over under its own weight


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('load', [50, 200, 1e3, 1e4])
def test_heavy_wires_converge_from_straight(load, basis):
    shape = DirectSimulator(Rod(1.0, load / 9.81, 1.0, 0.75), basis=basis).solve(Pose.identity())
    assert shape.converged
    assert shape.stability > 0.1
    assert (np.diff(shape.positions[:, 2]) < 0).all()  # it hangs


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_benchmark_b_winds_no_turns(wire_with_load, level, basis):
    shape = DirectSimulator(wire_with_load, basis=basis).solve(level)
    turned = np.sum(shape.element_strains[:, 1] * np.diff(shape.s))
    assert turned == pytest.approx(np.pi / 2, abs=0.05)


def test_grading_resolves_the_bend_of_b(wire_with_load, level):
    uniform = DirectSimulator(wire_with_load, basis='local', n_elements=64).solve(level)
    graded = DirectSimulator(wire_with_load, accuracy=1e-4).solve(level)
    assert uniform.error_estimate > 4e-4
    assert graded.error_estimate < 1e-4
    bend = np.searchsorted(graded.s, 0.02)
    assert bend > 0.1 * len(graded.s)  # a fiftieth of the length


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize(('factor', 'stands'), [(0.99, True), (1.01, False), (5.0, False)])
def test_upright_wire_stands_or_falls_over(factor, stands, basis):
    rod = Rod(1.0, factor * CRITICAL / 9.81, 1.0, 0.75)
    shape = DirectSimulator(rod, basis=basis, n_elements=128).solve(UP)
    assert shape.converged
    upright = shape.positions[-1, 2] > 1 - 1e-9
    assert upright == stands
    if stands:
        assert shape.stability > 0
    else:  # any azimuth will do: neutral, and said to be
        assert abs(shape.stability) < 1e-6


def test_stability_is_the_distance_to_buckling():
    # the lowest eigenvalue of the straight column falls linearly with its weight
    loads = np.array([2.0, 4.0, 6.0])
    values = [DirectSimulator(Rod(1.0, w / 9.81, 1.0, 0.75), n_elements=256).solve(UP).stability
              for w in loads]
    np.testing.assert_allclose(values, 1 - loads / CRITICAL, rtol=2e-3)


def test_planar_saddle_is_left_sideways():
    # turned past the vertical, the planar shape is a saddle in 3-D
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    simulator = DirectSimulator(rod)
    before = simulator.solve(Pose((0, 0, 0), Rotation.from_euler('y', -85, True).as_quat()))
    after = simulator.solve(Pose((0, 0, 0), Rotation.from_euler('y', -100, True).as_quat()),
                            before)
    assert after.jumped
    assert after.converged
    assert after.stability > 0.05
    assert after.positions[-1, 0] < -0.8


def test_energy_is_the_lowest_of_many_starts(curly, level, rng):
    simulator = DirectSimulator(curly)
    best = simulator.solve(level)
    for _ in range(5):
        other = simulator.solve(Pose((0, 0, 1), rng.normal(size=4)))
        again = simulator.solve(level, other)
        assert again.converged
        assert again.energy > best.energy - 1e-9


def test_nothing_to_do_is_no_work():
    rod = Rod(1.0, 0.0, 1.0, 1.0)
    shape = DirectSimulator(rod).solve(Pose.identity())
    assert shape.iterations == 0
    assert shape.converged
    assert shape.stability == pytest.approx(1.0)
    np.testing.assert_allclose(shape.positions[:, 0], shape.s, atol=1e-15)


def test_an_accuracy_out_of_reach_is_said(level):
    # the strain has a kink at each mass: series follow it slowly
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, point_masses=((0.3, 3.0), (0.5, 3.0)))
    shape = DirectSimulator(rod, accuracy=1e-5, basis='fourier').solve(level)
    assert shape.error_estimate > 1e-5
    assert not shape.converged
    assert np.isfinite(shape.positions).all()


@pytest.mark.parametrize('accuracy', [1e-3, 1e-5])
def test_fourier_reaches_an_accuracy(wire, curly, level, accuracy):
    for rod in (wire, curly):
        shape = DirectSimulator(rod, accuracy=accuracy, basis='fourier').solve(level)
        true = DirectSimulator(rod, accuracy=0.1 * accuracy).solve(level)
        error = np.linalg.norm(shape.positions - true.positions_at(shape.s), axis=1).max()
        assert shape.converged and error < accuracy


@pytest.mark.parametrize('basis', ['chebyshev', 'fourier', 'fourier_polynomial'])
@pytest.mark.parametrize('elements', [15, 16])
def test_more_terms_than_elements_are_all_that_the_elements_can_do(curly, level, basis, elements):
    # N_L = 15 with N_c = 16 is in the paper's Fig. 6
    wanted = DirectSimulator(curly, n_elements=elements, basis='local').solve(level)
    for terms in (elements, 16, 40):
        shape = DirectSimulator(curly, n_elements=elements, n_terms=terms, basis=basis).solve(level)
        assert shape.converged
        np.testing.assert_allclose(shape.positions, wanted.positions, atol=1e-9)
        assert shape.energy == pytest.approx(wanted.energy, abs=1e-12)


@pytest.mark.parametrize('torsion', [1.874, 2.0])
@pytest.mark.parametrize('basis', ['chebyshev', 'local'])
def test_a_strip_on_edge_leaves_its_plane_where_it_loses_stability(torsion, basis):
    # width 10 times the thickness, cold starts: flat below one load, bent aside above it
    roll = Pose((0, 0, 0), Rotation.from_euler('x', 90, degrees=True).as_quat())
    aside = []
    for load in np.linspace(17.5, 19.0, 48):
        rod = Rod(1.0, load / 9.81, (1.0, 100.0), torsion)
        shape = DirectSimulator(rod, basis=basis).solve(roll)
        assert shape.converged
        aside.append(abs(shape.positions[-1, 1]) > 1e-6)
    assert aside == sorted(aside) and aside[-1]


def test_a_saddle_whose_way_down_drowns_in_rounding_is_left():
    # natural curvature in the plane of its weight, at the load where it starts to leave that plane
    rod = Rod(1.0, 14.266584077318328 / 9.81, (1.0, 100.0), 2.0, natural_curvature=(0.0, 1.0))
    shape = DirectSimulator(rod, basis='local').solve(
        Pose((0, 0, 0), Rotation.from_euler('x', 90, degrees=True).as_quat()))
    assert shape.converged and shape.iterations < 100
