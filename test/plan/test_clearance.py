# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Room in holes and beside bodies."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    DirectSimulator,
    InverseSimulator,
    LayOnLine,
    Plane,
    Pose,
    Rod,
    Sheet,
    Sphere,
)
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import clearance, hole_clearances
from dlo_planner.tasks import MoveTo

WIDTH, THICKNESS = 0.02, 0.004
STRIP = Rod.rectangular(0.3, WIDTH, THICKNESS, 1000.0, 1e8, 0.3)
SURFACE = Surface.of(STRIP)
CURVED = Rod.rectangular(0.3, WIDTH, THICKNESS, 0.0, 1e8, 0.3, natural_curvature=(3.0, 1.0),
                         natural_twist=4.0)


def straight(roll, rod=STRIP, position=(0, 0, 0)):
    """Return a Shape along x, rolled about it."""
    gripper = Pose.from_rotation(position, Rotation.from_rotvec([roll, 0, 0]).as_matrix())
    return DirectSimulator(rod, gravity=(0, 0, 0)).solve(gripper)


def outside(shape, half, fine=400):
    """Return (n, 3) points of the outside of a rectangular DLO."""
    side = np.linspace(-1, 1, 81)
    rim = np.concatenate([np.column_stack([side, np.full(81, one)]) for one in (-1, 1)]
                         + [np.column_stack([np.full(81, one), side]) for one in (-1, 1)])
    points = []
    for s in np.linspace(0, shape.s[-1], fine):
        axes, place = shape.frame_at(s)
        points.append(place + rim * half @ axes[:, 1:].T)
    return np.concatenate(points)


@pytest.mark.parametrize('roll', [0.0, 0.3, np.pi / 4, 1.2, np.pi / 2, 2.5])
@pytest.mark.parametrize('hole', [{'width': 0.03, 'height': 0.012}, {'radius': 0.013}])
def test_room_in_a_hole_is_that_of_the_corners(roll, hole):
    center = np.array([0.15, 0.001, -0.002])
    sheet = Sheet.around(CutOut(Pose(center, (0, 0, 0, 1)), **hole))
    corners = np.array([(y, z) for y in (-1, 1) for z in (-1, 1)]) * [WIDTH / 2, THICKNESS / 2]
    turn = Rotation.from_rotvec([roll, 0, 0]).as_matrix()[1:, 1:]
    y, z = (corners @ turn.T - center[1:]).T
    if 'radius' in hole:
        wanted = (hole['radius'] - np.hypot(y, z)).min()
    else:
        wanted = np.minimum(hole['width'] / 2 - abs(y), hole['height'] / 2 - abs(z)).min()
        if wanted < 0:
            outer = np.maximum(abs(y) - hole['width'] / 2, 0), np.maximum(
                abs(z) - hole['height'] / 2, 0)
            wanted = -np.hypot(*outer).max()
    found = hole_clearances(sheet, np.array([1.0, 0, 0]), SURFACE, straight(roll))
    assert found[0] == pytest.approx(wanted, abs=1e-12)


def distance(obstacle, points):
    """Return distances (n,) of points outside an obstacle."""
    if isinstance(obstacle, Plane):
        return (points - obstacle.point) @ obstacle.normal
    if isinstance(obstacle, Sphere):
        return np.linalg.norm(points - obstacle.center, axis=1) - obstacle.radius
    if isinstance(obstacle, Capsule):
        along = obstacle.end - obstacle.start
        share = np.clip((points - obstacle.start) @ along / (along @ along), 0, 1)
        return np.linalg.norm(points - obstacle.start - share[:, None] * along,
                              axis=1) - obstacle.radius
    local = (points - obstacle.pose.position) @ obstacle.pose.rotation
    if isinstance(obstacle, Sheet):  # of one round hole in its middle
        beside = np.maximum(abs(local[:, 0]) - obstacle.thickness / 2, 0)
        plate = np.maximum(abs(local[:, 1:]) - [obstacle.width / 2, obstacle.height / 2], 0)
        rim = np.maximum(obstacle.cutouts[0].radius - np.hypot(*local[:, 1:].T), 0)
        return np.linalg.norm(np.column_stack([beside, rim, plate]), axis=1)
    return np.linalg.norm(np.maximum(abs(local) - obstacle.size / 2, 0), axis=1)


@pytest.mark.parametrize('index', range(8))
def test_clearance_of_a_curved_strip_against_samples(index):
    rng = np.random.default_rng(index)
    gripper = Pose((0, 0, 0), (0, 0, 0, 1))
    shape = DirectSimulator(CURVED, gravity=(0, 0, 0)).solve(gripper)
    points = outside(shape, np.array([WIDTH, THICKNESS]) / 2)
    axes, place = shape.frame_at(rng.uniform(0.1, 0.25))
    angle = rng.uniform(0, 2 * np.pi)
    away = axes[:, 1] * np.cos(angle) + axes[:, 2] * np.sin(angle)
    across = rng.normal(size=3)
    across -= (across @ away) * away
    turn = Rotation.random(random_state=rng).as_matrix()
    obstacle = [Sphere(place + 0.03 * away, 0.012), Plane(place - 0.05 * away, away),
                Capsule(place + 0.04 * away - 0.01 * across, place + 0.04 * away + 0.01 * across,
                        0.003),
                Box(Pose.from_rotation(place + 0.04 * away, turn), (0.02, 0.03, 0.01))][index % 4]
    wanted = distance(obstacle, points).min()
    assert wanted > 0 or isinstance(obstacle, Plane)
    # the samples lie 0.8 mm apart along the DLO and up to 0.25 mm across it
    assert clearance([obstacle], SURFACE, shape) == pytest.approx(wanted, abs=4e-5)


