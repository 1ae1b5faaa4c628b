# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of three cut-outs for random DLOs: planned and replayed, or refused and why.

python test/random_sequences.py [how many] [seed] [number of depths]
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from random_cutouts import confirmed, random_task  # noqa: E402
from steps import leaps  # noqa: E402
from tally import arguments, tally, timed  # noqa: E402

from dlo_planner import CutOut, DirectSimulator, Infeasible, InverseSimulator, Pose  # noqa: E402

_DEEPEST = 0.8  # m


def random_sequence(rng):
    """Return a Rod and three CutOuts, 0.25 m apart, that face along a way that bends a little."""
    rod, first = random_task(rng)
    centers, way = [first.center], first.normal
    for _ in range(2):
        way = way + 0.4 * rng.normal(size=3)
        way /= np.linalg.norm(way)
        centers.append(centers[-1] + 0.25 * way)
    return rod, [CutOut(Pose.looking_along(center, way)) for center in centers]


def outcome(rod, cutouts, basis, number=100):
    """Return 'replayed', 'confirmed', or what is wrong; and the CPU time of planning, s.

    Args:
        number: of depths
    """
    direct, depths = DirectSimulator(rod, basis=basis), np.linspace(0, _DEEPEST, number)
    plan, seconds = timed(lambda: InverseSimulator(direct).thread_sequence(cutouts, depths=depths))
    if isinstance(plan, Infeasible):
        if plan.waypoint == 0 and confirmed(direct, cutouts[0], depths, plan):
            return 'confirmed', seconds  # it begins as a threading through the first one does
        return f'refused, {plan.constraint}: {plan}; {plan.amount:.3g}', seconds
    return ('leaps' if leaps(plan) else replayed(direct, plan)), seconds


def replayed(direct, plan):
    """Return 'replayed', or what is wrong when the gripper moves as planned."""
    for depth, planned, shape in zip(plan.depths, plan.shapes, direct.track(plan.grippers),
                                     strict=True):
        if not shape.converged:
            return f'not converged: at depth {depth:g}'
        samples = np.linspace(0, shape.s[-1], 33)
        off = np.abs(shape.positions_at(samples) - planned.positions_at(samples)).max()
        if off > 1e-6:
            return f'not replayed: off by {off:.2g} m at depth {depth:g}'
    return 'replayed'


def main():
    """Print how many were replayed, how many refused and why, and everything else."""
    number, seed, depths = arguments(16, 0, 100)
    rng = np.random.default_rng(seed)
    tally(outcome(*random_sequence(rng), ('local', 'chebyshev')[index % 2], depths)
          for index in range(number))


if __name__ == '__main__':
    main()
