# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates of a DLO from looks at it: derivatives, honesty, robustness."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import HOLE, NOISE, SPREAD, START, WIRE, Truth, looked, plan_of, surprise
from scipy.spatial.transform import Rotation, Slerp

from dlo_planner import (
    CutOut,
    DirectSimulator,
    InvalidTask,
    InverseSimulator,
    Observer,
    PointLoad,
    Pose,
    Rod,
    Uncertainty,
)
from dlo_planner.identify import Estimate, Observation, gripper_at
from dlo_planner.identify.estimate import PredictedMiss, bound_of
from dlo_planner.identify.smoother import Consistency
from dlo_planner.penalties import Through

CURLY = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2), tip_mass=0.01,
            point_masses=((0.6, 0.01),), natural_twist=0.3)
WIDE = replace(SPREAD, natural_curvature=0.3, curvature_variation=0.2, gripper_rotation=0.05,
               mass_gradient=0.1)
OBSERVER = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE)
PLAN = plan_of()


def test_a_node_at_the_end_stays_on_a_shorter_dlo():
    plain, ended = (Observer(DirectSimulator(replace(CURLY, nodes=nodes), n_elements=32), WIDE)
                    for nodes in ((), (1.0,)))  # every mesh has a node there
    z = np.zeros(plain.uncertain.size)
    z[plain.uncertain.columns('length')[0]] = -0.005
    assert ended.uncertain.rod(z).nodes == (0.995,)
    one, other = (observer.uncertain.mesh(observer.uncertain.simulator.mesh).by_length
                  for observer in (plain, ended))
    for name, slope in one.items():
        np.testing.assert_allclose(other[name], slope, atol=1e-9)


@pytest.mark.parametrize('options', [{'n_elements': 64}, {'basis': 'local', 'n_elements': 48}])
def test_slopes_against_shapes_of_other_rods(options, rng):
    # the other side is the simulator of the Rod that the state stands for, nothing of the observer
    uncertain = Observer(DirectSimulator(CURLY, **options), WIDE, bias=1e-3).uncertain
    z = 0.5 * uncertain.deviations * rng.normal(size=uncertain.size)
    mesh = uncertain.simulator.mesh

    def nodes(z):
        simulator = DirectSimulator(uncertain.rod(z), **options)
        return simulator.solve(START.compose(uncertain.offset(z))).positions

    shape = uncertain.equilibrium(z, mesh, START.compose(uncertain.offset(z)))
    np.testing.assert_allclose(shape.positions, nodes(z), atol=2e-6)
    slopes = uncertain.slopes(z, shape)(shape.s)
    for k, (name, unit) in enumerate(zip(uncertain.names, uncertain.deviations, strict=True)):
        if name.startswith('camera'):
            assert not slopes[:, :, k].any()
            continue
        step = 1e-3 * unit * np.eye(z.size)[k]
        differences = (nodes(z + step) - nodes(z - step)) / (2e-3 * unit)
        # a series cannot tell all that a natural curvature does
        small = 3e-6 + 1e-4 * np.abs(differences * unit).max()
        np.testing.assert_allclose(slopes[:, :, k] * unit, differences * unit, rtol=0, atol=small,
                                   err_msg=name)


def test_the_estimate_is_as_good_as_it_says():
    # chi-square of 2 per seed: the mean of 8 is between 0.86 and 3.6 with 95 %, 0.4 and 5 at most
    surprises = []
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        truth = Truth.drawn(rng)
        estimate = looked(truth, OBSERVER, rng, START, 6)
        assert estimate.converged
        assert estimate.looks == 6
        off = truth.miss(PLAN.via_points[0][0], PLAN.grippers[0])
        surprises.append(surprise(off, estimate.miss(PLAN, [0])))
    assert 0.4 < np.mean(surprises) < 5


def test_looks_make_it_surer_and_the_order_of_points_does_not_matter(rng):
    truth = Truth.drawn(rng)
    seen = [truth.seen(rng, START) for _ in range(3)]
    one = two = OBSERVER.begin()
    before = np.trace(one.miss(PLAN, [0]).covariance[0])
    for look in seen:
        one = OBSERVER.update(one, look)
        two = OBSERVER.update(two, Observation(START, look.points[::-1]))
        after = np.trace(one.miss(PLAN, [0]).covariance[0])
        assert after < before
        before = after
    np.testing.assert_allclose(one.mean, two.mean, atol=1e-3 * OBSERVER.uncertain.deviations.min())


