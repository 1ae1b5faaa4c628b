# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rods in random grippers: is the answer a minimum, and is its error what it says?

python test/random_rods.py [how many] [seed]

SciPy judges: its boundary value solver on the Kirchhoff equations finds the equilibrium next to the
answer, and Jacobi's condition, integrated from the free end, tells whether that is a minimum.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from kirchhoff import equilibrium, is_minimum  # noqa: E402

from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402

DISCRETIZATIONS = [{'basis': 'local', 'n_elements': n} for n in (32, 64, 128)] + [
    {'n_elements': 64, 'n_terms': 6}, {}, {'n_elements': 128, 'n_terms': 20},
    {'basis': 'fourier', 'n_terms': 16}]
_EVERY = 15      # of the rods have their errors looked at
_SOFT = 100.0    # w L^3 / EI beyond which seven meshes of 32 to 128 elements are too coarse
_EXACT = 1e-7    # of the length: SciPy's solutions are not asked for errors of this size


def random_rod(rng, softest=1e5):
    """Return a Rod of 1 m and a gripper's Pose, any of them."""
    load = np.exp(rng.uniform(np.log(0.1), np.log(softest)))  # w L^3 / EI
    ratio = np.exp(rng.uniform(0, np.log(1e3)))
    stiffness = (1.0, ratio) if rng.random() < 0.5 else (ratio, 1.0)
    turns = 2 * np.pi * rng.uniform(-3, 3, 3) * (rng.random(3) < 0.5)  # several, or none
    rod = Rod(1.0, load / 9.81, stiffness, np.exp(rng.uniform(np.log(0.1), np.log(10))),
              natural_curvature=tuple(turns[1:]), natural_twist=turns[0])
    return rod, Pose(rng.normal(size=3), rng.normal(size=4))


def verdict(rod, gripper):
    """Return 'a minimum', or what is wrong with the shape found."""
    shape = DirectSimulator(rod).solve(gripper)
    if not shape.converged:
        return 'not called converged'
    try:
        true = equilibrium(rod, gripper, shape, tol=1e-7)
    except AssertionError:
        return 'no equilibrium of SciPy'
    if not error_of(shape, true) < 10 * shape.error_estimate:
        return 'far from the true rod'
    return 'a minimum' if is_minimum(rod, true) else 'a saddle'


def error_of(shape, true):
    """Return the largest distance (m) of a Shape's nodes from a solution of `equilibrium`."""
    return np.linalg.norm(shape.positions - true(shape.s)[:3].T, axis=1).max()


def error_ratios(rod, gripper):
    """Return error estimate over true error of each discretization, nan where it is another shape.

    A fine one only tells SciPy which equilibrium is meant.
    """
    fine = DirectSimulator(rod, accuracy=1e-4, basis='local').solve(gripper)
    true, ratios = equilibrium(rod, gripper, fine, tol=1e-9), []
    for options in DISCRETIZATIONS:
        shape = DirectSimulator(rod, **options).solve(gripper)
        error = error_of(shape, true)
        ratios.append(shape.error_estimate / error if 20 * _EXACT < error < 0.1 else np.nan)
    return ratios


def main():
    """Print how many ended in a minimum, and how the error estimates compare with the errors."""
    given = [int(value) for value in sys.argv[1:]]
    number, seed = (given + [600, 0][len(given):])[:2]
    rng, count, ratios = np.random.default_rng(seed), Counter(), []
    for index in range(number):
        what = verdict(*random_rod(rng))
        count[what] += 1
        if what != 'a minimum':
            print(f'{index}: {what}')
        if index % _EVERY == 0:
            ratios.append(error_ratios(*random_rod(rng, _SOFT)))
    print(', '.join(f'{number} {what}' for what, number in sorted(count.items())))
    found = np.array(ratios)[np.isfinite(ratios)]
    low, high = np.quantile(found, [0.005, 0.995])
    print(f'{found.size} errors of {len(ratios)} rods: estimate / error {found.min():.2f} to '
          f'{found.max():.2f}, 99 % from {low:.2f} to {high:.2f}')


if __name__ == '__main__':
    main()
