# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the tool link is and how near links come, against the URDF multiplied out by hand."""

from itertools import combinations

import numpy as np
import pytest
from robot_arms import (
    PACKAGES,
    UR5_READY,
    corners_by_hand,
    kinova,
    panda,
    placed_by_hand,
    ur5,
    urdf,
)
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from dlo_planner import InvalidTask, Pose
from dlo_planner.arm import Arm

ARMS = {'Panda': panda, 'UR5': ur5, 'Kinova, whose joints turn for ever': kinova}


def positions_in(arm, rng):
    return rng.uniform(np.maximum(arm.lower, -3), np.minimum(arm.upper, 3))


@pytest.mark.parametrize('name', ARMS)
def test_the_tool_link_is_where_the_urdf_says(name, rng):
    arm = ARMS[name]()
    for _ in range(10):
        positions = positions_in(arm, rng)
        by_hand = placed_by_hand(arm.urdf, arm.tool_link,
                                 dict(zip(arm.joints, positions, strict=True)))
        np.testing.assert_allclose(arm.pose(positions).matrix, by_hand, atol=1e-9)


def test_base_other_joints_and_order_count(rng):
    text = urdf('panda_description/urdf/panda.urdf')
    base = Pose((1.0, 2.0, 3.0), (0.1, 0.2, 0.3, 0.4))
    names = ('panda_joint6', 'panda_joint4', 'panda_joint2')
    arm = Arm(text, 'panda_hand_tcp', names, {'panda_joint1': 0.3, 'panda_joint7': -0.4}, base)
    positions = np.array([1.5, -1.2, 0.4])
    known = {'panda_joint1': 0.3, 'panda_joint7': -0.4, **dict(zip(names, positions, strict=True))}
    np.testing.assert_allclose(arm.pose(positions).matrix, base.matrix @ placed_by_hand(
        text, 'panda_hand_tcp', known), atol=1e-9)
    assert arm.joints == names
    np.testing.assert_allclose(arm.lower, (-0.0175, -3.0718, -1.7628))
    np.testing.assert_allclose(arm.upper, (3.7525, -0.0698, 1.7628))
    np.testing.assert_allclose(arm.speeds, (2.61, 2.175, 2.175))


def test_a_joint_that_follows_a_fixed_one_stands_where_it_says(rng):
    text = urdf('panda_description/urdf/panda.urdf')
    arm = Arm(text, 'panda_rightfinger', ('panda_joint1',), {'panda_finger_joint1': 0.03})
    open_ = placed_by_hand(text, 'panda_rightfinger', {'panda_finger_joint2': 0.03})
    np.testing.assert_allclose(arm.pose([0.0]).matrix, open_, atol=1e-9)


@pytest.mark.parametrize('name', ARMS)
def test_the_jacobian_is_the_derivative(name, rng):
    arm, step = ARMS[name](), 1e-6
    chain, positions = arm.chain, positions_in(arm, rng)
    target = chain.placement(positions_in(arm, rng))
    jacobian = chain.off(positions, *chain.placement(positions))[1]
    here = chain.placement(positions)
    for joint, unit in enumerate(np.eye(positions.size)):
        # as seen from here, the tool at q + h is off by J h
        off = chain.off(positions, *chain.placement(positions + step * unit))[0]
        np.testing.assert_allclose(off / step, jacobian[:, joint], atol=1e-5)
    np.testing.assert_allclose(chain.off(positions, *target)[0][:3], target[0] - here[0])


def hull_distance(one, other):
    """Return the distance of two convex hulls of points (k, 3), by least squares."""
    one, other = (points[ConvexHull(points).vertices] for points in (one, other))
    weight = 1e3
    rows = np.vstack([np.hstack([one.T, -other.T]),
                      weight * np.hstack([np.ones(len(one)), np.zeros(len(other))]),
                      weight * np.hstack([np.zeros(len(one)), np.ones(len(other))])])
    parts, _ = nnls(rows, np.array([0, 0, 0, weight, weight]), maxiter=20 * rows.shape[1])
    first, second = parts[:len(one)], parts[len(one):]
    return np.linalg.norm(first @ one / first.sum() - second @ other / second.sum())


def test_distances_between_links_are_those_of_their_hulls(rng):
    arm = ur5()
    corners = dict(corners_by_hand(arm.urdf, PACKAGES))
    for positions in (UR5_READY, positions_in(arm, rng)):
        known = dict(zip(arm.joints, positions, strict=True))
        placed = {}
        for link, points in corners.items():
            matrix = placed_by_hand(arm.urdf, link, known)
            placed[link] = points @ matrix[:3, :3].T + matrix[:3, 3]
        for pair, distance in zip(arm.collision.pairs, arm.collision.distances(positions),
                                  strict=True):
            by_hand = hull_distance(*(placed[link] for link in pair))
            assert max(distance, 0.0) == pytest.approx(by_hand, abs=2e-4)


def test_a_distance_changes_no_more_than_its_bound(rng):
    for arm in (panda(), ur5(), kinova()):
        for _ in range(20):
            one = positions_in(arm, rng)
            other = one + rng.uniform(-0.1, 0.1, one.size)
            change = np.abs(arm.collision.distances(one) - arm.collision.distances(other)).max()
            assert change <= arm.collision.way(np.abs(other - one))


