# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, DeadlineExceeded, DirectSimulator, Plane, Pose, Rod
from dlo_planner.progress import interrupted_by

LEVEL = Pose.identity()
MASS, STIFFNESS = 0.1, 1.0
WEIGHTLESS = (0.0, 0.0, 0.0)
ROOTS = (1.8751, 4.6941, 7.8548)  # beta L of a cantilever


def beam(**more):
    return Rod(1.0, MASS, STIFFNESS, 0.75, **more)


def angular_frequency(root):
    return root**2 * np.sqrt(STIFFNESS / MASS)


def bent_as_mode(simulator, root, tip=1e-4):
    """Return a Shape whose curvature about n is that of the cantilever's mode, tip drop `tip`."""
    shape = simulator.solve(LEVEL)
    s = 0.5 * (shape.s[1:] + shape.s[:-1])
    ratio = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))
    curvature = (np.cosh(root * s) + np.cos(root * s)
                 - ratio * (np.sinh(root * s) + np.sin(root * s)))
    strains = np.zeros((s.size, 3))
    strains[:, 1] = tip * root**2 / 2 * curvature  # the mode's tip is at 2
    return replace(shape, element_strains=strains)


def period(times, values):
    """Return the mean time between upward zero crossings."""
    k = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    crossings = times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k])
    return np.diff(crossings).mean()


def tip_height(motion):
    return np.array([shape.positions[-1, 2] for shape in motion.shapes])


def swing(steps, integrator='generalized_alpha', rod=None, seconds=0.6, tolerance=None, **options):
    """Return a smooth turn of the gripper by 60 degrees about a slanted axis, then rest."""
    rod = rod or Rod(1.0, 0.3, (1.0, 2.0), 0.7, natural_curvature=(0.5, 0.3))
    time = np.minimum(np.linspace(0, 1, steps + 1) / 0.7, 1.0)
    angle = np.pi / 3 * time**3 * (10 - 15 * time + 6 * time**2)  # no jumps of acceleration
    axis = np.array([0.2, 1.0, 0.4])
    grippers = [Pose((0.2 * a, 0, 0), Rotation.from_rotvec(a * axis).as_quat()) for a in angle]
    return DirectSimulator(rod, **options).simulate(grippers, seconds / steps,
                                                    integrator=integrator, tolerance=tolerance)


@pytest.mark.every(9)
@pytest.mark.parametrize('integrator', ['paper', 'generalized_alpha'])
@pytest.mark.parametrize(('method', 'mesh'), [
    ('dfp', {'n_elements': 24, 'n_terms': 5}), ('dfp', {'basis': 'local', 'n_elements': 16}),
    ('downhill_simplex', {'n_elements': 12, 'n_terms': 2})])
@pytest.mark.parametrize('more', [
    {}, {'damping': (0.5, 0.01)},
    {'yield_curvature': 0.5, 'yield_torsion': 0.4, 'hardening': 0.05}])
def test_motions_by_the_papers_methods(method, mesh, integrator, more):
    rod = Rod(1.0, 0.3, (1.0, 2.0), 0.7, natural_curvature=(0.5, 0.3), **more)
    one, other = (swing(12, integrator, rod, tolerance=np.inf, method=name, **mesh)
                  for name in (method, 'newton'))
    assert one.converged and other.converged
    for shape, wanted in zip(one.shapes, other.shapes, strict=True):
        assert shape.residual < 1e-8 and shape.evaluations > 0 == wanted.evaluations
        np.testing.assert_allclose(shape.positions, wanted.positions, atol=1e-7)
    np.testing.assert_allclose(one.velocities, other.velocities, atol=1e-5)
    np.testing.assert_allclose(one.losses, other.losses, rtol=1e-4, atol=1e-7)
    if 'hardening' in more:
        assert one.losses[-1, 1] > 1e-3 * np.ptp(one.potential_energy)
    assert one.error_estimate[-1] == pytest.approx(other.error_estimate[-1], rel=1e-3)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('root', ROOTS)
def test_cantilever_frequencies(root, basis):
    simulator = DirectSimulator(beam(), gravity=WEIGHTLESS, basis=basis, n_elements=96)
    expected = 2 * np.pi / angular_frequency(root)
    motion = simulator.simulate([LEVEL] * 601, expected / 100, bent_as_mode(simulator, root))
    assert motion.converged
    assert period(motion.times, tip_height(motion)) == pytest.approx(expected, rel=5e-3)


