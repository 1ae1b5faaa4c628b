# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Fibers of a section that yields, against a fine section of fibers written here, on any path."""

from functools import cache

import numpy as np
import pytest

from dlo_planner import Rod
from dlo_planner.energy.plastic import add_plastic, return_map, yielding_layers

MATERIAL = {'density': 8960.0, 'youngs_modulus': 110e9, 'poisson_ratio': 0.34,
            'yield_stress': 60e6}
RODS = {'round': Rod.circular(1.0, 2e-3, **MATERIAL),
        'thick tube': Rod.tube(1.0, 2e-3, 0.9e-3, **MATERIAL),
        'thin tube': Rod.tube(1.0, 2e-3, 1.8e-3, **MATERIAL),
        'square': Rod.rectangular(1.0, 2e-3, 2e-3, **MATERIAL),
        'flat': Rod.rectangular(1.0, 12e-3, 0.5e-3, **MATERIAL)}


@cache
def cells(section, count=200, parts=5):
    """Return middles x, y along n and b and the stiffness (n,) of the cells of a section.

    At a rim a cell counts by the part of it that is inside.
    """
    def mean(values):
        return values.reshape(count, parts, count, parts).mean(axis=(1, 3))

    middle = (np.arange(count * parts) + 0.5) / (count * parts) * 2 - 1
    x, y = np.meshgrid(middle * section.half_n, middle * section.half_b)
    inside = np.ones_like(x)
    if section.kind != 'rectangular':
        away = np.hypot(x, y)
        inside = ((away < section.half_n) & (away > section.inner)).astype(float)
    area = mean(inside)
    kept = area > 0
    cell = 4 * section.half_n * section.half_b / count**2
    return (mean(x * inside)[kept] / area[kept], mean(y * inside)[kept] / area[kept],
            section.youngs_modulus * cell * area[kept])


class FineSection:
    """Some 40,000 ideally plastic fibers of a section, strained by e = k_n y - k_b x."""

    def __init__(self, rod):
        self.x, self.y, self.stiffness = cells(rod.section)
        self.limit = MATERIAL['yield_stress'] / rod.section.youngs_modulus
        self.plastic = np.zeros(self.x.size)

    def moment(self, curvature):
        """Return the moment (2,) about n and b after a straight step to `curvature` (2,)."""
        strain = curvature[0] * self.y - curvature[1] * self.x
        elastic = np.clip(strain - self.plastic, -self.limit, self.limit)
        self.plastic = strain - elastic
        force = self.stiffness * elastic
        return np.array([force @ self.y, -force @ self.x])


class OneElement:
    """The package's section of a rod, on one element of 1 m."""

    def __init__(self, rod):
        self.stiffness = np.array([rod.stiffness])
        self.layers = yielding_layers(rod, self.stiffness)
        self.lost = 0.0

    def step(self, strain):
        """Return the moments (3,) after a step to `strain` (3,)."""
        strains, zero, gradient = np.array([strain]), np.zeros((1, 3)), np.zeros((1, 3))
        length = np.ones(1)
        add_plastic(length, strains, zero, self.layers, gradient)
        new, lost = return_map(length, strains, zero, self.layers)
        assert lost >= 0
        self.lost += lost
        self.layers = self.layers._replace(set=new)
        return gradient[0]

    def moment(self, curvature):
        """Return the moment (2,) about n and b after a step to `curvature` (2,)."""
        return self.step([0.0, *curvature])[1:]


def yield_moments(rod):
    return np.array(rod.bending_stiffness) * rod.yield_curvature


def largest_deviation(rod, path):
    """Return by how much moments deviate from fine fibers on a path (n, 2), in yield moments.

    The path is in multiples of the thresholds.
    """
    fine, coarse = FineSection(rod), OneElement(rod)
    off = [(coarse.moment(point * rod.yield_curvature) - fine.moment(point * rod.yield_curvature))
           / yield_moments(rod) for point in path]
    return np.linalg.norm(off, axis=1).max()


def corners(*points):
    """Return a path in steps through corners, from the straight shape."""
    path = [np.zeros(2)]
    for point in points:
        path += list(np.linspace(path[-1], point, 5)[1:])
    return np.array(path)


