# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Vibrations about a shape at rest, against the theory of beams, chains and rings."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from references.vibrations import (
    GAUSS,
    WEIGHT,
    G,
    beam_frequencies,
    plane_rod,
    polynomials,
    ring,
    slowest,
)
from scipy.integrate import solve_ivp, trapezoid
from scipy.linalg import eigh
from scipy.optimize import brentq, curve_fit
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
from dlo_planner.results import modes_along
from dlo_planner.rods import GraspedInside, with_plug

LEVEL = Pose.identity()
DOWN = Pose.looking_along((0, 0, 0), (0, 0, -1))
WEIGHTLESS = (0.0, 0.0, 0.0)


def beam(**more):
    return Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 1.0,
                  'torsional_stiffness': 0.75} | more)


@pytest.mark.parametrize('basis', ['chebyshev', 'local', 'fourier_polynomial'])
@pytest.mark.parametrize('stiffness', [(1.0, 1.0), (1.0, 2.0)])
def test_cantilever_in_both_planes(basis, stiffness):
    shape = DirectSimulator(beam(bending_stiffness=stiffness), gravity=WEIGHTLESS, basis=basis,
                            n_elements=64).solve(LEVEL)
    modes = shape.modes(6)
    roots = np.array([1.875104, 4.694091, 7.854757])
    plain = roots**2 * np.sqrt(1 / 0.1) / (2 * np.pi)
    expected = np.sort(np.concatenate([np.sqrt(one) * plain for one in stiffness]))
    np.testing.assert_allclose(modes.frequencies, expected, rtol=2e-4)
    assert (np.abs(modes.frequencies / expected - 1) < 2 * modes.error_estimate).all()
    assert modes.error_estimate.max() < 3e-4
    np.testing.assert_allclose(np.abs(modes.displacements[:, :, 0]).max(), 0, atol=1e-12)


def test_more_modes_than_the_series_has_terms():
    modes = DirectSimulator(beam(), gravity=WEIGHTLESS).solve(LEVEL).modes(20)
    roots = np.array([1.875104, 4.694091, 7.854757, *((k - 0.5) * np.pi for k in range(4, 11))])
    expected = np.repeat(roots**2 * np.sqrt(10) / (2 * np.pi), 2)
    off = np.abs(modes.frequencies / expected - 1)
    assert (off < 1.1 * modes.error_estimate).all()
    assert off.max() < 1e-2


@pytest.mark.parametrize('tip', [0.02, 0.1, 1.0])
def test_cantilever_with_a_tip_mass(tip):
    def characteristic(b):
        return 1 + np.cos(b) * np.cosh(b) + tip / 0.1 * b * (np.cos(b) * np.sinh(b)
                                                             - np.sin(b) * np.cosh(b))
    roots = np.array([brentq(characteristic, 0.3, 1.9), brentq(characteristic, 3.9, 4.7)])
    modes = DirectSimulator(beam(tip_mass=tip), gravity=WEIGHTLESS).solve(LEVEL).modes(4)
    np.testing.assert_allclose(modes.frequencies[::2], roots**2 * np.sqrt(10) / (2 * np.pi),
                               rtol=4e-4)


@pytest.mark.parametrize('mass', [0.0, 0.1])
def test_plug_at_the_tip(mass):
    own, size, inertia = 0.01, 0.05, 2e-6
    rod = with_plug(beam(mass_per_length=mass, point_masses=[(0.4, 0.01)]), size, own,
                    inertia=inertia)
    modes = DirectSimulator(rod, gravity=WEIGHTLESS).solve(LEVEL).modes(4)
    x, w = 0.5 * (GAUSS + 1), 0.5 * WEIGHT
    v, bend = polynomials(x, 2, 0), polynomials(x, 2, 2)
    tip, turn = (polynomials(np.array([1.0]), 2, k) for k in (0, 1))
    center, carried = tip + size / 2 * turn, polynomials(np.array([0.4]), 2, 0)
    M = (mass * (v.T * w) @ v + own * center.T @ center + inertia * turn.T @ turn
         + 0.01 * carried.T @ carried)
    np.testing.assert_allclose(modes.frequencies[::2], slowest(M, (bend.T * w) @ bend, 2),
                               rtol=1e-3)
    np.testing.assert_allclose(modes.frequencies[1::2], modes.frequencies[::2], rtol=1e-9)


