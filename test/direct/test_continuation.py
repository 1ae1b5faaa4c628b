# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Following: what the gripper's step explains is followed, what it does not is a jump."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, DirectSimulator, FarEnd, Pose, Rod
from dlo_planner.direct.continuation import fell, follow, shape_change
from dlo_planner.direct.grips import between
from dlo_planner.direct.shape import Contact, Feed

ROD = Rod(1.0, 0.0, 1.0, 0.7)
STRAIGHT = DirectSimulator(ROD, n_elements=16, gravity=(0, 0, 0)).solve(Pose.identity())


def pose(angle):
    return Pose((0, 0, 0), Rotation.from_rotvec([0, 0, angle]).as_quat())


def bent(gripper, angle):
    """Return a made-up Shape: beyond its middle the DLO is turned by `angle` against `gripper`."""
    turn = Rotation.from_rotvec([0, angle, 0]).as_matrix()
    frames = np.array([gripper.rotation @ (turn if s > 0.5 else np.eye(3)) for s in STRAIGHT.s])
    return replace(STRAIGHT, gripper=gripper, frames=frames)


def leaping(size, at=0.05):
    """Return an `equilibrium` whose shape changes by `size` once the gripper has turned by `at`."""
    def equilibrium(gripper, initial, holds, most=np.inf):
        turned = Rotation.from_matrix(np.array(gripper.rotation)).as_rotvec()[2]
        return bent(gripper, size if turned > at else 0.0)
    return equilibrium


@pytest.mark.parametrize('size', [0.3, 0.9, 2.0])
def test_a_leap_is_a_jump_however_small(size):
    before = bent(pose(0.0), 0.0)
    assert follow(leaping(size), before, pose(0.06)).jumped
    assert not follow(leaping(size), before, pose(0.04)).jumped


def test_a_quick_change_is_followed_in_smaller_steps():
    asked = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        turned = Rotation.from_matrix(np.array(gripper.rotation)).as_rotvec()[2]
        asked.append(turned)
        return bent(gripper, 8.0 * turned)  # 8 rad per rad, without a leap

    shape = follow(equilibrium, bent(pose(0.0), 0.0), pose(0.2))
    assert not shape.jumped and len(asked) > 4
    np.testing.assert_allclose(shape.gripper.matrix, pose(0.2).matrix, atol=1e-12)


@pytest.mark.parametrize('leaps', [(0.0512,), (0.0303,), (0.0303, 0.0802)])
def test_what_is_left_of_a_way_after_a_fall_is_made_at_once(leaps):
    ways = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        begin, turned = (Rotation.from_matrix(np.array(one.rotation)).as_rotvec()[2]
                         for one in (initial.gripper, gripper))
        ways.append((begin, turned))
        shape = bent(gripper, 0.9 * sum(turned > leap for leap in leaps))
        return replace(shape, state=replace(shape.state, culled=True))

    before, goal = bent(pose(0.0), 0.0), pose(0.1)
    shape = follow(equilibrium, before, goal)
    assert shape.jumped and shape.gripper is goal
    assert shape_change(shape, bent(goal, 0.9 * len(leaps))) < 1e-9
    after = [way for way in ways if leaps[0] < way[0] < 0.045 or way[0] > leaps[-1]]
    assert len(after) <= 4 + len(leaps)  # not one for each of the eleven halves of the way before


def test_no_attempt_is_made_at_what_has_been_found_to_fall():
    # all of a way falls, its first half does not: then the second one does
    asked = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        begin, turned = (Rotation.from_matrix(np.array(one.rotation)).as_rotvec()[2]
                         for one in (initial.gripper, gripper))
        asked.append((begin, turned, begin < 0.0687 < turned))
        return bent(gripper, 0.9 * (turned > 0.0687))

    assert follow(equilibrium, bent(pose(0.0), 0.0), pose(0.08)).jumped
    fell = {(round(begin, 9), round(turned, 9)) for begin, turned, falls in asked if falls}
    good = {(round(begin, 9), round(turned, 9)) for begin, turned, falls in asked if not falls}
    shortest = min(turned - begin for begin, turned in fell)
    for begin, turned in fell:
        middle = round(0.5 * (begin + turned), 9)
        if (begin, middle) in good and turned - begin > 2.1 * shortest:
            assert (middle, turned) not in fell
    assert len(asked) <= 18  # 22 with all of these attempts


