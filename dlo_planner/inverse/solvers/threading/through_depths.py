# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A threading through one cut-out, continued from where it begins through all depths.

The gripper rolls as its route says, or only where the DLO would hardly be stable. Such rolls come
in jerks, each a corner of its path: afterwards the same plan is tried with even ones. The sum of
the rolls is how far it has to be rolled at each depth; a smooth curve along it (Whittaker 1923) is
about the same path without corners.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.inverse.solvers.conditions import Aligned
from dlo_planner.inverse.solvers.continuation.ahead import Ahead
from dlo_planner.inverse.solvers.continuation.following import (
    Condition,
    Passing,
    Rolls,
    Step,
    as_replayed,
    follow,
    refusal_for_step,
)
from dlo_planner.inverse.solvers.continuation.quick import thinned
from dlo_planner.inverse.solvers.hanging.start_candidates import Candidate, is_axisymmetric
from dlo_planner.minimize.newton import NEUTRAL
from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.plan.builder import PlanBuilder, PlanRequirements
from dlo_planner.plan.continuity import largest_turn
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Holes, waypoint_of

_FIRM = (1e3, 1e2, 1e1, 1.0)  # how much smoothness counts: features of 35 to 6 waypoints go
_NO_ROLL = 1e-3               # rad between two waypoints


@dataclass(frozen=True, eq=False)
class EvenRolls:
    """How far the gripper has rolled at n depths; a route for `following.follow`.

    Attributes
    ----------
    depths : ndarray, shape (n,)
        Depths in m.
    turned : ndarray, shape (n,)
        Rotation about the free axis at each depth, rad.
    """

    depths: Floats
    turned: Floats

    def roll(self, condition: Condition, passing: Passing, depth: float, target: float) -> float:
        """Return the roll (rad) to make between two depths, m."""
        del condition, passing
        return float(np.diff(np.interp((depth, target), self.depths, self.turned))[0])


def even_rolls(condition: Condition, depths: Floats,
               passings: Sequence[Passing]) -> Iterator[EvenRolls]:
    """Yield EvenRolls, ever less smooth, along the rolls between n Passings at n depths."""
    rolls = [Rotation.from_matrix(after.shape.gripper.rotation @ before.shape.gripper.rotation.T)
             .as_rotvec() @ condition.axis(before.shape)
             for before, after in zip(passings, passings[1:], strict=False)]
    if len(rolls) < 2 or np.abs(rolls).max() < _NO_ROLL:
        return
    turned = np.append(0.0, np.cumsum(rolls))
    bends = np.diff(np.eye(turned.size), 2, axis=0)
    for firm in _FIRM:
        yield EvenRolls(depths, np.linalg.solve(np.eye(turned.size) + firm * bends.T @ bends,
                                                turned))


_ROLLS = (0.2, -0.2, 0.5, -0.5, 1.0, -1.0)  # of the largest turn, tried between two waypoints
_DOUBTFUL = 0.05    # stability below which another roll is looked for
_AS_STABLE = 0.8    # of that, or of what there is: rolled evenly it may be less


@dataclass(frozen=True)
class Threading:
    """A threading through one cut-out.

    Attributes
    ----------
    cutout : CutOut
    depths : ndarray, shape (n,)
        Depths in m.
    start : Pose or None
        Pose whose roll is kept as far as possible.
    initial : Shape or None
        Shape before. If None, the DLO is set down in its natural shape.
    demands : PlanRequirements
        What the plan has to keep.
    method : str
        'coupled' or 'nested', for waypoints.
    """

    cutout: CutOut
    depths: Floats
    start: Pose | None
    initial: Shape | None
    demands: PlanRequirements
    method: str = 'coupled'

    def at_most(self, most: int) -> Threading:
        """Return a quick one: `most` of the depths, coupled, its steps unreported.

        Itself, if it has no more depths.
        """
        if len(self.depths) <= most:
            return self
        return replace(self, depths=thinned(self.depths, most), demands=self.demands.silent(),
                       method='coupled')


