# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What NumPy takes for numbers although nobody means them: durations, dates and bytes."""

from dataclasses import replace

import pytest
from misuse import MALFORMED
from specimens import values

from dlo_planner import (
    DirectSimulator,
    DloPlannerError,
    Pose,
    Rod,
    Sphere,
    Thread,
    Workspace,
)
from dlo_planner.model.checks import number, row

ROD = Rod(1.0, 0.1, 0.5, 0.4)
ODD = ('a duration', 'a date', '3 durations', 'bytearray', 'memoryview', 'a byte', '4 bytes',
       'rows of bytes', 'a scalar', '3 scalars')
ASKING = {
    'Rod.length': lambda odd: replace(ROD, length=odd),
    'bending_stiffness': lambda odd: replace(ROD, bending_stiffness=odd),
    'natural_curvature': lambda odd: replace(ROD, natural_curvature=odd),
    'nodes': lambda odd: replace(ROD, nodes=odd),
    'Pose.position': lambda odd: Pose(odd, (0, 0, 0, 1)),
    'Sphere.center': lambda odd: Sphere(odd, 0.1),
    'gravity': lambda odd: DirectSimulator(ROD, gravity=odd),
    'Workspace.lower': lambda odd: Workspace(lower=odd),
    'depths': lambda odd: Thread(values()['CutOut'], depths=odd),
    'Plan.times': lambda odd: replace(values()['Plan'], times=odd),
    'Shape.energy': lambda odd: replace(values()['Shape'], energy=odd, state=values()[
        'Shape'].state.forgotten()),
    's': lambda odd: values()['Shape'].at(s=odd),
    'Trajectory times': lambda odd: values()['Trajectory'].progress(times=odd)}


@pytest.mark.parametrize('odd', ODD)
@pytest.mark.parametrize('name', ASKING)
def test_what_is_no_number_is_refused_by_name(name, odd):
    with pytest.raises(DloPlannerError, match=name.split('.')[-1].rsplit(' ', maxsplit=1)[-1]):
        ASKING[name](MALFORMED[odd]())


@pytest.mark.parametrize('name', ['Pose.position', 'Sphere.center', 'gravity', 'Workspace.lower'])
def test_masked_numbers_are_refused(name):
    with pytest.raises(DloPlannerError, match='none masked'):
        ASKING[name](MALFORMED['masked']())


def test_a_limit_that_does_not_exist_is_no_limit_by_another_name():
    for judged, value in ((number, 1.0), (row, [1.0])):
        with pytest.raises(TypeError, match='minimun'):
            judged('x', value, minimun=0.0)
