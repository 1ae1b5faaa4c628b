# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan as the motion that is executed: timed so that the DLO arrives calm, and verified."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator, clamping
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, items, number
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.value import brief, put
from dlo_planner.plan.motion.calm_search import ROOM, CalmSearch
from dlo_planner.plan.motion.in_motion import InMotion, watched
from dlo_planner.plan.motion.limits import Limits
from dlo_planner.plan.motion.time_law import TimeLaw
from dlo_planner.plan.motion.timed_path import TimedPath, fastest_law
from dlo_planner.plan.passing import means_to_touch
from dlo_planner.plan.path import GripperPath
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress, Progress

_TOLERANCE = 1e-3   # m, where no hole has a size
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
        tolerance, still_to_go = _tolerance(tolerance, plan), Progress(progress, deadline)
        obstacles = items('obstacles', obstacles, OBSTACLES)
        if tolerance < np.inf:
            simulator = _simulator(simulator, plan)
            obstacles = watched(simulator, plan, obstacles)
        path = GripperPath.of(plan)
        laws = tuple(fastest_law(leg, limits) for leg in path.legs)
        super().__init__(path, laws, limits)
        put(self, tolerance=tolerance, motion=None, mode_margin=np.nan)
        if simulator is None or tolerance == np.inf:
            return
        search = CalmSearch(plan, TimedPath(path, laws, limits), tolerance, simulator,
                            initial or plan.shapes[0], obstacles, still_to_go)
        timed, motion, spare = search.run()
        put(self, motion=motion, mode_margin=spare,
            **{name: getattr(timed, name) for name in ('laws', 'starts', 'duration')})

    def __repr__(self) -> str:
        miss = '' if self.motion is None else f'miss {self.motion.position_error:.2g} m'
        return brief(self, f'{self.duration:.4g} s', f'{len(self.path.legs)} legs', miss)


def restored(path: GripperPath, laws: tuple[TimeLaw | None, ...], limits: Limits,
             tolerance: float, motion: InMotion | None, mode_margin: float) -> Trajectory:
    """Return a saved Trajectory from its attributes, without a search."""
    trajectory = Trajectory.__new__(Trajectory)
    TimedPath.__init__(trajectory, path, laws, limits)
    put(trajectory, tolerance=tolerance, motion=motion, mode_margin=mode_margin)
    return trajectory


def _simulator(simulator: DirectSimulator | None, plan: Plan) -> DirectSimulator:
    """Return the DirectSimulator that verifies a Plan; raise InvalidTask if there is none."""
    first = plan.shapes[0]
    length = float(first.s[-1]) + (0.0 if first.far_end is None else float(plan.depths[0]))
    if any(shape.parts is not None for shape in plan.shapes) or any(
            shape.far_end is None and abs(shape.s[-1] - length) > _SAME * length
            for shape in plan.shapes):
        raise InvalidTask('plan: expected shapes of one DLO that the gripper holds at its '
                          'beginning, as in `simulate`; with an infinite tolerance nothing is '
                          'simulated')
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
                          'have none')
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
    return float(ROOM * rooms.min()) if rooms.size else _TOLERANCE
