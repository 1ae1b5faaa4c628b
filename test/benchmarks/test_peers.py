# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The reference of the peers against the package; the peers that are always there."""

import numpy as np
import pytest

from benchmarks import floor
from benchmarks.cases import ANGLES, local, random_poses, rotations, turned, wire
from benchmarks.peers import boundary, descent, ours
from benchmarks.peers.compare import error_of
from benchmarks.peers.reference import CASES, Reference

pytestmark = pytest.mark.sweep  # the package has tests of its own


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.name[0])
def test_the_package_agrees_with_the_reference(case):
    assert error_of(ours.prepare(case, 1e-5)(), Reference(case)) < 1e-5


def test_the_reference_keeps_the_length_and_the_grip():
    reference, s = Reference(CASES[0]), np.linspace(0, 1, 20001)
    places = reference(0, s)
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).sum() == pytest.approx(1, abs=1e-5)
    np.testing.assert_allclose(places[1] / s[1], [1, 0], atol=5e-4)


def test_errors_of_peers_fall():
    reference = Reference(CASES[0])
    assert error_of(boundary.prepare(CASES[0], 1e-7)(), reference) < 1e-8
    coarse, fine = (error_of(descent.prepare(CASES[0], n)(), reference) for n in (16, 32))
    assert 3 < coarse / fine < 5


# ---- the hand-written loop finds what the package finds -------------------------------------


@pytest.mark.parametrize('n', [32, 64])
def test_benchmark_c_is_that_of_the_package(n):
    poses = [turned(angle) for angle in ANGLES]
    found, figures = floor.solved(floor.copper_wire(n), rotations(poses), warm=True)
    shapes = local(n).track(poses)
    for shape, places, (residual, stability, _) in zip(shapes, found, figures, strict=True):
        assert shape.converged
        assert residual < 1e-10
        np.testing.assert_allclose(places + shape.gripper.position, shape.positions, atol=1e-10)
        # the package may judge by the step before the last one
        assert stability == pytest.approx(shape.stability, abs=1e-4)


def test_random_poses_are_those_of_the_package():
    poses = random_poses(40, seed=3)
    found, figures = floor.solved(floor.copper_wire(), rotations(poses))
    shapes = [local().solve(pose) for pose in poses]
    np.testing.assert_allclose(found, [shape.positions for shape in shapes], atol=1e-10)
    np.testing.assert_array_equal(figures[:, 2], [shape.iterations for shape in shapes])


def test_a_tip_mass():
    found, _ = floor.solved(floor.copper_wire(tip_mass=1.0), rotations([turned(0)]))
    shape = local(rod=wire(tip_mass=1.0)).solve(turned(0))
    np.testing.assert_allclose(found[0] + [0, 0, 1], shape.positions, atol=1e-10)


@pytest.mark.parametrize('size', [1e-9, 1e-3, 0.14, 0.142, 0.5, 0.999, 1.001, 2.0, 3.1])
def test_coefficients_of_the_exponential(size):
    """Both sides of where the formulas change; slopes by differences."""
    c1, c2, d1, d2, dd1, dd2 = floor._coefficients(size**2)
    assert c1 == pytest.approx(2 * (np.sin(size / 2) / size) ** 2, rel=1e-13)
    assert size * (1 - c2 * size**2) == pytest.approx(np.sin(size), rel=1e-14)
    step = 1e-5
    here, there = (np.array(floor._coefficients((size + sign * step)**2)) for sign in (-1, 1))
    if size > 0.1:
        slopes = (there - here) / (2 * step * size)
        np.testing.assert_allclose(slopes[:4], [d1, d2, dd1, dd2], rtol=1e-6)
