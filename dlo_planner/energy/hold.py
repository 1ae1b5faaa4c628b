"""A second grip at the free end: some points fixed to it are held where they should be.

Three points (the end itself, one farther along t and one out along n) hold its pose, the first
alone its position. Each is a spring with a multiplier (augmented Lagrangian, Nocedal and Wright,
ch. 17.3): the minimiser's outer loop adjusts the multipliers until the points are exact, and then
they are the reaction.
"""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.record import Record, makes


class Hold(Record):
    """P points of the far end and their targets; none if the end is free.

    Attributes:
        offset: (P, 3) m, in the frame of the far end
        target: (P, 3) m, world axes, relative to the gripper
        free: (3,) unit vector along which the points may slide; zero if they may not
        multiplier: (P, 3) N
        stiffness: N/m
    """

    offset: np.ndarray
    target: np.ndarray
    free: np.ndarray
    multiplier: np.ndarray
    stiffness: float


@makes(Hold)
@kernel
def _new_hold(offset, target, free, multiplier, stiffness):
    return Hold(offset, target, free, multiplier, stiffness)


@kernel
def miss(hold, p, rotation, position, away, arm):
    """Fill how far, away (3,), point p is from its target, and its arm (3,) from the far end."""
    slide = 0.0
    for i in range(3):
        arm[i] = (rotation[i, 0] * hold.offset[p, 0] + rotation[i, 1] * hold.offset[p, 1]
                  + rotation[i, 2] * hold.offset[p, 2])
        away[i] = position[i] + arm[i] - hold.target[p, i]
        slide += away[i] * hold.free[i]
    for i in range(3):
        away[i] -= slide * hold.free[i]


@kernel
def add_hold(hold, rotation, position, attached):
    """Fill the tip's part of `attached`; return the potential in J.

    Args:
        rotation: (3, 3), position: (3,) of the free end
    """
    energy = 0.0
    away, arm, pull = np.empty(3), np.empty(3), np.empty(3)
    moves, part = np.empty((3, 6)), np.empty((3, 6))
    attached.tip_force[:] = 0.0
    attached.tip_moment[:] = 0.0
    attached.tip_first[:] = 0.0
    attached.tip_matrix[:] = 0.0
    for p in range(hold.offset.shape[0]):
        miss(hold, p, rotation, position, away, arm)
        for i in range(3):
            # a multiplier has no part along the free direction: `away` has none
            pull[i] = hold.stiffness * away[i] + hold.multiplier[p, i]
            energy += away[i] * (hold.multiplier[p, i] + 0.5 * hold.stiffness * away[i])
        for i in range(3):
            attached.tip_force[i] += pull[i]
            j, k = (i + 1) % 3, (i + 2) % 3
            attached.tip_moment[i] += arm[j] * pull[k] - arm[k] * pull[j]
            for j in range(3):
                attached.tip_first[i, j] += pull[i] * arm[j]
        # the point moves by (rotation, displacement) of the end; held: but for the free direction
        for i in range(3):
            for j in range(3):
                moves[i, j] = 0.0
                moves[i, 3 + j] = 1.0 if i == j else 0.0
        moves[0, 1], moves[0, 2] = arm[2], -arm[1]
        moves[1, 0], moves[1, 2] = -arm[2], arm[0]
        moves[2, 0], moves[2, 1] = arm[1], -arm[0]
        for j in range(6):
            slide = (hold.free[0] * moves[0, j] + hold.free[1] * moves[1, j]
                     + hold.free[2] * moves[2, j])
            for i in range(3):
                part[i, j] = hold.stiffness * (moves[i, j] - slide * hold.free[i])
        for i in range(6):
            for j in range(6):
                attached.tip_matrix[i, j] += (moves[0, i] * part[0, j] + moves[1, i] * part[1, j]
                                              + moves[2, i] * part[2, j])
    return energy
