# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions against wires that were not written with the package, balances, and what they say."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from references.planar_motions import (
    CASES,
    DENSITY,
    LEVEL,
    REFERENCE_C,
    STIFFNESS,
    Wire,
    links,
    motion_of,
    reference,
    rod,
    spectral,
    tilted,
    tips,
    wild_turn,
)
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Capsule,
    DirectSimulator,
    FarEnd,
    InvalidTask,
    Motion,
    Plane,
    Pose,
    Rod,
)
from dlo_planner.direct.stepper import Stepper


@pytest.mark.every(3)
@pytest.mark.parametrize('case', CASES)
def test_a_motion_is_right_within_its_estimate(case):
    motion = motion_of(case)
    assert motion.converged
    known, doubtful = reference(case)
    true = np.linalg.norm(tips(motion) - known, axis=1)
    assert true.max() < 5e-3 + doubtful
    assert (motion.error_estimate >= 0.1 * (true - doubtful)).all()
    assert (np.diff(motion.error_estimate) >= 0).all()
    assert motion.error_estimate[-1] < 100 * true.max() + 1e-3
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    # the work of the grips is a quadrature of its own: that it balances is no tautology
    assert np.abs(motion.numerical_loss).max() < 0.01 * moved
    assert motion.numerical_loss.min() > -2e-3 * moved


@pytest.mark.sweep
def test_both_references_agree():
    angle, place, mass, _, _ = CASES['whirl']
    wire = Wire(1.0, DENSITY, STIFFNESS, angle, place, mass)
    times = np.linspace(0, 0.3, 16)
    one, energies = spectral(wire, times, np.zeros(8), 8, 24, 1e-6)
    np.testing.assert_allclose(one, (4 * links(wire, times, np.zeros(24), 1e-7)
                                     - links(wire, times, np.zeros(12), 1e-7)) / 3, atol=5e-4)
    assert np.isfinite(energies).all()


def test_a_free_motion_keeps_its_energy():
    motion = motion_of('swing')
    np.testing.assert_array_equal(motion.work, 0)
    np.testing.assert_array_equal(motion.losses, 0)
    swung = motion.kinetic_energy.max()
    assert swung > 0.1
    assert np.abs(motion.energy - motion.energy[0]).max() < 5e-3 * swung
    assert motion.numerical_loss.min() > -1e-3 * swung


def test_what_damping_takes_is_what_is_missing():
    thing = rod(damping=(0.4, 5e-3))
    straight = DirectSimulator(thing, gravity=(0, 0, 0)).solve(LEVEL)
    motion = DirectSimulator(thing).simulate([LEVEL] * 80, 0.01, straight)
    lost = motion.energy[0] - motion.energy
    assert lost[-1] > 0.05
    np.testing.assert_allclose(motion.losses[:, 0], lost, atol=0.01 * lost[-1])
    np.testing.assert_array_equal(motion.losses[:, 1:], 0)


def test_work_of_a_gripper_that_lifts_slowly():
    heights = 0.1 * (1 - np.cos(np.pi * np.linspace(0, 1, 60)))
    motion = DirectSimulator(rod()).simulate([tilted(0, (0, z)) for z in heights], 0.2)
    assert motion.work[-1] == pytest.approx(9.81 * DENSITY * 0.2, rel=2e-3)
    assert motion.energy[-1] - motion.energy[0] == pytest.approx(motion.work[-1], rel=2e-3)


def test_the_wild_turn_of_benchmark_c_keeps_its_energy():
    # without damping the end cracks like a whip at 1.6 s
    motion = wild_turn()
    assert motion.status == 'complete'
    away = np.linalg.norm(tips(motion)[list(REFERENCE_C)] - list(REFERENCE_C.values()), axis=1)
    assert away.max() < 1e-3
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert motion.numerical_loss.min() > -1e-3 * moved
    assert np.abs(motion.numerical_loss).max() < 0.01 * moved


def test_a_motion_goes_on_from_another():
    whole = motion_of('swing')
    simulator = DirectSimulator(rod())
    half = len(whole) // 2
    straight = whole.shapes[0]
    first = simulator.simulate([LEVEL] * (half + 1), 0.01, straight)
    second = simulator.simulate([LEVEL] * (len(whole) - half), 0.01, first)
    np.testing.assert_allclose(second.velocities[0], first.velocities[-1], atol=2e-2)
    np.testing.assert_allclose(tips(second)[-1], tips(whole)[-1], atol=2e-3)
    moved = np.linalg.norm(tips(whole)[-1] - tips(whole)[half])
    assert moved > 0.1


