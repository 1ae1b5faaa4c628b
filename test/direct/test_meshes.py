# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO that touches meshes and hulls: against the bodies that they stand for, and own judges."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import ball, blocks, box, from_boxes

from dlo_planner import (
    Box,
    DirectSimulator,
    Hull,
    InvalidTask,
    Mesh,
    Plane,
    Pose,
    Rod,
    Sphere,
    Workspace,
)
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.scene import build_scene
from dlo_planner.plan.clearance import clearance
from dlo_planner.plan.path import GripperPath

RADIUS = 0.004
SOFT = Rod(0.8, 0.05, 2e-3, 1.5e-3, radius=RADIUS)
PLACE = Pose((0.12, 0.0, 0.72), (0.1, -0.05, 0.2, 0.97))


def over(obstacle, rod=SOFT, heights=(1.0, 0.99, 0.98)):
    """Return the Shape of a DLO whose gripper is lowered beside an obstacle that it hangs over."""
    direct, shape = DirectSimulator(rod, n_elements=32, obstacles=[obstacle]), None
    for height in heights:
        shape = direct.solve(Pose((0, 0, height), (0, 0, 0, 1)), initial=shape)
    return shape


def pushed(shape):
    return np.sum([one.vector for one in shape.contacts], axis=0)


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_flat_faces_are_those_of_a_box(friction):
    size = (0.2, 0.3, 0.15)
    bodies = [Box(PLACE, size), Mesh(*box(size), PLACE, smooth=False),
              Hull(box(size).vertices, PLACE)]
    shapes = [over(replace(body, friction=friction)) for body in bodies]
    assert shapes[0].converged
    assert shapes[0].contacts
    for shape in shapes[1:]:
        assert shape.converged
        np.testing.assert_allclose(shape.positions, shapes[0].positions, atol=1e-9)
        np.testing.assert_allclose(pushed(shape), pushed(shapes[0]), atol=1e-8)


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_a_round_mesh_pushes_as_the_sphere_does(friction):
    place = Pose((0.1, -0.01, 0.8), PLACE.quaternion)  # beside the plane that it hangs in
    mesh = Mesh(*ball(0.04, 4000), place, friction)
    sphere, other = over(Sphere(place.position, 0.04, friction)), over(mesh)
    assert sphere.converged
    assert other.converged
    assert len(other.contacts) == len(sphere.contacts) > 0
    np.testing.assert_allclose(pushed(other), pushed(sphere),
                               atol=0.01 * np.linalg.norm(pushed(sphere)))
    assert np.abs(other.positions - sphere.positions).max() < 1e-3 * SOFT.length
    # it is clear of the triangles, though a smooth surface was touched
    assert 0 <= clearance([mesh], RADIUS, other) < 0.02 * RADIUS


LINES = [(0.08, 0.45), (-0.03, -0.006, 0.006, 0.03), (-0.01, 0.0, 0.03)]
SLOT = [[[1, 1], [1, 0], [1, 1]]]


@pytest.mark.parametrize('smooth', [True, False])
def test_a_cable_is_laid_into_the_slot_of_a_bracket(smooth):
    bracket = Mesh(*blocks(LINES, SLOT), smooth=smooth)
    rod = Rod(0.5, 0.05, 1.2e-3, 1e-3, radius=RADIUS)
    direct, shape = DirectSimulator(rod, n_elements=32, obstacles=[bracket]), None
    for height in (0.2, 0.18, 0.16, 0.14):
        shape = direct.solve(Pose.looking_along((0, 0, height), (1, 0, -0.3)), initial=shape)
        assert shape.converged
    places = np.array([shape.at(s).position for s in np.linspace(0, 0.5, 401)])
    away = from_boxes(places, LINES, SLOT) - RADIUS
    assert away.min() >= (0 if smooth else -2e-6 * rod.length)
    assert away.min() < 0.06 * RADIUS
    assert places[-1, 2] < 0.01  # on its bottom, between walls of 30 mm
    assert clearance([bracket], RADIUS, shape) == pytest.approx(away.min(), abs=2e-6)


def passes(obstacle, old, new, radius=0.002):
    """Whether straight elements between `old` and `new` nodes (n, 3) go through an obstacle."""
    old, new = np.array(old, dtype=float), np.array(new, dtype=float)
    n = len(old) - 1
    lengths = np.linalg.norm(np.diff(old, axis=0), axis=1)
    frames = [np.stack([Pose.looking_along((0, 0, 0), along).rotation
                        for along in np.diff(nodes, axis=0)]) for nodes in (old, new)]
    frames = [np.concatenate([one, one[-1:]]) for one in frames]
    return [sweeps_through(build_scene([obstacle], radius, sharp=sharp), lengths, np.zeros((n, 3)),
                           frames[0], old, frames[1], new) for sharp in (False, True)]


def level(z, y=0.0):
    return [(x, y, z) for x in (-0.2, 0.0, 0.2)]


PLATE = Mesh(*blocks([(-0.15, 0.15), (-0.1, 0.1), (-0.001, 0.001)], np.ones((1, 1, 1))))
ARCH = Mesh(*blocks([(-0.15, -0.1, 0.1, 0.15), (-0.1, 0.1), (-0.05, 0.0, 0.01)],
                    [[[1, 1]], [[0, 1]], [[1, 1]]]))


