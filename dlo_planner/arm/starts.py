# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The configurations in which an arm can begin."""

import numpy as np

from dlo_planner.arm.chain import Chain
from dlo_planner.arm.following import Lost, judge_limits, judge_reach
from dlo_planner.arm.robot import Arm
from dlo_planner.arm.solving import Solved, Target, centered, choices, solve
from dlo_planner.model.arrays import Floats

_ITERATIONS = 80
_RELAXING, _RELAXED = 20, 0.05  # steps away from limits, and their size in rad or m
_ALIKE = 1e-2     # rad or m: configurations that are one
_HERE = 0.02, 0.1  # m, rad: so near to the first target the tool is where it should be


def is_there(arm: Arm, target: Target, current: Floats) -> bool:
    """Whether the tool is at its first target at the arm's present joint positions."""
    off = arm.chain.off(current, *target)[0]
    return bool(np.linalg.norm(off[:3]) <= _HERE[0] and np.linalg.norm(off[3:]) <= _HERE[1])


def starts(arm: Arm, target: Target, current: Floats | None, number: int) -> list[Floats]:
    """Return configurations (m,) in which the tool is at a target, the nearest ones first.

    The search is the same each time: it begins at the present joint positions, and at points spread
    evenly over the ranges (Halton's sequence). If the tool is there already, only the arm's present
    configuration counts. Where the present positions are not known, those farthest from limits come
    first, and an arm with a choice goes away from its limits before.

    Shapes: current (m,).
    """
    chain = arm.chain
    if current is not None and is_there(arm, target, current):
        found = solve(chain, current, target, _ITERATIONS)
        judge_all(arm, found, 0.0)
        return [found.positions]
    reference = chain.middle if current is None else current
    seeds = [*([] if current is None else [current]), *_spread(chain, number)]
    good: list[Floats] = []
    best: Lost | None = None
    for seed in seeds:
        found = solve(chain, seed, target, _ITERATIONS, clipped=True)
        if current is None and found.reached:
            found = _relaxed(chain, found, target)
        for wound in (reference, chain.middle):
            try:
                nearest = type(found)(_wound(chain, found.positions, wound), found.off)
                judge_all(arm, nearest, 0.0)
            except Lost as lost:
                best = _nearer(best, lost)
                continue
            if all(np.abs(nearest.positions - other).max() > _ALIKE for other in good):
                good.append(nearest.positions)
    if not good and best is not None:
        raise best
    # without present positions a joint is as far from its middle as it is near to a limit
    size = 1.0 if current is not None else 0.5 * (chain.upper - chain.lower)
    return sorted(good, key=lambda one: np.abs((one - reference) / size).max())


def judge_all(arm: Arm, found: Solved, time: float) -> None:
    """Raise Lost unless a Solved is there, within limits, and no links touch."""
    judge_reach(found, time)
    judge_limits(arm, found.positions, time)
    judge_self_collision(arm, found.positions, time)


def judge_self_collision(arm: Arm, positions: Floats, time: float) -> float:
    """Return the smallest distance between links, m; raise Lost if it is too small."""
    distances = arm.collision.distances(positions)
    if not distances.size:
        return np.inf
    pair = int(np.argmin(distances))
    if distances[pair] <= arm.self_clearance:
        one, other = arm.collision.pairs[pair]
        wanted = f'at least {arm.self_clearance:g} m' if arm.self_clearance else 'more than 0 m'
        raise Lost(f'{one} and {other} come together: their distance is {distances[pair]:.4g} m, '
                   f'expected {wanted}', time, 'self_collision',
                   float(arm.self_clearance - distances[pair]))
    return float(distances[pair])


def _relaxed(chain: Chain, found: Solved, target: Target) -> Solved:
    """Return a Solved of the same placement with joints nearer to the middles of their ranges."""
    for _ in range(_RELAXING if choices(chain)[0] else 0):
        other = solve(chain, centered(chain, found.positions, target, _RELAXED), target,
                      _ITERATIONS)
        if not other.reached:
            break
        found = other
    return found


def _spread(chain: Chain, number: int) -> Floats:
    """Return seeds (number, m) over the ranges, a turn of angles at most."""
    from scipy.stats import qmc  # noqa: PLC0415  (half a second: only where it is used)
    half = np.where(chain.turning, np.pi, 1.0)
    lower, upper = (np.clip(limit, chain.middle - half, chain.middle + half)
                    for limit in (chain.lower, chain.upper))
    shares: Floats = qmc.Halton(len(chain.names), scramble=False).random(number)
    return lower + (upper - lower) * shares


def _wound(chain: Chain, positions: Floats, reference: Floats) -> Floats:
    """Return the same configuration with whole turns taken off, nearest to a reference."""
    turns = np.where(chain.turning, np.round((reference - positions) / (2 * np.pi)), 0.0)
    other = positions + 2 * np.pi * turns
    return np.where((other >= chain.lower) & (other <= chain.upper), other, positions)


def _nearer(best: Lost | None, lost: Lost) -> Lost:
    """Return the refusal that is nearer to a solution: within reach, then by the amount."""
    order = ('reach', 'joint_limit', 'self_collision')
    rank = order.index(lost.constraint), -lost.amount
    return lost if best is None or rank > (order.index(best.constraint), -best.amount) else best
