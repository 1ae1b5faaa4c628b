# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A search begins where the way so far leads: fewer steps, the same shapes."""

import numpy as np
import pytest

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod
from dlo_planner.inverse.continuation import Aligned, Passing

CUTOUT = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0)))


@pytest.mark.parametrize('options', [{'basis': 'local', 'n_elements': 64}, {'n_elements': 64}, {}])
@pytest.mark.parametrize('bent', [(0.0, 0.0), (0.5, -0.8)])
def test_plans_are_the_same_with_fewer_steps(options, bent, monkeypatch):
    rod = Rod(1.0, 0.1, (0.3, 0.5), 0.4, natural_curvature=bent)
    inverse, depths = InverseSimulator(DirectSimulator(rod, **options)), np.linspace(0, 0.8, 41)
    ahead = inverse.thread(CUTOUT, depths=depths)
    monkeypatch.setattr(Passing, 'trend', lambda passing, depth: None)
    monkeypatch.setattr(Aligned, 'onward', lambda *_: [])  # it knows of trends by itself
    from_before = inverse.thread(CUTOUT, depths=depths)
    for one, other in zip(ahead.grippers, from_before.grippers, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-9)
    np.testing.assert_allclose(ahead.stability, from_before.stability, rtol=1e-3)
    steps = [sum(shape.iterations for shape in plan.shapes) for plan in (ahead, from_before)]
    assert steps[0] < steps[1]


@pytest.mark.parametrize('options', [{'n_elements': 48, 'basis': 'local'}, {}])
def test_two_cutouts_are_passed_alike_with_no_more_steps(options, monkeypatch):
    rod = Rod(1.0, 0.05, (0.2, 0.5), 0.3, natural_curvature=(0.3, 0.2), natural_twist=0.4)
    inverse = InverseSimulator(DirectSimulator(rod, **options))
    task = {'second': hole((0.3, 0.05, 0.95)), 'depths': np.linspace(0.35, 0.8, 31)}
    ahead = inverse.thread_two(hole((0.0, 0.0, 1.0)), **task)
    monkeypatch.setattr(Passing, 'trend', lambda passing, depth: None)
    from_before = inverse.thread_two(hole((0.0, 0.0, 1.0)), **task)
    for one, other in zip(ahead.grippers, from_before.grippers, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-8)
    np.testing.assert_allclose(ahead.position_errors, 0, atol=1e-9)
    np.testing.assert_allclose(ahead.stability, from_before.stability, rtol=1e-3)
    steps = [sum(shape.iterations for shape in plan.shapes) for plan in (ahead, from_before)]
    assert steps[0] <= steps[1]


def hole(center):
    return CutOut(Pose.looking_along(center, (1, 0, 0)))


def test_a_trend_is_believed_for_a_few_steps_on():
    shape = DirectSimulator(Rod(1.0, 0.1, 0.3, 0.2), basis='local', n_elements=8).solve(CUTOUT.pose)
    later = Passing(shape, np.zeros(3), depth=0.3,
                    since=Passing(shape, np.zeros(3), depth=0.2))
    assert later.trend(0.4) == (shape, pytest.approx(1.0))
    assert later.trend(0.35) == (shape, pytest.approx(0.5))
    for depth in (0.3, 0.25, 0.9):  # nowhere, back, too far
        assert later.trend(depth) is None
    assert later._replace(since=None).trend(0.4) is None
    for begun in (float('nan'), 0.3):
        since = later.since._replace(depth=begun)
        assert later._replace(since=since).trend(0.4) is None