def test_an_initial_velocity_is_made_possible_or_refused():
    simulator = DirectSimulator(rod(), gravity=(0, 0, 0))
    start = simulator.solve(LEVEL)
    spin = np.array([0, -3.0, 0])
    # turned and let the gripper turn with it: a rigid rotation stays one
    grippers = [tilted(3.0 * 0.01 * k) for k in range(20)]
    motion = simulator.simulate(grippers, 0.01, start,
                                velocity=lambda s: np.cross(spin, (s, 0, 0)))
    np.testing.assert_allclose(motion.velocities[0, -1], [0, 0, 3.0], atol=1e-3)
    np.testing.assert_allclose(tips(motion)[-1], [np.cos(0.57), np.sin(0.57)], atol=2e-3)
    with pytest.raises(InvalidTask, match='velocity.*length'):
        simulator.simulate([LEVEL] * 3, 0.01, start, velocity=lambda s: (s, 0, 0))
    with pytest.raises(InvalidTask, match='velocity'):
        simulator.simulate([LEVEL] * 3, 0.01, start, velocity=np.zeros((4, 3)))


@pytest.mark.parametrize('grip', ['clamped', 'pinned', 'sleeve'])
def test_a_far_end_that_moves_slowly_is_as_in_statics(grip):
    simulator = DirectSimulator(rod(damping=(8.0, 0.02)))
    share = 0.5 - 0.5 * np.cos(np.pi * np.minimum(np.linspace(0, 1.5, 46), 1.0))
    ends = [FarEnd(tilted(-0.2 * x, (0.95 - 0.05 * x, 0.1 * x)), grip) for x in share]
    motion = simulator.simulate([LEVEL] * 46, 0.1, far_ends=ends)
    assert motion.converged, motion.message
    still = simulator.track([LEVEL] * 46, far_ends=ends)[-1]
    np.testing.assert_allclose(motion.shapes[-1].positions, still.positions, atol=2e-3)
    gained = motion.energy[-1] - motion.energy[0]
    assert motion.work[-1] == pytest.approx(gained + motion.dissipated[-1],
                                            abs=0.02 * (abs(gained) + motion.dissipated[-1]))


def test_a_shape_that_is_turned_in_an_aligned_grip_begins_a_motion():
    gripper = Pose((0, 0, 1), (0, 0, 0, 1))
    direct = DirectSimulator(Rod(1.0, 0.03, 1e-3, 1e-3), basis='local', n_elements=16)
    along = np.array([1.0, 0.3, 0.4]) / np.linalg.norm([1.0, 0.3, 0.4])
    ends = [FarEnd(Pose.from_rotation((0.7, 0, 1), Pose.looking_along((0, 0, 0), along).rotation @
                                      Rotation.from_rotvec((turn, 0, 0)).as_matrix()), 'aligned')
            for turn in (0.0, 1.0)]
    shape = direct.solve(gripper, far_end=ends[0])
    for end in ends:  # which way it is turned about its tangent does not count
        motion = direct.simulate([gripper] * 4, 0.05, shape, far_ends=[end] * 4)
        assert motion.converged
        assert np.abs(motion.shapes[-1].positions - shape.positions).max() < 1e-6
    askew = FarEnd(Pose.looking_along((0.7, 0, 1), along + [0, 0.1, 0]), 'aligned')
    with pytest.raises(InvalidTask, match='far end'):
        direct.simulate([gripper] * 4, 0.05, shape, far_ends=[askew] * 4)


def test_far_ends_that_make_no_sense_are_refused():
    simulator = DirectSimulator(rod())
    held = simulator.solve(LEVEL, far_end=(0.8, 0, 0))
    for ends, named in (([(0.8, 0, 0)], 'far_ends has 1'),
                        ([(0.8, 0, 0), FarEnd(tilted(0, (0.8, 0)))], 'same grip')):
        with pytest.raises(InvalidTask, match=named):
            simulator.simulate([LEVEL] * 2, 0.01, far_ends=ends)
    with pytest.raises(InvalidTask, match='far end'):
        simulator.simulate([LEVEL] * 2, 0.01, held, far_ends=[(0.7, 0, 0)] * 2)
    assert simulator.simulate([LEVEL] * 2, 0.01, held, far_ends=[(0.8, 0, 0)] * 2).converged


@pytest.mark.parametrize('obstacle', [Plane((0, 0, -0.3), (0, 0, 1)),
                                      Capsule((0.5, -1, -0.2), (0.5, 1, -0.2), 0.02)])
def test_impacts_make_no_energy(obstacle):
    thing = rod(radius=2e-3)
    straight = DirectSimulator(thing, gravity=(0, 0, 0), n_elements=24, basis='local').solve(LEVEL)
    simulator = DirectSimulator(thing, n_elements=24, basis='local', obstacles=[obstacle])
    motion = simulator.simulate([LEVEL] * 28, 0.01, straight)
    assert any(shape.contacts for shape in motion.shapes)
    moved = motion.kinetic_energy.max()
    assert motion.converged or 's ' in motion.message
    assert motion.numerical_loss.min() > -2e-3 * moved


