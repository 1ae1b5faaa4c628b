# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Vibrations about a shape at rest, against the theory of beams, chains and rings."""

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
from scipy.integrate import trapezoid
from scipy.optimize import brentq

from dlo_planner import Capsule, DirectSimulator, FarEnd, PointLoad, Pose, Rod, with_plug

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
