# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO on a cylinder with flat ends: its side is a bar, its end a floor; and on an ellipsoid."""

import numpy as np
import pytest

from dlo_planner import Capsule, Cylinder, DirectSimulator, Ellipsoid, Plane, Pose, Rod

WIRE = Rod(1.0, 0.1, 0.05, 0.04, radius=2e-3)
LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


def solved(obstacle):
    shape = DirectSimulator(WIRE, n_elements=48, obstacles=[obstacle]).solve(LEVEL)
    assert shape.converged and shape.stability > 0 and shape.contacts
    return shape


def outside(body, shape):
    """Return the least distance of the axis from the solid, sampled between the nodes too, m."""
    places = shape.positions_at(np.linspace(0, 1, 20_001))
    along = body.end - body.start
    axis = along / np.linalg.norm(along)
    height = (places - body.start) @ axis
    rho = np.linalg.norm(places - body.start - height[:, None] * axis, axis=1) - body.radius
    beyond = np.abs(height - 0.5 * np.linalg.norm(along)) - 0.5 * np.linalg.norm(along)
    inside = np.maximum(rho, beyond)
    return np.where(inside > 0, np.hypot(np.maximum(rho, 0), np.maximum(beyond, 0)), inside).min()


def test_on_its_side_it_is_a_bar():
    ends = (0.4, -0.5, 0.85), (0.4, 0.5, 0.85)
    round_, flat = solved(Capsule(*ends, 0.05)), solved(Cylinder(*ends, 0.05))
    assert np.abs(round_.positions - flat.positions).max() < 1e-9
    assert flat.contacts[0].force == pytest.approx(round_.contacts[0].force, rel=1e-7)


def test_an_ellipsoid_that_is_round_in_the_plane_of_the_dlo_is_a_bar():
    bar = solved(Capsule((0.4, -0.5, 0.85), (0.4, 0.5, 0.85), 0.05))
    egg = solved(Ellipsoid(Pose((0.4, 0, 0.85), (0, 0, 0, 1)), (0.05, 0.5, 0.05)))
    assert np.abs(bar.positions - egg.positions).max() < 1e-9
    assert egg.contacts[0].force == pytest.approx(bar.contacts[0].force, rel=1e-7)
    assert egg.stability < bar.stability  # it may roll off to the side


def test_nothing_enters_an_ellipsoid():
    body = Ellipsoid(Pose((0.4, 0.01, 0.4), (0.1, 0.2, 0.3, 0.9)), (0.1, 0.08, 0.12), 0.5)
    places = solved(body).positions_at(np.linspace(0, 1, 20_001))
    local = (places - body.pose.position) @ body.pose.rotation
    surface = body.half_axes + WIRE.radius
    assert ((local / surface) ** 2).sum(axis=1).min() > 1 - 2e-2


def test_on_its_end_it_is_a_floor():
    floor, end = solved(Plane((0, 0, 0.8), (0, 0, 1))), solved(
        Cylinder((0.5, 0, 0), (0.5, 0, 0.8), 3.0))
    assert np.abs(floor.positions - end.positions).max() < 1e-9
    assert sum(one.force for one in end.contacts) == pytest.approx(
        sum(one.force for one in floor.contacts), rel=1e-6)


def test_at_its_rim_it_is_an_edge():
    body = Cylinder((0.45, 0, 0.2), (0.45, 0, 0.85), 0.05)  # upright: the rim is nearest
    shape = solved(body)
    assert outside(body, shape) == pytest.approx(WIRE.radius, abs=1e-6)
    for contact in shape.contacts:
        assert np.hypot(contact.position[0] - 0.45, contact.position[1]) <= 0.05 + 2e-3 + 1e-9
    total = sum(contact.force * contact.normal for contact in shape.contacts)
    weight = WIRE.mass_per_length * 9.81
    assert shape.gripper_wrench[:3] + total == pytest.approx([0, 0, weight], abs=1e-6 * weight)


def test_nothing_gets_through_it():
    body = Cylinder((0.45, -0.02, 0.3), (0.45, 0.02, 0.3), 0.2)
    simulator = DirectSimulator(WIRE, n_elements=48, obstacles=[body])
    down = [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(1, 0.55, 10)]
    for shape in simulator.track(down):
        assert shape.converged and outside(body, shape) > WIRE.radius - 1e-6
