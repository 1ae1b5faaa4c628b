# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of a plan's gripper, and which of them are leaps."""

import numpy as np
from scipy.spatial.transform import Rotation


def steps(plan, length=1.0):
    """Return turns (n - 1,) in rad and displacements of the gripper, of the length."""
    turns = [Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude()
             for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)]
    places = np.array([gripper.position for gripper in plan.grippers])
    return np.array(turns), np.linalg.norm(np.diff(places, axis=0), axis=1) / length


def leaps(plan, length=1.0):
    """Return whether a step is larger than any that the depth explains."""
    turns, shifts = steps(plan, length)
    deeper = np.diff(plan.depths) / length
    return (turns > 0.06 + 11 * deeper).any() or (shifts > 0.03 + 3.5 * deeper).any()
