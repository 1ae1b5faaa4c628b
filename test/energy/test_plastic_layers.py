# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Springs that yield: elastic inside their limits, held at them beyond, and the energy adds up."""

import numpy as np
import pytest

from dlo_planner import Rod
from dlo_planner.energy.plastic import (
    add_plastic,
    add_plastic_stiffness,
    closest_point_projection,
    elastic_part,
    return_map,
    set_strains,
    yielding_layers,
)

LENGTHS = np.array([0.1, 0.3, 0.2])
STIFFNESS = np.array([[0.4, 0.7, 2.0], [0.3, 0.9, 1.0], [0.2, 0.5, 3.0]])
LIMITS = {'yield_curvature': (1.0, 0.4), 'yield_torsion': 0.5}
KINDS = {'ideal': {'section_model': 'ideal'}, 'round': {'section_model': 'round'},
         'rectangular': {'section_model': 'rectangular'},
         'hardening': {'section_model': 'round', 'hardening': 0.1},
         'ideal, hardening': {'section_model': 'ideal', 'hardening': 0.1},
         'bending only': {'section_model': 'round', 'yield_torsion': None},
         'torsion only': {'section_model': 'rectangular', 'yield_curvature': None}}


@pytest.fixture(params=KINDS)
def rod(request):
    return Rod(1.0, 0.0, (0.7, 2.0), 0.4, **{**LIMITS, **KINDS[request.param]})


@pytest.fixture
def layers(rod):
    return yielding_layers(rod, STIFFNESS)


def given(rng, layers, size):
    """Return strains, natural strains and Layers, whose sets and strains are of about `size`."""
    natural = rng.normal(size=(3, 3))
    sets = size * rng.normal(size=layers.set.shape)
    return natural + size * rng.normal(size=(3, 3)), natural, layers._replace(set=sets)


def elastic(strains, natural, part):
    """Return the moments (3, 3) and the energy of a part of the stiffness that never yields."""
    moments = part * LENGTHS[:, None] * STIFFNESS * (strains - natural)
    return moments, 0.5 * np.sum(moments * (strains - natural))


def gradient_and_energy(strains, natural, layers, rod):
    gradient, energy = elastic(strains, natural, rod.hardening)
    energy += add_plastic(LENGTHS, strains, natural, layers, gradient)
    return gradient, energy


def stiffness_of(strains, natural, layers, rod):
    out = rod.hardening * np.array([np.diag(row) for row in LENGTHS[:, None] * STIFFNESS])
    add_plastic_stiffness(LENGTHS, strains, natural, layers, np.ones((3, 3)), out)
    return out


def test_what_never_yields_is_the_hardening(rod):
    np.testing.assert_array_equal(elastic_part(rod).part, np.full(3, rod.hardening))
    np.testing.assert_array_equal(elastic_part(Rod(1.0, 0.0, 1.0, 0.4)).part, np.ones(3))


def test_inside_its_limits_a_section_is_elastic_about_its_set(layers, rod, rng):
    strains, natural, layers = given(rng, layers, 0.01)
    gradient, energy = gradient_and_energy(strains, natural, layers, rod)
    free = natural + set_strains(STIFFNESS, layers)
    wanted, stored = elastic(strains, free, 1.0)
    np.testing.assert_allclose(gradient, wanted, atol=1e-14)
    # the rest of the energy is locked in by sets that differ from fiber to fiber
    assert energy - gradient_and_energy(free, natural, layers, rod)[1] == pytest.approx(stored)
    new, lost = return_map(LENGTHS, strains, natural, layers)
    np.testing.assert_array_equal(new, layers.set)
    assert lost == 0
    np.testing.assert_allclose(stiffness_of(strains, natural, layers, rod),
                               [np.diag(row) for row in LENGTHS[:, None] * STIFFNESS], atol=1e-14)


def test_a_step_stores_and_loses_what_it_costs(layers, rod, rng):
    strains, natural, layers = given(rng, layers, 2.0)
    before = layers.set.copy()
    gradient, energy = gradient_and_energy(strains, natural, layers, rod)
    new, lost = return_map(LENGTHS, strains, natural, layers)
    np.testing.assert_array_equal(layers.set, before)  # the step may still be made again
    after = layers._replace(set=new)
    moment, stored = gradient_and_energy(strains, natural, after, rod)
    assert lost > 0
    assert energy == pytest.approx(stored + lost)
    np.testing.assert_allclose(moment, gradient, atol=1e-12)
    # and there it stays
    again, more = return_map(LENGTHS, strains, natural, after)
    np.testing.assert_allclose(again, new, atol=1e-12)
    assert more == pytest.approx(0, abs=1e-12)


def test_energy_moment_and_stiffness_are_derivatives(layers, rod, rng):
    strains, natural, layers = given(rng, layers, 2.0)
    gradient, _ = gradient_and_energy(strains, natural, layers, rod)
    stiffness, step = stiffness_of(strains, natural, layers, rod), 1e-6
    for e, i in np.ndindex(3, 3):
        change = np.zeros((3, 3))
        change[e, i] = step
        ahead, back = (gradient_and_energy(strains + sign * change, natural, layers, rod)
                       for sign in (1, -1))
        assert gradient[e, i] == pytest.approx((ahead[1] - back[1]) / (2 * step), abs=1e-7)
        np.testing.assert_allclose(stiffness[e, i], (ahead[0] - back[0])[e] / (2 * step),
                                   atol=1e-7)


@pytest.mark.parametrize('size', [1 + 1e-9, 1.0001, 1.05, 3.0])
def test_what_is_just_outside_comes_back_to_the_ellipse(size, rng):
    for angle in np.linspace(0, 2 * np.pi, 12):
        k1, k2, l1, l2 = rng.uniform(0.1, 5, 4)
        d1, d2 = l1 * size * np.cos(angle), l2 * size * np.sin(angle)
        e1, e2, multiplier = closest_point_projection(d1, d2, k1, k2, l1, l2)
        assert multiplier > 0
        assert np.hypot(e1 / l1, e2 / l2) == pytest.approx(1, abs=1e-13)
        inside = (d1 / size * (1 - 1e-9), d2 / size * (1 - 1e-9))
        assert closest_point_projection(*inside, k1, k2, l1, l2) == (*inside, 0.0)
