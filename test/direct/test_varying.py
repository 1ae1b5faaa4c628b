# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What varies along a DLO, and what acts at its points: right, and its error known."""

import numpy as np
import pytest
from references.stepped import Stepped, random_stepped
from scipy.integrate import quad

from dlo_planner import DirectSimulator, InvalidRod, InvalidTask, PointLoad, Pose, Rod
from dlo_planner.rods import Piecewise, with_plug

HERE = Pose.identity()


def rod_of(true, **more):
    return Rod(1.0, true.of(true.mass, scalar=True), true.of(true.stiffness[:, 1:]),
               true.of(true.stiffness[:, 0], scalar=True),
               natural_curvature=true.of(true.natural[:, 1:]),
               natural_twist=true.of(true.natural[:, 0], scalar=True), **more)


def error(shape, true, gripper=HERE):
    samples = np.append(np.linspace(0, 1, 40), 1.0)[:-1]
    exact = true.shape(gripper, shape.frames[-1], samples)
    return np.linalg.norm(shape.positions_at(samples) - exact, axis=1).max()


@pytest.mark.every(22)
@pytest.mark.parametrize('options', [{}, {'accuracy': 1e-5}, {'n_elements': 64},
                                     {'basis': 'local', 'n_elements': 40}])
@pytest.mark.parametrize('seed', range(4))
def test_random_steps(seed, options):
    rng = np.random.default_rng(seed)
    true, gripper = random_stepped(rng), Pose((0, 0, 0), rng.normal(size=4))
    simulator = DirectSimulator(rod_of(true), load=true.of(true.load), **options)
    shape = simulator.solve(gripper)
    off = error(shape, true, gripper)
    assert shape.converged
    assert shape.error_estimate > off / 10
    assert off < (simulator.accuracy or np.inf)


@pytest.mark.sweep
@pytest.mark.parametrize('width', [0.1, 0.004, 1e-3])
def test_a_narrow_bend_is_not_overlooked(width):
    # a patch that half of all meshes do not see at the middles of their elements
    rod = Rod(1.0, 0.0690346 / 9.81, 5.39961e-3, 4.02956e-3, natural_curvature=lambda s: (
        0.0, 0.8 / width if 0.52 < s < 0.52 + width else 0.0))
    true = Stepped(np.array([0, 0.52, 0.52 + width, 1.0]), np.full(3, 0.0690346 / 9.81),
                   np.tile([4.02956e-3, 5.39961e-3, 5.39961e-3], (3, 1)),
                   np.array([[0, 0, 0], [0, 0, 0.8 / width], [0, 0, 0]]), np.zeros((3, 3)))
    for options in ({'accuracy': 1e-3}, {}, {'n_elements': 64}, {'n_elements': 37}):
        shape = DirectSimulator(rod, **options).solve(HERE)
        off = error(shape, true)
        assert shape.converged and shape.error_estimate > off / 10
        assert off < 1e-3 or 'n_elements' in options
        assert np.abs(shape.s - 0.52).min() < 1e-9


def test_a_narrow_load_is_not_overlooked():
    wire = Rod(1.0, 0.0, 1.0, 1.0)
    load = DirectSimulator(wire, accuracy=1e-6, gravity=(0, 0, 0), load=lambda s: (
        0, 0, -30.0 if 0.52 < s < 0.53 else 0)).solve(HERE)
    point = DirectSimulator(wire, accuracy=1e-6, gravity=(0, 0, 0), point_loads=[
        PointLoad((0, 0, -0.3), s=0.525)]).solve(HERE)
    np.testing.assert_allclose(load.gripper_wrench[2], 0.3, rtol=1e-8)
    np.testing.assert_allclose(load.positions[-1], point.positions[-1], atol=5e-6)


def test_narrower_than_anything_if_it_is_stated():
    width = 1e-6
    bend = Piecewise(lambda s: (0.0, 0.5 / width if 0.3 <= s < 0.3 + width else 0.0),
                     (0.3, 0.3 + width))
    shape = DirectSimulator(Rod(1.0, 0.0, 1.0, 1.0, natural_curvature=bend)).solve(HERE)
    np.testing.assert_allclose(shape.positions[-1], (0.3 + 0.7 * np.cos(0.5), 0.7 * np.sin(0.5), 0),
                               atol=1e-5)


@pytest.mark.parametrize('stiffness', [
    lambda s: 1.0 + 2.0 * s, ((0.0, 1.0), (1.0, 3.0)), [(0, 1), (0.5, 2), (1, 3)],
    np.array([[0.0, 1.0], [1.0, 3.0]]), (lambda s: 1.0 + 2.0 * s, ((0.0, 1.0), (1.0, 3.0)))])
def test_a_tapered_cantilever_in_every_way_to_say_it(stiffness):
    # small loads: deflection = integral of F (1 - s)^2 / EI
    rod = Rod(1.0, 0.0, stiffness, 1.0)
    force = 1e-4
    shape = DirectSimulator(rod, accuracy=1e-9, gravity=(0, 0, 0), point_loads=[
        PointLoad((0, force, -force))]).solve(HERE)
    expected = force * quad(lambda s: (1 - s) ** 2 / (1 + 2 * s), 0, 1)[0]
    np.testing.assert_allclose(shape.positions[-1, 1:], (expected, -expected), rtol=1e-4)


