"""What speaks against a correction, and against an estimate: without a node."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import DEPTHS, NOISE, SPREAD, START, Truth, plan_of

from dlo_planner import Box, Pose, correct
from dlo_planner.ros.doubts import doubts, unexplained
from dlo_planner.ros.observing import Observing, Seeing
from dlo_planner.ros.parameters import ENTRIES
from dlo_planner.ros.scene import build_scene

SEEING = Seeing(SPREAD, NOISE)
PLAN = plan_of(depths=DEPTHS)


def scene(*obstacles, **changes):
    values = {name: entry.default for name, entry in ENTRIES.items()} | {
        'rod.diameter': 1.5e-3, 'observe.largest_correction': 0.05}
    return build_scene(values | {name.replace('__', '.'): value
                                 for name, value in changes.items()}, obstacles)


def looked(points_of, looks=8):
    out = Observing(scene().direct, SEEING)
    for time in (0.0, 10.0):
        out.gripper(time, START)
    for k in range(looks):
        out.look(0.1 + 0.3 * k, points_of())
    return out.estimate


@pytest.fixture(scope='module')
def estimate():
    rng = np.random.default_rng(4)
    truth = Truth.drawn(rng)
    shape = truth.shape(START)
    return looked(lambda: truth.seen(rng, START, shape=shape).points)


def test_a_dlo_that_hangs_freely_is_explained(estimate):
    assert unexplained(estimate, SEEING) == ''
    assert doubts(correct(estimate, PLAN), estimate, scene()) == ''


def test_a_dlo_that_does_not_hang_freely_is_not_explained():
    rng = np.random.default_rng(4)
    shape = Truth.drawn(rng).shape(START)

    def lifted():  # something bears its free half up
        points = shape.positions_at(np.linspace(0, 0.99, 30) * shape.s[-1])
        points[:, 2] = np.maximum(points[:, 2], shape.positions[-1, 2] + 0.2)
        return points + NOISE * rng.normal(size=points.shape)

    estimate = looked(lifted)
    said = unexplained(estimate, SEEING)
    assert 'none of the DLO as it is estimated: expected at most 30%' in said


@pytest.mark.parametrize(('changes', 'said'), [
    ({'misfit': 0.26}, 'the points are 0.26 m off the DLO as it is estimated'),
    ({'outliers': 0.67}, '67% of the points are none of the DLO as it is estimated')])
def test_no_correction_by_an_estimate_of_something_else(estimate, changes, said):
    wrong = replace(estimate, **changes)
    assert said in unexplained(wrong, SEEING)
    assert said in doubts(correct(estimate, PLAN), wrong, scene())
    careless = replace(SEEING, noise=0.1, outliers=0.8)
    assert unexplained(wrong, careless) == ''


def test_the_best_aim_is_taken_though_it_is_not_sure(estimate):
    # of what the poses were before it is known still less
    correction = correct(estimate, PLAN)
    unsure = replace(correction, miss=replace(correction.miss, bound=10 + correction.miss.bound))
    assert doubts(unsure, estimate, scene(cutouts__radius=2e-3)) == ''


def test_a_correction_keeps_workspace_and_obstacles(estimate):
    correction = correct(estimate, PLAN)
    first = correction.grippers[0].position
    said = doubts(correction, estimate, scene(workspace__upper=[*(first[:2] + 1),
                                                                float(first[2]) - 1e-3]))
    assert 'it moves the gripper' in said and 'beyond workspace.upper.z' in said
    tip = correction.shapes[-1].positions[-1]
    said = doubts(correction, estimate, scene(Box(Pose(tip, (0, 0, 0, 1)), (0.02, 0.02, 0.02))))
    assert 'm into Box 0' in said
    far = replace(correction, offsets=correction.offsets + 0.1)
    assert 'observe.largest_correction = 0.05 m' in doubts(far, estimate, scene())
    lost = replace(correction, converged=False)
    assert 'no stable shape' in doubts(lost, estimate, scene())
