# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where to hold a DLO for a task: a map over grasps and places of its far end."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from os import PathLike
from time import thread_time
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from dlo_planner.errors import DeadlineExceeded, Infeasible, InvalidTask
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import Task
from dlo_planner.inverse.tasks.insert_plug import InsertPlug
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, is_number, items, number, results, shown
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import brief, put
from dlo_planner.parallel.capability import (
    LONGEST,
    PATIENCE,
    UNDECIDED,
    Batch,
    Part,
    answered,
    columns_of,
)
from dlo_planner.parallel.pool import Workers, checked
from dlo_planner.parallel.shapes import as_it_is
from dlo_planner.pictured import BACKEND, Answer
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress, Progress, uninterrupted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLANNED, INVALID = 'planned', 'invalid'
_AT_ONCE = 4  # cells in one piece of work: a plan of a whole task takes up to seconds
_MOST = 10_000  # cells: hours of computing
_NUMBERS = ('amount', 'fraction', 'margin', 'clearance', 'stability', 'force', 'moment', 'seconds')
_COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {
    'outcome': (f'<U{LONGEST}', ()), **{name: (float, ()) for name in _NUMBERS}}


@dataclass(frozen=True, eq=False, repr=False)
class GraspMap(Answer):
    """What becomes of a task by where the DLO is held; arrays (G, F) by grasp and far end.

    Attributes
    ----------
    grasps : tuple of float or Pose
        The G grasps.
    far_ends : tuple of FarEnd or None
        The F far ends; None: as the task has it.
    outcome : ndarray
        'planned'; or the constraint that was not kept, as `Infeasible.constraint`; 'invalid' where
        the task makes no sense so held; 'undecided' where time was over; '' where it was not
        looked at.
    amount : ndarray
        By how much the constraint is broken, in its unit; nan where that is not known.
    fraction : ndarray
        Part of the waypoints that is reached.
    margin : ndarray
        What is left of the plan's demands where least is, as a part: the least of its stability, of
        what its largest force and moment leave of their limits, and of its clearance over the DLO's
        diameter. nan: no plan.
    clearance : ndarray
        Least clearance, m; infinite: nothing is around; nan: no plan.
    stability : ndarray
        Least of all shapes; nan: no plan.
    force, moment : ndarray
        Largest of the gripper and of what else holds, N and N m; nan: no plan.
    seconds : ndarray
        CPU time of computing; not compared.
    """

    grasps: tuple[float | Pose, ...]
    far_ends: tuple[FarEnd | None, ...]
    outcome: Floats
    amount: Floats
    fraction: Floats
    margin: Floats
    clearance: Floats
    stability: Floats
    force: Floats
    moment: Floats
    seconds: Floats = field(compare=False)

    def __post_init__(self) -> None:
        put(self, grasps=_grasps('GraspMap.grasps', self.grasps),
            far_ends=_far_ends('GraspMap.far_ends', self.far_ends))
        shape = len(self.grasps), len(self.far_ends)
        put(self, outcome=as_it_is('GraspMap.outcome', self.outcome, shape, 'U', 'strings'),
            **{name: results(f'GraspMap.{name}', getattr(self, name), shape)
               for name in _NUMBERS})
        super().__post_init__()

    def __repr__(self) -> str:
        best = self.best
        return brief(self, f'{len(self.grasps)} grasps', f'{len(self.far_ends)} far ends',
                     f'{int(self.planned.sum())} planned',
                     '' if best is None else f'most margin {self.margin[best]:.2g} at '
                     f'grasps[{best[0]}], far_ends[{best[1]}]')

    @property
    def planned(self) -> Floats:
        """(G, F) whether there is a plan."""
        result: Floats = self.outcome == PLANNED
        return result

    @property
    def best(self) -> tuple[int, int] | None:
        """Indices of the grasp and the far end with the most `margin`; None: there is no plan."""
        if not self.planned.any():
            return None
        g, f = np.unravel_index(np.where(self.planned, self.margin, -np.inf).argmax(),
                                self.outcome.shape)
        return int(g), int(f)

    def plot(self, **options: Any) -> Figure:
        """Draw the margin of each grasp and far end, and why there is no plan elsewhere.

        Needs matplotlib.

        Raises
        ------
        InvalidTask
            An option is given: there is none.
        MissingExtra
            Matplotlib is not installed.
        """
        if options:
            raise InvalidTask(f'{next(iter(options))}: expected no options')
        return cast('Figure', import_module(BACKEND).plot_grasps(self))


