# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics: joint positions for a placement of the tool link, and checks of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_planner.arm.robot import Arm, Chain
from dlo_planner.model.arrays import Floats

_CLOSE = 1e-9     # m and rad: placed
_REACHED = 1e-6   # m and rad: as good as placed, where rounding or a singularity ends the search
_DAMPING = 1e-3   # of the squared error, against singular Jacobians
_STEP = 0.5       # rad or m at most in one iteration
_COORDINATES = 6  # of the tool: an arm with more joints has a choice
_CENTERINGS = 0.5, 2.0, 0.0
_BORDER = 1e-3    # of a range: nearer to a limit counts as so near
_ITERATIONS = 80
_RELAXING, _RELAXED = 20, 0.05  # steps away from limits, and their size in rad or m
_ALIKE = 1e-2     # rad or m: configurations that are one
_HERE = 0.02, 0.1  # m, rad: so near to the first target the tool is where it should be
_LIMIT_ROUNDING = 1e-9
_ORDER = ('reach', 'joint_limit', 'self_collision')  # of refusals, the nearest to a solution last

Target = tuple[Floats, Floats]  # position (3,), rotation (3, 3) in the arm's root link


class IKFailure(Exception):
    """A configuration cannot be gone on with: why, when (s), the constraint, by how much.

    Of two, that with the larger `rank` is nearer to a solution.
    """

    attempt: Any = None  # with which it can be tried again

    def __init__(self, words: str, time: float, constraint: str, amount: float, unit: str,
                 rank: tuple[float, float] | None = None) -> None:
        super().__init__(words)
        self.words, self.time, self.constraint = words, time, constraint
        self.amount, self.unit = amount, unit
        self.rank = (time, 0.0) if rank is None else rank


@dataclass(frozen=True)
class IKSolution:
    """Joint positions (m,), and the displacement and rotation vector (6,) that are left."""

    positions: Floats
    off: Floats

    @property
    def reached(self) -> bool:
        """Whether the tool is where it should be, to 1e-6 m and rad."""
        return bool(np.abs(self.off).max() <= _REACHED)


def centerings(chain: Chain) -> tuple[float, ...]:
    """Return how strongly the joints may be drawn to their middles, in rad per m and rad of way."""
    return _CENTERINGS if len(chain.names) > _COORDINATES else (0.0,)


def solve(chain: Chain, positions: Floats, target: Target, iterations: int, clipped: bool = False,
          plain: bool = False) -> IKSolution:
    """Return what Newton's method makes of joint positions (m,).

    The steps are the least ones in a metric in which joints near their limits are heavy (Chan and
    Dubey, IEEE Transactions on Robotics and Automation 11, 1995), damped in proportion to the
    squared error (Levenberg and Marquardt): quadratic convergence, and near what is out of reach
    the nearest placement.
    """
    best = IKSolution(positions, np.full(_COORDINATES, np.inf))
    for _ in range(iterations):
        off, jacobian = chain.off(positions, *target)
        if off @ off < best.off @ best.off:
            best = IKSolution(positions, off)
        if np.abs(off).max() < _CLOSE:
            break
        weights = np.ones(positions.size) if plain else _weights(chain, positions)
        step = _least_step(jacobian, off, weights)
        positions = positions + step * min(1.0, _STEP / np.abs(step).max())
        if clipped:
            positions = np.clip(positions, chain.lower, chain.upper)
    return best


def centered(chain: Chain, positions: Floats, target: Target, most: float) -> Floats:
    """Return positions (m,) from which to go on: nearer to the middles, the tool about unmoved."""
    if positions.size <= _COORDINATES or most == 0:
        return positions
    weights = _weights(chain, positions)
    jacobian = chain.off(positions, *target)[1]
    wish = -most * _limit_slope(chain, positions) / weights
    return positions + wish - _least_step(jacobian, jacobian @ wish, weights)


def initial_configurations(arm: Arm, target: Target, current: Floats | None,
                           number: int) -> list[Floats]:
    """Return configurations (m,) in which the tool is at a target, the nearest ones first.

    The search is the same each time: it begins at the present joint positions (m,), and at points
    spread evenly over the ranges (Halton's sequence). If the tool is there already, only the arm's
    present configuration counts. Where the present positions are not known, those farthest from
    limits come first, and an arm with a choice goes away from its limits before.
    """
    chain = arm.chain
    if current is not None:
        off = chain.off(current, *target)[0]
        if np.linalg.norm(off[:3]) <= _HERE[0] and np.linalg.norm(off[3:]) <= _HERE[1]:
            found = solve(chain, current, target, _ITERATIONS)
            _check(arm, found)
            return [found.positions]
    reference = chain.middle if current is None else current
    good: list[Floats] = []
    failures: list[IKFailure] = []
    for seed in [*([] if current is None else [current]), *_spread(chain, number)]:
        found = solve(chain, seed, target, _ITERATIONS, clipped=True)
        if current is None and found.reached:
            found = _relaxed(chain, found, target)
        for near in (reference, chain.middle):
            unwound = IKSolution(_unwound(chain, found.positions, near), found.off)
            try:
                _check(arm, unwound)
            except IKFailure as failure:
                failures.append(failure)
                continue
            if all(np.abs(unwound.positions - other).max() > _ALIKE for other in good):
                good.append(unwound.positions)
    if not good:
        raise max(failures, key=lambda one: (_ORDER.index(one.constraint), -one.amount))
    # without present positions a joint is as far from its middle as it is near to a limit
    size = 1.0 if current is not None else 0.5 * (chain.upper - chain.lower)
    return sorted(good, key=lambda one: np.abs((one - reference) / size).max())


