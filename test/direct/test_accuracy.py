# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""An accuracy asked for: kept where the way counts too, and what happened on coarse meshes told."""

from dataclasses import replace

import numpy as np
import pytest
from references.kirchhoff import true_held_rod, true_rod

from dlo_planner import Box, Capsule, DirectSimulator, FarEnd, PointLoad, Pose, Rod
from dlo_planner.direct import accuracy as accuracy_module
from dlo_planner.direct import equilibrium, statics
from dlo_planner.direct.accuracy import judged, mode_may_be_missed, surely_within

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


@pytest.mark.sweep
def test_a_held_dlo_keeps_an_accuracy():
    rod = Rod(1.0, 0.05, (0.3, 0.6), 0.4, natural_curvature=(0.5, -0.3))
    end = FarEnd(Pose((0.6, 0.1, 0.9), (0, 0, 0, 1)))
    shape = DirectSimulator(rod, accuracy=1e-5).solve(LEVEL, far_end=end)
    assert shape.converged
    points = true_held_rod(rod, shape)
    assert np.linalg.norm(shape.positions - points, axis=1).max() < 1e-5


@pytest.mark.parametrize('accuracy', [1e-3, 1e-5])
def test_where_a_coarse_mesh_is_kicked_the_way_is_followed(accuracy):
    direct = DirectSimulator(Rod(1.0, 20 / 9.81, 1.0, 0.75), accuracy=accuracy)
    hanging = direct.solve(Pose.looking_along((0, 0, 0), (0, 0, -1)))
    fallen = direct.solve(Pose.looking_along((0, 0, 0), (0, 0, 1)), hanging)
    assert len(fallen.s) > len(hanging.s) or accuracy > 1e-4  # it needed a finer mesh
    # turned over at once it falls to any side; in small steps it bends over to one
    swung, = direct.track([fallen.gripper], initial=hanging)
    assert fallen.converged and swung.converged and not hanging.jumped
    assert fallen.jumped == swung.jumped
    np.testing.assert_allclose(fallen.positions_at([0.5, 1.0]), swung.positions_at([0.5, 1.0]),
                               atol=2 * accuracy + 1e-4)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_a_way_through_a_wall_is_no_continuation(basis):
    # below the slab there is a good shape, but the DLO cannot have come there
    slab = Box(Pose((0.2, 0, 0.5), (0, 0, 0, 1)), (1.0, 1.0, 0.1))
    direct = DirectSimulator(Rod(1.0, 0.05, 0.5, 0.4, radius=1e-3), basis=basis, n_elements=24,
                             obstacles=[slab])
    above = direct.solve(Pose((0, 0, 0.7), (0, 0, 0, 1)))
    below = direct.solve(Pose((0, 0, -1.0), (0, 0, 0, 1)), above)
    assert not below.converged and below.jumped
    assert direct.solve(Pose((0, 0, -1.0), (0, 0, 0, 1))).converged  # set down there it is one


def test_a_mesh_that_was_found_at_once_is_fine_enough():
    # judged by the shape on the first mesh, beside one on a mesh that is much finer still
    rng = np.random.default_rng(23)
    judged = 0
    while judged < 8:
        stiff = 10**rng.uniform(-1.5, 0.5)
        rod = Rod(1.0, 0.1, (stiff, stiff * rng.uniform(1, 30)), stiff * rng.uniform(0.5, 2),
                  natural_curvature=tuple(rng.normal(0, 1, 2)), tip_mass=rng.choice([0.0, 0.2]))
        gripper = Pose((0, 0, 0), rng.normal(size=4))
        accuracy = 10**rng.uniform(-6, -4.5)
        simulator = DirectSimulator(rod, accuracy=accuracy)
        shape = simulator.solve(gripper)
        if shape.stability < 0.1:
            continue
        judged += 1
        assert shape.converged
        fine = DirectSimulator(rod, basis='local', n_elements=4000).solve(gripper, shape)
        off = np.linalg.norm(fine.positions_at(shape.s) - shape.positions, axis=1).max()
        assert off < accuracy
        assert shape.error_estimate < accuracy
        assert len(shape.element_strains) < 20 * 48
        if len(shape.element_strains) > 60:  # and no finer than it has to be
            assert shape.error_estimate > 0.4 * accuracy


@pytest.mark.parametrize('tip_mass', [0.0, 1.0])
def test_the_last_mesh_is_the_second_and_the_shape_is_foreseen_there(tip_mass, monkeypatch):
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, tip_mass=tip_mass)
    searches, search = [], statics.step
    monkeypatch.setattr(statics, 'step',
                        lambda *given: searches.append(1) or search(*given))
    simulator = DirectSimulator(wire, accuracy=1e-6)
    shape = simulator.solve(LEVEL)
    assert simulator.discretization(LEVEL, shape) is shape.mesh
    assert shape.converged and len(searches) == 2 and shape.iterations <= 2
    assert 0.3e-6 < shape.error_estimate < 0.8e-6