def test_arc_lengths_from_either_end(rng):
    truth = Truth.drawn(rng)
    look = truth.seen(rng, START, known=True, outliers=0.0)
    there = OBSERVER.update(OBSERVER.begin(), look)
    back = OBSERVER.update(OBSERVER.begin(), replace(look, s=np.clip(1 - look.s, 0, None)))
    assert there.converged
    assert back.converged
    # the length is uncertain by 1 mm, and so is what is counted from the far end
    assert np.linalg.norm(there.miss(PLAN, [0]).off - back.miss(PLAN, [0]).off) < 5e-3


@pytest.mark.every(2)
@pytest.mark.parametrize('outliers', [0.1, 0.3])
def test_outliers_are_told_apart(outliers):
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, outliers=outliers)
    off = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        truth = Truth.drawn(rng)
        estimate = looked(truth, observer, rng, START, 4, outliers=outliers)
        assert estimate.converged
        assert estimate.misfit < 2 * NOISE  # of two components, sqrt(2) expected
        off.append(surprise(truth.miss(PLAN.via_points[0][0], PLAN.grippers[0]),
                            estimate.miss(PLAN, [0])))
    assert np.mean(off) < 8


def test_a_look_that_is_none_leaves_the_estimate(rng):
    truth = Truth.drawn(rng)
    estimate = looked(truth, OBSERVER, rng, START, 3)
    wild = OBSERVER.update(estimate, Observation(START, rng.uniform(2, 3, size=(20, 3))))
    off = [one.miss(PLAN, [0]).off for one in (estimate, wild)]
    assert np.linalg.norm(off[0] - off[1]) < 1e-3
    if not wild.converged:
        assert wild == replace(estimate, converged=False)


def test_a_sway_is_another_one_in_each_look(rng):
    steady = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE)
    swaying = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, sway=5e-3)
    truth = Truth.drawn(rng)
    shape = truth.shape(START)
    estimates = [steady.begin(), swaying.begin()]
    for _ in range(6):
        look = truth.seen(rng, START, shape=shape, outliers=0.0)
        s = np.linalg.norm(look.points - START.position, axis=1)  # about
        moved = look.points + s[:, None] ** 2 * 5e-3 * rng.normal(size=3)
        estimates = [one.update(known, Observation(START, moved)) for one, known in zip(
            (steady, swaying), estimates, strict=True)]
    off = truth.miss(PLAN.via_points[0][0], PLAN.grippers[0])
    one, two = (surprise(off, estimate.miss(PLAN, [0])) for estimate in estimates)
    assert two < 12
    assert two < one  # who does not know of it is too sure


def test_a_sway_as_stated_agrees(rng):
    truth = Truth.drawn(rng)
    estimate = looked(truth, OBSERVER, rng, START, 8)
    look = truth.seen(rng, START, outliers=0.0, known=True)
    swayed = Observation(START, look.points + (look.s[:, None] / WIRE.length) ** 2 * (0, 8e-3, 0))
    assert not OBSERVER.update(estimate, swayed).agrees
    assert OBSERVER.update(estimate, swayed, sway=5e-3).agrees


def test_a_cutout_seen_by_the_same_camera(rng):
    # 3 mm of bias move all that is seen: where the cut-out is seen too, the miss does not notice
    observer = Observer(DirectSimulator(WIRE), Uncertainty(natural_curvature=0.05), noise=NOISE,
                        bias=3e-3, cutout=3e-3)
    truth = Truth.drawn(rng, spread=Uncertainty(natural_curvature=0.05), bias=3e-3, cutout=3e-3)
    gripper = PLAN.grippers[0]
    before = looked(truth, observer, rng, gripper, 4)
    after = observer.see_cutout(before, HOLE.center, HOLE.center + truth.hole + truth.bias, 1e-4)
    first, last = (one.miss(PLAN, [0]) for one in (before, after))
    assert last.bound[0] - last.distance[0] < 0.6 * (first.bound[0] - first.distance[0])
    off = truth.miss(PLAN.via_points[0][0], gripper)
    assert np.linalg.norm(off - last.off[0]) < 1.5e-3
    assert surprise(off, last) < 12
    again = observer.update(after, truth.seen(rng, gripper))
    assert np.linalg.norm(again.miss(PLAN, [0]).off[0] - off) < 1.5e-3


