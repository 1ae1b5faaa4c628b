# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that loses its hold says so, whatever the step; what a step alone would lose is held."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from references.friction import column
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from scipy.spatial.transform import Rotation
from sweeps.contact import FALLS_ON, fallen, random_way

from dlo_planner import Capsule, DirectSimulator, Plane, Pose, Rod, Sheet, Sphere
from dlo_planner.direct.continuation import fell
from dlo_planner.direct.statics import step

LEVEL = (0.0, 0.0, 0.0, 1.0)


def drawn_back(weight, step):
    """Return the Shapes of a wire that is lowered over a bar and drawn back by 0.4 m in steps."""
    rod = Rod(1.0, weight / 9.81, 1.0, 0.75, radius=2e-3)
    bar = Capsule((0.9, -0.5, -0.05), (0.9, 0.5, -0.05), 0.02)
    down = [Pose((0, 0, z), LEVEL) for z in np.arange(0.1, -1e-9, -step)]
    back = [Pose((-step * k, 0, 0), LEVEL) for k in range(1, round(0.4 / step) + 1)]
    return DirectSimulator(rod, obstacles=[bar]).track(down + back)


@pytest.mark.parametrize('weight', [1.2, 3.0])
@pytest.mark.parametrize('step', [0.02, 0.1, 0.2])
def test_an_end_that_slips_off_a_bar_falls_and_says_so(weight, step):
    shapes = drawn_back(weight, step)
    assert all(shape.converged for shape in shapes)
    touches = [bool(shape.contacts) for shape in shapes]
    last = max(k for k, touch in enumerate(touches) if touch)
    assert [k for k, shape in enumerate(shapes) if shape.jumped] == [last + 1]
    # it falls where it does in steps of 5 mm, up to a step
    fine = drawn_back(weight, 0.005)
    at, = (shape.gripper.position[0] for shape in fine if shape.jumped)
    assert shapes[last + 1].gripper.position[0] <= at <= shapes[last].gripper.position[0]


def test_what_it_hung_on_within_a_step_is_met():
    # neither before nor after does it touch the bar from which it slips in between
    rod = Rod(1.0, 0.3, 1.0, 0.75, radius=2e-3)
    simulator = DirectSimulator(rod, obstacles=[Capsule((0.9, -0.5, 0), (0.9, 0.5, 0), 0.02)])
    above = simulator.solve(Pose((0, 0, 0.6), LEVEL))
    below = simulator.solve(Pose((0, 0, -0.8), LEVEL), above)
    assert not above.contacts and not below.contacts
    assert below.converged and below.jumped


@pytest.mark.parametrize(('scene', 'kind'), [(58, 'converged'), (91, 'jumped')])
def test_a_light_contact_leaps_to_no_other_branch_in_silence(scene, kind):
    # a wire over a ball, in one step round to its other side; and off it, with hardly any energy
    way = random_way(np.random.default_rng((0, scene)))
    assert fallen(*way, FALLS_ON[scene % 4]) == kind


@pytest.mark.sweep
def test_a_column_buckles_in_short_steps():
    # the plane in which it does is nearly neutral
    assert column(0.2, 0.002, {'basis': 'local', 'n_elements': 32}, 0.01) == (0.0, '')


def slip_of_an_elastica(mu, tilt):
    """Return how far a straight rod can be pressed on a plane until friction mu holds no more."""
    def end(unknown, pressed):
        moment, along, up = unknown

        def rates(_, y):  # x along the plane, z up; the angle is from straight down
            return [np.sin(y[2]), -np.cos(y[2]), y[3], -along * np.cos(y[2]) - up * np.sin(y[2])]

        return solve_ivp(rates, (0, 1), [0, 1 - pressed, tilt, moment], rtol=1e-10,
                         atol=1e-12).y[:, -1]

    tip = np.sin(tilt)
    guess = np.array([-2.0, -2.0, 20.0])  # it bows to the side to which it is tilted

    def ratio(pressed):
        nonlocal guess
        guess, _, fine, _ = fsolve(lambda u: (end(u, pressed) - [tip, 0, 0, 0])[[0, 1, 3]], guess,
                                   full_output=True, xtol=1e-11)
        return abs(guess[1] / guess[2])

    pressed = 0.05
    while ratio(pressed) < mu:
        pressed += 0.01
    return brentq(lambda p: ratio(p) - mu, pressed - 0.01, pressed, xtol=1e-6)


