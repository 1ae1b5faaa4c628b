# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Sections: which side of a rectangle is which, in radius, strain and yield."""

import numpy as np
import pytest

from dlo_planner import Rod

WIDTH, THICKNESS = 0.02, 0.001
STRIP = Rod.rectangular(1.0, WIDTH, THICKNESS, 7850.0, 210e9, 0.3, yield_stress=400e6)


def test_the_radius_reaches_the_farthest_side():
    assert STRIP.radius == WIDTH / 2
    upright = Rod.rectangular(1.0, THICKNESS, WIDTH, 7850.0, 210e9, 0.3)
    assert upright.radius == WIDTH / 2
    assert Rod.tube(1.0, 0.02, 0.012, 1000.0, 1e7, 0.4).radius == 0.01


def test_bending_about_n_strains_the_thickness_and_about_b_the_width():
    curvature = 3.0
    bend = np.array([[0, curvature, 0], [0, 0, curvature], [0, -curvature, curvature]])
    axial = STRIP.section.surface_strain(bend)[:, 0]
    np.testing.assert_allclose(axial, curvature * np.array(
        [THICKNESS / 2, WIDTH / 2, (THICKNESS + WIDTH) / 2]))


def test_a_round_section_has_no_preferred_axis():
    wire = Rod.circular(1.0, 0.004, 7850.0, 210e9, 0.3)
    bend = 3.0 * np.array([[0, 1, 0], [0, 0, 1], [0, 0.6, -0.8]])
    np.testing.assert_allclose(wire.section.surface_strain(bend)[:, 0], 3.0 * 0.002)
    twisted = wire.section.surface_strain([[-2.0, 0, 0]])
    np.testing.assert_allclose(twisted, [[0, 2.0 * 0.002]])


@pytest.mark.parametrize('axis', [1, 2])
def test_yield_begins_where_the_surface_reaches_the_stress(axis):
    bend = np.zeros((1, 3))
    bend[0, axis] = STRIP.yield_curvature[axis - 1]
    strain = STRIP.section.surface_strain(bend)[0, 0]
    assert strain * STRIP.section.youngs_modulus == pytest.approx(400e6)


def test_torsion_yields_where_the_shear_does():
    bend = np.array([[STRIP.yield_torsion, 0, 0]])
    shear = STRIP.section.surface_strain(bend)[0, 1] * STRIP.section.shear_modulus
    assert shear == pytest.approx(400e6 / np.sqrt(3))
