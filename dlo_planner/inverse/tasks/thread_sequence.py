# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through more than two cut-outs: nearest to all of their centers that are passed.

The gripper has six degrees of freedom, and the arc lengths at all cut-outs but the first are free:
two centers can be hit, three in general cannot. So the weighted distances are minimized. The weight
of a cut-out ahead grows smoothly as the free end comes near, so that the gripper's path is
continuous: the DLO, extended straight, aims at it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.equilibria import is_axisymmetric
from dlo_planner.inverse.nearest_goals import nearest_goals
from dlo_planner.inverse.route import quick_simulator, thinned
from dlo_planner.inverse.task import PlanContext, Task, depths_on, depths_or_none
from dlo_planner.inverse.tasks.thread import Thread, Threading, thread
from dlo_planner.inverse.tasks.thread_two import ThreadTwo
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, row
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, turned_by
from dlo_planner.model.value import put
from dlo_planner.plan.builder import PlanBuilder, refusal_for_leap
from dlo_planner.plan.checks import PlanRequirements
from dlo_planner.plan.continuity import largest_shift, largest_turn
from dlo_planner.plan.goal_rows import DIRECTION, POSITION, ROLL, THROUGH, GoalTable
from dlo_planner.plan.goals import Through
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Holes, waypoint_at

_BLEND = 0.25         # of the length: from there on a cut-out ahead counts
_LONGEST_STEP = 1 / 20  # of the length: depth steps of the continuation
_FREE = 1e-3          # weight of the first normal, which decides only what is left free
_SHORTEST_STEP = 1 / 200
_SOON = 0.02          # share of a third one at which the second counts in full
_COMPARED, _ROLLS = 8, 4  # depths and rolls at which start_candidates are compared
_HIT = 0.01           # of the length: misses that need no comparison
_BETTER = 0.5         # of the squared misses: what another roll has to gain
_PART = 0.7           # of the largest turn and shift, so that both together are no leap


@dataclass(frozen=True)
class CutoutSequence:
    """A threading through k cut-outs.

    Attributes
    ----------
    cutouts : tuple of CutOut
        The k cut-outs.
    weights : ndarray, shape (k,)
        Weights of their distances.
    depths : ndarray, shape (n,)
        Depths in the first one, m.
    start : Pose or None
        Pose whose roll is kept as far as possible.
    demands : PlanRequirements
    """

    cutouts: tuple[CutOut, ...]
    weights: Floats
    depths: Floats
    start: Pose | None
    demands: PlanRequirements

    @cached_property
    def centers(self) -> Floats:
        """(k, 3) m."""
        return np.array([cutout.center for cutout in self.cutouts], dtype=float)

    @cached_property
    def apart(self) -> Floats:
        """(k,) how deep a straight DLO is as its free end reaches each center, m."""
        legs = np.linalg.norm(np.diff(self.centers, axis=0), axis=1)
        return np.concatenate([[0.0], legs.cumsum()])


def thread_sequence(simulator: DirectSimulator, cutouts: tuple[CutOut, ...], weights: Floats,
                    depths: Floats, start: Pose | None, demands: PlanRequirements) -> Plan:
    """Return the Plan; see `InverseSimulator.thread_sequence` for what the arguments mean.

    Several rolls to begin with are compared, with a quick simulator at a few depths; the one with
    the smallest errors is taken.
    """
    task = CutoutSequence(cutouts, weights, depths, start, demands)
    quick = quick_simulator(simulator)
    if quick is simulator and is_axisymmetric(simulator.rod):
        return _thread(simulator, task)  # all rolls are alike
    few = replace(task, depths=thinned(depths, _COMPARED), demands=demands.silent(quick))
    best: CutoutSequence | None = None
    least, refused = np.inf, None
    for begin in _rolled(simulator, task):
        demands.progress.check()
        try:
            plan = _thread(quick, replace(few, start=begin))
        except Infeasible as error:
            refused = refused or error
            continue
        missed = sum((weight * miss) ** 2 for misses in plan.position_errors
                     for weight, miss in zip(weights, misses, strict=False))
        if missed < _BETTER * least:
            least, best = missed, replace(task, start=begin)
        if missed <= (_HIT * simulator.rod.length) ** 2 * max(weights) ** 2:
            break
    if best is None:
        if quick is simulator and len(few.depths) < len(depths):
            return _thread(simulator, task)  # closer waypoints may do, or tell more
        assert refused is not None  # one roll is tried at least
        raise refused
    return _thread(simulator, best)


def _rolled(simulator: DirectSimulator, task: CutoutSequence) -> Iterator[Pose | None]:
    """Yield Poses, or None, from whose roll the DLO is turned least; first the requested one."""
    yield task.start
    if is_axisymmetric(simulator.rod):
        return
    first = task.cutouts[0]
    upright = (Pose.looking_along((0.0, 0.0, 0.0), first.normal) if task.start is None
               else task.start)
    for k in range(1, _ROLLS):
        turn = turned_by(2 * np.pi * k / _ROLLS * upright.direction)
        yield Pose.from_rotation(upright.position, turn @ upright.rotation)