@pytest.mark.every(6)
@pytest.mark.parametrize('how', [{'basis': 'local', 'n_elements': 64}, {'accuracy': 1e-5}])
@pytest.mark.parametrize(('mu', 'step'), [(0.2, 0.01), (0.3, 0.01), (0.3, 0.02)])
def test_a_column_slips_in_the_step_in_which_its_friction_ends(mu, step, how):
    turn = Rotation.from_euler('y', np.pi / 2 + 1e-3).as_quat()
    simulator = DirectSimulator(Rod(1.0, 1e-9, 1.0, 0.8), **how,
                                obstacles=[Plane((0, 0, 0), (0, 0, 1), mu)])
    shape = simulator.solve(Pose((0, 0, 1.002), turn))
    expected = slip_of_an_elastica(mu, 1e-3)
    for pressed in np.arange(0, 0.4, step):
        before, shape = shape, simulator.solve(Pose((0, 0, 1 - pressed), turn), shape)
        assert shape.converged
        if before.contacts and abs(shape.positions[-1, 0] - before.positions[-1, 0]) > 3e-3:
            break
    assert shape.jumped
    assert pressed - step - 0.02 * expected <= expected <= pressed + 0.02 * expected


CORNERS = {  # weight, sheet's place, attitude and thickness, gripper's turn about y, way
    'one step of twenty': (1.223, (0.7799, -0.0891, -0.5610), (0.1193, -0.1389, 0.1745, 0.9675),
                           0.0, 0.3910, (-0.0015, -0.0371, -0.0150)),
    'one step': (2.788, (0.34209, 0.095373, -0.0975478),
                 (-0.073439, 0.234179, 0.0525565, 0.96799), 0.0, -0.35815,
                 (0.01038278, -0.01648743, -0.03493369))}


@pytest.mark.parametrize('corner', list(CORNERS))
def test_on_a_corner_the_branch_is_the_same_in_any_steps(corner):
    # in these steps the contact of a wire would turn over the outer corner of a rough sheet
    weight, place, attitude, thickness, turn, way = CORNERS[corner]
    level = Rotation.from_euler('y', turn).as_quat()
    sheet = Sheet(Pose(place, attitude), 0.3, 0.3, thickness, (), friction=0.3)
    simulator = DirectSimulator(Rod(1.0, weight / 9.81, 1.0, 0.75, radius=2e-3), basis='local',
                                n_elements=200, obstacles=[sheet])
    begin = simulator.track([Pose((0, 0, z), level) for z in (0.0, -0.02, -0.04)])[-1]
    ends = []
    for steps in (1, 2, 4, 20, 80):
        parts = np.linspace(0, 1, steps + 1)[1:, None]
        shapes = simulator.track([Pose(one, level) for one in (0, 0, -0.04) + parts * way],
                                 initial=begin)
        assert not any(shape.jumped for shape in shapes)
        ends.append(shapes[-1].positions[-1])
    # friction knows the way of a step by its ends alone: what that is off by falls with the steps
    away = np.linalg.norm(np.subtract(ends, ends[-1]), axis=1)
    assert away[0] < 2.5e-3
    assert (away[1:-1] < 0.6 * away[:-2]).all()