def test_energy_of_a_free_vibration_is_kept():
    simulator = DirectSimulator(beam(), gravity=WEIGHTLESS)
    expected = 2 * np.pi / angular_frequency(ROOTS[0])
    motion = simulator.simulate([LEVEL] * 521, expected / 52,  # one of them at full speed
                                bent_as_mode(simulator, ROOTS[0], 0.1))
    assert np.abs(motion.energy / motion.energy[0] - 1).max() < 1e-3
    np.testing.assert_array_equal(motion.work, 0)
    np.testing.assert_array_equal(motion.losses, 0)
    # it does move: the energy changes its kind, fully
    assert motion.kinetic_energy.max() == pytest.approx(motion.energy[0], rel=2e-3)


def test_papers_integrator_damps_as_documented():
    simulator = DirectSimulator(beam(), gravity=WEIGHTLESS)
    omega = angular_frequency(ROOTS[0])
    dt = 2 * np.pi / omega / 200
    motion = simulator.simulate([LEVEL] * 401, dt, bent_as_mode(simulator, ROOTS[0]),
                                integrator='paper')
    radians = omega * motion.times[-1]
    # amplitude falls by exp(-w dt / 4) a radian, energy by its square
    assert motion.energy[-1] / motion.energy[0] == pytest.approx(
        np.exp(-omega * dt / 2 * radians), rel=0.02)


@pytest.mark.every(2)
@pytest.mark.parametrize(('integrator', 'order'), [('generalized_alpha', 2.0), ('paper', 1.0)])
def test_order_of_convergence(integrator, order):
    ends = [swing(steps, integrator, tolerance=np.inf).shapes[-1].positions
            for steps in (100, 200, 400, 800, 1600)]
    changes = [np.abs(b - a).max() for a, b in zip(ends, ends[1:], strict=False)]
    assert np.log2(changes[0] / changes[-1]) / 3 == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_force_of_the_gripper_is_the_change_of_momentum(basis):
    motion = swing(400, basis=basis, seconds=1.0)
    shapes = motion.shapes
    masses = np.full(65, 0.3 / 64)
    masses[[0, -1]] /= 2
    momentum = np.einsum('k,nki->ni', masses, motion.velocities)
    dt = motion.times[1]
    rate = (momentum[2:] - momentum[:-2]) / (2 * dt)
    force = np.array([shape.gripper_wrench[:3] for shape in shapes[1:-1]])
    weight = 9.81 * 0.3 * np.array([0, 0, 1])
    np.testing.assert_allclose(force[40:], (weight + rate)[40:], atol=0.02)  # 3 N and more
    # and of angular momentum, about the gripper where it rests
    still = slice(300, 399)
    levers = np.array([shape.positions - shape.gripper.position for shape in shapes])
    spin = np.einsum('k,nki->ni', masses, np.cross(levers, motion.velocities))
    turn = ((spin[2:] - spin[:-2]) / (2 * dt))[still]
    gravity = np.cross(levers, [0, 0, 9.81])[1:-1][still]
    moment = np.array([shape.gripper_wrench[3:] for shape in shapes[1:-1]])[still]
    np.testing.assert_allclose(moment, turn + np.einsum('k,nki->ni', masses, gravity), atol=0.02)


def test_in_a_falling_cell_nothing_bends():
    dt = 0.01
    simulator = DirectSimulator(beam())
    straight = DirectSimulator(beam(), gravity=WEIGHTLESS).solve(LEVEL)
    grippers = [Pose((0, 0, -9.81 / 2 * (dt * k) ** 2), (0, 0, 0, 1)) for k in range(40)]
    motion = simulator.simulate(grippers, dt, straight)
    for shape in motion.shapes:
        drop = shape.positions[:, 2] - shape.gripper.position[2]
        assert np.abs(drop).max() < 2e-3  # the start is a jerk, and no more
    held = simulator.simulate([LEVEL] * 40, dt, straight)
    assert held.shapes[-1].positions[:, 2].min() < -0.05