def test_a_failure_on_the_way_is_not_passed_over():
    def equilibrium(gripper, initial, holds, most=np.inf):
        turned = Rotation.from_matrix(np.array(gripper.rotation)).as_rotvec()[2]
        return replace(bent(gripper, 0.0), converged=turned < 0.3)

    shape = follow(equilibrium, bent(pose(0.0), 0.0), pose(1.0))
    assert shape.jumped and not shape.converged


def test_where_nothing_on_the_way_is_found_the_step_is_made_at_once_to_its_end():
    # a search that may give up tells nothing of the shape that the DLO falls into
    def equilibrium(gripper, initial, holds, most=np.inf):
        turned = Rotation.from_matrix(np.array(gripper.rotation)).as_rotvec()[2]
        shape = bent(gripper, 1.0)
        if most < 1.0:
            return replace(shape, converged=False, residual=np.inf)
        return replace(shape, converged=turned > 0.15)

    shape = follow(equilibrium, bent(pose(0.0), 0.0), pose(0.2))
    assert shape.jumped and shape.converged and np.isfinite(shape.residual)


def touching(gripper, angle, obstacle):
    """Return a made-up Shape that touches an obstacle."""
    contact = Contact(obstacle, 1.0, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, np.zeros(3),
                      0.0)
    return replace(bent(gripper, angle), contacts=(contact,))


def test_where_a_contact_changes_half_steps_have_to_agree():
    def equilibrium(gripper, initial, holds, most=np.inf):
        away = np.linalg.norm(gripper.position - initial.gripper.position)
        return touching(gripper, 0.08, 1) if away > 0.015 else touching(gripper, 0.0, 0)

    shape = follow(equilibrium, touching(pose(0.0), 0.0, 0), Pose((0.02, 0, 0), (0, 0, 0, 1)))
    assert [contact.obstacle for contact in shape.contacts] == [0]
    assert shape_change(shape, bent(shape.gripper, 0.0)) < 1e-9


@pytest.mark.parametrize('leaps', [False, True])
def test_of_what_lies_a_half_that_changes_all_is_a_leap(leaps):
    def lying(gripper, angle):
        return replace(touching(gripper, angle, 0), contacts=4 * touching(gripper, 0.0, 0).contacts)

    asked = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        x = gripper.position[0]
        asked.append(x)
        return lying(gripper, 0.3 * (x > 0.0137) if leaps else 15.0 * x)

    shape = follow(equilibrium, lying(pose(0.0), 0.0), Pose((0.02, 0, 0), (0, 0, 0, 1)))
    assert shape.converged and shape.jumped == leaps
    assert leaps or asked == pytest.approx([0.01, 0.02])


def test_a_step_whose_parts_have_no_end_keeps_its_own_and_says_so():
    def equilibrium(gripper, initial, holds, most=np.inf):
        away = gripper.position[0] - initial.gripper.position[0]
        shape = touching(gripper, 0.0, 1 if away > 0.015 else 0)
        return replace(shape, converged=bool(away > 0.015 or gripper.position[0] < 0.015))

    shape = follow(equilibrium, touching(pose(0.0), 0.0, 0), Pose((0.02, 0, 0), (0, 0, 0, 1)))
    assert shape.converged and shape.jumped
    assert [contact.obstacle for contact in shape.contacts] == [1]


