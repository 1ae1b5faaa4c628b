# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Old names work, with a warning."""

import pytest

import dlo_planner
from dlo_planner import DirectSimulator, Estimate, InverseSimulator, Rod, Sphere, with_plug

_ROD = Rod(1.0, 0.01, 1e-3, 1e-3)


def _sphere():
    sphere = Sphere(centre=(1, 2, 3), radius=0.1)
    assert sphere == Sphere((1, 2, 3), 0.1)


def _plug():
    assert (with_plug(_ROD, 0.1, 0.01, centre=0.04) == with_plug(_ROD, 0.1, 0.01, center=0.04))


def _fibers():
    rod = Rod.circular(1.0, 1e-3, 8000, 1e11, 0.3, section_model='fibres', yield_stress=1e8)
    assert rod.section_model == 'fibers'


@pytest.mark.parametrize('use', [
    _sphere, _plug, _fibers, lambda: dlo_planner.minimise_penalty,
    lambda: Sphere((1, 2, 3), 0.1).centre],
    ids=['Sphere', 'with_plug', 'fibers', 'function', 'field'])
def test_old_names_work_and_warn(use):
    with pytest.warns(DeprecationWarning, match='is now'):
        use()


@pytest.mark.parametrize(('owner', 'old', 'new'), [
    (InverseSimulator, 'minimise_penalty', 'minimize_penalty'),
    (DirectSimulator, 'discretisation', 'discretization'), (Estimate, 'centre', 'center')])
def test_old_methods_are_the_new_ones(owner, old, new):
    value = owner.__new__(owner)
    with pytest.warns(DeprecationWarning, match=f'{owner.__name__}.{old} is now {new}'):
        assert getattr(value, old) == getattr(value, new)


def test_both_names_at_once_are_refused():
    with pytest.warns(DeprecationWarning), pytest.raises(TypeError, match='one argument'):
        Sphere(centre=(1, 2, 3), center=(1, 2, 3), radius=0.1)
