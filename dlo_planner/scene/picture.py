# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A scene as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Obstacle, Plane
from dlo_planner.view.mpl import Frame, Stage
from dlo_planner.view.scene import cutout_primitives, obstacle_primitives

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AROUND = 0.5  # m, how much of planes is shown where there is nothing else
_NORMAL = 0.09  # of the extent: normals of cut-outs


def plot(obstacles: Sequence[Obstacle], cutouts: Sequence[CutOut], ax: Axes | None) -> Figure:
    """Return the Figure of obstacles and cut-outs in space, see `Scene.plot`."""
    solid = obstacle_primitives(one for one in obstacles if not isinstance(one, Plane))
    corners = [one.corners for one in solid]
    if not corners:
        places = [one.point for one in obstacles if isinstance(one, Plane)] or [
            one.center for one in cutouts] or [np.zeros(3)]
        corners = [np.array([place - _AROUND, place + _AROUND]) for place in places]
    points = np.vstack(corners)
    length = float(np.ptp(points, axis=0).max())
    # places beside it: what is flat is seen in space all the same, for its holes
    frame = Frame.of(ax, np.vstack([points, points.mean(axis=0) + 0.1 * length * np.eye(3)]))
    holes = cutout_primitives(cutouts, _NORMAL * length)
    Stage((), (), (), tuple(obstacles), length).set(frame, holes, corners)
    return frame.figure
