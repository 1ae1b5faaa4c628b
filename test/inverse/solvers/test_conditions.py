# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Aligned shapes at many depths at once: those that are found one by one, up to the first doubt."""

import numpy as np
import pytest

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod
from dlo_planner.inverse import continuation as conditions
from dlo_planner.inverse.continuation import LONGEST_STEP, Aligned
from dlo_planner.inverse.equilibria import start_candidates
from dlo_planner.plan import continuity

CUTOUT = CutOut(Pose.looking_along((0.1, -0.2, 0.3), (1.0, 0.4, 0.1)))
ROD = Rod(0.8, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
DEPTHS = 0.01 * np.array([1, 2, 3.5, 4, 6, 6, 5.5, 9, 12, 12.1, 15])


def begun(**options):
    """Return the condition and the first Passing."""
    simulator = DirectSimulator(ROD, **{'n_elements': 40, 'basis': 'local'} | options)
    aligned = Aligned(simulator, CUTOUT.normal)
    guess, reference, depth = next(start_candidates(simulator, CUTOUT, None))
    return aligned, aligned.from_guess(guess, depth, reference)


def one_by_one(aligned, passing, depths=DEPTHS):
    found = []
    for depth in depths:
        passing = aligned.at(passing, depth, final=True)
        found.append(passing)
    return found


@pytest.mark.parametrize('options', [{}, {'basis': 'chebyshev', 'n_terms': 12}])
def test_they_are_those_found_one_by_one_bit_for_bit(options):
    aligned, first = begun(**options)
    many, few = aligned.onward(first, DEPTHS), one_by_one(aligned, first)
    assert len(many) == len(few) == len(DEPTHS)
    for one, other in zip(many, few, strict=True):
        for name in ('positions', 'frames', 'element_strains', 'gripper_wrench', 'energy',
                     'elastic_energy', 'residual', 'stability', 'iterations', 'converged',
                     'error_estimate'):
            assert np.array_equal(getattr(one.shape, name), getattr(other.shape, name)), name
        assert np.array_equal(one.gripper[0], other.gripper[0]) and one.depth == other.depth
        np.testing.assert_allclose(one.place, other.place, atol=1e-15)
        np.testing.assert_allclose(one.axes, other.axes, atol=1e-15)
        assert one.since.depth == other.since.depth
        assert not one.shape.positions.flags.writeable


def test_a_search_goes_on_from_where_another_one_ended():
    aligned, first = begun()
    begin = aligned.onward(first, DEPTHS[:4])
    rest = aligned.onward(begin[-1], DEPTHS[4:])
    for one, other in zip(begin + rest, one_by_one(aligned, first), strict=True):
        assert np.array_equal(one.shape.positions, other.shape.positions)


def test_a_long_step_is_left_to_others():
    aligned, first = begun()
    longest = LONGEST_STEP * ROD.length
    assert len(aligned.onward(first, np.array([0.01, 0.02, 0.02 + 1.01 * longest, 0.1]))) == 2
    assert len(aligned.onward(first, np.array([0.01, 0.02, 0.02 + 0.99 * longest]))) == 3
    assert aligned.onward(first, np.array([1.01 * longest])) == []
    assert aligned.onward(first, np.array([])) == []


FELT = {'_TURN': lambda one, other, step: continuity.angle_between(
            one.gripper[0], other.gripper[0]) - continuity._TURN_RATE * step,
        '_SHIFT': lambda one, other, step: np.linalg.norm(
            other.place - one.place) / ROD.length - continuity._SHIFT_RATE * step,
        '_QUIET': lambda one, other, _: continuity.shape_change(
            one.shape, other.shape) - continuity.angle_between(one.gripper[0], other.gripper[0])}


@pytest.mark.parametrize('name', FELT)
def test_a_leap_is_left_to_others(monkeypatch, name):
    aligned, first = begun()
    way = [first, *aligned.onward(first, DEPTHS)]
    felt = [FELT[name](one, other, abs(other.depth - one.depth) / ROD.length)
            for one, other in zip(way, way[1:], strict=False)]
    for room, expected in ((1e-9, len(DEPTHS)), (-1e-9, int(np.argmax(felt)))):
        monkeypatch.setattr(continuity, name, max(felt) + room)
        assert len(aligned.onward(first, DEPTHS)) == expected


def test_what_is_hardly_stable_is_left_to_others(monkeypatch):
    aligned, first = begun()
    way = aligned.onward(first, DEPTHS)[::-1]
    depths = np.array([passing.depth for passing in way])
    stable = [passing.shape.stability for passing in aligned.onward(way[0], depths[1:])]
    worst = int(np.argmin(stable))
    assert worst > 0 and stable[worst] < way[0].shape.stability
    for room, expected in ((1e-9, len(stable)), (-1e-9, worst)):
        monkeypatch.setattr(continuity, '_STABLE', stable[worst] - room)
        assert len(aligned.onward(way[0], depths[1:])) == expected
    monkeypatch.setattr(continuity, '_STABLE', way[0].shape.stability + 1e-9)
    assert aligned.onward(way[0], depths[1:]) == []


def test_the_nested_method_takes_shapes_one_by_one():
    aligned, first = begun()
    nested = Aligned(aligned.simulator, CUTOUT.normal, 'nested')
    assert nested.onward(first, DEPTHS) == []


@pytest.mark.parametrize('accuracy', [None, 9e-6])
def test_with_an_accuracy_they_end_where_another_mesh_is_needed(accuracy):
    heavy = Rod(0.8, 0.5, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
    simulator = DirectSimulator(heavy, accuracy=accuracy)  # None: its own
    aligned, depths = Aligned(simulator, CUTOUT.normal), np.linspace(0.01, 0.6, 30)
    guess, reference, depth = next(start_candidates(simulator, CUTOUT, None))
    first = aligned.from_guess(guess, depth, reference)
    many, few = aligned.onward(first, depths), one_by_one(aligned, first, depths)
    mesh = first.shape.state.mesh
    other = [k for k, passing in enumerate(few) if passing.shape.state.mesh is not mesh]
    assert len(many) == (other[0] if other else len(depths))
    assert bool(other) == (accuracy is not None)  # both are looked at
    for one, another in zip(many, few, strict=False):
        assert one.shape.state.mesh is mesh
        assert np.array_equal(one.shape.positions, another.shape.positions)


def test_a_plan_is_the_same_whichever_way_its_shapes_are_found(monkeypatch):
    inverse = InverseSimulator(DirectSimulator(ROD, n_elements=32))
    calls = []
    follow = conditions.follow
    monkeypatch.setattr(conditions, 'follow',
                        lambda *given, **more: calls.append(0) or follow(*given, **more))
    depths = np.linspace(0, 0.7, 71)
    plan = inverse.thread(CUTOUT, depths=depths)
    assert 0 < len(calls) < 20
    monkeypatch.setattr(Aligned, 'onward', lambda *_: [])
    slow = inverse.thread(CUTOUT, depths=depths)
    for one, other in zip(plan.shapes, slow.shapes, strict=True):
        assert np.array_equal(one.positions, other.positions)
    assert np.array_equal(plan.times, slow.times)
