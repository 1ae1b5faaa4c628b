# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Names of obstacles: kept with them, a line of text."""

import pickle
from dataclasses import replace

import pytest

from dlo_planner import CutOut, InvalidTask, Pose, Sheet, Sphere
from dlo_planner.inverse.plain_tasks import from_plain, to_plain
from dlo_planner.model.obstacles import called

BALL = Sphere((0, 0, 0), 0.1)


def test_a_name_goes_with_an_obstacle_and_makes_no_other_one_of_it():
    table = replace(BALL, name='table')
    assert table == BALL and hash(table) == hash(BALL)
    assert pickle.loads(pickle.dumps(table)).name == 'table'
    assert repr(table).startswith("Sphere(name='table', ")
    assert called(table, 3) == 'table' and called(BALL, 3) == 'Sphere 3'
    assert from_plain('it', to_plain(table)).name == 'table'


def test_a_sheet_around_a_hole_has_a_name():
    hole = CutOut(Pose.identity(), radius=0.01)
    assert Sheet.around(hole, name='panel').name == 'panel'


@pytest.mark.parametrize('name', ['two\nlines', ' table', 'table ', 'x' * 257, 3, None, b'table'])
def test_what_is_no_line_of_text_is_refused(name):
    with pytest.raises(InvalidTask, match=r'Sphere\.name = .*: expected a line of at most 256'):
        replace(BALL, name=name)
