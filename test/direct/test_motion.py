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
from sweeps.contact import random_slide

from benchmarks import columns
from dlo_planner import (
    Capsule,
    DeadlineExceeded,
    DirectSimulator,
    FarEnd,
    InvalidTask,
    Plane,
    Pose,
    Rod,
    Sphere,
)
from dlo_planner.direct import dynamics
from dlo_planner.direct.boundary_motion import BoundaryMotion, GripTrajectory, moving_grips
from dlo_planner.direct.integrator import KINETIC, WORK, Scheme, within_energy_budget
from dlo_planner.direct.stepper import Acceptance, Stepper
from dlo_planner.minimize.newton import newton
from dlo_planner.results import Motion


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
    assert not motion.converged and motion.status == 'blocked'  # the floor is where it ends
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
        [tilted(0.01 * k) for k in range(4)], 0.01)
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


@pytest.mark.every(3)
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


# ------------------------------------------------------------------------------------------------
# The way of a grip between the instants: against motions that are known in closed form.


AXIS = np.array([1.0, 2.0, -2.0]) / 3


def twist_at(guide, place):
    (back, ahead), (before, after) = guide.along(place + np.array([-1e-4, 1e-4]))
    turn = Rotation.from_matrix(ahead @ back.T).as_rotvec()
    return np.append(after - before, turn) / (2e-4 * guide.dt)


def test_two_poses_are_one_constant_acceleration():
    guide = GripTrajectory([Pose.identity(), Pose((0.4, 0, -0.2), (0, 0, 0, 1))], 0.5)
    for place in (0.25, 0.5, 0.75):
        np.testing.assert_allclose(guide.at(place).position, place**2 * np.array([0.4, 0, -0.2]),
                                   atol=1e-15)
    for place in (0.0, 0.5, 0.9):  # v = 2 x t / T^2
        np.testing.assert_allclose(twist_at(guide, place),
                                   2 * place / 0.5 * np.array([0.4, 0, -0.2, 0, 0, 0]), atol=1e-10)


@pytest.mark.parametrize('at_rest', [True, False])
def test_several_whole_turns_are_gone_through(at_rest):
    # a rotation has two quaternions: here now the one comes, now the other
    angles = 4.5 * np.pi * np.linspace(0, 1, 60) ** 2
    guide = GripTrajectory(
        [Pose((0, 0, 0), (-1) ** (k // 3) * Rotation.from_rotvec(a * AXIS).as_quat())
         for k, a in enumerate(angles)], 0.1, at_rest)
    for place in np.arange(2.5, 57):
        angle = 4.5 * np.pi * (place / 59) ** 2
        away = guide.at(place).rotation @ Rotation.from_rotvec(-angle * AXIS).as_matrix()
        assert np.linalg.norm(away - np.eye(3)) < 1e-4
        rate = 2 * 4.5 * np.pi * place / 59**2 / 0.1
        np.testing.assert_allclose(twist_at(guide, place), [0, 0, 0, *rate * AXIS], atol=0.02)
    rotations, _ = guide.along(np.array([3.5, 40.0, 41.25]))
    for place, rotation in zip((3.5, 40.0, 41.25), rotations, strict=True):
        np.testing.assert_allclose(rotation, guide.at(place).rotation, atol=1e-12)


# ------------------------------------------------------------------------------------------------
# A DLO that falls onto a plane: quick, with an error that it knows.


CABLE = Rod(1.0, 0.1, 0.02, 0.015, radius=0.005, damping=1e-3)
FLOOR = Plane((0, 0, -0.2), (0, 0, 1))


def dropped(instants, dt, friction=0.0, **options):
    """Return the Motion of a cable that is straight and level at first."""
    straight = DirectSimulator(CABLE, gravity=(0, 0, 0), **options).solve(LEVEL)
    floor = Plane(FLOOR.point, FLOOR.normal, friction)
    return DirectSimulator(CABLE, obstacles=[floor], **options).simulate(
        [LEVEL] * instants, dt, straight)


def test_the_error_of_a_drop_is_known():
    motion = dropped(25, 0.01)
    assert motion.status == 'complete' and motion.shapes[-1].contacts
    soon = motion.error_estimate  # half a second of halved steps, then doubled ones
    with pytest.raises(DeadlineExceeded):
        motion.estimate_error(deadline=1e-3)
    estimate = motion.estimate_error()
    assert np.isfinite(soon).all() and np.isfinite(estimate).all()
    assert soon[0] == estimate[0] and (soon != estimate).any()
    assert motion.error_estimate is estimate
    # four times the steps, twice the elements
    finer = dropped(97, 0.0025, n_elements=128, basis='local')
    assert finer.status == 'complete'
    shapes = zip(finer.shapes[::4], motion.shapes, strict=True)
    true = np.maximum.accumulate([np.linalg.norm(one.positions[::2] - other.positions, axis=1).max()
                                  for one, other in shapes])
    assert true[-1] > 1e-3  # the impact counts
    for one in (soon, estimate):
        assert (true <= one).all() and one[-1] < 5 * true[-1]
    # an impact takes energy, and gives none
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)


# ------------------------------------------------------------------------------------------------
# How stable the shapes of a motion are: found when it is asked for, from how the DLO moves.


@pytest.mark.every(3)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('damping', [0.0, (0.5, 5e-4)])
@pytest.mark.parametrize('integrator', ['generalized_alpha', 'paper'])
def test_a_step_is_as_stable_as_the_hessian_that_it_minimized_says(basis, damping, integrator):
    wire, dt = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, damping=damping), 0.005
    simulator = DirectSimulator(wire, basis=basis, n_elements=24)
    grippers = [tilted(0.5 * k * dt) for k in range(7)]
    start = simulator.solve(grippers[0])
    stepper = Stepper(start.mesh, BoundaryMotion(GripTrajectory(grippers, dt)), dt)
    now, scheme, told = stepper.begin(start), Scheme(integrator, dt), []
    for k in range(1, 7):
        batch = stepper.steps(now, (), np.array([float(k)]), scheme, Acceptance())
        assert batch.refused is None
        problem = stepper.problem(now, float(k), scheme)
        there = batch.last.shape
        true = newton(problem, start.mesh.unknowns(there.element_strains), 1e-9, 100, True)
        np.testing.assert_allclose(true.state.strains, there.element_strains, rtol=0, atol=1e-5)
        told.append((there.stability, true.stability))
        now = batch.last
    told = np.array(told)
    assert np.isfinite(told).all()
    assert np.abs(told[:, 0] / told[:, 1] - 1).max() < 1e-3
    assert told[-1, 1] < 0.99  # not merely that of a DLO without forces


