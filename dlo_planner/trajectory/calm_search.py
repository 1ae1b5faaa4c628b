# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The search for a motion that leaves the DLO at rest: laws from its modes, then simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dlo_planner.blas import one_thread
from dlo_planner.direct.grasp import Simulator, held_at
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import DeadlineExceeded, Infeasible, InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.rod import Surface
from dlo_planner.model.varying import scaled
from dlo_planner.plan.checks import Margin, motion_margins
from dlo_planner.plan.clearance import Bodies
from dlo_planner.plan.continuity import solved_as
from dlo_planner.plan.path import GripperPath, Leg, held_after
from dlo_planner.plan.plan import Plan, arc_length_at, means_to_touch
from dlo_planner.plan.requirements import Limits
from dlo_planner.progress import Progress
from dlo_planner.trajectory.dynamic_check import (
    InMotion,
    calm_shapes,
    in_motion,
    instants,
    misses,
    step_error,
    unplanned,
)
from dlo_planner.trajectory.modal_response import Response
from dlo_planner.trajectory.shaping import SLOWEST, LegTask, calm_law, margin, predicted
from dlo_planner.trajectory.time_law import TimeLaw
from dlo_planner.trajectory.timed_path import TimedPath

_ELEMENTS = 32   # of the DLO whose modes are looked at
_WRONG = (0.9, 1.1)  # factors of the stiffness with which a DLO is calm, too


def leg_tasks(simulator: Simulator, plan: Plan, path: GripperPath, limits: Limits,
              first: Shape, check: Callable[[], None]) -> list[LegTask | None]:
    """Return a LegTask for each leg of a path; None for a dwell, or where modes are not known."""
    quick, bore = _quick(simulator), held_after(plan)
    wrong = {factor: _with_stiffness(quick, factor) for factor in _WRONG}
    begins: dict[float, Shape] = {}
    shape: Shape | None = None
    tasks: list[LegTask | None] = []
    for leg in path.legs:
        check()
        # what a bore holds vibrates quickly outside, and little
        if leg.still or bore is not None and leg.knots[-1] > plan.times[bore]:
            tasks.append(None)
            continue
        try:
            shape = shape or solved_as(quick, first)
            response = Response.of(quick, leg, shape, check=check, arms=path.arms)
        except InvalidTask:  # a shape without modes: neutral, or in contact with friction
            return [None] * len(path.legs)
        shape = response.shapes[-1]
        tasks.append(LegTask(leg, response, limits, holes_passed(plan, response.parameters),
                             leg is path.legs[-1],
                             tuple(_wrong(one, factor, response, leg, path.arms, begins, check)
                                   for factor, one in wrong.items()), plan.plug is not None))
    return tasks


def _wrong(simulator: Simulator, factor: float, response: Response, leg: Leg, arms: Sequence[str],
           begins: dict[float, Shape], check: Callable[[], None]) -> Response:
    """Return the Response of a DLO whose stiffness is wrong by a factor, at the same parameters.

    Where such a DLO falls or has no modes, `response` with other frequencies. `begins` are the
    shapes in which the leg before has left such DLOs.
    """
    try:
        begin = begins.pop(factor, None) or solved_as(simulator, response.shapes[0])
        wrong = Response.of(simulator, leg, begin, response.parameters, check, arms)
        if all(shape.converged and not shape.jumped for shape in wrong.shapes):
            begins[factor] = wrong.shapes[-1]
            return wrong
    except InvalidTask:
        pass
    return response.faster(np.sqrt(factor))


def _with_stiffness(simulator: Simulator, factor: float) -> Simulator:
    rod = simulator.rod
    return simulator.with_rod(replace(
        rod, bending_stiffness=scaled(rod.bending_stiffness, factor),
        torsional_stiffness=scaled(rod.torsional_stiffness, factor)))


def _quick(simulator: Simulator) -> Simulator:
    """Return a simulator of the same DLO on a fixed, coarse mesh, for its modes."""
    around = simulator.surroundings
    quick = DirectSimulator(around.rod, n_elements=_ELEMENTS, basis='local', load=around.load,
                            gravity=around.gravity, point_loads=around.point_loads,
                            obstacles=around.obstacles)
    return quick if isinstance(simulator, DirectSimulator) else held_at(quick, simulator.at)


