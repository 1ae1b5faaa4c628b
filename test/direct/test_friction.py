# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Coulomb's law in every shape: where a tip lets go (the elastica), what sticks, what slides."""

import pickle
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from scipy.spatial.transform import Rotation
from sweeps.contact import DRAWN_ON, drawn, random_scene

from dlo_planner import Box, Capsule, DirectSimulator, FarEnd, Plane, Pose, Rod
from dlo_planner.direct.equilibrium import AlongWay, corrected_by
from dlo_planner.direct.sensitivity import Sensitivity

THIN = 5e-4
ROD = Rod(1.0, 0.0, 1.0, 0.8, radius=THIN)
LEVEL = (0.0, 0.0, 0.0, 1.0)


@cache
def on_its_tip(mu, steepness, pressed, n_elements=64):
    """Return a simulator of a weightless rod over a floor, its last Shape, height and attitude.

    The gripper points down by an angle (degrees) and goes down until the rod is pressed so far.
    """
    angle = np.radians(steepness)
    attitude = Rotation.from_euler('y', angle).as_quat()
    simulator = DirectSimulator(ROD, basis='local', n_elements=n_elements, gravity=(0, 0, 0),
                                obstacles=[Plane((0, 0, 0), (0, 0, 1), mu)])
    heights = np.linspace(np.sin(angle) + THIN + 0.005, np.sin(angle) + THIN - pressed,
                          int(pressed / 0.01) + 1)
    shapes = simulator.track([Pose((0, 0, z), attitude) for z in heights])
    assert all(shape.converged for shape in shapes)
    return simulator, shapes[-1], heights[-1], attitude


def pinned(x, height, angle, tip, guess):
    """Return moment at the gripper and force (x, z) on the tip of an elastica pinned there."""
    def miss(unknown):
        moment, along, up = unknown

        def rates(_, y):
            return [np.cos(y[2]), np.sin(y[2]), y[3], along * np.sin(y[2]) - up * np.cos(y[2])]

        end = solve_ivp(rates, (0, 1), [x, height, -angle, moment], rtol=1e-10, atol=1e-12).y[:, -1]
        return [end[0] - tip, end[1], end[3]]

    found, _, fine, text = fsolve(miss, guess, xtol=1e-12, full_output=True)
    # (what is found to the integration's rounding errors makes no good progress)
    assert fine == 1 or np.abs(miss(found)).max() < 1e-9, text
    return found


def lets_go(mu, shape, height, steepness, sign, step=2e-3):
    """Return how far the gripper of a Shape can go until the elastica's tip slips."""
    angle, tip = np.radians(steepness), shape.positions[-1, 0]
    force = shape.contacts[-1].vector
    guess = pinned(0, height - THIN, angle, tip, (-shape.strains[0, 1], force[0], force[2]))
    # the limit it is at already, having slid there, is not the one it will reach
    at = np.sign(guess[1])

    def excess(way):
        nonlocal guess
        guess = pinned(sign * way, height - THIN, angle, tip, guess)
        return max(abs(guess[1]) if np.sign(guess[1]) != at or abs(ratio) < 0.99 * mu else 0,
                   0) - mu * guess[2]

    ratio = guess[1] / guess[2]
    way = step
    while excess(way) < 0:
        way += step
    return brentq(excess, way - step, way, xtol=1e-8)


def ratio_of(shape):
    return max((np.linalg.norm(contact.friction) / contact.force for contact in shape.contacts),
               default=0.0)


@pytest.mark.every(3)
@pytest.mark.parametrize('step', [0.01, 0.002])
@pytest.mark.parametrize('mu', [0.2, 0.3])
def test_a_tip_that_sticks_slips_where_the_elastica_says(mu, step):
    # pressed down it has slid outwards; drawn back it sticks, until it slides the other way
    simulator, shape, height, attitude = on_its_tip(mu, 80.0, 0.4)
    assert ratio_of(shape) == pytest.approx(mu, rel=1e-6)
    tip, way, moved = shape.positions[-1, 0], 0.0, 0.0
    expected = lets_go(mu, shape, height, 80.0, -1)
    while moved == 0.0:
        way += step
        shape = simulator.solve(Pose((-way, 0, height), attitude), shape)
        assert shape.converged and not shape.jumped
        assert ratio_of(shape) <= mu * (1 + 1e-6)
        moved = shape.positions[-1, 0] - tip
        if abs(moved) < 1e-9:
            moved = 0.0
            assert ratio_of(shape) < mu
    assert shape.contacts[0].friction[0] > 0
    assert way + moved == pytest.approx(expected, rel=0.02)  # it follows the gripper from there on


