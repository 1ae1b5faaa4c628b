# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The deepest plan of a threading that cannot reach all requested depths."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dlo_planner.errors import Infeasible
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.plan import Plan

_HALVINGS = 6  # of the depth between the last waypoint that is reached and the next one


def deepest(planned: Callable[[Floats], Plan], depths: Floats) -> Plan:
    """Return the Plan of the depths that can be reached, and of the deepest one found.

    Its `fraction` is the deepest depth as a part of the last requested one.

    Parameters
    ----------
    planned : callable
        Function of depths (n,) m that returns the Plan, or raises Infeasible.
    depths : ndarray, shape (n,)
        Depths in m.

    Raises
    ------
    Infeasible
        The first depth cannot be reached.
    """
    try:
        return planned(depths)
    except Infeasible as error:
        count = 0 if error.plan is None else len(error.plan)
        if not count:
            raise
    good, bad, plan = depths[:count], depths[count], None
    for _ in range(_HALVINGS):
        tried = np.append(good, 0.5 * (good[-1] + bad))
        try:
            plan, good = planned(tried), tried
        except Infeasible:
            bad = tried[-1]
    plan = planned(good) if plan is None else plan
    return replace(plan, fraction=float(good[-1] / depths[-1]))
