# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a fit found, as parameters: the rod that they describe is the rod that was found."""

from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import InvalidTask
from dlo_planner.identify import Fit
from dlo_planner.settings.build import parameters_of_fit, rod_of
from dlo_planner.settings.yaml_files import read_values

PLACES = [0.1, 0.4]


def found(values, **changed):
    """Return a Fit that found these values."""
    rod = rod_of(values)
    if 'bending_stiffness' in changed:
        rod = replace(rod, section=None, section_model=None)
    return Fit(replace(rod, **changed), changed, dict.fromkeys(changed, 0.1), 0.0, True)


@pytest.mark.parametrize('name', ['copper_wire', 'rubber_hose', 'steel_leaf_spring'])
@pytest.mark.parametrize('factors', [(1.1, 1.1, 1.0), (1.1, 1.15, 0.9), (1.5, 0.7, 1.2)])
def test_stiffness_torsion_and_mass_are_as_found(name, factors):
    values, _ = read_values(name)
    rod = rod_of(values)
    (torsion, *bending), = rod.stiffnesses([0.1])
    mass, = rod.masses_per_length([0.1])
    bend, twist, heavy = factors
    fit = found(values, bending_stiffness=tuple(bend * one for one in bending),
                torsional_stiffness=twist * torsion, mass_per_length=heavy * mass)
    again = rod_of(values | parameters_of_fit(fit, values))
    np.testing.assert_allclose(again.stiffnesses(PLACES), fit.rod.stiffnesses(PLACES), rtol=1e-9)
    np.testing.assert_allclose(again.masses_per_length(PLACES), heavy * mass, rtol=1e-9)
    poisson = (1 + values['rod.poisson_ratio']) * bend / twist - 1
    assert (again.section is None) == (poisson > 0.5)  # no section has that torsion


def test_what_a_parameter_says_itself_is_taken_as_it_is():
    values, _ = read_values('copper_wire')
    fit = found(values, natural_curvature=(0.1, -0.2), natural_twist=0.3, tip_mass=0.01)
    assert parameters_of_fit(fit, values) == {'rod.natural_curvature': [0.1, -0.2],
                                       'rod.natural_twist': 0.3, 'rod.tip_mass': 0.01}


def test_a_rod_given_by_stiffness_stays_one():
    values, _ = read_values('copper_wire', [
        'rod.section=stiffness', 'rod.mass_per_length=0.007', 'rod.torsional_stiffness=0.004',
        'rod.bending_stiffness=[0.005, 0.005]'])
    fit = found(values, bending_stiffness=(0.01, 0.02))
    assert parameters_of_fit(fit, values) == {'rod.bending_stiffness': [0.01, 0.02]}


def test_what_no_parameter_says_is_refused():
    values, _ = read_values('copper_wire')
    fit = found(values, tip_mass=0.01)
    with pytest.raises(InvalidTask, match='bending_stiffness_n'):
        parameters_of_fit(replace(fit, values={'bending_stiffness_n': 1.0}), values)
    with pytest.raises(InvalidTask, match='natural_curvature'):
        parameters_of_fit(replace(fit, values={'natural_curvature': [[0, 1], [1, 0]]}), values)
