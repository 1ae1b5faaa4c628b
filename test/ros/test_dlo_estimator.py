# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a camera sees, made an estimate and then parameters: without a node."""

import re
from dataclasses import replace
from threading import Timer

import numpy as np
import pytest
from closed_loops import DEPTHS, NOISE, SPREAD, START, WIRE, Truth, plan_of

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InvalidTask,
    Limits,
    Pose,
    Rod,
    Trajectory,
    Uncertainty,
)
from dlo_planner.execute.causes import Refused
from dlo_planner.identify.estimator import DloEstimator, EstimatorConfig, Swing, motion_at
from dlo_planner.ros.estimate import _said, estimate_summary, in_front, observing_of
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.build import parameters_of_estimate
from dlo_planner.settings.parameters import PARAMETERS

SEEING = EstimatorConfig(SPREAD, NOISE, bias=0.0, camera_rotation=0.0)  # a camera as stated
COPPER = {'rod.diameter': 1.5e-3}
SPRING = {'rod.section': 'stiffness', 'rod.mass_per_length': 0.05, 'rod.torsional_stiffness': 0.02,
          'rod.bending_stiffness': [0.03, 0.05]}


def parameters(**changes):
    return {name: entry.default for name, entry in PARAMETERS.items()} | changes


def observing(simulator=None, seeing=SEEING, gripper=START, times=(0.0, 10.0)):
    out = DloEstimator(simulator or DirectSimulator(WIRE), seeing)
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
    for stamp in (-0.001, 11.001):
        with pytest.raises(InvalidTask, match=r'known: 0.000 to 10.* s, or, where it stands, '
                           r'observe.pose_holds = 1 s later'):
            out.look(stamp, points)
    with pytest.raises(InvalidTask, match='known: none'):
        observing(times=()).look(1.0, points)
    assert out.estimate.looks == 0


def test_the_last_pose_of_a_gripper_that_stands_holds_for_a_while(rng):
    points = Truth.drawn(rng).seen(rng, START).points
    assert observing(times=(0.0, 0.4)).look(1.39, points).looks == 1  # 2.5 poses in a second
    assert observing(times=(5.0,)).look(5.9, points).looks == 1       # a single one
    moving = observing(times=(0.0,))
    moving.gripper(0.4, Pose(START.position + (0.01, 0, 0), START.quaternion))
    with pytest.raises(InvalidTask, match='gripper poses are known'):
        moving.look(0.401, points)
    moving.gripper(0.8, Pose(START.position + (0.01, 0, 0), START.quaternion))
    moving.look(0.9, points)  # it stands again
    assert moving.looked == 0.9
    never = DloEstimator(DirectSimulator(WIRE), replace(SEEING, pose_holds=0.0))
    never.gripper(0.0, START)
    with pytest.raises(InvalidTask, match='pose_holds = 0 s'):
        never.look(0.001, points)


def test_between_two_poses_a_gripper_is_where_it_was_between(rng):
    truth, out = Truth.drawn(rng), observing(times=())
    for time in (0.0, 0.4):  # 2.5 poses in a second, 2.5 cm/s
        out.gripper(time, Pose(START.position + (0, 0.025 * time, 0), START.quaternion))
    there = Pose(START.position + (0, 0.025 * 0.3, 0), START.quaternion)
    points = truth.seen(rng, there).points
    assert out.look(0.3, points).looks == 1  # 7.5 mm off it would not agree
    assert out.normalized_innovation < 0.5
    out.look(0.01, points)
    assert out.normalized_innovation > 1


def test_a_cloud_waits_for_the_next_pose_of_a_gripper_that_moves(rng):
    truth, out = Truth.drawn(rng), observing(times=())
    for time in (0.0, 0.4):
        out.gripper(time, Pose(START.position + (0, 0.025 * time, 0), START.quaternion))
    points = truth.seen(rng, Pose(START.position + (0, 0.0125, 0), START.quaternion)).points
    late = Timer(0.25, out.gripper, (0.8, Pose(START.position + (0, 0.02, 0), START.quaternion)))
    late.start()
    assert out.look(0.5, points).looks == 1
    late.join()


