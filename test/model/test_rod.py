# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import math
from array import array

import numpy as np
import pytest

from dlo_planner import InvalidRod, Rod
from dlo_planner.model.rod import before, part_of_rod
from dlo_planner.model.varying import Expanded, resolved, smooth


def test_round_section_has_the_textbook_values():
    rod = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    assert rod.mass_per_length == pytest.approx(8960 * math.pi * 0.25e-6)
    assert rod.bending_stiffness[0] == pytest.approx(110e9 * math.pi * 1e-12 / 64)
    # GJ / EI = 1 / (1 + nu) for any round section
    assert rod.torsional_stiffness / rod.bending_stiffness[0] == pytest.approx(1 / 1.34)


def test_tube_is_the_difference_of_two_rounds():
    outer, inner = (Rod.circular(1.0, d, 1000.0, 1e7, 0.4) for d in (0.02, 0.012))
    tube = Rod.tube(1.0, 0.02, 0.012, 1000.0, 1e7, 0.4)
    assert tube.mass_per_length == pytest.approx(outer.mass_per_length - inner.mass_per_length)
    np.testing.assert_allclose(tube.stiffness, outer.stiffness - inner.stiffness)


@pytest.mark.parametrize(('ratio', 'factor'), [(1.0, 0.1406), (2.0, 0.229), (10.0, 0.312)])
def test_rectangular_torsion_constant_is_timoshenkos(ratio, factor):
    # Timoshenko and Goodier, art. 109: J = factor * w t^3
    rod = Rod.rectangular(1.0, ratio * 0.01, 0.01, 7850.0, 2.0, 0.0)  # G = 1
    assert rod.torsional_stiffness == pytest.approx(factor * ratio * 0.01**4, rel=3e-3)


def test_rectangular_is_soft_about_its_wide_axis():
    rod = Rod.rectangular(1.0, 0.02, 0.001, 7850.0, 210e9, 0.3)
    soft, hard = rod.bending_stiffness
    assert hard / soft == pytest.approx(400.0)


def test_callable_natural_strains():
    rod = Rod(2.0, 0.1, 1.0, 1.0, natural_curvature=lambda s: (s, 2 * s), natural_twist=math.sin)
    np.testing.assert_allclose(rod.natural_strains([0.5, 2.0]),
                               [[math.sin(0.5), 0.5, 1.0], [math.sin(2.0), 2.0, 4.0]])


@pytest.mark.parametrize(('change', 'named'), [
    ({'length': 0.0}, 'length = 0.0'),
    ({'bending_stiffness': (1.0, 0.0)}, 'bending_stiffness = 0.0'),
    ({'natural_curvature': lambda s: (1 / max(s, 0) if s else math.nan, 0)},
     'natural_curvature(0) = nan'),
    ({'point_masses': ((2.0, 1.0),)}, 'point_masses s = 2.0'),
    ({'damping': (1.0, -0.1)}, 'damping'),
    ({'hardening': 1.0}, 'hardening'), ({'section_model': 'oval'}, 'section_model'),
    ({'section_model': 'fibers'}, 'section_model'),
])
def test_bad_values_are_named(change, named):
    good = {'length': 1.0, 'mass_per_length': 0.1, 'bending_stiffness': 1.0,
            'torsional_stiffness': 1.0}
    with pytest.raises(InvalidRod) as caught:
        Rod(**{**good, **change})
    assert named in str(caught.value)


def test_bad_section_is_named():
    with pytest.raises(InvalidRod, match='poisson_ratio = 0.7'):
        Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.7)
    with pytest.raises(InvalidRod, match='inner_diameter = 0.02'):
        Rod.tube(1.0, 0.01, 0.02, 1000.0, 1e7, 0.4)


def test_pairs_may_be_any_row():
    for row in (tuple, list, np.array, lambda pair: array('d', pair)):
        rod = Rod(1.0, 0.1, row([1.0, 2.0]), 0.7, damping=row([0.5, 0.1]))
        assert rod.bending_stiffness == (1.0, 2.0)
        assert rod.damping == (0.5, 0.1)
    assert Rod(1.0, 0.1, [1.0], 0.7, damping=[0.1]) == Rod(1.0, 0.1, 1.0, 0.7, damping=(0.0, 0.1))


def test_a_function_that_fails_is_named():
    with pytest.raises(InvalidRod, match=r'Rod.natural_twist\(0\).* raised ZeroDivisionError'):
        Rod(1.0, 0.1, 1.0, 0.7, natural_twist=lambda s: 1 / s)


# ---- sections: which side of a rectangle is which, in radius, strain and yield --------------


