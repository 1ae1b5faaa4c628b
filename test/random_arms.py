# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random motions of robot arms, found again from the tool's way: python test/random_arms.py [n].

The joints of Panda, UR5 and Kinova go a random smooth way within their limits and clear of
themselves; only the way of the tool is given. Printed: how many are found, from the present joint
positions and without them, and by how much the tool is off, multiplied out of the URDF by hand.
"""

import sys
from pathlib import Path
from time import process_time

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]
from robot_arms import kinova, panda, placed_by_hand, timed, ur5  # noqa: E402

from dlo_planner import Infeasible  # noqa: E402
from dlo_planner.arm import joint_trajectory  # noqa: E402
from dlo_planner.model.pose import angle_between  # noqa: E402


def random_way(arm, rng):
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


def main(count=20):
    """Print a row for each arm."""
    rng = np.random.default_rng(12)
    for name, arm in (('Panda', panda()), ('UR5', ur5()), ('Kinova j2s6s200', kinova())):
        found, worst, seconds, refused = [0, 0], np.zeros(2), [], []
        for _ in range(count):
            ways = random_way(arm, rng)
            trajectory = timed([arm.pose(one) for one in ways])
            for k, current in enumerate((ways[0], None)):
                started = process_time()
                try:
                    made = joint_trajectory(trajectory, arm, current=current)
                except Infeasible as error:
                    refused.append(error.constraint)
                    continue
                seconds.append(process_time() - started)
                found[k] += 1
                worst = np.maximum(worst, off_by_hand(made, trajectory, arm))
        print(f'{name}: {found[0]} and {found[1]} of {count} found, off by {worst[0]:.1e} m and '
              f'{worst[1]:.1e} rad at most, {np.median(seconds):.2f} s of CPU (median), '
              f'{max(seconds):.2f} s (longest); refused: {refused}')


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
