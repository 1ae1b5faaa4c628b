# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Both ends held, soft and nearly taut, and grips that leave something free."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from references.kirchhoff import true_held_rod
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipk
from sweeps.shapes import cable, poses

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    DirectSimulator,
    FarEnd,
    InvalidTask,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.direct import placement
from dlo_planner.direct.statics import StepSolver
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
    made, calls = StepSolver.take, []

    def second_fails(solver, *given):
        shape = made(solver, *given)
        calls.append(None)
        return replace(shape, converged=False) if len(calls) == 2 else shape

    monkeypatch.setattr(StepSolver, 'take', second_fails)
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


# ------------------------------------------------------------------------------------------------
# Both ends held: forces, buckling loads from the literature, symmetry.


ROD = Rod(1.0, 0.0, 1.0, 0.7)


def simulator(rod=ROD, basis='local', **more):
    return DirectSimulator(rod, basis=basis, gravity=(0, 0, 0), n_elements=96,
                           n_terms=None if basis == 'local' else 20, **more)


def turned(angle, x=0.0):
    return Pose((x, 0, 0), Rotation.from_rotvec([angle, 0, 0]).as_quat())


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_any_pose_is_held_and_wrenches_balance(basis, rng):
    rod = Rod(1.0, 0.05, (0.3, 0.6), 0.4, natural_curvature=(0.5, -0.3), tip_mass=0.1)
    direct = DirectSimulator(rod, basis=basis, n_terms=None if basis == 'local' else 20)
    for _ in range(6):
        gripper = Pose(rng.normal(size=3), rng.normal(size=4))
        turn = Rotation.from_rotvec(rng.uniform(-1, 1, 3)).as_matrix()
        end = Pose.from_rotation(gripper.position + gripper.rotation @ rng.uniform(-0.4, 0.7, 3),
                                 gripper.rotation @ turn)
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged
        last = shape.at(1.0)
        np.testing.assert_allclose(last.position, end.position, atol=1e-8)
        np.testing.assert_allclose(last.rotation, end.rotation, atol=1e-7)
        weight = np.array([0, 0, -9.81 * 0.15])
        np.testing.assert_allclose(
            shape.gripper_wrench[:3] + shape.far_wrench[:3] + weight, 0, atol=1e-9)
        middle = 0.5 * (shape.positions[1:] + shape.positions[:-1])
        pulls = np.diff(shape.s)[:, None] * [0, 0, -0.05 * 9.81]
        moment = (shape.gripper_wrench[3:] + shape.far_wrench[3:]
                  + np.cross(shape.positions[-1] - gripper.position,
                             shape.far_wrench[:3] + [0, 0, -0.981])
                  + np.cross(middle - gripper.position, pulls).sum(axis=0))
        np.testing.assert_allclose(moment, 0, atol=1e-9)


def test_clamped_column_against_the_elastica():
    # four quarters of the pinned elastica: shortening 1 - (2 E / K - 1), force (4 K)^2 EI / L^2
    shape = simulator().solve(HERE, far_end=Pose((0.9, 0, 0), (0, 0, 0, 1)))
    assert shape.converged
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - 0.9, 1e-6, 0.9)
    assert -shape.far_wrench[0] == pytest.approx((4 * ellipk(m)) ** 2, rel=5e-4)
    np.testing.assert_allclose(shape.far_wrench[1:3], 0, atol=1e-4)


def test_pinned_far_end_has_no_moment_and_buckles_at_eulers_load():
    shape = simulator().solve(HERE, far_end=(0.9995, 0, 0))
    assert shape.converged
    # clamped and pinned: tan x = x
    x = brentq(lambda x: np.tan(x) - x, 4.4, 4.6)
    # force along the line between the ends, some percent above the critical one at this amplitude
    assert np.linalg.norm(shape.far_wrench[:3]) == pytest.approx(x**2, rel=3e-3)
    np.testing.assert_allclose(shape.far_wrench[3:], 0, atol=1e-9)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_twist_at_which_a_straight_rod_buckles(basis):
    # free to shorten: M = 2 * 4.4934 EI / L (both ends clamped), so stability vanishes there
    critical = 8.98682 / 0.7
    angles = critical * np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.99])
    direct = simulator(basis=basis)
    shapes = direct.track([HERE] * 6, far_ends=[FarEnd(turned(a, 1.0), 'sleeve') for a in angles])
    assert all(shape.converged and not shape.jumped for shape in shapes)
    zero = np.polyfit([shape.stability for shape in shapes[-3:]], angles[-3:], 1)[1]
    assert zero == pytest.approx(critical, rel=3e-3)
    fallen = direct.track([HERE], initial=shapes[-1],
                          far_ends=[FarEnd(turned(1.02 * critical, 1.0), 'sleeve')])[0]
    assert fallen.jumped and np.abs(fallen.positions[:, 1:]).max() > 0.05