class _Query(NamedTuple):
    """The question about every cell."""

    inverse: InverseSimulator
    task: Task
    grasps: tuple[float | Pose, ...]
    far_ends: tuple[FarEnd | None, ...]
    start: Pose | None
    patience: float  # s of computing for a plan


def which_grasp(inverse: InverseSimulator, task: Task, grasps: Iterable[float | Pose],
                far_ends: Iterable[FarEnd] | None = None, executor: Workers = None, *,
                start: Pose | None = None, folder: str | PathLike[str] | None = None,
                chunk: int = _AT_ONCE, patience: float = PATIENCE, progress: OnProgress = None,
                deadline: float | None = None) -> GraspMap:
    """Return what becomes of a task by where the DLO is held, with what margin.

    Parameters
    ----------
    inverse : InverseSimulator
        InverseSimulator, with the workspace and the obstacles of the cell.
    task : Task
    grasps : iterable of float or Pose
        Where the gripper holds the DLO, m from its beginning, of a task that has `hold_at`; or how
        a plug sits in the hand, `Plug.grasp`, of an `InsertPlug`.
    far_ends : iterable of FarEnd, optional
        What holds the far end, of a task that has `far_end`. If None, as the task has it.
    executor : Workers, optional
        As for `parallel.map`; the result does not depend on it.
    start : Pose, optional
        Pose of the gripper now, whatever it holds. If None, plans begin at their best pose.
    folder : str or PathLike, optional
        Where parts are kept as they are done; the same call goes on with what is there.
    chunk : int, optional
        Cells in one piece of work, and in one file.
    patience : float, optional
        Seconds of computing for one plan; one that takes longer is 'undecided'.
    progress : callable, optional
        Called as progress(done, total) after each piece, in cells.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense, the task cannot be held so, or the folder keeps another map.
    DeadlineExceeded
        The deadline is over; what is in the folder is kept.
    """
    instance('inverse', inverse, InverseSimulator)
    instance('task', task, Task)
    places, ends = _grasps('grasps', grasps), _far_ends('far_ends', (
        (None,) if far_ends is None else far_ends))
    for k, place in enumerate(places):
        if not isinstance(place, Pose):
            number(f'grasps[{k}]', place, below=inverse.simulator.rod.length)
    _check_held(task, places, ends)
    checked(executor)
    instance('start', start, Pose, optional=True)
    chunk, total = integer('chunk', chunk, minimum=1, maximum=_MOST), len(places) * len(ends)
    if total > _MOST:
        raise InvalidTask(f'grasps has {len(places)} entries, far_ends {len(ends)}: expected at '
                          f'most {_MOST} pairs')
    query = _Query(inverse, task, places, ends, start, number('patience', patience, above=0))
    parts = answered(_lines, query, total, chunk, executor, folder, {}, Progress(
        progress, deadline))
    return GraspMap(places, ends, **{
        name: values.reshape(len(places), len(ends))
        for name, values in columns_of(parts, _COLUMNS, total, chunk).items()})


def _grasps(name: str, value: object) -> tuple[float | Pose, ...]:
    """Return grasps, all of one kind; raise InvalidTask."""
    found = items(name, value, object, least=1)
    if all(isinstance(one, Pose) for one in found):
        return cast('tuple[Pose, ...]', found)
    if not all(is_number(one) for one in found):
        raise InvalidTask(f'{name} = {shown(found)}: expected numbers, m, or Poses')
    return tuple(number(f'{name}[{k}]', one, minimum=0) for k, one in enumerate(found))


