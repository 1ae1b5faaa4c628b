# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How often what `fit_rod` says of its errors is true, in repeated experiments.

python test/fit_coverage.py [repeats] [case ...]
"""

import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parent.parent)]

from dlo_planner import DirectSimulator, Pose, Rod, Uncertainty, fit_rod  # noqa: E402
from dlo_planner.identify import Observation  # noqa: E402

TRUE = Rod(1.0, 0.07, 0.02, 0.015, natural_curvature=(0.3, -0.2))
TURNS = [0, 0, 0], [0, 0.5, 0.3], [1.2, -0.7, 0.2], [0.5, -1.5, 0]
S = np.linspace(0.1, 1.0, 10)
NOISE, POSITION, ROTATION = 1e-3, 2e-3, 0.01
CASES = {  # arc lengths known, errors of the gripper, more arguments
    'with s': (True, False, {}), 'without s': (False, False, {}),
    'with s, gripper': (True, True, {}), 'without s, gripper': (False, True, {}),
    'with s, gripper, noise known': (True, True, {'noise': NOISE}),
    'with s, outliers': (True, False, {'loss': 'soft_l1'}),
    'with s, prior': (True, False, {'prior': Uncertainty(bending_stiffness=0.05)})}


def experiment(rng, known, gripper, more, points=S):
    """Return errors (3,) of EI and of the natural curvature, in stated deviations."""
    center = np.exp(0.05 * rng.normal()) if 'prior' in more else 1.5
    seen = []
    for turn in TURNS:
        pose = Pose((0, 0, 1), Rotation.from_rotvec(turn).as_quat())
        true = pose
        if gripper:
            off = Rotation.from_rotvec(ROTATION * rng.normal(size=3)).as_matrix()
            true = Pose.from_rotation(pose.position + POSITION * rng.normal(size=3),
                                      off @ pose.rotation)
        at = DirectSimulator(TRUE).solve(true).positions_at(points)
        at = at + NOISE * rng.normal(size=at.shape)
        if 'loss' in more:
            at[rng.random(len(at)) < 0.05] += 0.05 * rng.normal(size=3)
        seen.append(Observation(pose, at, points if known else None))
    errors = {'gripper_position': POSITION, 'gripper_rotation': ROTATION} if gripper else {}
    guess = Rod(1.0, 0.07, 0.02 * center, 0.015)
    fit = fit_rod(guess, seen, ('bending_stiffness', 'natural_curvature'), **errors, **more)
    stiffness = (np.log(fit.values['bending_stiffness'][0] / 0.02)
                 * fit.values['bending_stiffness'][0] / fit.deviations['bending_stiffness'][0])
    bend = ((np.array(fit.values['natural_curvature']) - TRUE.natural_curvature)
            / fit.deviations['natural_curvature'])
    return np.array([stiffness, *bend])


def coverage(case, repeats, seed=0):
    """Return the errors (repeats, 3) in stated deviations."""
    rng = np.random.default_rng(seed)
    return np.array([experiment(rng, *CASES[case]) for _ in range(repeats)])


def main():
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for case in sys.argv[2:] or CASES:
        begun = perf_counter()
        errors = coverage(case, repeats)
        within = [100 * (np.abs(errors) < bound).mean() for bound in (1.0, 1.96)]
        print(f'{case:30s} 68 %: {within[0]:5.1f}   95 %: {within[1]:5.1f}   '
              f'mean {errors.mean():+.2f}   {perf_counter() - begun:.0f} s', flush=True)


if __name__ == '__main__':
    main()