PLUG = Rod(0.2, 0.01, 1.0, 1.0, radius=((0, 0.002), (0.15, 0.002), (0.15, 0.006), (0.2, 0.006)))


@pytest.mark.parametrize(('depth', 'wanted'), [(0.02, 0.004 - 0.006), (0.07, 0.004 - 0.002)])
def test_what_passes_the_hole_counts_with_its_own_radius(depth, wanted):
    shape = DirectSimulator(PLUG, gravity=(0, 0, 0), n_elements=64).solve(Pose.identity())
    sheet = Sheet.around(CutOut(Pose((0.2 - depth, 0, 0), (0, 0, 0, 1)), radius=0.004),
                         thickness=0.0)
    assert hole_clearances(sheet, np.array([1.0, 0, 0]), Surface.of(PLUG),
                           shape)[0] == pytest.approx(
        wanted, abs=1e-9)


HOSE = Rod(1.0, 0.05, 0.3, 0.3, radius=4e-3)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.02)
PLATE = Sheet(HOLE.pose, 3.0, 3.0, 0.02, (HOLE,))
BALLS = [Sphere((x, 0.1, 0.97), 0.05) for x in (-0.35, 0.35)]
FLOOR = Plane((0, 0, 0), (0, 0, 1))
BAR = Capsule((0, -0.3, -0.05), (0, 0.3, -0.05), 0.05)
TOUCH = Pose((0, 0, 0), (0, 0, 0, 1))


def further(x):
    """Return a hole in a plate of its own, on from the first."""
    hole = CutOut(Pose.looking_along((x, 0, 1 - 0.3 * x), (1, 0, -0.3)), radius=0.03)
    return hole, Sheet(hole.pose, 0.15, 0.15, 0.004, (hole,))


def way_there(inverse):
    first = inverse.thread(HOLE, depths=[0.0, 0.1])
    start = first.grippers[0]
    return inverse.approach(HOLE, first, Pose(start.position - (0.12, 0.02, 0), start.quaternion),
                            standoff=0.05)


TASKS = {
    'thread': ([PLATE, *BALLS], lambda one: one.thread(HOLE, depths=np.linspace(0, 0.6, 5))),
    'two': ([PLATE, further(0.2)[1], *BALLS], lambda one: one.thread_two(
        HOLE, further(0.2)[0], depths=np.linspace(0, 0.6, 7))),
    'three': ([PLATE, further(0.2)[1], further(0.4)[1]], lambda one: one.thread_sequence(
        [HOLE, further(0.2)[0], further(0.4)[0]], depths=np.linspace(0, 0.6, 13))),
    'insert': (BALLS[:1], lambda one: one.insert(CutOut(HOLE.pose), depths=[0, 0.2, 0.4])),
    'hold': ([BAR, Sphere((-0.1, 0.1, 0.1), 0.05)], lambda one: one.hold_contact(TOUCH, 0.8)),
    'slide': ([BAR, Sphere((-0.1, 0.1, 0.1), 0.05)], lambda one: one.slide_contact(
        TOUCH, np.linspace(0.8, 0.7, 3))),
    'approach': ([PLATE, BALLS[0]], way_there),
    'lay': ([FLOOR], lambda one: one.plan(LayOnLine(Pose((0, 0, 0.1), (0, 0, 0, 1)), 0.05,
                                                    [0.0, 0.1], tolerance=5e-3))),
    'move': ([BALLS[0]], lambda one: one.plan(
        MoveTo([Pose((-0.6, -0.3, 1.1), (0, 0, 0, 1)), Pose((-0.6, -0.1, 1.2), (0, 0, 0, 1))]),
        start=Pose((-0.6, -0.3, 1.2), (0, 0, 0, 1))))}


@pytest.mark.parametrize('task', TASKS)
def test_the_clearance_of_a_plan_is_that_of_the_dlos_surface(task):
    # whatever the goals: beside the sheets of holes, beside other obstacles, and 0 in contact
    obstacles, planned = TASKS[task]
    plan = planned(InverseSimulator(DirectSimulator(HOSE, obstacles=obstacles)))
    for reported, shape in zip(plan.clearance, plan.shapes, strict=True):
        axis = shape.positions_at(np.linspace(0, shape.s[-1], 2000))
        measured = min(distance(one, axis).min() for one in obstacles) - HOSE.radius
        assert reported == pytest.approx(measured, abs=1e-4)


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('thickness', [0.0, 0.006])
def test_the_outline_of_a_narrow_sheet_counts_below_a_face(seed, thickness):
    """No edge of the strip comes as near as its face, of which points all over are looked at."""
    rng = np.random.default_rng(seed)
    shape = straight(rng.uniform(-0.3, 0.3))
    half = 0.5 * np.array([thickness, 0.006, 0.05])  # m, narrower than the strip
    turn = Rotation.from_rotvec(rng.uniform(-0.15, 0.15, 3)).as_matrix()
    sheet = Sheet(Pose.from_rotation((0.15, 0.001, -0.035), turn), 0.006, 0.05, thickness)
    assert clearance([sheet], SURFACE, shape) == pytest.approx(
        min_to_box(outside(shape, SURFACE.half), sheet.pose, half), abs=1e-5)
    cut = Sheet(Pose.from_rotation((0.15, 0.001, -0.02), turn), 0.006, 0.05, thickness)
    assert clearance([cut], SURFACE, shape) <= 1e-12


def min_to_box(points, pose, half):
    """Return the smallest distance of points (n, 3) from a box with half sizes (3,), in m."""
    beyond = np.abs((points - pose.position) @ pose.rotation) - half
    return np.sqrt((np.maximum(beyond, 0.0) ** 2).sum(axis=1)).min()
