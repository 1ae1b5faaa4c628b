# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
import math
from array import array

import numpy as np
import pytest

from dlo_planner import InvalidRod, Rod


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
    ({'length': 'long'}, "length = 'long'"),
    ({'mass_per_length': -1.0}, 'mass_per_length = -1.0'),
    ({'bending_stiffness': (1.0, 0.0)}, 'bending_stiffness = 0.0'),
    ({'bending_stiffness': (1.0, 2.0, 3.0)}, 'bending_stiffness'),
    ({'torsional_stiffness': math.nan}, 'torsional_stiffness = nan'),
    ({'tip_mass': math.inf}, 'tip_mass = inf'),
    ({'radius': -1.0}, 'radius = -1.0'),
    ({'natural_curvature': 3.0}, 'natural_curvature = 3.0'),
    ({'natural_curvature': lambda s: (1 / max(s, 0) if s else math.nan, 0)},
     'natural_curvature(0) = nan'),
    ({'natural_twist': 'left'}, "natural_twist = 'left'"),
    ({'point_masses': ((2.0, 1.0),)}, 'point_masses s = 2.0'),
    ({'damping': -0.1}, 'damping = -0.1'),
    ({'damping': (1.0, 2.0, 3.0)}, 'damping'),
    ({'point_masses': (1.0,)}, 'point_masses = (1.0,)'),
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
