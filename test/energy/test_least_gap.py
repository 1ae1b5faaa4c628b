# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The least gap along an element, all its minima, and the bounds that prove that there are no more.

What a straight line keeps from the rim of a hole in a sheet without thickness is closed form: it
crosses the plane `off` from the middle at an angle, and is nearest to both rims where it is
(radius -+ off) sin(angle) away.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.gaps import distance, straight
from dlo_planner import Box, Capsule, CutOut, Cylinder, Pose, Sheet
from dlo_planner.direct.discretization import ContactPoints
from dlo_planner.energy.chords import lowest_of_tangents, sheet_bound
from dlo_planner.energy.gap import closest_point_in_element, least_gap, minima_in_element
from dlo_planner.energy.scene import build_scene
from dlo_planner.model.rod import Surface
from dlo_planner.plan.clearance import clearance as stated
from dlo_planner.plan.clearance import hole_clearances, nearest

RADIUS, HOLE = 1e-3, 5e-3
TURNED = Pose((0.3, -0.2, 0.1), (0.2, -0.1, 0.4, 0.8))  # nothing may depend on the axes


def oblique(angle, off, *, length=0.1, share=0.5):
    """Return a thin Sheet and the arrays of a straight element that passes its hole obliquely."""
    normal, across = TURNED.rotation[:, 0], TURNED.rotation[:, 1]
    along = np.cos(angle) * across + np.sin(angle) * normal
    begin = TURNED.position + off * across - share * length * along
    frame = Pose.looking_along((0, 0, 0), along).rotation
    arrays = (np.array([length]), np.zeros((1, 3)), np.array([frame, frame]),
              np.array([begin, begin + length * along]))
    return Sheet(TURNED, 0.4, 0.4, 0.0, (CutOut(TURNED, radius=HOLE),)), arrays


PASSAGES = [(angle, off, share) for angle in (0.35, 0.8, 1.0) for off in (-2e-3, -1e-4, 1e-3)
            for share in (0.31, 0.5, 0.77)]


@pytest.mark.parametrize(('angle', 'off', 'share'), PASSAGES)
def test_the_least_gap_of_an_oblique_passage_is_that_of_the_nearer_rim(angle, off, share):
    sheet, arrays = oblique(angle, off, share=share)
    scene = build_scene([sheet], RADIUS)
    wanted = (HOLE - abs(off)) * np.sin(angle) - RADIUS
    where = share + np.sign(off) * (HOLE - abs(off)) * np.cos(angle) / arrays[0][0]
    gap, fraction, bound = least_gap(scene, 0, 0, 0.0, 1.0, np.inf, 1e-10, *arrays)
    assert gap == pytest.approx(wanted, abs=1e-9)
    assert gap - 1e-8 <= bound <= gap
    assert fraction == pytest.approx(where, abs=1e-3)
    gap, fraction = closest_point_in_element(scene, 0, 0, 0.0, *arrays, np.empty(3),
                                             np.empty((3, 3)))
    assert gap == pytest.approx(wanted, abs=1e-15)
    assert fraction == pytest.approx(where, abs=1e-9)


@pytest.mark.parametrize(('angle', 'off', 'share'), PASSAGES)
def test_an_oblique_passage_has_a_minimum_at_each_rim(angle, off, share):
    sheet, arrays = oblique(angle, off, share=share)
    scene, gaps, fractions = build_scene([sheet], RADIUS), np.empty(2), np.empty(2)
    assert minima_in_element(scene, 0, 0, *arrays, gaps, fractions) == 2
    rooms = np.array([HOLE + off, HOLE - off])  # at the rim before the plane, and behind it
    np.testing.assert_allclose(gaps, rooms * np.sin(angle) - RADIUS, atol=1e-15)
    np.testing.assert_allclose(fractions, share + [-1, 1] * rooms * np.cos(angle) / arrays[0][0],
                               atol=1e-9)
    for gap, fraction in zip(gaps, fractions, strict=True):
        # a point that is watched there finds its own minimum again, and not the other one
        again = closest_point_in_element(scene, 0, 0, fraction + 0.004, *arrays, np.empty(3),
                                         np.empty((3, 3)))
        assert again == pytest.approx((gap, fraction), abs=1e-9)


def test_an_element_that_ends_in_a_hole_has_the_minimum_before_it_alone():
    sheet, arrays = oblique(0.8, 1e-3, share=1.0)
    gaps, fractions = np.empty(2), np.empty(2)
    assert minima_in_element(build_scene([sheet], RADIUS), 0, 0, *arrays, gaps, fractions) == 1
    assert gaps[0] == pytest.approx((HOLE + 1e-3) * np.sin(0.8) - RADIUS, abs=1e-15)


BODIES = [Box(TURNED, (0.01, 0.02, 0.03)), Capsule((0.29, -0.2, 0.1), (0.31, -0.19, 0.1), 0.004),
          Cylinder((0.29, -0.2, 0.1), (0.31, -0.19, 0.1), 0.004)]


