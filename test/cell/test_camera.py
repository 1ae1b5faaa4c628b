# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera: what it sees, when, and how wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip('mujoco', reason='extra [cell] is not installed')

from dlo_planner import CutOut, InvalidTask, Pose, Rod  # noqa: E402  mujoco may be missing
from dlo_planner.cell.camera import BAD, Camera, Viewer  # noqa: E402
from dlo_planner.cell.plant import Plant  # noqa: E402
from dlo_planner.cell.truth import Truth  # noqa: E402
from dlo_planner.identify.carried import carried  # noqa: E402

LEVEL = Pose((0, 0, 1), (0, 0, 0, 1))
HOLE = CutOut(Pose.looking_along((0.8, 0, 1), (1, 0, 0)), radius=0.01)


@pytest.fixture
def plant():
    """Return a weightless straight DLO along x."""
    return Plant(Rod(1.0, 0.1, 1.0, 0.75), LEVEL, gravity=(0, 0, 0), cells=8,
                 truth=Truth(hole_shift=(0, 0.002, 0)))


def seen(plant, camera, seconds, rng, period=0.01):
    """Return [(time, Image)] of a DLO at rest."""
    viewer, images = Viewer(camera, rng), []
    for _ in range(round(seconds / period)):
        images += [(plant.time, image) for image in viewer.images(plant, HOLE)]
        plant.move(LEVEL, period)
    return images


def test_rate_latency_and_stamps(plant, rng):
    images = seen(plant, Camera(rate=10.0, latency=0.06, stamp_error=0.03), 2.0, rng)
    times, stamps = np.array([(time, image.stamp) for time, image in images]).T
    assert stamps == pytest.approx(0.03 + 0.1 * np.arange(20))
    assert times == pytest.approx(stamps + 0.03, abs=1e-6)


def test_noise_and_bias(plant, rng):
    images = seen(plant, Camera(rate=100.0, noise=1e-3, bias=5e-3, points=40), 0.5, rng)
    points = np.concatenate([image.points for _, image in images])
    assert points[:, 1:].std(axis=0) == pytest.approx(1e-3, rel=0.1)
    assert np.abs(points.mean(axis=0)[1:] - (0, 1)).max() > 1e-3
    assert all(image.hole is None for _, image in images)


def test_outliers_are_as_many_as_asked_for(plant, rng):
    images = seen(plant, Camera(rate=100.0, noise=1e-5, outliers=0.1, points=40), 0.5, rng)
    off = np.linalg.norm(np.concatenate([i.points for _, i in images])[:, 1:] - (0, 1), axis=1)
    assert (off > 1e-4).mean() == pytest.approx(0.1, abs=0.03)


def test_a_third_is_never_seen_but_the_free_end_is(plant, rng):
    for _ in range(5):
        images = seen(plant, Camera(rate=50.0, noise=0.0, hidden=1 / 3, points=60), 0.2, rng)
        along = np.sort(np.concatenate([image.points for _, image in images])[:, 0])
        gaps = np.diff(np.concatenate([[0], along, [1]]))
        assert gaps.max() == pytest.approx(1 / 3, abs=0.03)
        assert np.sort(gaps)[-2] < 0.05
        assert along[along > 2 / 3].size > 100


@pytest.mark.parametrize('share', [0.3, 1.0])
def test_the_free_third_is_hidden_in_spells(plant, rng, share):
    camera = Camera(rate=20.0, noise=0.0, points=40, blind=share, hidden=0.2, latency=0.0)
    viewer, seen_then = Viewer(camera, rng), []
    for _ in range(4000 if share < 1 else 100):
        seen_then += [image.points[:, 0].max() > 2 / 3 for image in viewer.images(plant, HOLE)]
        plant.time += 0.05  # at rest nothing moves
    seen_then = np.array(seen_then)
    assert 1 - seen_then.mean() == pytest.approx(share, abs=0.06)
    if share < 1:
        ends = np.flatnonzero(np.diff(seen_then.astype(int)))
        hidden = 0.05 * np.diff(ends[0 if seen_then[0] else 1:])[::2]
        assert hidden.min() > 0.4
        assert np.median(hidden) == pytest.approx(1.3, abs=0.3)  # some are one after the other


def test_a_second_cable_hangs_beside_the_way(plant, rng):
    camera = Camera(rate=100.0, noise=0.0, points=60, second_cable=0.25)
    points = np.concatenate([image.points for _, image in seen(plant, camera, 0.5, rng)])
    its = points[np.linalg.norm(points[:, 1:] - (0, 1), axis=1) > 1e-9]
    assert len(its) / len(points) == pytest.approx(0.25, abs=0.03)
    x, y, z = its.T
    assert np.ptp(x) == pytest.approx(0.85, abs=0.02)
    assert np.polyfit(x, y, 1, full=True)[1] == pytest.approx(0, abs=1e-12)  # in a plane
    parabola, off = np.polyfit(x, z, 2, full=True)[:2]
    assert off == pytest.approx(0, abs=1e-12)
    assert parabola[0] > 0  # hanging
    assert np.linalg.norm(its[:, 1:] - (0, 1), axis=1).max() < 0.25
    elsewhere = np.concatenate([image.points for _, image in seen(
        plant, camera, 0.5, np.random.default_rng(5))])
    assert np.abs(elsewhere[:len(points), 1].max() - y.max()) > 1e-3


