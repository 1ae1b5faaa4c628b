# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Modes along a path: what was one vibration stays one, whichever is slower."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, InvalidTask, Pose, Rod
from dlo_planner.results import modes_along

LEVEL = Pose.identity()
DOWN = Pose.looking_along((0, 0, 0), (0, 0, -1))
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
