# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Equations 15 to 17 of the paper as printed, against the exact arcs used here."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner.geometry.basis import from_components
from dlo_planner.geometry.kinematics import forward_kinematics

STRAINS = np.array([[2.0, 3.0, -4.0]])  # torsion, curvature about n, about b


def printed(steps):
    """Return the free end: Eq. 16 for the rotation over ds, Eq. 17 and 15 as sums."""
    (direction, amount, torsion), ds = from_components(STRAINS)[0], 1.0 / steps
    turn = (Rotation.from_rotvec([direction, 0, 0]) * Rotation.from_rotvec([0, amount * ds, 0])
            * Rotation.from_rotvec([-direction, 0, 0]) * Rotation.from_rotvec([torsion * ds, 0, 0]))
    frame, end = np.eye(3), np.zeros(3)
    for _ in range(steps):
        end = end + frame[:, 0] * ds
        frame = frame @ turn.as_matrix()
    return end


def exact():
    rotations, positions = np.empty((2, 3, 3)), np.empty((2, 3))
    forward_kinematics(np.ones(1), STRAINS, np.eye(3), rotations, positions, np.empty((1, 7)))
    return positions[-1]


def test_they_are_of_first_order_and_one_exact_arc_is_their_limit():
    off = [np.linalg.norm(printed(steps) - exact()) for steps in (64, 256, 1024, 4096)]
    assert off[0] > 0.01
    np.testing.assert_allclose(np.array(off[:-1]) / off[1:], 4.0, rtol=0.05)
    extrapolated = (4 * printed(4096) - printed(1024)) / 3
    assert extrapolated == pytest.approx(exact(), abs=1e-6)
