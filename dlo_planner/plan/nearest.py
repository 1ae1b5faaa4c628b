# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO is nearest to each body of a scene, and how far away."""

from __future__ import annotations

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.energy.gap import (
    closest_point_in_element,
    node_gap,
    node_range,
    taper,
)
from dlo_planner.energy.scene import Scene
from dlo_planner.geometry.so3 import inner
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


def nearest(scene: Scene, shape: Shape) -> list[tuple[float, float, Floats]]:
    """Return [(gap in m, arc length in m, unit normal (3,))] of the DLO's nearest points."""
    s = np.array(shape.s)
    return [_nearest(scene, o, s, *shape.for_kernels) for o in range(scene.kind.size)]


@kernel
def _nearest(scene: Scene, o: int, s: Floats, lengths: Floats, strains: Floats, rotations: Floats,
             positions: Floats) -> tuple[float, float, Floats]:
    x, slope, bend, normal = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros(3)
    offset, last = np.zeros(2), np.empty(3)
    smallest, where = np.inf, 0.0
    begin, end = node_range(scene, o, positions.shape[0] - 1)
    for k in range(begin, end + 1):
        gap = node_gap(scene, o, k, rotations, positions, offset, x, slope, bend)
        if gap < smallest:
            smallest, where = gap, s[k]
            normal[:] = slope
        if k > begin:
            grows = taper(scene, o, k - 1) / lengths[k - 1]
            before = inner(last, rotations[k - 1, :, 0]) - grows
            behind = inner(slope, rotations[k, :, 0]) - grows
        last[:] = slope
        if k > begin and before < 0.0 < behind:
            gap, fraction = closest_point_in_element(scene, o, k - 1, lengths, strains, rotations,
                                                     positions, slope, bend)
            if gap < smallest:
                smallest, where = gap, s[k - 1] + fraction * lengths[k - 1]
                normal[:] = slope
    return smallest, where, normal