# ------------------------------------------------------------------------------------------------
# Motions in which inertia is far stronger than elasticity go on, and are right.


DT = 0.02


def soft(softness, **more):
    """Return a rod of 1 m, w L^3 / EI = `softness`."""
    stiffness = 0.05 * 9.81 / softness
    return Rod(1.0, 0.05, stiffness, 0.75 * stiffness, **more)


def tumbled(pace, n):
    """Return n poses, DT apart, of a gripper that is turned and moved, at rest at first."""
    x = pace * DT * np.arange(n)
    places = np.sin(np.outer(x, [1.0, 0.7, 1.3])) ** 2 * np.array([0.1, 0.05, 0.1])
    turns = np.sin(x)[:, None] ** 2 * np.array([0.3, 1.0, 0.4])
    return [Pose(place, Rotation.from_rotvec(turn).as_quat())
            for place, turn in zip(places, turns, strict=True)]


def apart(motion, other):
    """Return the largest distance of a node from every second one of a finer motion, m."""
    return max(np.linalg.norm(one.positions - two.positions[::2], axis=1).max()
               for one, two in zip(motion.shapes, other.shapes, strict=True))


@pytest.mark.every(5)
@pytest.mark.parametrize(('softness', 'pace', 'more'), [
    (1e3, 10.0, {}), (1e3, 7.0, {'tip_mass': 0.03}), (3e3, 7.0, {}), (1e4, 7.0, {}),
    (3e3, 10.0, {'damping': (1.0, 1e-3)})])
def test_a_whipped_rod_goes_on_within_its_estimate(softness, pace, more):
    rod, grippers = soft(softness, **more), tumbled(pace, 20)
    motion, finer = (DirectSimulator(rod, n_elements=n, basis='local').simulate(
        grippers, DT, tolerance=tolerance) for n, tolerance in ((16, 1e-3), (32, 2e-4)))
    assert motion.converged, motion.message
    assert finer.converged, finer.message
    assert max(shape.residual for shape in motion.shapes) < 1e-6
    assert apart(motion, finer) < 1.5 * motion.error_estimate[-1] < 0.5
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert -2e-3 * moved < motion.numerical_loss.min()
    assert motion.numerical_loss.max() < 0.02 * moved


@pytest.mark.sweep
def test_both_ends_of_a_soft_rod_are_moved_fast():
    up = 0.15 * np.sin(3 * 2 * np.pi * DT * np.arange(6)) ** 2
    grippers = [Pose((0, 0, z), LEVEL.quaternion) for z in up]
    ends = [FarEnd(Pose((0.7, y, 0), Rotation.from_euler('z', 2 * y).as_quat()), 'pinned')
            for y in up]
    rod = soft(3e3, damping=(0.5, 2e-3))
    motion, finer = (DirectSimulator(rod, n_elements=n, basis='local').simulate(
        grippers, DT, far_ends=ends, tolerance=tolerance)
        for n, tolerance in ((24, 1e-3), (48, 2e-4)))
    assert motion.converged, motion.message
    assert finer.converged, finer.message
    assert apart(motion, finer) < 1.5 * motion.error_estimate[-1] < 0.5
    for shape, end in zip(motion.shapes, ends, strict=True):
        assert np.linalg.norm(shape.positions[-1] - end.pose.position) < 1e-9


def test_rates_that_are_renewed_are_no_gain_of_a_step():
    # a gripper jerks a rod at rest: the first steps lose energy, and their rates are renewed
    up = 0.1 * np.sin(3 * 2 * np.pi * DT * np.arange(8)) ** 2
    motion = DirectSimulator(soft(1e4), n_elements=24, basis='local').simulate(
        [tilted(-3 * z, (0.0, z)) for z in up], DT)
    assert motion.converged, motion.message
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert motion.numerical_loss.min() > -2e-3 * moved


def test_one_step_does_not_use_up_what_a_motion_may_gain():
    def energies(balance):
        return np.array([0.0, balance, *np.zeros(7)])

    budget = np.zeros(5)
    budget[2] = 1e3  # potential energy has been as high: 1 J may be gained
    left, balance = 1.0, 0.0
    for _ in range(8):
        kept = budget.copy()
        assert not within_energy_budget(budget, energies(balance + 0.6 * left), 1e-3, 0.0)
        np.testing.assert_array_equal(budget, kept)
        assert within_energy_budget(budget, energies(balance + 0.4 * left), 1e-3, 0.0)
        balance, left = balance + 0.4 * left, 0.6 * left
    # however little is left, a step that gains nothing is none that gains
    assert within_energy_budget(budget, energies(balance), 1e-3, 0.0)
    assert within_energy_budget(budget, energies(-5.0), 1e-3, 0.0)
    assert not within_energy_budget(budget, energies(-4.0), 1e-3, 0.0)