WIRE = Rod(1.0, 0.02, 0.01, 0.007)
GRADED = Rod(1.0, 0.02, ((0.0, 0.04), (1.0, 0.005)), ((0.0, 0.028), (1.0, 0.0035)))


SOFT = tuple((s, 0.01 * part) for s, part in (
    (0.0, 1.0), (0.4, 1.0), (0.4, 1e-3), (0.6, 1e-3), (0.6, 1.0), (1.0, 1.0)))


@pytest.mark.parametrize('rod', [
    with_plug(WIRE, 0.1, 0.005), GRADED, Rod(1.0, 0.02, (SOFT, 0.01), 0.01),
    Rod(1.0, 0.02, (0.01, SOFT), 0.01), Rod(1.0, 0.02, 0.01, SOFT)],
    ids=['plug', 'graded', 'soft about n', 'soft about b', 'soft in torsion'])
@pytest.mark.parametrize('basis', ['chebyshev', 'fourier'])
def test_stability_counts_each_strain_by_its_energy(rod, basis):
    # with one weight for all three a plug made it 1e-6 in place of 1, what is soft about one axis
    # alone 0.97 in place of 0.39
    def stability(terms, **options):
        return DirectSimulator(rod, basis=basis, n_elements=64, n_terms=terms, **options).solve(
            HERE).stability

    assert stability(16, gravity=(0, 0, 0)) == pytest.approx(1.0, abs=1e-4)
    local = DirectSimulator(rod, basis='local', n_elements=64).solve(HERE).stability
    assert stability(16) == pytest.approx(local, rel=0.05)
    assert stability(64) == pytest.approx(local, rel=1e-6)  # as many terms as elements


def test_stiffness_per_component_and_its_step():
    # a stiff half does not bend: the soft one is a cantilever with a rigid arm
    rod = Rod(1.0, 0.0, (((0, 1e6), (0.5, 1e6), (0.5, 1.0), (1, 1.0)), 5.0), 1.0)
    force = 1e-4
    shape = DirectSimulator(rod, accuracy=1e-9, gravity=(0, 0, 0), point_loads=[
        PointLoad((0, force, -force))]).solve(HERE)
    np.testing.assert_allclose(shape.positions[-1, 1:], (force / 15, -force / 24), rtol=1e-4)
    assert 0.5 in shape.s


@pytest.mark.parametrize('moment', [1.0, 3.0, 2 * np.pi])
def test_a_tip_moment_rolls_a_rod_up_to_a_circle(moment):
    shape = DirectSimulator(Rod(1.0, 0.0, 1.0, 1.0), gravity=(0, 0, 0), point_loads=[
        PointLoad(moment=(0, 0, moment))]).solve(HERE)
    assert shape.converged
    np.testing.assert_allclose(shape.element_strains, np.tile([0, 0, moment], (64, 1)), atol=1e-9)
    np.testing.assert_allclose(shape.gripper_wrench, (0, 0, 0, 0, 0, -moment), atol=1e-9)


@pytest.mark.every(3)
@pytest.mark.parametrize('seed', range(3))
def test_dead_moments_and_forces_in_space(seed):
    rng = np.random.default_rng(seed)
    true = random_stepped(rng, 5.0, 0.1)
    gripper = Pose((0, 0, 0), rng.normal(size=4))
    true.points = [(s, rng.normal(size=3), rng.normal(size=3)) for s in (0.37, 1.0)]
    loads = [PointLoad(force, moment, s) for s, force, moment in true.points]
    shape = DirectSimulator(rod_of(true), accuracy=1e-5, load=true.of(true.load),
                            point_loads=loads).solve(gripper)
    assert shape.converged and error(shape, true, gripper) < 1e-5


def test_what_is_wrong_is_named():
    for change, words in [({'bending_stiffness': ((0, 1), (1, -2))}, 'bending_stiffness'),
                          ({'bending_stiffness': ((0, 1), (1, 2), (0.5, 3))}, 's ascending'),
                          ({'torsional_stiffness': lambda s: 0.5 - s}, 'torsional_stiffness'),
                          ({'radius': ((0, 'a'), (1, 2))}, 'radius'),
                          ({'natural_curvature': lambda s: 3.0}, '(k_n, k_b)')]:
        with pytest.raises(InvalidRod, match=words.replace('(', r'\(').replace(')', r'\)')):
            Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 1.0,
                   'torsional_stiffness': 1.0} | change)
    with pytest.raises(InvalidRod, match='too wildly'):
        DirectSimulator(Rod(1.0, 0.1, 1.0, 1.0, natural_twist=lambda s: hash(s) % 97)).solve(HERE)
    with pytest.raises(InvalidTask, match='PointLoad.s'):
        DirectSimulator(Rod(1.0, 0.1, 1.0, 1.0), point_loads=[PointLoad((1, 0, 0), s=1.5)])
