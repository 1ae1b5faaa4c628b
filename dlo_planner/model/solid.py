# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What obstacles are drawn with: bodies that RViz, browsers and physics engines know."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose


class Solid(NamedTuple):
    """A body that RViz, browsers and physics engines know: what obstacles are drawn with.

    Attributes
    ----------
    kind : str
        'box', 'ball' or 'cylinder' (flat ends, its axis along z).
    pose : Pose
        Pose of its center.
    size : (float, float, float)
        (3,) full sizes along the axes of the pose, m.
    """

    kind: str
    pose: Pose
    size: tuple[float, float, float]


def bar(start: Floats, end: Floats, radius: float) -> Solid:
    """Return the cylinder between two points (3,), m."""
    along = end - start
    pose = Pose.looking_along(0.5 * (start + end), along)
    return Solid('cylinder', Pose.from_rotation(pose.position, pose.rotation[:, [1, 2, 0]]),
                 (2 * radius, 2 * radius, float(np.linalg.norm(along))))


def ball(center: Floats, radius: float) -> Solid:
    """Return the ball around a point (3,), m."""
    return Solid('ball', Pose(center, (0.0, 0.0, 0.0, 1.0)), (2 * radius,) * 3)
