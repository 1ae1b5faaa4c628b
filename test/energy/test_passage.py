# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions that run through something, and motions that do not."""

import numpy as np
import pytest

from dlo_planner import Box, CutOut, DirectSimulator, Plane, Pose, Rod, Sheet, Sphere
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.scene import build_scene

RADIUS = 0.002
TURNED = Pose((0.3, -0.2, 0.1), (0.2, -0.1, 0.4, 0.8))  # nothing may depend on the axes


def runs_through(obstacle, old, new):
    """Whether straight elements between `old` and `new` nodes (n, 3) cross an obstacle."""
    old, new = (np.ascontiguousarray(nodes, dtype=float) for nodes in (old, new))
    n = len(old) - 1
    lengths = np.linalg.norm(np.diff(old, axis=0), axis=1)
    rod = Rod(float(lengths.sum()), 0.0, 1.0, 1.0, radius=RADIUS)
    direct = DirectSimulator(rod, basis='local', n_elements=max(n, 2), obstacles=[obstacle])
    origin = np.array([0.02, -0.03, 0.05])
    scene = direct.mesh.system(np.eye(3), origin).scene
    rotations = np.empty((n + 1, 3, 3))
    for k, along in enumerate(np.diff(old, axis=0)):
        rotations[k] = Pose.looking_along((0, 0, 0), along).rotation
    rotations[n] = rotations[n - 1]
    return sweeps_through(scene, lengths, np.zeros((n, 3)), rotations, old - origin, rotations,
                          new - origin)


def level(z, y=0.0, x=(0.0, 0.5, 1.0)):
    return np.array([[value, y, z] for value in x])


BALL = Sphere((0.25, 0, 0), 0.05)  # between two nodes


@pytest.mark.parametrize(('old', 'new', 'crosses'), [
    (level(0.1), level(-0.1), True), (level(-0.1), level(0.1), True),
    (level(0.1), level(0.2), False), (level(0.1), level(0.06), False),
    (level(0.06), level(0.04), False),              # touches: that is for the contact
    (level(0.1), level(0.0), True),                 # so deep that the way out is lost
    (level(0.04), level(0.06), False), (level(0.04), level(-0.06), True),
    (level(0.1, 0.3), level(-0.1, 0.3), False),     # passes beside
    (level(0.06), level(0.06, 0.02), False),
    (level(0.1, x=(0.0, 0.1)), level(-0.1, x=(0.0, 0.1)), False),  # too short to meet it
    (level(0.1, x=(0.0, 0.2, 0.4)), level(-0.1, x=(0.0, 0.2, 0.4)), True)])
def test_a_ball(old, new, crosses):
    assert runs_through(BALL, old, new) == crosses


def test_one_end_that_swings_is_enough():
    ball = Sphere((0.95, 0, 0), 0.02)
    assert runs_through(ball, level(0.1), [[0, 0, 0.1], [0.5, 0, 0.1], [1, 0, -0.1]])
    assert not runs_through(ball, level(0.1), [[0, 0, -0.1], [0.5, 0, 0.1], [1, 0, 0.1]])
    ball = Sphere((0.05, 0, 0), 0.02)
    assert runs_through(ball, level(0.1), [[0, 0, -0.1], [0.5, 0, 0.1], [1, 0, 0.1]])


@pytest.mark.parametrize(('down', 'crosses'), [(-0.02, True), (0.004, False)])
def test_a_thin_plate_is_as_thin_as_it_is(down, crosses):
    plate = Box(Pose((0.5, 0, 0), (0, 0, 0, 1)), (0.4, 0.4, 0.001))
    assert runs_through(plate, level(0.02), level(down)) == crosses
    upright = Box(Pose((0.5, 0, 0), (0, np.sqrt(0.5), 0, np.sqrt(0.5))), (0.001, 0.4, 0.4))
    assert runs_through(upright, level(0.02), level(down)) == crosses


def test_a_plane_has_no_other_side():
    assert not runs_through(Plane((0, 0, 0), (0, 0, 1)), level(0.1), level(-0.1))