# ------------------------------------------------------------------------------------------------
# Only steps in which something lands are of first order.


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_steps_are_exact_while_the_dlo_goes_on_bearing(friction):
    floor = Plane((0, 0, 0.1), (0, 0, 1), friction)
    direct = DirectSimulator(rod(damping=(0.0, 5e-4)), n_elements=24, basis='local',
                             obstacles=[floor])

    def places(dt, tolerance=np.inf):
        ways = 0.05 * np.sin(np.pi * np.arange(0, 0.2 + 0.5 * dt, dt) / 0.2) ** 2
        poses = [Pose((-way, 0, 0.4), (0, 0, 0, 1)) for way in ways]
        motion = direct.simulate(poses, dt, direct.solve(poses[0]), tolerance=tolerance)
        assert motion.converged and all(shape.contacts for shape in motion.shapes)
        return np.array([shape.positions for shape in motion.shapes[::round(1e-2 / dt)]])

    fine = places(3.125e-4)

    def error(*how):
        return np.abs(places(*how) - fine).max()

    # with implicit Euler's steps alone they are 6e-3 and 8e-4
    assert error(1e-2) < 8e-4 and error(1.25e-3) < 3e-5
    assert error(1e-2, None) < 2e-4  # with steps as long as the tolerance, 1e-3, allows
    assert error(1e-2, 2e-4) < 5e-5


def fallen(thing, height, tolerance, instants, dt):
    """Return the Motion of a DLO of 24 elements that falls on a floor, straight at first."""
    mesh = {'n_elements': 24, 'basis': 'local'}
    straight = DirectSimulator(thing, gravity=(0, 0, 0), **mesh).solve(LEVEL)
    floor = Plane((0, 0, -height), (0, 0, 1), 0.4)
    motion = DirectSimulator(thing, obstacles=[floor], **mesh).simulate(
        [LEVEL] * instants, dt, straight, tolerance=tolerance)
    assert motion.converged, motion.message
    return motion


def test_a_landing_is_as_exact_as_the_tolerance_asks():
    usual, fine, true = (np.array([shape.positions for shape in fallen(
        CABLE, 0.2, tolerance, 31, 0.01).shapes]) for tolerance in (1e-3, 2e-4, 5e-5))
    errors = [np.linalg.norm(one - true, axis=2).max() for one in (usual, fine)]
    assert errors[1] < 3e-3 and errors[1] < 0.3 * errors[0]


def test_instants_that_are_near_to_each_other_need_no_shorter_steps_in_contact():
    soft = Rod(1.0, 0.035, 1.2e-3, 9e-4, radius=0.0025)
    few, many = (len(fallen(soft, 0.15, 1e-3, round(0.4 / dt) + 1, dt)._estimate.args[2].steps)
                 for dt in (1e-2, 2e-3))
    assert many < 2 * few


def lowered(thing, to, friction=0.3, seconds=0.75, turn=None, **options):
    """Return the Motion of a straight DLO that is lowered along itself to `to` of its length.

    It begins 0.1 of its length above the floor; all is turned by a Rotation.
    """
    turn = Rotation.identity() if turn is None else turn
    floor = Plane((0, 0, 0), turn.apply((0, 0, 1)), friction)
    direct = DirectSimulator(thing, obstacles=[floor], gravity=turn.apply((0, 0, -9.81)), **options)
    poses = [Pose.looking_along(turn.apply((0, 0, height * thing.length)), turn.apply((0, 0, -1)))
             for height in np.linspace(1.1, to, 16)]
    return direct.simulate(poses, seconds / 15)


SOFT = Rod.circular(1.0, 6e-3, density=1600, youngs_modulus=5e6, poisson_ratio=0.4, damping=0.02)


def test_a_column_that_lands_buckles_to_a_side_that_is_always_the_same():
    motion, again = lowered(SOFT, 0.7), lowered(SOFT, 0.7)
    assert motion.converged and motion.shapes[-1].contacts
    last = motion.shapes[-1].positions
    np.testing.assert_array_equal(last, again.shapes[-1].positions)
    assert np.linalg.norm(last[:, :2], axis=1).max() > 0.02 and last[:, 2].min() > 2.999e-3
    # it does not depend on how the cell is turned when it buckles, nor that it does
    turned = lowered(SOFT, 0.7, turn=Rotation.from_rotvec((0.7, 0.3, -0.4)))
    assert turned.converged
    # where it may go to any side, nothing foretells where it goes, and this is said
    assert np.isfinite(motion.error_estimate).all() and not motion.within_tolerance
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)


def test_a_column_that_lands_fast_buckles_in_waves_that_no_short_series_knows():
    copper = Rod.circular(1.0, 1.5e-3, density=8960, youngs_modulus=110e9, poisson_ratio=0.34)
    motion = lowered(copper, 0.95, seconds=0.075)
    assert motion.converged and motion.shapes[-1].contacts


STRIP = Rod.rectangular(0.4, 0.02, 0.0005, 7850, 2.0e11, 0.3)
COPPER_WIRE = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
COPPER = replace(COPPER_WIRE, damping=(0.0, 1e-3))
STEEL = Rod.circular(0.5, 1e-3, 7850, 2e11, 0.3)


@pytest.mark.parametrize(('thing', 'dt', 'gap', 'way', 'mesh'), [
    # on four edges at once, in a step that buckles by hundredths of a millimeter
    (STRIP, 7.75e-3, 0.0493, 0.09, {'n_elements': 48, 'basis': 'local'}),
    # it lands while rates are renewed: no such force acts along a step
    (COPPER, 5.065e-4, 5.15e-3, 0.0115, {}),
])
def test_columns_buckle_in_short_steps(thing, dt, gap, way, mesh):
    t = np.linspace(0, 1, 61)
    poses = [Pose.looking_along((0, 0, thing.length + gap - z), (0, 0, -1))
             for z in way * (t - np.sin(2 * np.pi * t) / (2 * np.pi))]
    motion = DirectSimulator(thing, obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.4)], **mesh).simulate(
        poses, dt)
    assert motion.converged, motion.message
    last = motion.shapes[-1]
    assert any(one.contacts for one in motion.shapes)
    assert np.linalg.norm(last.positions[:, :2], axis=1).max() > 1e-3
    # an impact takes about what the grip does against the force that buckles it; none makes energy
    assert motion.work.max() < 1.0
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)


