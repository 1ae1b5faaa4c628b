# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random pairs of cut-outs for random DLOs: planned and replayed, or refused and confirmed.

python test/random_pairs.py [how many] [seed] [number of depths]
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from hanging import directions_in_first, no_start  # noqa: E402
from random_cutouts import DEEPEST, MASS, falls_into, random_task  # noqa: E402
from steps import leaps  # noqa: E402
from tally import arguments, tally, timed  # noqa: E402

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
)

_HIT = 1e-6  # m
_GRIDS = 2500, 10000  # points: a coarse one shows starts that are only near what is asked for


def random_pair(rng):
    """Return a Rod and two CutOuts, 0.1 to 0.5 m apart, that face along the way between them."""
    rod, first = random_task(rng)
    way = rng.normal(size=3)
    way *= rng.uniform(0.1, 0.5) / np.linalg.norm(way)
    return rod, *(CutOut(Pose.looking_along(center, way))
                  for center in (first.center, first.center + way))


def distance(shape, point):
    """Return how far the DLO is from a point, m: sampled, and ever closer where it is nearest."""
    s = np.linspace(0, shape.s[-1], 201)
    while s[1] - s[0] > 1e-9:
        best = np.argmin(np.linalg.norm(shape.positions_at(s) - point, axis=1))
        s = np.linspace(s[max(best - 1, 0)], s[min(best + 1, s.size - 1)], 21)
    return np.linalg.norm(shape.positions_at(s[10:11])[0] - point)


def outcome(rod, first, second, basis, number=20):
    """Return 'replayed', 'confirmed', or what is wrong; and the CPU time of planning, s.

    Args:
        number: of depths
    """
    direct, depths = DirectSimulator(rod, basis=basis), np.linspace(0, DEEPEST, number)
    plan, seconds = timed(lambda: InverseSimulator(direct).thread_two(first, second,
                                                                      depths=depths))
    if isinstance(plan, Infeasible):
        if confirmed(direct, first, second, plan):
            return 'confirmed', seconds
        return f'refused for nothing?: {plan.constraint}: {plan}; {plan.amount:.3g}', seconds
    return ('leaps' if leaps(plan) else replayed(direct, first, second, plan)), seconds


def confirmed(direct, first, second, error):
    """Whether no stable shape passes both, or the DLO begins with none that leads there.

    It begins along the direction in which it is to pass the first one.
    """
    given = direct.rod, np.array([0, 0, -9.81 * MASS])
    for grid in _GRIDS:
        directions = directions_in_first(*given, first, second, grid)
        if error.waypoint == 0:
            directions = [one for one in directions if not no_start(
                *given, one / np.linalg.norm(one), falls_into(direct))]
        if len(directions) == 0:
            return True
    return False


def replayed(direct, first, second, plan):
    """Return 'replayed', or what is wrong when the gripper moves as planned."""
    apart = np.linalg.norm(second.center - first.center)
    reached = False
    for depth, shape in zip(plan.depths, direct.track(plan.grippers), strict=True):
        if not shape.converged:
            return f'not converged: at depth {depth:g}'
        axes, position = shape.frame_at(1 - depth)
        if np.linalg.norm(position - first.center) > _HIT:
            return f'misses the first: at depth {depth:g}'
        if axes[:, 0] @ first.normal <= 0:
            return f'passes the first backwards: at depth {depth:g}'
        hit = depth > apart and distance(shape, second.center) < _HIT
        if reached and not hit:
            return f'leaves the second: at depth {depth:g}'
        reached = hit
    return 'replayed' if reached else 'never comes to the second'


def main():
    """Print how many were replayed, how many refusals were confirmed, and everything else."""
    number, seed, depths = arguments(100, 0, 20)
    rng = np.random.default_rng(seed)
    tally(outcome(*random_pair(rng), ('local', 'chebyshev')[index % 2], depths)
          for index in range(number))


if __name__ == '__main__':
    main()