def test_what_leaps_in_one_half_of_a_step_is_looked_at_more_closely():
    # both halves lead to where the step does, but all of the change is in one of them
    def equilibrium(gripper, initial, holds, most=np.inf):
        here, there = initial.gripper.position[0], gripper.position[0]
        leapt = shape_change(initial, bent(initial.gripper, 0.0)) > 0.01
        if leapt or there - here > 0.004 and there > 0.012:
            return touching(gripper, 0.05, 1)
        return touching(gripper, 0.0, 0)

    shape = follow(equilibrium, touching(pose(0.0), 0.0, 0), Pose((0.02, 0, 0), (0, 0, 0, 1)))
    assert [contact.obstacle for contact in shape.contacts] == [0] and not shape.jumped


def test_a_contact_goes_in_a_short_step():
    steps = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        touches = gripper.position[0] < 0.013
        if initial.contacts and not touches:
            steps.append(gripper.position[0] - initial.gripper.position[0])
        return touching(gripper, 0.0, 0) if touches else bent(gripper, 0.04)

    shape = follow(equilibrium, touching(pose(0.0), 0.0, 0), Pose((0.02, 0, 0), (0, 0, 0, 1)))
    assert min(steps) < 2e-3
    assert shape.jumped and not shape.contacts  # by 0.04 rad in a step as short


def test_a_long_step_in_contact_is_cut():
    steps = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        steps.append(np.linalg.norm(gripper.position - initial.gripper.position))
        return touching(gripper, 0.0, 0)

    follow(equilibrium, touching(pose(0.0), 0.0, 0), Pose((0.2, 0, 0), (0, 0, 0, 1)))
    assert len(steps) >= 4
    assert max(steps) <= 0.05 + 1e-12


def test_a_dlo_in_contact_has_fallen_where_energy_is_missing():
    before = replace(touching(pose(0.0), 0.0, 0), energy=1.0)
    assert fell(before, replace(before, energy=0.5))
    assert not fell(before, replace(before, energy=1.0))


def test_change_of_shape_is_relative_to_the_gripper():
    one = bent(pose(0.0), 0.2)
    assert shape_change(one, bent(pose(1.3), 0.2)) == pytest.approx(0, abs=1e-7)
    assert shape_change(one, bent(pose(1.3), 0.7)) == pytest.approx(0.5)


def test_between_goes_the_short_way_in_place_and_turn():
    one, other = Pose((0, 0, 1), (0, 0, 0, 1)), Pose((1, 2, 1), pose(0.8).quaternion)
    third = between(one, other, 0.25)
    np.testing.assert_allclose(third.position, (0.25, 0.5, 1))
    np.testing.assert_allclose(third.rotation, pose(0.2).rotation, atol=1e-12)


@pytest.mark.parametrize(('stored', 'lost', 'jumped'), [
    (1.0, 0.0, False),   # all the work is stored
    (0.9, 0.0, False),   # the trapezoidal rule is not exact
    (0.5, 0.0, True),    # where is the rest?
    (0.3, 0.7, False),   # in plastic work
    (0.3, 0.2, True),
    (1.5, 0.0, False)])
def test_a_held_dlo_has_fallen_where_energy_is_missing(stored, lost, jumped):
    # the gripper moves by 0.1 m against a force that grows from 0 to 20 N: 1 J
    force = np.array([20.0, 0, 0, 0, 0, 0])
    before = replace(bent(pose(0.0), 0.0), energy=0.0, elastic_energy=0.1)
    there = Pose((0.1, 0, 0), (0, 0, 0, 1))
    end = FarEnd(Pose((1, 0, 0), (0, 0, 0, 1)))
    after = replace(bent(there, 0.0), energy=stored, gripper_wrench=force, dissipated=lost,
                    far_end=end)
    assert follow(lambda *_: after, before, there, (end,)).jumped == jumped
    kicked = replace(after, state=replace(after.state, kicks=1))
    assert follow(lambda *_: kicked, before, there, (end,)).jumped  # a kick is a fall as well


