# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Distances against brute force and differences."""

import numpy as np
import pytest
from meshes import SOLIDS
from scipy.optimize import minimize

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    Ellipsoid,
    Hull,
    InvalidTask,
    Mesh,
    Plane,
    Pose,
    Sheet,
    Sphere,
)
from dlo_planner.energy import scene as scenes
from dlo_planner.energy.scene import (
    KINDS,
    SHEET,
    build_scene,
    is_convex,
    sheet_distance,
    signed_distance,
)
from dlo_planner.model import obstacles
from dlo_planner.model.rod import Surface

POSE = Pose((0.1, -0.2, 0.3), (0.2, -0.1, 0.4, 0.8))
ROUND = CutOut(Pose.from_rotation(POSE.position + POSE.rotation @ [0, 0.1, 0.05], POSE.rotation),
               radius=0.08)
TURNED = POSE.rotation @ np.array([[-1, 0, 0], [0, -0.8, 0.6], [0, 0.6, 0.8]])
SQUARE = CutOut(Pose.from_rotation(POSE.position + POSE.rotation @ [0, -0.12, 0], TURNED),
                width=0.1, height=0.06)
OBSTACLES = [Plane((0, 0, 0.2), (1, 2, 3)), Sphere((0.3, 0.1, 0.2), 0.15),
             Capsule((0.3, 0, 0), (0.1, 0.4, 0.3), 0.05), Box(POSE, (0.1, 0.3, 0.5)),
             Sheet(POSE, 0.5, 0.6, 0.02, [ROUND, SQUARE]), Sheet(POSE, 0.5, 0.4, 0.0, SQUARE),
             Cylinder((0.3, 0, 0.1), (0.1, 0.1, 0.3), 0.12),
             Cylinder((0.1, -0.2, 0.3), (0.12, -0.18, 0.31), 0.3),
             Ellipsoid(POSE, (0.1, 0.3, 0.2)), Ellipsoid(POSE, (0.4, 0.02, 0.4)),
             Hull(SOLIDS['wedge'].vertices, POSE), Mesh(*SOLIDS['bracket'], POSE)]
SCENE = build_scene(OBSTACLES, 0.0)


def distance(index, x):
    """Return the distance from an obstacle, that from the nearest of its bodies; normal, bend."""
    found = []
    for body in np.flatnonzero(SCENE.source == index):
        normal, bend = np.empty(3), np.empty((3, 3))
        found.append((signed_distance(SCENE, body, np.array(x, dtype=float), normal, bend), normal,
                      bend))
    return min(found, key=lambda one: one[0])


def points(rng, number=200):
    return POSE.position + rng.uniform(-0.5, 0.5, size=(number, 3))


@pytest.mark.parametrize('index', range(len(OBSTACLES)))
def test_derivatives_against_differences(index, rng):
    step = 1e-6
    for x in points(rng):
        _, normal, bend = distance(index, x)
        assert np.linalg.norm(normal) == pytest.approx(1)
        near = [[distance(index, x + sign * step * e) for sign in (1, -1)] for e in np.eye(3)]
        if any(a[1] @ b[1] < 0.99 for a, b in near):
            continue  # a ridge, where the nearest feature changes
        slope = [(a[0] - b[0]) / (2 * step) for a, b in near]
        np.testing.assert_allclose(normal, slope, atol=1e-6)
        curved = np.column_stack([(a[1] - b[1]) / (2 * step) for a, b in near])
        np.testing.assert_allclose(bend, curved, atol=2e-4 * max(1, np.abs(bend).max()))


@pytest.mark.parametrize('body', np.flatnonzero(SCENE.kind == SHEET))
def test_the_distance_of_a_sheet_alone(body, rng):
    normal, bend = np.empty(3), np.empty((3, 3))
    inside = 0
    for x in np.vstack([points(rng, 2000), *(one.center + 0.06 * points(rng, 500)
                                             for one in (ROUND, SQUARE))]):
        known = signed_distance(SCENE, body, x, normal, bend)
        assert sheet_distance(SCENE, body, x) == pytest.approx(known, abs=1e-15)
        inside += known < 0
    assert inside or SCENE.size[body, 0] == 0


def test_each_kind_is_tried_and_has_its_number():
    assert {type(one) for one in OBSTACLES} == set(obstacles.OBSTACLES), 'OBSTACLES of this file'
    assert set(SCENE.kind) == set(range(len(KINDS)))
    assert [getattr(scenes, kind.upper()) for kind in KINDS] == list(range(len(KINDS)))