def test_an_error_that_two_meshes_agree_on_is_not_looked_for_on_a_third(monkeypatch):
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    simulator, error_of, asked = DirectSimulator(rod, accuracy=1e-6), equilibrium.estimated, []
    monkeypatch.setattr(equilibrium, 'estimated',
                        lambda *given: asked.append(1) or error_of(*given))
    shape = simulator.solve(LEVEL)
    error = shape.error_estimate
    assert not asked
    # where they do not agree, halved elements tell; both find the same here
    leading = accuracy_module.discretization_error
    monkeypatch.setattr(accuracy_module, 'discretization_error',
                        lambda *given: 1.3 * leading(*given))
    other = simulator.solve(LEVEL)
    assert asked and other.s.size == shape.s.size
    assert other.error_estimate == pytest.approx(error, rel=1e-3)


@pytest.mark.parametrize('rod', [
    Rod(1.0, 1.5, (1.0, 2.0), 0.6, natural_curvature=(1.0, -0.5), natural_twist=0.5),
    Rod(1.0, 0.2, 0.3, 0.2, tip_mass=0.3)])
def test_it_is_kept_beside_kirchhoffs_equations(rod):
    gripper = Pose((0, 0, 1), (0.1, -0.2, 0.1, 0.9))
    shape = DirectSimulator(rod, accuracy=1e-5).solve(gripper)
    error = np.linalg.norm(shape.positions - true_rod(rod, gripper, shape), axis=1).max()
    assert shape.converged and error < 1e-5
    assert 0.3 < error / shape.error_estimate < 1.2


@pytest.mark.parametrize('force', [(0.0, 0.0, 0.0), (3.0, 4.0, 10.0)])
def test_point_masses_get_nodes_and_the_error_is_foreseen_there(force, monkeypatch):
    # a mass between two nodes is shared by them, which bends its element otherwise
    rod = Rod(1.0, 0.2, 1.0, 0.7, point_masses=[(0.313, 1.5), (0.7071, 0.5)])
    loads = [PointLoad(force=force, s=0.57)]
    searches, search = [], statics.step
    monkeypatch.setattr(statics, 'step',
                        lambda *given: searches.append(1) or search(*given))
    shape = DirectSimulator(rod, accuracy=1e-5, point_loads=loads).solve(LEVEL)
    assert shape.converged and len(searches) == 2
    assert np.isin([0.313, 0.7071], shape.s).all()
    fine = DirectSimulator(rod, accuracy=2e-8, point_loads=loads).solve(LEVEL)
    off = np.linalg.norm(fine.positions_at(shape.s) - shape.positions, axis=1).max()
    assert off < 1e-5
    assert 0.3 < off / shape.error_estimate < 1.2


def test_a_shape_that_hardly_stands_is_looked_at_on_a_finer_mesh():
    # upright, just below the load at which it buckles: errors are magnified
    rod = Rod(1.0, 7.6 / 9.81, 1.0, 0.8, natural_curvature=(0.05, 0.0))
    up = Pose.looking_along((0, 0, 0), (0, 0, 1))
    shape = DirectSimulator(rod, accuracy=1e-6).solve(up)
    assert shape.converged and 0.0 < shape.stability < 0.1
    assert not surely_within(shape, 1e-6) and shape.error_estimate < 1e-6
    fine = DirectSimulator(rod, basis='local', n_elements=6000).solve(up, shape)
    off = np.linalg.norm(fine.positions_at(shape.s) - shape.positions, axis=1).max()
    assert off < 1e-6


def test_what_is_said_without_an_estimate_is_above_it():
    # a DLO that hardly stands: its error is twice `truncation`, of others it is below
    rod = Rod(1.0, 0.1, (0.0441137, 0.184684), 0.0369670, natural_curvature=(4.69162, -1.40828),
              tip_mass=0.2)
    shape = DirectSimulator(rod, basis='local', n_elements=16).solve(
        Pose((0, 0, 0), (-0.453073, -1.065838, -0.346121, -0.005876)))
    assert shape.stability > 0.1
    assert not surely_within(shape, 0.999 * shape.error_estimate)
    assert surely_within(shape, 3 * shape.error_estimate)


def test_a_series_that_hardly_stands_is_looked_at_by_another_mesh():
    rod = Rod(1.0, 0.1, 0.3, 0.2)
    series, local = (DirectSimulator(rod, **how).solve(LEVEL) for how in (
        {'n_elements': 32}, {'n_elements': 32, 'basis': 'local'}))
    for shape, missed in ((series, True), (local, False)):
        assert not mode_may_be_missed(shape)
        assert mode_may_be_missed(replace(shape, stability=0.09)) == missed


