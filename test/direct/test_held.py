# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Both ends held, soft and nearly taut, and grips that leave something free."""


from dataclasses import replace

import numpy as np
import pytest
from references.kirchhoff import true_held_rod
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from sweeps.shapes import cable, poses

from dlo_planner import DirectSimulator, FarEnd, InvalidTask, InverseSimulator, Pose, Rod
from dlo_planner.minimize.convergence import as_rounded

HERE = Pose.identity()


@pytest.mark.every(3)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('load', [1e3, 1e5])
def test_a_soft_cable_is_held(load, basis):
    direct = DirectSimulator(cable(load), basis=basis)
    for gripper, end in poses(8):
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged and shape.stability > 0.0
        last = shape.at(1.0)
        np.testing.assert_allclose(last.position, end.position, atol=1e-9)
        np.testing.assert_allclose(last.rotation, end.rotation, atol=1e-8)


@pytest.mark.parametrize('load', [0.0, 10.0, 1e3])
def test_soft_torsion_is_held(load):
    direct = DirectSimulator(cable(max(load, 1.0), 1e-4), basis='local',
                             gravity=(0, 0, 0) if load == 0.0 else (0, 0, -9.81))
    for gripper, end in poses(4):
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged and shape.stability > -1e-6


@pytest.mark.parametrize('load', [30.0, 1e3])
def test_held_rods_against_scipy(load):
    rod = cable(load)
    direct = DirectSimulator(rod, accuracy=3e-4)
    for gripper, end in poses(2):
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged
        off = np.abs(true_held_rod(rod, shape) - shape.positions).max()
        assert off < 3e-4 and off < 10 * shape.error_estimate


def catenary_force(span, weight):
    """Return the horizontal force of a chain of length 1 between two points as high."""
    return brentq(lambda h: 2 * h / weight * np.sinh(span * weight / (2 * h)) - 1,
                  1e-2 * weight, 1e7 * weight)


@pytest.mark.parametrize('span', [0.8, 0.999, 1 - 1e-6])
def test_a_pinned_cable_hangs_as_a_catenary(span):
    rod = cable(1e5)  # its stiffness has an effect of some 1e-4
    weight = rod.mass_per_length * 9.81
    shape = DirectSimulator(rod, basis='local', grip='pinned').solve(HERE, far_end=(span, 0, 0))
    assert shape.converged
    np.testing.assert_allclose(shape.gripper_wrench[3:], 0, atol=1e-9 * weight)
    force = catenary_force(span, weight)
    assert shape.far_wrench[0] == pytest.approx(force, rel=2e-3)
    sag = force / weight * (np.cosh(span * weight / (2 * force)) - 1)
    assert -shape.at(0.5).position[2] == pytest.approx(sag, rel=2e-3)


@pytest.mark.parametrize('grip', ['clamped', 'pinned', 'aligned'])
@pytest.mark.parametrize('distance', [1.0, 1 - 1e-12, 1.1])
def test_a_dlo_cannot_be_held_taut(grip, distance):
    shape = DirectSimulator(cable(10.0)).solve(
        HERE, far_end=FarEnd(Pose((distance, 0, 0), (0, 0, 0, 1)), grip))
    assert not shape.converged and not shape.nearly
    assert 'out of reach' in shape.status and f'{distance:.9g} m' in shape.status


def test_an_aligned_grip_leaves_the_twist_free():
    rod = Rod(1.0, 0.1, 0.05, 0.04)
    direct = DirectSimulator(rod, basis='local')
    end = Pose((0.7, 0.1, 0.1), Rotation.from_rotvec([0.4, 0.3, -0.5]).as_quat())
    aligned = direct.solve(HERE, far_end=FarEnd(end, 'aligned'))
    assert aligned.converged
    last = aligned.at(1.0)
    np.testing.assert_allclose(last.position, end.position, atol=1e-9)
    np.testing.assert_allclose(last.direction, end.direction, atol=1e-9)
    assert abs(aligned.far_wrench[3:] @ end.direction) < 1e-9
    # of all twists at which it may be clamped it takes the one of least energy
    turned = Rotation.from_matrix(np.array(last.rotation))
    clamped = [direct.solve(HERE, aligned, far_end=Pose(
        last.position, (turned * Rotation.from_rotvec([a, 0, 0])).as_quat())).energy
        for a in (-0.1, 0.0, 0.1)]
    assert clamped[1] == pytest.approx(aligned.energy, abs=1e-10)
    assert min(clamped[0], clamped[2]) > aligned.energy + 1e-5