ROBOT = {'robot_position': 0.35e-3, 'robot_rotation': 1.25e-3, 'robot_time': 1.0}


def on_the_way(seed, factor=1.0, slip=None, count=16, step=0.5):
    """Return the Estimates after looks at a DLO whose robot errs, by `factor` of what is stated.

    From half way on it has slipped in the gripper by a rotation vector.
    """
    rng = np.random.default_rng(seed)
    truth = Truth.drawn(rng)
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, sway=5e-4, **ROBOT)
    sizes = factor * np.repeat([ROBOT['robot_rotation'], ROBOT['robot_position']], 3)
    found, link = [observer.begin()], np.exp(-step)
    error = sizes * rng.normal(size=6)
    for k in range(count):
        gripper = Pose(START.position + (0.02 * k, 0, 0), START.quaternion)
        true = truth.offset.compose(Pose(error[3:], Rotation.from_rotvec(error[:3]).as_quat()))
        if slip is not None and k >= count // 2:
            true = true.compose(Pose((0, 0, 0), Rotation.from_rotvec(slip).as_quat()))
        shape = truth.simulator.solve(gripper.compose(true))
        found.append(observer.update(found[-1], truth.seen(rng, gripper, shape=shape, begin=0.3),
                                     elapsed=step))
        error = link * error + np.sqrt(1 - link**2) * sizes * rng.normal(size=6)
    return found[1:]


def test_looks_that_are_as_expected_agree():
    looks = [look for seed in range(2) for look in on_the_way(seed)]
    assert all(look.agrees for look in looks)
    assert np.median([look.normalized_innovation for look in looks]) > 0.2  # it is looked at
    assert max(look.inflation for look in looks) < 1.1


def test_a_slip_is_seen_at_once():
    looks = on_the_way(0, slip=(0, np.radians(1), 0))
    assert all(look.agrees for look in looks[:8])
    assert not looks[8].agrees
    assert looks[8].normalized_innovation > 3


def test_a_light_touch_that_grows_slowly_is_seen_in_many_looks_together(rng):
    truth = Truth.drawn(rng)
    estimate = looked(truth, OBSERVER, rng, START, 12, begin=0.1)
    rod = truth.simulator.rod
    for k in range(1, 49):  # 1.4 mm at the end after 43 looks, each of which tells it to 1 mm
        touched = replace(truth, simulator=DirectSimulator(rod, point_loads=[
            PointLoad((0.0, 0.0, 6e-6 * k), s=0.8 * rod.length)]))
        estimate = OBSERVER.update(estimate, touched.seen(rng, START, begin=0.1))
        if not estimate.agrees:
            break
    assert estimate.converged and estimate.normalized_innovation > 1
    assert estimate.inflation > 1.3  # the bound grows before


def test_a_robot_that_errs_more_than_stated_makes_the_bound_larger():
    look = on_the_way(0, factor=3.0)[-1]
    assert look.inflation > 1.2
    calm = replace(look, _memory=None)
    assert calm.inflation == 1
    assert look.miss(PLAN, [0]).covariance[0] == pytest.approx(
        look.inflation * calm.miss(PLAN, [0]).covariance[0])


@pytest.mark.parametrize('which', [0, 2])
def test_what_moves_the_state_and_what_does_not_fit_count_each_by_itself(which):
    chi_squares = np.zeros(5)
    chi_squares[which:which + 2] = 200.0
    assert Consistency().after(*chi_squares).inflation == 1
    chi_squares[which] *= 4  # errors twice as large as stated: some of it is left to chance
    assert 3 < Consistency().after(*chi_squares).inflation < 4