def test_a_far_end_works_too():
    # turned by 0.1 rad against a moment that grows from 10 to 30 N m: 2 J
    first, last = (np.array([0, 0, 0, 0, 0, moment]) for moment in (10.0, 30.0))
    end = FarEnd(Pose((1, 0, 0), pose(0.1).quaternion))
    before = replace(bent(pose(0.0), 0.0), energy=1.0, elastic_energy=0.1, far_end=end,
                     far_wrench=first)
    turned = np.array([pose(0.1).rotation] * len(STRAIGHT.s))
    after = replace(bent(pose(0.0), 0.0), energy=3.0, frames=turned, far_end=end,
                    far_wrench=last)
    for energy, jumped in ((3.0, False), (2.0, True)):
        shape = replace(after, energy=energy)
        assert follow(lambda *_, s=shape: s, before, pose(0.0), (end,)).jumped == jumped


@pytest.mark.parametrize('ends', [True, False])
def test_a_fall_along_an_obstacle_is_exact_only_where_it_is_the_answer(ends):
    asked = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        falls = initial.gripper.position[0] <= 0.011 < gripper.position[0]
        shape = touching(gripper, 0.0, 0)
        asked.append((falls, most))
        blocked = not ends and falls and gripper.position[0] < 0.019
        state = replace(shape.state, kicks=int(falls), culled=False)
        return replace(shape, state=state, residual=most, converged=not blocked)

    shape = follow(equilibrium, touching(pose(0.0), 0.0, 0), Pose((0.02, 0, 0), (0, 0, 0, 1)))
    assert shape.converged and shape.jumped
    assert ends or shape.residual == np.inf  # its `most`: the whole step is the answer
    exact = [most == np.inf for falls, most in asked if falls]
    assert not any(exact[:-2]) and exact[-1] and len(exact) > 4


def test_grips_that_are_not_found_at_once_go_in_halves_and_say_so():
    box = Box(Pose((5, 0, 0), (0, 0, 0, 1)), (0.1, 0.1, 0.1))
    direct = DirectSimulator(Rod(1.0, 0.01, 1e-3, 7e-4, radius=1e-3), obstacles=[box],
                             basis='local', n_elements=16)
    asked = []

    def equilibrium(gripper, initial, holds, most=np.inf):
        shape = direct.solve(gripper, far_end=holds[0])
        asked.append(np.linalg.norm(gripper.position - initial.gripper.position))
        return replace(shape, converged=shape.converged and asked[-1] < 0.06)

    def ends(x):
        return Pose((x, 0, 0), (0, 0, 0, 1)), (FarEnd(Pose((x + 0.7, 0, 0), (0, 0, 0, 1))),)

    (gripper, held), (there, goal) = ends(0.0), ends(0.2)
    before = direct.solve(gripper, far_end=held[0])
    shape = follow(equilibrium, before, there, goal)
    assert shape.converged and shape.gripper is there and asked[0] == pytest.approx(0.2)
    assert shape.tried[-1] == ('in halves', 'found')
    asked.clear()  # what is out of reach is so in any part
    far = (FarEnd(Pose((1.3, 0, 0), (0, 0, 0, 1))),)
    shape = follow(equilibrium, before, there, far)
    assert not shape.converged and len(asked) == 1
    assert ('in halves', 'not converged') not in shape.tried


def test_what_falls_in_rings_may_have_landed_anywhere():
    feed = Feed(np.zeros(0), (), np.zeros((0, 0)), 0.0, '')

    def equilibrium(gripper, initial, holds, most=np.inf):
        turned = Rotation.from_matrix(np.array(gripper.rotation)).as_rotvec()[2]
        shape = touching(gripper, 0.9 * (turned > 0.05), 0)
        return replace(shape, state=replace(shape.state, feed=feed, culled=False))

    before = equilibrium(pose(0.0), None, ())
    shape = follow(equilibrium, before, pose(0.04))
    assert not shape.jumped and np.isfinite(shape.error_estimate)
    shape = follow(equilibrium, before, pose(0.06))
    assert shape.jumped and shape.converged and shape.error_estimate == np.inf
