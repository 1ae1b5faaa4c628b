# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The search for a motion in which a plan's DLO stays calm: laws from its modes, then simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import Infeasible
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.surface import Surface
from dlo_planner.plan.motion.calm import LegTask, calm_law, margin, predicted
from dlo_planner.plan.motion.in_motion import InMotion, in_motion, least_clearance, step_error
from dlo_planner.plan.motion.leg_tasks import leg_tasks
from dlo_planner.plan.motion.time_law import TimeLaw
from dlo_planner.plan.motion.timed_path import TimedPath
from dlo_planner.plan.passing import means_to_touch
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import Progress

ROOM = 0.25         # part of the room in a hole that the default tolerance is
_SLOWEST = 16.0     # times as long as the limits ask for: slower is no motion any more
_ROUNDS = 7         # of aiming lower
_SPARE = 0.9        # part of the tolerance that is aimed at again
_TOUCHED = 2.0      # times the tolerance: what a touch that is not planned counts as


@dataclass(frozen=True, eq=False)
class CalmSearch:
    """Looks for the fastest laws with which a plan's DLO stays calm.

    Attributes
    ----------
    plan : Plan
    fastest : TimedPath
        TimedPath within limits alone.
    tolerance : float
        Tolerance in m.
    simulator : DirectSimulator
        DirectSimulator that verifies.
    begin : Shape
        Shape at the beginning.
    obstacles : tuple of obstacle
        Obstacles from which the DLO has to stay away.
    progress : Progress
    """

    plan: Plan
    fastest: TimedPath
    tolerance: float
    simulator: DirectSimulator
    begin: Shape
    obstacles: tuple[Obstacle, ...]
    progress: Progress

    @cached_property
    def _simulators(self) -> list[DirectSimulator]:
        """With the rod's damping, and without any."""
        rod = self.simulator.rod
        if not np.any(rod.damping):
            return [self.simulator]
        return [self.simulator, self.simulator.with_rod(replace(rod, damping=0.0))]

    @cached_property
    def _first(self) -> Shape:
        """The Shape at the beginning, in equilibrium."""
        begin = self.begin
        if begin.far_end is not None:
            return begin
        return self.simulator.solve(begin.gripper, begin)

    @cached_property
    def _tasks(self) -> Sequence[LegTask | None]:
        """A LegTask for each leg, None for a dwell."""
        return leg_tasks(self.simulator, self.plan, self.fastest.path, self.fastest.limits,
                         self._first, self.progress.check)

    @cached_property
    def _room(self) -> float:
        """Clearance as planned, m; nan if there is nothing to be near to."""
        return least_clearance(self.plan, self.obstacles, Surface.of(self.simulator.rod),
                               self.plan.shapes)

    def run(self) -> tuple[TimedPath, InMotion, float]:
        """Return the TimedPath, its InMotion, and the part by which frequencies may be off."""
        aim, slower = self.tolerance, 1.0
        what, least, duration = '', np.inf, np.inf
        for _ in range(_ROUNDS):
            timed, known = self._timed(aim, slower)
            motions = self._moved(timed)
            motion = _worst(motions)
            name, used = self._used(motion)
            if used <= 1:
                return timed, self._with_error(timed, motions), self._margin(timed, motion)
            if not what or used < least:
                what, least, duration = name, used, timed.duration
            if timed.duration > _SLOWEST * self.fastest.duration:
                break
            # lower than what this way seemed to keep: else the same one would be found again
            kept = max((one for one in known if one <= aim), default=aim)
            aim = kept * max(min(_SPARE / used, _SPARE), 0.25)
            slower *= np.sqrt(2) if used < 4 else 2.0
        if what == 'contact':
            raise Infeasible('limits: in motion the DLO touches what the plan does not', len(
                self.plan) - 1, what, float((least - 1) * self.tolerance), self.plan)
        raise Infeasible(
            f'limits: the DLO is not calm: {what} in motion, {least * self.tolerance:.3g} m at '
            f'best, in {duration:.3g} s: expected at most {self.tolerance:.3g} m',
            len(self.plan) - 1, what, float((least - 1) * self.tolerance), self.plan)

    def _timed(self, aim: float, slower: float) -> tuple[TimedPath, list[float]]:
        """Return a TimedPath, and the largest deviations of its legs as far as modes tell, m."""
        laws: list[TimeLaw | None] = []
        known: list[float] = []
        before: LegTask | None = None
        states: list[Floats] = []
        for leg, task, law in zip(self.fastest.path.legs, self._tasks, self.fastest.laws,
                                  strict=True):
            self.progress.check()
            if task is not None:
                begins = task.rest if before is None else task.taken_over(before, states)
                calm = calm_law(task, aim, begins, self.progress.check)
                laws.append(calm)
                known.append(predicted(task, calm, begins))
                before, states = task, task.after(calm, begins)
            else:
                laws.append(law if law is None else law.slower(slower))
                if before is not None:  # a dwell
                    states = before.waited(states, np.ptp(leg.knots))
        return TimedPath(self.fastest.path, tuple(laws), self.fastest.limits), known

    def _moved(self, timed: TimedPath) -> list[InMotion]:
        return [in_motion(simulator, self.plan, timed, self._first, self.obstacles,
                          self.progress) for simulator in self._simulators]

    def _with_error(self, timed: TimedPath, motions: Sequence[InMotion]) -> InMotion:
        """Return the worst of motions by each simulator, the errors of their steps in it."""
        return _worst([replace(motion, error_estimate=motion.error_estimate + step_error(
            simulator, self.plan, timed, self._first, motion, self.progress))
            for simulator, motion in zip(self._simulators, motions, strict=True)])

    def _used(self, motion: InMotion) -> tuple[str, float]:
        """Return the name of the figure that uses most of the tolerance, and the part it uses."""
        if not motion.converged:
            return 'motion', np.inf
        used = {'miss': self._missed(motion) / self.tolerance,
                'departure': motion.departure / self.tolerance}
        if not np.isnan(motion.clearance):
            # far from everything more may be lost than where it is narrow; between two waypoints
            # the plan may come nearer than at both
            room = min(self._room, motion.calm_clearance)
            used['clearance'] = (room - motion.clearance) / max(self.tolerance, ROOM * room)
            if motion.clearance <= 0:
                used['clearance'] = np.fmax(used['clearance'],
                                            1 - motion.clearance / self.tolerance)
        if motion.contact_force > 0 and not means_to_touch(self.plan):
            used['contact'] = _TOUCHED
        return max(((name, part) for name, part in used.items() if not np.isnan(part)),
                   key=lambda one: one[1])

    def _missed(self, motion: InMotion) -> float:
        """Return by how much a motion misses more than the plan, m; nan without a center."""
        return float(motion.position_error - self.plan.position_error.max())

    def _margin(self, timed: TimedPath, motion: InMotion) -> float:
        """Return by which part frequencies may be off until the miss is twice the tolerance."""
        known = [(task, law) for task, law in zip(self._tasks, timed.laws, strict=True)
                 if task is not None and law is not None]
        if not known:
            return np.nan
        worst = max(motion.departure, np.nan_to_num(self._missed(motion)))
        return min(margin(task, law, 2 * self.tolerance * max(
            1.0, predicted(task, law) / worst)) for task, law in known)


def _worst(motions: Sequence[InMotion]) -> InMotion:
    return motions[0] if len(motions) == 1 else motions[0].worse(motions[1])