def test_clouds_are_thinned_out_by_time_and_points(rng):
    truth, out = Truth.drawn(rng), observing()
    assert out.due(0.1)
    out.look(0.1, truth.seen(rng, START, count=5000, hidden=0.0, outliers=0.0).points)
    assert not out.due(0.25)
    assert out.due(0.31)
    assert out.due(-60.0)  # the clock was set back
    out.closely = True
    assert [out.due(stamp) for stamp in (0.15, 0.17)] == [False, True]


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
    speed, acceleration, _ = motion_at(times, poses, 1.0, 1.0)
    assert speed == pytest.approx(0.25)
    assert acceleration == pytest.approx(0.2)
    turning = [Pose((0, 0, 0), (0, 0, np.sin(0.15 * t), np.cos(0.15 * t))) for t in times]
    assert motion_at(times, turning, 1.0, 0.5)[0] == pytest.approx(0.15)
    assert motion_at(times[:2], poses[:2], 0.0, 1.0)[:2] == (0.0, 0.0)


def test_a_late_stamp_hides_where_a_moving_gripper_is(rng):
    truth, rest, moving = Truth.drawn(rng), observing(), observing(times=())
    for time in np.linspace(0, 1, 51):
        moving.gripper(time, Pose(START.position + (0, 0.1 * (time - 0.5), 0), START.quaternion))
    points = truth.seen(rng, START).points
    sure, less = (out.look(0.5, points).deviations for out in (rest, moving))
    assert less['gripper_position[1]'] > 1.05 * sure['gripper_position[1]']  # along the motion
    assert less['gripper_position[2]'] == pytest.approx(sure['gripper_position[2]'], rel=0.01)


def test_all_points_of_a_late_cloud_are_off_together(rng):
    truth, moving = Truth.drawn(rng), observing(times=())
    for time in np.linspace(0, 1, 51):
        moving.gripper(time, Pose(START.position + (0, 0.1 * (time - 0.5), 0), START.quaternion))
    points = truth.seen(rng, START, outliers=0).points
    late = 0.1 * SEEING.stamps
    moving.look(0.5, points)
    moving.look(0.7, points + (0, 0.02 + late, 0))
    assert moving.normalized_innovation < 1
    mixed = points + (0, 0.02, 0) + 2 * late * np.sign(rng.normal(size=(len(points), 1)))
    moving.look(0.9, mixed + (0, 0.02, 0))
    assert moving.normalized_innovation > 1


def test_looks_that_disagree_are_not_believed_and_two_are_a_doubt(rng):
    truth, out = Truth.drawn(rng), observing()
    looked(out, truth, rng, looks=10)
    known, seen = out.estimate, out.seen
    slipped = replace(truth, offset=truth.offset.compose(
        Pose((0, 0, 0), (0, np.sin(0.006), 0, np.cos(0.006)))))
    shape = slipped.shape(START)
    for k in range(2):
        assert not out.inconsistent
        out.look(5.0 + 0.2 * k, slipped.seen(rng, START, shape=shape, outliers=0).points)
        assert out.estimate is known
        assert out.normalized_innovation > 1
        assert out.seen == seen
    assert out.inconsistent
    for k in range(7):  # it was something else
        assert out.inconsistent
        out.look(6.0 + 0.1 * k, truth.seen(rng, START).points)
    assert not out.inconsistent
    out.inflate_covariance(6.9)
    out.look(6.8, truth.seen(rng, START).points)
    assert out.looked == -np.inf  # of before it may tell of a vibration, and of nothing else
    for k in range(6):
        out.look(7.0 + 0.2 * k, slipped.seen(rng, START, shape=shape).points)
        assert not out.inconsistent
    assert np.abs(out.estimate.shape(START).positions_at(np.linspace(0, 0.99, 9))
                  - shape.positions_at(np.linspace(0, 0.99, 9))).max() < 3e-3