@pytest.mark.sweep
def test_a_tip_that_lets_go_leaps_and_says_so():
    # a column that has buckled over its tip: no equilibrium is near when it slips
    mu = 0.3
    simulator, shape, height, attitude = on_its_tip(mu, 89.9, 0.2)
    tip, last = shape.positions[-1, 0], 0.0
    expected = lets_go(mu, shape, height, 89.9, -1)
    for way in np.arange(1, 40) * 0.01:
        shape = simulator.track([Pose((-way, 0, height), attitude)], initial=shape)[0]
        assert ratio_of(shape) <= mu * (1 + 1e-6)
        if shape.jumped or not shape.converged:
            break
        assert abs(shape.positions[-1, 0] - tip) < 1e-9
        last = way
    assert shape.jumped and abs(shape.positions[-1, 0] - tip) > 0.1
    assert last <= 1.02 * expected and last + 0.01 >= 0.98 * expected


def test_what_sticks_goes_back_to_where_it_was():
    simulator, first, height, attitude = on_its_tip(0.3, 80.0, 0.4)
    there = simulator.solve(Pose((-0.003, 0, height), attitude), first)
    assert ratio_of(there) < 0.29
    back = there
    for _ in range(3):
        back = simulator.solve(Pose((-0.003, 0, height), attitude), back)
        np.testing.assert_allclose(back.positions, there.positions, atol=1e-12)
    for _ in range(3):
        away = simulator.solve(Pose((-0.002, 0, height), attitude), back)
        back = simulator.solve(Pose((-0.003, 0, height), attitude), away)
    np.testing.assert_allclose(back.positions, there.positions, atol=1e-9)


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_each_contact_of_a_groove_has_its_own_friction(wire, basis):
    groove = [Plane((0, 0, 0), (0, sign, 1), mu) for sign, mu in ((1, 0.3), (-1, 0.1))]
    simulator = DirectSimulator(wire, basis=basis, obstacles=groove)
    height = np.sqrt(2) * wire.radius + 1e-3
    shapes = simulator.track([Pose((0, 0, z), LEVEL) for z in (0.05, 0.02, height)])
    for x in (-0.002, -0.01):
        shape = simulator.solve(Pose((x, 0, height), LEVEL), shapes[-1])
        assert shape.converged
        both = {contact.obstacle for contact in shape.contacts}
        assert both == {0, 1}
        for contact in shape.contacts:
            mu = groove[contact.obstacle].friction
            size = np.linalg.norm(contact.friction)
            assert size <= mu * contact.force * (1 + 1e-6)
            assert abs(contact.friction @ contact.normal) < 1e-9 * contact.force
    for contact in shape.contacts:  # all of it slides now
        mu = groove[contact.obstacle].friction
        assert np.linalg.norm(contact.friction) == pytest.approx(mu * contact.force, rel=1e-5)


@pytest.mark.parametrize('scene', [69, 112, pytest.param(67, marks=pytest.mark.sweep)])
def test_contacts_that_pass_from_element_to_element_keep_the_law(scene):
    # drawn over thin bars and balls: most steps carry the contact past nodes, all with friction
    rng = np.random.default_rng((0, scene))
    found = [one.what for one in drawn(*random_scene(rng, DRAWN_ON[scene % 4]))]
    assert found.count('converged') > 4
    assert set(found) <= {'converged', 'away'}


@pytest.mark.parametrize('basis', ['local', 'chebyshev'])
def test_an_edge_and_a_floor_hold_back_what_slides_against_its_way(wire, basis):
    turn = (Rotation.from_euler('z', 35, degrees=True) * Rotation.from_euler('y', 20, degrees=True))
    box = Box(Pose((0.4, 0, 0.6), turn.as_quat()), (0.2, 0.3, 0.1), 0.3)
    simulator = DirectSimulator(wire, basis=basis, obstacles=[box])
    shape, slid = None, 0
    for z in np.arange(0.98, 0.80, -0.02):
        before, shape = shape, simulator.solve(Pose((0, 0, z), LEVEL), shape)
        assert shape.converged
        assert ratio_of(shape) <= 0.3 * (1 + 1e-6)
        for contact in shape.contacts if before is not None else ():
            way = shape.positions_at([contact.s])[0] - before.positions_at([contact.s])[0]
            way -= (way @ contact.normal) * contact.normal
            if np.linalg.norm(contact.friction) > 0.2999 * contact.force and before.contacts:
                slid += 1
                assert contact.friction @ way < -0.99 * np.linalg.norm(
                    contact.friction) * np.linalg.norm(way)
    assert slid > 2


