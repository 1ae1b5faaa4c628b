# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan in the making: it keeps all demands, or is refused with the violated one.

Each waypoint is checked when it is added, the path between them when the plan is complete.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.checks import PlanChecker, utilization, violated
from dlo_planner.plan.continuity import SAME, apart, discontinuity, passes_itself, same
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import (
    Plan,
    PlanStatus,
    padded_clearances,
    times_at_speed,
    truncate,
)
from dlo_planner.plan.stage import moving
from dlo_planner.plan.swept import violation_between
from dlo_planner.plan.waypoint import Waypoint
from dlo_planner.uncertainty.parameters import Uncertainty


class PlanBuilder:
    """Collects the Waypoints of a plan in order.

    Parameters
    ----------
    depths : array_like, shape (n,)
        Depths of the waypoints wanted, m.
    demands : PlanChecker
        PlanChecker.
    what : str, optional
        How a waypoint is called in a refusal.
    initial : Shape, optional
        Shape before the first waypoint, or None.
    stops : iterable of int, optional
        Indices of waypoints at which the gripper stops.
    """

    def __init__(self, depths: ArrayLike, demands: PlanChecker, what: str = 'waypoint',
                 initial: Shape | None = None, stops: Iterable[int] = ()) -> None:
        self.waypoints: list[Waypoint] = []
        self._rooms: list[float] = []  # of each, beside everything, m
        self._used: list[float] = []  # of the yield limits
        self._initial, self._stops = initial, list(stops)
        self._depths: Floats = np.asarray(depths, dtype=float)
        self._demands, self._what = demands, what

    @property
    def last(self) -> Shape | None:
        """The Shape of the last waypoint; before there is one, the initial Shape or None."""
        return self.waypoints[-1].shape if self.waypoints else self._initial

    @property
    def wanted(self) -> int:
        """How many waypoints the plan shall have."""
        return len(self._depths)

    @property
    def depth(self) -> float:
        """Depth of the next waypoint, m."""
        return float(self._depths[len(self.waypoints)])

    @property
    def step(self) -> float:
        """How much deeper the next waypoint is than the one before, m; 0 at the first."""
        index = len(self.waypoints)
        return float(self._depths[index] - self._depths[index - 1]) if index else 0.0

    def lengthen(self, count: int) -> None:
        """Let the plan have some waypoints more, which go nowhere deeper than the next one."""
        index = len(self.waypoints)
        self._depths = np.insert(self._depths, index, [self._depths[index]] * count)

    def stop(self) -> None:
        """Let the gripper stop at the last waypoint."""
        self._stops.append(len(self.waypoints) - 1)

    def check(self) -> None:
        """Raise DeadlineExceeded if the time is over."""
        self._demands.progress.check()

    def add(self, waypoint: Waypoint) -> None:
        """Take the next Waypoint; raises Infeasible if it breaks a demand."""
        if self.last is not None and passes_itself(self._demands.simulator, self.last,
                                                   waypoint.shape):
            raise self.refusal('self_passage', 1.0, 'on the way there the DLO would pass through '
                               'itself: nothing holds its pieces off each other', '')
        margins = list(self._demands.margins(waypoint))
        broken = violated(margins)
        if broken is not None:
            raise self.refusal(broken.name, -broken.room, broken.message, broken.unit)
        self.waypoints.append(waypoint)
        self._rooms.append(min(self._demands.room_beside_touched(waypoint.shape), *(
            one.room + self._demands.clearance for one in margins if one.name == 'clearance')))
        limits = self._demands.yield_limits
        self._used.append(np.nan if limits is None else utilization(waypoint.shape, limits))
        self._demands.progress.done(len(self.waypoints), len(self._depths))

    def refusal(self, constraint: str, amount: float, why: str,
                unit: str | None = None) -> Infeasible:
        """Return Infeasible for the next waypoint, with the plan up to it as evidence."""
        return _refusal(self._what, len(self.waypoints), self._depths, constraint, float(amount),
                        unit, why, self.partial())

    def finished(self) -> Plan:
        """Return the Plan; raises Infeasible if it breaks a demand between two waypoints."""
        return kept_between(self._plan(PlanStatus.COMPLETE), self._demands, self._what,
                            self._rooms)

    def partial(self) -> Plan:
        """Return the Plan so far, as evidence."""
        return self._plan(PlanStatus.PARTIAL)

    def _plan(self, status: PlanStatus) -> Plan:
        stops = tuple(stop for stop in self._stops if stop < len(self.waypoints))
        plan = build_plan(self.waypoints, self._depths, self._demands.speeds, status, stops,
                          self._rooms, self._used, self._demands.uncertainty)
        limits = self._demands.wrench_limits
        return plan if limits == (None, None) else replace(plan, wrench_limits=limits)


