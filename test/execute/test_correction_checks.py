# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What speaks against a correction, and against an estimate: without a node."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from closed_loops import DEPTHS, HOLE, NOISE, SPREAD, START, WIRE, Truth, plan_of

from dlo_planner import (
    Box,
    DirectSimulator,
    InverseSimulator,
    Observer,
    Pose,
    Sheet,
    Trajectory,
)
from dlo_planner.execute.correction_checks import (
    expected_miss,
    looked_at,
    misfit_reason,
    miss_bound,
    motion_bound,
    rejection_reason,
    stop_before_entry,
)
from dlo_planner.execute.execution import Execution
from dlo_planner.execute.loop_motions import commanded_of
from dlo_planner.identify import CorrectedTrajectory, correct
from dlo_planner.identify.estimator import DloEstimator, EstimatorConfig
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.parameters import PARAMETERS
from dlo_planner.trajectory.dynamic_check import InMotion
from dlo_planner.trajectory.trajectory import restored
from msg_helpers.obstacles import Body

SEEING = EstimatorConfig(SPREAD, NOISE, bias=0.0, camera_rotation=0.0)  # a camera as stated
LARGEST = 0.05  # m, of a correction
PLAN = plan_of(depths=DEPTHS)


def scene(*obstacles, **changes):
    values = {name: entry.default for name, entry in PARAMETERS.items()} | {
        'rod.diameter': 1.5e-3}
    return Scene.of(values | {name.replace('__', '.'): value for name, value in changes.items()},
                    {('', k): Body(one) for k, one in enumerate(obstacles)})


def looked(points_of, looks=8):
    out = DloEstimator(scene().direct, SEEING)
    for time in (0.0, 10.0):
        out.gripper(time, START)
    for k in range(looks):
        out.look(0.1 + 0.3 * k, points_of())
    return out


@pytest.fixture(scope='module')
def observing():
    rng = np.random.default_rng(4)
    truth = Truth.drawn(rng)
    shape = truth.shape(START)
    return looked(lambda: truth.seen(rng, START, shape=shape).points)


def test_a_dlo_that_hangs_freely_is_explained(observing):
    assert misfit_reason(observing) == ''
    aimed = correct(observing.estimate, PLAN, inverse=scene().inverse)
    assert rejection_reason(aimed, LARGEST) == ''


def test_a_dlo_that_does_not_hang_freely_is_not_explained():
    rng = np.random.default_rng(4)
    shape = Truth.drawn(rng).shape(START)

    def lifted():  # something bears its free half up
        points = shape.positions_at(np.linspace(0, 0.99, 30) * shape.s[-1])
        points[:, 2] = np.maximum(points[:, 2], shape.positions[-1, 2] + 0.2)
        return points + NOISE * rng.normal(size=points.shape)

    observing = looked(lifted)
    said = misfit_reason(observing)
    assert 'none of the DLO as it is estimated: expected at most 30%' in said


def seen(observing, **changes):
    """Return a DloEstimator that has seen something else, see `SimpleNamespace`."""
    return SimpleNamespace(**{name: getattr(observing, name)
                              for name in ('estimate', 'off', 'seeing')} | changes)


@pytest.mark.parametrize(('changes', 'outliers', 'said'), [
    ({'off': 0.26}, 0.1, 'the points are 0.26 m off the DLO as it is estimated'),
    ({}, 0.67, '67% of the points are none of the DLO as it is estimated')])
def test_an_estimate_of_something_else_is_not_explained(observing, changes, outliers, said):
    estimate = replace(observing.estimate, outliers=outliers)
    wrong = seen(observing, estimate=estimate, **changes)
    assert said in misfit_reason(wrong)
    careless = seen(wrong, seeing=replace(SEEING, noise=0.1, outliers=0.8))
    assert misfit_reason(careless) == ''


def test_stamps_excuse_what_the_gripper_moves_meanwhile_and_no_more(observing):
    wrong = seen(observing, off=0.26, seeing=replace(SEEING, stamps=0.05))
    assert 'the points are 0.26 m off' in misfit_reason(wrong)
    assert 'the points are 0.26 m off' in misfit_reason(wrong, 0.1)
    assert misfit_reason(wrong, 6.0) == ''


def test_sway_excuses_five_of_its_deviations_and_no_more(observing):
    little, enough = (seen(observing, off=0.26, seeing=replace(SEEING, sway=sway))
                      for sway in (0.05, 0.053))
    assert 'the points are 0.26 m off' in misfit_reason(little)
    assert misfit_reason(enough) == ''


def test_the_cameras_bias_excuses_points_along_two_axes_and_no_more(observing):
    little, enough = (seen(observing, off=0.26, seeing=replace(SEEING, bias=bias))
                      for bias in (0.036, 0.038))
    assert 'the points are 0.26 m off' in misfit_reason(little)
    assert misfit_reason(enough) == ''


def test_what_the_motion_and_late_commands_displace_is_expected():
    way = Trajectory(PLAN, tolerance=np.inf)
    seen = InMotion(True, 1e-3, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0, 1.0, 0.01, 2e-3)
    way, moved = restored(way.path, way.laws, way.limits, np.inf, seen, np.nan, ''), 3e-3
    for one in (way, CorrectedTrajectory(way, np.array([0.5, 0.5, 0.1]))):
        execution = Execution(one, Pose.identity(), 'world')
        assert motion_bound(execution) == moved
        stalled = replace(execution, stall_displacement=0.01)
        assert motion_bound(stalled) == pytest.approx(moved + 0.02)