@pytest.mark.parametrize(('body', 'old', 'new', 'goes_through'), [
    (PLATE, level(0.05), level(-0.05), True), (PLATE, level(-0.05), level(0.05), True),
    (PLATE, level(0.05), level(0.004), False),
    (PLATE, level(0.05), level(0.002), False),          # touches: that is for the contact
    (PLATE, level(0.003), level(0.0025, 0.05), False),  # slides along
    (PLATE, level(0.05, 0.2), level(-0.05, 0.2), False),  # beside
    (PLATE, level(0.05, 0.15), level(-0.05, 0.05), True),
    (PLATE, [(x + 0.2, 0, 0.05) for x in (-0.02, 0.0, 0.02)],
     [(x - 0.2, 0, -0.05) for x in (-0.02, 0.0, 0.02)], True),  # slips through its face
    (ARCH, [(0, -0.2, -0.03), (0, 0, -0.03), (0, 0.2, -0.03)],
     [(0.05, -0.2, -0.03), (0.05, 0, -0.03), (0.05, 0.2, -0.03)], False),  # under it
    (ARCH, [(0, -0.2, -0.03), (0, 0, -0.03), (0, 0.2, -0.03)],
     [(0, -0.2, 0.03), (0, 0, 0.03), (0, 0.2, 0.03)], True),  # out of it from within
    (ARCH, [(0, -0.2, -0.03), (0, 0, -0.03), (0, 0.2, -0.03)],
     [(0.25, -0.2, -0.03), (0.25, 0, -0.03), (0.25, 0.2, -0.03)], True)])
def test_what_goes_through_a_mesh_is_seen(body, old, new, goes_through):
    assert passes(body, old, new) == [goes_through] * 2


def test_a_dlo_under_an_arch_is_held_by_it():
    rod = Rod(0.5, 0.05, 0.05, 0.04, radius=RADIUS)
    direct = DirectSimulator(rod, n_elements=32, obstacles=[replace(ARCH, pose=Pose(
        (0.3, 0, 0), (0, 0, np.sqrt(0.5), np.sqrt(0.5))))])
    shape = direct.solve(Pose((0, 0, -0.02), (0, 0, 0, 1)))
    lifted = direct.track([shape.gripper, *(Pose((0, 0, z), (0, 0, 0, 1))
                                            for z in (0.0, 0.03))], initial=shape)[-1]
    assert lifted.converged
    assert lifted.at(0.3).position[2] < 0.0
    assert pushed(lifted)[2] < 0  # down on the DLO


def test_one_that_is_elsewhere_or_rubs_is_looked_into_once():
    mesh = Mesh(*box((0.02, 0.02, 0.02)))
    others = replace(mesh, pose=PLACE, friction=0.3), replace(mesh, smooth=True)
    scene = build_scene([mesh], RADIUS)
    for other in others:
        same = build_scene([other], RADIUS)
        assert same.trees.corner is scene.trees.corner
        assert np.shares_memory(same.trees.box, scene.trees.box)
    hull = Hull(mesh.vertices)
    assert (build_scene([replace(hull, friction=0.1)], RADIUS).trees.corner
            is build_scene([hull], RADIUS).trees.corner)


def test_the_clearance_of_a_mesh_is_that_of_its_triangles():
    shape = DirectSimulator(SOFT, n_elements=32).solve(Pose((0, 0, 1), (0, 0, 0, 1)))
    lines = [(0.0, 0.03, 0.12, 0.2), (0.01, 0.1), (0.5, 0.55, 0.7)]
    filled = [[[1, 1]], [[1, 0]], [[1, 1]]]
    places = np.array([shape.at(s).position for s in np.linspace(0, 0.8, 4001)])
    expected = from_boxes(places, lines, filled).min() - RADIUS
    mesh = Mesh(*blocks(lines, filled))
    assert clearance([mesh], RADIUS, shape) == pytest.approx(expected, abs=1e-6)


def test_the_gripper_keeps_out_of_meshes():
    cell = Workspace(keep_out=[Plane((0, 0, -1), (0, 0, 1)), ARCH], gripper_radius=0.01)
    name, margin = cell.min_margin(Pose((0, 0, -0.03), (0, 0, 0, 1)))
    assert name == 'workspace.keep_out[1]'
    assert margin == pytest.approx(0.02)


@pytest.mark.parametrize(('end', 'beyond'), [((0.08, 0, -0.03), False), ((0.3, 0, -0.03), True),
                                             ((0, 0.3, -0.03), False)])
def test_a_gripper_does_not_leave_an_arch_through_its_wall(end, beyond):
    # the plane at the nearest point, of its roof, says nothing of its legs
    grippers = [Pose((0, 0, -0.03), (0, 0, 0, 1)), Pose(end, (0, 0, 0, 1))]
    found = Workspace(keep_out=[ARCH], gripper_radius=0.01).first_beyond(
        GripperPath.through(grippers, range(2), 1.0))
    assert (found is not None) == beyond
    if beyond:
        assert found[:2] == (1, 'workspace.keep_out[0]')
        # out of the leg its lower end is nearest
        assert found[2] == pytest.approx(0.01 + 0.02, abs=1e-5)


def test_a_dlo_without_a_radius_is_refused():
    with pytest.raises(InvalidTask, match='Rod.radius = None: expected .* where a Mesh is'):
        DirectSimulator(replace(SOFT, radius=None), obstacles=[PLATE])


def test_a_strip_is_refused():
    with pytest.raises(InvalidTask, match='Mesh.*: expected a DLO with a round section'):
        DirectSimulator(Rod.rectangular(0.5, 0.02, 0.001, density=1e3, youngs_modulus=1e9,
                                        poisson_ratio=0.3), obstacles=[PLATE]).solve(PLACE)