# a bar; a sphere; 21, 28, 59: they bounce, and vibrate more quickly than steps follow
@pytest.mark.parametrize('seed', [18, 51, 21, 28, 59])
def test_random_columns_go_on(seed):
    motion = columns.at_random(1, seed).run(20)
    assert motion.status == 'complete', motion.message
    assert len(motion._estimate.args[2].steps) < 2000
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)


def test_what_lands_while_rates_are_renewed_is_no_force_of_the_grips():
    # its work would be some joules, of a wire of 16 g
    poses = [Pose.looking_along((0, 0, z), (0, 0, -1)) for z in 1.0 - 1e-3 * np.arange(4)]
    floor = Plane((0, 0, -1e-3 - COPPER.radius - 1e-5), (0, 0, 1))
    direct = DirectSimulator(COPPER, obstacles=[floor], n_elements=16, basis='local')
    shape = direct.solve(poses[0])
    stepper = Stepper(shape.mesh, BoundaryMotion(GripTrajectory(poses, 1e-3, False)), 1e-3)
    now = stepper.begin(shape, np.tile([0.0, 0.0, -1.0], (17, 1)))
    now = stepper.steps(now, (), np.array([1.0]), Scheme('generalized_alpha', 1e-3),
                        Acceptance()).last
    assert now.place == 1.0 and not len(now.row.contacts)
    renewed = stepper.resized(now, 5e-4)
    assert np.abs(renewed.row.wrenches).max() < 1.0
    assert np.abs(renewed.row.mean_wrenches).max() < 1.0


def pressed(tilt=0.0, dt=3.8e-4, way=0.021, gap=0.0, friction=0.0, thing='plane', height=0.0):
    """Return the motion of a steel wire, its tip `gap` above what it is pressed on, and its axis.

    m, s, rad; the rounding errors of the tip's place, and so the sign of a gap of 0, depend on the
    height.
    """
    axis, up = np.array([np.sin(tilt), 0.0, -np.cos(tilt)]), np.array([0, 0, height])
    tip = up + 0.5 * axis - (0, 0, gap + STEEL.radius)
    floor = (Plane(tip, (0, 0, 1), friction) if thing == 'plane'
             else Sphere(tip - (0, 0, 0.05), 0.05, friction=friction))
    t = np.linspace(0, 1, 31)
    poses = [Pose.looking_along(up - (0, 0, z), axis)
             for z in way * (t - np.sin(2 * np.pi * t) / (2 * np.pi))]
    return DirectSimulator(STEEL, obstacles=[floor]).simulate(poses, dt), axis


SLOWLY = {'dt': 1.5e-2, 'way': 0.05, 'friction': 0.4}


@pytest.mark.parametrize('scene', [
    SLOWLY,
    SLOWLY | {'height': 0.5, 'gap': 1e-12},
    SLOWLY | {'height': 0.5, 'gap': -5e-10},
    {},  # quickly
    {'gap': 1e-12},
    {'height': 0.5},
    {'gap': -5e-10},
    {'tilt': -1e-4, 'dt': 1.1e-4, 'way': 2.35e-3, 'gap': 5e-6, 'friction': 0.4},
    {'tilt': 1e-6, 'dt': 3.2e-4, 'way': 2.95e-3, 'thing': 'sphere'},
    # a first step that left it pressed in was pushed out in the next, with energy of its own
    {'tilt': 1e-3, 'dt': 2.5e-3, 'way': 0.031, 'friction': 0.4},
    {'tilt': -1e-5, 'dt': 4.4e-3, 'way': 0.031, 'friction': 0.4},
    {'tilt': -1e-3, 'dt': 1.6e-4, 'way': 2.2e-4, 'thing': 'sphere'},
    {'tilt': -1e-3, 'dt': 1.5e-3, 'way': 2.3e-3, 'friction': 0.4, 'thing': 'sphere'},
])
def test_columns_that_touch_at_the_start_buckle(scene):
    motion, axis = pressed(**scene)
    assert motion.converged, motion.message
    # half a wave of amplitude a takes (pi a)^2 / (4 length) of the way, shorter waves have less
    last = motion.shapes[-1].positions - motion.shapes[-1].positions[0]
    beside = np.linalg.norm(np.cross(last, axis), axis=1).max()
    way = scene.get('way', 0.021)
    most = 0.7 if motion.shapes[-1].contacts else 0.8  # inertia has drawn the tip off
    assert 0.1 * np.sqrt(way * STEEL.length) < beside < most * np.sqrt(way * STEEL.length)
    assert sum(bool(shape.contacts) for shape in motion.shapes) > 3
    # nothing is pressed in, to be pushed out by the next step
    assert max(shape.violation for shape in motion.shapes) < 1.1e-8 * STEEL.length
    moved = np.ptp(motion.potential_energy) + motion.kinetic_energy.max()
    assert motion.numerical_loss.min() > -1e-3 * moved
    assert motion.work.max() < 1.5 * moved  # by no force of springs that it is pressed in by


@pytest.mark.parametrize('scene', [SLOWLY, {}])
def test_what_is_straight_to_rounding_buckles_to_one_side(scene):
    ends = [pressed(tilt, **scene)[0].shapes[-1].positions for tilt in (0.0, -1e-16, 1e-16)]
    beside = np.linalg.norm(ends[0][:, :2], axis=1).max()
    for other in ends[1:]:
        assert np.abs(other - ends[0]).max() < 0.1 * beside


def led_together(thing, axis, gravity, grip='clamped', slack=0.0, instants=21, dt=0.02, way=0.02,
                 twist=0.0):
    """Return the motion in which each end of a straight DLO goes a `way`, times its length.

    Meanwhile the far end turns about the axis, by `twist`, rad.
    """
    axis, t = np.array(axis), np.linspace(0, 1, instants)
    part = t - np.sin(2 * np.pi * t) / (2 * np.pi)
    ways, here = way * thing.length * part, Pose.looking_along((0, 0, 0), axis)
    ends = [FarEnd(Pose.from_rotation(
        axis * (thing.length * (1 - slack) - way),
        Rotation.from_rotvec(axis * turn).as_matrix() @ here.rotation), grip)
            for way, turn in zip(ways, twist * part, strict=True)]
    return DirectSimulator(thing, gravity=gravity).simulate(
        [Pose.looking_along(axis * way, axis) for way in ways], dt, far_ends=ends)


