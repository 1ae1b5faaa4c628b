# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Old names work, with a warning."""

import re
from pathlib import Path

import pytest

import dlo_planner
from dlo_planner import (
    DirectSimulator,
    Estimate,
    InverseSimulator,
    Observer,
    Plan,
    PlanStatus,
    Pose,
    Rod,
    SlideContact,
    Sphere,
    Uncertainty,
    robustness,
    with_plug,
)
from dlo_planner.inverse.task import Task
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.waypoint import waypoint_at

_ROD = Rod(1.0, 0.01, 1e-3, 1e-3)


def _sphere():
    sphere = Sphere(centre=(1, 2, 3), radius=0.1)
    assert sphere == Sphere((1, 2, 3), 0.1)


def _plug():
    assert (with_plug(_ROD, 0.1, 0.01, centre=0.04) == with_plug(_ROD, 0.1, 0.01, center=0.04))


def _plan():
    shape = DirectSimulator(_ROD, n_elements=4, n_terms=2).solve(Pose((0, 0, 1), (0, 0, 0, 1)))
    builder = PlanBuilder([0.0], PlanRequirements((1.0, 1.0)))
    builder.add(waypoint_at(shape, shape.positions[-1] + (0, 0.1, 0), 1.0, None))
    return builder.finished()


def _plastic():
    soft = DirectSimulator(Rod(1.0, 0.01, 1e-3, 1e-3, yield_curvature=1.0, hardening=0.1))
    assert InverseSimulator(soft, may_yield=False) == InverseSimulator(soft, allow_plastic=False)
    assert InverseSimulator(soft, may_yield=False) != InverseSimulator(soft)


def _fields():
    plan = _plan()
    assert plan.miss is plan.position_error and plan.passes is plan.via_points
    assert plan.misses == plan.position_errors == [[pytest.approx(0.1)]]
    assert plan[0].miss == plan[0].position_error == pytest.approx(0.1)
    given = {name: getattr(plan, name) for name in (
        'depths', 'grippers', 'shapes', 'misalignment', 'times', 'clearances', 'sheets')}
    assert Plan(miss=plan.position_error, passes=plan.via_points, fraction=1.0,
                status=PlanStatus.COMPLETE, **given) == plan


def _fibers():
    rod = Rod.circular(1.0, 1e-3, 8000, 1e11, 0.3, section_model='fibres', yield_stress=1e8)
    assert rod.section_model == 'fibers'


def _uncertainty():
    simulator, known = DirectSimulator(_ROD, n_elements=4, n_terms=2), Uncertainty(length=0.01)
    assert Observer(simulator, spread=known) == Observer(simulator, known)
    assert robustness(simulator, _plan(), spread=known) == robustness(simulator, _plan(), known)


def _slide():
    straight = SlideContact(Pose.identity(), [0.5], mode='straight')
    assert SlideContact(Pose.identity(), [0.5], way='straight') == straight
    assert straight.way == 'straight'
    content = straight.to_dict()
    content['way'] = content.pop('mode')
    assert Task.from_dict(content) == straight


@pytest.mark.parametrize('use', [
    _sphere, _plug, _fibers, _plastic, _fields, _uncertainty, _slide,
    lambda: dlo_planner.minimise_penalty, lambda: Sphere((1, 2, 3), 0.1).centre],
    ids=['Sphere', 'with_plug', 'fibers', 'plastic', 'Plan', 'uncertainty', 'slide', 'function',
         'field'])
def test_old_names_work_and_warn(use):
    with pytest.warns(DeprecationWarning, match='is now'):
        use()


@pytest.mark.parametrize(('owner', 'old', 'new'), [
    (InverseSimulator, 'minimise_penalty', 'minimize_penalty'),
    (InverseSimulator, 'start_phase', 'approach'),
    (DirectSimulator, 'discretisation', 'discretization'), (Estimate, 'centre', 'center')])
def test_old_methods_are_the_new_ones(owner, old, new):
    value = owner.__new__(owner)
    with pytest.warns(DeprecationWarning, match=f'{owner.__name__}.{old} is now {new}'):
        assert getattr(value, old) == getattr(value, new)


def test_the_warning_stands_where_the_old_name_does():
    for use in (_fibers, lambda: Sphere((1, 2, 3), 0.1).centre, _sphere):
        with pytest.warns(DeprecationWarning) as caught:
            use()
        assert {one.filename for one in caught} == {__file__}  # elsewhere Python hides it


def test_both_names_at_once_are_refused():
    with pytest.warns(DeprecationWarning), pytest.raises(TypeError, match='one argument'):
        Sphere(centre=(1, 2, 3), center=(1, 2, 3), radius=0.1)


@pytest.mark.parametrize('old', sorted(dlo_planner._RENAMED))
def test_every_old_name_is_in_the_table(old):
    new = dlo_planner._RENAMED[old]
    with pytest.warns(DeprecationWarning, match=f'dlo_planner.{old} is now dlo_planner.{new}'):
        assert getattr(dlo_planner, old) is getattr(dlo_planner, new)
    table = (Path(__file__).parent.parent / 'docs' / 'api' / 'renamed.md').read_text()
    assert any(re.search(rf'`{old}\b', line) and f'`{new}' in line
               for line in table.splitlines() if line.startswith('|'))