def test_michells_ring():
    # a ring of a straight rod stays flat up to the twist 2 pi sqrt(3) EI / GJ
    direct = simulator()
    angles = np.linspace(0.1, 2 * np.pi, 30)
    closing = [Pose((np.sin(a) / a, 0, (1 - np.cos(a)) / a),
                    Rotation.from_rotvec([0, -a, 0]).as_quat()) for a in angles]
    ring = direct.track([HERE] * 30, far_ends=closing)[-1]
    assert ring.converged
    assert ring.energy == pytest.approx(2 * np.pi**2, rel=1e-6)
    critical = 2 * np.pi * np.sqrt(3) / 0.7
    twists = critical * np.array([0.15, 0.3, 0.45, 0.6, 0.75, 0.85, 0.93, 0.97])
    shapes = direct.track([HERE] * 8, initial=ring, far_ends=[turned(a) for a in twists])
    for twist, shape in zip(twists, shapes, strict=True):
        assert shape.converged and not shape.jumped
        flat = np.linalg.svd(shape.positions - shape.positions.mean(axis=0))[1][2]
        assert flat < 1e-3
        assert shape.energy == pytest.approx(2 * np.pi**2 + 0.35 * twist**2, rel=1e-3)
    beyond = direct.track([HERE], initial=shapes[-1], far_ends=[turned(1.04 * critical)])[0]
    assert beyond.jumped
    assert beyond.energy < 0.5 * shapes[-1].energy


def test_twist_beyond_half_a_turn_is_followed_not_forgotten():
    direct = simulator()
    shapes = direct.track([HERE] * 4, far_ends=[turned(a, 0.9) for a in (1.5, 3.0, 4.5, 6.0)])
    torsion = [shape.element_strains[:, 0].mean() for shape in shapes]
    assert torsion == sorted(torsion)
    assert torsion[-1] > 3.0  # a pose alone would have been read as -0.28 rad


# ------------------------------------------------------------------------------------------------
# Both ends held over obstacles, wherever the DLO without them would lie.


PEG = Capsule((0.4, -1, -0.25), (0.4, 1, -0.25), 0.05)
DEEP = (6, 8)  # poses in which a cable alone hangs through the peg's middle


def dense(shape):
    """Return (n, 3) points along the axis of a Shape, twenty in an element."""
    return np.array([shape.at(s).position
                     for one, other in pairwise(shape.s)
                     for s in np.linspace(one, other, 20, endpoint=False)] + [shape.positions[-1]])


def check_laws(rod, shape):
    """Contacts push, along the normal; forces and moments of all that acts balance."""
    weight = rod.mass_per_length * 9.81 * rod.length
    middle = 0.5 * (shape.positions[1:] + shape.positions[:-1])
    force = shape.gripper_wrench[:3] + shape.far_wrench[:3] - np.array([0, 0, weight])
    moment = (shape.gripper_wrench[3:] + shape.far_wrench[3:]
              + np.cross(shape.positions[-1] - shape.gripper.position, shape.far_wrench[:3])
              + np.cross((middle.T @ np.diff(shape.s)) / rod.length - shape.gripper.position,
                         (0, 0, -weight)))
    for contact in shape.contacts:
        assert contact.force > 0.0
        force += contact.vector
        moment += np.cross(contact.position - shape.gripper.position, contact.vector)
    np.testing.assert_allclose(force, 0, atol=1e-6 * weight)
    np.testing.assert_allclose(moment, 0, atol=1e-4 * weight)


