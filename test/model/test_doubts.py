# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What of a DLO is probably not meant is said where it is stated, and nowhere else."""

import warnings
from dataclasses import replace

import pytest

from dlo_planner import DirectSimulator, DoubtfulInput, InvalidRod, Pose, Rod
from dlo_planner.identify import Observation
from dlo_planner.identify.fit import fit_rod
from dlo_planner.model.rod import doubts

CABLE = {'length': 0.5, 'mass_per_length': 0.045, 'bending_stiffness': 0.03,
         'torsional_stiffness': 0.02, 'radius': 0.003}


@pytest.mark.parametrize(('more', 'said'), [
    ({'mass_per_length': 45.0}, 'density 1.59e[+]06 kg/m.3'),
    ({'mass_per_length': 45e-6}, 'density 1.59 kg/m.3'),
    ({'length': 500.0, 'bending_stiffness': 3e4}, '500 m long, more than 100 m'),
    ({'radius': 3.0}, '6 m thick, 0.5 m long'),
    ({'radius': 0.026, 'mass_per_length': 2.0}, '0.052 m thick, 0.5 m long'),
    ({'length': 80.0, 'radius': 1.0, 'mass_per_length': 3e3, 'bending_stiffness': 1e9},
     '2 m thick, more than 0.5 m'),
    ({'bending_stiffness': 3e-9}, 'hangs like a chain')])
def test_what_is_hardly_meant_is_a_warning_of_the_package(more, said):
    with pytest.warns(DoubtfulInput, match=said) as seen:
        rod = Rod(**{**CABLE, **more})
    assert seen[0].filename == __file__  # the line that states it
    assert any(one == str(seen[0].message) for one in doubts(rod))


@pytest.mark.parametrize('more', [
    {}, {'mass_per_length': 0.0}, {'radius': None, 'mass_per_length': 45.0},
    {'radius': 0.0249, 'mass_per_length': 2.0}, {'length': 100.0, 'bending_stiffness': 300.0}])
def test_what_may_be_meant_is_not_doubted(more):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert not doubts(Rod(**{**CABLE, **more}))


def test_sections_are_doubted_by_their_material():
    for density, count in ((1150.0, 0), (1.15, 1), (1.15e6, 1)):
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter('always')
            Rod.tube(1.0, 0.01, 0.009, density, 5e9, 0.4)
        assert len(seen) == count


def test_rods_that_a_search_tries_are_nobodys_statement():
    with pytest.warns(DoubtfulInput):
        heavy = replace(Rod(**CABLE), mass_per_length=45.0)
    pose = Pose((0, 0, 1), (0, 0, 0, 1))
    with warnings.catch_warnings():
        warnings.simplefilter('error', DoubtfulInput)
        shape = DirectSimulator(heavy).solve(pose)
        fit_rod(heavy, [Observation(pose, shape.positions[8::8], shape.s[8::8])])


def test_ranges_have_units():
    with pytest.raises(InvalidRod, match='Rod.length = -1: expected a finite number > 0 m'):
        Rod(**{**CABLE, 'length': -1})
    with pytest.raises(InvalidRod, match='density = -1: expected a finite number >= 0 kg/m.3'):
        Rod.circular(1.0, 1e-3, -1, 1e9, 0.3)