def test_points_that_do_not_fit_are_no_news_of_the_dlo(rng):
    truth = Truth.drawn(rng)
    estimate = looked(truth, OBSERVER, rng, START, 5)
    look = truth.seen(rng, START, outliers=0)
    most = look.points.copy()
    most[6:] += (0, 0.1, 0.1)
    assert not OBSERVER.update(estimate, Observation(START, most)).agrees
    rough = look.points + 4 * NOISE * rng.normal(size=look.points.shape)
    assert not OBSERVER.update(estimate, Observation(START, rough)).agrees


def test_the_robot_errs_anew_in_the_miss(rng):
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, **ROBOT)
    sure = replace(observer.begin(), covariance=np.zeros_like(observer.begin().covariance))
    miss = sure.miss(PLAN, [0])
    found = miss.covariance[0]
    gripper, (center, s, _) = PLAN.grippers[0], PLAN.via_points[0][0]
    expected = np.zeros((3, 3))
    for k in range(6):  # by shapes whose gripper is elsewhere
        size = ROBOT['robot_rotation'] if k < 3 else ROBOT['robot_position']
        twist = 0.1 * size * np.eye(6)[k]
        moved = [Through(center, s - 0.1).residuals(DirectSimulator(WIRE).solve(gripper.compose(
            Pose(sign * twist[3:], Rotation.from_rotvec(sign * twist[:3]).as_quat()))))
            for sign in (1, -1)]
        slope = (moved[0] - moved[1]) / 0.2
        expected += np.outer(slope, slope)
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())
    drawn = rng.multivariate_normal(miss.off[0], expected, 100_000)
    assert miss.bound[0] == pytest.approx(np.quantile(np.linalg.norm(drawn, axis=1), 0.95),
                                          rel=0.02)


def test_the_robots_error_is_forgotten_with_time(rng):
    # what one look says of the gripper holds for the next one at once, and for none much later
    observer = Observer(DirectSimulator(WIRE), Uncertainty(mass=1e-6), noise=NOISE,
                        robot_position=2e-3, robot_time=1.0)
    truth = Truth(DirectSimulator(WIRE), Pose((0, 2e-3, 0), (0, 0, 0, 1)), np.zeros(3), np.zeros(3))
    seen = truth.seen(rng, START, outliers=0)
    aside = Observation(START, seen.points - 2 * truth.offset.position)
    first = observer.update(observer.begin(), seen)
    at_once, later = (observer.update(first, aside, elapsed=elapsed) for elapsed in (0.01, 20.0))
    assert not at_once.agrees
    assert later.agrees


def test_a_slip_is_found_where_the_gripper_is_open_again(rng):
    truth = Truth.drawn(rng)
    estimate = looked(truth, OBSERVER, rng, START, 8)
    slipped = replace(truth, offset=truth.offset.compose(
        Pose((0, 0, 0), Rotation.from_rotvec((0, np.radians(2), 0)).as_quat())))
    assert not OBSERVER.update(estimate, slipped.seen(rng, START)).agrees
    again = looked(slipped, OBSERVER, rng, START, 8, OBSERVER.reopened(estimate, 2e-3, 0.03))
    assert again.agrees
    off = slipped.miss(PLAN.via_points[0][0], PLAN.grippers[0])
    assert np.linalg.norm(off - again.miss(PLAN, [0]).off[0]) < 2e-3


def test_looks_that_hardly_agreed_count_where_the_gripper_is_open_again(rng):
    observer = Observer(DirectSimulator(WIRE), SPREAD, noise=0.6 * NOISE)  # it is told too little
    truth, estimate = Truth.drawn(rng), observer.begin()
    shape = truth.shape(START)
    for _ in range(8):
        estimate = observer.update(estimate, truth.seen(rng, START, outliers=0, shape=shape))
    assert estimate.inflation > 1.05
    again = observer.reopened(estimate, 2e-3, 0.03)
    assert again.inflation == estimate.inflation
    assert np.allclose(again.mean, estimate.mean)
    kept = [k for k, name in enumerate(again.names) if not name.startswith('gripper')]
    assert np.allclose(again.covariance[np.ix_(kept, kept)], estimate.covariance[
        np.ix_(kept, kept)], rtol=1e-6, atol=0)


