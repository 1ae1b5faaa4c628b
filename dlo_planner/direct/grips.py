# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where grips hold a DLO, and the straight way from there to where they are to."""

from __future__ import annotations

from typing import NamedTuple

from dlo_planner.direct.shape import Shape
from dlo_planner.geometry.so3 import partway
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Hold, Holds, posed
from dlo_planner.model.pose import Pose, pose_of
from dlo_planner.model.value import read_only


def between(one: Pose, other: Pose, fraction: float) -> Pose:
    """Return the Pose at `fraction` of the way: position linear, rotation about one fixed axis."""
    return pose_of(one.position + fraction * (other.position - one.position),
                   partway(one.rotation, other.rotation, float(fraction)))


class Grips(NamedTuple):
    """What holds a DLO: Pose of the gripper, Holds."""

    gripper: Pose
    holds: Holds = ()

    def towards(self, goal: Grips, fraction: float) -> Grips:
        """Return where grips are at a fraction of the straight way to `goal`, which holds as much.

        Their ways of holding are those of `goal`.
        """
        holds = tuple(posed(other, between(one.pose, other.pose, fraction))
                      for one, other in zip(self.holds, goal.holds, strict=True))
        return Grips(between(self.gripper, goal.gripper, fraction), holds)


def grips_at(shape: Shape, holds: Holds) -> Grips:
    """Return where a Shape has its gripper, and the places that Holds are to hold."""
    return Grips(shape.gripper, tuple(posed(hold, _place_of(shape, hold)) for hold in holds))


def _place_of(shape: Shape, hold: Hold) -> Pose:
    """Return the Pose of the DLO where something is to hold it."""
    if hold.s is None:
        return Pose.from_rotation(shape.positions[-1], shape.frames[-1])
    rotation, position = shape.frame_at(hold.s)
    return Pose.from_rotation(position, rotation)


def frame_inside(shape: Shape, s: float) -> tuple[Floats, Floats]:
    """Return axes (3, 3) and position (3,) of a Shape at `s` (m), read-only as those of nodes."""
    rotation, position = shape.frame_at(s)
    return read_only(rotation), read_only(position)
