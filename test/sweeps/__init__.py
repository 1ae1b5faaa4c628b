# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random tasks by the hundred, each judged by something that shares no code with the planner.

`python test/sweeps KIND` runs one kind (KINDS in `__main__.py`); tests take single tasks.
"""

from time import process_time
from typing import NamedTuple

import numpy as np

from dlo_planner import Infeasible, Rod

MASS = 0.05  # kg/m


class Outcome(NamedTuple):
    """What came of a task: 'kind' or 'kind: more'; CPU time, s; error estimate over true error."""

    what: str
    seconds: float = np.nan
    ratio: float = np.nan


def timed(compute, *arguments, **options):
    """Return what a function returns, or its Infeasible; and its CPU time, s."""
    begun = process_time()
    try:
        found = compute(*arguments, **options)
    except Infeasible as error:
        found = error
    return found, process_time() - begun


def random_rod(rng):
    """Return a Rod of 1 m: round, flat, bent, or bent, twisted and with a weight."""
    kind = rng.integers(4)
    stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
    if kind == 0:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 if kind >= 2 else np.zeros(2)
    return Rod(1.0, MASS, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
               natural_curvature=tuple(bent),
               natural_twist=rng.normal() * 0.5 if kind == 3 else 0.0,
               tip_mass=rng.uniform(0, 0.02) if kind == 3 else 0.0)
