# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""PyElastica: explicit steps of a Cosserat rod, damped until it hangs still.

Ten times as thick and a ten-thousandth as stiff, with the same EI and the same weight: an explicit
method could not follow the stretching of copper. That changes the shape by less than 1e-4 m.
"""

from functools import partial

import numpy as np

from benchmarks.peers.reference import BENDING, GRAVITY, LENGTH, WEIGHT

try:
    import elastica as ea
except ImportError:
    ea = None

NAME = 'PyElastica (explicit, damped until still)'
LADDER = (20, 40) if ea else ()
_RADIUS = 5e-3
_STILL = 1e-5  # m/s
_LONGEST = 8.0  # s, simulated


def prepare(case, rung):
    """Return a function that returns (s, (n, 2) positions) of each pose, or None."""
    return partial(_run, case, rung)


def _run(case, n):
    """Return (s, (n + 1, 2) positions) of a single pose, or None."""
    if len(case.angles) > 1 or case.tip_mass:
        return None  # one pose takes as long as all of the others' cases
    area, inertia = np.pi * _RADIUS**2, np.pi * _RADIUS**4 / 4
    young, density = BENDING / inertia, WEIGHT / GRAVITY / area

    class System(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    system = System()
    angle = np.radians(case.angles[0])
    rod = ea.CosseratRod.straight_rod(
        n, np.zeros(3), np.array([np.cos(angle), 0, np.sin(angle)]), np.array([0.0, 1.0, 0.0]),
        LENGTH, _RADIUS, density, youngs_modulus=young, shear_modulus=young / 2.68)
    step = 0.4 * min(_RADIUS / np.sqrt(young / 2.68 / density),
                     LENGTH / n / np.sqrt(young / density))
    system.append(rod)
    system.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,),
                                constrained_director_idx=(0,))
    system.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0, 0, -GRAVITY]))
    system.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=4.0,
                             time_step=step)
    system.finalize()
    stepper, time = ea.PositionVerlet(), np.float64(0.0)
    while time < _LONGEST:
        for _ in range(2000):
            time = stepper.step(system, time, np.float64(step))
        if np.abs(rod.velocity_collection).max() < _STILL:
            return [(np.linspace(0, LENGTH, n + 1), rod.position_collection[[0, 2]].T.copy())]
    return None
