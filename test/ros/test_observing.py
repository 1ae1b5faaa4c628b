# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a camera sees, made an estimate and then parameters: without a node."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import NOISE, SPREAD, START, WIRE, Truth

from dlo_planner import DirectSimulator, InvalidTask, Pose, Rod
from dlo_planner.ros.identifying import identified, told
from dlo_planner.ros.observing import Observing, Seeing, motion_at
from dlo_planner.ros.parameters import ENTRIES
from dlo_planner.ros.scene import build_scene

SEEING = Seeing(SPREAD, NOISE)
COPPER = {'rod.diameter': 1.5e-3}
SPRING = {'rod.section': 'stiffness', 'rod.mass_per_length': 0.05, 'rod.torsional_stiffness': 0.02,
          'rod.bending_stiffness': [0.03, 0.05]}


def parameters(**changes):
    return {name: entry.default for name, entry in ENTRIES.items()} | changes


def observing(simulator=None, seeing=SEEING, gripper=START, times=(0.0, 10.0)):
    out = Observing(simulator or DirectSimulator(WIRE), seeing)
    for time in times:
        out.gripper(time, gripper)
    return out


def looked(out, truth, rng, gripper=START, looks=20):
    shape = truth.shape(gripper)
    for k in range(looks):
        out.look(0.1 + 0.2 * k, truth.seen(rng, gripper, shape=shape).points)
    return out.estimate


def test_looks_tell_the_shape(rng):
    truth, out = Truth.drawn(rng), observing()
    shape = truth.shape(START)
    before = np.abs(out.estimate.shape(START).positions - shape.positions).max()
    estimate = looked(out, truth, rng)
    assert estimate.looks == 20
    assert np.abs(estimate.shape(START).positions_at(np.linspace(0, 0.99, 9))
                  - shape.positions_at(np.linspace(0, 0.99, 9))).max() < 0.2 * before
    out.reset()
    assert out.estimate.looks == 0


def test_a_cloud_needs_points_and_a_gripper_of_its_time(rng):
    out, points = observing(), np.zeros((5, 3))
    with pytest.raises(InvalidTask, match='observed_points has 2 points: expected 3'):
        out.look(1.0, points[:2])
    for stamp in (-0.001, 10.001):
        with pytest.raises(InvalidTask, match=r'stamp = .* gripper poses are known: 0.000 to 10'):
            out.look(stamp, points)
    with pytest.raises(InvalidTask, match='known: none'):
        observing(times=()).look(1.0, points)
    assert out.estimate.looks == 0


def test_clouds_are_thinned_out_by_time_and_points(rng):
    truth, out = Truth.drawn(rng), observing()
    assert out.due(0.1)
    out.look(0.1, truth.seen(rng, START, count=5000, hidden=0.0, outliers=0.0).points)
    assert not out.due(0.25)
    assert out.due(0.31)
    assert out.due(-60.0)  # the clock was set back


def test_gripper_poses_that_come_late_are_left_out():
    out = observing(times=(0.0, 1.0, 0.5, 1.0, 2.0))
    assert [stamp for stamp, _ in out._grippers] == [0.0, 1.0, 2.0]


def test_gripper_poses_of_a_clock_that_was_set_back_are_believed(rng):
    out = observing(times=(0.0, 5000.0, 5000.1, 100.0, 100.1))
    assert [stamp for stamp, _ in out._grippers] == [100.0, 100.1]
    assert out.look(100.05, Truth.drawn(rng).seen(rng, START).points).looks == 1


def test_where_a_gripper_moved_unseen_nothing_is_told(rng):
    points = Truth.drawn(rng).seen(rng, START).points
    out = observing(times=(0.0, 1.0))
    out.gripper(3.0, Pose(START.position + (0.1, 0, 0), START.quaternion))
    with pytest.raises(InvalidTask, match=r'gripper poses at most 0.5 s apart then, not 2 s'):
        out.look(2.0, points)
    assert out.look(0.5, points).looks == 1  # it stood


def test_speed_and_acceleration():
    times = np.linspace(0, 2, 101)
    poses = [Pose.from_rotation((0.05 * t + 0.1 * t**2, 0, 0), np.eye(3)) for t in times]
    speed, acceleration = motion_at(times, poses, 1.0, 1.0)
    assert speed == pytest.approx(0.25)
    assert acceleration == pytest.approx(0.2)
    turning = [Pose((0, 0, 0), (0, 0, np.sin(0.15 * t), np.cos(0.15 * t))) for t in times]
    assert motion_at(times, turning, 1.0, 0.5)[0] == pytest.approx(0.15)
    assert motion_at(times[:2], poses[:2], 0.0, 1.0) == (0.0, 0.0)


def test_what_moves_counts_less(rng):
    truth, rest, moving = Truth.drawn(rng), observing(), observing(times=())
    for time in np.linspace(0, 1, 51):
        moving.gripper(time, Pose(START.position + (0.1 * (time - 0.5), 0, 0), START.quaternion))
    points = truth.seen(rng, START).points
    sure, less = (np.linalg.det(out.look(0.5, points).covariance) for out in (rest, moving))
    assert sure < 0.1 * less


@pytest.mark.parametrize('section', [COPPER, SPRING])
def test_what_is_identified_is_the_dlo_of_the_estimate(section, rng):
    values = parameters(**section)
    scene = build_scene(values)
    truth = Truth.drawn(rng, scene.direct.rod)
    estimate = looked(observing(scene.direct), truth, rng, looks=6)
    changed = identified(estimate, values)
    assert set(changed) <= set(ENTRIES)
    assert all(type(value) is type(ENTRIES[name].default) for name, value in changed.items())
    after = build_scene(values | changed)
    commanded = START.compose(after.tool)
    np.testing.assert_allclose(commanded.matrix, estimate.actual(START).matrix, atol=1e-12)
    s = np.linspace(0, 0.999, 9) * after.direct.rod.length
    np.testing.assert_allclose(after.direct.solve(commanded).positions_at(s),
                               estimate.shape(START).positions_at(s), atol=2e-4)
    assert 'natural_curvature' in told(estimate)


def test_terms_add_up(rng):
    values = parameters(**COPPER, **{'rod.natural_curvature_terms': [0.1, 0.2, 0.0, -0.1]})
    rod = build_scene(values).direct.rod
    np.testing.assert_allclose(rod.natural_strains([0.0, 1.0])[:, 1:],
                               [[-0.1, -0.3], [0.1, 0.1]])
    estimate = observing(DirectSimulator(rod)).estimate
    assert identified(estimate, values)['rod.natural_curvature_terms'][:4] == [0.1, 0.2, 0.0, -0.1]


def test_terms_that_are_no_pairs_are_refused():
    with pytest.raises(InvalidTask, match='rod.natural_curvature_terms'):
        build_scene(parameters(**{'rod.natural_curvature_terms': [0.1, 0.2, 0.3]}))


def test_nothing_uncertain_is_refused():
    with pytest.raises(InvalidTask, match='uncertainty'):
        Observing(DirectSimulator(replace(WIRE)), Seeing())
    assert isinstance(WIRE, Rod)