@pytest.mark.every(5)
@pytest.mark.parametrize('grip', ['clamped', 'pinned'])
@pytest.mark.parametrize('gravity', [(0, 0, -9.81), (-9.81, 0, 0), (0, 0, 0)])
@pytest.mark.parametrize(('slack', 'dt'), [(0.0, 0.02), (1e-5, 1e-3), (1e-3, 1e-3)])
def test_what_is_straight_buckles_between_grips_that_are_led_together(grip, gravity, slack, dt):
    motion = led_together(COPPER_WIRE, (1, 0, 0), gravity, grip, slack, dt=dt)
    assert motion.converged, motion.message
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)
    assert np.isfinite(motion.error_estimate).all()
    last = motion.shapes[-1].positions
    away = np.linalg.norm(last[:, 1:], axis=1).max()
    assert away > 0.02
    np.testing.assert_allclose(motion.shapes[-1].far_end.pose.position, last[-1], atol=1e-9)
    if gravity[2]:
        assert last[:, 2].min() < -0.99 * away  # gravity chooses the side
    again = led_together(COPPER_WIRE, (1, 0, 0), gravity, grip, slack, dt=dt)
    np.testing.assert_array_equal(again.shapes[-1].positions, last)


def test_a_motion_from_full_length_is_compared_with_one_that_makes_no_energy():
    hose = Rod.circular(1.0, 0.012, 1100, 5e6, 0.45)
    motion = led_together(hose, (1, 0, 0), (0, 0, -9.81), instants=81)
    assert motion.converged, motion.message
    assert 1e-6 < motion.error_estimate[-1] < 1e-3


def test_new_rates_between_two_grips_are_their_work_and_make_no_energy():
    ends = [FarEnd(Pose.looking_along((0.9 - 1e-3 * k, 0, 0), (1, 0, 0))) for k in range(4)]
    poses = [Pose.looking_along((0, 0, 0), (1, 0, 0))] * 4
    direct = DirectSimulator(COPPER_WIRE, n_elements=16, basis='local')
    shape = direct.solve(poses[0], far_end=ends[1])
    grips = moving_grips(poses, [(one,) for one in ends], 1e-2, False, None)
    stepper = Stepper(shape.mesh, grips, 1e-2)
    now = stepper.begin(shape)
    wrong = now.row.nodes.copy()
    # the length does not allow it; so slow waves that elasticity changes them by little in the time
    wrong[1] += np.outer(np.sin(np.pi * shape.s), (0.1, 0.02, 0.05))
    row = now.row._replace(nodes=wrong, energies=now.row.energies.copy())
    row.energies[KINETIC] = 0.5 * (stepper.masses @ np.sum(wrong[1]**2, axis=1))
    now = replace(now, row=row, place=1.0)
    fresh = stepper.renewed(now, 1e-3)
    impulse = stepper.masses[:, None] * (fresh.velocities - wrong[1])
    # what keeps the length does no work along any motion that the grips allow, as that of shapes at
    # rest: its work is that of the grips
    ahead, back = (direct.solve(poses[0], shape, far_end=grips.at(1 + part)[1][0])
                   for part in (1e-3, -1e-3))
    at_rest = (ahead.positions - back.positions) / 2e-5
    np.testing.assert_allclose(at_rest[-1], (-0.1, 0, 0), atol=1e-6)
    work = fresh.row.energies[WORK] - now.row.energies[WORK]
    assert work == pytest.approx(np.sum(impulse * at_rest), rel=0.03)
    assert np.sum(impulse * at_rest) != pytest.approx(np.sum(impulse * wrong[1]), rel=0.1)
    # the rest of what they change is lost: it is the kinetic energy of the difference
    lost = 0.5 * (stepper.masses @ np.sum((fresh.velocities - wrong[1])**2, axis=1))
    assert now.balance - fresh.balance == pytest.approx(lost, rel=0.03)


def test_a_strip_that_tilts_on_its_edge_makes_no_energy():
    strip = Rod.rectangular(0.5, 1e-2, 1e-3, density=7800, youngs_modulus=2e11, poisson_ratio=0.3)
    motion = lowered(strip, 0.8, seconds=0.8)
    assert motion.converged, motion.message
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)


def test_what_lies_still_is_followed_by_steps_of_any_length():
    thing = Rod.circular(0.5, 3e-3, density=1200, youngs_modulus=1e6, poisson_ratio=0.45)
    direct = DirectSimulator(thing, obstacles=[Plane((0, 0, 0), (0, 0, 1))])
    here = Pose((0, 0, 0.2), (0, 0, 0, 1))
    start = direct.solve(here)
    for dt in (1e-4, 1e-5):
        motion = direct.simulate([here] * 4, dt, start)
        assert motion.converged and len(motion.shapes[-1].contacts) > 10
        assert np.abs(motion.shapes[-1].positions - motion.shapes[0].positions).max() < 1e-5


def test_a_motion_that_leads_grips_out_of_reach_says_so():
    direct, here = DirectSimulator(SOFT), Pose((0, 0, 0), (0, 0, 0, 1))
    ends = [FarEnd(Pose((0.7 + 0.1 * k, 0, 0), (0, 0, 0, 1))) for k in range(6)]
    motion = direct.simulate([here] * 6, 0.2, direct.solve(here, far_end=ends[0]), far_ends=ends)
    assert motion.status == 'blocked'
    assert motion.message.startswith('out of reach: at 0.6 s the far end is held')
    assert np.isfinite(motion.numerical_loss[:-1]).all() and np.isnan(motion.numerical_loss[-1])


