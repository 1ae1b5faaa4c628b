# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""SciPy's `solve_bvp` in the plane, from the straight wire, then from the pose before."""

from functools import partial

import numpy as np
from scipy.integrate import solve_bvp

from benchmarks.peers.reference import BENDING, GRAVITY, LENGTH, WEIGHT

NAME = 'scipy solve_bvp (in the plane)'
LADDER = (1e-1, 1e-2, 1e-3, 1e-5, 1e-7)


def prepare(case, rung):
    """Return a function that returns (s, (n, 2) positions) of each pose, or None."""
    return partial(_run, case, rung)


def _run(case, tolerance):
    """Return (s, (n, 2) positions) of each pose, or None."""
    def slope(s, y):
        beyond = WEIGHT * (LENGTH - s) + case.tip_mass * GRAVITY
        return np.vstack([y[1] / BENDING, beyond * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    found, shapes = None, []
    for angle in np.radians(case.angles):
        s = np.linspace(0, LENGTH, 11) if found is None else found.x
        guess = np.zeros((4, s.size)) if found is None else found.y
        if found is None:
            guess[0], guess[2], guess[3] = angle, s * np.cos(angle), s * np.sin(angle)
        found = solve_bvp(
            slope, lambda first, last, a=angle: np.array([first[0] - a, last[1], *first[2:]]), s,
            guess, tol=tolerance, max_nodes=20000)
        if not found.success:
            return None
        shapes.append((found.x, found.y[2:].T))
    return shapes