@pytest.mark.parametrize('body', BODIES)
@pytest.mark.parametrize('seed', range(8))
def test_the_least_gap_beside_convex_bodies_against_samples(body, seed):
    rng = np.random.default_rng(seed)
    h, strain = 0.05, 15.0 * rng.normal(size=3)
    frame = Rotation.random(random_state=rng).as_matrix()
    begin = np.array([0.3, -0.2, 0.1]) - 0.5 * h * frame[:, 0] + 0.01 * rng.normal(size=3)
    arrays = np.array([h]), strain[None], np.array([frame, frame]), np.array([begin, begin])
    # the exact helix by small rotations of its own
    fine = 20000
    turns = Rotation.from_rotvec(np.outer((np.arange(fine) + 0.5) * h / fine, strain)).as_matrix()
    axis = begin + np.vstack([np.zeros(3), np.cumsum(turns[:, :, 0] @ frame.T, axis=0) * h / fine])
    wanted = distance(body, axis).min() - RADIUS
    scene = build_scene([body], RADIUS)
    gap, _, bound = least_gap(scene, 0, 0, 0.0, 1.0, np.inf, 1e-10, *arrays)
    assert wanted - 2.5e-6 <= gap <= wanted + 2e-8  # the samples are 2.5e-6 m apart
    assert gap - 1.3e-8 <= bound
    # of what is not less than `below` no more is said than that
    more, _, bound = least_gap(scene, 0, 0, 0.0, 1.0, gap - 1e-3, 1e-10, *arrays)
    assert more >= gap - 1e-12
    assert bound >= gap - 1e-3 - 1e-10


SHEETS = [Sheet(TURNED, 0.06, 0.05, thickness, cutouts) for thickness in (0.0, 2e-3, 0.02)
          for cutouts in (
              (CutOut(TURNED, radius=HOLE),), (CutOut(TURNED, width=0.012, height=0.006),),
              (CutOut(TURNED, radius=HOLE), CutOut(Pose(
                  TURNED.position + TURNED.rotation @ [0, 0.015, 0.002], TURNED.quaternion),
                  radius=HOLE)), ())]


@pytest.mark.parametrize('sheet', SHEETS)
def test_no_point_of_a_chord_is_nearer_to_a_sheet_than_the_bound(sheet):
    rng = np.random.default_rng(len(sheet.cutouts))
    scene, share = build_scene([sheet], 0.0), np.linspace(0, 1, 201)[:, None]
    for _ in range(100):
        way = 10 ** rng.uniform(-5, -1.5) * rng.normal(size=3)
        begin = TURNED.position + TURNED.rotation @ (rng.normal(size=3) * [0.01, 0.02, 0.02])
        true = distance(sheet, begin + share * way).min()
        bound = min(sheet_bound(scene, o, begin, begin + way) for o in range(scene.kind.size))
        # as near as the length of the chord at worst, so that shorter ones end the search
        assert true - 2.0 * np.linalg.norm(way) - 1e-15 <= bound <= true + 1e-15


def test_a_convex_function_stays_above_its_tangents():
    low = lowest_of_tangents(1.0, -4.0, 2.0, 8.0)  # they meet at 7/12
    assert low == pytest.approx(1.0 - 4.0 * 7 / 12)
    assert lowest_of_tangents(1.0, 0.5, 3.0, 2.0) == 1.0
    assert lowest_of_tangents(3.0, -2.0, 1.0, -0.5) == 1.0


@pytest.mark.parametrize('off', [-2e-3, 2e-3])
def test_clearance_and_its_place_are_those_of_the_nearer_rim(off):
    sheet, (lengths, _, frames, positions) = oblique(0.5, off)
    shape = straight(Pose.from_rotation(positions[0], frames[0]), float(lengths[0]))
    wanted = (HOLE - 2e-3) * np.sin(0.5) - RADIUS
    assert stated([sheet], Surface(RADIUS), shape) == pytest.approx(wanted, abs=1e-10)
    rooms = hole_clearances(sheet, TURNED.rotation[:, 0], Surface(RADIUS), shape)
    assert rooms.min() == pytest.approx(wanted, abs=1e-10)
    (gap, s, _), = nearest(build_scene([sheet], RADIUS, shape.s), shape)
    assert gap == pytest.approx(wanted, abs=1e-15)
    assert s == pytest.approx(0.05 + np.sign(off) * 3e-3 * np.cos(0.5), abs=1e-9)


def test_a_point_that_rolls_beside_a_hole_keeps_its_place_on_another_mesh():
    values = np.zeros((3, 14))
    values[:, 0], values[:, 1] = 1.0, (-0.2, -0.9, 0.0)
    points = ContactPoints(np.array([(0, 0), (0, 0), (1, 0)]), values)
    moved = points.on(np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.2, 0.5, 0.7, 1.0]))
    assert list(moved.element) == [0, 1, 3]  # at 0.1, at 0.45, anywhere about 0.75
    np.testing.assert_allclose(moved.fraction, [-0.5, -0.25 / 0.3, 0.0])