def test_a_motion_from_full_length_may_begin_slowly():
    motion = led_together(COPPER_WIRE, (1, 0, 0), (0, 0, -9.81), instants=401, dt=1e-3)
    assert motion.converged, motion.message  # by 0.06 nm in the first quarter of an instant
    assert motion.numerical_loss.min() > -1e-3 * np.ptp(motion.potential_energy)
    first = motion.shapes[0]  # straight under its weight: by forces that are not known
    assert np.isnan(first.gripper_wrench).all() and np.isnan(first.wrenches).all()
    assert np.isfinite(motion.shapes[1].gripper_wrench).all()


@pytest.mark.parametrize('dt', [0.02, 0.1])
def test_grips_that_stay_at_full_length_are_out_of_reach(dt):
    ends = [FarEnd(Pose.looking_along((1, 0, 0), (1, 0, 0)))] * 6
    motion = DirectSimulator(COPPER_WIRE).simulate([LEVEL] * 6, dt, far_ends=ends, deadline=5)
    assert motion.status == 'blocked' and len(motion) == 1
    assert motion.message.startswith('out of reach: from the beginning on the far end is held 1 m')
    still = DirectSimulator(COPPER_WIRE, gravity=(0, 0, 0)).simulate([LEVEL] * 6, dt, far_ends=ends)
    assert still.converged


def test_grips_that_come_to_full_length_are_followed_until_then():
    ends = [FarEnd(Pose.looking_along((x, 0, 0), (1, 0, 0))) for x in (0.99, 0.999, 1, 1, 1, 1, 1)]
    motion = DirectSimulator(COPPER_WIRE).simulate([LEVEL] * 7, 0.02, far_ends=ends)
    assert motion.status == 'blocked' and motion.times[-1] > 0.02
    assert motion.message.startswith('out of reach: at 0.0')


@pytest.mark.every(3)
@pytest.mark.parametrize('grip', ['clamped', 'pinned'])
@pytest.mark.parametrize(('dt', 'twist'), [(1e-3, 0.0), (5e-3, 0.0), (0.05, 0.0), (0.05, 1e-3)])
def test_where_nothing_tells_how_it_buckles_the_estimate_is_how_far_it_may_be(grip, dt, twist):
    # in waves that depend on the steps
    motion = led_together(COPPER_WIRE, (1, 0, 0), (0, 0, 0), grip, way=1e-3, dt=dt, twist=twist)
    assert motion.converged, motion.message
    assert motion.error_estimate[0] < 1e-9
    assert motion.error_estimate[-1] >= np.sqrt(1 - 0.998**2) * (1 - 1e-9)
    bent = replace(COPPER_WIRE, natural_curvature=(0.0, 0.05))
    known = led_together(bent, (1, 0, 0), (0, 0, 0), grip, 1e-3, way=1e-3, dt=0.05)
    assert known.error_estimate[-1] < 0.03


def test_a_dlo_that_has_bounced_moves_freely_again():
    thing, options = rod(damping=(0.0, 5e-4)), {'n_elements': 24, 'basis': 'local'}
    ways = 0.1 * np.sin(np.pi * np.arange(0, 0.7, 1e-2)) ** 2
    poses = [Pose((way, 0, 1 - way), (0, 0, 0, 1)) for way in ways]
    low = DirectSimulator(thing, **options).solve(poses[0]).positions[:, 2].min()
    floor = Plane((0, 0, low - 0.05), (0, 0, 1))
    direct = DirectSimulator(thing, obstacles=[floor], **options)
    motion, fine = (direct.simulate(poses, 1e-2, direct.solve(poses[0]), tolerance=tolerance)
                    for tolerance in (None, 1e-5))
    touched = [bool(shape.contacts) for shape in motion.shapes]
    assert any(touched) and not any(touched[-15:])
    ours, true = (np.array([shape.positions for shape in one.shapes]) for one in (motion, fine))
    assert np.abs(ours - true).max() < 1e-3


def test_what_lands_between_two_nodes_is_noticed_at_once():
    sphere = Sphere((0.4, 0, 0.28), 0.1)
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, damping=(0.0, 5e-4))
    direct = DirectSimulator(wire, n_elements=24, basis='local', obstacles=[sphere])
    poses = [Pose((0.05 * np.sin(np.pi * time / 0.2) ** 2, 0, 0.4), (0, 0, 0, 1))
             for time in np.arange(0, 0.2, 2.5e-3)]
    motion = direct.simulate(poses, 2.5e-3, direct.solve(poses[0]), tolerance=np.inf)
    assert motion.converged, motion.message
    places = [shape.positions_at(np.linspace(0, 1, 97)) for shape in motion.shapes]
    away = np.linalg.norm(np.array(places) - sphere.center, axis=2)
    assert away.min() > sphere.radius


# ------------------------------------------------------------------------------------------------
# Slow motions along obstacles go on, and end where statics say.


# 26, 77, 148: one of the last elements gets flat; 98: the DLO slips along a bar
@pytest.mark.every(2)
@pytest.mark.parametrize('seed', [77, 98, 148, 26])
def test_a_slow_motion_along_obstacles_ends_at_rest(seed):
    simulator, way, dt = random_slide(seed)
    motion = simulator.simulate([*way, *way[-1:] * 3], dt)  # it swings where it has slipped off
    assert motion.status == 'complete', motion.message
    assert any(shape.contacts for shape in motion.shapes)
    rest = simulator.solve(way[-1], motion.shapes[-1])
    assert rest.converged
    np.testing.assert_allclose(motion.shapes[-1].positions, rest.positions, atol=2e-4)
    deepest = max(contact.penetration for shape in motion.shapes for contact in shape.contacts)
    assert deepest < 1e-7
    assert_no_gain(motion)


def assert_no_gain(motion):
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    assert motion.numerical_loss.min() > -1e-3 * moved


