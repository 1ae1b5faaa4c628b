# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Grips that move a little: the quick search finds what the thorough one finds, or nothing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, FarEnd, Pose, Rod
from dlo_planner.direct import equilibrium, statics
from dlo_planner.energy.grip import constraint_value
from dlo_planner.energy.potential import configuration_at, evaluate
from dlo_planner.energy.problem import new_configuration
from dlo_planner.minimize.hessian import assemble, new_hessian
from dlo_planner.minimize.newton import follow_homotopy
from dlo_planner.model.holds import GRIPS, Hold

SIMULATORS = ({'basis': 'local', 'n_elements': 32}, {'n_elements': 32}, {})


def drawn(rng, grip, **options):
    """Return a DirectSimulator, a Shape of it with both ends held, and grips a little farther."""
    stiff = 10 ** rng.uniform(-0.5, 0.5, 3)
    rod = Rod(1.0, 10 ** rng.uniform(-1, 1.5) / 9.81, tuple(stiff[:2]), stiff[2],
              natural_curvature=tuple(rng.normal(size=2)), natural_twist=rng.normal())
    simulator = DirectSimulator(rod, **options)

    def turned(size):
        return Rotation.from_rotvec(size * rng.normal(size=3))

    base, away = turned(0.5), np.array([rng.uniform(0.5, 0.9), 0, 0]) + 0.1 * rng.normal(size=3)
    gripper = Pose(rng.normal(size=3), base.as_quat())
    place, axes = gripper.position + base.apply(away), turned(0.4) * base
    shape = simulator.solve(gripper, far_end=FarEnd(Pose(place, axes.as_quat()), grip))
    small = 10 ** rng.uniform(-4, -1.7)
    moved = Pose(gripper.position + small * rng.normal(size=3), (turned(small) * base).as_quat())
    end = Pose(place + small * rng.normal(size=3), (turned(small) * axes).as_quat())
    return simulator, shape, moved, FarEnd(end, grip)


@pytest.mark.parametrize('grip', GRIPS)
@pytest.mark.parametrize('options', SIMULATORS)
def test_it_finds_what_the_thorough_search_finds(grip, options, rng, monkeypatch):
    quick, look = [], statics.held_nearby

    def watched(*given):
        found = look(*given)
        quick.append(found is not None)
        return found

    for _ in range(4):
        simulator, shape, gripper, end = drawn(rng, grip, **options)
        if not shape.converged or shape.stability < 0.02:
            continue
        with monkeypatch.context() as patch:
            patch.setattr(statics, 'held_nearby', watched)
            found = simulator.solve(gripper, shape, far_end=end)
            patch.setattr(statics, 'held_nearby', lambda *_: None)
            true = simulator.solve(gripper, shape, far_end=end)
        assert found.converged and true.converged and found.jumped == true.jumped
        np.testing.assert_allclose(found.positions, true.positions, rtol=0, atol=3e-9)
        np.testing.assert_allclose(found.frames, true.frames, rtol=0, atol=3e-8)
        size = np.abs(true.far_wrench).max()
        for name in ('far_wrench', 'gripper_wrench'):
            np.testing.assert_allclose(getattr(found, name), getattr(true, name), rtol=0,
                                       atol=1e-7 * size)
        assert found.energy == pytest.approx(true.energy, rel=1e-8, abs=1e-8 * size)
        assert found.stability == pytest.approx(true.stability, rel=1e-3)
        assert found.violation <= 1e-10
    assert any(quick)


def test_two_millimeters_take_three_steps_and_no_way_in_parts():
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    simulator, gripper = DirectSimulator(wire, n_elements=64), Pose((0, 0, 1), (0, 0, 0, 1))
    known = simulator.solve(gripper, far_end=Pose((0.8, 0, 1), (0, 0, 0, 1)))
    shape = simulator.solve(gripper, known, far_end=Pose((0.802, 0, 1.001), (0, 0, 0, 1)))
    assert shape.converged and shape.iterations <= 3
    assert shape.state.tried == (('near', 'found'),)
    again = simulator.solve(gripper, shape, far_end=shape.far_end)
    assert again.iterations == 0
    np.testing.assert_allclose(again.positions, shape.positions, rtol=0, atol=1e-12)
    assert again.stability == pytest.approx(shape.stability, rel=1e-3)


@pytest.mark.parametrize('grip', GRIPS)
def test_the_error_estimate_is_that_of_the_thorough_search(grip, rng, monkeypatch):
    simulator, shape, gripper, end = drawn(rng, grip, basis='local', n_elements=32)
    found = simulator.solve(gripper, shape, far_end=end)
    quick = found.error_estimate
    monkeypatch.setattr(equilibrium, 'held_nearby', lambda *_: None)
    assert quick == pytest.approx(found.state.estimate(), rel=1e-4)
    fine = DirectSimulator(simulator.rod, basis='local', n_elements=512)
    true = fine.solve(gripper, found, far_end=end).positions[::16]
    assert quick == pytest.approx(np.linalg.norm(found.positions - true, axis=1).max(), rel=0.1)