@pytest.mark.parametrize('body', [o for o in range(SCENE.kind.size) if is_convex(SCENE, o)])
def test_a_body_is_convex(body, rng):
    # contacts, passages and the workspace take the plane at its nearest point as a bound of all
    def away(x):
        return signed_distance(SCENE, body, x, np.empty(3), np.empty((3, 3)))

    for a, b in zip(points(rng), points(rng), strict=True):
        assert away(0.5 * (a + b)) <= 0.5 * (away(a) + away(b)) + 1e-12


def inside_sheet(x, thickness, holes):
    local = (np.asarray(x) - POSE.position) @ POSE.rotation
    if abs(local[0]) > thickness / 2 + 1e-12 or abs(local[1]) > 0.25 or abs(local[2]) > 0.3:
        return False
    for hole in holes:
        own = (np.asarray(x) - hole.center) @ hole.pose.rotation
        if hole.radius is not None and np.hypot(*own[1:]) < hole.radius:
            return False
        if hole.radius is None and abs(own[1]) < hole.width / 2 and abs(own[2]) < hole.height / 2:
            return False
    return True


def test_sheet_is_where_it_should_be(rng):
    for x in points(rng, 2000):
        assert (distance(4, x)[0] <= 0) == inside_sheet(x, 0.02, [ROUND, SQUARE])


def test_walking_back_along_the_normal_meets_the_surface(rng):
    for index in range(len(OBSTACLES)):
        for x in points(rng):
            far, normal, _ = distance(index, x)
            if far > 0:
                assert distance(index, x - far * normal)[0] == pytest.approx(0, abs=1e-12)


def test_capsule_against_a_search(rng):
    bar = OBSTACLES[2]
    for x in points(rng, 20):
        found = minimize(lambda t, x=x: np.linalg.norm(
            x - bar.start - t[0] * (bar.end - bar.start)), [0.5], bounds=[(0, 1)], tol=1e-14)
        assert distance(2, x)[0] == pytest.approx(found.fun - bar.radius, abs=1e-7)


@pytest.mark.parametrize('index', [6, 7])
def test_cylinder_against_brute_force(index, rng):
    body = OBSTACLES[index]
    along = body.end - body.start
    axis = along / np.linalg.norm(along)
    def beside(y):
        """Return the part (3,) of y across the axis."""
        return y - body.start - axis * (axis @ (y - body.start))

    solid = [{'type': 'ineq', 'fun': rule} for rule in (
        lambda y: axis @ (y - body.start), lambda y: axis @ (body.end - y),
        lambda y: body.radius**2 - beside(y) @ beside(y))]
    for x in points(rng, 50):
        away = x - body.start
        height = away @ axis
        rho = np.linalg.norm(away - height * axis)
        found = distance(index, x)[0]
        if found > 0:
            nearest = minimize(lambda y, x=x: (y - x) @ (y - x), body.start + 0.5 * along,
                               method='SLSQP', constraints=solid, options={'ftol': 1e-15})
            assert found == pytest.approx(np.sqrt(nearest.fun), abs=1e-7)
        else:  # inside: the nearest of three ways out
            assert found == pytest.approx(
                -min(height, np.linalg.norm(along) - height, body.radius - rho), abs=1e-12)


