# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points that a tracker carried along are told from those that it saw."""

import numpy as np
import pytest
from closed_loops import NOISE, SPREAD, START, WIRE
from scipy.spatial.transform import Rotation

from dlo_planner import DirectSimulator, Pose
from dlo_planner.identify.carried import carried
from dlo_planner.identify.estimator import DloEstimator, EstimatorConfig

S = np.linspace(0.02, 1.0, 30)


def moved(points, rng):
    """Return points moved by a small rigid motion."""
    turn = Rotation.from_rotvec(0.02 * rng.normal(size=3)).as_matrix()
    return points @ turn.T + 0.01 * rng.normal(size=3)


@pytest.mark.parametrize('hidden', [S > 0.66, S < 0.3, (S > 0.4) & (S < 0.7), S > 0.3])
@pytest.mark.parametrize('noise', [3e-3, 1e-4])
def test_what_moved_as_one_body_is_carried_and_nothing_else(hidden, noise, rng):
    places = DirectSimulator(WIRE).solve(START).positions_at(S)
    for _ in range(20):
        before, points = (places + noise * rng.normal(size=places.shape) for _ in range(2))
        assert not carried(before, points).any()
        points[hidden] = moved(before, rng)[hidden]
        assert carried(before, points).tolist() == hidden.tolist()
        assert carried(*np.float32([before, points])).tolist() == hidden.tolist()


def test_what_does_not_move_at_all_was_seen(rng):
    places = DirectSimulator(WIRE).solve(START).positions_at(S)
    assert not carried(places, places).any()
    assert not carried(places, moved(places, rng)).any()


def test_clouds_of_other_sizes_or_in_another_order_share_no_nodes(rng):
    points = rng.normal(size=(20, 3))
    assert carried(points[:-1], points).tolist() == [False] * 20
    assert not carried(points, rng.permutation(points)).any()
    assert carried(points[:3], points[:3]).tolist() == [False] * 3


def test_a_carried_end_does_not_tell_where_the_end_is(rng):
    """The gripper turns: weight bends the true end otherwise, the carried one turns along."""
    down = Rotation.from_euler('y', 25, degrees=True)
    direct, other = DirectSimulator(WIRE), Pose(
        START.position, (down * Rotation.from_quat(START.quaternion)).as_quat())
    out = DloEstimator(direct, EstimatorConfig(SPREAD, NOISE))
    shapes = [direct.solve(START), direct.solve(other)]
    hidden, last = S > 0.66, None
    for begin, shape, blind in ((0.0, shapes[0], False), (4.0, shapes[1], True)):
        for time in np.arange(begin, begin + 3.9, 0.05):
            out.gripper(time, shape.gripper)
        for stamp in np.arange(begin + 1.0, begin + 3.0, 0.2):
            points = shape.positions_at(S) + NOISE * rng.normal(size=(S.size, 3))
            if blind:
                turn, _ = Rotation.align_vectors(
                    (points - points[0])[1:][~hidden[1:]], (last - last[0])[1:][~hidden[1:]])
                points[hidden] = points[0] + turn.apply(last[hidden] - last[0])
            last = points
            out.look(stamp, points)
    end = shapes[1].positions[-1]
    assert np.linalg.norm(last[-1] - end) > 0.02  # where the tracker has it
    assert not out.inconsistent
    assert np.linalg.norm(out.estimate.shape(other).positions[-1] - end) < 3e-3


def test_where_points_begin_to_be_carried_a_look_may_disagree_and_is_no_doubt(rng):
    """What was seen last between two looks is not known: the first look of a spell is deceived."""
    direct, hidden = DirectSimulator(WIRE), S > 0.66
    out = DloEstimator(direct, EstimatorConfig(SPREAD, NOISE))
    for time in np.arange(0.0, 9.0, 0.1):
        out.gripper(time, START)
    places, surprises = direct.solve(START).positions_at(S), []
    for k in range(30):
        points = places + NOISE * rng.normal(size=places.shape)
        if k > 8 and k % 3:
            if k % 3 == 1:  # while the end was away from its rest
                last = places + [0, 5e-3, 0] * hidden[:, None]
            points[hidden] = moved(last, rng)[hidden] if k % 3 == 2 else last[hidden]
        out.look(0.5 + 0.2 * k, points)
        surprises.append(out.normalized_innovation)
        assert not out.inconsistent, k
    assert min(surprises[10::3]) > 1
    assert max(surprises[9::3]) <= 1


def test_a_carried_end_does_not_tell_that_the_dlo_is_at_rest(rng):
    direct, hidden = DirectSimulator(WIRE), S > 0.6
    places, told = direct.solve(START).positions_at(S), []
    for fills_in in (False, True):
        out = DloEstimator(direct, EstimatorConfig(SPREAD, NOISE))
        for time in np.arange(0.0, 5.1, 0.1):
            out.gripper(time, START)
        last = places
        for stamp in np.arange(1.0, 5.0, 0.1):
            points = places + NOISE * rng.normal(size=places.shape)
            if fills_in:
                points[hidden] = last[hidden]
            out.look(stamp, points)
            last = points
        told.append(out.vibration(START, 1.05))
    assert told[0].between[1] < 2 * NOISE
    assert told[1] is None


@pytest.mark.every(2)
@pytest.mark.parametrize('amplitude', [1.5e-3, 4e-3])
def test_a_swing_is_what_points_scatter_across_the_dlo_less_their_noise(amplitude):
    """Along the DLO a point tells nothing: two axes have noise, not three."""
    direct, s, noise = DirectSimulator(WIRE), np.linspace(0.3, 1.0, 8) * WIRE.length, 2e-3
    shape, found = direct.solve(START), []
    axes = shape.frame_at(float(shape.s[-1]))[0]
    places, share = shape.positions_at(s), (s / WIRE.length)[:, None]**2
    for seed in range(4):
        rng = np.random.default_rng(seed)
        out = DloEstimator(direct, EstimatorConfig(SPREAD, noise, sway=amplitude))
        for time in np.arange(0.0, 7.1, 0.1):
            out.gripper(time, START)
        for stamp in np.arange(1.0, 7.0, 0.21):
            swing = amplitude * np.cos(2 * np.pi * 0.9 * stamp) * axes[:, 1]
            out.look(stamp, places + share * swing + noise * rng.normal(size=(s.size, 3)))
        found.append(out.swing)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(amplitude, rel=0.15)