def test_one_look_that_no_chance_explains_is_a_doubt(rng):
    truth, out = Truth.drawn(rng), observing()
    looked(out, truth, rng, looks=10)
    slipped = replace(truth, offset=truth.offset.compose(
        Pose((0, 0, 0), (0, np.sin(0.05), 0, np.cos(0.05)))))
    out.look(5.0, slipped.seen(rng, START, outliers=0).points)
    assert out.normalized_innovation > 10
    assert out.inconsistent


def test_a_dlo_in_motion_is_expected_where_inertia_bends_it(rng):
    plan = plan_of(depths=DEPTHS)
    way = Trajectory(plan, Limits(0.3, 1.0), tolerance=0.02)
    swing = Swing.of(way, DirectSimulator(WIRE), plan.shapes[0])
    times = np.linspace(0, way.duration, 200)
    motion = DirectSimulator(WIRE).simulate(way.at(times)[0], times[1], plan.shapes[0])
    k = int(np.argmax(np.abs(np.diff(way.at(times)[1], axis=0)).sum(axis=1)))  # it accelerates
    bent, most = swing.at(times[k])
    still = DirectSimulator(WIRE).solve(motion.shapes[k].gripper, motion.shapes[k])
    s = np.linspace(0, 1, len(bent))
    expected = (motion.shapes[k].positions_at(s) - still.positions_at(s)
                ) @ motion.shapes[k].gripper.rotation
    assert most > 2e-3
    np.testing.assert_allclose(bent, expected, atol=0.15 * most)
    assert swing.at(np.inf)[1] == 0

    def looked_once(known):
        out = DloEstimator(DirectSimulator(WIRE), EstimatorConfig(
            replace(SPREAD, gripper_position=1e-4)))
        for time in times:
            out.gripper(time, way.at([time])[0][0])
        if known:
            out.moves(swing, lambda stamp: stamp)
        seen = motion.shapes[k].positions_at(np.linspace(0.05, 1, 40))
        out.look(times[k], seen + 3e-4 * rng.normal(size=seen.shape))
        assert out.normalized_innovation < 1
        return np.linalg.det(out.estimate.covariance)

    assert looked_once(True) < 0.1 * looked_once(False)  # what is not known may be anything


@pytest.mark.parametrize('section', [COPPER, SPRING])
def test_what_is_identified_is_the_dlo_of_the_estimate(section, rng):
    values = parameters(**section)
    scene = Scene.of(values)
    truth = Truth.drawn(rng, scene.direct.rod)
    estimate = looked(observing(scene.direct), truth, rng, looks=6)
    changed = parameters_of_estimate(estimate, values)
    assert set(changed) <= set(PARAMETERS)
    assert all(type(value) is type(PARAMETERS[name].default) for name, value in changed.items())
    after = Scene.of(values | changed)
    commanded = START.compose(after.tool)
    np.testing.assert_allclose(commanded.matrix, estimate.actual(START).matrix, atol=1e-12)
    s = np.linspace(0, 0.999, 9) * after.direct.rod.length
    np.testing.assert_allclose(after.direct.solve(commanded).positions_at(s),
                               estimate.shape(START).positions_at(s), atol=2e-4)
    said = estimate_summary(estimate)
    assert 'natural curvature about ' in said and '_' not in said.replace('P_', '')
    stiff, factor = re.search(r'bending stiffness (\S+) (?:and \S+ )?N m\^2 \((\S+) times', said
                              ).groups()
    rod = after.direct.rod
    assert float(stiff) == pytest.approx(rod.stiffnesses([0.5 * rod.length])[0, 1], rel=0.01)
    assert float(factor) == pytest.approx(np.exp(estimate.values['bending_stiffness']), rel=0.01)


