# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""`scipy.optimize.minimize` (BFGS with limited memory) on the energy of N arcs in the plane."""

from functools import partial

import numpy as np
from scipy.optimize import minimize

from benchmarks.peers.reference import BENDING, GRAVITY, LENGTH, WEIGHT

NAME = 'scipy.optimize L-BFGS-B (in the plane)'
LADDER = (8, 16, 32, 64, 128)


def prepare(case, rung):
    """Return a function that returns (s, (n, 2) positions) of each pose, or None."""
    return partial(_run, case, rung)


def _run(case, n):
    """Return (s, (n + 1, 2) positions) of each pose, or None."""
    h = LENGTH / n
    loads = np.full(n, WEIGHT * h)
    loads[-1] = 0.5 * WEIGHT * h + case.tip_mass * GRAVITY
    scale = np.sqrt(h / BENDING)  # of the unknowns, so that the elastic energy is |q|^2 / 2
    beyond = np.cumsum(loads[::-1])[::-1]
    q, shapes = np.zeros(n), []
    for angle in np.radians(case.angles):
        def energy(q, angle=angle):
            bend = scale * q
            middle = angle + np.cumsum(bend) - 0.5 * bend
            ratio = np.sinc(bend / (2 * np.pi))
            height = h * np.sin(middle) * ratio
            by_middle = beyond * h * np.cos(middle) * ratio
            by_bend = beyond * h * np.sin(middle) * _slope(bend)
            outer = np.cumsum(by_middle[::-1])[::-1]
            return (0.5 * q @ q + beyond @ height,
                    q + scale * (outer - 0.5 * by_middle + by_bend))

        found = minimize(energy, q, jac=True, method='L-BFGS-B',
                         options={'maxiter': 20000, 'maxfun': 50000, 'maxcor': 20,
                                  'ftol': 1e-16, 'gtol': 1e-7 * np.sqrt(BENDING)})
        q = found.x
        if np.abs(found.jac).max() > 1e-5 * max(1.0, np.linalg.norm(q)):
            return None
        bend = scale * q
        middle = angle + np.cumsum(bend) - 0.5 * bend
        chord = h * np.sinc(bend / (2 * np.pi))[:, None] * np.column_stack(
            [np.cos(middle), np.sin(middle)])
        shapes.append((np.linspace(0, LENGTH, n + 1),
                       np.vstack([[0, 0], np.cumsum(chord, axis=0)])))
    return shapes


def _slope(bend):
    """Return the derivative of sin(b / 2) / (b / 2) by b."""
    small = np.abs(bend) < 1e-3
    safe = np.where(small, 1.0, bend)
    return np.where(small, -bend / 12, (np.cos(safe / 2) - np.sinc(safe / (2 * np.pi))) / safe)
