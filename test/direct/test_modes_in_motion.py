# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Vibrations about a shape that hangs in space, against simulated motions; what has none."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Capsule,
    DirectSimulator,
    FarEnd,
    InvalidTask,
    Plane,
    PointLoad,
    Pose,
    Rod,
    Shape,
)
from dlo_planner.energy.potential import configuration_at
from dlo_planner.rods import GraspedInside

DOWN = Pose.looking_along((0, 0, 0), (0, 0, -1))
HANGING = {'bent': {}, 'curved': {'natural_curvature': (1.5, -1.0), 'natural_twist': 1.0,
                                  'bending_stiffness': (0.05, 0.08)},
           'tip': {'tip_mass': 0.05, 'point_masses': [(0.5, 0.03)]}}


def hanging(case, **options):
    rod = Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 0.06,
                 'torsional_stiffness': 0.05} | HANGING[case] | options.pop('rod', {}))
    pose = Pose((0, 0, 1), Rotation.from_rotvec([0.2, 0.5, 0.3]).as_quat())
    return DirectSimulator(rod, **options), pose


@pytest.mark.parametrize('case', HANGING)
@pytest.mark.parametrize('mode', [0, 1, 3])
def test_a_simulated_swing(case, mode):
    simulator, pose = hanging(case, rod={'damping': (0.05, 2e-3)})
    shape = simulator.solve(pose)
    modes = shape.modes(4)
    frequency, ratio = modes.frequencies[mode], modes.damping_ratios[mode]
    form = modes.displacements[mode]
    speed = 1e-3 * 2 * np.pi * frequency / np.abs(form).max() * form
    motion = simulator.simulate([pose] * 401, 0.01 / frequency, shape, velocity=speed)
    assert motion.converged
    moved = np.array([one.positions - shape.positions for one in motion.shapes])
    swing = np.einsum('k,ki,tki->t', modes.masses, form, moved)

    def vibration(t, frequency, ratio, cosine, sine):
        phase = 2 * np.pi * frequency * t
        return np.exp(-ratio * phase) * (cosine * np.cos(phase) + sine * np.sin(phase))

    size = swing.max()
    found, _ = curve_fit(vibration, motion.times, swing / size, [frequency, ratio, 0.0, 1.0])
    np.testing.assert_allclose(found[0], frequency * np.sqrt(1 - ratio**2), rtol=2e-3)
    np.testing.assert_allclose(found[1], ratio, rtol=0.03)
    # nothing else swings along
    rest = moved / size - np.einsum('t,ki->tki', swing / size, form)
    assert np.abs(rest).max() < 0.03 * np.abs(form).max()


@pytest.mark.parametrize('mode', [0, 1])
def test_a_simulated_swing_over_a_bar(mode):
    """It hangs over a bar on which it slides and rolls; across the bar, and over it."""
    rod, pose = Rod(1.0, 0.1, 0.06, 0.05, radius=0.004), Pose((0, 0, 1), (0, 0, 0, 1))
    free = DirectSimulator(rod).solve(pose)
    bar = free.at(0.5).position + np.array([0, 0, 0.016])  # 30 mm higher than it hangs
    simulator = DirectSimulator(rod, obstacles=[Capsule(bar - [0, 1, 0], bar + [0, 1, 0], 0.01)])
    shape = simulator.solve(pose, free)
    modes = shape.modes(2)
    assert len(shape.contacts) == 1
    frequency, form = modes.frequencies[mode], modes.displacements[mode]
    speed = 2e-4 * 2 * np.pi * frequency / np.abs(form).max() * form
    motion = simulator.simulate([pose] * 121, 0.01 / frequency, shape, velocity=speed)
    swing = [np.einsum('k,ki,ki', modes.masses, form, one.positions - shape.positions)
             for one in motion.shapes]
    assert motion.converged

    def vibration(t, frequency, ratio, sine):  # its implicit steps damp it
        phase = 2 * np.pi * frequency * t
        return np.exp(-ratio * phase) * sine * np.sin(phase)

    found, _ = curve_fit(vibration, motion.times, swing / np.max(swing), [frequency, 0.0, 1.0])
    assert found[0] == pytest.approx(frequency, rel=4e-3)


@pytest.mark.every(4)
@pytest.mark.parametrize('end', [None, FarEnd(Pose((0.5, 0.3, 0.5), (0, 0, 0, 1))),
                                 FarEnd(Pose((0.5, 0.3, 0.5), (0, 0, 0, 1)), 'pinned')])