def test_rods_that_are_twisted_by_nature_keep_an_accuracy():
    # their elements turn about each other by what the change of the strains does not tell
    rng = np.random.default_rng(0)
    kept = []
    for _ in range(60):
        weight, twist, wide = rng.uniform(0.1, 2.0), rng.uniform(8, 18), 10 ** rng.uniform(0.5, 2.5)
        rod = Rod(1.0, weight / 9.81, (wide, 1.0), rng.uniform(0.5, 8.0), natural_twist=twist)
        gripper = Pose((0, 0, 0), rng.normal(size=4))
        accuracy = 10 ** rng.uniform(-4, -3)
        shape = DirectSimulator(rod, accuracy=accuracy).solve(gripper)
        kept.append(shape.converged and shape.error_estimate <= accuracy)
    assert all(kept)


def test_what_is_converged_is_within_its_accuracy_whatever_was_read():
    # between these two shapes the error grows by much more than `truncation` does
    rod = Rod(1.0, 0.2910617705426024, 1.0, 0.5362810953374706, radius=3e-3)
    poses = [(LEVEL, Pose((0.7842181530754008, -0.08952435696296068, 0.9161853080545708),
                          (0, 0, 0, 1))),
             (Pose((-0.006427504533070143, 0.014121868005595974, 1.000334641047398),
                   (0.0002051342344798486, -0.01142282740112339, -0.025296487857023757,
                    0.9996147080931781)),
              Pose((0.7902521010507116, -0.1024506588769277, 0.9105299896142056),
                   (-0.0015927249204345092, -0.004979754210759641, -0.007941967001279828,
                    0.999954794195957)))]
    simulator = DirectSimulator(rod, accuracy=1.42398625012833e-06, basis='chebyshev')
    (here, end), (there, other) = poses
    before = simulator.solve(here, far_end=FarEnd(end))
    assert before.converged and before.error_estimate <= simulator.accuracy
    unread = replace(before, jumped=False)
    shapes = [simulator.solve(there, one, far_end=FarEnd(other)) for one in (before, unread)]
    for shape in shapes:
        assert shape.converged and shape.error_estimate <= simulator.accuracy
    np.testing.assert_array_equal(shapes[0].s, shapes[1].s)


@pytest.mark.sweep
def test_a_dlo_around_a_bar_is_converged_if_another_mesh_bears_on_it_there():
    # one step on halved elements, with the same contacts, moves it by no more than the accuracy
    rod = Rod(1.0, 5.1466, 1.0, 0.5, radius=3e-3, natural_curvature=(-0.0466, 1.6898))
    bar = Capsule((0.34067, -0.5, 0.8418), (0.34067, 0.5, 0.8418), 0.05)
    shape = DirectSimulator(rod, accuracy=2.4e-6, obstacles=[bar]).solve(LEVEL)
    assert shape.contacts and shape.stability > 0.1
    assert shape.converged == (shape.error_estimate <= 2.4e-6) and (
        shape.converged or shape.nearly)
    finer = DirectSimulator(rod, basis='local', n_elements=1500, obstacles=[bar]).solve(LEVEL)
    assert np.linalg.norm(finer.positions[-1] - shape.positions[-1]) <= max(
        2 * shape.error_estimate, 2.4e-6)


def test_what_has_yielded_keeps_an_accuracy():
    rod = Rod(1.0, 0.05, 0.24, 0.16, radius=1e-3, hardening=0.1, yield_curvature=0.3125,
              yield_torsion=2.0, section_model='round')
    angles = np.linspace(-0.5, 2.4, 7)
    poses = [Pose.looking_along((0, 0, 0), (np.cos(a), 0.3 * a, -np.sin(a)))
             for a in (*angles, *angles[-2::-1])]
    shapes = DirectSimulator(rod, accuracy=3e-5).track(poses)
    exact = DirectSimulator(rod, basis='local', n_elements=800).track(poses)
    assert shapes[-1].dissipated > 0
    for shape, fine in zip(shapes, exact, strict=True):
        assert shape.converged and shape.error_estimate <= 3e-5
        assert np.linalg.norm(shape.positions[-1] - fine.positions[-1]) <= 3e-5


def test_a_shape_whose_error_exceeds_the_accuracy_says_by_how_much(wire):
    shape = DirectSimulator(wire, accuracy=1e-4).solve(Pose((0, 0, 1), (0, 0, 0, 1)))
    less = judged(shape, 0.5 * shape.error_estimate)
    assert shape.converged and not less.converged
    assert less.status.endswith(
        f'its error is {shape.error_estimate:.2g} m, expected at most the accuracy of '
        f'{0.5 * shape.error_estimate:.2g} m')
