# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches -> geometry_msgs/WrenchStamped."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, vector
from dlo_planner.model.pose import Pose
from msg_helpers.poses import header


def wrench_in(frame: Pose, at: Pose, wrench: ArrayLike) -> Floats:
    """Return a wrench (6,) by the axes of a frame, its moment about the frame's origin.

    Parameters
    ----------
    frame : Pose
    at : Pose
        Its origin is the point about which the moment is given.
    wrench : array_like, shape (6,)
        Force (N) and moment (N m), world axes.
    """
    given = vector('wrench', wrench, 6)
    arm = instance('at', at, Pose).position - instance('frame', frame, Pose).position
    moment = given[3:] + np.cross(arm, given[:3])
    return np.concatenate([given[:3] @ frame.rotation, moment @ frame.rotation])


def wrench_msg(wrench: ArrayLike, frame_id: str, stamp: Time | None = None) -> WrenchStamped:
    """Return the message of force (N) and moment (N m) (6,) by the axes of `frame_id`."""
    a, b, c, x, y, z = vector('wrench', wrench, 6).tolist()
    return WrenchStamped(header=header(frame_id, stamp), wrench=Wrench(
        force=Vector3(x=a, y=b, z=c), torque=Vector3(x=x, y=y, z=z)))
