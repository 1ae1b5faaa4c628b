# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Values are values: read-only, equal by content, hashable, copied, sent to other processes."""

import copy
import inspect
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from enum import Enum
from multiprocessing import get_context

import numpy as np
import pytest
from specimens import LEVEL, PUBLIC, values

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    Shape,
    Sheet,
)
from dlo_planner.direct.discretization import Discretization, Memory
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import Value, brief, parts_of
from dlo_planner.rods import GraspedInside

TYPES = [name for name, member in PUBLIC.items()
         if inspect.isclass(member) and not issubclass(member, Exception | Enum)]
LONGEST = 200  # characters of a repr


def half(s):
    """Return a natural curvature that is a function."""
    return 0.5 * s, 0.1


@pytest.fixture(scope='module')
def more():
    """Return values of all kinds of origin, by what they are."""
    simulator = values()['DirectSimulator']
    shape = values()['Shape']
    soft = Rod(1.0, 0.1, 0.05, 0.04, radius=0.01, yield_curvature=1.0, hardening=0.1,
               natural_curvature=half)
    options = {'n_elements': 8, 'n_terms': 4}
    yielding = DirectSimulator(soft, **options)
    held = yielding.solve(LEVEL, far_end=(0.8, 0.0, 1.0))
    set_ = yielding.with_set(yielding.solve(LEVEL))
    hole = CutOut(Pose.looking_along((0.4, 0, 1), (1, 0, 0)), radius=0.2)
    around = DirectSimulator(soft, **options, load=(0, 0.1, 0), obstacles=[
        Plane((0, 0, 0.6), (0, 0, 1), 0.3), Sheet.around(hole, 1.0, 1.0)])
    grasped = GraspedInside(soft, 0.4, **options, load=(0, 0.1, 0))
    with pytest.raises(Infeasible) as refused:
        InverseSimulator(simulator).thread(hole, depths=[0.0, 0.1], gripper_clearance=0.99)
    return {
        'resampled': shape.resample(5), 'moved': shape.moved((1, 2, 3)), 'held': held,
        'yielding': yielding.solve(LEVEL), 'with a set': set_, 'set and elastic': set_.elastic(),
        'elastic shape': set_.elastic().solve(LEVEL), 'touching': around.track([LEVEL])[0],
        'simulator with obstacles': around, 'grasped': grasped.solve(LEVEL),
        'elastic inverse': InverseSimulator(set_), 'accurate': DirectSimulator(
            soft, accuracy=1e-3).solve(LEVEL), 'refused plan': refused.value.plan,
        'local': DirectSimulator(soft, n_elements=8, basis='local'), 'function': soft,
        'discretization': shape.state.mesh, 'history': held.state.history,
        'surroundings': around.surroundings}


def arrays_in(content, depth=0):
    """Yield all arrays that can be reached from a value by its public attributes."""
    if isinstance(content, np.ndarray):
        yield content
    elif isinstance(content, tuple | list):
        for part in content:
            yield from arrays_in(part, depth + 1)
    elif isinstance(content, dict):
        yield from arrays_in(list(content.values()), depth + 1)
    elif isinstance(content, Value) and depth < 6:
        names = ([item.name for item in fields(content)] if is_dataclass(content)
                 else parts_of(content))
        for name in names:
            yield from arrays_in(getattr(content, name), depth + 1)


def judge(value):
    assert all(not array.flags.writeable for array in arrays_in(value))
    again = pickle.loads(pickle.dumps(value))
    assert again is not value
    assert again == value
    assert hash(again) == hash(value)
    assert all(not array.flags.writeable for array in arrays_in(again))
    assert copy.copy(value) == value == copy.deepcopy(value)
    assert value in [again]
    assert len({value, again}) == 1
    assert value != 'another'
    text = repr(value)
    assert len(text) <= LONGEST
    assert '\n' not in text
    assert repr(again) == text
    with pytest.raises((FrozenInstanceError, AttributeError)):
        value.anything = 1
    if is_dataclass(value):
        assert replace(value) == value
        with pytest.raises((FrozenInstanceError, AttributeError)):
            setattr(value, fields(value)[0].name, None)


@pytest.mark.parametrize('name', TYPES)
def test_every_public_type_is_a_value(name):
    assert name in values(), f'no example of {name} in test/specimens.py'
    judge(values()[name])


def test_whatever_it_comes_from(more):
    for value in more.values():
        judge(value)


def test_what_travels_inside(more):
    assert isinstance(more['discretization'], Discretization)
    assert isinstance(more['history'], Memory)
    assert isinstance(more['surroundings'], Surroundings)


def _solved(value):
    """Return the value, and what it computes in another process."""
    if isinstance(value, DirectSimulator | GraspedInside):
        return value, value.solve(LEVEL)
    if isinstance(value, Shape):
        return value, value.positions_at([0.1, 0.3])
    return value, None


