# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rectangular section and a stepped DLO on obstacles, against closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, CutOut, DirectSimulator, Plane, Pose, Rod, Sheet, Sphere
from dlo_planner.energy.gap import gap_at
from dlo_planner.energy.scene import build_scene
from dlo_planner.model.rod import Surface

WIDTH, THICK = 0.02, 0.0005
STRIP = Rod.rectangular(0.4, WIDTH, THICK, 7800.0, 2e11, 0.3)
WEIGHT = 9.81 * STRIP.mass_per_length  # N/m


def bar(x, top, radius=0.005):
    """Return a bar across, its upper side at the height `top`."""
    return Capsule((x, -0.1, top - radius), (x, 0.1, top - radius), radius)


def least_gap(scene, rotation, place):
    return min(gap_at(scene, o, rotation, place, scene.rounding[o], np.zeros(2), np.empty(3),
                      np.empty(3), np.empty((3, 3))) for o in range(scene.kind.size))


@pytest.mark.parametrize('half', [(0.01, 0.00025), (0.003, 0.003)])
@pytest.mark.parametrize('roll', [0, 0.2, np.pi / 4, 1.0, np.pi / 2, 3.0])
def test_a_plane_is_as_far_as_the_lowest_corner(half, roll):
    scene = build_scene([Plane((0, 0, 0), (0, 0, 1))], Surface(max(half), half))
    rotation = Rotation.from_rotvec([roll, 0, 0]).as_matrix()
    lowest = half[0] * abs(np.sin(roll)) + half[1] * abs(np.cos(roll))
    assert least_gap(scene, rotation, np.array([0, 0, 0.1])) == pytest.approx(0.1 - lowest,
                                                                              abs=1e-15)


@pytest.mark.parametrize('obstacle', [Sphere((0.0, 0.002, -0.03), 0.01),
                                      Capsule((-0.1, 0.002, -0.03), (0.1, 0.002, -0.03), 0.01),
                                      Capsule((0, -0.1, -0.03), (0, 0.1, -0.03), 0.01),
                                      Box(Pose((0, 0.002, -0.03), (np.sin(np.pi / 8), 0, 0,
                                                                   np.cos(np.pi / 8))),
                                          (0.1, 0.01 * 2**0.5, 0.01 * 2**0.5))])
def test_a_face_is_as_far_as_its_nearest_point(obstacle):
    half = (0.01, 0.00025)  # all reach up to -0.02, the box with an edge along the strip
    scene = build_scene([obstacle], Surface(max(half), half))
    assert least_gap(scene, np.eye(3), np.zeros(3)) == pytest.approx(0.02 - half[1], abs=1e-15)


def test_a_strip_over_two_bars_is_a_beam():
    # clamped level at x = 0, a bar as high as its lower side at 0.3; beyond, 0.1 hangs over
    shape = DirectSimulator(STRIP, n_elements=80, basis='local',
                            obstacles=[bar(0.15, -0.05), bar(0.3, -THICK / 2)]).solve(
        Pose.identity())
    span, over = 0.3, 0.1
    moment = WEIGHT * over**2 / 2
    # propped cantilever: 3 w L / 8, and a moment at the prop adds 3 M / (2 L)
    force = 3 / 8 * WEIGHT * span + WEIGHT * over + 1.5 * moment / span
    touching = [one for one in shape.contacts if one.obstacle == 1]
    assert shape.converged and len(touching) == len(shape.contacts) == 2  # both edges
    assert sum(one.force for one in touching) == pytest.approx(force, rel=2e-3)
    assert touching[0].force == pytest.approx(touching[1].force, rel=1e-6)
    assert touching[0].s == pytest.approx(span, abs=2e-4)
    assert shape.at(0.3).position[2] == pytest.approx(0, abs=1e-5)  # not half the width above


