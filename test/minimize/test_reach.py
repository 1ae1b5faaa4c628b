# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What no DLO in the gripper can reach changes nothing, and costs little."""

import numpy as np
import pytest

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.minimize.reach import among_all, bodies_in_reach, with_bodies

ROD = Rod(1.0, 0.035, 1.2e-3, 9e-4, radius=0.0025)
TABLE = Plane((0, 0, 0), (0, 0, 1), 0.3)
HOLE = Sheet.around(CutOut(Pose.looking_along((3.0, 0, 0), (1, 0, 0)), radius=0.02))
FAR = (Sphere((0, 5, 0), 0.1), HOLE, Box(Pose((0, 0, -4), (0, 0, 0, 1)), (1, 1, 1)),
       Capsule((2, -1, 0), (2, 1, 0), 0.1), Plane((0, 0, -3), (0, 0, 1)))


def level(z, y=0.0):
    return Pose((0, y, z), (0, 0, 0, 1))


@pytest.mark.parametrize('before', [0, 2, 5])
def test_bodies_out_of_reach_change_no_step(before):
    near = DirectSimulator(ROD, n_elements=24, obstacles=[TABLE])
    among = DirectSimulator(ROD, n_elements=24, obstacles=[*FAR[:before], TABLE, *FAR[before:]])
    way = [level(z, y) for z, y in ((0.3, 0), (0.1, 0), (0.09, 0.01), (0.09, 0.02))]
    for one, other in zip(near.track(way), among.track(way), strict=True):
        assert one.converged and other.converged
        np.testing.assert_allclose(other.positions, one.positions, rtol=0, atol=1e-12)
        np.testing.assert_allclose(*([(contact.s, contact.force) for contact in shape.contacts]
                                     for shape in (one, other)), rtol=1e-9)
        assert all(contact.obstacle == before for contact in other.contacts)
        forces, few = other.history.node_force, one.history.node_force
        assert forces.shape[0] == among.mesh.scene.kind.size > few.shape[0]
        bodies = among.mesh.scene.source == before
        np.testing.assert_allclose(forces[bodies], few, rtol=0, atol=1e-9)
        assert not forces[~bodies].any()


def test_what_is_left_out_is_beyond_the_length_and_the_way():
    direct = DirectSimulator(ROD, n_elements=8, obstacles=[
        Sphere((0, 0, 1.1), 0.0974), Sphere((0, 0, 1.1), 0.0976), *FAR])
    system = direct.mesh.system(np.eye(3), np.zeros(3))
    nowhere = np.zeros((0, 6))
    assert bodies_in_reach(system, nowhere).tolist() == [1]  # its axis comes to 1 m, so 2.5 mm
    come = np.zeros((9, 6))
    come[:, 0] = 2.5  # the nodes were so far away
    reached = system.scene.source[bodies_in_reach(system, come)]
    assert set(reached.tolist()) == {0, 1, 5}


def test_a_part_of_the_bodies_has_its_holes_and_comes_back_to_its_place():
    direct = DirectSimulator(ROD, n_elements=8, obstacles=[TABLE, HOLE, FAR[0], HOLE])
    system = direct.mesh.system(np.eye(3), np.zeros(3))
    scene = system.scene
    bodies = np.flatnonzero(scene.source >= 2)
    part = with_bodies(system, bodies)
    assert part.scene.source.tolist() == scene.source[bodies].tolist()
    holes = scene.hole_of >= bodies[0]
    assert (bodies[part.scene.hole_of] == scene.hole_of[holes]).all()
    np.testing.assert_array_equal(part.scene.hole_size, scene.hole_size[holes])
    part.contacts.node[1] = 3.0
    whole = among_all(system, part, bodies)
    assert whole.contacts.node[bodies[1]].tolist() == [3.0] * 9
    assert whole.contacts.node.sum() == 27.0
    assert whole.scene.kind.size == scene.kind.size
