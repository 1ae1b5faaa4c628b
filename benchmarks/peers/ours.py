# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The package itself, by the accuracy that is asked for."""

import numpy as np

from benchmarks.cases import turned, wire
from dlo_planner import DirectSimulator

NAME = 'dlo_planner'
LADDER = (3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6)


def prepare(case, accuracy):
    """Return a function that returns (s, (n, 2) positions) of each pose, or None."""
    simulator = DirectSimulator(wire(tip_mass=case.tip_mass), accuracy=accuracy)
    poses = [turned(angle) for angle in case.angles]

    def run():
        shapes = simulator.track(poses)
        if not all(shape.converged for shape in shapes):
            return None
        return [(shape.s, shape.positions[:, [0, 2]] - np.array([0.0, 1.0])) for shape in shapes]

    return run
