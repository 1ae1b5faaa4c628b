# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What uncertainty leaves of the room in a hole: clearance less the miss that is to be expected."""

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.plan.goals import Through
from dlo_planner.uncertainty.state import PointSlopes


def miss_slopes(slopes: PointSlopes, goal: Through) -> tuple[Floats, Floats, Floats]:
    """Return by how much a Shape misses a point, (3,) m, and the derivatives (3, n) of that.

    They are across the DLO, which may pass elsewhere along itself; (3, 3) is what is across.
    """
    s, (off, tangent, _) = goal.nearest(slopes.shape)
    across = np.eye(3) - np.outer(tangent, tangent)
    return off, across @ slopes(np.array([s]))[0], across