def _thread(simulator: DirectSimulator, task: CutoutSequence) -> Plan:
    """Return the Plan that begins with the roll of `task.start`."""
    length, demands, centers = simulator.rod.length, task.demands, task.centers
    holes = Holes(task.cutouts, length, demands.obstacles, demands.surface)
    builder = PlanBuilder(task.depths, demands)
    begin = thread(simulator, Threading(
        task.cutouts[0], np.zeros(1), task.start, None,
        PlanRequirements(demands.speeds, demands.progress.silent())))
    shape, depth = begin.shapes[0], 0.0
    for target in task.depths:
        shape, depth = _follow(simulator, task, shape, depth, target)
        if depth < target:
            raise builder.refusal('equilibrium', target - depth, 'no stable shape was found that '
                                  f'is nearest to the centers beyond depth {depth:g} m')
        refusal = refusal_for_leap(simulator, builder, shape)
        if refusal is not None:
            raise refusal
        waypoint = waypoint_at(shape, centers[0], length - target, None)
        for center in centers[1:]:
            s = Through(center, length - target).passage(shape)
            if s > length:
                break
            waypoint = waypoint.with_via_point(center, s)
        for k, (cutout, (_, s, _)) in enumerate(zip(task.cutouts, waypoint.via_points,
                                                    strict=False)):
            along = float(shape.frame_at(s)[0][:, 0] @ cutout.normal)
            if along <= 0:
                raise builder.refusal('direction', -along, f'the DLO would pass cut-out {k} '
                                      'against its direction')
        builder.add(holes.passed(waypoint))
    return builder.finished()


def _goals(task: CutoutSequence, depth: float, length: float, gripper: Pose) -> GoalTable:
    """Return what the DLO should be like at a depth, m, after the gripper was at a Pose."""
    share = np.clip((depth - task.apart) / (_BLEND * length) + 1, 0, 1)
    share = share**2 * (3 - 2 * share)
    weights = task.weights * share
    weights[0] = task.weights[0]
    if share[1] > 0:
        # Two can be hit, whatever the weight: so the second one may decide what the normal did,
        # and has to count in full before a third one does.
        second = share[1] * max(_FREE, min(1.0, share[2] / _SOON))
        weights[1] = task.weights[1] * (1.0 if share[1] == 1 else second)
    further, rotation = len(weights) - 1, np.array(gripper.rotation)
    return GoalTable(
        np.array([POSITION, DIRECTION, *[THROUGH] * further, ROLL]),
        np.full(further + 3, length - depth),
        np.vstack([task.centers[0], task.cutouts[0].normal, task.centers[1:], rotation[:, 0]]),
        np.tile(rotation, (further + 3, 1, 1)),
        np.array([weights[0], _FREE * float(1 - share[1]) * length, *weights[1:], _FREE * length]))


def _follow(simulator: DirectSimulator, task: CutoutSequence, shape: Shape, depth: float,
            goal: float) -> tuple[Shape, float]:
    """Return the Shape nearest to the centers at the depth `goal`, and how far it came, m.

    The nearest shape may be far from the one at `depth`, m: then the DLO goes towards it by one
    step.
    """
    length = simulator.rod.length
    step = _LONGEST_STEP * length
    while True:
        task.demands.progress.check()
        target = min(goal, depth + step)
        part = (target - depth) / length
        nearest = nearest_goals(simulator, _goals(task, target, length, shape.gripper), shape,
                                _PART * largest_turn(part), _PART * largest_shift(part) * length)
        if nearest is not None:
            shape, depth = nearest, target
            if depth == goal:
                break
        elif step > _SHORTEST_STEP * length and target > depth:
            step /= 2
        else:
            break
    return shape, depth


@dataclass(frozen=True, eq=False, repr=False)
class ThreadSequence(Task):
    """Thread near the centers of cut-outs; see `InverseSimulator.thread_sequence`.

    Attributes
    ----------
    cutouts : tuple of CutOut
        The cut-outs, in the order in which they are passed.
    weights : ndarray, shape (k,) or None
        Weights of their distances. If None, all alike.
    depths : ndarray, shape (n,) or None
        Arc lengths that have gone through the first one, m, or None.
    """

    cutouts: tuple[CutOut, ...]
    weights: Floats | None = None
    depths: Floats | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, cutouts: Iterable[CutOut], weights: ArrayLike | None = None,
                     depths: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        cutouts = items('cutouts', self.cutouts, CutOut, least=1)
        weights = None if self.weights is None else row('weights', self.weights, above=0)
        if weights is not None and weights.size != len(cutouts):
            raise InvalidTask(f'weights has {weights.size} entries: expected one per cut-out, '
                              f'{len(cutouts)}')
        put(self, cutouts=cutouts, weights=weights, depths=depths_or_none('depths', self.depths))
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan; one and two cut-outs are hit exactly, as by `Thread` and `ThreadTwo`."""
        instance('context', context, PlanContext)
        if len(self.cutouts) <= 2:
            return threading_of(self.cutouts, self.depths).solve(context)
        weights = np.ones(len(self.cutouts)) if self.weights is None else self.weights
        return thread_sequence(context.without_obstacles, self.cutouts, weights,
                               depths_on(context.rod.length, self.depths), context.start,
                               context.demands)


def threading_of(cutouts: Sequence[CutOut],
                 depths: ArrayLike | None = None) -> Thread | ThreadTwo | ThreadSequence:
    """Return the task that threads through these cut-outs, one after the other.

    Parameters
    ----------
    cutouts : sequence of CutOut
        One or more.
    depths : array_like, shape (n,), optional
        Arc lengths that have gone through the first one, m, or None.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    cutouts = items('cutouts', cutouts, CutOut, least=1)
    if len(cutouts) == 1:
        return Thread(cutouts[0], depths)
    return ThreadTwo(*cutouts, depths) if len(cutouts) == 2 else ThreadSequence(
        cutouts, None, depths)