def test_a_mass_on_a_thread_has_two_modes():
    thread = Rod(1.0, 0.0, 1e-3, 1e-3, tip_mass=1.0)
    modes = DirectSimulator(thread, basis='local').solve(DOWN).modes(10)
    assert len(modes) == 2
    clamped = np.sqrt(1e-3 / G)  # it turns about a point so far from the clamp
    np.testing.assert_allclose(modes.periods, 2 * np.pi * np.sqrt((1 - clamped) / G), rtol=1e-3)


@pytest.mark.parametrize(('way', 'load', 'tip'), [
    (-1, 1.0, 0.0), (-1, 30.0, 0.02), (-1, 300.0, 0.0), (1, 5.0, 0.0), (1, 7.4, 0.0),
    (1, 2.0, 0.02)])
def test_stiffened_and_softened_by_gravity(way, load, tip):
    stiffness = 0.1 * G / load
    rod = beam(bending_stiffness=stiffness, torsional_stiffness=stiffness, tip_mass=tip)
    shape = DirectSimulator(rod, accuracy=1e-5).solve(Pose.looking_along((0, 0, 0), (0, 0, way)))
    expected = beam_frequencies(3, lambda x: -way * G * (0.1 * (1 - x) + tip), tip, stiffness)
    modes = shape.modes(6)
    np.testing.assert_allclose(modes.frequencies, np.repeat(expected, 2), rtol=2e-3)
    assert (np.abs(modes.frequencies / np.repeat(expected, 2) - 1)
            < 2 * modes.error_estimate + 1e-5).all()


def test_hanging_chain_has_bessels_zeros():
    chain = beam(bending_stiffness=1e-6, torsional_stiffness=1e-6)
    simulator = DirectSimulator(chain, basis='local', n_elements=128, grip='pinned')
    modes = simulator.solve(DOWN).modes(6)
    zeros = np.array([2.404826, 5.520078, 8.653728])  # of J0
    expected = zeros / 2 * np.sqrt(G) / (2 * np.pi)
    np.testing.assert_allclose(modes.frequencies, np.repeat(expected, 2), rtol=2e-3)


def test_compound_pendulum():
    bar = beam(bending_stiffness=1e4, torsional_stiffness=1e4)
    for basis in ('chebyshev', 'local'):
        modes = DirectSimulator(bar, basis=basis, n_elements=64, grip='pinned').solve(DOWN).modes(2)
        np.testing.assert_allclose(modes.frequencies, np.sqrt(1.5 * G) / (2 * np.pi), rtol=2e-4)
        np.testing.assert_allclose(modes.participation[:, 3:], 0, atol=1e-9)  # it may turn


@pytest.mark.parametrize(('angle', 'load', 'tip'), [
    (0.0, 5.0, 0.0), (0.0, 60.0, 0.0), (0.9, 20.0, 0.0), (-0.5, 8.0, 0.1)])
def test_bent_by_gravity_in_its_plane(angle, load, tip):
    stiffness = 0.1 * G / load
    rod = beam(bending_stiffness=stiffness, torsional_stiffness=0.7 * stiffness, tip_mass=tip)
    pose = Pose.looking_along((0, 0, 1), (np.cos(angle), 0, np.sin(angle)))
    modes = DirectSimulator(rod).solve(pose).modes(8)
    inside = np.linalg.norm(modes.displacements[:, :, 1], axis=1) < 1e-6
    assert inside.sum() >= 3
    expected = plane_rod(angle, 0.1, stiffness, tip, inside.sum())
    np.testing.assert_allclose(modes.frequencies[inside], expected, rtol=5e-3)
    assert (np.abs(modes.frequencies[inside] / expected - 1)
            < 3 * modes.error_estimate[inside] + 1e-4).all()


@pytest.mark.parametrize('opening', [1.0, np.pi, 4.5])
def test_part_of_a_ring(opening):
    stiffness, torsion = (1.0, 1.7), 0.6
    rod = beam(bending_stiffness=stiffness, torsional_stiffness=torsion,
               natural_curvature=(opening, 0.0))
    modes = DirectSimulator(rod, gravity=WEIGHTLESS).solve(LEVEL).modes(6)
    expected = np.sort(np.concatenate(ring(opening, 1 / opening, stiffness, torsion, 0.1, 6)))[:6]
    np.testing.assert_allclose(modes.frequencies, expected, rtol=2e-3)