@pytest.mark.every(2)
@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
@pytest.mark.parametrize('load', [1e3, 1e4])
def test_a_cable_that_would_hang_through_a_peg_lies_on_it(load, basis):
    rod = cable(load)
    direct = DirectSimulator(rod, basis=basis, obstacles=(PEG,))
    for index, (gripper, end) in enumerate(poses(max(DEEP) + 1)):
        if index not in DEEP:
            continue
        alone = direct.without_obstacles().solve(gripper, far_end=end)
        assert np.hypot(*(dense(alone) - PEG.start)[:, [0, 2]].T).min() < 0.5 * PEG.radius
        shape = direct.solve(gripper, far_end=end)
        assert shape.converged and shape.stability > 0.0 and shape.contacts
        away = np.hypot(*(dense(shape) - PEG.start)[:, [0, 2]].T)
        assert away.min() > PEG.radius + rod.radius - 1e-5  # a node bears, its neighborhood sags
        check_laws(rod, shape)


@pytest.mark.parametrize('obstacle', [
    Sphere((0.35, 0, -0.25), 0.1), Capsule((0.35, -1, -0.25), (0.35, 1, -0.25), 0.045)],
    ids=['sphere', 'bar'])
def test_a_cable_is_set_down_on(obstacle):
    rod = cable(1e3)
    direct = DirectSimulator(rod, basis='local', obstacles=(obstacle,))
    shape = direct.solve(HERE, far_end=Pose((0.75, 0, 0), (0, 0, 0, 1)))
    assert shape.converged and shape.contacts
    assert shape.violation < 1e-8
    check_laws(rod, shape)


@pytest.mark.parametrize(('grip', 'stiffness', 'end', 'height'), [
    ('pinned', 1.0, (0.8, 0.1, 0.95), 0.85), ('clamped', 0.05, (0.825, 0.078, 0.9485), 0.8579)])
def test_a_mesh_that_begins_deep_inside_a_bar_comes_out(grip, stiffness, end, height):
    rod = Rod(1.0, 0.1, stiffness, 0.8 * stiffness, radius=0.005)
    floor = Plane((0, 0, 0.8), (0, 0, 1))
    bar = Capsule((0.5, -1, height), (0.5, 1, height), 0.05)
    direct = DirectSimulator(rod, accuracy=1e-4, grip=grip, obstacles=[floor, bar])
    level = Pose((0, 0, 1), (0, 0, 0, 1))
    shape = direct.solve(level, far_end=end if grip == 'pinned' else Pose(end, (0, 0, 0, 1)))
    assert shape.converged and shape.contacts and shape.violation < 1e-8
    if grip == 'clamped':  # pinned twice it would also turn about the line between its ends
        assert shape.stability > 0.0
    check_laws(rod, shape)


@pytest.mark.every(3)
@pytest.mark.parametrize('mesh', [{'n_elements': 32, 'basis': 'local'}, {'accuracy': 1e-3}])
@pytest.mark.parametrize('loads', [{}, {'gravity': (0, 0, 0), 'load': (0, 0, -0.5)}])
def test_what_hangs_through_a_box_is_laid_over_it(loads, mesh):
    rod = Rod(0.6, 0.05, 0.02, 0.016, radius=2e-3)
    box = Box(Pose((0.25, 0, 0), (0, 0, 0, 1)), (0.15, 0.3, 0.2))
    direct = DirectSimulator(rod, obstacles=[box], **loads, **mesh)
    gripper, end = (Pose((place, 0, 0.12), (0, 0, 0, 1)) for place in (0.0, 0.5))
    shape = direct.solve(gripper, far_end=end)
    assert shape.converged and shape.stability > 0.0 and shape.contacts, shape.status
    x, y, z = dense(shape).T
    over = (np.abs(x - 0.25) < 0.075) & (np.abs(y) < 0.15)
    assert over.any() and z[over].min() > 0.1 + rod.radius - 1e-5
    pushed = shape.gripper_wrench[2] + shape.far_wrench[2] + sum(
        contact.vector[2] for contact in shape.contacts)
    assert pushed == pytest.approx(0.6 * (0.5 if loads else 0.05 * 9.81), rel=1e-6)