@pytest.mark.parametrize('case', ['curved', 'tip'])
def test_the_answer_to_a_moved_gripper(case, end):
    simulator, pose = hanging(case, rod={'damping': (0.0, 1e-4)})
    shape = simulator.solve(pose, far_end=end)
    modes = shape.modes(12)
    seconds = 0.7 * modes.periods[0]
    times = np.linspace(0, 1.8 * seconds, 181)
    tau = np.minimum(times / seconds, 1.0)
    way = tau**3 * (10 - 15 * tau + 6 * tau**2)
    rate = (60 * tau - 180 * tau**2 + 120 * tau**3) / seconds**2
    for twist in 1e-3 * np.array([(1, 0.5, 0, 0, 0, 0), (0.3, -0.5, 0.2, 0.4, 0.5, -1)]):
        grippers = [Pose.from_rotation(
            pose.position + a * twist[:3],
            Rotation.from_rotvec(a * twist[3:]).as_matrix() @ pose.rotation) for a in way]
        ends = None if end is None else [end] * len(grippers)
        motion = simulator.simulate(grippers, times[1], shape, far_ends=ends)
        slow = simulator.track(grippers, far_ends=ends)
        off = np.array([one.positions - other.positions
                        for one, other in zip(motion.shapes, slow, strict=True)])
        w = 2 * np.pi * modes.frequencies

        def slopes(t, y, w=w, twist=twist):
            n = len(w)
            push = modes.participation @ twist * np.interp(t, times, rate)
            return np.concatenate([y[n:], -push - w**2 * y[:n]
                                   - 2 * modes.damping_ratios * w * y[n:]])

        told = solve_ivp(slopes, (0, times[-1]), np.zeros(2 * len(w)), t_eval=times, rtol=1e-6,
                         atol=1e-10, max_step=seconds / 50).y[:len(w)]
        told = np.einsum('mt,mki->tki', told, modes.displacements)
        assert np.abs(off - told).max() < 0.02 * np.abs(off).max()


@pytest.mark.parametrize('basis', ['chebyshev', 'local'])
def test_matrices_tell_the_same(basis):
    simulator, pose = hanging('curved', basis=basis, n_elements=64)
    shape = simulator.solve(pose)
    K, M, J = shape.stiffness_matrix(), shape.mass_matrix(), shape.jacobian()
    modes = shape.modes(6)
    np.testing.assert_array_equal(K, K.T)
    np.testing.assert_array_equal(M, M.T)
    assert np.linalg.eigvalsh(K)[0] == pytest.approx(shape.stability, rel=1e-3)
    mu = eigh(M, K, eigvals_only=True)[::-1][:6]
    np.testing.assert_allclose(1 / np.sqrt(mu) / (2 * np.pi), modes.frequencies, rtol=1e-7)
    np.testing.assert_allclose(np.einsum('k,kia,kib->ab', modes.masses, J, J), M, atol=1e-12)
    # against differences of shape and energy
    mesh = shape.state.mesh
    system = mesh.system(pose.rotation)
    q = mesh.unknowns(shape.element_strains)
    rng = np.random.default_rng(1)
    step = rng.normal(size=q.shape) / np.sqrt(q.size)

    def at(a):
        return configuration_at(system, mesh.strains_of(q + a * step))

    up, down = at(1e-5), at(-1e-5)
    np.testing.assert_allclose((up.positions - down.positions) / 2e-5, J @ step.ravel(), atol=1e-8)
    np.testing.assert_allclose((up.gradient - down.gradient).ravel() / 2e-5, K @ step.ravel(),
                               atol=1e-7)


@pytest.mark.parametrize('case', HANGING)
def test_bases_and_meshes_agree(case):
    found = []
    for options in ({}, {'basis': 'local', 'n_elements': 128}, {'accuracy': 1e-5},
                    {'basis': 'local', 'n_elements': 24}):
        simulator, pose = hanging(case, **options)
        found.append(simulator.solve(pose).modes(5))
    best = found[2].frequencies
    for modes in found:
        off = np.abs(modes.frequencies / best - 1)
        assert (off < 2 * modes.error_estimate + 2e-4).all()
        assert off.max() < 0.02


def test_what_has_no_modes_is_refused(tmp_path):
    simulator, pose = hanging('bent', obstacles=())
    shape = simulator.solve(pose)
    shape.save(tmp_path / 'a.npz')
    motion = simulator.simulate([pose] * 20, 0.01, DirectSimulator(
        simulator.rod, gravity=(0, 3.0, -9)).solve(pose))
    moment = DirectSimulator(simulator.rod, point_loads=[PointLoad(moment=(0, 0.1, 0))]).solve(pose)
    rough = DirectSimulator(replace(simulator.rod, radius=0.01), obstacles=[
        Plane((0, 0, 0.8), (0, 0, 1), friction=0.3)]).solve(pose)
    assert rough.contacts
    inside = GraspedInside(simulator.rod, 0.4).solve(pose)
    assert inside.parts[0].modes(1).frequencies > inside.parts[1].modes(1).frequencies
    for bad, word in ((replace(shape, converged=False), 'expected a converged'),
                      (Shape.load(tmp_path / 'a.npz'), 'simulator'),
                      (inside, 'parts'),
                      (motion.shapes[-1], 'equilibrium'), (moment, 'moments'), (rough, 'friction')):
        for ask in (bad.modes, partial(bad.modes, 20), bad.stiffness_matrix, bad.mass_matrix,
                    bad.jacobian):
            with pytest.raises(InvalidTask, match=f'shape.*{word}'):
                ask()
    with pytest.raises(InvalidTask, match='n = 0'):
        shape.modes(0)


def test_what_is_neutral_is_refused():
    straight = Rod(1.0, 0.1, 1.0, 0.75)
    free = DirectSimulator(straight, gravity=(0, 0, 0), grip='pinned').solve(DOWN)
    curved = replace(straight, natural_curvature=(0.5, 0.2))  # it may turn about the vertical
    turning = DirectSimulator(curved, grip='pinned').solve(DOWN)
    for shape in (free, turning):
        assert shape.converged
        with pytest.raises(InvalidTask, match='shape: expected a stable'):
            shape.modes()
