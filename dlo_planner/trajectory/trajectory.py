# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plan as the motion that is executed: timed so that the DLO arrives at rest, and verified."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from os import PathLike
from typing import Any

import numpy as np

from dlo_planner.direct.grasp import (
    GraspedInside,
    Simulator,
    grasped_at,
    held_as,
    held_at,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.storage import load, save
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, items, number, shown
from dlo_planner.model.holds import alike, have_rings
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.value import brief, put
from dlo_planner.pictured import Reported
from dlo_planner.plan.checks import ROOM
from dlo_planner.plan.path import GripperPath, Leg, held_after
from dlo_planner.plan.plan import Plan, means_to_touch, rooms_in_holes
from dlo_planner.plan.requirements import Limits
from dlo_planner.progress import OnProgress, Progress
from dlo_planner.trajectory.calm_search import CalmSearch, quickest
from dlo_planner.trajectory.dynamic_check import InMotion, instants, watched
from dlo_planner.trajectory.time_law import Shift, TimeLaw
from dlo_planner.trajectory.timed_path import TimedPath, fastest_law

_TOLERANCE = 1e-3   # m, where no hole has a size
_SAME = 1e-9        # of the length
_TRIED = 2          # laws of a plan, of several that are compared
_ARM, _LAW = ('knots', 'positions', 'rotations'), ('parameters', 'rates', 'windows')
_SHIFT = ('knots', 'coefficients')
NOT_SIMULATED = 'not simulated'  # status where the tolerance is infinite


class Trajectory(TimedPath, Reported):
    """A Plan as the gripper's motion in time, which is validated, published and executed.

    The path runs through the plan's poses (`plan.path`), with stops at its corners and dwells.
    On each leg between stops it is the fastest motion found that keeps the limits and leaves the
    DLO calm: the rates are shaped by the DLO's natural periods (`trajectory.shaping`), and all
    of it is run through `DirectSimulator.simulate`, with the damping that the rod has and with
    none. If the DLO then misses by more than the tolerance, the laws are made calmer.

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
        in the cut-outs (of all three parts of the DLO, see `Plan.clearances`), 1 mm where none has
        a size. Infinite: the fastest motion within limits,
        nothing is simulated.
    simulator : DirectSimulator or GraspedInside, optional
        DirectSimulator that verifies, of the whole DLO, wherever the plan holds it. If None, one of
        the plan's shapes' DLO, with its load, and with its obstacles if the plan touches them.
    initial : Shape, optional
        Shape at the first pose, at rest. If None, the plan's first.
    obstacles : iterable of obstacle, optional
        Obstacles from which the DLO has to stay away in motion, besides the sheets of the plan.
    progress : callable, optional
        Called as progress(done, total) after each step.
    deadline : float, optional
        Seconds of computing after which the search ends. If None, there is no limit.

    Attributes
    ----------
    tolerance : float
        Tolerance in m.
    motion : InMotion or None
        InMotion, the worse of both runs; None with an infinite tolerance.
    mode_margin : float
        Part by which all natural frequencies may be off, up or down, until the miss is twice the
        tolerance, as far as the modes tell; nan where that is not known.
    least_duration : float
        Duration in s that the limits alone would allow.
    slowest_period : float
        Period in s of the slowest vibration of the DLO on the way, whose multiples a settled motion
        takes; nan where nothing is simulated.
    status : str
        'complete', 'not simulated' with an infinite tolerance, or, of a motion that is calm, that
        the deadline came before its error estimate (infinite then) and mode margin were known.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    Infeasible
        The DLO cannot be made calm within 16 times the fastest duration; the constraint is 'miss',
        'clearance', 'contact' (a touch that is not planned, or a planned one that is lost),
        'max_bend_curvature', 'departure' or 'motion'; the amount is what is missing, or how deep
        the DLO touches something at any speed: `Infeasible.unit` says which.
    DeadlineExceeded
        The deadline is over before a settled motion was found; the message says what was reached.
    """

    _PARTS: tuple[str, ...] = ('path', 'laws', 'limits', 'tolerance', 'motion', 'mode_margin',
                               'least_duration', 'slowest_period', 'status')

    tolerance: float
    motion: InMotion | None
    mode_margin: float
    least_duration: float
    slowest_period: float
    status: str

    def __init__(self, plan: Plan, limits: Limits | None = None, *, tolerance: float | None = None,
                 simulator: DirectSimulator | GraspedInside | None = None,
                 initial: Shape | None = None, obstacles: Iterable[Obstacle] = (),
                 progress: OnProgress = None, deadline: float | None = None) -> None:
        instance('plan', plan, Plan)
        limits = Limits() if limits is None else instance('limits', limits, Limits)
        instance('initial', initial, Shape, optional=True)
        tolerance, still_to_go = _tolerance(tolerance, plan), Progress(progress, deadline)
        obstacles = items('obstacles', obstacles, OBSTACLES)
        verifying: Simulator | None = None
        if tolerance < np.inf:
            verifying = _simulator(simulator, plan)
            obstacles = watched(verifying, plan, obstacles)
        timed = _within_limits(plan, limits, still_to_go)
        super().__init__(timed.path, timed.laws, limits)
        put(self, tolerance=tolerance, motion=None, mode_margin=np.nan, status=NOT_SIMULATED,
            least_duration=timed.duration, slowest_period=np.nan)
        if verifying is None:
            return
        # where the fastest takes too many, so does each that is calm
        instants(verifying, timed, plan.shapes[0])
        search = CalmSearch(plan, timed, tolerance, verifying, initial or plan.shapes[0],
                            obstacles, still_to_go)
        calm = search.assessed(quickest([search]))
        put(self, motion=calm.motion, mode_margin=calm.mode_margin, status=calm.status,
            slowest_period=search.slowest_period,
            # smoothed otherwise it may be quicker than what the limits alone asked for
            least_duration=min(timed.duration, calm.timed.duration),
            **{name: getattr(calm.timed, name) for name in ('laws', 'starts', 'duration')})

    def save(self, path: str | PathLike[str]) -> None:
        """Write the trajectory, as npz or JSON (see `Plan.save`)."""
        save(path, trajectory_tree(self), 'Trajectory')

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Trajectory:
        """Return the Trajectory saved at `path`; raise InvalidTask if there is none."""
        return load(path, trajectory_of, 'Trajectory')

    def __repr__(self) -> str:
        miss = '' if self.motion is None else f'miss {self.motion.position_error:.2g} m'
        return brief(self, f'{self.duration:.4g} s', f'{len(self.path.legs)} legs', miss)


def restored(path: GripperPath, laws: tuple[TimeLaw | None, ...], limits: Limits,
             tolerance: float, motion: InMotion | None, mode_margin: float, status: str,
             least_duration: float = np.nan, slowest_period: float = np.nan) -> Trajectory:
    """Return a saved Trajectory from its attributes, without a search."""
    trajectory = Trajectory.__new__(Trajectory)
    TimedPath.__init__(trajectory, path, laws, limits)
    put(trajectory, tolerance=tolerance, motion=motion, mode_margin=mode_margin, status=status,
        least_duration=least_duration, slowest_period=slowest_period)
    return trajectory


def quickest_plan(plans: Sequence[Plan], limits: Limits, tolerance: float | None,
                  simulator: Simulator, progress: Progress) -> int:
    """Return the index of the Plan, of several for one task, whose settled motion is the quickest.

    The deadline of `progress` ends the search: the best until then counts.
    """
    searches = [CalmSearch(plan, _within_limits(plan, limits, progress),
                           _tolerance(tolerance, plan), _simulator(simulator, plan),
                           plan.shapes[0], (), progress, _TRIED) for plan in plans]
    found = quickest(searches).search
    return next(k for k, search in enumerate(searches) if search is found)


def _within_limits(plan: Plan, limits: Limits, progress: Progress) -> TimedPath:
    """Return the fastest TimedPath of a Plan within limits, whatever the DLO does."""
    path, laws = GripperPath.of(plan), []
    for leg in path.legs:
        progress.check()
        laws.append(fastest_law(leg, limits))
    return TimedPath(path, tuple(laws), limits)


def _simulator(simulator: Simulator | None, plan: Plan) -> Simulator:
    """Return the simulator that verifies a Plan; raise InvalidTask if there is none."""
    first, bore = plan.shapes[0], held_after(plan)
    if bore is None and any(not alike(shape.holds, first.holds) for shape in plan.shapes):
        raise InvalidTask('plan: expected one stage, in which the same places are held all the '
                          f'time, as one of `stage_plans`, got {len(plan.stages)}; with an '
                          'infinite tolerance nothing is simulated')
    if have_rings(first.holds):
        raise InvalidTask(f'plan is held by {shown(first.holds)}: expected none that the DLO '
                          'slides through, which is known at rest only; with an infinite '
                          'tolerance nothing is simulated')
    length = float(first.s[-1]) + (0.0 if first.far_end is None else float(plan.depths[0]))
    at = grasped_at(first)
    if any(grasped_at(shape) != at or shape.far_end is None
           and abs(shape.s[-1] - length) > _SAME * length for shape in plan.shapes):
        raise InvalidTask('plan: expected shapes of one DLO that the gripper holds in one place, '
                          'as in `simulate`; with an infinite tolerance nothing is simulated')
    if at is not None and bore is not None:
        raise InvalidTask(f'plan: expected a DLO that is held at its beginning, as in `simulate`: '
                          f'held at {at:g} m it goes into a bore; with an infinite tolerance '
                          'nothing is simulated')
    if simulator is None and bore is not None and first.far_end is not None:
        raise InvalidTask('simulator = None: expected the DirectSimulator of the whole DLO for an '
                          f'insertion that begins {plan.depths[0]:g} m deep')
    if simulator is None:
        return simulator_of(first, means_to_touch(plan))
    held = held_as('simulator', simulator, first)
    if abs(held.rod.length - length) > _SAME * length:
        raise InvalidTask(f'simulator: expected one of the plan\'s DLO, {length:g} m long, its rod '
                          f'has {held.rod.length:g} m')
    return held


def simulator_of(shape: Shape, touching: bool) -> Simulator:
    """Return a simulator of the DLO that a Shape is of, held where it is, with its load."""
    if shape.state.mesh is None:
        raise InvalidTask('simulator = None: expected a DirectSimulator, the shapes of this plan '
                          'have none')
    around = shape.state.mesh.surroundings
    return held_at(DirectSimulator(around.rod, gravity=around.gravity, load=around.load,
                                   point_loads=around.point_loads,
                                   obstacles=around.obstacles if touching else ()),
                   grasped_at(shape))


def _tolerance(tolerance: float | None, plan: Plan) -> float:
    if tolerance is not None:
        endless = isinstance(tolerance, float) and tolerance == np.inf
        return tolerance if endless else number('tolerance', tolerance, above=0)
    rooms = rooms_in_holes(plan)
    rooms = rooms[np.isfinite(rooms) & (rooms > 0)]
    return float(ROOM * rooms.min()) if rooms.size else _TOLERANCE


def trajectory_tree(trajectory: Trajectory) -> dict[str, Any]:
    """Return a tree (see `direct.storage`) of all of a Trajectory."""
    tree: dict[str, Any] = {
        'times': trajectory.path.times, 'limits': trajectory.limits.sizes,
        'tolerance': trajectory.tolerance, 'mode_margin': trajectory.mode_margin,
        'status': trajectory.status, 'legs': len(trajectory.laws),
        'least_duration': trajectory.least_duration, 'slowest_period': trajectory.slowest_period,
        'arms': np.array(trajectory.path.arms, dtype=str)}
    if trajectory.motion is not None:
        tree['motion'] = _parts(trajectory.motion, [item.name for item in fields(InMotion)])
    for k, (leg, law) in enumerate(zip(trajectory.path.legs, trajectory.laws, strict=True)):
        tree[str(k)] = own = {'leg': _parts(leg, _ARM), 'others': {
            str(arm): _parts(other, _ARM) for arm, other in enumerate(leg.others)}}
        if law is not None:
            own |= {'law': _parts(law, _LAW)} | (
                {} if law.shift is None else {'shift': _parts(law.shift, _SHIFT)})
    return tree


def _parts(value: object, names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def trajectory_of(tree: Mapping[str, Any]) -> Trajectory:
    """Return the Trajectory of the tree of `trajectory_tree`."""
    legs, laws = [], []
    for k in range(int(tree['legs'])):
        own = tree[str(k)]
        shift = Shift(**own['shift']) if 'shift' in own else None
        others = own.get('others', {})
        legs.append(Leg(**own['leg'], others=tuple(
            Leg(**others[str(arm)]) for arm in range(len(others)))))
        laws.append(TimeLaw(**own['law'], shift=shift) if 'law' in own else None)
    motion = {name: array.item() for name, array in tree.get('motion', {}).items()}
    return restored(
        GripperPath(tree['times'], tuple(legs), tuple(map(str, tree.get('arms', ())))), tuple(laws),
        Limits(*tree['limits'].ravel().tolist()), float(tree['tolerance']),
        InMotion(**motion) if motion else None, float(tree['mode_margin']), str(tree['status']),
        float(tree.get('least_duration', np.nan)), float(tree.get('slowest_period', np.nan)))