@pytest.mark.parametrize(('stiffness', 'span', 'obstacle'), [
    (1.4, 0.84, Cylinder((0.33, -0.5, -0.346), (0.51, 0.5, -0.346), 0.084)),
    (0.3, 0.67, Sphere((0.335, 0, -0.562), 0.2)),
    (1.35, 0.644, Box(Pose((0.31, -0.02, -0.4046), (-0.2, 0.1, -0.05, 0.97)), (0.16, 0.4, 0.1)))],
    ids=['bar', 'sphere', 'box'])
def test_a_bow_between_two_grips_is_lowered_onto(stiffness, span, obstacle):
    rod = Rod(1.0, 0.05, stiffness, 0.4, radius=0.01 if isinstance(obstacle, Sphere) else 5e-4)
    direct = DirectSimulator(rod, obstacles=[obstacle])
    heights = np.linspace(0.0, -0.06, 5)
    first, last = ([Pose((x, 0, z), (0, turn, 0, 0.98)) for z in heights]
                   for x, turn in ((0.0, 0.199), (span, -0.199)))
    shapes = direct.track(first, far_ends=last)
    assert shapes[-1].contacts
    for shape in shapes:
        assert shape.converged and not shape.jumped and shape.violation < 1e-8
        assert shape.iterations < 100  # by turns it goes on without an end
        if shape.contacts:
            check_laws(rod, shape)


def test_an_obstacle_that_is_not_touched_changes_nothing():
    direct = DirectSimulator(cable(1e3, 1e-4), basis='local', obstacles=(PEG,))
    for gripper, end in poses(3):
        shape = direct.solve(gripper, far_end=end)
        alone = direct.without_obstacles().solve(gripper, far_end=end)
        assert shape.converged and alone.converged and not shape.contacts
        np.testing.assert_allclose(shape.positions, alone.positions, atol=1e-6)


def test_what_does_not_come_out_of_an_obstacle_says_of_which():
    wall = Sheet(Pose((0.35, 0, 0), (0, 0, 0, 1)), 3.0, 3.0, 4e-3, name='wall between both grips')
    direct = DirectSimulator(cable(10.0), basis='local', n_elements=24, obstacles=[
        Plane((0, 0, -5), (0, 0, 1)), wall])
    shape = direct.solve(HERE, far_end=Pose((0.7, 0, 0), (0, 0, 0, 1)))
    assert not shape.converged
    assert 'inside wall between both grips and does not come out' in shape.status


# ------------------------------------------------------------------------------------------------
# The way to where a step begins: in so many parts, and what is said where that is not enough.


STRIP = Rod.rectangular(length=0.6, width=0.012, thickness=6e-4, density=7850.0,
                        youngs_modulus=200e9, poisson_ratio=0.3)
HOLE = CutOut(Pose((0.380741, 0.0566812, 0.919323), (-0.013, 0.175, 0.0727, 0.9818)),
              width=0.03, height=0.02)
BAR = Capsule((0.267433, -0.160187, 0.913228), (0.267433, 0.239813, 0.913228), 0.01)


def grippers(count):
    """Return poses that move a strip, which hangs through a hole, toward the hole's rim."""
    return [Pose((-0.003 * k, 0.007 * k, 1 + 0.001 * k),
                 (0.0027 - 0.00127 * k, -0.0358 - 0.00444 * k, 0.0738 - 0.00545 * k, 0.9966))
            for k in range(count)]


def test_what_takes_too_many_parts_is_given_up_and_said(monkeypatch):
    made, relax = [], placement.minimum

    def counted(*arguments):
        made.append(None)
        return relax(*arguments)
    monkeypatch.setattr(placement, 'minimum', counted)
    among = DirectSimulator(STRIP, obstacles=[Sheet.around(HOLE, thickness=0.0), BAR])
    start, *before, last = grippers(4)
    shape = DirectSimulator(STRIP).solve(start)
    for gripper in before:
        shape = among.solve(gripper, shape)
    made.clear()
    arrived = among.solve(last, shape)
    assert arrived.converged and not arrived.jumped and len(made) > 100  # along the rim
    monkeypatch.setattr(placement, '_MORE_SEARCHES', 20)
    made.clear()
    stuck = among.solve(last, shape)
    assert len(made) == 21
    assert not stuck.converged or stuck.jumped