def test_where_a_wire_slides_over_a_bar_errors_go_with_the_square_of_the_elements():
    # it bends nearly as the bar does: on short elements, too, it bears at one point, which rolls
    bar = Capsule((0, -0.3, -0.1 - THIN), (0, 0.3, -0.1 - THIN), 0.1, 0.3)
    rod = Rod(1.0, 0.0, 5e-3, 5e-3, radius=THIN, tip_mass=0.1)
    ends = {}
    for n in (125, 250, 1000):
        simulator, shape = DirectSimulator(rod, basis='local', n_elements=n, obstacles=[bar]), None
        for z in (0.14, 0.13, 0.12, 0.11, 0.10):
            shape = simulator.solve(Pose((-0.3, 0, z), LEVEL), shape)
        assert shape.converged and len(shape.contacts) == 1
        assert ratio_of(shape) == pytest.approx(0.3, rel=1e-6)
        ends[n] = shape
    coarse, fine = (np.abs(ends[n].positions - ends[1000].positions[::1000 // n]).max()
                    for n in (125, 250))
    assert fine < 0.3 * coarse and fine < ends[250].error_estimate < 2 * fine


@pytest.mark.parametrize('way', [0.001, 0.008], ids=['sticking', 'sliding'])
def test_sensitivities_of_what_sticks_and_of_what_slides(way):
    simulator, before, height, attitude = on_its_tip(0.3, 80.0, 0.4)
    gripper = Pose((-way, 0, height), attitude)
    shape = simulator.solve(gripper, before)
    assert (ratio_of(shape) > 0.2999) == (way > 0.007)
    answer, step, slopes = Sensitivity(shape), 1e-6, np.zeros((3, 6))
    for k, twist in enumerate(step * np.eye(6)):
        up, down = (simulator.solve(Pose.from_rotation(
            gripper.position + sign * twist[3:],
            Rotation.from_rotvec(sign * twist[:3]).as_matrix() @ gripper.rotation),
            before).positions_at([0.5])[0] for sign in (1, -1))
        slopes[:, k] = (up - down) / (2 * step)
    np.testing.assert_allclose(answer.at(0.5)[3:], slopes, atol=2e-3)


def test_an_estimate_that_ends_elsewhere_is_no_estimate(wire):
    # dragged to the limit of friction over a corner, the finer DLO may let go: never a small number
    turn = Rotation.align_vectors([[0, 0, 1]], [[1, 1, 1]])[0]
    box = Box(Pose((0.45, 0.03, 0.55), turn.as_quat()), (0.2, 0.2, 0.2), 0.3)
    simulator = DirectSimulator(wire, basis='local', n_elements=32, obstacles=[box])
    fine = DirectSimulator(wire, basis='local', n_elements=64, obstacles=[box])
    shape = other = None
    for z in np.arange(0.98, 0.86, -0.03):
        gripper = Pose((0, 0, z), LEVEL)
        shape, other = simulator.solve(gripper, shape), fine.solve(gripper, other)
        away = np.abs(shape.positions - other.positions[::2]).max()
        assert shape.error_estimate > 0.02 * away or away < 1e-4


@pytest.mark.parametrize('obstacle', [Capsule((0.55, -0.5, 0.72), (0.55, 0.5, 0.72), 0.03, 0.3),
                                      Plane((0, 0, 0.75), (0, 0, 1), 0.3)])
def test_one_step_on_halved_elements_tells_what_all_steps_do_where_it_slides(wire, obstacle):
    simulator = DirectSimulator(wire, basis='local', n_elements=24, obstacles=[obstacle])
    places = [(0, 0, 1.05), (0, 0, 0.99), (0, 0, 0.97), (-0.03, 0.02, 0.97), (-0.05, 0.03, 0.97)]
    slid = []
    for shape in simulator.track([Pose(place, LEVEL) for place in places]):
        assert corrected_by(shape.mesh, shape, shape.history) == pytest.approx(
            shape.error_estimate, rel=0.03)
        slid.append(any(np.linalg.norm(contact.friction) > 0.299 * contact.force
                        for contact in shape.contacts))
    assert sum(slid) >= 3


CABLE = Rod(1.0, 0.035, 1.2e-3, 9e-4, radius=0.0025)


def errors_by_one_step(poses, ends=None):
    """Return (n,) what one step on halved elements tells of lying Shapes, of what all steps do."""
    direct = DirectSimulator(CABLE, basis='local', n_elements=64,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    shapes = direct.track(poses, far_ends=ends and [ends] * len(poses))
    return np.array([corrected_by(shape.mesh, shape, shape.history) / error_of_mesh(shape)
                     for shape in shapes if len(shape.contacts) > 4])


def error_of_mesh(shape):
    """Return the error of a Shape without that of its way, m."""
    estimate = shape.state.estimate
    return estimate.on_mesh() if isinstance(estimate, AlongWay) else estimate()


def test_one_step_on_halved_elements_tells_what_all_steps_do_of_a_cable_that_is_drawn():
    # what it was before the step decides which way its friction acts
    down = [Pose((0, 0, z), (0, 0.17, 0, 0.985)) for z in np.linspace(0.2, 0.04, 9)]
    drawn = [Pose((-0.02 * k, 0.02 * k, 0.04), (0, 0.17, 0, 0.985)) for k in range(1, 9)]
    ratios = errors_by_one_step(down + drawn)
    assert ratios.size >= 12
    assert ratios.min() > 0.5 and ratios.max() < 2.0 and abs(np.median(ratios) - 1.0) < 0.1


@pytest.mark.parametrize('way', [(-0.07, 0.07, 0.0), (0.0, 0.1, 0.0)], ids=['back', 'aside'])
def test_a_long_step_that_rubs_says_how_far_shorter_ones_end_from_it(way):
    direct = DirectSimulator(CABLE, basis='local', n_elements=64,
                             obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    attitude = (0, 0.17, 0, 0.985)
    down = [Pose((0, 0, z), attitude) for z in np.linspace(0.2, 0.04, 9)]
    lying = direct.track(down)[-1]
    goals = [Pose((0, 0, 0.04) + np.array(way) * part, attitude) for part in (1, *np.arange(
        1, 33) / 32)]
    long = direct.solve(goals[0], lying)
    shorter = direct.track(goals[1:], initial=lying)[-1]
    away = np.linalg.norm(long.positions - shorter.positions, axis=1).max()
    assert long.converged and not (long.jumped or shorter.jumped)
    assert 3e-4 < away < long.error_estimate < 4.0 * away
    assert pickle.loads(pickle.dumps(long)).error_estimate == long.error_estimate


def test_one_step_on_halved_elements_tells_what_all_steps_do_of_a_cable_in_two_grips():
    down = [Pose.looking_along((0, 0, z), (0.94, 0, -0.34)) for z in np.linspace(0.45, 0.25, 8)]
    ratios = errors_by_one_step(down, FarEnd(Pose((0.8, 0, 0.03), LEVEL)))
    assert ratios.size >= 4
    assert ratios.min() > 0.5 and ratios.max() < 2.0 and abs(np.median(ratios) - 1.0) < 0.1


@pytest.mark.parametrize('height', [0.12, 0.1, 0.08])
@pytest.mark.parametrize('way', [(0, 1, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)],
                         ids=['across', 'back', 'up', 'down'])
def test_a_wire_on_a_table_is_drawn_anywhere_in_few_steps_of_newton(wire, height, way):
    # what stuck slides, what slid turns over: with a stiff trial force Newton goes to and fro
    table = DirectSimulator(wire, basis='local', n_elements=64,
                            obstacles=[Plane((0, 0, 0), (0, 0, 1), 0.3)])
    shape = table.track([Pose((0, 0, z), LEVEL) for z in np.arange(0.3, height - 1e-3, -0.01)])[-1]
    assert len(shape.contacts) >= 5
    for k in range(1, 6):
        gripper = Pose((0, 0, height) + 1e-3 * k * np.array(way), LEVEL)
        before, shape = shape, table.solve(gripper, shape)
        assert shape.converged and not shape.jumped
        assert shape.iterations <= 12  # 40 to 90 where it does
        for one in shape.contacts:
            pushed = np.linalg.norm(one.friction)
            assert pushed <= 0.3 * one.force * (1 + 1e-9)
            slid = shape.at(one.s).position - before.at(one.s).position
            slid = slid - slid @ one.normal * one.normal
            if pushed < 0.299 * one.force:
                assert np.linalg.norm(slid) < 1e-8
            elif np.linalg.norm(slid) > 1e-6:
                against = -one.friction @ slid / (pushed * np.linalg.norm(slid))
                assert against > 0.999