def _far_ends(name: str, value: object) -> tuple[FarEnd | None, ...]:
    """Return far ends; raise InvalidTask."""
    return tuple(instance(f'{name}[{k}]', one, FarEnd, optional=True)
                 for k, one in enumerate(items(name, value, object, least=1)))


def _check_held(task: Task, grasps: tuple[float | Pose, ...],
                far_ends: tuple[FarEnd | None, ...]) -> None:
    """Raise InvalidTask where a task cannot be held so at all."""
    names = {item.name for item in fields(cast('Any', task))}
    if isinstance(grasps[0], Pose) and not isinstance(task, InsertPlug):
        raise InvalidTask(f'grasps = {shown(grasps)}: expected numbers, m, for the plan of a '
                          f'{type(task).__name__}; Poses are for an InsertPlug')
    if not isinstance(grasps[0], Pose) and any(grasps) and 'hold_at' not in names:
        raise InvalidTask(f'grasps = {shown(grasps)}: expected 0 alone for the plan of a '
                          f'{type(task).__name__}, which has no hold_at')
    if any(one is not None for one in far_ends) and 'far_end' not in names:
        raise InvalidTask(f'far_ends = {shown(far_ends)}: expected None for the plan of a '
                          f'{type(task).__name__}, which has no far_end')


def _lines(batch: Batch) -> Part:
    """Return the columns of a Batch; this is what workers do."""
    query = batch.query.content
    lines = [_line(query, *divmod(index, len(query.far_ends)))
             for index in range(batch.begin, batch.end)]
    return {name: np.array([line[name] for line in lines], dtype=kind)
            for name, (kind, _) in _COLUMNS.items()}


def _held(task: Task, grasp: float | Pose, far_end: FarEnd | None) -> Task:
    """Return a task of a DLO that is held so."""
    own: Any = task  # a dataclass that has them
    if isinstance(grasp, Pose):
        own = replace(own, plug=replace(own.plug, grasp=grasp))
    elif any(item.name == 'hold_at' for item in fields(own)):
        own = replace(own, hold_at=grasp or None)
    held: Task = own if far_end is None else replace(own, far_end=far_end)
    return held


def _line(query: _Query, g: int, f: int) -> dict[str, Any]:
    """Return a line of the map."""
    begun = thread_time()
    line: dict[str, Any] = dict.fromkeys(_NUMBERS, np.nan) | {
        'outcome': PLANNED, 'amount': 0.0, 'fraction': 0.0}
    try:
        plan = query.inverse.plan(_held(query.task, query.grasps[g], query.far_ends[f]),
                                  start=query.start, deadline=query.patience)
        line |= _margins(plan, query.inverse.simulator.rod.radius)
    except Infeasible as refused:
        line |= {'outcome': refused.constraint[:LONGEST], 'amount': refused.amount,
                 'fraction': 0.0 if refused.plan is None else refused.plan.fraction}
    except InvalidTask:
        line |= {'outcome': INVALID, 'amount': np.nan}
    except DeadlineExceeded:
        uninterrupted(None)  # by the map's own
        line |= {'outcome': UNDECIDED, 'amount': np.nan}
    return line | {'seconds': thread_time() - begun}


def _margins(plan: Plan, radius: Any) -> dict[str, float]:
    """Return the figures of a Plan of a DLO of a radius, m, if it has one alone."""
    figures = {'clearance': float(plan.clearance.min()), 'stability': float(plan.stability.min()),
               'force': float(np.fmax.reduce(plan.largest_force)),
               'moment': float(np.fmax.reduce(plan.largest_moment))}
    left = [figures['stability']]
    left += [1.0 - figures[name] / limit for name, limit in zip(
        ('force', 'moment'), plan.wrench_limits, strict=True) if limit is not None]
    if isinstance(radius, float) and radius > 0:  # else it has none, or it varies
        left.append(figures['clearance'] / (2.0 * radius))
    return figures | {'margin': min(left), 'fraction': plan.fraction}