def check_reach(found: IKSolution, time: float) -> None:
    """Raise IKFailure unless an IKSolution reaches its target."""
    if not found.reached:
        left, turn = (float(np.linalg.norm(part)) for part in (found.off[:3], found.off[3:]))
        raise IKFailure(f'the tool cannot get there: {left:.3g} m and {turn:.3g} rad are left',
                        time, 'reach', left or turn, 'm' if left > 0 else 'rad')


def check_limits(arm: Arm, positions: Floats, time: float) -> None:
    """Raise IKFailure unless joint positions (m,) are within their limits."""
    beyond = np.maximum(positions - arm.upper, arm.lower - positions)
    joint = int(np.argmax(beyond))
    if beyond[joint] > _LIMIT_ROUNDING:
        raise IKFailure(f'{arm.joints[joint]} = {positions[joint]:.6g} {arm.units[joint]}: '
                        f'expected {arm.lower[joint]:.6g} to {arm.upper[joint]:.6g}', time,
                        'joint_limit', float(beyond[joint]), arm.units[joint])


def check_self_collision(arm: Arm, positions: Floats, time: float) -> float:
    """Return the smallest distance between links, m; raise IKFailure if it is too small."""
    distances = arm.collision.distances(positions)
    if not distances.size:
        return np.inf
    pair = int(np.argmin(distances))
    if distances[pair] <= arm.self_clearance:
        one, other = arm.collision.pairs[pair]
        wanted = f'at least {arm.self_clearance:g} m' if arm.self_clearance else 'more than 0 m'
        raise IKFailure(f'{one} and {other} come together: their distance is '
                        f'{distances[pair]:.4g} m, expected {wanted}', time, 'self_collision',
                        float(arm.self_clearance - distances[pair]), 'm')
    return float(distances[pair])


def _check(arm: Arm, found: IKSolution) -> None:
    check_reach(found, 0.0)
    check_limits(arm, found.positions, 0.0)
    check_self_collision(arm, found.positions, 0.0)


def _relaxed(chain: Chain, found: IKSolution, target: Target) -> IKSolution:
    """Return the same placement with joints nearer to the middles of their ranges."""
    for _ in range(_RELAXING if centerings(chain)[0] else 0):
        other = solve(chain, centered(chain, found.positions, target, _RELAXED), target,
                      _ITERATIONS)
        if not other.reached:
            break
        found = other
    return found


def _spread(chain: Chain, number: int) -> Iterator[Floats]:
    """Return seeds (number, m) over the ranges, a turn of angles at most."""
    from scipy.stats import qmc  # noqa: PLC0415  (half a second: only where it is used)
    half = np.where(chain.turning, np.pi, 1.0)
    lower, upper = (np.clip(limit, chain.middle - half, chain.middle + half)
                    for limit in (chain.lower, chain.upper))
    return iter(lower + (upper - lower) * qmc.Halton(len(chain.names), scramble=False).random(
        number))


def _unwound(chain: Chain, positions: Floats, reference: Floats) -> Floats:
    """Return the same configuration with whole turns taken off, nearest to a reference."""
    turns = np.where(chain.turning, np.round((reference - positions) / (2 * np.pi)), 0.0)
    other = positions + 2 * np.pi * turns
    return np.where((other >= chain.lower) & (other <= chain.upper), other, positions)


def _least_step(jacobian: Floats, off: Floats, weights: Floats) -> Floats:
    weighted = jacobian / weights
    normal = weighted @ jacobian.T
    normal[np.diag_indices(_COORDINATES)] += _DAMPING * (off @ off) + 1e-14
    return weighted.T @ np.linalg.solve(normal, off)


def _weights(chain: Chain, positions: Floats) -> Floats:
    return np.hypot(1.0, _limit_slope(chain, positions))


def _limit_slope(chain: Chain, positions: Floats) -> Floats:
    """Return the slope (m,) of the sum of range^2 / (4 (upper - q) (q - lower)); 0 without one."""
    span = chain.upper - chain.lower
    limited = np.isfinite(span)
    slope = np.zeros(positions.size)
    span, lower = span[limited], chain.lower[limited]
    part = np.clip((positions[limited] - lower) / span, _BORDER, 1 - _BORDER)
    slope[limited] = (2 * part - 1) / (4 * span * (part * (1 - part))**2)
    return slope
