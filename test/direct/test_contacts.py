# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Contacts as they are told to people: how deep, how strong, where, in what order."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, FarEnd, Plane, Pose, Rod, Sphere
from dlo_planner.direct.contact import contact_rows, contacts_of
from dlo_planner.direct.shape import pack
from dlo_planner.energy.potential import evaluate
from dlo_planner.energy.problem import new_configuration

RADIUS = 0.01
ROD = Rod(1.0, 0.0, 1.0, 0.7, radius=RADIUS)


def contacts_at(height, obstacles):
    """Return the Contacts of a straight DLO at a height, each node pressed by 3 N."""
    direct = DirectSimulator(ROD, basis='local', n_elements=4, gravity=(0, 0, 0),
                             obstacles=obstacles)
    gripper = Pose((0.1, 0.2, height), (0, 0, 0, 1))
    system = direct.mesh.system(gripper.rotation, gripper.position)
    system.contacts.node[:, 1:] = 3.0
    state = new_configuration(system)
    evaluate(system, state)
    contacts = contacts_of(direct.mesh.s, contact_rows(system, state), gripper.position)
    return contacts, system.contacts.stiffness


@pytest.mark.parametrize('gap', [-2e-6, 1e-6])
def test_depth_force_and_place(gap):
    contacts, stiffness = contacts_at(RADIUS + gap, [Plane((0, 0, 0), (0, 0, 1))])
    assert [contact.s for contact in contacts] == [0.25, 0.5, 0.75, 1.0]
    for contact in contacts:
        assert contact.penetration == pytest.approx(max(0.0, -gap), abs=1e-12)
        assert contact.force == pytest.approx(3.0 - stiffness * gap)
        np.testing.assert_allclose(contact.position, (0.1 + contact.s, 0.2, RADIUS + gap))
        np.testing.assert_allclose(contact.vector, [0, 0, contact.force])


def test_each_contact_has_its_own_normal():
    away = {0: np.array([0, 0.6, 0.8]), 1: np.array([0, -0.8, 0.6])}  # from the balls
    place = {0: 0.75, 1: 0.25}
    axis = np.array([0.1, 0.2, 0.3])
    balls = [Sphere(axis + [place[k], 0, 0] - (0.05 + RADIUS) * away[k], 0.05) for k in (0, 1)]
    contacts, _ = contacts_at(0.3, balls)
    assert [(contact.obstacle, contact.s) for contact in contacts] == [(1, 0.25), (0, 0.75)]
    for contact in contacts:
        np.testing.assert_allclose(contact.normal, away[contact.obstacle], atol=1e-9)
        np.testing.assert_allclose(contact.vector, 3.0 * away[contact.obstacle], atol=1e-5)


SLIDING = [(-0.002, 0.001, 0.01), (-0.006, 0.003, 0.01)]
STICKING = [(-1e-7, 0, 0.01), (-1.5e-7, 0, 0.01), (-1e-7, 0, 0.01)]


def drawn(wire, shift, way):
    """Return the friction in N that a wire feels, lowered to a floor and drawn over it."""
    shift = np.array(shift)
    direct = DirectSimulator(wire, basis='local', n_elements=32,
                             obstacles=[Plane(shift, (0, 0, 1), 0.3)])
    shapes = direct.track([Pose(shift + x, (0, 0, 0, 1))
                           for x in [(0, 0, 0.05), (0, 0, 0.01), *way]])
    assert all(shape.converged for shape in shapes)
    return np.array([sum(contact.friction for contact in shape.contacts) for shape in shapes[2:]])


@pytest.mark.parametrize('way', [SLIDING, STICKING], ids=['sliding', 'sticking'])
def test_friction_does_not_ask_where_the_world_begins(wire, way):
    here, there = drawn(wire, (0, 0, 0), way), drawn(wire, (3.0, -2.0, 1.0), way)
    weight = wire.mass_per_length * 9.81
    np.testing.assert_allclose(there, here, atol=1e-5 * weight)
    assert np.linalg.norm(here[-1]) > 0.1 * weight


def test_friction_holds_against_the_way_and_what_sticks_goes_back(wire):
    weight = wire.mass_per_length * 9.81
    slid = drawn(wire, (0, 0, 0), SLIDING)[-1]
    assert slid @ [1, -0.5, 0] > 0.1 * weight
    stuck = drawn(wire, (0, 0, 0), STICKING)
    assert abs(stuck[1, 0] - stuck[0, 0]) > 0.01 * weight
    np.testing.assert_allclose(stuck[2], stuck[0], atol=1e-4 * weight)


def test_a_step_leaves_what_it_starts_from_alone(wire):
    soft = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, yield_stress=60e6, hardening=0.1)
    floor = Plane((0, 0, 0.9), (0, 0, 1), 0.3)
    poses = [Pose((x, 0, 1.0), (0, 0, 0, 1)) for x in (0.0, -0.01, 0.02)]
    ends = [FarEnd(Pose((x, 0.1, 1.0), (0, 0, 0, 1)), 'sleeve') for x in (0.8, 0.75, 0.7)]
    for rod, obstacles, far in ((wire, [floor], [None] * 3), (soft, [], [None] * 3),
                                (wire, [], ends)):
        direct = DirectSimulator(rod, basis='local', n_elements=24, obstacles=obstacles)
        shape = direct.track(poses[:2], far_ends=far[:2])[1]
        before = {name: array.copy() for name, array in pack(shape).items()}
        one, two = (direct.solve(poses[2], shape, far_end=far[2]) for _ in range(2))
        np.testing.assert_array_equal(one.positions, two.positions)  # so it can be made again
        for name, array in pack(shape).items():
            np.testing.assert_array_equal(array, before[name], err_msg=name)
