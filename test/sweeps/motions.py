# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Random motions, many of them extreme: how many cannot be simulated, and how long that takes.

Half have no damping, some a tip mass or are naturally bent.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, DirectSimulator, FarEnd, Plane, Pose, Rod, Sphere
from sweeps import Outcome, timed

# decimal logarithms of w L^3 / EI; a whip is moved four times as fast
SOFTNESS = {'soft': (2, 4.5), 'whip': (1, 4), 'held': (0.5, 4), 'contact': (0, 3),
            'held contact': (0.5, 2.5)}  # decimal logarithms
SPEED = {'soft': 0.6, 'whip': 2.0, 'held': 0.5, 'contact': 0.3, 'held contact': 0.25}
INSTANTS = 25


def random_rod(kind, rng):
    """Return a random Rod of a kind."""
    length, weight = 10 ** rng.uniform(-1, 1), 0.05
    stiffness = weight * 9.81 * length**3 / 10 ** rng.uniform(*SOFTNESS[kind])
    own = np.sqrt(length / 9.81)
    more = {'damping': (10 ** rng.uniform(-1, 1) / own, 10 ** rng.uniform(-4, -1.5) * own)
            if rng.random() < 0.5 else (0.0, 0.0)}
    if rng.random() < 0.3:
        more['tip_mass'] = weight * length * 10 ** rng.uniform(-1, 0.5)
    if rng.random() < 0.3:
        more['natural_curvature'] = tuple(rng.normal(0, 1 / length, 2))
    if 'contact' in kind:
        more['radius'] = 0.005 * length
    return Rod(length, weight, stiffness, stiffness * 10 ** rng.uniform(-1, 0.3), **more)


def smooth(size, t, rng):
    """Return (n, 3) random displacements that begin at rest."""
    out = np.zeros((t.size, 3))
    for _ in range(3):
        rate, phase, way = rng.uniform(1, 6), rng.uniform(0, 6.28), rng.normal(size=3) * size / 3
        out += way * (np.sin(rate * t + phase) - np.sin(phase)
                      - rate * t * np.cos(phase) * np.exp(-t))[:, None]
    return out


def below(along, length, rng):
    """Return a random obstacle below a DLO that is held along a direction (3,)."""
    drop, r, mu = (length * rng.uniform(0.05, 0.5), length * rng.uniform(0.05, 0.3),
                   rng.choice([0.0, 0.3]))
    center = along * length * rng.uniform(0.3, 0.8) - np.array([0, 0, drop + r])
    side = np.cross(along, [0, 0, 1]) * length
    return rng.choice([
        lambda: Plane((0, 0, -drop - 0.1 * length), (0, 0, 1), mu),
        lambda: Sphere(center, r, mu), lambda: Capsule(center - side, center + side, r, mu),
        lambda: Box(Pose(center, (0, 0, 0, 1)), (2 * r, 2 * r, 2 * r), mu)])()


def random_motion(kind, seed):
    """Return a simulator, Poses of the gripper, the time between them, s, and of far ends."""
    rng = np.random.default_rng([seed, list(SOFTNESS).index(kind)])
    rod = random_rod(kind, rng)
    length, speed = rod.length, SPEED[kind] * 10 ** rng.uniform(-0.5, 0.3)
    step = 0.04 if kind == 'whip' else 0.08  # of the time of a free fall
    t = step * np.arange(INSTANTS)
    places, turns = 0.25 * smooth(speed * length, t, rng), smooth(1.5 * speed, t, rng)
    base = (Rotation.from_euler('zy', [rng.uniform(0, 6), rng.uniform(-0.3, 0.6)])
            if 'contact' in kind else Rotation.from_rotvec(rng.normal(0, 1.5, 3)))
    along = base.apply([1, 0, 0])
    grippers = [Pose.from_rotation(place, (Rotation.from_rotvec(turn) * base).as_matrix())
                for place, turn in zip(places, turns, strict=True)]
    ends = None
    if 'held' in kind:
        away = along * length * rng.uniform(0.4, 0.9) + 0.1 * smooth(speed * length, t, rng)
        away *= np.minimum(1, 0.93 * length / np.linalg.norm(away, axis=1))[:, None]
        grip = str(rng.choice(['clamped', 'pinned', 'aligned']))
        ends = [FarEnd(Pose.from_rotation(place, (Rotation.from_rotvec(turn) * base).as_matrix()),
                       grip) for place, turn in zip(places + away, smooth(speed, t, rng),
                                                    strict=True)]
    around = [below(along, length, rng)] if 'contact' in kind else []
    direct = DirectSimulator(rod, n_elements=24, basis='local', obstacles=around)
    return direct, grippers, step * np.sqrt(length / 9.81), ends


def motions(number, seed):
    """Yield the Outcomes of a number of motions of each kind."""
    for kind in SOFTNESS:
        for one in range(seed, seed + number):
            direct, grippers, dt, ends = random_motion(kind, one)
            found, seconds = timed(direct.simulate, grippers, dt, far_ends=ends)
            what = str(found.status)
            yield Outcome(what if what == 'complete' else f'{what}: {kind} {one}: {found.message}',
                          seconds)
