# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Writhe beside closed forms and quadrature; what passes through itself changes it by two."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner.geometry.self_passage import bends_back, first_passage, passes_itself, passes_ray
from dlo_planner.geometry.writhe import link, writhe

CROSSING = np.array([[-1.0, 0, 0.1], [1, 0, 0.1], [2, 2, 0], [0, 3, 0], [0, 1, 0], [0, -2, 0]])


def torus_knot(p, q, n):
    t = np.linspace(0, 2 * np.pi, n + 1)
    away = 2 + np.cos(q * t)
    return np.column_stack([away * np.cos(p * t), away * np.sin(p * t), np.sin(q * t)])


def gauss_integral(points):
    """Return the writhe of a closed curve through points (n + 1, 3) by the midpoint rule."""
    middles, chords = 0.5 * (points[1:] + points[:-1]), np.diff(points, axis=0)
    away = middles[:, None] - middles[None]
    cubes = np.linalg.norm(away, axis=2) ** 3
    np.fill_diagonal(cubes, np.inf)
    crossed = np.cross(chords[:, None], chords[None])
    return (np.einsum('ijk,ijk->ij', crossed, away) / cubes).sum() / (4 * np.pi)


def meets_by_sampling(before, after, samples=400):
    """Return whether chords meet on the way, by the sign of volumes at many instants."""
    one, other = np.triu_indices(len(before) - 1, 2)

    def seen(t):
        x = (1 - t) * before + t * after
        u, v, w = x[one + 1] - x[one], x[other + 1] - x[other], x[other] - x[one]
        uu, vv, uv, uw, vw = (np.einsum('ij,ij->i', *pair)
                              for pair in ((u, u), (v, v), (u, v), (u, w), (v, w)))
        across = uu * vv - uv * uv
        return np.array([np.einsum('ij,ij->i', np.cross(u, v), w), (uw * vv - vw * uv) / across,
                         (uw * uv - vw * uu) / across])

    last = seen(0.0)
    for t in np.linspace(0, 1, samples)[1:]:
        now = seen(t)
        share = last[0] / (last[0] - now[0])
        p, q = last[1:] + share * (now[1:] - last[1:])
        if np.any((last[0] * now[0] < 0) & (p >= 0) & (p <= 1) & (q >= 0) & (q <= 1)):
            return True
        last = now
    return False


def test_what_lies_in_a_plane_has_no_writhe(rng):
    t = np.linspace(0, 20, 60)
    plane = np.column_stack([t * np.cos(t), t * np.sin(t), 0 * t])  # a spiral
    assert writhe(plane, False) == 0
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert abs(writhe(plane @ turn, False)) < 1e-6  # arcsin near 1 has the root of rounding


@pytest.mark.parametrize('p, q', [(2, 3), (3, 2), (2, 5)])
def test_writhe_of_knots_is_the_gauss_integral(p, q):
    knot = torus_knot(p, q, 1200)
    assert writhe(knot, False) == pytest.approx(gauss_integral(knot), rel=1e-4)
    mirrored = knot * (1, 1, -1)
    assert writhe(mirrored, False) == pytest.approx(-writhe(knot, False), abs=1e-9)


def test_writhe_of_a_helix_is_the_part_of_its_turns_that_is_not_torsion():
    # closed by straight lines far along its axis: Fuller 1971, n (1 - cos of the angle to the axis)
    turns, radius, pitch = 40, 1.0, 3.0
    t = np.linspace(0, 2 * np.pi * turns, 80 * turns + 1)
    helix = np.column_stack([radius * np.cos(t), radius * np.sin(t), pitch * t / (2 * np.pi)])
    slope = pitch / np.hypot(2 * np.pi * radius, pitch)
    assert writhe(helix, False) == pytest.approx(turns * (1 - slope), rel=0.02)


def test_a_strand_led_through_another_changes_writhe_by_two():
    heights = np.linspace(0.1, -0.1, 2000)  # none is 0
    values = []
    for height in heights:
        points = CROSSING.copy()
        points[:2, 2] = height
        values.append(writhe(points, False))
    jumps = np.diff(values)
    assert np.abs(jumps).max() == pytest.approx(2, abs=1e-2)
    assert np.sort(np.abs(jumps))[-2] < 0.01


def test_passages_through_what_goes_straight_on_are_those_of_one_more_chord(rng):
    found = 0
    for _ in range(150):
        before = np.cumsum(rng.normal(size=(8, 3)), axis=0)
        after = before + rng.normal(size=before.shape) * rng.choice([0.1, 0.3])
        ray = 4.0 * rng.normal(size=3)
        longer = [np.vstack([points, points[-1] + ray]) for points in (before, after)]
        passes = passes_ray(ray, ray, 7, before, after)
        if not passes_itself(before, after):
            assert passes == passes_itself(*longer)
        assert passes_ray(ray, ray, 0, before[::-1].copy(), after[::-1].copy()) == passes
        found += passes
    assert found > 4
    assert not passes_ray(np.zeros(3), np.zeros(3), 7, before, after)


