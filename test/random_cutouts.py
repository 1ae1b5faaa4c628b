# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random cut-outs for random DLOs: planned and replayed, or refused and the refusal confirmed.

python test/random_cutouts.py [how many] [seed] [number of depths]
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from hanging import no_start, no_way  # noqa: E402
from steps import leaps  # noqa: E402
from tally import arguments, tally, timed  # noqa: E402

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
)

DEEPEST = 0.95  # m
MASS = 0.05  # kg/m


def random_task(rng):
    """Return a Rod and a CutOut: round, flat, bent, or bent, twisted and with a weight."""
    kind = rng.integers(4)
    stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
    if kind == 0:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 if kind >= 2 else np.zeros(2)
    rod = Rod(1.0, MASS, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
              natural_curvature=tuple(bent),
              natural_twist=rng.normal() * 0.5 if kind == 3 else 0.0,
              tip_mass=rng.uniform(0, 0.02) if kind == 3 else 0.0)
    return rod, CutOut(Pose.looking_along(rng.normal(size=3), rng.normal(size=3)))


def outcome(rod, cutout, basis, number=20):
    """Return 'replayed', 'confirmed', or what is wrong; and the CPU time of planning, s.

    Args:
        number: of depths
    """
    direct = DirectSimulator(rod, basis=basis, n_elements=64)
    depths = np.linspace(0, DEEPEST, number)
    plan, seconds = timed(lambda: InverseSimulator(direct).thread(cutout, depths=depths))
    if isinstance(plan, Infeasible):
        if confirmed(direct, cutout, depths, plan):
            return 'confirmed', seconds
        return f'refused for nothing: {plan.constraint}: {plan}', seconds
    return ('leaps' if leaps(plan) else replayed(direct, cutout, plan)), seconds


def replayed(direct, cutout, plan):
    """Return 'replayed', or what is wrong when the gripper moves as planned."""
    for depth, shape in zip(plan.depths, direct.track(plan.grippers), strict=True):
        axes, position = shape.frame_at(1 - depth)
        if not shape.converged:
            return f'not converged: at depth {depth:g}'
        if np.linalg.norm(position - cutout.center) > 1e-6:
            return f'misses: at depth {depth:g}'
        if np.linalg.norm(axes[:, 0] - cutout.normal) > 1e-6:
            return f'oblique: at depth {depth:g}'
    return 'replayed'


def confirmed(direct, cutout, depths, error):
    """Whether there is no way to the waypoint, among all ways in which the DLO can hang."""
    gets_there = falls_into(direct)
    given = direct.rod, np.array([0, 0, -9.81 * MASS]), cutout.normal
    if error.waypoint == 0:
        return no_start(*given, gets_there)
    return no_way(*given, 1 - depths[:error.waypoint + 1], gets_there)


def falls_into(direct):
    """Return a function: whether the DLO, set down, falls into a shape with frames (n, 3, 3)."""
    def gets_there(frames):
        shape = direct.solve(Pose.from_rotation((0, 0, 0), frames[0]))
        return np.abs(shape.frames[-1] - frames[-1]).max() < 0.02

    return gets_there


def main():
    """Print how many were replayed, how many refusals were confirmed, and everything else."""
    number, seed, depths = arguments(200, 0, 20)
    rng = np.random.default_rng(seed)
    tally(outcome(*random_task(rng), ('local', 'chebyshev')[index % 2], depths)
          for index in range(number))


if __name__ == '__main__':
    main()