def test_mass_on_a_thread_is_a_pendulum():
    thread = Rod(1.0, 0.0, 1e-3, 1e-3, tip_mass=1.0)
    down = Pose.looking_along((0, 0, 0), (0, 0, -1))
    tilted = DirectSimulator(thread, gravity=(0.05, 0, -9.81), basis='local').solve(down)
    simulator = DirectSimulator(thread, basis='local')
    motion = simulator.simulate([down] * 600, 0.01, tilted)
    sideways = np.array([shape.positions[-1, 0] for shape in motion.shapes])
    clamped = np.sqrt(1e-3 / 9.81)  # the thread turns about a point this far from the clamp
    expected = 2 * np.pi * np.sqrt((1 - clamped) / 9.81)
    assert period(motion.times, sideways) == pytest.approx(expected, rel=3e-3)


def test_slow_motion_is_quasi_static():
    slow = swing(300, seconds=300.0)
    simulator = DirectSimulator(Rod(1.0, 0.3, (1.0, 2.0), 0.7, natural_curvature=(0.5, 0.3)))
    static = simulator.track([shape.gripper for shape in slow.shapes])
    for moving, still in zip(slow.shapes[::20], static[::20], strict=True):
        np.testing.assert_allclose(moving.positions, still.positions, atol=1e-4)


@pytest.mark.parametrize(('damping', 'ratio'), [
    ((0.0, 2e-3), lambda omega: 2e-3 * omega / 2), ((0.5, 0.0), lambda omega: 0.5 / omega / 2)])
def test_damping_ratio(damping, ratio):
    simulator = DirectSimulator(beam(damping=damping), gravity=WEIGHTLESS, basis='local')
    omega = angular_frequency(ROOTS[0])
    motion = simulator.simulate([LEVEL] * 501, 2 * np.pi / omega / 100,
                                bent_as_mode(simulator, ROOTS[0]))
    decay = np.log(motion.energy[0] / motion.energy[-1]) / 2 / (omega * motion.times[-1])
    assert decay == pytest.approx(ratio(omega), rel=0.02)


def test_damped_motion_ends_in_the_static_shape():
    rod = Rod(1.0, 0.3, (1.0, 2.0), 0.7, natural_curvature=(0.5, 0.3), damping=(4.0, 0.01))
    simulator = DirectSimulator(rod)
    straight = DirectSimulator(rod, gravity=WEIGHTLESS).solve(LEVEL)
    motion = simulator.simulate([LEVEL] * 400, 0.02, straight)
    np.testing.assert_allclose(motion.shapes[-1].positions, simulator.solve(LEVEL).positions,
                               atol=1e-6)
    assert (np.diff(motion.energy) < 1e-9).all()


def test_arrays_and_progress():
    told = []
    motion = DirectSimulator(beam(), n_elements=10).simulate(
        [LEVEL] * 4, 0.01, progress=lambda done, total: told.append((done, total)))
    assert motion.times.tolist() == pytest.approx([0, 0.01, 0.02, 0.03])
    assert motion.velocities.shape == (4, 11, 3)
    assert motion.energy.shape == (4,)
    assert told == [(2, 4), (3, 4), (4, 4)]
    assert motion.shapes[2].error_estimate == np.inf


def test_a_deadline_is_looked_at_within_one_pose():
    simulator = DirectSimulator(Rod(1.0, 0.1, 1.0, 0.7), n_elements=8, n_terms=4)
    looks = []
    with interrupted_by(lambda: looks.append(None)):
        simulator.track([Pose((0, 0, 0), (1, 0, 0, 0.1))], initial=simulator.solve(LEVEL))
    assert len(looks) > 10  # of two, at the beginning and at the end


def test_a_deadline_ends_a_motion():
    simulator = DirectSimulator(beam(), n_elements=10)
    for run in (lambda: simulator.track([LEVEL] * 50, deadline=1e-6),
                lambda: simulator.simulate([LEVEL] * 50, 0.01, deadline=1e-6)):
        with pytest.raises(DeadlineExceeded) as late:
            run()
        assert late.value.elapsed > late.value.seconds == 1e-6


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_damping_is_the_same_for_a_dlo_that_could_yield(basis):
    # far from its limits it is the elastic one: bent and twisted by nature, damped by its strain
    rod = Rod(1.0, 0.3, (1.0, 2.0), 0.7, natural_curvature=(0.9, -0.6), natural_twist=1.5,
              damping=(0.3, 0.02))
    firm = replace(rod, yield_curvature=1e3, yield_torsion=1e3, section_model='round')
    # in the same steps: rounding errors may decide where one is halved
    one, two = (swing(40, rod=each, basis=basis, n_elements=16, tolerance=np.inf)
                for each in (rod, firm))
    for elastic, plastic in zip(one.shapes, two.shapes, strict=True):
        # a change of step begins with accelerations from a very short one, which magnify rounding
        np.testing.assert_allclose(plastic.positions, elastic.positions, atol=1e-6)
    np.testing.assert_allclose(two.energy, one.energy, atol=1e-6)
    assert two.shapes[-1].dissipated == 0
    # and damping counts: it is another motion without
    free = swing(40, rod=replace(rod, damping=0.0), basis=basis, n_elements=16, tolerance=np.inf)
    assert np.abs(free.shapes[-1].positions - one.shapes[-1].positions).max() > 1e-3