def test_noise_and_sway_of_one_look(rng):
    look = Truth.drawn(rng).seen(rng, START)
    one = OBSERVER.update(OBSERVER.begin(), look, noise=3 * NOISE, sway=2e-3)
    stated = Observer(DirectSimulator(WIRE), SPREAD, noise=3 * NOISE, sway=2e-3)
    other = stated.update(stated.begin(), look)
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-12)
    np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-15)
    # a very noisy look at the same pose adds next to nothing to a good one
    good = OBSERVER.update(OBSERVER.begin(), look)
    both = OBSERVER.update(good, look, noise=1.0)
    off = both.miss(PLAN, [0]).covariance[0] - good.miss(PLAN, [0]).covariance[0]
    assert np.abs(off).max() < 0.01 * np.trace(good.miss(PLAN, [0]).covariance[0])


@pytest.mark.parametrize(('name', 'turns'), [('_LOOKS', [0.0] * 8), ('_POSES', [0.0, 0.1, 0.2,
                                                                               0.3, 0.4])])
def test_what_is_no_longer_remembered_still_counts(monkeypatch, name, turns):
    rng = np.random.default_rng(1)
    truth = Truth.drawn(rng, spread=replace(SPREAD, natural_curvature=5e-3, bending_stiffness=5e-3,
                                            curvature_variation=3e-3))
    poses = [START.compose(Pose.from_rotation((0, 0, 0), Rotation.from_rotvec(
        (0, turn, 0)).as_matrix())) for turn in turns]
    looks = [truth.seen(rng, pose, outliers=0.0) for pose in poses]
    found = []
    for kept in (100, 2):
        monkeypatch.setattr(f'dlo_planner.identify.smoother.{name}', kept)
        estimate = OBSERVER.begin()
        for look in looks:
            estimate = OBSERVER.update(estimate, look)
            assert estimate.converged
        found.append(estimate)
    whole, folded = (one.miss(PLAN, [0]) for one in found)
    np.testing.assert_allclose(np.trace(folded.covariance[0]), np.trace(whole.covariance[0]),
                               rtol=0.25)  # linearized at other states
    off = found[1].mean - found[0].mean
    assert off @ np.linalg.solve(found[0].covariance, off) < 0.7**2


def test_the_bound_of_a_normal_distribution():
    one = np.diag([1.0, 1.0])
    assert bound_of(np.zeros(2), 4 * one) == pytest.approx(2 * np.sqrt(-2 * np.log(0.05)), rel=5e-3)
    # far off the center only the direction of the miss counts: 1.645 standard deviations
    assert bound_of(np.array([0.0, 50.0]), one) == pytest.approx(51.655, abs=0.05)
    assert bound_of(np.zeros(2), np.diag([1.0, 0.0])) == pytest.approx(1.960, rel=0.01)
    assert bound_of(np.array([3.0, 4.0]), 0 * one) == pytest.approx(5.0)


@pytest.mark.parametrize('off', [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.9, -0.7, 0.0)])
@pytest.mark.parametrize('deviations', [(1.0, 1.0, 0.0), (1.0, 0.4, 0.0), (0.2, 0.0, 0.0)])
def test_a_bound_does_not_hang_on_the_axes(rng, off, deviations):
    off, covariance = np.array(off), np.diag(np.square(deviations))
    for _ in range(8):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.choice([-1.0, 1.0], size=3)
        assert bound_of(axes @ off, axes @ covariance @ axes.T) == pytest.approx(
            bound_of(off, covariance), rel=1e-6)


def test_the_covariance_of_a_miss_against_other_states(rng):
    uncertain = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, cutout=3e-3).uncertain
    z = uncertain.deviations * rng.normal(size=uncertain.size)
    # of one state each, and of all together, where their signs count
    for way in (*np.eye(uncertain.size)[rng.integers(uncertain.size, size=3)],
                *rng.normal(size=(2, uncertain.size))):
        step = 1e-2 * uncertain.deviations * way
        off, back, ahead = (Estimate(uncertain, z + d * step, np.outer(step, step)).miss(PLAN, [3])
                            for d in (0, -1, 1))
        tangent = Estimate(uncertain, z, np.outer(step, step)).shape(PLAN.grippers[3]).at(
            PLAN.via_points[3][0][1]).direction
        known = 0.5 * (ahead.off[0] - back.off[0])
        known -= tangent * (tangent @ known)  # elsewhere along itself it is the same miss
        np.testing.assert_allclose(off.covariance[0], np.outer(known, known),
                                   atol=0.02 * known @ known)
        assert np.abs(tangent @ off.covariance[0]).max() < 1e-3 * known @ known


