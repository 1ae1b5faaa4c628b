# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO bears on, obstacle by obstacle: forces, lengths, what slips."""

import numpy as np
import pytest

from dlo_planner import DirectSimulator, InvalidTask, Plane, Pose, Rod, Sphere
from dlo_planner.direct.touches import touches_of
from dlo_planner.results import Contact

CABLE = Rod(1.0, 0.05, 1e-3, 1e-3, radius=2e-3)
TABLE = Plane((0, 0, 0), (0, 0, 1), 0.5, name='table')


def laid(*obstacles, steps=1, **options):
    """Return the Shape of a cable that is moved along over obstacles by 2 cm a step."""
    simulator = DirectSimulator(CABLE, obstacles=obstacles, basis='local', n_elements=40,
                                **options)
    return simulator.track([Pose((0.02 * k, 0, 0.15), (0, 0, 0, 1)) for k in range(steps)])[-1]


def test_what_lies_on_a_table_is_as_long_as_what_is_low():
    shape = laid(TABLE)
    touch, = shape.touches
    low = shape.s[shape.positions[:, 2] < 2 * CABLE.radius]
    assert touch.length == pytest.approx(low[-1] - low[0], abs=2 / 40)
    assert touch.name == 'table' and touch.contacts == len(shape.contacts)
    np.testing.assert_allclose(touch.force, sum(one.vector for one in shape.contacts))
    bears = 0.05 * 9.81 - shape.gripper_wrench[2]
    assert touch.pressed == pytest.approx(bears, rel=1e-6)
    assert touch.force[2] == pytest.approx(bears, rel=1e-6)


def test_what_is_pushed_along_slips_and_its_friction_is_mu_times_the_force():
    touch, = laid(TABLE, steps=5).touches
    assert touch.slipping == touch.contacts > 2
    assert np.hypot(*touch.force[:2]) == pytest.approx(0.5 * touch.pressed, rel=1e-3)
    assert str(touch) == (f'lies on table over {touch.length:.3g} m, {touch.slipping} of '
                          f'{touch.contacts} contacts slip')
    smooth, = laid(Plane((0, 0, 0), (0, 0, 1)), steps=5).touches
    assert smooth.slipping == 0 and str(smooth).startswith('lies on obstacle 0 over ')


def test_each_obstacle_has_its_own():
    ball = Sphere((0.25, 0, 0.05), 0.05, name='ball')
    table = Plane((0, 0, 0), (0, 0, 1), name='table')
    shape = laid(table, ball)
    on_table, on_ball = shape.touches
    assert (on_table.name, on_ball.name) == ('table', 'ball')
    for touch in shape.touches:
        its = [one for one in shape.contacts if one.obstacle == touch.obstacle]
        np.testing.assert_allclose(touch.force, sum(one.vector for one in its))
    total = shape.gripper_wrench[:3] + on_table.force + on_ball.force
    np.testing.assert_allclose(total, [0, 0, 0.05 * 9.81], atol=1e-6)


def on_table(s, friction):
    """Return a Contact at `s` (m) of a DLO along x, with 1 N and a friction in N along x."""
    return Contact(0, s, (s, 0, 0.002), (0, 0, 1), 1.0, (friction, 0, 0), 0.0)


@pytest.mark.parametrize(('height', 'length'), [(0.01, 0.3), (0.0039, 0.8)])
def test_an_arch_does_not_lie_where_it_is_higher_than_its_radius(height, length):
    s = np.linspace(0, 1, 21)
    arch = np.where((s > 0.4) & (s < 0.9), height * np.sin(np.pi * (s - 0.4) / 0.5), 0.002)
    positions = np.column_stack([s, 0 * s, np.maximum(arch, 0.002)])
    contacts = [on_table(at, 0.0) for at in (0.1, 0.4, 0.9)]
    touch, = touches_of(contacts, [TABLE], s, positions, 0.002)
    assert touch.length == pytest.approx(length)


def test_what_is_held_by_less_than_mu_times_its_force_sticks():
    s = np.linspace(0, 1, 21)
    contacts = [on_table(at, friction) for at, friction in (
        (0.1, 0.0), (0.2, 0.499), (0.3, 0.5), (0.4, -0.5), (0.5, 0.1))]
    touch, = touches_of(contacts, [TABLE], s, np.column_stack([s, 0 * s, 0 * s]), 0.002)
    assert (touch.slipping, touch.contacts) == (2, 5)
    np.testing.assert_allclose(touch.force, [0.599, 0, 5])
    only, = touches_of(contacts[2:3], [TABLE], s, np.zeros((21, 3)), 0.002)
    assert str(only) == 'touches table and slips'


def test_a_shape_from_a_file_does_not_know_what_it_touches(tmp_path):
    shape = laid(TABLE)
    shape.save(tmp_path / 'shape.npz')
    with pytest.raises(InvalidTask, match='does not know its rod'):
        _ = type(shape).load(tmp_path / 'shape.npz').touches
