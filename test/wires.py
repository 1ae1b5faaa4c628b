# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Wires that several tests hold, and a plan that several execute."""

from functools import cache

import numpy as np

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod


def copper_wire(**more):
    """Return the paper's: 1 m of copper, 1 mm thick; `more` are further arguments of the Rod."""
    return Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34, **more)


@cache
def threaded(length=1.0, diameter=1.5e-3):
    """Return the Plan, of 12 waypoints, that threads a copper wire by 0.95 of its length."""
    wire = Rod.circular(length, diameter, 8960.0, 110e9, 0.34)
    return InverseSimulator(DirectSimulator(wire)).thread(
        CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0))), depths=length * np.linspace(0, 0.95, 12))
