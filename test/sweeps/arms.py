# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random motions of Panda, UR5 and Kinova, found again from the tool's way alone.

The joints go a random smooth way within their limits and clear of themselves. By how much the tool
is off is multiplied out of the URDF by hand.
"""

import numpy as np
from robot_arms import kinova, panda, placed_by_hand, timed, ur5

from dlo_planner import Infeasible
from dlo_planner.arm import joint_trajectory
from dlo_planner.model.pose import angle_between
from sweeps import Outcome
from sweeps import timed as measured

_OFF = 1e-4  # m and rad


def random_joints(arm, rng):
    """Return joint positions (9, m) on a way that the arm can go."""
    lower, upper = np.maximum(arm.lower, -3), np.minimum(arm.upper, 3)
    while True:
        begin = rng.uniform(0.9 * lower + 0.1 * upper, 0.1 * lower + 0.9 * upper)
        first, second = rng.uniform(-0.5, 0.5, (2, begin.size))
        parts = np.linspace(0, 1, 9)[:, None]
        ways = begin + parts * first + parts**2 * second
        within = (ways > lower).all() and (ways < upper).all()
        clear = within and all(arm.collision.distances(one).min() > 0.01 for one in ways)
        if clear and all(_stiffness(arm, one) > 0.05 for one in ways):
            return ways


def _stiffness(arm, positions):
    """Return the smallest singular value of the Jacobian: 0 where the arm is stretched out."""
    return np.linalg.svd(arm.chain.off(positions, *arm.chain.placement(positions))[1],
                         compute_uv=False)[-1]


def off_by_hand(made, trajectory, arm):
    """Return m and rad by which the tool is off at most, at the points and in the middles."""
    times = np.sort(np.concatenate([made.times, 0.5 * (made.times[1:] + made.times[:-1])]))
    worst = np.zeros(2)
    for gripper, one in zip(trajectory.at(times)[0], made.at(times)[0], strict=True):
        tool = placed_by_hand(arm.urdf, arm.tool_link, dict(zip(arm.joints, one, strict=True)))
        worst = np.maximum(worst, (np.linalg.norm(tool[:3, 3] - gripper.position),
                                   angle_between(tool[:3, :3], gripper.rotation)))
    return worst


def found_again(name, trajectory, arm, current):
    """Return the Outcome: 'found', 'refused', or what is wrong."""
    made, seconds = measured(joint_trajectory, trajectory, arm, current=current)
    if isinstance(made, Infeasible):
        return Outcome(f'refused, {made.constraint}: {name}', seconds)
    off = off_by_hand(made, trajectory, arm)
    return Outcome('found' if off.max() < _OFF else f'off: {name} by {off} m and rad', seconds)


def arms(number, seed):
    """Yield the Outcomes of random ways, from the present joint positions and without them."""
    rng = np.random.default_rng(seed)
    for name, arm in (('Panda', panda()), ('UR5', ur5()), ('Kinova', kinova())):
        for _ in range(number):
            joints = random_joints(arm, rng)
            trajectory = timed([arm.pose(one) for one in joints])
            for current in (joints[0], None):
                yield found_again(name, trajectory, arm, current)