def test_a_finer_mesh_goes_on_from_a_coarser_one(rng, monkeypatch):
    simulator, shape, _, _ = drawn(rng, 'clamped', basis='local', n_elements=32)
    fine = DirectSimulator(simulator.rod, basis='local', n_elements=200)
    with monkeypatch.context() as patch:
        patch.setattr(statics, 'held_nearby', lambda *_: None)
        true = fine.solve(shape.gripper, shape, far_end=shape.far_end)
    found = fine.solve(shape.gripper, shape, far_end=shape.far_end)
    assert found.state.tried == (('near', 'found'),)
    np.testing.assert_allclose(found.positions, true.positions, rtol=0, atol=1e-9)


@pytest.mark.parametrize('away', [0.12, -0.2])
def test_what_moves_far_is_led_there(away):
    simulator = DirectSimulator(Rod(1.0, 0.1, 0.05, 0.04), n_elements=32)
    here = Pose((0, 0, 0), (0, 0, 0, 1))
    known = simulator.solve(here, far_end=(0.8, 0, 0))
    end = FarEnd.of((0.8 + away, 0, 0))
    past = equilibrium.past_of(simulator.mesh, known, None)
    near = equilibrium.held_nearby(simulator.mesh, here, known.element_strains, past, (end,), True)
    assert near is None
    assert simulator.solve(here, known, far_end=end).converged


def test_a_saddle_between_two_grips_is_left_to_the_thorough_search():
    # compressed beyond its Euler load, a straight rod is in equilibrium, but falls aside
    simulator = DirectSimulator(Rod(1.0, 0.0, 1.0, 0.8), basis='local', n_elements=32)
    here = Pose.identity()
    straight = simulator.solve(here, far_end=FarEnd(Pose((1.0, 0, 0), (0, 0, 0, 1)), 'aligned'))
    for pressed, stable in ((0.9, True), (1.1, False)):  # of the Euler load
        forces = np.zeros(5)
        forces[2] = pressed * 4 * np.pi**2  # N
        found = equilibrium.held_nearby(
            simulator.mesh, here, np.zeros_like(straight.element_strains),
            replace(simulator.mesh.start, hold=forces), straight.holds, True)
        assert (found is not None) == stable


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('grip', GRIPS)
@pytest.mark.parametrize('springs', [True, False])
@pytest.mark.parametrize('nodes', [(), (7,), (3, 8)])
def test_the_rows_of_a_grip_are_its_derivatives(basis, grip, springs, nodes, rng):
    simulator, shape, gripper, end = drawn(rng, grip, basis=basis, n_elements=12)
    mesh = simulator.mesh
    inside = tuple(Hold(shape.at(float(mesh.s[k])), grip, float(mesh.s[k])) for k in nodes)
    held = mesh.system(gripper.rotation, gripper.position, None, (*inside, end))
    loose = held._replace(hold=held.hold._replace(stiffness=0.0, turn_stiffness=0.0))
    system = held if springs else loose
    state = configuration_at(system, np.array(shape.element_strains))
    hessian = new_hessian(system)
    assemble(system, state, hessian)
    rows = hessian.border.rows

    def missed(q):
        there, out = new_configuration(system), np.empty(len(rows))
        there.q[:] = q
        evaluate(system, there)
        constraint_value(system.hold, there, out)
        return out

    along = rng.normal(size=state.q.shape)
    h = 1e-6
    slope = (missed(state.q + h * along) - missed(state.q - h * along)) / (2 * h)
    np.testing.assert_allclose(np.tensordot(rows, along, 2), slope, rtol=0, atol=1e-8)


def test_forces_at_the_end_of_a_way_are_those_of_its_last_good_part():
    # no DLO is as long as the whole way: a part fails, and moves the forces on its way there
    simulator = DirectSimulator(Rod(1.0, 0.05, 1.0, 0.8), n_elements=32, basis='local')
    mesh, start = simulator.mesh, simulator.solve(Pose.identity(), far_end=(0.9, 0, 0))
    ends = [FarEnd.of((x, 0, 0)) for x in np.arange(0.91, 1.2, 0.02)]
    axes = np.stack([[end.pose.rotation] for end in ends])

    def followed(count):
        system = mesh.system(np.eye(3), np.zeros(3), start.state.left, (ends[0],), culled=True)
        return follow_homotopy(
            system, mesh.held.needs.displaced, mesh.unknowns(np.array(start.element_strains)),
            np.stack([np.eye(3)] * count), np.stack([[end.pose.position] for end in ends[:count]]),
            axes[:count], mesh.grip_rows((ends[0],), axes[:count]))

    q, forces, gone = followed(len(ends))
    assert 0 < gone < len(ends)
    there, known, arrived = followed(gone)
    assert arrived == gone
    np.testing.assert_allclose(q, there, atol=1e-2 * np.abs(there).max())
    np.testing.assert_allclose(forces, known, atol=1e-2 * np.abs(known).max())