def test_which_pairs_are_looked_at():
    pairs = set(map(frozenset, ur5().collision.pairs))
    links = ['base_link', 'shoulder_link', 'upper_arm_link', 'forearm_link', 'wrist_1_link',
             'wrist_2_link', 'wrist_3_link']
    adjacent = {frozenset(pair) for pair in zip(links, links[1:], strict=False)}
    assert not pairs & adjacent
    assert frozenset(('base_link', 'wrist_3_link')) in pairs
    srdf = '<robot name="ur5"><disable_collisions link1="wrist_3_link" link2="base_link"/></robot>'
    less = set(map(frozenset, Arm(ur5().urdf, 'tool0', packages=PACKAGES,
                                  srdf=srdf).collision.pairs))
    every = {frozenset(pair) for pair in combinations([*links, 'ee_link'], 2)}
    # links of one body never move against each other
    assert less == every - {frozenset(('wrist_3_link', 'base_link')),
                            frozenset(('wrist_3_link', 'ee_link'))}


def test_meshes_that_are_not_there_are_named():
    arm = Arm(ur5().urdf, 'tool0')
    assert [text.split()[0] for text in arm.collision.missing] == [
        'base_link', 'shoulder_link', 'upper_arm_link', 'forearm_link', 'wrist_1_link',
        'wrist_2_link', 'wrist_3_link']
    bare = '''<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute">
        <parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'''
    assert Arm(bare, 'b').collision.missing == ('no collision elements in the URDF',)


SLIDER = '''<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
    <joint name="j" type="{kind}"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="{lower}" upper="1" velocity="{speed}" effort="1"/></joint>
    <joint name="k" type="revolute"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/>{more}</joint></robot>'''


def robot(kind='prismatic', lower=-1, speed=1, more=''):
    return SLIDER.format(kind=kind, lower=lower, speed=speed, more=more)


def test_a_slide_moves_by_meters():
    arm = Arm(robot(), 'c')
    assert arm.units == ['m', 'rad']
    np.testing.assert_allclose(arm.pose([0.3, 0.0]).position, (0, 0, 0.3))


def test_a_link_may_be_called_as_a_joint(rng):
    text = urdf('z1_description/urdf/z1.urdf')
    arm = Arm(text, 'gripperStator', packages=PACKAGES)  # a fixed joint has that name too
    positions = positions_in(arm, rng)
    np.testing.assert_allclose(arm.pose(positions).matrix, placed_by_hand(
        text, 'gripperStator', dict(zip(arm.joints, positions, strict=True))), atol=1e-9)
    twin = robot().replace('"j"', '"b"')  # a joint that moves and a link
    for joints in (('b', 'k'), ('k',)):
        arm = Arm(twin, 'c', joints)
        assert arm.joints == joints
        assert arm.pose(np.zeros(len(arm.joints))) == Pose.identity()


@pytest.mark.parametrize('arguments, words', [
    ({'urdf': 3}, 'urdf = 3: expected str'),
    ({'urdf': 'robot'}, "urdf = 'robot': expected XML"),
    ({'urdf': '<sdf/>'}, 'urdf has the element <sdf>: expected <robot>'),
    ({'urdf': '<robot name="r"/>'}, 'urdf = '),
    ({'tool_link': 'hand'}, "tool_link = 'hand': expected a link of the URDF"),
    ({'tool_link': 'a'}, 'the tool_link does not move'),
    ({'joints': ('x',)}, r"joints\[0\] = 'x': expected a movable joint of the URDF"),
    ({'joints': ('j', 'j')}, r"joints\[1\] = 'j': expected each joint once"),
    ({'joints': ('k',), 'tool_link': 'b'}, r"joints\[0\] = 'k': expected one that moves the tool"),
    ({'joints': 'j'}, "joints = 'j': expected a sequence"),
    ({'fixed': {'x': 1.0}}, r"fixed\['x'\]: expected joints of the URDF"),
    ({'fixed': {'j': np.nan}}, r"fixed\['j'\] = nan: expected a finite number"),
    ({'base': 3}, 'base = 3: expected Pose'),
    ({'srdf': '<robot'}, 'srdf = .*: expected XML'),
    ({'self_clearance': -1.0}, 'self_clearance = -1.0: expected'),
    ({'urdf': robot(lower=2)}, "joint 'j' has the limits 2 and 1: expected lower < upper"),
    ({'urdf': robot(speed=0)}, "joint 'j' has the velocity limit 0: expected more than 0"),
    ({'urdf': robot(more='<mimic joint="j"/>'), 'tool_link': 'b'}, "'j' drives 'k' too"),
    ({'urdf': robot(more='<mimic joint="j"/>'), 'joints': ('k',)}, "'k' follows 'j'"),
    ({'urdf': robot('floating'), 'joints': ('j',)}, "'j': expected a revolute, continuous or"),
])
def test_what_makes_no_sense_is_named(arguments, words):
    with pytest.raises(InvalidTask, match=words):
        Arm(**{'urdf': robot(), 'tool_link': 'c', **arguments})


@pytest.mark.parametrize('wrong', [None, [1.0], [np.nan, 0.0], 'ab', [1e9, 0.0], [[0.0, 0.0]]])
def test_wrong_positions_are_refused(wrong):
    with pytest.raises(InvalidTask, match='positions'):
        Arm(robot(), 'c').pose(wrong)


def test_without_pinocchio_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'pinocchio', None)
    with pytest.raises(InvalidTask, match=r'dlo_planner\[arm\]'):
        Arm(robot(), 'c')
