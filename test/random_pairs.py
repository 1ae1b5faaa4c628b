"""Random pairs of cut-outs for random DLOs: planned and replayed, or refused.

python test/random_pairs.py [how many] [seed]

Refusals are counted by their constraint, not confirmed.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from random_cutouts import random_task  # noqa: E402

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
)

DEPTHS = np.linspace(0, 0.95, 20)
_HIT = 1e-6  # m


def random_pair(rng):
    """Return a Rod and two CutOuts, 0.1 to 0.5 m apart, that face along the way between them."""
    rod, first = random_task(rng)
    way = rng.normal(size=3)
    way *= rng.uniform(0.1, 0.5) / np.linalg.norm(way)
    return rod, *(CutOut(Pose.looking_along(centre, way))
                  for centre in (first.centre, first.centre + way))


def distance(shape, point):
    """Return how far the DLO is from a point, m: sampled, and ever closer where it is nearest."""
    s = np.linspace(0, shape.s[-1], 201)
    while s[1] - s[0] > 1e-9:
        best = np.argmin(np.linalg.norm(shape.positions_at(s) - point, axis=1))
        s = np.linspace(s[max(best - 1, 0)], s[min(best + 1, s.size - 1)], 21)
    return np.linalg.norm(shape.positions_at(s[10:11])[0] - point)


def outcome(rod, first, second, basis):
    """Return 'replayed', the constraint of a refusal, or what is wrong."""
    direct = DirectSimulator(rod, basis=basis)
    try:
        plan = InverseSimulator(direct).thread_two(first, second, depths=DEPTHS)
    except Infeasible as error:
        return f'refused ({error.constraint})'
    apart = np.linalg.norm(second.centre - first.centre)
    reached = False
    for depth, shape in zip(DEPTHS, direct.track(plan.grippers), strict=True):
        if not shape.converged:
            return f'not converged at depth {depth:g}'
        if np.linalg.norm(shape.at(1 - depth).position - first.centre) > _HIT:
            return f'misses the first at depth {depth:g}'
        hit = depth > apart and distance(shape, second.centre) < _HIT
        if reached and not hit:
            return f'leaves the second at depth {depth:g}'
        reached = hit
    return 'replayed' if reached else 'never comes to the second'


def main():
    """Print how many were replayed, how many refused and why, and everything else."""
    given = [int(value) for value in sys.argv[1:]]
    number, seed = (given + [100, 0][len(given):])[:2]
    rng, count = np.random.default_rng(seed), Counter()
    for index in range(number):
        what = outcome(*random_pair(rng), ('local', 'chebyshev')[index % 2])
        count[what.split(' at depth')[0]] += 1
        if what != 'replayed':
            print(f'{index}: {what}')
    print(', '.join(f'{number} {what}' for what, number in sorted(count.items())))


if __name__ == '__main__':
    main()