@pytest.mark.parametrize('seed', [51, 39])  # off a bar; off a ball onto a floor
def test_a_dlo_slips_off_an_obstacle_without_a_gain_of_energy(seed):
    simulator, way, dt = random_slide(seed)
    motion = simulator.simulate([*way, *way[-1:] * 3], dt)  # it swings where it has slipped off
    assert motion.status == 'complete', motion.message
    assert_no_gain(motion)


@pytest.mark.every(3)
@pytest.mark.parametrize('seed', [43, 49])  # refused in the shortest step: as unsolved; for energy
def test_where_the_shortest_step_is_refused_a_longer_one_goes_on(seed):
    simulator, way, dt = random_slide(seed)
    motion = simulator.simulate([*way, *way[-1:] * 3], dt)  # it swings where it has slipped off
    assert motion.status == 'complete', motion.message
    assert_no_gain(motion)
    for shape in motion.shapes:
        assert shape.converged
        for contact in shape.contacts:
            assert contact.penetration < 1e-7
            limit = simulator.surroundings.obstacles[contact.obstacle].friction * contact.force
            assert np.linalg.norm(contact.friction) <= limit * (1 + 1e-6) + 1e-12


def test_a_point_rolls_to_where_the_rest_of_the_dlo_lies():
    rod = Rod(1.0, 0.1, 0.02, 0.015, radius=0.005, damping=1e-3)
    simulator = DirectSimulator(rod, obstacles=[Plane((0, 0, -0.2), (0, 0, 1))])
    motion = simulator.simulate([LEVEL, Pose((0, 0, 0.3), (0, 0, 0, 1)), LEVEL], 100.0)
    assert motion.status == 'complete', motion.message
    rest = simulator.solve(LEVEL, motion.shapes[-1])
    np.testing.assert_allclose(motion.shapes[-1].positions, rest.positions, atol=1e-4)


# ------------------------------------------------------------------------------------------------
# Error estimates of motions are the errors, and steps that change length add none of their own.


def lash(damping=0.0, seconds=0.6):
    """Return a soft wire, the poses of a gripper that turns it over, and their dt."""
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, damping=damping)
    times = np.arange(0, seconds + 0.005, 0.01)
    return wire, [tilted(np.pi / 2 * (1 - np.cos(np.pi * t))) for t in times], 0.01


def steps_of(wire, grippers, dt, elements, halvings, change=None):
    """Return the last positions of even steps; at the instant `change` they are renewed."""
    simulator = DirectSimulator(wire, basis='local', n_elements=elements)
    grips = BoundaryMotion(GripTrajectory(grippers, dt))
    stepper = Stepper(simulator.solve(grippers[0]).mesh, grips, dt)
    now = stepper.begin(simulator.solve(grippers[0]))
    scheme, parts = Scheme('generalized_alpha', dt / 2**halvings), 2**halvings
    for k in range(len(grippers) - 1):
        if k == change:
            now = stepper.renewed(now, scheme.dt)
        batch = stepper.steps(now, (), k + np.arange(1, parts + 1) / parts, scheme, Acceptance())
        assert batch.refused is None
        now = batch.last
    return now.positions


