# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Points that a tracker did not see, but carried along with those that it saw.

A tracker with a node for each place of a DLO knows no gaps: where the DLO is hidden it goes on with
the last shape that it saw, moved like the rest. Such nodes look like observations and are none.
What gives them away is that they do not move against each other: each point that is seen has noise
of its own, so distances between two of them change from cloud to cloud; those between carried ones
do not. That needs no model of the DLO, and no stated noise: distances are compared with those of
the same two clouds that do change.
"""

import numpy as np

from dlo_planner.model.arrays import Bools, Floats

# of the median change of all distances: two points that were seen change their distance by less in
# one case of a hundred, two that were carried by rounding errors. A factor of three either way
# changes which chances are taken for a body, not which bodies are found.
_RIGID = 0.02
_LEAST_BODY = 4     # points: fewer are congruent by chance
_OF_ALL = 0.1       # of the points: so many partners a carried one has at least
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
    pairs = ~np.eye(len(points), dtype=bool)
    same = pairs & (changes <= _RIGID * np.median(changes[pairs]))
    body = ~none
    least = max(_LEAST_BODY - 1, int(np.ceil(_OF_ALL * len(points))))
    while body.any():  # each point of a body has partners in the body
        left = body & (same[:, body].sum(axis=1) >= least)
        if (left == body).all():
            break
        body = left
    return none if body.mean() > _MOST_OF_ALL else body


def _distances(points: Floats) -> Floats:
    """Return the distances (m, m) between points (m, 3)."""
    result: Floats = np.linalg.norm(points[:, None] - points, axis=2)
    return result
