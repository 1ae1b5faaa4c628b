# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The slowest period of a DLO, roughly."""

from __future__ import annotations

import numpy as np

from dlo_planner.model.rod import Rod

_GAUSS = np.polynomial.legendre.leggauss(16)
_LIGHTEST = 1e-12  # kg: a DLO without mass has some period, too


def slowest_period(rod: Rod) -> float:
    """Return the period (s) of the slowest vibration of a Rod clamped at one end, roughly.

    As if it were straight and weightless (`Shape.modes` knows shape and weight). By Dunkerley's
    formula, which for an even stiffness is never below the period of such a rod: a mass at s counts
    as (s / L)^3 of it at the tip, and so the mass of a uniform rod counts a quarter.
    """
    x, weights = 0.5 * (_GAUSS[0] + 1), 0.5 * _GAUSS[1]
    mass = rod.length * float(weights @ (rod.masses_per_length(rod.length * x) * x**3))
    mass += rod.tip_mass + sum(kg * (s / rod.length) ** 3 for s, kg in rod.point_masses)
    return float(2 * np.pi * np.sqrt(max(mass, _LIGHTEST) * rod.length**3
                                     / (3 * min(rod.stiffness[1:]))))
