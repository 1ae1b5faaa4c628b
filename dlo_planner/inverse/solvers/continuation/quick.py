# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A way is looked for with a simulator that is quick, whatever the accuracy asked for.

A refusal costs the same at any accuracy then; only the plan itself is made as accurate as asked.
"""

from dataclasses import replace

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.pose import Pose

_ROUGH = 2e-3       # of the length: accuracy of a search
_CHEAP = 130        # nodes: a simulator with more, or with an accuracy, is too slow for a search
_ELEMENTS = 32      # of a shape on the grid
_GETS_THERE = 0.05  # of a unit vector: the same shape, as far as the grid can tell
_ANY = Pose.looking_along((0, 0, 0), (1, 0, 0))


def quick_simulator(simulator):
    """Return a DirectSimulator of the same DLO that is quick, for searches; itself if it is."""
    around = simulator.surroundings
    quick = simulator.mesh.s.size <= _CHEAP if simulator.accuracy is None else (
        simulator.accuracy >= 0.5 * _ROUGH * around.rod.length)
    if quick:
        return simulator
    return DirectSimulator(around.rod, accuracy=_ROUGH * around.rod.length, gravity=around.gravity,
                           load=around.load, point_loads=around.point_loads)


def grid_nodes(simulator):
    """Return nodes (N + 1,) for the grid's shapes, about _ELEMENTS elements."""
    s = simulator.discretization(_ANY, None).s
    return s[np.unique(np.linspace(0, s.size - 1, min(s.size, _ELEMENTS + 1)).astype(int))]


def gets_there(simulator, gripper, end, initial=None):
    """Whether the DLO comes by itself into the shape whose free end has the frame `end` (3, 3).

    Parameters
    ----------
    gripper
        Pose.
    initial
        Shape before. If None, the DLO is set down in its natural shape.
    """
    there = (simulator.solve(gripper) if initial is None
             else simulator.track([gripper], initial=initial)[0])
    return there.converged and np.abs(there.frames[-1] - end).max() < _GETS_THERE


def thinned(asked, most):
    """Return a task with `depths` and a `brief` at `most` of its depths, its steps not reported.

    The task itself, if it has no more.
    """
    if len(asked.depths) <= most:
        return asked
    some = np.unique(np.linspace(0, len(asked.depths) - 1, most).astype(int))
    return replace(asked, depths=asked.depths[some], brief=asked.brief.silent())