def test_of_two_centers_both_count(rng):
    two = CutOut(Pose.looking_along((0.7, 0.06, 1), (1, 0.2, 0)), radius=0.05)
    plan = InverseSimulator(DirectSimulator(WIRE)).thread_two(HOLE, two)
    index = next(k for k, passes in enumerate(plan.via_points) if len(passes) == 2)
    estimate = OBSERVER.begin()
    single = [estimate.miss(replace(plan, via_points=tuple(
        passes[which:which + 1] for passes in plan.via_points)), [index]) for which in (0, 1)]
    both = estimate.miss(plan, [index])
    np.testing.assert_array_equal(both.waypoints, [index, index])
    for name in ('off', 'bound', 'covariance'):
        np.testing.assert_allclose(getattr(both, name), np.concatenate(
            [getattr(one, name) for one in single]), rtol=1e-12)
    assert both.together > max(one.together for one in single)
    places = Observer(DirectSimulator(WIRE), Uncertainty(mass=1e-9), noise=NOISE, cutout=1e-3)
    apart = places.begin().miss(plan, [index])  # each is elsewhere by itself
    np.testing.assert_allclose(apart.joint[:3, 3:], 0.0, atol=1e-12)
    assert np.diag(apart.joint).sum() == pytest.approx(4e-6, rel=1e-3)
    # of one number that is not known, both misses are the same number times their slopes
    uncertain = OBSERVER.uncertain
    step = 1e-2 * uncertain.deviations * rng.normal(size=uncertain.size)
    off, ahead, back = (Estimate(uncertain, d * step, np.outer(step, step)).miss(plan, [index])
                        for d in (0, 1, -1))
    known = 0.5 * (ahead.off - back.off)
    shape = plan.shapes[index]
    for k, (_, s, _) in enumerate(plan.via_points[index]):
        tangent = shape.at(min(s, 1.0)).direction
        known[k] -= tangent * (tangent @ known[k])  # elsewhere along itself it is the same miss
    np.testing.assert_allclose(off.joint, np.outer(known, known), atol=0.02 * (known**2).sum())


def test_what_is_estimated(rng):
    truth = Truth.drawn(rng)
    estimate = looked(truth, OBSERVER, rng, START, 6)
    shape = estimate.shape(START)
    true = truth.shape(START)
    np.testing.assert_allclose(shape.positions_at([0.5, 0.9]), true.positions_at([0.5, 0.9]),
                               atol=2e-3)
    # the same by the Rod and the offset that it states
    again = estimate.simulator.solve(START.compose(estimate.gripper_offset))
    np.testing.assert_allclose(again.positions_at([0.9]), shape.positions_at([0.9]), atol=1e-5)
    there = estimate.actual(estimate.commanded(START))
    np.testing.assert_allclose(there.matrix, START.matrix, atol=1e-12)
    assert set(estimate.deviations) == set(estimate.values) == set(OBSERVER.uncertain.names)


def test_poses_between_stamps(rng):
    grippers = [Pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(3)]
    stamps = [0.0, 0.1, 0.4]
    slerp = Slerp(stamps, Rotation.from_matrix([one.rotation for one in grippers]))
    for stamp in (0.0, 0.03, 0.1, 0.3, 0.4):
        pose = gripper_at(stamps, grippers, stamp)
        np.testing.assert_allclose(pose.rotation, slerp(stamp).as_matrix(), atol=1e-12)
        np.testing.assert_allclose(pose.position, [np.interp(stamp, stamps, [
            one.position[i] for one in grippers]) for i in range(3)], atol=1e-12)
    with pytest.raises(InvalidTask, match='stamp'):
        gripper_at(stamps, grippers, 0.5)
    with pytest.raises(InvalidTask, match='stamps'):
        gripper_at([0.0, 0.4, 0.1], grippers, 0.2)