def test_a_bow_that_may_turn_about_its_chord_is_followed_in_small_steps():
    # its eigenvalue there is 1e-5, of either sign: a descent creeps along that until it is given up
    assert column(0.2, 0.001, {'basis': 'local', 'n_elements': 64}, 0.006) == (0.0, '')


def test_what_friction_takes_is_no_fall():
    # a weight is drawn over a bar: what the gripper's work does not raise it by friction takes
    radius, thin = 0.1, 5e-4
    bar = Capsule((0, -0.3, -radius - thin), (0, 0.3, -radius - thin), radius, 0.3)
    rod = Rod(1.0, 0.0, 5e-3, 5e-3, radius=thin, tip_mass=1 / 9.81)
    direct = DirectSimulator(rod, basis='local', n_elements=64, obstacles=[bar])
    way = [Pose((-0.3, 0, z), LEVEL) for z in np.linspace(0.14, 0.0, 8)]
    way += [Pose((-0.3 - x, 0, 0), LEVEL) for x in (0.01, 0.02)]
    before = direct.track(way)[-1]
    after = step(direct.mesh, Pose((-0.324, 0, 0), LEVEL), before)
    pull = 0.5 * (before.gripper_wrench + after.gripper_wrench)[:3]
    taken = (before.energy - after.energy
             + float(pull @ (after.gripper.position - before.gripper.position)))
    assert taken > 1e-3 and after.converged and not after.state.kicks
    assert after.history.friction_work == pytest.approx(taken, rel=0.02)
    assert not fell(before, after)
    assert fell(before, replace(after, energy=after.energy - taken))


@pytest.mark.parametrize(('how', 'mu'), [
    ({'n_elements': 96, 'basis': 'local'}, 0.0), ({}, 0.0), ({}, 0.3)])
def test_a_light_fall_of_a_stiff_wire_between_two_grips_is_said(how, mu):
    # bent by its grips it holds 1 J, and falls off a ball for less than 1e-4 J: less than a finer
    # mesh, to which the fall leads, makes of it
    wire = Rod.circular(0.6, 2e-3, 8960.0, 110e9, 0.34)
    simulator = DirectSimulator(wire, **how, obstacles=[Sphere((0.25, 0.01, 0.2), 0.05, mu)])
    here = Pose((0, 0, 0.3), LEVEL)
    ways = [np.linspace((0.5, 0.06, 0.36), (0.5, 0, 0.36), 3),  # past one side of the ball
            np.linspace((0.5, 0, 0.36), (0.5, 0.0131, 0.305), 6),
            np.linspace((0.5, 0.0131, 0.305), (0.5, 0.0163, 0.2918), 120)]
    shape, falls, places = None, 0, np.linspace(0, 0.6, 50)
    for way in ways:
        far_ends = [Pose(place, LEVEL) for place in way]
        shapes = simulator.track([here] * len(way), far_ends=far_ends, initial=shape)
        shape = shapes[-1]
    for before, after in pairwise(shapes):
        moved = np.linalg.norm(after.positions_at(places) - before.positions_at(places), axis=1)
        assert after.converged and (after.jumped or moved.max() < 3e-3)
        falls += after.jumped
    assert falls == 1 and not shape.contacts


def test_what_a_finer_mesh_takes_from_the_energy_is_no_fall():
    # the shape before is one of 16 elements, which are too stiff by 1 % of its energy
    wire, ball = Rod.circular(0.6, 2e-3, 8960.0, 110e9, 0.34), Sphere((0.25, 0.01, 0.2), 0.05)
    coarse, fine = (DirectSimulator(wire, n_elements=n, basis='local', obstacles=[ball])
                    for n in (16, 160))
    here = Pose((0, 0, 0.3), LEVEL)
    before = coarse.solve(here, far_end=Pose((0.5, 0, 0.36), LEVEL))
    after, = fine.track([here], initial=before, far_ends=[Pose((0.5, 0, 0.35), LEVEL)])
    assert before.contacts and after.contacts and after.converged and not after.jumped
