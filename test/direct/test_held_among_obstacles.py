# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Both ends held over obstacles, wherever the DLO without them would lie."""

from itertools import pairwise

import numpy as np
import pytest
from test_held import HERE, cable, poses

from dlo_planner import Capsule, DirectSimulator, Plane, Pose, Rod, Sphere
from dlo_planner.energy.gap import penetration
from dlo_planner.energy.potential import configuration_at

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


def test_an_obstacle_that_is_not_touched_changes_nothing():
    direct = DirectSimulator(cable(1e3, 1e-4), basis='local', obstacles=(PEG,))
    for gripper, end in poses(3):
        shape = direct.solve(gripper, far_end=end)
        alone = direct.without_obstacles().solve(gripper, far_end=end)
        assert shape.converged and alone.converged and not shape.contacts
        np.testing.assert_allclose(shape.positions, alone.positions, atol=1e-6)


def test_depth_against_many_points():
    direct = DirectSimulator(cable(1e2), basis='local', n_elements=40, obstacles=(PEG,))
    system = direct.mesh.system(np.eye(3), np.zeros(3))
    for curvature in (0.0, 1.0, 2.0, 3.0):
        state = configuration_at(system, np.tile([0.3, 0.2, -curvature], (40, 1)))
        found = penetration(system.scene, system.lengths, state.strains, state.rotations,
                            state.positions)
        shape_points = np.array([state.positions[e] + f * (state.positions[e + 1]
                                                           - state.positions[e])
                                 for e in range(40) for f in np.linspace(0, 1, 200)])
        along = np.clip(shape_points[:, 1], -1, 1)
        away = np.linalg.norm(shape_points - np.column_stack(
            [np.full(len(along), 0.4), along, np.full(len(along), -0.25)]), axis=1)
        expected = max(0.0, PEG.radius + direct.rod.radius - away.min())
        assert found == pytest.approx(expected, abs=1e-3)  # chords lie beside the arcs
