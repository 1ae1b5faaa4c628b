# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random bores for random DLOs: inserted without a leap of the gripper, or refused and why.

python test/random_insertions.py [how many] [seed]
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from tally import arguments, tally, timed  # noqa: E402

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
    replay,
)

HOW = ({'basis': 'local'}, {'basis': 'chebyshev'}, {'accuracy': 1e-5})
_STEP = 0.11  # rad plus part of the length: more at once is a leap if closer depths do not help


def random_task(rng):
    """Return Rod and bore: round, flat, bent, or bent and twisted, with weights or without."""
    kind = rng.integers(4)
    stiffness = np.exp(rng.uniform(np.log(0.1), np.log(2), 2))
    if kind == 0:
        stiffness[1] = stiffness[0]
    bent = rng.normal(size=2) * 0.6 if kind >= 2 else np.zeros(2)
    weights = rng.random() < 0.5
    rod = Rod(1.0, 0.05, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
              natural_curvature=tuple(bent), natural_twist=rng.normal() * 0.5 if kind == 3 else 0,
              tip_mass=rng.uniform(0, 0.05) if weights else 0.0,
              point_masses=((rng.uniform(0.3, 0.9), 0.02),) if weights and rng.random() < 0.5
              else ())
    direction = rng.normal(size=3)
    return rod, CutOut(Pose.looking_along(rng.normal(size=3), direction))


def steps(plan):
    """Return turn plus shift of the gripper between each two waypoints (n - 1,), rad and m."""
    return np.array([Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude()
                     + np.linalg.norm(b.position - a.position)
                     for a, b in zip(plan.grippers, plan.grippers[1:], strict=False)])


def leaps(inverse, bore, plan, depths):
    """Return whether a step of a Plan stays as long with eight times the depths."""
    if steps(plan).max() < _STEP:
        return False
    finer = np.interp(np.arange(8 * (len(depths) - 1) + 1) / 8, np.arange(len(depths)), depths)
    return steps(inverse.insert(bore, depths=finer)).max() > max(_STEP, 0.3 * steps(plan).max())


def outcome(rod, bore, how):
    """Return 'inserted' or what is wrong; and the CPU time of planning, s."""
    direct = DirectSimulator(rod, **how)
    inverse, depths = InverseSimulator(direct), np.linspace(0, 0.95, 12)
    plan, seconds = timed(lambda: inverse.insert(bore, depths=depths))
    if isinstance(plan, Infeasible):
        return f'refused, {plan.constraint}: {plan}; {plan.amount:.3g}', seconds
    if not np.isin(depths, plan.depths).all() or plan.stability.min() < -1e-3:
        return 'incomplete', seconds
    if leaps(inverse, bore, plan, depths):
        return f'leaps: {steps(plan).max():.3g}', seconds
    report = replay(direct, plan)
    if not report.converged or report.position_error > 1e-5 or report.misalignment > 1e-5:
        return f'not replayed: {report}', seconds
    return 'inserted', seconds


def main():
    """Print how many were inserted, how many refused and why, and everything else."""
    number, seed = arguments(100, 0)
    rng = np.random.default_rng(seed)
    tally(outcome(*random_task(rng), HOW[index % 3]) for index in range(number))


if __name__ == '__main__':
    main()
