# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A task of a DLO that is held inside: its front is planned, then the whole is judged.

The part in front of the gripper does not feel the one behind it: the plan is that of a DLO that
begins at the gripper. The part behind hangs from the gripper as it does, and is in the way: each
waypoint, and what is between, is judged once more with both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dlo_planner.direct.grasp import GraspedInside, grasped_at
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.inverse.task import PlanContext
from dlo_planner.model.checks import number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.rod import Rod, Surface, followed_by
from dlo_planner.plan.builder import PlanBuilder
from dlo_planner.plan.checks import PlanChecker
from dlo_planner.plan.clearance import Bodies
from dlo_planner.plan.continuity import apart
from dlo_planner.plan.plan import Passes, Plan, padded_clearances
from dlo_planner.plan.waypoint import Holes, Waypoint


@dataclass(frozen=True)
class HeldInside:
    """What a task asks of a DLO whose gripper holds it at `at`, m from its beginning."""

    context: PlanContext  # of the whole DLO
    at: float
    cutouts: tuple[CutOut, ...]  # that the part in front passes, or the entrance of its bore

    @cached_property
    def simulator(self) -> GraspedInside:
        """The simulator of the whole DLO, among its obstacles, as it is now, elastic."""
        given, initial = self.context.given, self.context.initial
        held = GraspedInside.of(given, number('hold_at', self.at, above=0, below=given.rod.length,
                                              unit='m'))
        return (held if initial is None else held.left_by(initial)).elastic()

    @cached_property
    def front(self) -> PlanContext:
        """The context of the part in front of the gripper, as a DLO of its own."""
        context, initial = self.context, self.context.initial
        if initial is not None:
            _, initial = self.simulator.parts_of(initial)
        return replace(context, simulator=self.simulator.parts[1], initial=initial,
                       given=context.given.part(self.simulator.at, 1))

    @cached_property
    def demands(self) -> PlanChecker:
        """The demands on the whole DLO; the part in front has reported its waypoints."""
        return self.context.demands.silent().made_with(self.simulator.without_obstacles())

    def planned(self, solve: Callable[[], Plan], what: str = 'waypoint') -> Plan:
        """Return the Plan of the whole DLO, of one that `solve` returns for the part in front.

        `what`: how a waypoint is called in a refusal.

        Raises
        ------
        Infeasible
            Also where the part behind the gripper does not keep the demands.
        """
        try:
            plan = solve()
        except Infeasible as error:  # its evidence is of the whole DLO, too
            if error.plan is not None and len(error.plan):
                error.plan = self._joined(error.plan, self._backs(error.plan))
            raise
        backs = self._backs(plan)
        whole = self._joined(plan, backs)
        builder = PlanBuilder(plan.depths, self.demands, what, self.context.initial, plan.stops)
        last = None if self.context.initial is None else self.simulator.parts_of(
            self.context.initial)[0]
        for waypoint, back in zip(self._waypoints(whole), backs, strict=True):
            if not back.converged or back.jumped:
                away = float(back.s[-1]) if last is None else apart(last, back)
                raise builder.refusal('continuity', away, 'the part of the DLO behind the '
                                      f'gripper does not follow: it is {back.status}')
            last = back
            through = self._through(back)
            if through > 0:
                raise builder.refusal('clearance', through, 'the part of the DLO behind the '
                                      'gripper hangs through the cut-out')
            builder.add(waypoint)
        judged = builder.finished()
        return replace(whole, clearance=judged.clearance,
                       yield_utilization=judged.yield_utilization)

    def _held(self, front: Rod | None) -> GraspedInside:
        """Return the simulator of the whole DLO, or of what a bore leaves outside of it.

        `front`: the Rod of the part in front of the gripper.
        """
        if front is None or front.length == self.simulator.parts[1].rod.length:
            return self.simulator
        return self.simulator.with_rod(followed_by(self.context.rod, self.simulator.at, front))

    def _backs(self, plan: Plan) -> list[Shape]:
        """Return the Shapes of the part behind the gripper along a Plan of the part in front."""
        return self.simulator.without_obstacles().behind(plan.grippers, self.context.initial)

    def _joined(self, plan: Plan, backs: Sequence[Shape]) -> Plan:
        """Return a Plan of the part in front with the shapes of the whole DLO, not judged."""
        shapes = [self._held(front.rod).joined(back, front)
                  for back, front in zip(backs, plan.shapes, strict=True)]
        passes: list[Passes] = [
            tuple((center, s + self.at, normal) for center, s, normal in each)
            for each in plan.via_points]
        holes = Holes(self.cutouts, self.context.rod.length, self.demands.obstacles,
                      self.demands.surface)
        placed = [holes.passed(Waypoint(shape)) for shape in shapes]
        return replace(
            plan, shapes=tuple(shapes), via_points=tuple(passes), sheets=placed[0].sheets,
            clearances=padded_clearances([waypoint.clearances for waypoint in placed]),
            clearance=np.array([waypoint.clearance for waypoint in placed]))

    def _through(self, back: Shape) -> float:
        """Return how far (m) the part behind the gripper hangs through a sized cut-out, or 0.

        It is clear of the sheet there, but not where it should be.
        """
        deepest = 0.0
        for cutout in self.cutouts:
            size = cutout.radius or 0.5 * np.hypot(cutout.width or 0.0, cutout.height or 0.0)
            away = back.positions - cutout.center
            depth = away @ cutout.normal
            for k in np.flatnonzero((depth[1:] > 0) != (depth[:-1] > 0)):
                share = depth[k] / (depth[k] - depth[k + 1])
                place = away[k] + share * (away[k + 1] - away[k])
                if np.linalg.norm(place) < size:
                    deepest = max(deepest, float(depth.max()))
        return deepest

    def _waypoints(self, plan: Plan) -> list[Waypoint]:
        """Return the Waypoints of a Plan of the whole DLO."""
        return [Waypoint(point.shape, point.misalignment, point.position_error, passes,
                         tuple(rooms), plan.sheets) for point, passes, rooms in zip(
                             plan, plan.via_points, plan.clearances, strict=True)]


def front_of(plan: Plan, surface: Surface) -> Plan:
    """Return the Plan of the part in front of the gripper, as that of a DLO with a Surface.

    Its clearances are of that part alone; `clearance` stays, of all.

    Raises
    ------
    InvalidTask
        The plan is of a DLO that is not held in one place inside.
    """
    at = grasped_at(plan.shapes[0])
    if at is None or any(grasped_at(shape) != at for shape in plan.shapes):
        raise InvalidTask('plan: expected shapes of one DLO that the gripper holds in one place '
                          'inside')
    fronts = [shape.parts[1] for shape in plan.shapes if shape.parts is not None]
    bodies = Bodies(plan.sheets, (), surface)
    passes: list[Passes] = [tuple((center, s - at, normal) for center, s, normal in each)
                            for each in plan.via_points]
    return replace(
        plan, shapes=tuple(fronts), via_points=tuple(passes),
        clearances=plan.clearances if not bodies else np.array(list(map(bodies.holes, fronts))))
