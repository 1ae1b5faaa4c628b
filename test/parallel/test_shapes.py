# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Shapes as arrays."""

import numpy as np
import pytest
from wires import copper_wire

from dlo_planner import Capsule, DirectSimulator, InvalidTask, Pose
from dlo_planner.results import Shapes

BAR = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)


@pytest.fixture(scope='module')
def tracked():
    simulator = DirectSimulator(copper_wire(), n_elements=16, obstacles=[BAR])
    return simulator.track([Pose((0, 0, z), (0, 0, 0, 1)) for z in (0.9, 0.75, 0.7, 0.65)])


def test_shapes_one_by_one(tracked):
    shapes = Shapes.of(tracked)
    assert len(shapes) == 4 and len(shapes.contact_table)
    for shape, other in zip(shapes, tracked, strict=True):
        for name in ('positions', 'frames', 'element_strains', 'gripper_wrench', 'energy',
                     'stability', 'converged', 'contacts', 'gripper', 'dissipated'):
            np.testing.assert_equal(getattr(shape, name), getattr(other, name))
        assert np.isnan(shape.error_estimate)  # not known, and not 0
    np.testing.assert_array_equal(shapes.tangents[2], tracked[2].tangents)
    assert shapes[-1].contacts == tracked[-1].contacts
    with pytest.raises(IndexError):
        shapes[4]


def test_slices_and_joining(tracked):
    shapes = Shapes.of(tracked)
    assert Shapes.joined([shapes[:1], shapes[1:3], shapes[3:]]) == shapes
    assert Shapes.of(tracked[::-1]) == shapes[::-1]
    assert len(shapes[4:]) == 0
    assert Shapes.joined([shapes[4:], shapes]) == shapes


def test_a_shape_of_them_starts_a_search(tracked):
    simulator = DirectSimulator(copper_wire(), n_elements=16, obstacles=[BAR])
    again = simulator.solve(tracked[2].gripper, Shapes.of(tracked)[2])
    np.testing.assert_allclose(again.positions, tracked[2].positions, atol=1e-7)


def test_on_other_nodes(tracked):
    s = np.array([0.0, 0.21, 0.5, 1.0])
    shapes = Shapes.of(tracked, s)
    for k, shape in enumerate(tracked):
        np.testing.assert_allclose(shapes.positions[k], shape.positions_at(s), atol=1e-15)
        # their mean turns as far as the strains do
        np.testing.assert_allclose(np.diff(s) @ shapes.element_strains[k],
                                   np.diff(shape.s) @ shape.element_strains, atol=1e-12)


def test_what_does_not_fit_is_refused(tracked):
    shapes = Shapes.of(tracked)
    with pytest.raises(InvalidTask, match=r'parts\[1\]'):
        Shapes.joined([shapes, Shapes.of(tracked, [0.0, 1.0])])
    with pytest.raises(InvalidTask, match=r'shapes\[0\]'):
        Shapes.of(tracked, [0.0, 2.0])
    held = DirectSimulator(copper_wire(), n_elements=8).solve(Pose.identity(), far_end=(0.8, 0, 0))
    with pytest.raises(InvalidTask, match=r'shapes\[0\]'):
        Shapes.of([held])
