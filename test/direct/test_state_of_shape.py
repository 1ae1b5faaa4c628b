# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a Shape leaves to the next step, and effects that leave something of their own."""

import ast
import pickle
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import dlo_planner.direct
from dlo_planner import Capsule, DirectSimulator, InvalidTask, Plane, Pose, Rod, Shape
from dlo_planner.direct.memory import ACTING
from dlo_planner.direct.shape import UNKNOWN, State
from dlo_planner.direct.terms import Part
from dlo_planner.energy.terms import TERMS

NAMES = {'contact', 'contacts', 'hold', 'plastic', 'obstructed', 'holds', 'yields'}
BAR = Capsule((0.3, -0.5, 0.97), (0.3, 0.5, 0.97), 0.02, 0.3)


class Visits(Part):
    """An effect that counts the steps and where the DLO's tip has been; it pushes nothing."""

    name = 'visits'

    def record(self, mesh, left, held):
        return None

    def empty(self, mesh, s):
        return {'visits': np.array(0), 'heights': np.zeros(s.size)}

    def resampled(self, left, s, wanted):
        return {'heights': np.interp(wanted, s, left['heights'])}

    def cleared(self, left):
        return {'visits': np.array(0), 'heights': np.zeros_like(left['heights'])}

    def leaves(self, solved):
        heights = solved.state.positions[:, 2] + solved.gripper.position[2]
        return {'visits': solved.left['visits'] + 1, 'heights': heights}


@pytest.fixture
def counted(monkeypatch):
    """Offer one more effect."""
    for name, module in tuple(sys.modules.items()):
        if name.startswith('dlo_planner.') and getattr(module, 'ACTING', None) is ACTING:
            monkeypatch.setattr(module, 'ACTING', (*ACTING, Visits()))


@pytest.fixture
def wire():
    return Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)


def level(height):
    return Pose((0, 0, height), (0, 0, 0, 1))


def test_one_more_effect_leaves_what_it_wants(counted, wire, tmp_path):
    direct = DirectSimulator(wire, n_elements=32, obstacles=[BAR])
    way = [level(height) for height in (1.0, 0.99, 0.98)]
    shapes = direct.track(way)
    assert shapes[-1].contacts
    past = shapes[-1].history
    assert past.left['visits'] >= len(way)
    np.testing.assert_array_equal(past.left['heights'], shapes[-1].positions[:, 2])
    assert not past.left['heights'].flags.writeable
    shapes[-1].save(tmp_path / 'shape.npz')
    for again in (Shape.load(tmp_path / 'shape.npz'), pickle.loads(pickle.dumps(shapes[-1]))):
        assert again.history == past
        assert again.history.left['visits'] == past.left['visits']
    finer = DirectSimulator(wire, n_elements=64, obstacles=[BAR])
    on_finer = finer.mesh.past(past).left
    np.testing.assert_allclose(on_finer['heights'][::2], past.left['heights'], atol=1e-12)
    elsewhere = DirectSimulator(wire, n_elements=32, obstacles=[Plane((0, 0, 0), (0, 0, 1))])
    assert elsewhere.mesh.past(past).left['visits'] == 0


def test_one_more_effect_changes_no_shape(wire, monkeypatch, request):
    way = [level(height) for height in (1.0, 0.99, 0.98)]
    alone = DirectSimulator(wire, n_elements=32, obstacles=[BAR]).track(way)
    request.getfixturevalue('counted')
    counted = DirectSimulator(wire, n_elements=32, obstacles=[BAR]).track(way)
    for one, other in zip(alone, counted, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
        assert one.contacts == other.contacts
        assert one != other  # they leave another past


def test_shape_past_and_equilibrium_know_no_effect_by_name():
    folder = Path(dlo_planner.direct.__file__).parent
    for name in ('shape', 'memory', 'statics', 'storage'):
        tree = ast.parse((folder / f'{name}.py').read_text(encoding='utf-8'))
        used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        used |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
                 for alias in node.names}
        # dead moments are balanced by what bends
        known = {'shape': {'contacts', 'Contact'}, 'statics': {'yields', 'plastic'}}
        asked = used & NAMES - known.get(name, set())
        assert not asked, f'{name}.py knows {asked}'


def test_all_that_acts_is_an_effect():
    names = [part.name for part in ACTING]
    assert len(set(names)) == len(names)
    assert set(names) <= set(TERMS)


def test_a_shape_hides_nothing_but_its_state(wire):
    shape = DirectSimulator(wire, n_elements=8).solve(level(1.0))
    assert not [item.name for item in fields(Shape) if item.name.startswith('_')]
    assert 'state' not in shape.to_dict()
    assert isinstance(shape.state, State)
    assert shape.state.mesh is shape.mesh
    assert replace(shape, state=replace(shape.state, before=None)) == shape
    assert replace(shape, state=UNKNOWN) != shape


def test_a_state_that_is_not_known_says_so(wire):
    shape = DirectSimulator(wire, n_elements=8).solve(level(1.0))
    unknown = replace(shape, state=shape.state.forgotten())
    assert unknown.error_estimate == shape.error_estimate
    for name in ('made_on', 'left', 'held'):
        with pytest.raises(InvalidTask, match='expected a shape that comes from a simulator'):
            getattr(unknown.state, name)
    with pytest.raises(InvalidTask, match='Shape.state'):
        replace(shape, state=None)
    for wrong in ({'mesh': 1}, {'history': 1}, {'before': 1}, {'estimate': 1}):
        with pytest.raises(InvalidTask, match=f'State.{next(iter(wrong))}'):
            State(**wrong)
