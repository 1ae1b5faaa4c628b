# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Motions whose true course is known from wires that were not written with the package.

python test/motion_cases.py    prints how well they are met, and what that costs
"""

import sys
from pathlib import Path
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

sys.path[:0] = [str(Path(__file__).parent.parent), str(Path(__file__).parent)]

from planar_wires import Wire, links  # noqa: E402

from dlo_planner import DirectSimulator, Pose, Rod  # noqa: E402

LEVEL = Pose.identity()
DENSITY, STIFFNESS = 0.1, 0.05
# x and z of the tip in m at hundredths of a second, in benchmark C without damping: chains of 24
# and 48 bars (`planar_wires.links`), extrapolated
REFERENCE_C = {50: (0.64699, -0.40074), 100: (-0.99267, 0.11679),
               125: (0.65159, -0.38623), 150: (-0.18759, -0.39121)}


def rod(**more):
    return Rod(1.0, DENSITY, STIFFNESS, 0.04, **more)


def tilted(angle, place=(0.0, 0.0)):
    """Return a gripper turned by `angle` from x to z, at x, z."""
    return Pose((place[0], 0, place[1]), Rotation.from_euler('y', -angle).as_quat())


def turn(angle):
    """Return angle, rate and acceleration of a turn that begins and ends smoothly in 1 s."""
    def at(t):
        x = min(t, 1.0)
        return (angle * x**3 * (10 - 15 * x + 6 * x**2), angle * 30 * x**2 * (1 - x) ** 2,
                angle * 60 * x * (1 - x) * (1 - 2 * x))
    return at


def shaken(t, hertz=20.0, size=0.002):
    """Return place, velocity and acceleration of a gripper that begins to shake along z."""
    w = 2 * np.pi * hertz
    up, rate, change = size * (1 - np.cos(w * t)), size * w * np.sin(w * t), w * w * np.cos(w * t)
    return np.array([0, up]), np.array([0, rate]), np.array([0, size * change])


def still(t):
    return np.zeros(2), np.zeros(2), np.zeros(2)


# angle and place of the gripper, tip mass, s, interval s; all begin straight and level, at rest
CASES = {'swing': (lambda t: (0.0, 0.0, 0.0), still, 0.0, 0.8, 0.01),
         'whirl': (turn(np.pi), still, 0.0, 1.0, 0.01),
         'tip mass': (turn(0.7), still, 0.1, 1.0, 0.01),
         'shake': (lambda t: (0.0, 0.0, 0.0), shaken, 0.0, 0.2, 0.004)}


def motion_of(case, **options):
    angle, place, mass, seconds, interval = CASES[case]
    n = round(seconds / interval)
    times = interval * np.arange(n + 1)
    thing = rod(tip_mass=mass)
    straight = DirectSimulator(thing, gravity=(0, 0, 0), **options).solve(LEVEL)
    grippers = [tilted(angle(t)[0], place(t)[0]) for t in times]
    return DirectSimulator(thing, **options).simulate(grippers, interval, straight)


def reference(case, bars=(12, 24)):
    """Return the tips of a chain with ever more bars, and how far they may be off, m."""
    angle, place, mass, seconds, interval = CASES[case]
    times = interval * np.arange(round(seconds / interval) + 1)
    wire = Wire(1.0, DENSITY, STIFFNESS, angle, place, mass)
    coarse, fine = (links(wire, times, np.zeros(n), 1e-7) for n in bars)
    return (4 * fine - coarse) / 3, np.linalg.norm(fine - coarse, axis=1).max() / 12


def tips(motion):
    return np.array([shape.positions[-1, [0, 2]] for shape in motion.shapes])


def wild_turn(seconds=1.5, **options):
    """Return the Motion of benchmark C's wire, turned by 180 degrees and back in 2 s, undamped."""
    wire = Rod.circular(1.0, 1e-3, 8960.0, 110e9, 0.34)
    times = 0.01 * np.arange(round(100 * seconds) + 1)
    grippers = [tilted(np.pi / 2 * (1 - np.cos(np.pi * t))) for t in times]
    return DirectSimulator(wire, **options).simulate(grippers, 0.01)


def _say(name, begun, motion, true, doubtful):
    seconds = process_time() - begun
    moved = motion.kinetic_energy.max() + np.ptp(motion.potential_energy)
    begun = process_time()
    estimate = motion.error_estimate[-1]
    estimating = process_time() - begun
    loss = motion.numerical_loss
    print(f'{name:10s} {motion.status} true error {1e3 * true:.3g} mm (known to '
          f'{1e3 * doubtful:.2g}), estimate {1e3 * estimate:.3g} mm, numerical loss '
          f'{100 * loss.min() / moved:.3g} to {100 * loss.max() / moved:.3g} % of the energy that '
          f'moves, {seconds:.2g} s, estimate {estimating:.2g} s')


def main():
    """Print the table."""
    for case in CASES:
        known, doubtful = reference(case, (16, 32))
        begun = process_time()
        motion = motion_of(case)
        _say(case, begun, motion, np.linalg.norm(tips(motion) - known, axis=1).max(), doubtful)
    begun = process_time()
    motion = wild_turn()
    at = list(REFERENCE_C)
    away = np.linalg.norm(tips(motion)[at] - list(REFERENCE_C.values()), axis=1)
    _say('C to 1.5 s', begun, motion, away.max(), 3e-4)
    begun = process_time()
    motion = wild_turn(2.0)
    print(f'C to 2 s: {motion.status} {motion.message}, at most '
          f'{motion.kinetic_energy.max():.3g} J of motion, numerical loss '
          f'{motion.numerical_loss.min():.2g} to {motion.numerical_loss.max():.2g} J, '
          f'{process_time() - begun:.2g} s')


if __name__ == '__main__':
    main()