def test_a_look_in_motion_with_outliers_and_wrong_stamps_is_explained():
    rng = np.random.default_rng(4)
    truth, out = Truth.drawn(rng), DloEstimator(scene().direct, replace(SEEING, stamps=0.06))
    shape = truth.shape(START)
    for time in np.linspace(0, 2, 101):
        out.gripper(time, Pose(START.position + (0.1 * (time - 1.0), 0, 0), START.quaternion))
    out.look(1.0, truth.seen(rng, START, outliers=0.4, shape=shape).points)
    assert out.normalized_innovation < 1
    assert misfit_reason(out, 0.1) == ''


def test_a_correction_keeps_workspace_and_obstacles(observing):
    estimate = observing.estimate
    correction = correct(estimate, PLAN)

    def said(inverse):
        return rejection_reason(correct(estimate, PLAN, inverse=inverse), LARGEST)

    first = correction.grippers[0].position
    low = scene(workspace__upper=[*(first[:2] + 1), float(first[2]) - 1e-3])
    assert 'waypoint 0: the gripper is' in said(low.inverse)
    assert 'beyond workspace.upper.z' in said(low.inverse)
    tip = correction.shapes[-1].positions[-1]
    filled = scene(Box(Pose(tip, (0, 0, 0, 1)), (0.02, 0.02, 0.02)))
    assert 'm in marker 0' in said(filled.inverse)
    far = replace(correction, offsets=correction.offsets + 0.1)
    assert 'observe.largest_correction = 0.05 m' in rejection_reason(far, LARGEST)
    lost = replace(correction, converged=False)
    assert 'no stable shape' in rejection_reason(lost, LARGEST)
    assert said(InverseSimulator(scene().direct)) == ''  # no workspace
    # the best aim is taken though it is not sure: of what the poses were before is known still less
    unsure = replace(correction, miss=replace(correction.miss, bound=10 + correction.miss.bound))
    assert rejection_reason(unsure, LARGEST) == ''


def test_the_way_in_is_not_corrected_for_a_cutout_that_was_seen_before_it_was_planned():
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, cutout=3e-3)
    estimate = observer.see_cutout(observer.begin(), HOLE.center, HOLE.center + (0, 2e-3, -1e-3),
                                   1e-5)
    inverse = InverseSimulator(DirectSimulator(WIRE, obstacles=[Sheet.around(HOLE)]))
    plan = inverse.thread(estimate.moved_cutout(HOLE), depths=DEPTHS[:4])
    correction = correct(estimate, commanded_of(plan, estimate), inverse=inverse)
    np.testing.assert_allclose(correction.offsets, 0.0, atol=1e-6)
    assert correction.violation == '' and correction.miss.distance.max() < 1e-6


def test_it_stops_before_a_cutout_that_it_may_miss(observing):
    way = Trajectory(PLAN, tolerance=np.inf)
    entry = CorrectedTrajectory.of(way, PLAN.shapes[-1]).reached(PLAN.times)[looked_at(PLAN)[0]]
    motion = Execution(way, Pose.identity(), 'world', done=entry - 2.0)
    unsure, sure = (expected_miss(one.estimate, PLAN, motion) for one in (
        DloEstimator(scene().direct, SEEING), observing))
    assert unsure[1] == sure[1] == pytest.approx(2.0)
    chosen = looked_at(PLAN)
    at_rest = observing.estimate.miss(PLAN, chosen, [motion.way.poses([motion.free])[0]] * len(
        chosen)).together
    assert sure[0] == pytest.approx(at_rest, rel=1e-6) and sure[0] < 0.9 * unsure[0]
    shaken = expected_miss(observing.estimate, PLAN, replace(motion, stall_displacement=0.01))[0]
    assert shaken == pytest.approx(sure[0] + 0.02)
    room = 0.95 * unsure[0]
    said = stop_before_entry(unsure[0], room, 2.0)
    assert 'may miss the cut-out by' in said and f'the room of {room:.3g} m' in said
    assert stop_before_entry(sure[0], room, 2.0) == ''
    for left in (3.1, 0.0, -2.0):  # there is time left, or it is too late
        assert stop_before_entry(unsure[0], room, left) == ''


def test_what_is_not_blended_in_at_the_entry_counts(observing):
    estimate, way = observing.estimate, Trajectory(PLAN, tolerance=np.inf)
    windows = np.array([0.5, 0.5, 0.1])
    found = correct(estimate, PLAN)
    motion = CorrectedTrajectory(way, windows)
    reached = motion.reached(PLAN.times)
    entry = reached[looked_at(PLAN)[0]]

    def bound(way, plan=PLAN):
        return miss_bound(estimate, plan, way, reached, entry - 3.0, 1.0)

    # aimed at, with looks on the way there, a second and half the windows before
    chosen = looked_at(PLAN)
    aimed = estimate.miss(replace(PLAN, grippers=found.grippers), chosen, motion.poses(
        np.maximum(reached[chosen] - 1.55, entry - 3.0))).together
    assert aimed < found.miss.together  # without
    assert bound(motion) > 1.5 * aimed
    bounds = [bound(motion.corrected(entry - early, found, reached))
              for early in (2.0, 0.7, 0.5, -0.1)]
    assert bounds[0] == pytest.approx(aimed, rel=0.02)
    assert all(one <= other * 1.01 for one, other in itertools.pairwise(bounds))
    assert bounds[-1] > 1.3 * bounds[0]
    free = replace(PLAN, via_points=((),) * len(PLAN))
    assert bound(motion, free) == 0.0


def test_some_of_what_passes_is_looked_at():
    assert list(looked_at(PLAN)) == [0, 3, 6, 9, 12]
    late = replace(PLAN, via_points=((),) * 10 + PLAN.via_points[10:])
    assert list(looked_at(late)) == [10, 11, 12]
