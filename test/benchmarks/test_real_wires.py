# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The rows of real wires, by photographs of a wire that is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks import real_wires
from benchmarks.real_wires import WIRES, Turned, as_it_is_said, in_space, loop, places
from benchmarks.validation import scripted
from benchmarks.validation.scripts import ENTRIES
from dlo_planner import Pose, fit_rod
from dlo_planner.identify import Observation

WHITE = WIRES[0]
NOISE = 1e-3  # m


@cache
def white_loop():
    return loop(WHITE)


def photographed(stiffness, angles, seed=0):
    """Return the points (51, 2) of a photograph of the white wire."""
    ends = np.zeros((51, 2))
    ends[-1, 0] = -real_wires.APART
    shape = Turned(WHITE, [ends], white_loop()).shape(0, stiffness, np.array(angles))
    assert shape.converged
    points = shape.positions_at(places(ends))[:, [0, 2]]
    points[1:-1] += NOISE * np.random.default_rng(seed).normal(size=(49, 2))
    return points


def test_the_loop_is_in_its_plane_and_is_that_of_its_curvatures():
    shape = white_loop()
    assert np.abs(shape.positions[:, 1]).max() < 1e-6
    assert np.abs(shape.torque).max() < 1e-9
    turned = -shape.element_strains[:, 1] @ np.diff(shape.s)
    assert abs(turned) == pytest.approx(2 * np.pi)


def test_the_stiffness_of_a_known_wire_is_found_in_the_grips_as_they_are_said():
    found = as_it_is_said(WHITE, [photographed(9e-5, (0, 0, 0))], white_loop())
    assert abs(found.stiffness - 9e-5) < 3 * found.deviation < 0.1 * 9e-5
    assert found.apart == pytest.approx(np.sqrt(2) * NOISE, rel=0.2)


def test_a_picture_is_of_the_loop_without_a_turn_of_twist():
    # a loop with a turn fits these points better, as long as the stiffness is a guess
    points = photographed(9.7e-5, (0.007, 0.21, -0.23))
    seen = Observation(Pose.identity(), in_space(points)[1:-1], places(points)[1:-1],
                       real_wires.pitched(in_space(points)[-1], 0.0), (0, 1, 0))
    guess = real_wires.rod_of(WHITE, 2 * WHITE.theirs[0])
    fit = fit_rod(guess, [seen], **real_wires.MESH)
    assert np.abs(fit.found[0][:, 1]).max() < 1e-6


def test_the_angles_of_camera_and_clamps_are_found():
    angles = np.array([0.03, 0.2, -0.1])
    points = photographed(9e-5, angles)
    found = Turned(WHITE, [points], white_loop()).found()
    assert abs(found.stiffness - 9e-5) < 3 * found.deviation
    np.testing.assert_allclose(found.angles, [angles], atol=0.03)
    wrong = as_it_is_said(WHITE, [points], white_loop())
    assert wrong.apart > 2 * found.apart


def test_what_goes_together_counts_once():
    rng = np.random.default_rng(1)
    alone = rng.normal(size=4000)
    assert real_wires._together(alone) == pytest.approx(1, abs=0.2)
    smooth = np.convolve(alone, np.full(10, 0.1), mode='valid')
    assert real_wires._together(smooth) == pytest.approx(10, rel=0.3)  # a triangle of lags


def test_a_light_ring_gives_way_at_michells_twist():
    # 2 pi sqrt(3) EI / GJ without weight (Michell 1889, Zajac 1962); w L^3 / EI is 1 here: a ring
    # without weight turns about the tangent of its clamps for nothing
    ring, ratio = replace(WHITE, mass=3e-6, theirs=(1e-4, 0.8)), 0.8
    twist, before, after = real_wires.twist_that_tips(ring, 1e-4, ratio, loop(ring, 0.0))
    assert twist == pytest.approx(360 * np.sqrt(3) / ratio, rel=0.015)
    assert before.converged and after.jumped


def test_without_the_photographs_that_is_said(tmp_path, monkeypatch, capsys):
    assert real_wires.main([str(tmp_path)]) == 2
    assert 'expected a folder with loop_white_0.csv' in capsys.readouterr().err
    monkeypatch.setenv('DLO_WIRES', str(tmp_path / 'nowhere'))
    rows = [one for one in ENTRIES if one.data]
    found = scripted.run(rows, 1, tmp_path)
    assert len(rows) == 2
    assert {scripted.met(one) for one in found.values()} == {
        '*not run*: DLO_WIRES names no folder with the data'}


def test_a_point_of_a_picture_is_in_the_upright_plane():
    np.testing.assert_array_equal(in_space(np.array([[1.0, 2.0]])), [[1, 0, 2]])