def test_a_soft_strip_lies_flat_on_both_edges_however_it_is_held():
    soft = Rod.rectangular(0.4, WIDTH, THICK, 7800.0, 2e10, 0.3)
    gripper = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec([0.02, 0, 0]).as_matrix())
    shape = DirectSimulator(soft, n_elements=64, basis='local',
                            obstacles=[Plane((0, 0, -0.012), (0, 0, 1))]).solve(gripper)
    assert shape.converged
    assert len([one for one in shape.contacts if one.s > 0.3]) > 10
    np.testing.assert_allclose(shape.frames[-1][2], [0, 0, 1], atol=1e-6)
    assert shape.positions[-1, 2] == pytest.approx(-0.012 + THICK / 2, abs=1e-9)
    total = shape.gripper_wrench[2] + sum(one.force for one in shape.contacts)
    assert total == pytest.approx(WEIGHT * 0.4, rel=1e-6)


def test_a_strip_that_is_rolled_bears_on_one_edge_and_twists_by_it():
    roll = 0.1
    gripper = Pose.from_rotation((0, 0, 0), Rotation.from_rotvec([roll, 0, 0]).as_matrix())
    floor = Plane((0, 0, -0.012), (0, 0, 1))
    shape = DirectSimulator(STRIP, n_elements=64, obstacles=[floor]).solve(gripper)
    assert shape.converged and shape.contacts
    lowest = min(float(place[2] - abs(axes[2, 1]) * WIDTH / 2 - abs(axes[2, 2]) * THICK / 2)
                 for axes, place in zip(shape.frames, shape.positions, strict=True))
    assert lowest == pytest.approx(-0.012, abs=1e-8)
    # the edge is pushed up with a lever of half the width: Saint-Venant's torsion
    twist = roll - np.arcsin(shape.frames[-1][2, 1])
    torque = shape.contacts[0].force * WIDTH / 2
    assert twist == pytest.approx(torque * 0.4 / STRIP.torsional_stiffness, rel=0.03)
    weight = WEIGHT * 0.4
    total = shape.gripper_wrench[2] + sum(one.force * one.normal[2] for one in shape.contacts)
    assert total == pytest.approx(weight, rel=1e-6)


@pytest.mark.parametrize('off', [0.0, 0.004])
def test_a_ball_under_the_middle_of_a_strip_carries_it(off):
    ball = Sphere((0.3, off, -0.02 - THICK / 2), 0.02)
    shape = DirectSimulator(STRIP, n_elements=64, obstacles=[ball]).solve(Pose.identity())
    assert shape.converged and len(shape.contacts) == 1
    contact = shape.contacts[0]
    axes, place = shape.frame_at(contact.s)
    offset = (ball.center - place) @ axes[:, 1]
    low = place + axes[:, 1] * offset - axes[:, 2] * THICK / 2
    assert np.linalg.norm(low - ball.center) == pytest.approx(0.02, abs=1e-9)
    # the force passes through the ball's center: what it turns is borne by the gripper alone
    moment = shape.gripper_wrench[3:] + np.cross(low, contact.force * contact.normal)
    mass = STRIP.mass_per_length * np.diff(shape.s)
    middle = 0.5 * (shape.positions[1:] + shape.positions[:-1])
    moment += np.cross(middle, mass[:, None] * np.array([0, 0, -9.81])).sum(axis=0)
    np.testing.assert_allclose(moment, 0, atol=2e-6)


PLUG = Rod(0.2, 0.05, 0.05, 0.05, radius=((0, 0.002), (0.15, 0.002), (0.15, 0.006), (0.2, 0.006)))


@pytest.mark.parametrize(('hole', 'passes'), [(0.004, False), (0.0064, True)])
def test_a_plug_butts_against_the_rim_of_a_hole_that_is_too_small(hole, passes):
    sheet = Sheet.around(CutOut(Pose((0.25, 0, 0), (0, 0, 0, 1)), radius=hole), thickness=0.0)
    direct = DirectSimulator(PLUG, n_elements=64, gravity=(0, 0, 0), obstacles=[sheet])
    # the thin part is in the hole, the plug is drawn back to the sheet from behind
    ways = [Pose((x, 0, 0), (0, 0, 0, 1)) for x in (0.106, 0.1024, 0.0975)]
    shapes = direct.track(ways)
    reached = min(shape.gripper.position[0] for shape in shapes if shape.converged)
    if passes:
        assert reached == pytest.approx(ways[-1].position[0])
        assert all(shape.converged for shape in shapes)
    else:  # its face is 0.15 from the gripper
        assert 0.0999 < reached < 0.1026