@pytest.mark.parametrize(('name', 'value', 'said'), [
    ('length', 2e-3, 'length 1.002 m (+0.002 m) +- 0.0005 m'),
    ('natural_curvature[3]', 0.1, 'natural curvature about b (P_1 of s) +0.1 +- 0.0005 1/m'),
    ('gripper_rotation[1]', -0.01, 'grip turned about y by -0.01 +- 0.0005 rad'),
    ('camera[2]', 1e-3, 'camera shifted along z by +0.001 +- 0.0005 m'),
    ('stamps', 0.02, 'stamps late by +0.02 +- 0.0005 s'),
    ('cutout[0]', 1e-3, 'cut-out shifted along x by +0.001 +- 0.0005 m')])
def test_each_value_is_said_with_its_unit(name, value, said):
    observed = DloEstimator(DirectSimulator(WIRE), replace(
        SEEING, spread=replace(SPREAD, length=1e-3), bias=1e-3, camera_rotation=1e-3, cutout=1e-3))
    estimate = observed.estimate
    mean = estimate.mean.copy()
    mean[estimate.names.index(name)] = value
    assert _said(replace(estimate, mean=mean), name, value, 5e-4) == said


def test_terms_add_up(rng):
    values = parameters(**COPPER, **{'rod.natural_curvature_terms': [0.1, 0.2, 0.0, -0.1]})
    rod = Scene.of(values).direct.rod
    np.testing.assert_allclose(rod.natural_strains([0.0, 1.0])[:, 1:],
                               [[-0.1, -0.3], [0.1, 0.1]])
    estimate = observing(DirectSimulator(rod)).estimate
    changed = parameters_of_estimate(estimate, values)
    assert changed['rod.natural_curvature_terms'][:4] == [0.1, 0.2, 0.0, -0.1]


def test_terms_that_are_no_pairs_are_refused():
    with pytest.raises(InvalidTask, match='rod.natural_curvature_terms'):
        Scene.of(parameters(**{'rod.natural_curvature_terms': [0.1, 0.2, 0.3]}))


def test_poses_before_the_first_cloud_are_of_the_tool_frame(rng):
    tool = Pose.looking_along((0.0, 0.1, 0.02), (1.0, 0.3, 0.2))
    scene = replace(Scene.of(parameters(**COPPER)), tool=tool)
    there = START.compose(tool.inverse())
    out = observing_of(scene, [(0.0, there), (10.0, there)], None)
    looked(out, Truth.drawn(rng), rng, looks=1)
    assert out.off < 3e-3
    certain = replace(scene, seeing=EstimatorConfig(Uncertainty()))
    assert observing_of(certain, [], None) is None


def test_nothing_uncertain_is_refused():
    with pytest.raises(InvalidTask, match='uncertainty'):
        DloEstimator(DirectSimulator(replace(WIRE)), EstimatorConfig())
    assert isinstance(WIRE, Rod)


@pytest.mark.parametrize('changes', [{'noise': 5e-3}, {'sway': 0.02}, {'cutout': 5e-3}])
def test_whatever_the_camera_may_be_off_makes_the_expected_miss_larger(changes):
    plan, bounds = plan_of(depths=DEPTHS), []
    for seeing in (SEEING, replace(SEEING, **changes)):
        rng = np.random.default_rng(7)
        out = observing(seeing=seeing)
        looked(out, Truth.drawn(rng), rng, looks=3)
        bounds.append(out.estimate.miss(plan, [len(plan) - 1]).bound[0])
    assert bounds[1] > 1.02 * bounds[0]


def test_bias_and_cutout_are_uncertain_as_stated():
    deviations = observing(seeing=replace(SEEING, bias=4e-3, cutout=3e-3)).estimate.deviations
    assert [deviations[f'{name}[{k}]'] for name in ('camera', 'cutout') for k in range(3)] == (
        [pytest.approx(4e-3)] * 3 + [pytest.approx(3e-3)] * 3)


