# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How deep a DLO lies in obstacles."""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.distance import signed_distance
from dlo_planner.energy.outline import node_gap, nodes_of, stretch
from dlo_planner.energy.rolling import nearest_inside
from dlo_planner.energy.scene import NODE_FACE, Scene
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats


@kernel
def depth(scene: Scene, lengths: Floats, strains: Floats, rotations: Floats,
          positions: Floats) -> float:
    """Return how deep in m the surface of a DLO lies in an obstacle, at most; 0 if it is clear.

    Args:
        strains: (N, 3), 1/m; rotations: (N + 1, 3, 3); positions: (N + 1, 3), m, relative to
            `scene.origin`
    """
    deepest = 0.0
    normal, hessian, offset, point = np.empty(3), np.empty((3, 3)), np.zeros(2), np.empty(3)
    for o in range(scene.kind.size):
        begin, end = nodes_of(scene, o, lengths.size)
        last = np.inf
        for k in range(begin, end + 1):
            gap = node_gap(scene, o, k, rotations, positions, offset, point, normal, hessian)
            if k > 0:
                deepest = max(deepest, -gap)
            e = k - 1
            # no point of an element is farther than half its length from one of its nodes
            if k > begin and scene.feature[o] != NODE_FACE and (
                    min(gap, last) - 0.5 * lengths[e] * stretch(scene, o, strains[e]) < -deepest):
                inside, _ = nearest_inside(scene, o, e, lengths, strains, rotations, positions,
                                           normal, hessian)
                deepest = max(deepest, -inside)
            last = gap
    return deepest


@kernel
def depth_of_point(scene: Scene, place: Floats) -> float:
    """Return how deep in m a place (3,), world, lies in an obstacle, at most; 0 if in none."""
    deepest = 0.0
    normal, hessian = np.empty(3), np.empty((3, 3))
    for o in range(scene.kind.size):
        deepest = max(deepest, -signed_distance(scene, o, place, normal, hessian))
    return deepest