_ROUNDS = 7         # of aiming lower
_SPARE = 0.9        # part of the tolerance that is aimed at again
_STRAYS = 1.2       # times the tolerance: a shift of the gripper brings back less
_SURELY = 1.3       # times slower than a lag seems to need
# statuses of a Trajectory
COMPLETE = 'complete'
DEADLINE = 'it leaves the DLO at rest, but not all is known of it: the deadline came first'


@dataclass(eq=False)
class CalmSearch:
    """Looks for the fastest laws that leave a plan's DLO at rest, round by round."""

    plan: Plan
    fastest: TimedPath  # within limits alone
    tolerance: float  # tolerance in m
    simulator: Simulator  # that verifies
    begin: Shape  # at the beginning
    obstacles: tuple[Obstacle, ...]  # obstacles from which the DLO has to stay away
    progress: Progress
    rounds: int | None = None  # how many laws are simulated at most. If None, _ROUNDS

    def __post_init__(self) -> None:
        self._rounds, self._aim, self._slower = 0, self.tolerance, 1.0
        self._inside = 0.0  # m, of the DLO in what is in its way, however slow it is
        self._missed_by = _Missed()

    @cached_property
    def _simulators(self) -> list[Simulator]:
        """Without any damping, and with the rod's."""
        rod = self.simulator.rod
        if not np.any(rod.damping):
            return [self.simulator]
        return [self.simulator.with_rod(replace(rod, damping=0.0)), self.simulator]

    @cached_property
    def _free(self) -> Simulator:
        """The simulator, without the obstacles that the DLO is not meant to touch."""
        if unplanned(self.simulator, self.plan):
            return self.simulator.without_obstacles()
        return self.simulator

    @cached_property
    def _first(self) -> Shape:
        """The Shape at the beginning, in equilibrium."""
        if self.begin.holds and held_after(self.plan) is not None:
            return self.begin
        return solved_as(self._free, self.begin)

    @cached_property
    def _damped_tasks(self) -> Sequence[LegTask | None]:
        return leg_tasks(self._free, self.plan, self.fastest.path, self.fastest.limits,
                         self._first, self.progress.check)

    @cached_property
    def _damping_ratio(self) -> float:
        """Largest one of the slowest vibration; above 1 the DLO lags behind and creeps to rest.

        How far depends on the speed alone, of which modes tell nothing.
        """
        return max((float(task.response.damping[:, 0].max()) for task in self._damped_tasks
                    if task is not None), default=0.0)

    @cached_property
    def _tasks(self) -> Sequence[LegTask | None]:
        """A LegTask for each leg, None for a dwell; of a DLO that creeps: as if it did not."""
        if self._damping_ratio <= 1:
            return self._damped_tasks
        return [task and task.undamped() for task in self._damped_tasks]

    @cached_property
    def _slow(self) -> Sequence[Shape] | None:
        """The Shapes of the DLO that follows the path slowly; None of one that a bore takes."""
        return calm_shapes(self._free, self.plan, self.fastest, self._first, self.progress)

    @cached_property
    def _strays(self) -> float:
        """By how much (m) the DLO misses between the waypoints, more than at them, at any speed."""
        if self._slow is None or not any(self.plan.via_points):
            return 0.0
        reached = self.fastest.progress(instants(self.simulator, self.fastest, self._first))
        return float(misses(self.plan, reached, self._slow).max()
                     - self.plan.position_error.max())

    @property
    def slowest_period(self) -> float:
        """The longest period (s) of the DLO's vibrations on the way; nan where it never moves."""
        return max((2 * np.pi / float(task.response.rates.min()) for task in self._tasks
                    if task is not None), default=np.nan)

    @cached_property
    def _room(self) -> float:
        """Clearance as planned, m; nan if there is nothing to be near to."""
        return Bodies(self.plan.sheets, self.obstacles,
                      Surface.of(self.simulator.rod)).least(self.plan.shapes)

    @property
    def _hopeless(self) -> bool:
        """Whether the DLO strays so far that no motion can keep the tolerance, aside or not."""
        return self._strays > _STRAYS * self.tolerance

    @property
    def over(self) -> bool:
        """Whether no other law is left to be tried."""
        return (not self._first.converged or self._inside > 0 or self._hopeless
                or self._rounds >= (_ROUNDS if self.rounds is None else self.rounds)
                or self._missed_by.slowest > SLOWEST * self.fastest.duration
                or self._slower > SLOWEST and self._damping_ratio > 1)

    def go_on(self, below: float = np.inf) -> Calm | None:
        """Return what the next laws come to if they leave the DLO at rest; None if not.

        Laws that take `below` s or longer are not simulated.
        """
        timed, known = self._timed(self._aim, self._slower)
        if timed.duration >= below:
            return None
        motions = self._moved(timed)
        motion = _worst(motions)
        worst = self._most_used(motion)
        if worst.used <= 1:
            return Calm(self, timed, motions, _worst([
                replace(one, error_estimate=np.inf) for one in motions]))
        if motion.converged:
            self._inside = self._depth(motion)
        missed = self._missed_by
        if missed.margin is None or worst.used < missed.margin.used:
            missed = _Missed(worst, timed.duration, missed.slowest)
        # lower than what this way seemed to keep: else the same one would be found again
        kept = max((one for one in known if one <= self._aim), default=self._aim)
        self._missed_by = replace(missed, slowest=max(missed.slowest, timed.duration))
        if self._damping_ratio > 1:  # it lags by as much less as it is slower
            slower = _SURELY * worst.used * self._slower
            self._slower = slower if self._slower == SLOWEST else min(slower, SLOWEST)
        else:
            self._aim = kept * max(min(_SPARE / worst.used, _SPARE), 0.25)
            self._slower *= np.sqrt(2) if worst.used < 4 else 2.0
        self._rounds += 1
        return None

    def _depth(self, motion: InMotion) -> float:
        """Return how deep the DLO that follows slowly is in something, m; not by a shift alone."""
        if self._slow is None:
            return -float(np.fmin(motion.calm_gap, np.fmin(motion.calm_clearance, 0.0)))
        bodies = Bodies(self.plan.sheets, (*self.obstacles, *unplanned(self.simulator, self.plan)),
                        Surface.of(self.simulator.rod))
        return -float(np.fmin(bodies.least(self._slow), 0.0))

    def refusal(self) -> Infeasible:
        """Return Infeasible: no law that was tried is calm."""
        broken = self._missed_by.margin
        if not self._first.converged:
            return Infeasible(f'limits: where the motion begins, the DLO is '
                              f'{self._first.status}', 0, 'motion', np.inf, self.plan, '')
        if self._hopeless:
            return Infeasible('limits: however slow it is, between the waypoints the DLO misses '
                              f'by {self._strays:.3g} m more than at them: expected at most '
                              f'{self.tolerance:.3g} m; closer waypoints help', len(self.plan) - 1,
                              'miss', self._strays - self.tolerance, self.plan)
        assert broken is not None  # of the laws that were tried
        name, said, amount, unit = broken.name, f'limits: {self.reached}', -broken.room, broken.unit
        if self._inside > 0:
            name, amount, unit = name if name == 'contact' else 'clearance', self._inside, 'm'
            said = ('limits: however slow it is, the DLO touches what the plan does not, '
                    f'{amount:.3g} m deep')
        elif broken.name in ('miss', 'departure'):
            said = (f'limits: the DLO does not come to rest: {self.reached}: expected at most '
                    f'{self.tolerance:.3g} m')
            if self._damping_ratio > 1:
                said += (f'; it lags behind: the damping ratio of its slowest vibration is '
                         f'{self._damping_ratio:.3g}')
        return Infeasible(said, len(self.plan) - 1, name, float(amount), self.plan, unit)

    @property
    def reached(self) -> str:
        """What the best laws so far come to, in words; empty before there are any."""
        broken, duration = self._missed_by.margin, self._missed_by.duration
        if broken is None:
            return ''
        if broken.name == 'motion':
            return 'no motion that was tried could be simulated to its end'
        if broken.name not in ('miss', 'departure'):
            return f'{broken.message}, at best, in {duration:.3g} s'
        return (f'{broken.name} in motion, {broken.used * self.tolerance:.3g} m at best, in '
                f'{duration:.3g} s')

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
                if self._damping_ratio > 1 and slower > 1:
                    calm = calm.slower(slower)
                laws.append(calm)
                known.append(predicted(task, calm, begins))
                before, states = task, task.after(calm, begins)
            else:
                laws.append(law if law is None else law.slower(slower))
                if before is not None:  # a dwell
                    states = before.waited(states, np.ptp(leg.knots))
        return TimedPath(self.fastest.path, tuple(laws), self.fastest.limits), known

    def _moved(self, timed: TimedPath) -> list[InMotion]:
        """Return the InMotion of each simulator, of none after the first that is not calm."""
        calm = calm_shapes(self._free, self.plan, timed, self._first, self.progress)
        motions: list[InMotion] = []
        for simulator in self._simulators:
            motions.append(in_motion(simulator, self.plan, timed, self._first, self.obstacles,
                                     self.progress, touched=False, calm=calm))
            if self._most_used(motions[-1]).used > 1:
                break
        return motions

    @one_thread()
    def assessed(self, calm: Calm) -> Calm:
        """Return Calm with its error estimate and mode margin, or those that time was left for."""
        timed, motions = calm.timed, calm.motions
        try:
            motion = self._with_error(timed, motions)
            calm = replace(calm, motion=motion)
            return replace(calm, mode_margin=self._margin(timed, motion), status=COMPLETE)
        except DeadlineExceeded:
            return calm

    def _with_error(self, timed: TimedPath, motions: Sequence[InMotion]) -> InMotion:
        """Return the worst of motions by each simulator, the errors of their steps in it."""
        return _worst([replace(motion, error_estimate=motion.error_estimate + step_error(
            simulator, self.plan, timed, self._first, motion, self.progress))
            for simulator, motion in zip(self._simulators, motions, strict=True)])

    def _most_used(self, motion: InMotion) -> Margin:
        """Return the Margin of which most is used."""
        return max(motion_margins(vars(motion), self.plan.position_error.max(), self.tolerance,
                                  means_to_touch(self.plan), self._room, self.plan.wrench_limits),
                   key=lambda one: one.used)

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
        # what hangs straight down and goes down does not vibrate at all
        return min(margin(task, law, 2 * self.tolerance * (max(
            1.0, predicted(task, law) / worst) if worst else 1.0), self.progress.check)
            for task, law in known)


