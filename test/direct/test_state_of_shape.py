# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a Shape leaves to the next step, and what it says of it."""

from dataclasses import fields, replace

import pytest

from dlo_planner import DirectSimulator, InvalidTask, Pose, Rod, Shape
from dlo_planner.direct.shape import UNKNOWN, State


@pytest.fixture
def wire():
    return Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)


def level(height):
    return Pose((0, 0, height), (0, 0, 0, 1))


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
