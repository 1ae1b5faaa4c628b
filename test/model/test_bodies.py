# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles: what is accepted, and that what is checked is what is used."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import (
    Box,
    Capsule,
    CutOut,
    Cylinder,
    InvalidTask,
    Limits,
    Plane,
    Pose,
    Sheet,
    Sphere,
    Uncertainty,
)

PLATE = Pose.looking_along((0.1, 0.2, 0.3), (1.0, 2.0, 0.5))


def rolled(angle, y=0.0, z=0.0):
    """Return a pose in the plate, rolled about its normal."""
    turn = Rotation.from_rotvec([angle, 0, 0]).as_matrix()
    return Pose.from_rotation(PLATE.position + PLATE.rotation @ (0, y, z), PLATE.rotation @ turn)


@pytest.mark.parametrize(('cutout', 'fits'), [
    (CutOut(rolled(0.0), width=0.5, height=0.05), False),
    (CutOut(rolled(0.0), width=0.05, height=0.5), False),
    (CutOut(rolled(0.0), width=0.19, height=0.09), True),
    (CutOut(rolled(0.0), width=0.2, height=0.1), True),
    (CutOut(rolled(np.pi / 2), width=0.19, height=0.09), False),
    (CutOut(rolled(np.pi / 2), width=0.09, height=0.19), True),
    (CutOut(rolled(np.pi / 4), width=0.08, height=0.06), True),
    (CutOut(rolled(np.pi / 4), width=0.09, height=0.07), False),
    (CutOut(rolled(0.0, 0.06), width=0.09, height=0.02), False),
    (CutOut(rolled(0.0, 0.05), width=0.09, height=0.02), True),
    (CutOut(rolled(0.3, 0.05), radius=0.049), True),
    (CutOut(rolled(0.3, 0.05), radius=0.051), False)])
def test_a_cutout_lies_in_its_sheet_with_all_its_corners(cutout, fits):
    if fits:
        assert Sheet(PLATE, 0.2, 0.1, cutouts=[cutout]).cutouts == (cutout,)
    else:
        with pytest.raises(InvalidTask, match=r'Sheet.cutouts\[0\].*width of 0.2 m and height'):
            Sheet(PLATE, 0.2, 0.1, cutouts=[cutout])


@pytest.mark.parametrize('scale', [1e-4, 1.0, 1e3])
def test_nothing_hangs_on_the_size_of_the_world(scale):
    Capsule((0, 0, 0), (1e-3 * scale, 0, 0), 1e-3 * scale)
    pose = Pose((scale, scale, scale), (0, 0, 0, 1))
    Sheet(pose, 0.2 * scale, 0.2 * scale, cutouts=[CutOut(pose, radius=0.1 * scale)])
    with pytest.raises(InvalidTask, match='middle plane'):
        Sheet(pose, 0.2 * scale, 0.2 * scale, cutouts=[
            CutOut(Pose((1.001 * scale, scale, scale), (0, 0, 0, 1)), radius=0.05 * scale)])
    np.testing.assert_allclose(Plane((0, 0, 0), (0, 0, 1e-30)).normal, (0, 0, 1))


@pytest.mark.parametrize(('kind', 'given'), [
    (Plane, ((0, 0, 0), (0, 0, 1))), (Sphere, ((0, 0, 0), 0.1)),
    (Capsule, ((0, 0, 0), (1, 0, 0), 0.1)), (Cylinder, ((0, 0, 0), (1, 0, 0), 0.1)),
    (Box, (PLATE, (1, 1, 1))), (Sheet, (PLATE, 0.2, 0.1))])
def test_friction_gives_no_energy(kind, given):
    assert kind(*given, friction=0.0).friction == 0
    with pytest.raises(InvalidTask, match=f'{kind.__name__}.friction = -0.01'):
        kind(*given, friction=-0.01)


def test_what_is_checked_is_what_is_used():
    third = Fraction(1, 3)
    assert isinstance(CutOut(PLATE, radius=third).radius, float)
    assert isinstance(Limits(linear_speed=third).linear_speed, float)
    assert isinstance(Limits(linear_jerk=third).linear_jerk, float)
    assert isinstance(Uncertainty(mass=third).mass, float)
    for make in (lambda: CutOut(PLATE, radius='1.0'), lambda: Limits(linear_speed='1.0'),
                 lambda: Uncertainty(mass='1.0'), lambda: Limits(angular_jerk=True)):
        with pytest.raises(InvalidTask, match='expected a number'):
            make()


# ---- sheets: their cut-outs lie in them, flat and inside the border -------------------------


TILTED = Pose((0.1, -0.2, 0.3), (0.2, -0.1, 0.4, 0.8))


def hole(across=(0.0, 0.0), off=0.0, tilt=(0.0, 0.0, 0.0), **size):
    """Return a CutOut at `across` in the plate, `off` it, turned by `tilt` (all plate axes)."""
    center = TILTED.position + TILTED.rotation @ [off, *across]
    turn = Rotation.from_rotvec(tilt).as_matrix()
    return CutOut(Pose.from_rotation(center, TILTED.rotation @ turn), **(size or {'radius': 0.02}))


def plate(cutout):
    return Sheet(TILTED, 0.4, 0.2, 1e-3, cutout)


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
        plate(CutOut(TILTED))