def sheet(radius=0.02, *, second=None):
    holes = [CutOut(TURNED, radius=radius)]
    if second is not None:
        holes.append(CutOut(Pose.from_rotation(TURNED.position + TURNED.rotation @ [0, second, 0],
                                               TURNED.rotation), radius=radius))
    return Sheet(TURNED, 0.4, 0.4, 0.0, holes)


def in_sheet(*nodes):
    """Return world nodes of points given in the sheet's axes: normal, across, across."""
    return TURNED.position + np.array(nodes) @ TURNED.rotation.T


def through(y, z=0.0):
    """Return nodes of a DLO that goes through the sheet's plane at (y, z)."""
    return in_sheet([-0.1, y, z], [-0.01, y, z], [0.1, y, z])


def beside(x):
    """Return nodes of a DLO that runs along the sheet, on one side."""
    return in_sheet([x, -0.1, 0.05], [x, 0.0, 0.05], [x, 0.1, 0.05])


@pytest.mark.parametrize(('old', 'new', 'crosses'), [
    (beside(-0.05), beside(-0.01), False), (beside(-0.05), beside(0.05), True),
    (beside(0.05), beside(-0.05), True),
    (through(0), through(0.01), False), (through(0), through(0, -0.015), False),
    (through(0), through(0.05), True), (through(0), through(0, 0.05), True),
    (through(0), through(0.3), True),               # from the hole to beyond the border
    (through(0.3), through(0.4), False),            # it was never in it
    (through(0.3), through(0.3, 0.5), False),
    (through(0.1), through(0.11), False),           # in the material already: it may come out
    (in_sheet([-0.03, 0.3, 0], [-0.02, 0.3, 0]), in_sheet([0.03, 0.3, 0], [0.02, 0.3, 0]), False),
    (in_sheet([-0.03, 0, 0], [-0.02, 0, 0]), in_sheet([-0.01, 0, 0], [0.02, 0, 0]), False)])
def test_a_sheet(old, new, crosses):
    assert runs_through(sheet(), old, new) == crosses


def test_where_an_oblique_dlo_meets_the_plane():
    # the nodes are far from the hole, the point where the plane is met is in its middle
    old = in_sheet([-0.03, -0.06, 0], [0.01, 0.02, 0])
    assert not runs_through(sheet(), old, old + TURNED.rotation @ [0, 0.005, 0])
    # the other way round: one node right behind the hole, the plane is met beside it
    assert runs_through(sheet(), old, in_sheet([-0.03, 0.2, 0], [0.01, 0.0, 0]))


def test_from_one_hole_to_another_there_is_no_way():
    two = sheet(0.05, second=0.14)
    assert runs_through(two, through(0), through(0.14))
    assert not runs_through(two, through(0.14), through(0.17))
    assert runs_through(sheet(0.05), through(0), through(0.3))


HOLES = tuple(CutOut(Pose.looking_along((0, y, 0), (1, 0, 0)), radius=0.05) for y in (0.0, 0.2))
SHEET = Sheet(Pose.looking_along((0, 0, 0), (1, 0, 0)), 1.0, 1.0, 0.0, HOLES)


def straight(tip):
    """Return the nodes of a straight DLO of 1 m along x, by its end."""
    return np.linspace((-1, 0, 0), (0, 0, 0), 9) + tip


@pytest.mark.parametrize('end', [0.0, 1e-17, -1e-17, 3e-16, -3e-16])
@pytest.mark.parametrize(('tip', 'through'), [
    ((0.1, 0.0, 0.0), False), ((0.1, 0.03, 0.0), False), ((-0.1, 0.2, 0.0), False),
    ((0.1, 0.2, 0.0), True), ((0.1, 0.1, 0.0), True), ((0.0, 0.03, 0.01), False)])
def test_an_end_in_the_plane_of_a_hole(end, tip, through):
    scene = build_scene([SHEET], 1e-3)
    lengths, strains = np.full(8, 1 / 8), np.zeros((8, 3))
    rotations = np.tile(np.eye(3), (9, 1, 1))
    old, new = straight((end, 0, 0)), straight(tip)
    assert sweeps_through(scene, lengths, strains, rotations, old, rotations, new) == through