@pytest.mark.parametrize('model', ['ideal', 'rectangular'])
def test_damping_has_nothing_to_do_at_rest(model):
    # a naturally bent DLO that yields and is damped stays where it hangs
    rod = Rod(1.0, 0.3, (1.0, 2.0), 0.7, natural_curvature=(0.9, -0.6), damping=(0.3, 0.05),
              yield_curvature=0.5, yield_torsion=0.3, hardening=0.2, section_model=model)
    direct = DirectSimulator(rod, n_elements=24)
    start = direct.solve(LEVEL)
    assert start.dissipated > 0
    motion = direct.simulate([LEVEL] * 10, 0.01, start)
    np.testing.assert_allclose(motion.shapes[-1].positions, start.positions, atol=1e-7)
    np.testing.assert_allclose(motion.velocities, 0, atol=1e-6)
    assert motion.shapes[-1].dissipated == pytest.approx(start.dissipated, rel=1e-6)


@pytest.mark.parametrize('integrator', ['generalized_alpha', 'paper'])
def test_a_gripper_that_accelerates_evenly_pulls_evenly(integrator):
    # along the straight DLO, from rest: the first step too has the force m a
    dt, acceleration = 0.01, 4.0
    simulator = DirectSimulator(beam(), gravity=WEIGHTLESS)
    way = [Pose((acceleration / 2 * (dt * k) ** 2, 0, 0), (0, 0, 0, 1)) for k in range(12)]
    motion = simulator.simulate(way, dt, integrator=integrator)
    forces = np.array([shape.gripper_wrench for shape in motion.shapes[1:]])
    np.testing.assert_allclose(forces, np.tile([MASS * acceleration, 0, 0, 0, 0, 0], (11, 1)),
                               atol=1e-6)
    np.testing.assert_allclose(motion.velocities[:, :, 0],
                               np.outer(acceleration * motion.times, np.ones(65)), atol=1e-9)


@pytest.mark.parametrize(('obstacle', 'below'), [
    (Box(Pose((0.2, 0, 0.5), (0, 0, 0, 1)), (1.0, 1.0, 0.1)), -1.0),  # is run through
    (Plane((0, 0, 0.55), (0, 0, 1)), 0.3)], ids=['slab', 'floor'])    # is entered
def test_a_step_that_cannot_be_made_ends_the_motion(obstacle, below):
    rod = Rod(1.0, 0.05, 0.5, 0.4, radius=1e-3)
    direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=[obstacle])
    heights = (0.9, 0.89, below, below - 0.01, below - 0.02)
    motion = direct.simulate([Pose((0, 0, z), (0, 0, 0, 1)) for z in heights], 0.05)
    assert [shape.converged for shape in motion.shapes] == [True, True, False]
    assert not motion.converged
    assert len(motion.times) == len(motion.velocities) == len(motion.energy) == 3


def test_a_motion_begins_with_the_set_of_its_first_shape():
    # bent up by force and let go: strains alone would not tell that it is set
    rod = Rod(1.0, 0.1, (1.0, 2.0), 0.7, damping=(0.3, 0.05), yield_curvature=0.8, hardening=0.1)
    direct = DirectSimulator(rod, n_elements=24)
    up = Pose((0.7, 0, 0.5), Rotation.from_rotvec([0, -1.6, 0]).as_quat())
    start = direct.solve(LEVEL, direct.solve(LEVEL, far_end=up))
    assert start.converged and start.dissipated > 0.01 and start.positions[-1, 2] > 0.05
    motion = direct.simulate([LEVEL] * 10, 0.01, start)
    np.testing.assert_allclose(motion.shapes[-1].positions, start.positions, atol=1e-6)
    assert motion.shapes[-1].dissipated == pytest.approx(start.dissipated, rel=1e-6)
