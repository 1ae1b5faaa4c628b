# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points that a tracker did not see, but carried along with those that it saw.

A tracker with a node for each place of a DLO knows no gaps: where the DLO is hidden it goes on with
the last shape that it saw, moved like the rest. Such nodes look like observations and are none.
What gives them away is that they do not move against each other at all: each point that is seen
has noise of its own, so distances between two of them change from cloud to cloud, while those
between carried ones stay to the last digit. That needs no model of the DLO and no stated noise.

What it does not find: what is filled in with noise of its own, or bent while it is carried; clouds
whose points come in another order or number each time.
"""

import numpy as np

from dlo_planner.model.arrays import Bools, Floats

# of the largest coordinate, by which distances stay the same: 1 um of 1 m. Rounding of the 32-bit
# numbers of a message makes a tenth of it, noise of a camera a hundred times as much
_ROUNDING = 1e-6
_LEAST_BODY = 4     # points: fewer are congruent by chance
_OF_ALL = 0.1       # of the points, at least: a smaller body may be chance, and tells little
_MOST_OF_ALL = 0.9  # if more keep their distances nothing has moved, and nobody was deceived


def carried(before: Floats, points: Floats) -> Bools:
    """Return which points (m,) of a cloud are those of the one before, moved as one rigid body.

    Points (m, 3) are nodes in the same order in both; clouds of another size share no nodes. None
    is carried where hardly any distance has changed: a DLO at rest, seen without noise.
    """
    none = np.zeros(len(points), dtype=bool)
    if before.shape != points.shape or len(points) < _LEAST_BODY:
        return none
    changes = np.abs(_distances(points) - _distances(before))
    same = changes <= _ROUNDING * float(np.abs(points).max())
    least = max(_LEAST_BODY, int(np.ceil(_OF_ALL * len(points))))
    # the largest body whose points all keep their distances from each other: what has the fewest
    # partners in it leaves it, one after the other
    body, partners = ~none, same.sum(axis=1)
    while body.sum() >= least and partners[body].min() < body.sum():
        worst = np.flatnonzero(body)[partners[body].argmin()]
        body[worst] = False
        partners -= same[:, worst]
    return none if body.sum() < least or body.mean() > _MOST_OF_ALL else body


def _distances(points: Floats) -> Floats:
    """Return the distances (m, m) between points (m, 3)."""
    result: Floats = np.linalg.norm(points[:, None] - points, axis=2)
    return result
