# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random DLOs moved over random obstacles in long steps: does each fall say so?

python test/random_falls.py [how many scenes] [seed]

A way is made in steps of 0.01 to 0.2 of the length, and once more in steps a tenth as long. Where
neither says `jumped` both have to end in the same shape, within 0.01 of the length. What slides has
errors of the first order in the step: it is on the same branch ("slid") where steps a quarter as
long leave a part of the difference that such an error does.
"""

import sys
from pathlib import Path
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from random_contacts import distance  # noqa: E402
from random_friction import random_obstacle  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from tally import arguments, tally  # noqa: E402

from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402

HOW = ({}, {'basis': 'local'}, {'basis': 'local', 'n_elements': 32}, {'n_elements': 40})
LONG = 0.01, 0.2
PARTS, _STEPS = 10, 4
_SAME = 0.01
_SLID, _CUT = (0.02, 0.9), 0.05


def random_way(rng):
    """Return Rod, obstacle, step and the Poses of a way over it, the first above it."""
    while True:
        stiffness = np.exp(rng.uniform(np.log(0.05), np.log(2), 2))  # w L^3 / EI = 0.25 ... 10
        rod = Rod(1.0, 0.05, tuple(stiffness), np.exp(rng.uniform(np.log(0.05), 0)),
                  natural_curvature=tuple(0.6 * rng.normal(size=2) * (rng.random() < 0.5)),
                  radius=rng.choice([5e-4, 2e-3, 1e-2]))
        attitude = Rotation.from_euler('zyx', rng.uniform((-3, -0.5, -3), (3, 1.0, 3)))
        start = Pose((0, 0, 0), attitude.as_quat())
        hanging = DirectSimulator(rod, basis='local').solve(start)
        s = rng.uniform(0.3, 1.0)
        tangent = hanging.at(s).rotation[:, 0]
        normal = np.cross(np.cross(tangent, [0, 0, 1.0] + 0.3 * rng.normal(size=3)), tangent)
        normal /= np.linalg.norm(normal)
        obstacle = random_obstacle(rng, hanging.positions_at([s])[0]
                                   - (rod.radius + 0.005) * normal, normal, tangent,
                                   rng.choice([0.0, 0.2, 0.5]))
        step = np.exp(rng.uniform(*np.log(LONG)))
        poses, down = [start], normal
        for _ in range(_STEPS):
            aside = rng.normal(size=3)
            way = 0.7 * aside / np.linalg.norm(aside) - down
            turn = Rotation.from_rotvec(0.5 * step * rng.normal(size=3))
            poses.append(Pose(poses[-1].position + step * way / np.linalg.norm(way),
                              (turn * Rotation.from_quat(poses[-1].quaternion)).as_quat()))
            down = 0.3 * down
        places = np.concatenate([np.linspace(a.position, b.position, 20) for a, b in
                                 zip(poses, poses[1:], strict=False)])
        if distance(obstacle, places).min() > 2 * rod.radius:  # else the gripper would be in it
            return rod, obstacle, step, poses


def in_parts(one, other, number):
    """Return the Poses on the way from one to another, in steps of a part."""
    turn = Rotation.from_matrix(other.rotation @ one.rotation.T).as_rotvec()
    return [Pose.from_rotation(one.position + part * (other.position - one.position),
                               Rotation.from_rotvec(part * turn).as_matrix() @ one.rotation)
            for part in np.arange(1, number + 1) / number]


def _away(one, other):
    places = np.linspace(0.05, 1, 20)
    return np.linalg.norm(one.positions_at(places) - other.positions_at(places), axis=1).max()


def outcome(rod, obstacle, step, poses, how):
    """Return 'converged', 'away', or what is wrong with a way."""
    simulator = DirectSimulator(rod, obstacles=[obstacle], **how)
    long = short = simulator.solve(poses[0])
    touched = slid = False
    cuts = int(np.ceil(step / _CUT))  # that are made of a long step anyway
    for k, (begin, end) in enumerate(zip(poses, poses[1:], strict=False)):
        before, long = long, simulator.track([end], initial=long)[0]
        shapes = simulator.track(in_parts(begin, end, PARTS * cuts), initial=short)
        short = shapes[-1]
        if not long.converged or not all(shape.converged for shape in shapes):
            return f'not converged: {"long" if not long.converged else "short"} step {k}'
        touched |= any(bool(shape.contacts) for shape in (long, *shapes))
        if long.jumped or any(shape.jumped for shape in shapes):
            both = long.jumped and any(shape.jumped for shape in shapes)
            return 'jumped' if both else 'jumped in ' + ('long' if long.jumped else 'short') + (
                ' steps only')
        off, left = _away(long, short), 0.0
        if off > _SAME * rod.length:
            quarters = simulator.track(in_parts(begin, end, 4 * cuts), initial=before)
            left = _away(quarters[-1], short) / off
        if _SLID[0] < left < _SLID[1]:
            slid, short = True, long
        elif off > _SAME * rod.length:
            return (f'silent fall: off by {off:.3g} m, {left:.2g} of it in quarters, at step {k} '
                    f'of {step:.3g} m, '
                    f'{type(obstacle).__name__} with friction {obstacle.friction:g}, {how}')
    return 'slid' if slid else 'converged' if touched else 'away'


def ways(number, seed):
    """Yield outcome and CPU time of a number of ways."""
    for index in range(number):
        way, begun = random_way(np.random.default_rng((seed, index))), process_time()
        yield outcome(*way, HOW[index % len(HOW)]), process_time() - begun


def main():
    """Print how many ways are the same in long steps and in short ones, and everything else."""
    tally(ways(*arguments(150, 0)))


if __name__ == '__main__':
    main()
