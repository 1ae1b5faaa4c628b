# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan as the motion that is executed: timed so that the DLO arrives calm, and verified."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import Infeasible, InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, items, number
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.surface import Surface
from dlo_planner.model.value import brief, put
from dlo_planner.plan.motion.calm import LegTask, calm_law, margin, predicted
from dlo_planner.plan.motion.in_motion import InMotion, in_motion, least_clearance, watched
from dlo_planner.plan.motion.leg_tasks import leg_tasks
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.time_law import TimeLaw
from dlo_planner.plan.motion.timed_path import TimedPath, fastest_law
from dlo_planner.plan.passing import means_to_touch
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress, Progress

_ROOM = 0.25        # part of the room in a hole that the default tolerance is
_TOLERANCE = 1e-3   # m, where no hole has a size
_SLOWEST = 16.0     # times as long as the limits ask for: slower is no motion any more
_ROUNDS = 7         # of aiming lower
_SPARE = 0.9        # part of the tolerance that is aimed at again
_TOUCHED = 2.0      # times the tolerance: what a touch that is not planned counts as
_SAME = 1e-9        # of the length


class Trajectory(TimedPath):
    """A Plan as the gripper's motion in time, which is validated, published and executed.

    The path runs through the plan's poses (`plan.path`), with stops at its corners and dwells.
    On each leg between stops it is the fastest motion found that keeps the limits and leaves the
    DLO calm: the rates are shaped by the DLO's natural periods (`plan.motion.calm`), and the whole
    is run through `DirectSimulator.simulate`, with the damping that the rod has and with none. If
    the DLO then misses by more than the tolerance, the laws are made calmer.

    Parameters
    ----------
    plan : Plan
        Plan with two poses at least.
    limits : Limits, optional
        Limits. If None, the default ones.
    tolerance : float, optional
        Tolerance in m, by which the DLO in motion may miss the centers of its cut-outs more than
        the plan does, come nearer to a rim or an obstacle than the plan says (or by a quarter of
        that room, if it is more), or still vibrate when the gripper has stopped; what is outside of
        a bore may deviate by as much from its shape at rest. If None, a quarter of the least room
        at the rims, 1 mm where no cut-out has a size. Infinite: the fastest motion within limits,
        nothing is simulated.
    simulator : DirectSimulator, optional
        DirectSimulator that verifies. If None, one of the plan's shapes' DLO, with its load, and
        with its obstacles if the plan touches them.
    initial : Shape, optional
        Shape at the first pose, at rest. If None, the plan's first.
    obstacles : iterable of obstacle, optional
        Obstacles from which the DLO has to stay away in motion, besides the sheets of the plan.
    progress : callable, optional
        Called as progress(done, total) after each step.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, there is no limit.

    Attributes
    ----------
    tolerance : float
        Tolerance in m.
    motion : InMotion or None
        InMotion, the worse of both runs; None with an infinite tolerance.
    mode_margin : float
        Part by which all natural frequencies may be off, up or down, until the miss is twice the
        tolerance, as far as the modes tell; nan where that is not known.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    Infeasible
        The DLO cannot be made calm within 16 times the fastest duration; the constraint is 'miss',
        'clearance', 'contact' (a touch that is not planned), 'departure' or 'motion', the amount is
        in m.
    DeadlineExceeded
        The deadline is over.
    """

    PARTS: tuple[str, ...] = ('path', 'laws', 'limits', 'tolerance', 'motion', 'mode_margin')

    tolerance: float
    motion: InMotion | None
    mode_margin: float

    def __init__(self, plan: Plan, limits: Limits | None = None, *, tolerance: float | None = None,
                 simulator: DirectSimulator | None = None, initial: Shape | None = None,
                 obstacles: Iterable[Obstacle] = (), progress: OnProgress = None,
                 deadline: float | None = None) -> None:
        instance('plan', plan, Plan)
        limits = Limits() if limits is None else instance('limits', limits, Limits)
        instance('initial', initial, Shape, optional=True)
        path = GripperPath.of(plan)
        tolerance = _tolerance(tolerance, plan)
        laws = tuple(fastest_law(leg, limits) for leg in path.legs)
        super().__init__(path, laws, limits)
        put(self, tolerance=tolerance, motion=None, mode_margin=np.nan)
        if tolerance == np.inf:
            return
        search = _Search(plan, TimedPath(path, laws, limits), tolerance,
                         _simulator(simulator, plan), initial or plan.shapes[0],
                         items('obstacles', obstacles, OBSTACLES), Progress(progress, deadline))
        way, motion, spare = search.found()
        put(self, motion=motion, mode_margin=spare,
            **{name: getattr(way, name) for name in ('laws', 'starts', 'duration')})

    def __repr__(self) -> str:
        said = '' if self.motion is None else f'miss {self.motion.position_error:.2g} m'
        return brief(self, f'{self.duration:.4g} s', f'{len(self.path.legs)} legs', said)