def true_end(wire, grippers, dt):
    """Return where the nodes of 32 elements end, from ever finer meshes and steps."""
    coarse, fine, long, short = (
        steps_of(wire, grippers, dt, *how)[::how[0] // 32]
        for how in ((128, 4), (256, 4), (64, 4), (64, 5)))
    return fine + (fine - coarse) / 3 + 4 / 3 * (short - long)


@pytest.mark.every(4)
@pytest.mark.parametrize('damping', [0.0, 2e-3])
@pytest.mark.parametrize('begins', ['at rest', 'with its shape'])
def test_the_estimate_is_the_error(damping, begins):
    wire, grippers, dt = lash(damping)
    simulator = DirectSimulator(wire)
    initial = None if begins == 'at rest' else simulator.solve(grippers[0])
    motion = simulator.simulate(grippers, dt, initial)
    end = motion.shapes[-1].positions
    off = np.linalg.norm(end[::(len(end) - 1) // 32] - true_end(wire, grippers, dt), axis=1).max()
    assert off > 5e-5
    assert 0.97 * off < motion.error_estimate[-1] < 2 * off


def test_a_given_rest_is_a_rest_for_the_estimate():
    # not one of this simulator's: the straight wire of a place without gravity
    wire = rod(damping=(0.3, 2e-3))
    grippers = [tilted(0.3 * np.sin(0.1 * k)) for k in range(20)]
    bent = rod(natural_curvature=(0.0, 0.8))
    for thing, away in ((wire, {'gravity': (0, 0, 0)}), (bent, {'gravity': (0, 0, -2.0)})):
        known = DirectSimulator(thing, n_elements=16, basis='local', **away).solve(grippers[0])
        motion = DirectSimulator(thing, n_elements=16, basis='local').simulate(grippers, 0.01,
                                                                               known)
        finer = DirectSimulator(thing, n_elements=32, basis='local', **away).solve(grippers[0])
        moved = np.linalg.norm(finer.positions[::2] - known.positions, axis=1).max()
        assert motion.error_estimate[0] == pytest.approx(4 / 3 * moved, rel=1e-6, abs=1e-12)


def test_the_estimate_looks_between_the_instants():
    # turned and back again: most of what is wrong is not where the gripper's poses are given
    motion = DirectSimulator(rod(), n_elements=16, basis='local').simulate(
        [tilted(0.4 * k) for k in (0, 1, 0, 1, 0)], 0.25)
    func, (*known, samples) = motion._estimate.func, motion._estimate.args
    assert len(samples) > len(motion)
    at_instants = func(*known, None)
    assert (at_instants <= motion.error_estimate).all()
    assert at_instants[-1] < motion.error_estimate[-1]


@pytest.mark.every(3)
@pytest.mark.parametrize('options', [{}, {'basis': 'local', 'n_elements': 24}])
@pytest.mark.parametrize('integrator', ['generalized_alpha', 'paper'])
def test_many_steps_at_once_are_the_same_as_one_by_one(options, integrator, monkeypatch):
    wire = rod(damping=(0.4, 2e-3), natural_curvature=(0.3, 0.2), tip_mass=0.02)
    grippers = [Pose((0.1 * x, 0, 0), Rotation.from_rotvec(x * np.array([0.3, 1, 0.5])).as_quat())
                for x in np.sin(0.2 * np.arange(25)) ** 2]

    def moved():
        return DirectSimulator(wire, **options).simulate(grippers, 0.01, integrator=integrator)
    many = moved()
    monkeypatch.setattr(dynamics, 'MOST', 1)
    single = moved()
    for name in ('kinetic_energy', 'potential_energy', 'work', 'losses', 'velocities'):
        np.testing.assert_allclose(getattr(many, name), getattr(single, name), rtol=0, atol=1e-12)
    for one, other in zip(many.shapes, single.shapes, strict=True):
        np.testing.assert_allclose(one.positions, other.positions, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(one.gripper.rotation, other.gripper.rotation)
        assert one.converged and one.iterations == other.iterations


# ------------------------------------------------------------------------------------------------
# Work and damping are those of the scheme, however abruptly a grip starts.


@pytest.mark.parametrize('damping', [0.01, 0.2])
@pytest.mark.parametrize('obstacles', [(), (Plane((0, 0, 0), (0, 0, 1)),)])
def test_a_grip_that_starts_abruptly_makes_no_energy(obstacles, damping):
    thing = Rod(1.0, 0.05, 0.02, 0.02, radius=0.006, damping=damping)
    simulator = DirectSimulator(thing, n_elements=20, basis='local', obstacles=obstacles)
    down = Rotation.from_euler('y', 0.4).as_quat()
    for speed, dt, way in ((0.002, 0.0125, (1, 0, 0)), (0.002, 0.05, (0, 1, 0)),
                           (0.2, 0.05, (0, 1, 0))):
        places = np.array([0, 0, 0.12]) + speed * dt * np.outer(np.arange(10), way)
        motion = simulator.simulate([Pose(place, down) for place in places], dt)
        assert motion.converged, motion.message
        moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
        assert motion.numerical_loss.min() > -5e-3 * moved
        assert motion.numerical_loss.max() < 0.03 * moved


def test_what_moves_on_many_points_finds_their_forces_at_once():
    # a soft cable that comes to lie on 20 points: 185 Newton steps in all; 635 where the strength
    # of inertia counts as a force, 368 one point after another, 270 with depths as small as at rest
    rod = Rod(1.0, 0.035, 1.2e-3, 0.9e-3, radius=2.25e-3)
    here, friction = Pose((0, 0, 0.01), (0, 0, 0, 1)), 0.4
    level = DirectSimulator(rod, basis='local', n_elements=24, gravity=(0, 0, 0)).solve(here)
    direct = DirectSimulator(rod, basis='local', n_elements=24,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), friction)])
    motion = direct.simulate([here] * 61, 2e-3, initial=level, tolerance=np.inf)
    lying = [shape for shape in motion.shapes if len(shape.contacts) >= 4]
    assert motion.converged and len(lying) > 30
    assert sum(shape.iterations for shape in lying) < 230
    assert max(shape.violation for shape in lying) < 1e-6
    for shape in lying:
        for contact in shape.contacts:
            assert np.linalg.norm(contact.friction) <= friction * contact.force * (1 + 1e-9)


def test_a_motion_that_ended_nearly_at_rest_goes_on_where_the_gripper_stands_still():
    # the way of a gripper between instants leaves it a thousandth of its speed at the end
    direct = DirectSimulator(Rod.circular(0.1, 3e-3, 1200, 1e9, 0.4, damping=(0.0, 1e-3)),
                             n_elements=16)
    share = np.linspace(0.0, 1.0, 31)
    way = [Pose((0.1 * (u - np.sin(2 * np.pi * u) / (2 * np.pi)), 0, 1), LEVEL.quaternion)
           for u in share]
    moved = direct.simulate(way, 0.02)
    hand = np.abs(moved.velocities[-1, 0]).max()
    assert 0 < hand < 0.01 * np.abs(moved.velocities[:, 0]).max()
    stands = direct.simulate(way[-1:] * 6, 0.02, moved)
    assert stands.status == 'complete'
    half = direct.simulate(way[:16], 0.02)
    with pytest.raises(InvalidTask, match='velocity'):
        direct.simulate(way[15:16] * 6, 0.02, half)


def test_a_motion_that_rubs_on_a_floor_is_continued_by_its_own():
    """On its own mesh: on that of the DLO at rest there a part would be pressed into the floor."""
    thing = Rod.circular(1.0, 6e-3, density=1600, youngs_modulus=5e6, poisson_ratio=0.4,
                         damping=0.02)
    direct = DirectSimulator(thing, obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    share = np.linspace(0, 1, 16)
    way = [Pose((0, 0, z), LEVEL.quaternion)
           for z in 0.4 - 0.15 * share**3 * (10 - 15 * share + 6 * share**2)]
    whole = direct.simulate([*way, *way[-1:] * 6], 0.02)
    first = direct.simulate(way, 0.02)
    assert len(first.shapes[-1].contacts) > 4
    rest = direct.simulate(way[-1:] * 7, 0.02, first)
    assert rest.status == 'complete'
    np.testing.assert_array_equal(rest.shapes[0].s, first.shapes[-1].s)
    np.testing.assert_allclose(rest.shapes[0].gripper_wrench, first.shapes[-1].gripper_wrench)
    moved = whole.shapes[-1].positions - first.shapes[-1].positions
    assert np.linalg.norm(moved, axis=1).max() > 0.01
    np.testing.assert_allclose(rest.shapes[-1].positions, whole.shapes[-1].positions, atol=2e-4)
