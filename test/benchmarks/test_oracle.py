# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A sample of the frozen answers, and whether faults of the smallest size are noticed."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.oracle import checking, contacts, frozen, plans, shapes
from benchmarks.oracle.answers import BELOW, FACTOR, Answer, Field
from benchmarks.oracle.given import Given
from benchmarks.oracle.kinds import KINDS
from dlo_planner import DirectSimulator

pytestmark = pytest.mark.sweep  # the package has tests of its own

KNOWN = frozen.load()


def differences(kinds, sample):
    """Return what differs in a sample of some kinds."""
    cases = checking.chosen(KNOWN, kinds, sample)
    assert cases
    return [one for one in checking.check(_Here, KNOWN, cases, None) if one.differences]


class _Here:
    map = staticmethod(map)


def test_the_code_answers_as_it_did():
    found = differences(KINDS, 3)
    assert not found, '\n'.join(checking.table(KNOWN, found))


def test_every_kind_is_frozen_and_few_cases_are_left_out():
    for kind, (count, _) in KINDS.items():
        own = [key for key in KNOWN.answers if key[0] == kind]
        left = [key for key in KNOWN.left_out if key[0] == kind]
        assert sorted(own + left) == [(kind, number) for number in range(count)]
        assert len(own) >= 0.6 * count
    assert len(KNOWN.answers) >= 2500 and frozen.FILE.stat().st_size < 1.5e6


def stiffer(make):
    def changed(self, *args, **more):
        rod = make(self, *args, **more)
        return replace(rod, bending_stiffness=tuple(
            (1 + 1e-5) * one for one in rod.bending_stiffness))
    return changed


class Elsewhere(DirectSimulator):
    """A simulator in whose world something is a little different."""

    def __init__(self, rod, *, gravity=(0, 0, -9.81), obstacles=(), **more):
        super().__init__(rod, gravity=self.heavier * np.asarray(gravity), obstacles=[
            self.other(one) for one in obstacles], **more)

    heavier = 1.0

    def other(self, obstacle):
        return obstacle


class Heavier(Elsewhere):
    heavier = 1 + 1e-5


class Rougher(Elsewhere):
    def other(self, obstacle):
        return replace(obstacle, friction=1.001 * obstacle.friction)


def test_a_stiffness_that_is_a_hundred_thousandth_off_is_noticed(monkeypatch):
    monkeypatch.setattr(Given, 'rod', stiffer(Given.rod))
    for kind in ('cold', 'warm', 'accuracy', 'track', 'held'):
        assert len(differences([kind], 6)) >= 4


@pytest.mark.parametrize('module, kinds, world, sample', [
    (shapes, ['cold', 'warm', 'track', 'held'], Heavier, 6),
    (contacts, ['pressed'], Heavier, 6), (contacts, ['rubbed'], Rougher, 6),
    (plans, ['thread'], Heavier, 6), (plans, ['insert'], Heavier, 12)])  # 12 of 45 insertions do
def test_another_world_is_noticed(monkeypatch, module, kinds, world, sample):
    monkeypatch.setattr(module, 'DirectSimulator', world)
    for kind in kinds:
        assert len(differences([kind], sample)) >= max(2, sample // 4)


def answer(word, values=(1.0,), tolerance=1e-3, how='near'):
    return Answer({'place': Field(np.array(values), tolerance, how)}, {'verdict': word})


def test_what_differs_is_said():
    one = answer('converged')
    assert one.differences(answer('converged', (1.0009,))) == []
    assert one.differences(answer('converged', (1.002,)))[0][0] == 'place'
    assert one.differences(answer('converged', (np.nan,)))[0][1] == np.inf
    assert one.differences(answer('converged', (1.0, 2.0)))[0][2] == '1 numbers -> 2'
    assert [name for name, *_ in one.differences(answer('jumped', (5.0,)))] == ['verdict']
    assert one.differences(Answer({}, {'verdict': 'converged'}))[0][2] == 'is missing'


def test_error_estimates_may_be_off_by_a_factor_and_residuals_are_limits():
    for now, differs in ((1.9, False), (2.1, True), (0.51, False), (0.49, True)):
        assert bool(answer('c', how=FACTOR).differences(answer('c', (now,)))) == differs
    small = answer('c', (1e-12,), 1e-8, BELOW)
    assert small.differences(answer('c', (9e-9,))) == []
    assert small.differences(answer('c', (2e-8,))) != []


def test_what_is_written_is_read(tmp_path):
    first = next(iter(KNOWN.answers))
    some = frozen.Frozen({first: KNOWN.answers[first]}, {first: 0.1}, {('cold', 7): 'verdict'},
                         {'commit': 'a'})
    frozen.save(some, tmp_path / 'some.npz')
    again = frozen.load(tmp_path / 'some.npz')
    assert again[1:] == some[1:]
    assert again.answers[first].differences(some.answers[first]) == []
    assert again.answers[first].words == some.answers[first].words