def test_what_stops_a_motion_is_named():
    simulator = DirectSimulator(rod(radius=2e-3, damping=1.0), n_elements=16, obstacles=[
        Plane((0, 0, -0.9), (0, 0, 1))])
    motion = simulator.simulate([tilted(0, (0, z)) for z in np.linspace(0, -1, 11)], 0.1)
    assert not motion.converged and motion.status in ('unsolved', 'energy')
    assert f'{motion.times[-1]:.3g}'[:3] in motion.message
    assert not motion.shapes[-1].converged


def test_a_motion_that_gains_energy_ends_before_it_does():
    # more than ten terms of a series follow: soft, undamped, shaken far above its lowest mode
    stiffness = 9.81 * 0.1 / 113
    soft = DirectSimulator(Rod(1.0, 0.1, stiffness, 0.75 * stiffness))
    shaken = [Pose((0, 0, 0.05 * np.sin(2 * np.pi * 11.7 * k * 0.005)), (0, 0, 0, 1))
              for k in range(120)]
    motion = soft.simulate(shaken, 0.005)
    assert motion.status == 'energy' and not motion.converged and len(motion) < 120
    assert f'from {motion.times[-1]:.6g} s' in motion.message
    assert motion.shapes[-1].converged
    moved = motion.kinetic_energy[:-1].max()
    assert motion.kinetic_energy[-1] < 1.1 * moved
    assert motion.numerical_loss.min() > -2e-3 * moved


def test_a_motion_travels_with_its_estimate(tmp_path):
    motion = DirectSimulator(rod(), n_elements=8, n_terms=4).simulate(
        [tilted(0.01 * k) for k in range(6)], 0.01)
    motion.save(tmp_path / 'unread.npz')
    assert np.isnan(Motion.load(tmp_path / 'unread.npz').error_estimate).all()
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(again.error_estimate, motion.error_estimate)
    motion.save(tmp_path / 'read.npz')
    read = Motion.load(tmp_path / 'read.npz')
    assert read == motion
    np.testing.assert_array_equal(read.error_estimate, motion.error_estimate)
    assert motion.within_tolerance == (motion.error_estimate <= motion.tolerance).all()


def test_steps_that_exceed_the_tolerance_say_so():
    simulator, ways = DirectSimulator(rod(), n_elements=8, n_terms=4), [
        tilted(0.1 * k) for k in range(4)]
    fine, rough = (simulator.simulate(ways, 0.05, tolerance=tolerance, integrator='paper')
                   for tolerance in (10.0, 1e-6))
    assert fine.message == '' and fine.converged and rough.converged
    assert 'the local errors of its steps add up to' in rough.message
    assert 'more than the tolerance of 1e-06 m' in rough.message and not rough.within_tolerance


@pytest.mark.parametrize('beyond', [False, True])
def test_once_the_dlo_has_touched_its_steps_stay_those_of_impacts(beyond, monkeypatch):
    made, steps = [], Stepper.steps

    def seen(self, *arguments):
        batch = steps(self, *arguments)
        if len(batch.errors):
            made.append(batch.last.touched)
        return batch

    monkeypatch.setattr(Stepper, 'steps', seen)
    floor = Plane((0, 0, -10.0 if beyond else -0.05), (0, 0, 1))
    direct = DirectSimulator(replace(rod(), radius=0.005), n_elements=8, n_terms=4,
                             obstacles=[floor])
    motion = direct.simulate([Pose((0, 0, 0.2 * k * k), (0, 0, 0, 1)) for k in range(3)], 0.2)
    assert motion.converged and not motion.shapes[-1].contacts  # it was lifted off
    assert bool(motion.shapes[0].contacts) != beyond
    assert made and all(touched != beyond for touched in made)


@pytest.mark.parametrize('viscosity', [1e-4, 1e-3, 5e-3])
def test_damping_takes_no_more_than_there_is_of_what_is_too_quick_for_the_steps(viscosity):
    thing = Rod.circular(1.0, 4e-3, 1200.0, 5e6, 0.4, damping=(0.0, viscosity))
    simulator = DirectSimulator(thing, n_elements=24, basis='local')
    start = simulator.solve(LEVEL)
    across = np.sin(12 * np.pi * start.s) * np.minimum(1, 6 * start.s)
    motion = simulator.simulate([LEVEL] * 30, 0.03, start, integrator='paper',
                                velocity=np.outer(across, (0, 1, 0)))
    assert motion.losses[-1, 0] > 0
    assert motion.numerical_loss.min() > -1e-3 * motion.kinetic_energy[0]
