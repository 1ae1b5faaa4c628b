# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What moves through the material is seen, on whichever side of zero rounding puts an end."""

import numpy as np
import pytest

from dlo_planner import CutOut, Pose, Sheet
from dlo_planner.energy.ccd import sweeps_through
from dlo_planner.energy.scene import build_scene

HOLES = tuple(CutOut(Pose.looking_along((0, y, 0), (1, 0, 0)), radius=0.05) for y in (0.0, 0.2))
SHEET = Sheet(Pose.looking_along((0, 0, 0), (1, 0, 0)), 1.0, 1.0, 0.0, HOLES)


def straight(tip):
    """Return the nodes of a straight DLO of 1 m along x, by its end."""
    return np.linspace((-1, 0, 0), (0, 0, 0), 9) + tip


@pytest.mark.parametrize('end', [0.0, 1e-17, -1e-17, 3e-16, -3e-16])
@pytest.mark.parametrize(('tip', 'through'), [
    ((0.1, 0.0, 0.0), False), ((0.1, 0.03, 0.0), False), ((-0.1, 0.2, 0.0), False),
    ((0.1, 0.2, 0.0), True), ((0.1, 0.1, 0.0), True), ((0.0, 0.03, 0.01), False)])
def test_an_end_in_the_plane_of_a_hole(end, tip, through):
    scene = build_scene([SHEET], 1e-3)
    lengths, strains = np.full(8, 1 / 8), np.zeros((8, 3))
    rotations = np.tile(np.eye(3), (9, 1, 1))
    old, new = straight((end, 0, 0)), straight(tip)
    assert sweeps_through(scene, lengths, strains, rotations, old, rotations, new) == through
