# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The wire in its plane, to 1e-11: its equation integrated from the free end by SciPy.

EI phi'' = W(s) sin phi, with W the weight beyond s, phi the angle from straight down. The free
end's angle is what is sought; it is followed from the weightless wire, so the branch is that of a
wire that was bent slowly.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

LENGTH, DIAMETER, DENSITY, YOUNG, GRAVITY = 1.0, 1e-3, 8960.0, 110e9, 9.81
WEIGHT = DENSITY * np.pi * DIAMETER**2 / 4 * GRAVITY  # N/m
BENDING = YOUNG * np.pi * DIAMETER**4 / 64            # N m^2
_STEPS = 20


@dataclass(frozen=True)
class Case:
    """A motion of the gripper in a plane; each shape is the start of the next one.

    Attributes:
        angles: degrees above the level
        tip_mass: kg
    """

    name: str
    angles: tuple[float, ...]
    tip_mass: float = 0.0


CASES = (Case('A: level', (0.0,)), Case('B: level, 1 kg at the tip', (0.0,), 1.0),
         Case('C, up to 80 degrees in 9 poses', tuple(np.arange(0.0, 81.0, 10.0))))


class Reference:
    """The true shapes of a Case; a call gives (n, 2) x and z relative to the gripper at s (n,)."""

    def __init__(self, case: Case):
        self._curves, before = [], 0.0
        tips = [np.log(np.pi / 2)] * 2
        for load in np.linspace(0, 1, _STEPS + 1)[1:] ** 2:  # nearly a straight line in its root
            tips.append(_tip(0.0, case.tip_mass, load, 2 * tips[-1] - tips[-2]))
        tip = tips[-1]
        for angle in np.radians(case.angles):
            for way in np.linspace(before, angle, 11)[1:] if angle != before else [angle]:
                tip = _tip(way, case.tip_mass, 1.0, tip)
            before = angle
            self._curves.append(_integrated(tip, case.tip_mass, 1.0, dense=True).sol)

    def __call__(self, pose: int, s: np.ndarray) -> np.ndarray:
        """Return (n, 2) m of a pose."""
        curve = self._curves[pose]
        return curve(LENGTH - np.asarray(s))[2:].T - curve(LENGTH)[2:]


def _integrated(tip, tip_mass, load, dense=False):
    """Integrate angle above the vertical, moment, x, z from the free end, over L - s.

    `tip` is the logarithm of the first: a heavy wire ends within 1e-18 of the vertical.
    """
    def slope(back, y):
        beyond = load * (WEIGHT * back + tip_mass * GRAVITY)
        return [-y[1] / BENDING, -beyond * np.sin(y[0]), -np.sin(y[0]), np.cos(y[0])]

    return solve_ivp(slope, (0, LENGTH), [np.exp(tip), 0.0, 0.0, 0.0], method='DOP853', rtol=1e-12,
                     atol=[1e-40, 1e-40, 1e-13, 1e-13], dense_output=dense)


def _tip(gripper, tip_mass, load, guess):
    """Return the logarithm of the free end's angle that meets the gripper's, from a guess."""
    def miss(tip):
        return _integrated(tip, tip_mass, load).y[0, -1] - gripper - np.pi / 2

    found = root_scalar(miss, x0=guess, x1=guess - 1e-3, xtol=1e-12, rtol=1e-13)
    curve = _integrated(found.root, tip_mass, load)
    bent_one_way = (curve.y[1] <= 0).all() and curve.y[0, -1] < np.pi  # the others have loops
    if not found.converged or abs(curve.y[0, -1] - gripper - np.pi / 2) > 1e-9 or not bent_one_way:
        raise FloatingPointError(f'no plain shape at a gripper angle of {gripper:g} rad')
    return found.root
