# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics: joint positions for a placement of the tool link."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.arm.chain import Chain
from dlo_planner.model.arrays import Floats

CLOSE = 1e-9      # m and rad: placed
_REACHED = 1e-6   # m and rad: as good as placed, where rounding or a singularity ends the search
_DAMPING = 1e-3   # of the squared error, against singular Jacobians
_STEP = 0.5       # rad or m at most in one iteration
_COORDINATES = 6  # of the tool: an arm with more joints has a choice
_CENTERINGS = 0.5, 2.0, 0.0
_BORDER = 1e-3    # of a range: nearer to a limit counts as so near


Target = tuple[Floats, Floats]  # position (3,), rotation (3, 3)


@dataclass(frozen=True)
class Solved:
    """Joint positions (m,), and the displacement and rotation vector (6,) that are left."""

    positions: Floats
    off: Floats

    @property
    def reached(self) -> bool:
        """Whether the tool is where it should be, to 1e-6 m and rad."""
        return bool(np.abs(self.off).max() <= _REACHED)


def choices(chain: Chain) -> tuple[float, ...]:
    """Return how strongly the joints may be drawn to their middles, in rad per m and rad of way."""
    return _CENTERINGS if len(chain.names) > _COORDINATES else (0.0,)


def solve(chain: Chain, positions: Floats, target: Target, iterations: int, clipped: bool = False,
          plain: bool = False) -> Solved:
    """Return what Newton's method makes of joint positions (m,).

    The steps are the least ones in a metric in which joints near their limits are heavy (Chan and
    Dubey, IEEE Transactions on Robotics and Automation 11, 1995), damped in proportion to the
    squared error (Levenberg and Marquardt): quadratic convergence, and near what is out of reach
    the nearest placement.
    """
    best = Solved(positions, np.full(_COORDINATES, np.inf))
    for _ in range(iterations):
        off, jacobian = chain.off(positions, *target)
        if off @ off < best.off @ best.off:
            best = Solved(positions, off)
        if np.abs(off).max() < CLOSE:
            break
        heavy = np.ones(positions.size) if plain else _heavy(chain, positions)
        step = _least_step(jacobian, off, heavy)
        positions = positions + step * min(1.0, _STEP / np.abs(step).max())
        if clipped:
            positions = np.clip(positions, chain.lower, chain.upper)
    return best


def centered(chain: Chain, positions: Floats, target: Target, most: float) -> Floats:
    """Return positions (m,) from which to go on: nearer to the middles, the tool about unmoved."""
    if positions.size <= _COORDINATES or most == 0:
        return positions
    slope = _slope(chain, positions)
    heavy = _heavy(chain, positions)
    _, jacobian = chain.off(positions, *target)
    wish = -most * slope / heavy
    return positions + wish - _least_step(jacobian, jacobian @ wish, heavy)


def _least_step(jacobian: Floats, off: Floats, heavy: Floats) -> Floats:
    weighted = jacobian / heavy
    normal = weighted @ jacobian.T
    normal[np.diag_indices(_COORDINATES)] += _DAMPING * (off @ off) + 1e-14
    return weighted.T @ np.linalg.solve(normal, off)


def _heavy(chain: Chain, positions: Floats) -> Floats:
    return np.hypot(1.0, _slope(chain, positions))


def _slope(chain: Chain, positions: Floats) -> Floats:
    """Return the slope (m,) of the sum of range^2 / (4 (upper - q) (q - lower)); 0 without one."""
    span = chain.upper - chain.lower
    limited = np.isfinite(span)
    slope = np.zeros(positions.size)
    span, lower = span[limited], chain.lower[limited]
    part = np.clip((positions[limited] - lower) / span, _BORDER, 1 - _BORDER)
    slope[limited] = (2 * part - 1) / (4 * span * (part * (1 - part))**2)
    return slope
