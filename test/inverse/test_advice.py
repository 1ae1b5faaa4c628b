# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What would let a refused DLO through a hole: each lever holds, and is near its bound."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
    Sheet,
    Thread,
)
from dlo_planner.inverse import advice
from dlo_planner.tasks import Requirements

GRAVITY = (0.0, 0.0, -9.80665)
SOFT = Rod(1.0, 0.04, 1.57e-3, 1.2e-3, radius=3e-3)  # w L^3/EI = 250
WIRE = Rod(0.2, 0.0174, 1.22e-4, 1.0e-4, radius=1.5e-3)


def hole(elevation, radius):
    up = np.deg2rad(elevation)
    return CutOut(Pose.looking_along((0.1, 0.2, 1.0), (np.cos(up), 0.0, np.sin(up))),
                  radius=radius)


def thread(rod, cutout, **options):
    obstacles = options.pop('obstacles', ())
    simulator = DirectSimulator(rod, gravity=GRAVITY, obstacles=obstacles)
    requirements = options.pop('requirements', None)
    deadline = options.pop('deadline', None)
    return InverseSimulator(simulator).plan(Thread(cutout, **options), deadline=deadline,
                                            requirements=requirements)


def refusal(*given, **options):
    with pytest.raises(Infeasible) as caught:
        thread(*given, **options)
    return caught.value


def number(pattern, words):
    return float(re.search(pattern + r' ([\d.e-]+)', words)[1])


def test_held_nearer_it_passes_and_no_farther():
    free = number('held at most', refusal(SOFT, hole(40, 0.02)).advice)
    assert len(thread(replace(SOFT, length=free / 1.02), hole(40, 0.02))) == 40
    refusal(replace(SOFT, length=1.04 * free), hole(40, 0.02))


@pytest.mark.sweep
def test_turned_downwards_it_passes_and_no_less():
    # a search with fewer depths than a plan finds a way before there is a plan: the first plan that
    # was tried then was 2 degrees farther
    rod = Rod(1.0, 0.04, 3.123e-3, 2.342e-3, radius=4.6e-3)
    turned = number('downwards by', refusal(rod, hole(1.3, 0.0243)).advice)
    assert len(thread(rod, hole(1.3 - turned - 0.1, 0.0243))) == 40
    refusal(rod, hole(1.3 - 0.95 * turned, 0.0243))


@pytest.mark.sweep
def test_through_a_larger_hole_it_keeps_a_margin():
    given = {'requirements': Requirements(margin=0.0), 'depths': np.linspace(0, 0.19, 12)}
    radius = number('of radius', refusal(WIRE, hole(0, 0.01), **given).advice)
    assert 0.01 < radius < 0.0115
    assert thread(WIRE, hole(0, 1.02 * radius), **given).margin.min() >= 0


def test_it_is_asked_for_when_the_deadline_is_over():
    refused = refusal(SOFT, hole(40, 0.02), deadline=5.0)
    begun = refused.advise.args[1].demands.progress
    begun._begun -= 10.0
    assert begun.left() == pytest.approx(1e-9)
    assert 'held at most' in refused.advice


def test_no_hole_is_larger_than_its_sheet():
    cutout = hole(40, 0.02)
    sheet = Sheet(cutout.pose, 0.1, 0.1, 0.004, (cutout,))
    assert 'held at most' in refusal(SOFT, cutout, obstacles=[sheet]).advice


def test_a_hole_that_is_narrower_than_the_dlo_is_to_be_larger():
    advice = refusal(WIRE, hole(-20, 0.001)).advice
    radius = number('of radius', advice)
    assert radius > WIRE.radius
    assert 'held' not in advice
    assert len(thread(WIRE, hole(-20, radius))) == 40  # rounded up: 1.5 mm is as wide as the DLO


@pytest.mark.parametrize('gap', [0.0, 0.004, 0.05, 0.2])
@pytest.mark.parametrize('bound', [0.11, 0.3, 0.52, 0.9, 0.999])
@pytest.mark.parametrize('guess', [0.0, 0.3, 0.95, 7.0])
def test_a_bound_is_found_from_any_guess(guess, bound, gap):
    # a search finds a way up to the bound, a plan may need somewhat more
    tried, looks = [], []

    def passes(x):
        looks.append(x)
        return x <= bound

    def planned(x):
        tried.append(x)
        return x <= bound - gap

    found = advice._bound(passes, planned, advice._Lever(0.1, 1.0, guess, 0.05, lambda x: 0.02 * x))
    if bound - gap < 0.1:
        assert found is None
        return
    assert found in tried and planned(found)
    assert bound - gap - found <= 0.02 * bound + 1e-12
    assert len(looks) <= 12 and len(tried) <= 11
    assert min(looks + tried) >= 0.1 and max(looks + tried) < 1.0


def test_what_never_passes_has_no_bound():
    lever = advice._Lever(0.1, 1.0, 0.6, 0.05, lambda x: 0.02 * x)
    assert advice._bound(lambda x: False, lambda x: True, lever) is None
    assert advice._bound(lambda x: True, lambda x: False, lever) is None