def test_passages_are_those_of_a_plain_look_at_many_instants(rng):
    found = 0
    for _ in range(50):
        before = np.cumsum(rng.normal(size=(14, 3)), axis=0)
        after = before + rng.normal(size=before.shape) * rng.choice([0.1, 0.3])
        passes = passes_itself(before, after)
        assert passes == meets_by_sampling(before, after)
        assert passes_itself(after, before) == passes
        found += passes
    assert 7 < found < 43


def test_rounding_in_a_plane_is_no_passage(rng):
    flat = CROSSING * (1, 1, 0)
    for _ in range(50):
        one, other = (flat + 1e-16 * rng.normal(size=flat.shape)
                      for _ in range(2))
        assert not passes_itself(one, other)
    over, under = CROSSING.copy(), CROSSING.copy()
    under[:2, 2] = -0.1
    assert passes_itself(over, under) and not passes_itself(over, over)


def arc(bend, count=20):
    """Return lengths, strains, frames and positions of an even bend about n, by its closed form."""
    s = np.linspace(0, 1, count + 1)
    c, sine = np.cos(bend * s), np.sin(bend * s)
    frames = np.zeros((count + 1, 3, 3))
    frames[:, 0, 0], frames[:, 2, 0], frames[:, 1, 1] = c, -sine, 1
    frames[:, 0, 2], frames[:, 2, 2] = sine, c
    positions = np.column_stack([sine, 0 * s, c - 1]) / bend
    return np.diff(s), np.tile([0, bend, 0.0], (count, 1)), frames, positions


def test_only_what_bends_by_more_than_a_right_angle_may_pass():
    lengths, gentle, _, _ = arc(1.5)
    _, sharp, _, _ = arc(1.6)
    assert not bends_back(lengths, gentle, gentle)
    assert bends_back(lengths, gentle, sharp) and bends_back(lengths, sharp, gentle)


def test_the_first_passage_of_a_row_of_shapes():
    rows = np.repeat(CROSSING[None], 4, axis=0)
    rows[2:, :2, 2] = -0.1
    lengths = np.linalg.norm(np.diff(CROSSING, axis=0), axis=1)
    bent = np.full((4, 5, 3), 1.0)
    frames = np.tile(np.eye(3), (4, 1, 1))
    assert first_passage(lengths, bent, frames, rows) == 1
    assert first_passage(lengths, bent, frames, rows[[0, 0, 0, 0]]) == -1
    assert first_passage(lengths, 0 * bent, frames, rows) == -1


def test_passages_are_looked_at_from_where_the_curve_is_held(rng):
    strains, differ = np.full((2, 13, 3), 1.0), 0
    for _ in range(60):
        before = np.cumsum(rng.normal(size=(14, 3)), axis=0)
        after = before + 0.2 * rng.normal(size=before.shape)
        after[0] = before[0]
        turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        frames, carried = np.array([np.eye(3), turn]), after @ turn.T + 5.0
        lengths = np.linalg.norm(np.diff(before, axis=0), axis=1)
        passes = passes_itself(before, after)
        rows = np.array([before, carried])
        assert (first_passage(lengths, strains, frames, rows) == 0) == passes
        differ += passes_itself(before, carried) != passes  # as the world sees it
    assert differ > 1


def test_link_does_not_tell_that_straight_ends_cross_each_other():
    # of a bend by half a turn, a little less or more: its ends cross far behind, or do not
    known = [link(*arc(np.pi + more), 0.0) for more in (-0.02, 0.02)]
    assert known[0] == pytest.approx(known[1], abs=0.02)
    out = Rotation.from_rotvec([0.0, 0.02, 0.0]).as_matrix()
    for more in (-0.02, 0.02):  # the same out of the plane
        lengths, strains, frames, positions = arc(np.pi + more)
        frames[-1] = out @ frames[-1]
        assert link(lengths, strains, frames, positions, 0.0) == pytest.approx(known[0], abs=0.02)


def test_link_of_a_flat_bend_is_its_twist():
    lengths, strains, frames, positions = arc(2.0)
    assert link(lengths, strains, frames, positions, 0.0) == pytest.approx(0, abs=1e-7)
    # a straight one, twisted by five turns on two elements
    angle = 10 * np.pi * np.linspace(0, 1, 3)
    twisted = np.array([[[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
                        for a in angle])
    places = np.column_stack([np.linspace(0, 1, 3), np.zeros((3, 2))])
    assert link(np.full(2, 0.5), np.tile([10 * np.pi, 0, 0.0], (2, 1)), twisted, places,
                0.0) == pytest.approx(5)