@pytest.mark.parametrize(('end', 'held'), [
    (FarEnd(Pose((1, 0, 0), (0, 0, 0, 1))), [(1.0, 0), (1.0, 1)]),
    (FarEnd(Pose((1, 0, 0), (0, 0, 0, 1)), 'aligned'), [(1.0, 0), (1.0, 1)]),
    (FarEnd(Pose((1, 0, 0), (0, 0, 0, 1)), 'sleeve'), [(1.0, 0), (1.0, 1)]),
    (FarEnd(Pose((1, 0, 0), (0, 0, 0, 1)), 'pinned'), [(1.0, 0)])])
@pytest.mark.parametrize('basis', ['chebyshev', 'local'])
def test_beam_held_at_both_ends(end, held, basis):
    shape = DirectSimulator(beam(), gravity=WEIGHTLESS, basis=basis, n_elements=64).solve(
        LEVEL, far_end=end)
    modes = shape.modes(4)
    off = np.abs(modes.frequencies / np.repeat(beam_frequencies(2, held=held), 2) - 1)
    assert (off < 1.1 * modes.error_estimate).all()
    assert off.max() < 2e-3
    assert len(shape.stiffness_matrix()) < 3 * shape.state.mesh.n_unknowns


def test_cable_between_two_joints():
    """Across its plane a cable of small sag swings as a string under its horizontal force."""
    cable = beam(bending_stiffness=1e-5, torsional_stiffness=1e-5)
    span = 0.99
    shape = DirectSimulator(cable, accuracy=1e-4, grip='pinned').solve(
        LEVEL, far_end=(span, 0, 0))
    modes = shape.modes(8)
    across = np.linalg.norm(modes.displacements[:, :, 1], axis=1) > 0.5 * np.linalg.norm(
        modes.displacements[:, :, 2], axis=1)
    # with the catenary's own mass per span: x'' H y + w^2 rho ds/dx y = 0, by Ritz with sines
    x = np.linspace(0, span, 2001)
    force = abs(shape.gripper_wrench[0])
    grown = np.cosh(0.1 * G / force * (x - span / 2))
    sines = np.sin(np.pi * np.outer(x / span, np.arange(1, 9)))
    slopes = np.pi / span * np.arange(1, 9) * np.cos(np.pi * np.outer(x / span, np.arange(1, 9)))
    expected = slowest(trapezoid(0.1 * grown[:, None, None] * sines[:, :, None] * sines[:, None],
                                 x, axis=0),
                       trapezoid(force * slopes[:, :, None] * slopes[:, None], x, axis=0), 3)
    np.testing.assert_allclose(modes.frequencies[across][:3], expected, rtol=5e-3)


@pytest.mark.parametrize('at', [0.53, 0.7])
def test_beam_on_a_bar(at):
    """Up and down it is a beam on two supports, sideways a cantilever: the bar has no friction."""
    rod = beam(radius=0.005, bending_stiffness=20.0, torsional_stiffness=15.0)
    bar = Capsule((at, -1, -0.0148), (at, 1, -0.0148), 0.01)  # it lifts the rod by 0.2 mm
    shape = DirectSimulator(rod, obstacles=[bar]).solve(LEVEL)
    assert len(shape.contacts) == 1
    modes = shape.modes(4)
    up = np.abs(modes.displacements[:, :, 2]).max(axis=1) > 1e-3
    np.testing.assert_allclose(
        modes.frequencies[up], beam_frequencies(2, stiffness=20.0, held=[(at, 0)])[:up.sum()],
        rtol=5e-3)
    np.testing.assert_allclose(modes.frequencies[~up],
                               beam_frequencies(4, stiffness=20.0)[:(~up).sum()], rtol=1e-3)
    assert up.sum() >= 1
    for one in modes.displacements[up, :, 2]:
        assert abs(np.interp(at, shape.s, one)) < 2e-3 * np.abs(one).max()


def test_modes_are_orthonormal_and_share_the_mass():
    shape = DirectSimulator(beam(), gravity=WEIGHTLESS, basis='local', n_elements=32).solve(LEVEL)
    modes = shape.modes(400)
    product = np.einsum('k,aki,bki->ab', modes.masses, modes.displacements, modes.displacements)
    np.testing.assert_allclose(product, np.eye(len(modes)), atol=1e-8)
    moving = modes.masses[1:].sum()
    second = modes.masses @ shape.s**2
    # effective masses add up; what is next to the clamp is held by it
    np.testing.assert_allclose(np.sum(modes.participation**2, axis=0),
                               [0, moving, moving, 0, second, second], rtol=1e-3, atol=1e-9)


