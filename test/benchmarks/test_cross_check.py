# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The comparison with another engine, coarse; its limits, and what it makes of refinements."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.cross import refinement
from benchmarks.cross.scenes import CONTACT, STATIC, scenes

pytestmark = pytest.mark.sweep  # the package has tests of its own

KEPT = Path(__file__).parents[2] / 'benchmarks' / 'results' / 'validation' / 'cross_check.json'


def scene(words):
    return next(one for one in scenes() if words in one.name)


def test_the_limit_of_errors_that_fall_with_the_square_is_exact(rng):
    cells, true, rate = (20, 28, 40, 56), rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    found = np.array([true + rate / n**2 for n in cells])
    np.testing.assert_allclose(refinement.limit(cells, found), true, atol=1e-12)
    assert refinement.doubt(cells, found) < 1e-12


def test_noise_is_doubted_by_about_its_size(rng):
    cells = (20, 28, 40, 56)
    found = np.array([np.ones((200, 3)) + rng.normal(size=(200, 3)) / n**2 for n in cells])
    off = refinement.largest(refinement.limit(cells, found) - 1)
    assert 0.3 * off < refinement.doubt(cells, found) < 10 * off


def test_the_limit_is_known_as_well_as_is_said(rng):
    cells = (20, 24, 28, 34, 40, 48, 56)
    found = np.array([rng.normal(size=(400, 3)) / n**2 for n in cells])
    off = np.linalg.norm(refinement.limit(cells, found), axis=-1)
    said = [refinement.doubt(cells, found[:, k]) for k in range(len(off))]
    assert np.mean(off < said) > 0.8 and np.median(said) < 4 * np.median(off)


def test_what_mujoco_does_not_know_is_not_claimed():
    pytest.importorskip('matplotlib')
    from benchmarks.cross_check import Compared  # noqa: PLC0415
    touching = next(one for one in scenes() if one.kind == CONTACT)
    places = np.zeros((1, 2, 3))
    for apart, doubt, met in ((2e-4, 3e-4, True), (6e-4, 3e-4, False), (2e-4, 9e-4, False)):
        one = Compared(touching, places, places, apart, apart, doubt, estimate=2e-4)
        assert one.met == met and one.shown == apart + doubt


def test_two_chains_tell_no_doubt():
    with pytest.raises(ValueError, match='three chains'):
        refinement.doubt((20, 40), np.zeros((2, 1, 3)))


def test_a_wire_that_hangs_freely_is_that_of_mujoco():
    pytest.importorskip('mujoco', reason='extra [cell] is not installed')
    from benchmarks.cross_check import compare  # noqa: PLC0415
    found = compare(scene('benchmark A'), (28, 40, 56))
    assert found.apart < found.estimate + found.doubt < 2e-4
    assert found.met


def test_a_wire_on_a_plane_is_that_of_mujoco():
    pytest.importorskip('mujoco', reason='extra [cell] is not installed')
    from benchmarks.cross_check import compare  # noqa: PLC0415
    found = compare(scene('plane'), (10, 14, 20), step=2e-3)
    assert found.package[0, -1, 2] == pytest.approx(0.75e-3, abs=1e-5)  # it lies there
    assert found.met and found.shown < 3e-4


def test_another_dlo_is_told_from_this_one():
    # a comparison that cannot fail would be none
    pytest.importorskip('mujoco', reason='extra [cell] is not installed')
    from benchmarks.cross_check import Compared, compare  # noqa: PLC0415
    one = scene('stiff wire')
    right = compare(one, (10, 14, 20))
    softer = replace(one, rod=replace(one.rod, bending_stiffness=0.99))
    wrong = compare(softer, (10, 14, 20))
    apart = refinement.largest(wrong.package - right.chain)
    assert right.met
    assert not Compared(one, wrong.package, right.chain, apart, apart, right.doubt,
                        right.estimate).met


def test_all_scenes_stand_in_the_docs_with_their_limits():
    kept = json.loads(KEPT.read_text())['cross_check']
    assert list(kept) == [one.name for one in scenes()]
    for one in scenes():
        row = kept[one.name]
        limit = row['own_estimate_m'] + row['mujoco_error_m']
        assert row['shown_m'] == pytest.approx(row['apart_m'] + row['mujoco_error_m'])
        if one.kind == CONTACT:  # less is not claimed than what MuJoCo can tell
            limit = min(limit, 1e-3 - row['mujoco_error_m'])
        assert row['limit_m'] == pytest.approx(limit)
        assert row['met'] == (row['apart_m'] <= limit)
        if one.kind in (STATIC, CONTACT):
            assert row['met'], one.name
