# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading tasks of others, in the plant."""

import re
from pathlib import Path

import pytest

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from benchmarks import deft  # noqa: E402  mujoco may be missing
from dlo_planner import DirectSimulator, Pose  # noqa: E402

pytestmark = pytest.mark.sweep  # the package has tests of its own


def test_the_grid_has_forty_different_cases():
    cases = deft.grid()
    assert len(cases) == len({case.name for case in cases}) == 5 * 4 * 2
    places = {(case.task.start, tuple(case.task.cutout.center)) for case in cases}
    assert len(places) == 40
    assert len({case.task.start for case in cases}) == 5
    assert {tuple(case.task.cutout.center) for case in cases} == {
        (across, 0.0, height) for across in deft.HOLES.values() for height in deft.HEIGHTS}
    assert all(case.task.depth == case.aligned == 0.05 for case in cases)


def test_the_free_end_droops_as_the_page_says():
    page = (Path(deft.__file__).parent / 'results' / 'others.md').read_text()
    said = re.search(r'a free end of (\d+) mm, which droops by some (\d+) mm', page)
    shape = DirectSimulator(deft.CABLE).solve(Pose.identity())
    assert [round(1e3 * deft.CABLE.length), round(-1e3 * shape.positions[-1, 2], -1)] == [
        float(number) for number in said.groups()]


def test_narrow_holes_are_as_wide_as_stated():
    cases = {case.name: case.task for case in deft.narrow()}
    assert len(cases) == len(deft.NARROW) * len(deft.RATIOS)
    published = cases['string 3.5 mm, 1.4']
    assert 2 * published.cutout.radius == pytest.approx(4.9e-3)
    assert 2 * published.rod.radius == pytest.approx(3.5e-3)


def test_a_case_is_threaded():
    case = deft.grid()[32]  # begins along the board
    result = deft.tried(case)
    assert result.clean, result.outcome
    assert result.outcome.depth == pytest.approx(0.05, abs=1.5e-3)
    assert result.aligned < 1e-3
    last = result.tips[-1] - case.task.cutout.center
    assert last @ case.task.cutout.normal == pytest.approx(0.05, abs=2e-3)
    assert result.outcome.miss < case.task.room