@dataclass(frozen=True)
class _Missed:
    """What a search came to: the margin that fails least, the duration with it, the longest one."""

    margin: Margin | None = None
    duration: float = np.inf
    slowest: float = 0.0


@dataclass(frozen=True)
class Calm:
    """A motion that is calm."""

    search: CalmSearch  # that found it
    timed: TimedPath
    motions: list[InMotion]  # InMotion of each simulator
    motion: InMotion  # the worse of them
    mode_margin: float = np.nan  # part by which frequencies may be off, nan: not known
    status: str = DEADLINE  # COMPLETE, or what is not known of it


@one_thread()
def quickest(searches: Sequence[CalmSearch]) -> Calm:
    """Return the quickest settled motion that one of several searches finds, for plans of one task.

    Where the deadline comes first, the quickest one until then.
    """
    best: Calm | None = None
    try:
        while best is None:
            left = [search for search in searches if not search.over]
            if not left:
                raise searches[0].refusal()
            for search in left:
                best = search.go_on(np.inf if best is None else best.timed.duration) or best
    except DeadlineExceeded as error:
        if best is None:
            reached = next((one.reached for one in searches if one.reached), 'no motion yet')
            raise DeadlineExceeded(f'{error}: {reached}', error.seconds, error.elapsed) from error
        return best
    return best


def _worst(motions: Sequence[InMotion]) -> InMotion:
    return motions[0] if len(motions) == 1 else motions[0].worse(motions[1])


def holes_passed(plan: Plan, u: Floats) -> Floats:
    """Return (k, n) arc lengths (m) that pass the k centers of a Plan at parameters u (n,).

    nan before the first waypoint that passes a center, and after the last one.
    """
    centers: list[Floats] = []
    for passes in plan.via_points:
        centers += [center for center, _, _ in passes
                    if not any(np.array_equal(center, one) for one in centers)]
    out = np.full((len(centers), len(u)), np.nan)
    for row, center in zip(out, centers, strict=True):
        s = [arc_length_at(center, passes) for passes in plan.via_points]
        known = np.array([k for k, one in enumerate(s) if one is not None])
        times = plan.times[known]
        inside = (u >= times[0]) & (u <= times[-1])
        row[inside] = np.interp(u[inside], times, [s[k] for k in known])
    return out