def restored(path: GripperPath, laws: tuple[TimeLaw | None, ...], limits: Limits,
             tolerance: float, motion: InMotion | None, mode_margin: float) -> Trajectory:
    """Return a saved Trajectory from its attributes, without a search."""
    way = Trajectory.__new__(Trajectory)
    TimedPath.__init__(way, path, laws, limits)
    put(way, tolerance=tolerance, motion=motion, mode_margin=mode_margin)
    return way


class _Search:
    """Looks for the fastest laws with which a plan's DLO stays calm.

    Parameters
    ----------
    plan : Plan
    fastest : TimedPath
        TimedPath within limits alone.
    tolerance : float
        Tolerance in m.
    simulator : DirectSimulator
        DirectSimulator that verifies.
    first : Shape
        Shape at the beginning.
    obstacles : tuple of obstacle
    progress : Progress
    """

    def __init__(self, plan: Plan, fastest: TimedPath, tolerance: float, simulator: DirectSimulator,
                 first: Shape, obstacles: tuple[Obstacle, ...], progress: Progress) -> None:
        self._plan, self._fastest, self._tolerance = plan, fastest, tolerance
        self._obstacles, self._progress = watched(simulator, plan, obstacles), progress
        rod = simulator.rod
        self._simulators = [simulator]
        if np.any(rod.damping):
            self._simulators.append(simulator.with_rod(replace(rod, damping=0.0)))
        self._first = first if first.far_end is not None else simulator.solve(first.gripper, first)
        self._tasks = leg_tasks(simulator, plan, fastest.path, fastest.limits, self._first,
                                self._progress.check)
        # as planned, nan if there is nothing to be near to
        self._room = least_clearance(plan, self._obstacles, Surface.of(rod), plan.shapes)

    def found(self) -> tuple[TimedPath, InMotion, float]:
        """Return the TimedPath, its InMotion, and the part by which frequencies may be off."""
        aim, slower = self._tolerance, 1.0
        what, least, duration = '', np.inf, np.inf
        for _ in range(_ROUNDS):
            way, known = self._way(aim, slower)
            motion = self._moved(way)
            name, used = self._used(motion)
            if used <= 1:
                return way, motion, self._margin(way, motion)
            if not what or used < least:
                what, least, duration = name, used, way.duration
            if way.duration > _SLOWEST * self._fastest.duration:
                break
            # lower than what this way seemed to keep: else the same one would be found again
            kept = max((one for one in known if one <= aim), default=aim)
            aim = kept * max(min(_SPARE / used, _SPARE), 0.25)
            slower *= np.sqrt(2) if used < 4 else 2.0
        if what == 'contact':
            raise Infeasible('limits: in motion the DLO touches what the plan does not', len(
                self._plan) - 1, what, float((least - 1) * self._tolerance), self._plan)
        raise Infeasible(
            f'limits: the DLO is not calm: {what} in motion, {least * self._tolerance:.3g} m at '
            f'best, in {duration:.3g} s: expected at most {self._tolerance:.3g} m',
            len(self._plan) - 1, what, float((least - 1) * self._tolerance), self._plan)

    def _way(self, aim: float, slower: float) -> tuple[TimedPath, list[float]]:
        """Return a TimedPath, and the largest deviations of its legs as far as modes tell, m."""
        laws: list[TimeLaw | None] = []
        known: list[float] = []
        before: LegTask | None = None
        states: list[Floats] = []
        for leg, task, law in zip(self._fastest.path.legs, self._tasks, self._fastest.laws,
                                  strict=True):
            self._progress.check()
            if task is not None:
                begins = task.rest if before is None else task.taken_over(before, states)
                calm = calm_law(task, aim, begins, self._progress.check)
                laws.append(calm)
                known.append(predicted(task, calm, begins))
                before, states = task, task.after(calm, begins)
            else:
                laws.append(law if law is None else law.slower(slower))
                if before is not None:  # a dwell
                    states = before.waited(states, np.ptp(leg.knots))
        return TimedPath(self._fastest.path, tuple(laws), self._fastest.limits), known

    def _moved(self, way: TimedPath) -> InMotion:
        found = [in_motion(simulator, self._plan, way, self._first, self._obstacles, self._progress)
                 for simulator in self._simulators]
        return found[0] if len(found) == 1 else found[0].worse(found[1])

    def _used(self, motion: InMotion) -> tuple[str, float]:
        """Return the name of what uses most of the tolerance, and which part of it."""
        if not motion.converged:
            return 'motion', np.inf
        used = {'miss': self._missed(motion) / self._tolerance,
                'departure': motion.departure / self._tolerance}
        if not np.isnan(motion.clearance):
            # far from everything more may be lost than where it is narrow; between two waypoints
            # the plan may come nearer than at both
            room = min(self._room, motion.calm_clearance)
            used['clearance'] = (room - motion.clearance) / max(self._tolerance, _ROOM * room)
            if motion.clearance <= 0:
                used['clearance'] = np.fmax(used['clearance'],
                                            1 - motion.clearance / self._tolerance)
        if motion.contact_force > 0 and not means_to_touch(self._plan):
            used['contact'] = _TOUCHED
        return max(((name, part) for name, part in used.items() if not np.isnan(part)),
                   key=lambda one: one[1])

    def _missed(self, motion: InMotion) -> float:
        """Return by how much a motion misses more than the plan, m; nan without a center."""
        return float(motion.position_error - self._plan.position_error.max())

    def _margin(self, way: TimedPath, motion: InMotion) -> float:
        """Return by which part frequencies may be off until the miss is twice the tolerance."""
        known = [(task, law) for task, law in zip(self._tasks, way.laws, strict=True)
                 if task is not None and law is not None]
        if not known:
            return np.nan
        worst = max(motion.departure, np.nan_to_num(self._missed(motion)))
        return min(margin(task, law, 2 * self._tolerance * max(
            1.0, predicted(task, law) / worst)) for task, law in known)


