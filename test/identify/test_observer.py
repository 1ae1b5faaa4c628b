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
    Estimate,
    InvalidTask,
    InverseSimulator,
    Observation,
    Observer,
    Pose,
    Rod,
    Uncertainty,
    gripper_at,
)
from dlo_planner.identify.predicted_miss import _bound
from dlo_planner.identify.response import node_slopes
from dlo_planner.identify.settling import settled

CURLY = Rod(1.0, 0.05, (0.3, 0.6), 0.25, natural_curvature=(0.4, 0.2), tip_mass=0.01,
            point_masses=((0.6, 0.01),), natural_twist=0.3)
WIDE = replace(SPREAD, natural_curvature=0.3, curvature_variation=0.2, gripper_rotation=0.05)
OBSERVER = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE)
PLAN = plan_of()


def test_a_node_at_the_end_stays_on_a_shorter_dlo():
    plain, ended = (Observer(DirectSimulator(replace(CURLY, nodes=nodes), n_elements=32), WIDE)
                    for nodes in ((), (1.0,)))  # every mesh has a node there
    z = np.zeros(plain.uncertain.size)
    z[plain.uncertain.columns('length')[0]] = -0.005
    assert ended.uncertain.rod(z).nodes == (0.995,)
    one, other = (observer.uncertain.varied(observer.uncertain.simulator.mesh).by_length
                  for observer in (plain, ended))
    for name, slope in one.items():
        np.testing.assert_allclose(other[name], slope, atol=1e-9)


@pytest.mark.parametrize('options', [{'n_elements': 64}, {'basis': 'local', 'n_elements': 48}])
def test_slopes_against_shapes_of_other_rods(options, rng):
    # the other side is the simulator of the Rod that the state stands for, nothing of the observer
    uncertain = Observer(DirectSimulator(CURLY, **options), WIDE, bias=1e-3).uncertain
    z = 0.5 * uncertain.deviations * rng.normal(size=uncertain.size)
    varied = uncertain.varied(uncertain.simulator.mesh)

    def nodes(z):
        simulator = DirectSimulator(uncertain.rod(z), **options)
        return simulator.solve(START.compose(uncertain.offset(z))).positions

    shape = settled(varied, z, START.compose(uncertain.offset(z)))
    np.testing.assert_allclose(shape.positions, nodes(z), atol=2e-6)
    slopes = node_slopes(varied, z, shape)
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


def test_drift_forgets(rng):
    wandering = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, drift=0.1)
    look = Truth.drawn(rng).seen(rng, START)
    estimate = wandering.update(wandering.begin(), look)
    later = wandering.update(estimate, look, elapsed=100.0)
    assert np.linalg.norm(later.covariance) > np.linalg.norm(
        wandering.update(estimate, look).covariance)


def test_what_wanders_by_the_square_root_of_time(rng):
    look = Truth.drawn(rng).seen(rng, START)
    found = []
    for drift, elapsed in ((0.1, 100.0), (0.2, 25.0)):
        observer = Observer(DirectSimulator(WIRE), SPREAD, noise=NOISE, drift=drift)
        found.append(observer.update(observer.update(observer.begin(), look), look,
                                     elapsed=elapsed))
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-9, atol=1e-15)


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
        monkeypatch.setattr(f'dlo_planner.identify.memory.{name}', kept)
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
    assert _bound(np.zeros(2), 4 * one) == pytest.approx(2 * np.sqrt(-2 * np.log(0.05)), rel=5e-3)
    # far off the center only the direction of the miss counts: 1.645 standard deviations
    assert _bound(np.array([0.0, 50.0]), one) == pytest.approx(51.655, abs=0.05)
    assert _bound(np.zeros(2), np.diag([1.0, 0.0])) == pytest.approx(1.960, rel=0.01)
    assert _bound(np.array([3.0, 4.0]), 0 * one) == pytest.approx(5.0)


def test_the_covariance_of_a_miss_against_other_states(rng):
    uncertain = OBSERVER.uncertain
    z = uncertain.deviations * rng.normal(size=uncertain.size)
    for k in rng.integers(uncertain.size, size=4):
        step = 1e-2 * uncertain.deviations[k] * np.eye(uncertain.size)[k]
        off, back, ahead = (Estimate(uncertain, z + d * step, np.outer(step, step)).miss(PLAN, [3])
                            for d in (0, -1, 1))
        known = 0.5 * (ahead.off[0] - back.off[0])
        np.testing.assert_allclose(off.covariance[0], np.outer(known, known),
                                   atol=0.02 * known @ known)
        assert np.abs(HOLE.normal @ off.covariance[0]).max() < 1e-6 * known @ known


def test_of_two_centers_the_worse_one_counts():
    two = CutOut(Pose.looking_along((0.7, 0.06, 1), (1, 0.2, 0)), radius=0.05)
    plan = InverseSimulator(DirectSimulator(WIRE)).thread_two(HOLE, two)
    index = next(k for k, passes in enumerate(plan.via_points) if len(passes) == 2)
    estimate = OBSERVER.begin()
    single = [estimate.miss(replace(plan, via_points=tuple(
        passes[which:which + 1] for passes in plan.via_points)), [index]) for which in (0, 1)]
    both = estimate.miss(plan, [index])
    assert single[0].bound[0] != pytest.approx(single[1].bound[0], rel=0.05)
    assert both == max(single, key=lambda one: one.bound[0])


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