def test_the_robot_errs_as_stated():
    robot = observing(seeing=replace(SEEING, robot_position=2e-4, robot_rotation=7e-4,
                                     robot_way=0.3, robot_time=5.0)).estimate.robot
    assert robot.deviations.tolist() == [7e-4] * 3 + [2e-4] * 3
    assert (robot.way, robot.time) == (0.3, 5.0)


def test_a_cutout_that_is_seen_is_where_it_is_seen_and_no_farther_than_it_may_be():
    out = observing(seeing=replace(SEEING, cutout=2e-3, bias=1e-3))
    stated, off = np.array([0.4, 0.0, 1.0]), np.array([1e-3, -2e-3, 5e-4])
    for _ in range(50):
        out.hole(stated, stated + off)
    hole = CutOut(Pose.looking_along(stated, (1, 0, 0)), radius=5e-3)
    moved = out.estimate.moved_cutout(hole).center - stated
    np.testing.assert_allclose(moved + out.estimate.camera_bias, off, rtol=0.01)
    before = out.estimate
    far = 6 * np.sqrt(2e-3**2 + 1e-3**2 + NOISE**2)
    with pytest.raises(InvalidTask, match=r'from where it is stated: expected 0\.0147 m at most'):
        out.hole(stated, stated + (0, 0, 1.01 * far))
    assert out.estimate is before
    first = observing(seeing=out.seeing)
    first.hole(stated, stated + (0, 0, 0.99 * far))
    assert first.estimate.center(stated)[2] > stated[2] + 0.5 * far
    known = observing()
    before = known.estimate
    known.hole(stated, stated + off)  # nothing of it is uncertain
    assert known.estimate is before


@pytest.mark.parametrize(('far', 'looks'), [(6e-3, 2), (3e-3, 8)])  # noise of a look: 1 mm
def test_a_cutout_that_moves_is_a_doubt_and_is_followed_once_that_is_looked_into(far, looks):
    out = observing(seeing=replace(SEEING, cutout=5e-4, bias=1e-3))
    stated, moved = np.array([0.4, 0.0, 1.0]), np.array([0.0, far, 0.0])
    for _ in range(20):
        out.hole(stated, stated)
    out.hole(stated, stated + moved)
    assert not out.inconsistent  # one is left to chance
    for _ in range(looks - 1):
        out.hole(stated, stated + moved)
    assert out.inconsistent
    out.inflate_covariance()
    assert not out.inconsistent
    for _ in range(20):
        out.hole(stated, stated + moved)
    assert not out.inconsistent
    center = out.estimate.center(stated) + out.estimate.camera_bias
    np.testing.assert_allclose(center, stated + moved, atol=2e-4)


def test_of_a_dlo_that_is_grasped_inside_the_front_is_estimated(rng):
    scene = Scene.of(parameters(**COPPER, **{'rod.grasped_at': 0.4,
                                             'spread.bending_stiffness': 0.1}))
    made = observing_of(scene, [], None)
    assert made.estimate.rod.length == pytest.approx(0.6)
    shape = scene.grasped.solve(START)
    s = np.sort(rng.uniform(0, 1, 60))
    points = shape.positions_at(s) + 1e-3 * rng.normal(size=(60, 3))
    kept = in_front(shape, points)
    np.testing.assert_array_equal(kept, points[len(points) - len(kept):])
    assert abs(s[len(points) - len(kept)] - 0.4) < 0.03  # in their order: the rest is behind
    assert in_front(None, points) is points
    assert in_front(scene.direct.solve(START), points) is points


def test_what_knows_of_no_contact_with_itself_is_refused():
    Scene.of(parameters(**COPPER)).refuse_self_contact('a plan')
    scene = Scene.of(parameters(**COPPER, **{'simulator.self_contact': True}))
    assert scene.direct.surroundings.self_contact
    with pytest.raises(Refused, match=r'simulator\.self_contact = True: expected False for a plan'):
        scene.refuse_self_contact('a plan')
