# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Sheets: their cut-outs lie in them, flat and inside the border."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import CutOut, InvalidTask, Pose, Sheet

PLATE = Pose((0.1, -0.2, 0.3), (0.2, -0.1, 0.4, 0.8))


def hole(across=(0.0, 0.0), off=0.0, tilt=(0.0, 0.0, 0.0), **size):
    """Return a CutOut at `across` in the plate, `off` it, turned by `tilt` (all plate axes)."""
    center = PLATE.position + PLATE.rotation @ [off, *across]
    turn = Rotation.from_rotvec(tilt).as_matrix()
    return CutOut(Pose.from_rotation(center, PLATE.rotation @ turn), **(size or {'radius': 0.02}))


def plate(cutout):
    return Sheet(PLATE, 0.4, 0.2, 1e-3, cutout)


@pytest.mark.parametrize('across', [(0.179, 0), (-0.179, 0), (0, 0.079), (0, -0.079),
                                    (0.179, -0.079)])
def test_up_to_the_border(across):
    assert plate(hole(across)).cutouts[0].radius == 0.02


@pytest.mark.parametrize('across', [(0.181, 0), (-0.181, 0), (0, 0.081), (0, -0.081), (0.25, 0),
                                    (0, -0.3)])
def test_not_beyond_the_border(across):
    with pytest.raises(InvalidTask, match=r'Sheet\.cutouts\[0\].*0\.4 m and height of 0\.2 m'):
        plate(hole(across))


@pytest.mark.parametrize('axis', [1, 2])
def test_flat_in_the_sheet(axis):
    tilt = np.zeros(3)
    tilt[axis] = 1e-3
    with pytest.raises(InvalidTask, match=r'cutouts\[0\].*normal'):
        plate(hole(tilt=tilt))
    tilt[axis] = 1e-8  # rounding
    plate(hole(tilt=tilt))
    plate(hole(tilt=(0.7, 0, 0), width=0.05, height=0.02))  # rolled in its plane
    turned = np.zeros(3)
    turned[axis] = np.pi  # and passed the other way
    plate(hole(tilt=turned))


def test_in_the_middle_plane():
    with pytest.raises(InvalidTask, match='middle plane'):
        plate(hole(off=1e-4))


def test_every_cutout_is_looked_at():
    with pytest.raises(InvalidTask, match=r'cutouts\[1\]'):
        plate([hole(), hole((0.3, 0))])
    with pytest.raises(InvalidTask, match='radius or width'):
        plate(CutOut(PLATE))
