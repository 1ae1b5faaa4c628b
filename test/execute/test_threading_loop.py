# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A threading with a camera in exact time, where nothing is wrong and where something is."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import SPREAD, WIRE
from threadings_at_rest import KINDS, RADIUS, STATED, World, threaded

from dlo_planner import DirectSimulator, Infeasible, InverseSimulator, Sphere
from dlo_planner.cell.tasks import draw_task
from dlo_planner.execute.threading_motions import Threading, way_back, way_to_standoff
from dlo_planner.identify.closed_loop import Phase
from dlo_planner.identify.observing import Observing, Seeing


def phases(came):
    return [line.split(' ', 1)[1] for line in came.log]


def test_where_nothing_is_wrong_it_goes_in():
    came = threaded(0, World(robot=(1e-4, 3e-4)))
    assert came.clean
    assert came.tries == 0
    assert came.miss <= came.promised
    assert phases(came)[:6] == ['look', 'plan', 'go', 'look', 'plan', 'enter']


def test_a_slip_before_the_sheet_is_seen_and_it_tries_again():
    came = threaded(0, KINDS['slip'])
    assert came.tries >= 1
    assert not came.rammed
    assert 'retreat' in phases(came)
    assert phases(came).index('retreat') == phases(came).index('enter') + 1
    assert came.end is Phase.STOP or came.clean


@pytest.mark.sweep
def test_a_dlo_that_keeps_swinging_is_not_threaded():
    came = threaded(2, replace(KINDS['bump'], bump=0.1))
    assert came.end is Phase.STOP
    assert came.depth == 0
    assert came.tries == 1  # and then it waits for rest in vain
    assert 'looks at the DLO do not agree' in came.reason


def test_a_robot_that_wanders_too_far_is_not_let_in():
    seeing = Seeing(SPREAD, 1e-3, 0.5e-3, 0.1, cutout=0.5e-3, period=0.1,
                    robot_time=5.0, **{**STATED, 'robot_rotation': 5e-3})
    came = threaded(0, World(), seeing)
    assert came.end is Phase.STOP
    assert came.depth == 0
    assert 'may miss the center' in came.reason


def test_motions_stay_clear_of_what_is_around():
    simulator, drawn = DirectSimulator(WIRE), draw_task(0, 'wire 1.5', RADIUS)
    estimate = Observing(simulator, Seeing(SPREAD)).estimate

    def among(*obstacles):
        return Threading(InverseSimulator(DirectSimulator(WIRE, obstacles=obstacles)),
                         drawn.cutout, np.linspace(0, 0.4, 9), 0.05)

    free = way_to_standoff(among(), estimate, drawn.start).trajectory
    poses = free.poses(np.linspace(0.0, free.duration, 5))
    shapes = simulator.track(poses)
    beside = Sphere(drawn.cutout.center + (0.0, 0.0, 2.0), 0.1)
    back = way_back(among(beside), estimate, poses, shapes[0]).trajectory.motion
    assert 0.5 < back.clearance < 3.0
    with pytest.raises(Infeasible, match='in motion|touches what the plan does not'):
        way_back(among(Sphere(shapes[2].positions[-1], 0.01)), estimate, poses, shapes[0])