def on_circle(angle, size=4.0):
    return size * np.array([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize('name', RODS)
@pytest.mark.parametrize('about', [0, 1])
def test_bending_in_a_plane_of_symmetry(name, about):
    path = np.zeros((25, 2))
    path[:, about] = 1 / np.linspace(1, 0.1, 25)
    assert largest_deviation(RODS[name], path) < 3e-3


@pytest.mark.parametrize('name', RODS)
def test_bending_in_any_plane(name, rng):
    sizes = 1 / np.linspace(1, 0.2, 20)
    for angle in rng.uniform(0, 2 * np.pi, 4):
        assert largest_deviation(RODS[name], np.outer(sizes, on_circle(angle, 1.0))) < 0.012


TURNED = {
    'bent and turned by 90 degrees': np.vstack([
        corners(on_circle(0)), [on_circle(a) for a in np.linspace(0, np.pi / 2, 20)]]),
    'bent and turned round twice': np.vstack([
        corners(on_circle(0.4, 2.5)),
        [on_circle(a, 2.5) for a in np.linspace(0.4, 0.4 + 4 * np.pi, 50)]]),
    'square to it, kept': corners((4, 0), (4, 4)),
    'square to it, released': corners((4, 0), (2.6, 0), (0, 0), (0, 4)),
    'cycles in turning planes': corners(*[on_circle(0.7 * k, 3.0) * (-1)**k for k in range(6)])}


@pytest.mark.parametrize('name', RODS)
@pytest.mark.parametrize('way', TURNED)
def test_bending_that_turns(name, way):
    assert largest_deviation(RODS[name], TURNED[way]) < 0.02


@pytest.mark.parametrize('name', RODS)
def test_random_paths(name, rng):
    for _ in range(3):
        points = [on_circle(rng.uniform(0, 2 * np.pi), rng.uniform(0, 5)) for _ in range(5)]
        assert largest_deviation(RODS[name], corners(*points)) < 0.02


@pytest.mark.parametrize('name', RODS)
def test_a_step_within_the_thresholds_is_elastic(name, rng):
    rod, section = RODS[name], OneElement(RODS[name])
    for part in on_circle(rng.uniform(0, 2 * np.pi, 5), 1.0).T:
        np.testing.assert_allclose(section.moment(0.5 * part * rod.yield_curvature),
                                   0.5 * part * yield_moments(rod), rtol=1e-12)
    assert section.lost == 0


@pytest.mark.parametrize('model', ['round', 'rectangular'])
def test_fibers_without_a_section_are_those_of_one(model, rng):
    known = RODS['round' if model == 'round' else 'flat']
    rod = Rod(1.0, 0.1, known.bending_stiffness, known.torsional_stiffness, section_model=model,
              yield_curvature=known.yield_curvature, yield_torsion=known.yield_torsion)
    one, other = OneElement(known), OneElement(rod)
    for _ in range(4):
        strain = rng.normal(size=3) * 3 * np.array([known.yield_torsion, *known.yield_curvature])
        np.testing.assert_allclose(other.step(strain), one.step(strain), rtol=1e-12)


@pytest.mark.parametrize('model', ['round', 'rectangular'])
@pytest.mark.parametrize('thresholds', [(0.8, 0.5), (0.2, 3.0), (1.0, 1e12)])
def test_axes_that_fit_no_one_section_keep_their_own_curves(model, thresholds):
    # what is stated about one axis holds for it, whatever is stated about the other one
    stiffness = (1.3, 0.4)
    known = {'length': 1.0, 'mass_per_length': 0.0, 'torsional_stiffness': 1.0}
    both = Rod(**known, bending_stiffness=stiffness, yield_curvature=thresholds,
               section_model=model)
    for about in (0, 1):
        alone = Rod(**known, bending_stiffness=stiffness[about], section_model=model,
                    yield_curvature=thresholds[about])
        two, one = OneElement(both), OneElement(alone)
        for ratio in (0.9, 1.5, 2.5, -1.0, -4.0):
            bend = np.zeros(2)
            bend[about] = ratio * thresholds[about]
            if thresholds[about] > 1e9:
                bend[about] = ratio
            moment = two.moment(bend)
            assert moment[about] == pytest.approx(one.moment(bend)[about], rel=5e-3)
            assert abs(moment[1 - about]) <= 1e-12 * abs(moment[about])


def test_each_element_has_its_own_stiffness():
    # thresholds are the same all along, so moments at the same strain go with the stiffness
    rod = RODS['flat']
    stiffness = np.outer([1.0, 3.0, 0.2], rod.stiffness)
    layers, length = yielding_layers(rod, stiffness), np.array([0.2, 0.3, 0.5])
    strain = np.array([1.5 * rod.yield_torsion, *(2 * np.array(rod.yield_curvature))])
    gradient = np.zeros((3, 3))
    add_plastic(length, np.tile(strain, (3, 1)), np.zeros((3, 3)), layers, gradient)
    wanted = OneElement(rod).step(strain)
    np.testing.assert_allclose(gradient / length[:, None], np.outer([1.0, 3.0, 0.2], wanted),
                               rtol=1e-12)
    assert (np.abs(wanted) < np.abs(rod.stiffness * strain)).all()


def ring_torque(bore, x):
    """Return T / T_y of a ring at x times its threshold: the integral of shear times radius."""
    radius = bore + (1 - bore) * (np.arange(100_000) + 0.5) / 100_000
    return np.sum(radius**2 * np.minimum(x * radius, 1)) / np.sum(radius**3)


@pytest.mark.parametrize(('name', 'curve'), [
    ('round', lambda x: 4 / 3 - 1 / (3 * x**3)), ('thin tube', lambda x: ring_torque(0.9, x)),
    ('thick tube', lambda x: ring_torque(0.45, x)), ('flat', lambda x: 1.5 - 0.5 / x**2)])
def test_torsion_over_its_threshold(name, curve):
    rod, section = RODS[name], OneElement(RODS[name])
    for x in (0.5, 1.0, 1.3, 2.0, 5.0):
        torque = section.step([x * rod.yield_torsion, 0, 0])[0]
        wanted = x if x <= 1 else curve(x)
        assert torque / (rod.torsional_stiffness * rod.yield_torsion) == pytest.approx(
            wanted, abs=1.5e-3)