def thread_from(simulator: DirectSimulator, task: Threading, begin: Candidate,
                route: Rolls | None) -> Plan:
    """Return the Plan that continues a Candidate through all depths."""
    length, cutout, demands = simulator.rod.length, task.cutout, task.demands
    builder = PlanBuilder(task.depths, demands, initial=task.initial)
    holes = Holes([cutout], length, demands.obstacles, demands.surface)
    aligned = Aligned(simulator, cutout.normal, task.method)
    may_roll = not is_axisymmetric(simulator.rod) and not isinstance(route, EvenRolls)
    guess, reference, depth = begin
    last, jerks = aligned.from_guess(guess, depth, reference), False
    passings: list[Passing] = []
    ahead = Ahead(aligned, task.depths) if route is None else None
    for index, target in enumerate(task.depths):
        demands.progress.check()
        before = last if builder.waypoints else None
        refusal = None
        passing = None if ahead is None or before is None else ahead.passing(before, index)
        if passing is None:
            step = Step(None, depth, 0.0) if last is None else follow(
                aligned, last, depth, target, route)
            refusal = _refusal(simulator, builder, before, target, step)
            passing = step.passing if refusal is None else None
        if before is not None and may_roll and (
                passing is None or passing.shape.stability < _DOUBTFUL):
            jerks = True
            passing = _rolled(simulator, builder, aligned, before, target, passing)
        if passing is None:
            assert refusal is not None  # else there is one
            raise refusal
        last, depth = as_replayed(simulator, aligned, builder.last, passing, target), target
        passings.append(last)
        waypoint = waypoint_of(last.shape, cutout.center, length - target, cutout.normal,
                               last.known)
        builder.add(holes.passed(waypoint))
    plan = builder.finished()
    return _evenly(simulator, task, begin, plan, passings) if jerks else plan


def _evenly(simulator: DirectSimulator, task: Threading, begin: Candidate, plan: Plan,
            passings: Sequence[Passing]) -> Plan:
    """Return a Plan with the rolls of `plan`, but even ones; `plan` itself if there is none."""
    silent = replace(task, demands=task.demands.silent())
    aligned = Aligned(simulator, task.cutout.normal, task.method)
    for route in even_rolls(aligned, task.depths, passings):
        try:
            even = thread_from(simulator, silent, begin, route)
        except Infeasible:
            continue
        if even.stability.min() >= _AS_STABLE * min(_DOUBTFUL, plan.stability.min()):
            return even
    return plan


def _refusal(simulator: DirectSimulator, builder: PlanBuilder, before: Passing | None,
             target: float, step: Step) -> Infeasible | None:
    """Return why a Step does not lead to the next waypoint, or None."""
    if step.passing is None and step.leap:
        return builder.refusal('continuity', step.leap, 'the gripper would have to leap at depth '
                               f'{step.depth:.4g} m: the shapes that do the task turn back there')
    if step.passing is None:
        return builder.refusal('equilibrium', target - step.depth, 'no equilibrium with the '
                               'tangent along the normal was found beyond depth '
                               f'{step.depth:g} m')
    shape = step.passing.shape
    if shape.stability < -NEUTRAL:
        return builder.refusal('stability', -shape.stability, 'the DLO would not stay in the shape '
                               f'that passes the cut-out; stability {shape.stability:.3g} < 0')
    return refusal_for_step(simulator, builder, None if step.at_once else before, step.passing)


def _rolled(simulator: DirectSimulator, builder: PlanBuilder, aligned: Aligned, before: Passing,
            target: float, best: Passing | None) -> Passing | None:
    """Return a Passing that is stable enough, the gripper rolled as little as that takes.

    If there is none, the most stable one, or `best`.
    """
    most = largest_turn(builder.step / simulator.rod.length)
    for part in _ROLLS:
        rolled = aligned.at(before, target, part * most, True)
        if rolled is None or best is not None and rolled.shape.stability <= best.shape.stability:
            continue
        if _refusal(simulator, builder, before, target, Step(rolled, target, 0.0)) is None:
            best = rolled
            if rolled.shape.stability >= _DOUBTFUL:
                break  # no larger roll than needed: the gripper's path stays smooth
    return best