def _simulator(simulator: DirectSimulator | None, plan: Plan) -> DirectSimulator:
    """Return the DirectSimulator that verifies a Plan; raise InvalidTask if there is none."""
    first = plan.shapes[0]
    length = float(first.s[-1]) + (0.0 if first.far_end is None else float(plan.depths[0]))
    if any(shape.parts is not None for shape in plan.shapes) or any(
            shape.far_end is None and abs(shape.s[-1] - length) > _SAME * length
            for shape in plan.shapes):
        raise InvalidTask('plan: expected shapes of one DLO that the gripper holds at its '
                          'beginning, as `simulate` has it; a tolerance of infinity asks for no '
                          'simulation')
    if simulator is None and first.far_end is not None:
        raise InvalidTask('simulator = None: expected the DirectSimulator of the whole DLO for an '
                          f'insertion that begins {plan.depths[0]:g} m deep')
    if simulator is None:
        return simulator_of(first, means_to_touch(plan))
    if abs(clamping('simulator', simulator).rod.length - length) > _SAME * length:
        raise InvalidTask(f'simulator: expected one of the plan\'s DLO, {length:g} m long, its rod '
                          f'has {simulator.rod.length:g} m')
    return simulator


def simulator_of(shape: Shape, touching: bool) -> DirectSimulator:
    """Return a DirectSimulator of the DLO that a Shape is of, with its load.

    Parameters
    ----------
    touching : bool
        Whether its obstacles are touched; else there are none.
    """
    if shape.state.mesh is None:
        raise InvalidTask('simulator = None: expected a DirectSimulator, the shapes of this plan '
                          'do not know of theirs')
    around = shape.state.mesh.surroundings
    return DirectSimulator(around.rod, gravity=around.gravity, load=around.load,
                           point_loads=around.point_loads,
                           obstacles=around.obstacles if touching else ())


def _tolerance(tolerance: float | None, plan: Plan) -> float:
    if tolerance is not None:
        endless = isinstance(tolerance, float) and tolerance == np.inf
        return tolerance if endless else number('tolerance', tolerance, above=0)
    rooms = plan.clearances[:, :, 0]
    rooms = rooms[np.isfinite(rooms) & (rooms > 0)]
    return float(_ROOM * rooms.min()) if rooms.size else _TOLERANCE