def test_what_is_neutral_is_found_neutral():
    # a weightless arch may turn about the line between its ends
    for grip in ('clamped', 'pinned'):
        direct = DirectSimulator(Rod(1.0, 0.0, 1.0, 0.7), basis='local', gravity=(0, 0, 0),
                                 grip=grip)
        shape = direct.solve(HERE, far_end=(0.8, 0, 0))
        assert shape.converged and abs(shape.stability) < 1e-9


def test_track_goes_on_from_a_shape_that_is_nearly_converged(monkeypatch):
    direct = DirectSimulator(cable(100.0), basis='local', accuracy=1e-3)
    ends = [(0.8 - 0.02 * k, 0, 0) for k in range(3)]
    before = direct.track([HERE] * 3, far_ends=ends)
    assert all(shape.status == 'converged' for shape in before)
    made, calls = DirectSimulator._step, []

    def second_fails(simulator, *given):
        shape, kicks = made(simulator, *given)
        calls.append(None)
        return (replace(shape, converged=False) if len(calls) == 2 else shape), kicks

    monkeypatch.setattr(DirectSimulator, '_step', second_fails)
    shapes = direct.track([HERE] * 3, far_ends=ends)
    assert [shape.converged for shape in shapes] == [True, False, True]
    assert shapes[1].nearly and 'nearly converged' in shapes[1].status
    # the third began with the forces of the second, not of the first
    np.testing.assert_allclose(shapes[2].state.before.positions, shapes[1].positions)


def test_a_pinned_gripper_lets_the_dlo_hang():
    rod = Rod(1.0, 0.1, 0.05, 0.04)
    for basis in ('local', 'chebyshev'):
        shape = DirectSimulator(rod, basis=basis, grip='pinned').solve(Pose((0, 0, 1),
                                                                          (0, 0, 0, 1)))
        assert shape.converged and abs(shape.stability) < 1e-7
        np.testing.assert_allclose(shape.positions[-1], 0, atol=1e-9)
        np.testing.assert_allclose(shape.frames[0][:, 0], (0, 0, -1), atol=1e-9)
        np.testing.assert_allclose(shape.gripper_wrench, (0, 0, 0.981, 0, 0, 0), atol=1e-9)


def test_a_pinned_bent_dlo_hangs_with_its_weight_below_the_gripper():
    rod = Rod(1.0, 0.1, 0.5, 0.4, natural_curvature=(0.0, 2.0))
    direct = DirectSimulator(rod, basis='local', grip='pinned')
    first = direct.solve(Pose((0, 0, 1), (0, 0, 0, 1)))
    shapes = direct.track([Pose((0.1 * k, 0, 1), (0, 0, 0, 1)) for k in range(3)], initial=first)
    for shape in (first, *shapes):
        assert shape.converged and not shape.jumped
        middle = 0.5 * (shape.positions[1:] + shape.positions[:-1]).mean(axis=0)
        np.testing.assert_allclose((middle - shape.gripper.position)[:2], 0, atol=1e-3)
        np.testing.assert_allclose(shape.gripper_wrench[3:], 0, atol=1e-9)


def test_a_pinned_gripper_is_refused_where_it_is_not_looked_at():
    direct = DirectSimulator(cable(1.0), grip='pinned')
    with pytest.raises(InvalidTask, match='pinned'):
        InverseSimulator(direct)
    with pytest.raises(InvalidTask, match='pinned'):
        direct.simulate([HERE] * 2, 0.01)
    with pytest.raises(InvalidTask, match='grip'):
        DirectSimulator(cable(1.0), grip='glued')


@pytest.mark.parametrize(('residual', 'noise', 'proved'), [
    (0.9e-7, 0.0, True), (1.1e-7, 0.0, False), (8e-6, 9e-6, True), (0.0, 1.1e-5, False)])
def test_forces_that_rounding_hides_prove_nothing(residual, noise, proved):
    assert as_rounded(residual, noise, 1e-7) == proved