def kept_between(plan: Plan, demands: PlanChecker, what: str = 'waypoint',
                 known: Sequence[float] | None = None) -> Plan:
    """Return a Plan that keeps its demands between waypoints, on the path of its Trajectory.

    known: rooms at the waypoints beside everything, m, where they are.
    """
    looked_at = demands.workspace is not None or demands.plug is not None or (
        demands.simulator is not None and (
            plan.sheets or demands.obstacles or demands.wrench_limits != (None, None)))
    if len(plan) < 2 or not plan.times[-1] > plan.times[0] or not looked_at:
        return plan
    broken = violation_between(GripperPath.of(plan), plan.shapes, plan.sheets, demands, known)
    if broken is None:
        return plan
    assert broken.place is not None  # it is between waypoints
    raise _refusal(what, broken.place, plan.depths, broken.name, -broken.room, broken.unit,
                   broken.message, truncate(plan, broken.place, PlanStatus.PARTIAL))


def _refusal(what: str, index: int, depths: Floats, constraint: str, amount: float,
             unit: str | None, why: str, plan: Plan) -> Infeasible:
    """Return Infeasible for the waypoint `index`."""
    deep = bool(np.any(depths))
    depth = f' (depth {depths[index]:g} m)' if deep else ''
    kept = f'; all is kept to depth {depths[index - 1]:g} m' if deep and index else ''
    return Infeasible(f'{what} {index}{depth}: {why}{kept}', index, constraint, amount, plan, unit)


def build_plan(waypoints: Sequence[Waypoint], depths: Floats, speeds: tuple[float, float],
               status: PlanStatus, stops: tuple[int, ...] = (),
               rooms: Sequence[float] = (), used: Sequence[float] = (),
               uncertainty: Uncertainty | None = None) -> Plan:
    """Return the Plan of Waypoints at the first of the `depths`; speeds: m/s, rad/s; rooms: m.

    used: of the yield limits, 1 where the DLO begins to yield.
    """
    grippers = [waypoint.shape.gripper for waypoint in waypoints]
    arms = moving([waypoint.shape for waypoint in waypoints])
    return Plan(np.array(depths[:len(waypoints)]), tuple(grippers),
                tuple(waypoint.shape for waypoint in waypoints),
                np.array([waypoint.misalignment for waypoint in waypoints]),
                np.array([waypoint.position_error for waypoint in waypoints]),
                times_at_speed(grippers, *speeds, arms.values()),
                tuple(waypoint.via_points for waypoint in waypoints),
                padded_clearances([waypoint.clearances for waypoint in waypoints]),
                waypoints[-1].sheets if waypoints else (),
                len(waypoints) / len(depths), status, stops,
                clearance=np.array(rooms or [waypoint.clearance for waypoint in waypoints]),
                yield_utilization=np.array(used or [np.nan] * len(waypoints)),
                uncertainty=uncertainty)


def refusal_for_accuracy(simulator: DirectSimulator, builder: PlanBuilder,
                         shape: Shape) -> Infeasible | None:
    """Return Infeasible if a Shape is an equilibrium that misses only the accuracy, else None."""
    accuracy = simulator.accuracy
    if accuracy is None or not shape.nearly or not shape.error_estimate > accuracy:
        return None
    return builder.refusal('accuracy', shape.error_estimate - accuracy, 'the DLO is in '
                           'equilibrium there, but its shape is known with an error of '
                           f'{shape.error_estimate:.3g} m, accuracy = {accuracy:g} m is asked for')


def refusal_for_leap(simulator: DirectSimulator, builder: PlanBuilder,
                     shape: Shape) -> Infeasible | None:
    """Return Infeasible if the next waypoint of a PlanBuilder cannot have this Shape, else None."""
    reached = discontinuity(simulator, builder.last, shape)
    if reached is None:
        return None
    inexact = refusal_for_accuracy(simulator, builder, reached)
    if inexact is not None and same(reached, shape):
        return inexact
    away = max(apart(reached, shape), SAME * shape.s[-1])
    if not builder.waypoints:
        why = ('set down there in its natural shape' if builder.last is None
               else 'brought there from its initial shape')
        return builder.refusal('start', away, 'a stable shape does the task, but the DLO, '
                               f'{why}, snaps into another one')
    return builder.refusal('continuity', away, 'the DLO would fall into another shape on the way '
                           'there; closer waypoints may help')
