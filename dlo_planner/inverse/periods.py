"""How long the slowest vibration of a DLO takes, about."""

import numpy as np

from dlo_planner.model.rod import Rod


def slowest_period(rod: Rod) -> float:
    """Return the period (s) of the slowest vibration of a Rod held at one end, about.

    As if it hung straight and weightless; a tip mass counts wholly, its own mass for a quarter.
    Shape and weight change it (`Shape.modes`).
    """
    s = np.linspace(0, rod.length, 33)
    mass = rod.length * rod.masses_per_length(s).mean() / 4 + rod.tip_mass
    return float(2 * np.pi * np.sqrt(max(mass, 1e-12) * rod.length**3
                                     / (3 * min(rod.stiffness[1:]))))
