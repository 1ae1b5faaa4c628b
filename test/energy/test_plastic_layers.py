"""Layers that yield: elastic inside their limits, projected beyond, and the energy adds up."""

import numpy as np
import pytest

from dlo_planner.energy.elastic import add_elastic
from dlo_planner.energy.plastic import Layers, add_plastic, settled, yielded

LENGTHS = np.array([0.1, 0.3, 0.2])
STIFFNESS = np.tile(np.array([0.4, 0.7, 2.0]), (LENGTHS.size, 1))
SHARE = np.array([[0.5, 0.2], [0.3, 0.5], [0.2, 0.3]])
LIMIT = np.array([[0.5, 1.0, 0.4], [0.8, 1.5, 0.6], [np.inf] * 3])


def given(rng, size):
    """Return strains, natural strains and Layers, whose sets and strains are of about `size`."""
    natural = rng.normal(size=(3, 3))
    layers = Layers(SHARE, LIMIT, size * rng.normal(size=(3, 3, 3)))
    return natural + size * rng.normal(size=(3, 3)), natural, layers


def gradient_and_energy(strains, natural, layers):
    gradient = np.zeros((3, 3))
    energy = add_plastic(LENGTHS, strains, natural, STIFFNESS, layers, gradient)
    return gradient, energy


def test_inside_its_limits_a_section_is_elastic_about_its_set(rng):
    strains, natural, layers = given(rng, 0.05)
    gradient, energy = gradient_and_energy(strains, natural, layers)
    wanted, stored = np.zeros((3, 3)), 0.0
    for j in range(3):
        part = np.zeros((3, 3))
        stored += add_elastic(LENGTHS, strains, natural + layers.set[:, j],
                              STIFFNESS * SHARE[j, [0, 1, 1]], part)
        wanted += part
    np.testing.assert_allclose(gradient, wanted, atol=1e-14)
    assert energy == pytest.approx(stored)
    new, lost = settled(LENGTHS, strains, natural, STIFFNESS, layers)
    np.testing.assert_array_equal(new, layers.set)
    assert lost == 0


def test_a_step_stores_and_loses_what_it_costs(rng):
    strains, natural, layers = given(rng, 2.0)
    before = layers.set.copy()
    gradient, energy = gradient_and_energy(strains, natural, layers)
    new, lost = settled(LENGTHS, strains, natural, STIFFNESS, layers)
    np.testing.assert_array_equal(layers.set, before)  # the step may still be made again
    elastic = strains[:, None] - natural[:, None] - new
    stiffness = LENGTHS[:, None, None] * STIFFNESS[:, None] * SHARE[:, [0, 1, 1]]
    assert lost > 0
    assert energy == pytest.approx(0.5 * np.sum(stiffness * elastic**2) + lost)
    np.testing.assert_allclose(gradient, np.sum(stiffness * elastic, axis=1), atol=1e-12)
    part = np.abs(elastic[:, :2]) / LIMIT[:2]
    assert part[..., 0].max() == pytest.approx(1)
    bend = np.hypot(part[..., 1], part[..., 2])
    assert bend.max() == pytest.approx(1) and bend.max() < 1 + 1e-12
    # and there it stays
    again, more = settled(LENGTHS, strains, natural, STIFFNESS, layers._replace(set=new))
    np.testing.assert_allclose(again, new, atol=1e-12)
    assert more == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize('size', [1 + 1e-9, 1.0001, 1.05, 3.0])
def test_what_is_just_outside_comes_back_to_the_ellipse(size, rng):
    for angle in np.linspace(0, 2 * np.pi, 12):
        k1, k2, l1, l2 = rng.uniform(0.1, 5, 4)
        d1, d2 = l1 * size * np.cos(angle), l2 * size * np.sin(angle)
        e1, e2, multiplier = yielded(d1, d2, k1, k2, l1, l2)
        assert multiplier > 0
        assert np.hypot(e1 / l1, e2 / l2) == pytest.approx(1, abs=1e-13)
        inside = (d1 / size * (1 - 1e-9), d2 / size * (1 - 1e-9))
        assert yielded(*inside, k1, k2, l1, l2) == (*inside, 0.0)
