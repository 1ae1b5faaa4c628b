# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Searches use a quick simulator, whatever the accuracy of the plan.

A refusal then costs the same at any accuracy; only the plan itself has the accuracy of its
simulator.
"""


import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose

_ROUGH = 2e-3       # of the length: accuracy of a search
_CHEAP = 130        # nodes: a simulator with more, or with an accuracy, is too slow for a search
_ELEMENTS = 32      # of a shape on the grid
_GETS_THERE = 0.05  # of a unit vector: the same shape, as far as the grid can tell
_ANY = Pose.looking_along((0, 0, 0), (1, 0, 0))


def quick_simulator(simulator: DirectSimulator) -> DirectSimulator:
    """Return a DirectSimulator of the same DLO that is quick, for searches; itself if it is."""
    around = simulator.surroundings
    quick = simulator.mesh.s.size <= _CHEAP if simulator.accuracy is None else (
        simulator.accuracy >= 0.5 * _ROUGH * around.rod.length)
    if quick:
        return simulator
    return DirectSimulator(around.rod, accuracy=_ROUGH * around.rod.length, gravity=around.gravity,
                           load=around.load, point_loads=around.point_loads)


def grid_nodes(simulator: DirectSimulator) -> Floats:
    """Return nodes (N + 1,) for the grid's shapes, about _ELEMENTS elements."""
    s = simulator.discretization(_ANY, None).s
    some: Floats = s[np.unique(np.linspace(0, s.size - 1, min(s.size, _ELEMENTS + 1)).astype(int))]
    return some


def gets_there(simulator: DirectSimulator, gripper: Pose, end: Floats,
               initial: Shape | None = None) -> bool:
    """Whether the DLO itself takes the shape whose free end has the frame `end` (3, 3)."""
    shape = (simulator.solve(gripper) if initial is None
             else simulator.track([gripper], initial=initial)[0])
    return bool(shape.converged and np.abs(shape.frames[-1] - end).max() < _GETS_THERE)


def thinned(depths: Floats, most: int) -> Floats:
    """Return depths (n,), or `most` of them if there are more, spread evenly."""
    if len(depths) <= most:
        return depths
    some: Floats = depths[np.unique(np.linspace(0, len(depths) - 1, most).astype(int))]
    return some
