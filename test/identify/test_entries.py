# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Before a mouth: what is seen of a DLO tells how it misses, and the gripper takes that away."""

from functools import cache

import numpy as np
import pytest

from dlo_planner import DirectSimulator, FarEnd, Hold, InvalidTask, Pose, Rod
from dlo_planner.closed_loop import centered, seen_miss
from dlo_planner.model.pose import displaced
from dlo_planner.tasks import Fork

CABLE = Rod(0.6, 0.025, 6e-3, 3e-3, radius=3e-3)
PLUG = FarEnd(Pose.looking_along((0, 0, 0.1), (-1.0, 0.15, 0)))  # it leaves the plug to one side
GRIPPER = Pose.looking_along((0.597, 0.0, 0.13), (-1, 0, 0))
FORK = Fork(Pose.looking_along((0.2, 0.0, 0.1), (-1, 0, 0)), room=0.8e-3)
ACROSS = np.array([FORK.aside, FORK.outwards])


@cache
def led(stiffness=1.0, gripper=GRIPPER):
    rod = Rod(0.6, 0.025, stiffness * 6e-3, stiffness * 3e-3, radius=3e-3)
    shape = DirectSimulator(rod, n_elements=48, basis='local').solve(gripper, far_end=PLUG)
    assert shape.converged
    return shape


def passes(shape):
    """Return where it goes through the plane of the fork, aside and out, m."""
    places = shape.positions_at(np.linspace(0.2, 0.6, 4001)) - FORK.pose.position
    along = places @ FORK.pose.rotation[:, 0]
    return ACROSS @ places[np.abs(along).argmin()]


def points(shape, seed, count=300, noise=1e-3, wild=0):
    rng = np.random.default_rng(seed)
    seen = shape.positions_at(rng.uniform(0, 0.6, count)) + noise * rng.standard_normal((count, 3))
    seen[:wild] += rng.uniform(-0.06, 0.06, (wild, 3))
    return seen


@pytest.mark.parametrize('wild', [0, 45])
def test_a_miss_is_seen_within_its_error(wild):
    true = passes(led(1.5)) - passes(led())
    assert np.linalg.norm(true) > FORK.room  # open loop it would lie on the prongs
    off = np.array([(one.miss - true) / one.error for one in (
        seen_miss(led(), FORK, points(led(1.5), seed, wild=wild)) for seed in range(40))])
    assert np.sqrt((off**2).mean()) < 1.3 and np.abs(off).max() < 4
    assert np.abs(off.mean(axis=0)).max() < 3 / np.sqrt(40) + 0.3


def test_the_gripper_leads_it_to_the_middle():
    gripper, misses = GRIPPER, list[float]()
    for _ in range(3):  # it looks again, since it knows the other DLO alone
        miss = passes(led(1.2, gripper)) - passes(led())
        misses.append(np.linalg.norm(miss))
        gripper = displaced(gripper, centered(led(), FORK, miss))
    assert misses[0] > FORK.room > 0.25 * FORK.room > misses[2]
    size = [np.linalg.norm(one.position - PLUG.pose.position) for one in (gripper, GRIPPER)]
    assert size[0] == pytest.approx(size[1], abs=1e-4)  # as slack as before


def test_the_least_motion_of_the_gripper_is_that_by_differences():
    miss = np.array([2e-4, -1e-4])
    after = led(1.0, displaced(GRIPPER, centered(led(), FORK, -miss)))
    np.testing.assert_allclose(passes(after) - passes(led()), miss, atol=1e-5)


def test_where_too_little_is_seen_nothing_is_told():
    far = led().positions_at(np.linspace(0.0, 0.2, 100))
    for seen in (far, points(led(), 0, count=5)):
        assert np.isinf(seen_miss(led(), FORK, seen).error).all()


def test_beyond_what_holds_next_nothing_counts():
    held = led().frame_at(0.45)
    hold = Hold(Pose.from_rotation(held[1], held[0]), s=0.45, by='clip 1')
    shape = DirectSimulator(CABLE, n_elements=48, basis='local').solve(
        GRIPPER, holds=[hold], far_end=PLUG, initial=None)
    near = Fork(Pose.looking_along(shape.positions_at([0.43])[0], (-1, 0, 0)), room=0.8e-3)
    seen = shape.positions_at(np.linspace(0.3, 0.6, 200))
    moved = seen.copy()
    moved[np.linspace(0.3, 0.6, 200) > 0.46] += (0.0, 5e-3, 0.0)
    for one in (seen, moved):
        assert np.linalg.norm(seen_miss(shape, near, one).miss) < 5e-5


@pytest.mark.parametrize(('make', 'said'), [
    (lambda: seen_miss(led(), FORK, [[0.0, 1.0]]), 'points'),
    (lambda: seen_miss(led(), FORK.pose, np.zeros((9, 3))), 'fitting'),
    (lambda: centered(led(), FORK, [0.0]), 'miss'),
    (lambda: centered(None, FORK, [0.0, 0.0]), 'shape')])
def test_what_makes_no_sense_is_named(make, said):
    with pytest.raises(InvalidTask, match=said):
        make()