@pytest.mark.parametrize(('call', 'named'), [
    (lambda: Observer(WIRE, Uncertainty()), 'uncertainty'),
    (lambda: Observer(WIRE, SPREAD, outliers=1.0), 'outliers'),
    (lambda: OBSERVER.update(Observer(WIRE, Uncertainty(mass=0.1)).begin(),
                             Observation(START, [[0, 0, 1]])), 'estimate'),
    (lambda: OBSERVER.update(OBSERVER.begin(), Observation(START, [[0, 0, 1]], [1.5])),
     'observation'),
    (lambda: OBSERVER.see_cutout(OBSERVER.begin(), (0, 0, 0), (0, 0, 0)), 'cutout'),
    (lambda: OBSERVER.begin().miss(PLAN, [99]), 'waypoints')])
def test_nonsense_is_named(call, named):
    with pytest.raises(InvalidTask, match=named):
        call()


def test_the_bound_of_several_waypoints_together(rng):
    sizes = (1.0, 0.9, 0.4)
    across = np.diag([1.0, 1.0, 0.0])
    miss = PredictedMiss(np.arange(3.0), np.zeros((3, 3)),
                         np.kron(np.diag(np.square(sizes)), across), np.zeros(3))
    drawn = np.linalg.norm(rng.normal(size=(200_000, 3, 2)) * np.array(sizes)[:, None], axis=2)
    assert miss.together == pytest.approx(np.quantile(drawn.max(axis=1), 0.95), rel=0.01)
    assert replace(miss, bound=np.array([1.0, np.inf, 1.0])).together == np.inf
    alike = replace(miss, joint=np.kron(np.outer(sizes, sizes), across))
    assert alike.together == pytest.approx(np.sqrt(-2 * np.log(0.05)), rel=0.02)  # of the first
    aside = replace(miss, off=np.eye(3))
    rounded = replace(aside, joint=miss.joint + 1e-13 * np.cov(rng.normal(size=(9, 30))))
    assert rounded.together == pytest.approx(aside.together, rel=1e-6)


def test_what_was_seen_of_the_robots_error_counts_nearby():
    simulator = DirectSimulator(WIRE)
    observer = Observer(simulator, SPREAD, noise=NOISE, robot_position=0.35e-3,
                        robot_rotation=1.25e-3)
    size = np.repeat((1.25e-3, 0.35e-3), 3)
    error = 2 * size * (1, -1, 1, 1, -1, 1)
    turned = Pose(error[3:], Rotation.from_rotvec(error[:3]).as_quat())
    truth = Truth(simulator, turned, np.zeros(3), np.zeros(3))
    rng, estimate = np.random.default_rng(0), observer.begin()
    assert not estimate.robot_error.any()
    for _ in range(12):
        estimate = observer.update(estimate, truth.seen(rng, START), elapsed=0.1)
    seen = simulator.solve(START.compose(turned)).positions[-1]
    tip = simulator.with_rod(estimate.rod).solve(estimate.actual(START)).positions[-1]
    assert np.linalg.norm(tip - seen) < 1.5e-3
    assert np.linalg.norm(estimate.robot_error / size) > 0.5
    assert estimate.robot_change(START) == 0
    near, far = (START.compose(Pose((moved, 0, 0), (0, 0, 0, 1))) for moved in (0.1, 5.0))
    assert estimate.robot_change(near) == pytest.approx(2 * (1 - np.exp(-0.5 * 0.25**2)))
    assert estimate.robot_change(near, near) == 0
    assert estimate.robot_change(far) == pytest.approx(2.0)
    at_once, later = (estimate.miss(PLAN, [0], [pose]).bound[0] for pose in (
        PLAN.grippers[0], PLAN.grippers[0].compose(Pose((0.3, 0, 0), (0, 0, 0, 1)))))
    assert at_once < later
    with pytest.raises(InvalidTask, match='seen'):
        estimate.miss(PLAN, [0], [START, START])