def test_an_even_ellipsoid_is_a_sphere(rng):
    radius = 0.15
    bodies = Ellipsoid(POSE, (radius,) * 3), Sphere(POSE.position, radius)
    scenes = [build_scene([body], 0.0) for body in bodies]
    for x in points(rng, 50):
        found = []
        for scene in scenes:
            normal, bend = np.empty(3), np.empty((3, 3))
            found.append((signed_distance(scene, 0, x, normal, bend), normal, bend))
        for one, other in zip(*found, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize('index', [8, 9])
def test_ellipsoid_against_a_search(index, rng):
    body = OBSTACLES[index]
    half = body.half_axes

    def surface(direction):
        return half * direction / np.linalg.norm(direction)

    grid = rng.normal(size=(500, 3))
    for x in points(rng, 25):
        p = body.pose.rotation.T @ (x - body.pose.position)
        across = p / half  # straight out of what is thin
        k = np.argmin(half)
        across[k] = np.copysign(np.sqrt(max(1 - across @ across + across[k] ** 2, 0)), p[k])
        begin = min([*grid, across], key=lambda one, p=p: np.linalg.norm(surface(one) - p))
        nearest = minimize(
            lambda one, p=p: np.sum((half * one - p) ** 2), begin / np.linalg.norm(begin),
            method='SLSQP', options={'ftol': 1e-15, 'maxiter': 1000},
            constraints=[{'type': 'eq', 'fun': lambda one: one @ one - 1}])
        sign = -1 if np.sum((p / half) ** 2) < 1 else 1
        assert distance(index, x)[0] == pytest.approx(sign * np.sqrt(nearest.fun), abs=1e-7)


@pytest.mark.parametrize('index', [8, 9])
def test_ends_and_middle_of_an_ellipsoid(index):
    body = OBSTACLES[index]
    for k in range(3):
        end = POSE.position + POSE.rotation[:, k] * body.half_axes[k]
        far, normal, bend = distance(index, end + 0.3 * POSE.rotation[:, k])
        assert far == pytest.approx(0.3)
        np.testing.assert_allclose(normal, POSE.rotation[:, k], atol=1e-12)
        for j in {0, 1, 2} - {k}:  # the radius of its bend there, and the way to it
            radius = body.half_axes[j] ** 2 / body.half_axes[k]
            along = POSE.rotation[:, j]
            assert along @ bend @ along == pytest.approx(1 / (radius + 0.3))
    far, normal, bend = distance(index, POSE.position)
    assert far == pytest.approx(-body.half_axes.min())
    assert np.linalg.norm(normal) == pytest.approx(1) and np.isfinite(bend).all()


def test_middle_of_a_cylinder_has_a_way_out():
    for body, out in ((Cylinder((0, 0, -1), (0, 0, 1), 0.1), -0.1),
                      (Cylinder((0, 0, -0.1), (0, 0, 0.1), 1.0), -0.1)):
        scene, normal, bend = build_scene([body], 0.0), np.empty(3), np.empty((3, 3))
        assert signed_distance(scene, 0, np.zeros(3), normal, bend) == pytest.approx(out)
        assert np.linalg.norm(normal) == 1 and np.isfinite(bend).all()


def test_a_section_with_edges_is_refused_by_a_cylinder():
    body, strip = Cylinder((0, 0, 0), (1, 0, 0), 0.1), Surface(0.01, (0.01, 0.001))
    with pytest.raises(InvalidTask, match='Cylinder.*round section'):
        build_scene([body], strip)


@pytest.mark.parametrize('cutouts', [ROUND, SQUARE], ids=['round', 'square'])
@pytest.mark.parametrize('thickness', [2e-3, 0.02, 0.1])
def test_the_wall_of_a_hole_is_closed(thickness, cutouts, rng):
    scene = build_scene([Sheet(POSE, 0.5, 0.6, thickness, cutouts)], 1e-3)
    normal, bend = np.empty(3), np.empty((3, 3))
    hole = np.array(cutouts.pose.rotation)
    for _ in range(200):
        height, angle = thickness * rng.uniform(-0.5, 0.5), rng.uniform(0, 2 * np.pi)
        away = np.array([np.cos(angle), np.sin(angle)])
        if cutouts.radius is None:
            reach = np.min(np.array([cutouts.width, cutouts.height]) / 2 / np.abs(away))
        else:
            reach = cutouts.radius
        depth = rng.uniform(-5e-3, 5e-3)  # along the ray; what is left of it across the wall
        x = cutouts.center + height * POSE.direction + hole[:, 1:] @ away * (reach + depth)
        gap = min(signed_distance(scene, o, x, normal, bend) for o in range(scene.kind.size))
        if cutouts.radius is not None:
            assert gap == pytest.approx(max(-depth, abs(height) - thickness / 2), abs=1e-12)
        else:
            assert np.sign(gap) == -np.sign(depth) and abs(gap) <= abs(depth) + 1e-12


def test_both_layers_of_a_sheet_push_the_same_way(rng):
    # (but in its middle, where nothing tells to which side)
    scene = build_scene([Sheet(POSE, 0.5, 0.6, 0.02, ROUND)], 1e-3)
    assert scene.kind.size == 2
    for x in points(rng, 500):
        local = (x - POSE.position) @ POSE.rotation * (0.02, 1, 1)  # most of them in the material
        found = []
        for o in range(2):
            normal, bend = np.empty(3), np.empty((3, 3))
            found.append((signed_distance(scene, o, POSE.position + POSE.rotation @ local, normal,
                                          bend), normal))
        (one, out), (other, there) = found
        if min(one, other) < 0:
            assert one == pytest.approx(other) and out @ there == pytest.approx(1)


@pytest.mark.parametrize('order', [1, -1])
def test_a_hole_is_in_its_own_sheet_only(order):
    behind = Pose.from_rotation(POSE.position + POSE.direction, POSE.rotation)
    closed, open_ = Sheet(behind, 0.5, 0.6, 0.0), Sheet(POSE, 0.5, 0.6, 0.0, ROUND)
    scene = build_scene([closed, open_][::order], 0.0)
    normal, bend = np.empty(3), np.empty((3, 3))
    first, second = (0, 1)[::order]
    x = ROUND.center + POSE.direction
    assert signed_distance(scene, first, x, normal, bend) == pytest.approx(0, abs=1e-12)
    center = np.array(ROUND.center)
    assert signed_distance(scene, second, center, normal, bend) == pytest.approx(0.08)