def test_what_is_new_does_not_change_what_is_drawn_else(plant):
    one, other = (seen(plant, camera, 0.5, np.random.default_rng(3)) for camera in (
        Camera(points=40), Camera(points=40, second_cable=0.25)))
    same = [np.isclose(a.points, b.points, atol=1e-9).all(axis=1).mean()
            for (_, a), (_, b) in zip(one, other, strict=True)]
    assert min(same) > 0.5


def test_the_hole_is_seen_with_the_same_bias(plant, rng):
    camera = Camera(rate=100.0, noise=1e-4, bias=5e-3, points=40, sees_hole=True)
    images = seen(plant, camera, 0.3, rng)
    hole = np.mean([image.hole for _, image in images], axis=0)
    points = np.concatenate([image.points for _, image in images]).mean(axis=0)
    assert hole[1:] - points[1:] == pytest.approx((0.002, 0), abs=1e-4)


def test_a_camera_that_is_turned_and_displaced_sees_dlo_and_hole_so(plant, rng):
    turn, about, offset = np.array([0.0, 0.0, 0.01]), np.array([0.2, 0.0, 0.8]), (0, 0, 3e-3)
    camera = Camera(rate=100.0, noise=0.0, points=40, sees_hole=True, turn=turn,
                    turned_about=about, offset=offset)
    images = seen(plant, camera, 0.1, rng)
    center = HOLE.center + about  # 1 m from the gripper
    matrix = Rotation.from_rotvec(turn).as_matrix()

    def wrong(place):
        return matrix @ (place - center) + center + offset

    begin, end = wrong(np.array([0.0, 0, 1])), wrong(np.array([1.0, 0, 1]))
    points = np.concatenate([image.points for _, image in images])
    along = (points - begin) @ (end - begin)
    np.testing.assert_allclose(points, begin + along[:, None] * (end - begin), atol=1e-6)
    assert np.abs(begin - (0, 0, 1)).max() == pytest.approx(0.01, rel=1e-3)
    np.testing.assert_allclose(images[0][1].hole, wrong(HOLE.center + (0, 2e-3, 0)), atol=1e-9)


def test_a_camera_that_drifts_is_off_the_more_the_later(plant, rng):
    rates = (0.0, 0.0, 3e-3), np.array([0.0, 0.0, 0.02])
    images = seen(plant, Camera(rate=100.0, noise=0.0, points=40, sees_hole=True, drift=rates[0],
                                turn_drift=rates[1]), 0.3, rng)
    hole = HOLE.center + (0, 2e-3, 0)
    for _, image in images:
        turn = Rotation.from_rotvec(image.stamp * rates[1]).as_matrix()
        np.testing.assert_allclose(
            image.hole, turn @ (hole - HOLE.center) + HOLE.center + image.stamp
            * np.array(rates[0]), atol=1e-9)
    assert images[-1][1].stamp > images[0][1].stamp + 0.2


def test_a_tracker_fills_the_free_third_in_with_what_it_saw_last(rng):
    bent = Plant(Rod(1.0, 0.1, 1.0, 0.75), LEVEL, cells=16)
    viewer = Viewer(Camera(rate=100.0, latency=0.0, noise=1e-3, points=30, fills_in=True,
                           blind=0.5), rng)
    s, errors, before, hidden = np.linspace(0, 1, 30), [], None, 0
    for k in range(400):
        image, = viewer.images(bent, HOLE)
        places = bent.points(s * bent.length)
        errors.append(np.linalg.norm(image.points - places, axis=1))
        if before is not None:
            still = carried(before, image.points)
            assert not still[s < 0.66].any()
            hidden += still.any()
            assert still.any() == still[s > 0.67].all()
        before = image.points
        bent.move(Pose(LEVEL.position, Rotation.from_euler(
            'y', 0.5 * np.sin(0.02 * k)).as_quat()), 0.01)
    assert 100 < hidden < 300
    errors = np.array(errors)
    assert errors[:, s < 0.66].max() < 6e-3  # noise
    assert errors[:, -1].max() > 0.02


@pytest.mark.parametrize('nodes', [9, 10])
def test_a_tracker_of_few_nodes_knows_how_the_hidden_part_moves(plant, nodes, rng):
    viewer = Viewer(Camera(rate=50.0, latency=0.0, noise=1e-4, points=nodes, fills_in=True,
                           blind=0.5), rng)
    images = []
    for _ in range(200):
        images += viewer.images(plant, HOLE)
        plant.time += 0.05  # at rest nothing moves
    points = np.array([image.points for image in images])
    np.testing.assert_allclose(points[:, :, 0], np.tile(np.linspace(0, 1, nodes), (200, 1)),
                               atol=0.01)


def test_the_same_seed_sees_the_same(plant):
    one, other = (seen(plant, BAD, 0.2, np.random.default_rng(3)) for _ in range(2))
    assert len(one) == len(other) == 2
    assert np.array([i.points for _, i in one]) == pytest.approx(
        np.array([i.points for _, i in other]), abs=1e-6)


@pytest.mark.parametrize('given', [{'rate': 0}, {'latency': -1}, {'outliers': 1.1}, {'points': 0},
                                   {'hidden': 0.7}, {'blind': 1.2}, {'second_cable': -0.1},
                                   {'second_cable': 0.6, 'outliers': 0.6},
                                   {'hidden': 0.65, 'blind': 0.1}, {'noise': np.nan},
                                   {'sees_hole': 1}, {'points': 8, 'fills_in': True}])
def test_what_makes_no_sense_is_refused(given):
    with pytest.raises(InvalidTask, match=f'Camera.{next(iter(given))}'):
        Camera(**given)