WIDTH, THICKNESS = 0.02, 0.001
STRIP = Rod.rectangular(1.0, WIDTH, THICKNESS, 7850.0, 210e9, 0.3, yield_stress=400e6)


def test_the_radius_reaches_the_farthest_side():
    assert STRIP.radius == WIDTH / 2
    upright = Rod.rectangular(1.0, THICKNESS, WIDTH, 7850.0, 210e9, 0.3)
    assert upright.radius == WIDTH / 2
    assert Rod.tube(1.0, 0.02, 0.012, 1000.0, 1e7, 0.4).radius == 0.01


def test_bending_about_n_strains_the_thickness_and_about_b_the_width():
    curvature = 3.0
    bend = np.array([[0, curvature, 0], [0, 0, curvature], [0, -curvature, curvature]])
    axial = STRIP.section.surface_strain(bend)[:, 0]
    np.testing.assert_allclose(axial, curvature * np.array(
        [THICKNESS / 2, WIDTH / 2, (THICKNESS + WIDTH) / 2]))


def test_a_round_section_has_no_preferred_axis():
    wire = Rod.circular(1.0, 0.004, 7850.0, 210e9, 0.3)
    bend = 3.0 * np.array([[0, 1, 0], [0, 0, 1], [0, 0.6, -0.8]])
    np.testing.assert_allclose(wire.section.surface_strain(bend)[:, 0], 3.0 * 0.002)
    twisted = wire.section.surface_strain([[-2.0, 0, 0]])
    np.testing.assert_allclose(twisted, [[0, 2.0 * 0.002]])


@pytest.mark.parametrize('axis', [1, 2])
def test_yield_begins_where_the_surface_reaches_the_stress(axis):
    bend = np.zeros((1, 3))
    bend[0, axis] = STRIP.yield_curvature[axis - 1]
    strain = STRIP.section.surface_strain(bend)[0, 0]
    assert strain * STRIP.section.youngs_modulus == pytest.approx(400e6)


def test_torsion_yields_where_the_shear_does():
    bend = np.array([[STRIP.yield_torsion, 0, 0]])
    shear = STRIP.section.surface_strain(bend)[0, 1] * STRIP.section.shear_modulus
    assert shear == pytest.approx(400e6 / np.sqrt(3))


# ---- what is known of a function along a DLO without a look at it is what a look would find -


@pytest.mark.parametrize('terms', [1, 6, 10])
def test_a_series_is_told_as_if_it_had_been_looked_at(rng, terms):
    for base, parts in (((0.1, -0.2), 2), (0.3, 1)):
        content = Expanded(base, rng.normal(size=(terms, parts)), 1.003)
        known, seen = smooth(content, 1.003), resolved('k', content, 1.003)
        assert known == seen


def test_a_long_series_is_looked_at(rng):
    content = Expanded((0.0, 0.0), 0.1 * rng.normal(size=(24, 2)), 1.0)
    rod = Rod(1.0, 1e-3, 1e-3, 0.02, natural_curvature=content)
    s = np.linspace(0, 1, 50)
    means = rod.natural_strains(s)[:, 1:]
    assert means == pytest.approx(np.array([content(one) for one in s]), abs=1e-9)
    assert len(rod._profiles['natural_curvature'].edges) > 257


@pytest.mark.parametrize('cut', [lambda rod: before(rod, 0.7),
                                 lambda rod: part_of_rod(rod, 0.3, 1)])
def test_a_part_of_a_dlo_is_known_from_the_whole(cut):
    asked = []

    def graded(s):
        asked.append(s)
        return (1 + s) ** 2 if s < 0.41 else 5.0

    whole = Rod(1.0, graded, ((0, 2.0), (0.5, 1.0), (0.5, 3.0), (1, 3.0)), graded,
                natural_curvature=lambda s: (np.sin(3 * s), 0.2))
    assert whole.breaks == pytest.approx([0.41, 0.5])
    asked.clear()
    part, s = cut(whole), np.array([0, 0.1, 0.2, 0.35, 0.7])
    known = part.mean_stiffnesses(s), part.node_masses(s), part.mean_natural_strains(s), part.breaks
    assert len(asked) < 50  # of 8000 where it is looked at
    alone = Rod(part.length, part.mass_per_length, part.bending_stiffness,
                part.torsional_stiffness, natural_curvature=part.natural_curvature)
    looked_at = (alone.mean_stiffnesses(s), alone.node_masses(s), alone.mean_natural_strains(s),
                 alone.breaks)
    for one, other in zip(known, looked_at, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