def test_the_largest_displacement_is_positive():
    for angle in (0.0, 1.0, 2.0, 3.0):
        pose = Pose.looking_along((0, 0, 0), (np.cos(angle), np.sin(angle), 0.3))
        for one in DirectSimulator(beam()).solve(pose).modes(4).displacements:
            assert one.max() == np.abs(one).max()


def test_loads_count_as_they_pull():
    pulled = DirectSimulator(beam(), gravity=WEIGHTLESS,
                             point_loads=[PointLoad(force=(3.0, 0, 0))]).solve(LEVEL)
    np.testing.assert_allclose(pulled.modes(4).frequencies,
                               np.repeat(beam_frequencies(2, lambda x: 3.0 + 0 * x), 2), rtol=5e-4)


def test_what_yielded_springs_back():
    rod = beam(bending_stiffness=0.1, torsional_stiffness=0.08, yield_curvature=1.0, hardening=0.1)
    simulator = DirectSimulator(rod, n_elements=64, n_terms=10)
    shape = simulator.solve(LEVEL)
    assert shape.dissipated > 0
    springy = simulator.with_set(shape).elastic().solve(shape.gripper)
    np.testing.assert_allclose(springy.positions, shape.positions, atol=1e-3)
    np.testing.assert_allclose(shape.modes(4).frequencies, springy.modes(4).frequencies, rtol=2e-3)


# ------------------------------------------------------------------------------------------------
# Modes along a path: what was one vibration stays one, whichever is slower.


ROD = {'length': 1.0, 'mass_per_length': 0.1, 'torsional_stiffness': 0.05}


def turned(angles, **options):
    rod = Rod(**ROD, bending_stiffness=0.06)
    grippers = [Pose((0.2 * a, 0, 1), Rotation.from_rotvec([0.1 * a, a, 0.2]).as_quat())
                for a in angles]
    return DirectSimulator(rod, **options).track(grippers)


def test_planes_that_cross_stay_what_they_are():
    ratios = np.linspace(0.8, 1.25, 10)
    shapes = [DirectSimulator(Rod(**ROD, bending_stiffness=(1.0, ratio)),
                              gravity=(0, 0, 0)).solve(LEVEL) for ratio in ratios]
    tracked = modes_along(shapes, 4)
    up = np.array([[np.abs(one[:, 2]).max() > 1e-6 for one in modes.displacements]
                   for modes in tracked])
    assert (up == [False, True, False, True]).all()  # EI_b < EI_n bends sideways first
    found = np.array([modes.frequencies for modes in tracked])
    np.testing.assert_allclose(found[:, 1], found[0, 1], rtol=1e-9)
    np.testing.assert_allclose(found[:, 0] / found[0, 0], np.sqrt(ratios / 0.8), rtol=1e-9)
    assert found[-1, 0] > found[-1, 1]
    assert min(modes.overlap.min() for modes in tracked) > 0.999
    for modes in tracked:  # the estimate belongs to the mode, whichever place it has
        assert (modes.error_estimate < 3e-4).all()


def test_a_bend_that_turns():
    shapes = turned(np.linspace(-0.5, 1.2, 30))
    tracked = modes_along(shapes, 4)
    assert len(tracked) == len(shapes)
    for shape, modes in zip(shapes, tracked, strict=True):
        every = shape.modes(8).frequencies
        assert np.abs(modes.frequencies[:, None] / every - 1).min(axis=1).max() < 1e-9
    found = np.array([modes.frequencies for modes in tracked])
    # smooth: second differences are of second order
    assert np.abs(np.diff(found, 2, axis=0) / found[1:-1]).max() < 0.02
    assert min(modes.overlap.min() for modes in tracked) > 0.95
    for before, modes in zip(tracked, tracked[1:], strict=False):
        product = np.einsum('k,mki,mki->m', modes.masses, before.displacements,
                            modes.displacements)
        np.testing.assert_allclose(product, modes.overlap, atol=1e-9)  # signs too


