# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The distance from triangles against a look at all of them."""

import numpy as np
import pytest
from meshes import SOLIDS, blocks, distances

from dlo_planner.geometry.bvh import joined, line_to_surface, signed_from_surface, tree_of


def distance(trees, x, root=0, within=np.inf):
    normal, hessian = np.empty(3), np.zeros((3, 3))
    return signed_from_surface(trees, root, np.array(x), within, normal, hessian), normal, hessian


def points_about(surface, rng, number):
    middle, size = surface.vertices.mean(axis=0), np.ptp(surface.vertices, axis=0)
    return middle + rng.uniform(-1, 1, (number, 3)) * size


@pytest.mark.parametrize('name', SOLIDS)
def test_distance_and_sign_against_brute_force(name, rng):
    surface = SOLIDS[name]
    trees, _ = joined([tree_of(surface)])
    points = points_about(surface, rng, 400)
    found = [distance(trees, x)[0] for x in points]
    np.testing.assert_allclose(found, distances(surface, points), atol=1e-12)
    assert min(found) < 0 < max(found)


def test_each_of_several_surfaces_has_its_own_root(rng):
    surfaces = [SOLIDS['ring'], SOLIDS['bracket'], SOLIDS['box']]
    trees, roots = joined([tree_of(one) for one in surfaces])
    for surface, root in zip(surfaces, roots, strict=True):
        points = points_about(surface, rng, 30)
        np.testing.assert_allclose([distance(trees, x, root)[0] for x in points],
                                   distances(surface, points), atol=1e-12)


@pytest.mark.parametrize('name', SOLIDS)
def test_it_changes_by_no_more_than_the_place(name, rng):
    trees, _ = joined([tree_of(SOLIDS[name])])
    points = points_about(SOLIDS[name], rng, 1000)
    others = points + rng.normal(size=points.shape) * rng.choice([1e-6, 1e-3, 0.1], (1000, 1))
    for x, y in zip(points, others, strict=True):
        assert abs(distance(trees, x)[0] - distance(trees, y)[0]) <= np.linalg.norm(x - y) + 1e-15


@pytest.mark.parametrize('name', SOLIDS)
def test_derivatives_against_differences(name, rng):
    trees, _ = joined([tree_of(SOLIDS[name])])
    step, tried = 1e-7, 0
    for x in points_about(SOLIDS[name], rng, 150):
        _, normal, hessian = distance(trees, x)
        near = [[distance(trees, x + sign * step * e) for sign in (1, -1)] for e in np.eye(3)]
        if any(a[1] @ b[1] < 1 - 1e-6 for a, b in near):
            continue  # the middle of the body, or an end of what is nearest
        tried += 1
        np.testing.assert_allclose(normal, [(a[0] - b[0]) / (2 * step) for a, b in near], atol=1e-6)
        slopes = np.column_stack([(a[1] - b[1]) / (2 * step) for a, b in near])
        np.testing.assert_allclose(hessian, slopes, atol=1e-4 * max(1, np.abs(hessian).max()))
    assert tried > 100


def test_what_is_farther_than_asked_for_is_no_nearer():
    trees, _ = joined([tree_of(SOLIDS['box'])])
    assert distance(trees, (0.55, 0.0, 0.0), within=0.3)[0] == 0.3
    assert distance(trees, (0.55, 0.0, 0.0), within=0.6)[0] == pytest.approx(0.5)


@pytest.mark.parametrize('name', SOLIDS)
def test_a_line_against_its_points(name, rng):
    surface = SOLIDS[name]
    trees, _ = joined([tree_of(surface)])
    pierced = 0
    for p, q in zip(points_about(surface, rng, 60), points_about(surface, rng, 60), strict=True):
        line, triangle = line_to_surface(trees, 0, p, q, np.inf)
        along = [distance(trees, p + k / 200 * (q - p))[0] for k in range(201)]
        least, close = np.min(np.abs(along)), np.linalg.norm(q - p) / 400
        if min(along) < 0 < max(along):
            assert line == 0
            pierced += 1
        elif line == 0:  # it went in and out between two of them
            assert least <= close
        else:
            assert least - close <= line <= least + 1e-12
        assert triangle >= 0
    assert pierced
    assert line_to_surface(trees, 0, np.full(3, 5.0), np.full(3, 6.0), 0.1) == (0.1, -1)


def test_how_deep_a_point_knows_its_way_out_is_half_of_how_thick_a_plate_is():
    plate = blocks([(0, 0.3), (0, 0.2), (0, 0.004)], np.ones((1, 1, 1)))
    tree = tree_of(plate)
    flat = np.abs(tree.normal[:, 0, 2]) > 0.5
    np.testing.assert_allclose(tree.inner[flat], 0.002)
    assert (tree.inner[~flat] > 0.09).all()
