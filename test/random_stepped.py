# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rods whose properties jump: is the answer as accurate as it says, and as asked for?

python test/random_stepped.py [how many] [seed]
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from stepped import random_stepped  # noqa: E402
from tally import arguments  # noqa: E402

from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402

WAYS = [{}, {'accuracy': 1e-5}, {'n_elements': 64}, {'basis': 'local', 'n_elements': 50}]
SAMPLES = np.linspace(0, 1, 41)


def looked_at(rng):
    """Return what is wrong with each way to solve one random rod, and the ratios of errors."""
    true, gripper = random_stepped(rng), Pose((0, 0, 0), rng.normal(size=4))
    rod = Rod(1.0, true.of(true.mass, scalar=True), true.of(true.stiffness[:, 1:]),
              true.of(true.stiffness[:, 0], scalar=True),
              natural_curvature=true.of(true.natural[:, 1:]),
              natural_twist=true.of(true.natural[:, 0], scalar=True))
    for options in WAYS:
        simulator = DirectSimulator(rod, load=true.of(true.load), **options)
        shape = simulator.solve(gripper)
        if not shape.converged:
            yield 'not converged', np.nan
            continue
        try:
            exact = true.shape(gripper, shape.frames[-1], SAMPLES)
        except AssertionError:
            yield 'without reference', np.nan
            continue
        off = np.linalg.norm(shape.positions_at(SAMPLES) - exact, axis=1).max()
        ratio = shape.error_estimate / off
        kept = simulator.accuracy is None or off <= simulator.accuracy
        what = 'good' if kept and ratio > 0.1 or off < 1e-8 else (
            'accuracy missed' if not kept else 'estimate too small')
        yield what, ratio if off > 1e-8 else np.nan


def main():
    """Print how many answers are good, and how estimates compare with errors."""
    number, seed = arguments(200, 0)
    rng, count, ratios = np.random.default_rng(seed), Counter(), []
    for index in range(number):
        for options, (what, ratio) in zip(WAYS, looked_at(rng), strict=True):
            count[what] += 1
            ratios.append(ratio)
            if what != 'good':
                print(f'{index} {options}: {what}, estimate / error {ratio:.3g}', flush=True)
    print(', '.join(f'{number} {what}' for what, number in sorted(count.items())))
    found = np.array(ratios)[np.isfinite(ratios)]
    print(f'estimate / error {found.min():.2f} to {found.max():.2f}, median {np.median(found):.2f}')


if __name__ == '__main__':
    main()
