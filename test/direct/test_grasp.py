# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Grasped inside: what both parts say is said of the whole, in the whole's arc length."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, DirectSimulator, Pose, Rod
from dlo_planner.rods import GraspedInside

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))


def test_contacts_are_where_they_say(wire):
    bars = [Capsule((x, -0.5, 0.965), (x, 0.5, 0.965), 0.02) for x in (-0.25, 0.3)]
    shape = GraspedInside(wire, 0.4, basis='local', obstacles=bars).solve(LEVEL)
    assert shape.converged and {contact.obstacle for contact in shape.contacts} == {0, 1}
    places = [contact.s for contact in shape.contacts]
    assert places == sorted(places) and places[0] < 0.4 < places[-1]
    for contact in shape.contacts:
        np.testing.assert_allclose(shape.at(contact.s).position, contact.position, atol=1e-9)
        assert abs(contact.position[0] - (-0.25, 0.3)[contact.obstacle]) < 0.05


def test_one_part_that_jumps_is_a_jump(wire):
    # the back part goes through benchmark C, the other one is too short to notice
    grasped = GraspedInside(wire, 0.9)
    ways = [Pose((0, 0, 1), (Rotation.from_euler('y', 180 - angle, degrees=True)).as_quat())
            for angle in (60, 120)]
    shapes = grasped.track(ways)
    assert [[part.jumped for part in shape.parts] for shape in shapes] == [
        [False, False], [True, False]]
    assert [shape.jumped for shape in shapes] == [False, True]
    assert shapes[1].energy == pytest.approx(sum(part.energy for part in shapes[1].parts))


def test_the_worse_part_tells_residual_and_error(curly):
    shape = GraspedInside(curly, 0.3, n_elements=24).solve(LEVEL)
    back, on = shape.parts
    assert shape.residual == max(back.residual, on.residual)
    assert shape.stability == min(back.stability, on.stability)
    assert shape.error_estimate == max(back.error_estimate, on.error_estimate)
    assert back.error_estimate != on.error_estimate


def test_a_load_that_varies_is_that_of_the_whole():
    # only what lies beyond 0.7 m is loaded: the back part does not notice, the other one does
    rod = Rod(1.0, 0.0, 1.0, 0.7)
    grasped = GraspedInside(rod, 0.5, basis='local', gravity=(0, 0, 0),
                            load=lambda s: (0, 0, -1.0 if s > 0.7 else 0.0))
    shape = grasped.solve(LEVEL)
    back, on = shape.parts
    np.testing.assert_allclose(back.element_strains, 0, atol=1e-12)
    assert on.gripper_wrench[2] == pytest.approx(0.3, rel=0.03)
    alone = DirectSimulator(Rod(0.5, 0.0, 1.0, 0.7), basis='local', gravity=(0, 0, 0),
                            load=lambda s: (0, 0, -1.0 if s > 0.2 else 0.0)).solve(LEVEL)
    np.testing.assert_allclose(on.positions, alone.positions, atol=1e-12)


def test_losses_and_violations_are_those_of_both_parts():
    yields = Rod(1.0, 0.3, 0.05, 0.04, yield_curvature=0.5, hardening=0.1)
    shape = GraspedInside(yields, 0.4, basis='local').solve(LEVEL)
    back, on = shape.parts
    assert 0 < back.dissipated < on.dissipated
    assert shape.dissipated == back.dissipated + on.dissipated
    thick = Rod(1.0, 0.1, 0.5, 0.4, radius=0.01)
    for x in (-0.35, 0.35):  # a block in which one of the parts lies, and cannot get out
        block = Box(Pose((x, 0, 1), (0, 0, 0, 1)), (0.3, 2.0, 2.0))
        shape = GraspedInside(thick, 0.5, basis='local', n_elements=16,
                              obstacles=[block]).solve(LEVEL)
        assert not shape.converged
        assert shape.violation == max(part.violation for part in shape.parts) > 0.01