def test_a_sideways_mode_keeps_its_sign_all_the_way_round():
    # by itself a mode has the sign that makes its largest displacement, in world axes, positive
    rod = Rod(**ROD, bending_stiffness=(0.06, 0.2))
    ways = [Pose((0, 0, 0), Rotation.from_euler('z', a).as_quat())
            for a in np.linspace(0, 2 * np.pi, 25)]
    shapes = DirectSimulator(rod).track(ways)
    tracked = modes_along(shapes, 2)
    for before, modes in zip(tracked, tracked[1:], strict=False):
        product = np.einsum('k,mki,mki->m', modes.masses, before.displacements,
                            modes.displacements)
        assert (product > 0.9).all()
    alone = [shape.modes(2).displacements for shape in shapes]
    assert any(np.vdot(one[k], other[k]) < 0 for one, other in zip(alone, alone[1:], strict=False)
               for k in range(2))
    np.testing.assert_allclose(tracked[-1].displacements, tracked[0].displacements, atol=1e-6)


def test_twins_are_turned_together():
    """A round DLO that hangs straight: any plane is one of vibration."""
    simulator = DirectSimulator(Rod(**ROD, bending_stiffness=0.06))
    rolled = [Pose.from_rotation((0, 0, 0), DOWN.rotation @ Rotation.from_rotvec(
        [a, 0, 0]).as_matrix()) for a in np.linspace(0, 2, 9)]
    tracked = modes_along(simulator.track(rolled), 4)
    for modes in tracked[1:]:
        np.testing.assert_allclose(modes.overlap, 1.0, atol=1e-6)
        np.testing.assert_allclose(modes.displacements, tracked[0].displacements, atol=1e-5)
        product = np.einsum('k,aki,bki->ab', modes.masses, modes.displacements,
                            modes.displacements)
        np.testing.assert_allclose(product, np.eye(4), atol=1e-8)


def test_meshes_may_differ():
    one, other = (turned([0.1, 0.2], **options)[k] for k, options in enumerate(
        ({}, {'basis': 'local', 'n_elements': 40})))
    first, second = modes_along([one, other], 4)
    assert second.overlap.min() > 0.99
    assert second.displacements.shape == (4, 41, 3)
    np.testing.assert_allclose(first.frequencies, second.frequencies, rtol=0.05)


def test_what_is_wrong_is_named():
    good = turned([0.0])[0]
    with pytest.raises(InvalidTask, match=r'shapes\[1\]: expected one that comes'):
        modes_along([good, good.resample(8)], 2)
    thread = Rod(1.0, 0.0, 1e-3, 1e-3, tip_mass=1.0)
    few = DirectSimulator(thread, basis='local').solve(DOWN)
    with pytest.raises(InvalidTask, match=r'shapes\[1\]: expected one with 4 modes'):
        modes_along([good, few], 4)
    assert modes_along([], 2) == ()


# ------------------------------------------------------------------------------------------------
# Vibrations about a shape that hangs in space, against simulated motions; what has none.


HANGING = {'bent': {}, 'curved': {'natural_curvature': (1.5, -1.0), 'natural_twist': 1.0,
                                  'bending_stiffness': (0.05, 0.08)},
           'tip': {'tip_mass': 0.05, 'point_masses': [(0.5, 0.03)]}}


def hanging(case, **options):
    rod = Rod(**{'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 0.06,
                 'torsional_stiffness': 0.05} | HANGING[case] | options.pop('rod', {}))
    pose = Pose((0, 0, 1), Rotation.from_rotvec([0.2, 0.5, 0.3]).as_quat())
    return DirectSimulator(rod, **options), pose


@pytest.mark.every(4)
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


def test_what_has_no_mass_has_no_modes():
    light = Rod(1.0, 0.0, 1.0, 0.75)
    assert len(DirectSimulator(light, gravity=(0, 0, 0)).solve(LEVEL).modes()) == 0


def test_what_is_neutral_is_refused():
    straight = Rod(1.0, 0.1, 1.0, 0.75)
    free = DirectSimulator(straight, gravity=(0, 0, 0), grip='pinned').solve(DOWN)
    curved = replace(straight, natural_curvature=(0.5, 0.2))  # it may turn about the vertical
    turning = DirectSimulator(curved, grip='pinned').solve(DOWN)
    for shape in (free, turning):
        assert shape.converged
        with pytest.raises(InvalidTask, match='shape: expected a stable'):
            shape.modes()