def test_all_go_through_a_process_pool(more):
    everything = [values()[name] for name in TYPES] + list(more.values())
    with ProcessPoolExecutor(1, mp_context=get_context('fork')) as pool:
        for value, (again, found) in zip(everything, pool.map(_solved, everything), strict=True):
            assert again == value
            mine = _solved(value)[1]
            if isinstance(found, Shape):
                np.testing.assert_allclose(found.positions, mine.positions, atol=1e-12)
            elif found is not None:
                np.testing.assert_array_equal(found, mine)


def test_a_loaded_shape_equals_the_saved_one(tmp_path, more):
    for value in (values()['Shape'], values()['Motion'], more['held'], more['touching']):
        value.save(tmp_path / 'saved.npz')
        loaded = type(value).load(tmp_path / 'saved.npz')
        assert loaded == value
        judge(loaded)


def test_different_values_differ():
    rod, pose = values()['Rod'], Pose((1, 2, 3), (0, 0, 0, 1))
    assert pose != Pose((1, 2, 3.0000001), (0, 0, 0, 1))
    assert rod != replace(rod, length=1.0000001)
    assert DirectSimulator(rod) != DirectSimulator(rod, n_elements=32)
    assert DirectSimulator(rod) != DirectSimulator(rod, gravity=(0, 0, -9.8))
    assert DirectSimulator(rod) == DirectSimulator(replace(rod))
    assert values()['Shape'] != values()['Shape'].moved((0, 0, 1e-9))


def test_signs_of_zero_are_one_value():
    plus, minus = (Pose((zero, 0, 0), (zero, 0, 0, 1)) for zero in (0.0, -0.0))
    assert plus == minus
    assert hash(plus) == hash(minus)


def test_rotation_and_quaternion_tell_the_same(rng):
    for _ in range(20):
        pose = Pose(rng.normal(size=3), rng.normal(size=4))
        again = Pose.from_rotation(pose.position, pose.rotation)
        sign = np.sign(again.quaternion @ pose.quaternion)
        np.testing.assert_allclose(again.quaternion, sign * pose.quaternion, atol=1e-15)
        assert Pose(pose.position, pose.quaternion) == pose
        assert Pose(again.position, again.quaternion) == again
        for array in (again.quaternion, again.rotation, again.position, pose.direction):
            with pytest.raises(ValueError, match='read-only'):
                array[0] = 0.5


def test_nothing_is_changed_through_what_was_computed():
    simulator, shape = values()['DirectSimulator'], values()['Shape']
    for array in (simulator.gravity, shape.s, shape.positions, shape.frames, shape.tangents,
                  shape.element_strains, shape.gripper_wrench, values()['Plan'].times,
                  values()['Motion'].velocities):
        with pytest.raises(ValueError, match='read-only'):
            array[-1] = 0.9


def test_a_line_says_what_matters():
    shape, plan = values()['Shape'], values()['Plan']
    assert repr(shape).startswith('Shape(1 m, 8 elements, converged, residual ')
    assert 'stability' in repr(shape)
    assert 'error' in repr(shape)
    assert repr(plan).startswith('Plan(2 waypoints, complete, ')


def _fresh(content, made):
    """Return a content with new arrays that can be written, and note them in `made`."""
    if isinstance(content, np.ndarray):
        made.append(np.array(content))
        return made[-1]
    if isinstance(content, tuple | list):
        make = getattr(type(content), '_make', type(content))
        return make(_fresh(part, made) for part in content)
    return content


def _inside(content, known):
    """Note in `known` all values that a content consists of, by their ids."""
    if isinstance(content, Value) and id(content) not in known:
        known[id(content)] = content
        names = ([item.name for item in fields(content)] if is_dataclass(content)
                 else parts_of(content))
        content = [getattr(content, name) for name in names]
    if isinstance(content, tuple | list | dict):
        for part in content.values() if isinstance(content, dict) else content:
            _inside(part, known)


def test_later_writes_to_what_was_given_change_nothing(more):
    known, tried = {}, set()
    _inside([*values().values(), *more.values()], known)
    for value in known.values():
        for item in fields(value) if is_dataclass(value) else ():
            place, made = (type(value), item.name), []
            content = _fresh(getattr(value, item.name), made) if item.init else None
            if place in tried or not made:
                continue
            tried.add(place)
            again = replace(value, **{item.name: content})
            before = pickle.dumps(getattr(again, item.name))
            for array in made:
                assert array.flags.writeable, place  # nor is it made read-only for who gave it
                array[...] = 0 if array.all() else 1
            assert pickle.dumps(getattr(again, item.name)) == before, place
    assert len(tried) > 60


def test_a_read_only_view_of_what_can_be_written_is_copied():
    plan = values()['Plan']
    times = np.array(plan.times)
    view = times[:]
    view.flags.writeable = False
    again = replace(plan, times=view)
    times[:] = 7.0
    assert again == plan


def test_a_repr_that_is_too_long_ends_between_its_parts():
    text = brief(LEVEL, *(f'part {k} of 0.0092 m' for k in range(20)))
    assert len(text) < 180 and text.endswith('of 0.0092 m ...)')
    assert brief(LEVEL, 'x' * 500, 'more').endswith('x ...)')
    assert brief(LEVEL, 'one', '', 'two') == 'Pose(one, two)'
