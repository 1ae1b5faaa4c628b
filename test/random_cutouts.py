"""Random cut-outs for random DLOs: planned and replayed, or refused and the refusal confirmed.

python test/random_cutouts.py [how many] [seed]
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from hanging import no_start, no_way  # noqa: E402

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Pose,
    Rod,
)

DEPTHS = np.linspace(0, 0.95, 20)
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


def outcome(rod, cutout, basis):
    """Return 'replayed', 'confirmed', or what is wrong."""
    direct = DirectSimulator(rod, basis=basis)
    try:
        plan = InverseSimulator(direct).thread(cutout, depths=DEPTHS)
    except Infeasible as error:
        return 'confirmed' if confirmed(direct, cutout, error) else f'refused for nothing: {error}'
    for depth, shape in zip(DEPTHS, direct.track(plan.grippers), strict=True):
        axes, position = shape.frame_at(1 - depth)
        if np.linalg.norm(position - cutout.centre) > 1e-6:
            return f'misses at depth {depth}'
        if np.linalg.norm(axes[:, 0] - cutout.normal) > 1e-6:
            return f'oblique at depth {depth}'
    return 'replayed'


def confirmed(direct, cutout, error):
    """Whether there is no way to the waypoint, among all ways in which the DLO can hang."""
    def gets_there(frames):
        shape = direct.solve(Pose.from_rotation((0, 0, 0), frames[0]))
        return np.abs(shape.frames[-1] - frames[-1]).max() < 0.02

    given = direct.rod, np.array([0, 0, -9.81 * MASS]), cutout.normal
    if error.waypoint == 0:
        return no_start(*given, gets_there)
    return no_way(*given, 1 - DEPTHS[:error.waypoint + 1], gets_there)


def main():
    """Print how many were replayed, how many refusals were confirmed, and everything else."""
    given = [int(value) for value in sys.argv[1:]]
    number, seed = (given + [200, 0][len(given):])[:2]
    rng, count = np.random.default_rng(seed), Counter()
    for index in range(number):
        task = random_task(rng)
        what = outcome(*task, ('local', 'chebyshev')[index % 2])
        count[what.split(':')[0]] += 1
        if what not in ('replayed', 'confirmed'):
            print(f'{index}: {what}')
    print(', '.join(f'{number} {what}' for what, number in sorted(count.items())))


if __name__ == '__main__':
    main()
