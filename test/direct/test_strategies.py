# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By which strategies a step is sought, and how each ended: `Shape.tried`."""

from dlo_planner import Capsule, DirectSimulator, Plane, Pose, Rod, Shape

WIRE = Rod.circular(1.0, 1.5e-3, 8960.0, 110e9, 0.34)
FREE = DirectSimulator(WIRE, n_elements=32, basis='local')
TABLE = DirectSimulator(WIRE, n_elements=32, basis='local',
                        obstacles=[Plane((0, 0, -0.3), (0, 0, 1))])
LEVEL = Pose((0, 0, 0), (0, 0, 0, 1))


def lower(z):
    return Pose((0, 0, z), (0, 0, 0, 1))


def test_what_hangs_freely_is_found_as_if_nothing_acted():
    assert FREE.solve(LEVEL).tried == (('free', 'found'),)
    assert TABLE.solve(lower(1.0)).tried == (('free', 'found'),)


def test_what_comes_upon_a_table_is_moved_there_and_goes_on_bearing():
    above = FREE.solve(LEVEL)
    floor = Plane((0, 0, above.positions[-1, 2] - 0.02), (0, 0, 1))
    simulator = DirectSimulator(WIRE, n_elements=32, basis='local', obstacles=[floor])
    before = simulator.solve(LEVEL)
    shape = simulator.solve(lower(-0.022), before)
    assert before.tried == (('free', 'found'),) and shape.contacts
    assert shape.tried == (('free', 'something acts'), ('bearing on', 'not near'),
                           ('moved', 'found'))
    on = simulator.solve(lower(-0.023), shape)
    assert on.contacts and on.tried == (('bearing on', 'found'),)
    off = simulator.solve(lower(-0.019), on)
    assert not off.contacts
    assert off.tried == (('bearing on', 'not near'), ('moved', 'found'))


def test_what_is_held_is_set_down_and_then_followed_nearby_or_moved():
    end = Pose((0.8, 0, 0), (0, 0, 0, 1))
    first = FREE.solve(LEVEL, far_end=end)
    assert first.tried[-1] == ('set down', 'found')
    near = FREE.solve(LEVEL, first, far_end=Pose((0.801, 0, 0), (0, 0, 0, 1)))
    assert near.tried == (('near', 'found'),)
    far = FREE.solve(LEVEL, near, far_end=Pose((0.7, 0, 0.2), (0, 0, 0, 1)))
    assert far.tried[-1] == ('moved', 'found')


def test_what_would_begin_inside_an_obstacle_is_set_down_on_it():
    bar = Capsule((0.35, -1, -0.2), (0.35, 1, -0.2), 0.12)
    shape = DirectSimulator(WIRE, n_elements=64, basis='local', obstacles=[bar]).solve(LEVEL)
    assert shape.converged and shape.contacts
    assert shape.tried == (('free', 'something acts'), ('set down', 'found'))


def test_of_a_shape_from_elsewhere_nothing_is_known(tmp_path):
    FREE.solve(LEVEL).save(tmp_path / 'shape.npz')
    assert Shape.load(tmp_path / 'shape.npz').tried == ()
