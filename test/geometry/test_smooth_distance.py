# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The smooth distance from triangles against the exact one, and against spheres."""

import numpy as np
import pytest
from meshes import SOLIDS, ball

from dlo_planner.geometry import smooth_distance as smooth
from dlo_planner.geometry.bvh import joined, signed_from_surface, tree_of
from dlo_planner.geometry.smooth_distance import grids_of, smooth_distance

RADIUS = 0.006


@pytest.fixture(scope='module')
def made():
    """Return {name: (trees, grids, [Grid])} of some solids, for a DLO with the radius."""
    made = {}
    for name, surface in (('ball', ball(0.05, 8000)), ('bracket', SOLIDS['bracket'])):
        trees, _ = joined([tree_of(surface)])
        made[name] = trees, smooth.joined(grids_of(trees, (RADIUS, RADIUS)))
    return made


def value(trees, grids, x):
    normal, hessian = np.empty(3), np.empty((3, 3))
    away = smooth_distance(trees, 0, grids, 0, np.array(x, dtype=float), normal, hessian)
    return away, normal, hessian


def in_contact(trees, surface, rng, number):
    """Return places (n, 3) as far from a surface as the axis of the DLO that bears on it."""
    found = []
    while len(found) < number:
        normal, hessian = np.empty(3), np.zeros((3, 3))
        x = rng.uniform(surface.vertices.min(axis=0) - 0.01, surface.vertices.max(axis=0) + 0.01)
        for _ in range(3):
            away = signed_from_surface(trees, 0, x, np.inf, normal, hessian)
            x = x + (RADIUS - away) * normal
        if abs(signed_from_surface(trees, 0, x, np.inf, normal, hessian) - RADIUS) < 1e-9:
            found.append(x)
    return np.array(found)


@pytest.mark.parametrize('name', ['ball', 'bracket'])
def test_it_is_hardly_more_than_the_exact_distance_and_not_much_less(made, name, rng):
    trees, grids = made[name]
    surface = ball(0.05, 8000) if name == 'ball' else SOLIDS['bracket']
    places = in_contact(trees, surface, rng, 400)
    off = np.array([value(trees, grids, x)[0] for x in places]) - RADIUS
    # the error is measured in the middles of cells, not everywhere
    assert off.max() <= 2e-3 * RADIUS
    assert off.min() >= (-0.02 if name == 'ball' else -0.3) * RADIUS


def test_round_facets_bend_as_the_sphere_does(made, rng):
    trees, grids = made['ball']
    for way in rng.normal(size=(200, 3)):
        out = way / np.linalg.norm(way)
        away, normal, hessian = value(trees, grids, (0.05 + RADIUS) * out)
        assert away == pytest.approx(RADIUS, abs=0.02 * RADIUS)
        assert normal @ out > 1 - 1e-4
        bends = np.linalg.eigvalsh(hessian)
        np.testing.assert_allclose(bends, [0, 1 / (0.05 + RADIUS), 1 / (0.05 + RADIUS)], atol=5)


@pytest.mark.parametrize('name', ['ball', 'bracket'])
def test_the_normal_is_a_unit_vector_and_turns_as_the_hessian_says(made, name, rng):
    trees, grids = made[name]
    surface = ball(0.05, 8000) if name == 'ball' else SOLIDS['bracket']
    step = 1e-7
    for x in in_contact(trees, surface, rng, 100):
        _, normal, hessian = value(trees, grids, x)
        assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-12)
        near = [[value(trees, grids, x + sign * step * e) for sign in (1, -1)] for e in np.eye(3)]
        slope = np.array([(a[0] - b[0]) / (2 * step) for a, b in near])
        size = np.linalg.norm(slope)
        assert 0.65 < size < 1.05  # the least in a crease, where two walls are as near
        np.testing.assert_allclose(normal, slope / size, atol=1e-6)
        turn = np.column_stack([(a[1] - b[1]) / (2 * step) for a, b in near])
        across = np.eye(3) - np.outer(normal, normal)
        np.testing.assert_allclose(hessian, across @ turn @ across, atol=1e-3 * max(
            1, np.abs(hessian).max()))


def test_farther_away_it_is_no_more_than_the_exact_distance(made, rng):
    trees, grids = made['ball']
    assert grids.step.size > 1
    assert list(grids.further) == list(range(grids.step.size))[::-1]
    normal, hessian = np.empty(3), np.zeros((3, 3))
    known = 0
    for x in rng.uniform(-0.12, 0.12, (500, 3)):
        exact = signed_from_surface(trees, 0, x, np.inf, normal, hessian)
        found = value(trees, grids, x)[0]
        if exact > 4 * RADIUS and found < np.inf:
            known += 1
            assert 0.5 * exact < found <= exact + 1e-3 * RADIUS
    assert known > 200


def test_large_solids_have_larger_cells(monkeypatch):
    monkeypatch.setattr(smooth, '_MOST_BLOCKS', 60)
    trees, _ = joined([tree_of(SOLIDS['box'])])
    grid, *_ = grids_of(trees, (RADIUS, RADIUS))
    assert grid.step > 2 * RADIUS / 2
    assert grid.blocks <= 60


def test_only_what_is_looked_at_is_filled_and_its_numbers_do_not_depend_on_when(rng):
    surface = ball(0.05, 8000)
    trees, _ = joined([tree_of(surface)])
    one, other = (smooth.joined(grids_of(trees, (RADIUS, RADIUS))) for _ in range(2))
    places = in_contact(trees, surface, rng, 20)
    assert not one.weight.any()
    found = [value(trees, one, x)[0] for x in places]
    assert found == [value(trees, other, x)[0] for x in places[::-1]][::-1]
    filled = one.weight.all(axis=(1, 2, 3))
    assert 0 < filled.sum() <= 20
    np.testing.assert_array_equal(filled, one.weight.any(axis=(1, 2, 3)))
    np.testing.assert_array_equal(one.weight, other.weight)
