# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which cut-outs of a cell a DLO can be threaded through: a map over many tasks."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import depths_on, depths_or_none
from dlo_planner.model.checks import instance, integer, items, number, results, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put
from dlo_planner.parallel.cell_grid import CellGrid
from dlo_planner.parallel.pieces import Shared
from dlo_planner.parallel.store import Store, fingerprint, part_in, task_in
from dlo_planner.parallel.threadable import (
    COLUMNS,
    THREADED,
    UNDECIDED,
    Batch,
    Question,
    answers,
)
from dlo_planner.parallel.workers import Crew, Workers, checked
from dlo_planner.progress import OnProgress, Progress

_AT_ONCE = 32      # cut-outs in one piece of work
_PATIENCE = 30.0   # s
_NUMBERS = ('amount', 'fraction', 'clearance', 'stability', 'roll', 'seconds')


@dataclass(frozen=True, eq=False, repr=False)
class CapabilityMap(Value):
    """Which cut-outs can be threaded; arrays (P, D, R) by position, direction and radius.

    Attributes:
        grid: CellGrid
        outcome: 'threaded'; or the constraint that was not kept, as `Infeasible.constraint`, after
            'start_phase.' where it is the way from the start; 'undecided' where time was over; ''
            where it was not looked at
        amount: by how much the constraint is broken, in its unit; nan where that is not known
        fraction: part of the waypoints that is reached
        clearance: m, least of the threading; stability: least of all shapes; nan: no plan
        roll: rad, of the gripper in its first pose about its x axis, 0 where that is upright
        start: index of the start; -1: none
        gripper: (P, D, R, 7) its first pose: position in m, quaternion x, y, z, w; nan: no plan
        seconds: CPU time of computing; not compared
    """

    grid: CellGrid
    outcome: np.ndarray
    amount: np.ndarray
    fraction: np.ndarray
    clearance: np.ndarray
    stability: np.ndarray
    roll: np.ndarray
    start: np.ndarray
    gripper: np.ndarray
    seconds: np.ndarray = field(compare=False)

    def __post_init__(self):
        shape = instance('CapabilityMap.grid', self.grid, CellGrid).shape
        outcome, start = (_plain(f'CapabilityMap.{name}', getattr(self, name), shape, kind)
                          for name, kind in (('outcome', 'U'), ('start', 'i')))
        put(self, outcome=outcome, start=start,
            gripper=results('CapabilityMap.gripper', self.gripper, (*shape, 7)),
            **{name: results(f'CapabilityMap.{name}', getattr(self, name), shape)
               for name in _NUMBERS})
        super().__post_init__()

    def __repr__(self):
        n, open_ = len(self.grid), int((self.outcome == '').sum())
        return brief(self, f'{n} cut-outs', f'{int(self.threaded.sum())} threaded',
                     f'{int((self.outcome == UNDECIDED).sum())} undecided',
                     f'{open_} not looked at' if open_ else '')

    @property
    def threaded(self) -> np.ndarray:
        """(P, D, R) whether the cut-out can be threaded."""
        return self.outcome == THREADED

    @property
    def least_radius(self) -> np.ndarray:
        """(P, D) m, of the narrowest cut-out there that can be threaded; infinite: none can."""
        return np.where(self.threaded, self.grid.radii, np.inf).min(axis=2)

    @classmethod
    def load(cls, folder: str | PathLike) -> 'CapabilityMap':
        """Return what has been done so far of the map that is kept in a folder.

        Raises:
            InvalidTask: no map is kept there; the message names it
        """
        task = task_in(folder)
        try:
            grid = CellGrid(task['positions'], task['directions'], task['radii'])
            chunk = int(task['chunk'])
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidTask(f'folder = {shown(str(folder))}: expected one in which a map is '
                              f'kept, {error}') from None
        parts = {k: part_in(Path(folder), k) for k in range(-(-len(grid) // chunk))}
        return _joined(grid, chunk, parts)


def capability_map(inverse: InverseSimulator, grid: CellGrid, executor: Workers = None, *,
                   starts: Iterable[Pose] = (), depths: ArrayLike | None = None,
                   folder: str | PathLike | None = None, chunk: int = _AT_ONCE,
                   patience: float = _PATIENCE, progress: OnProgress = None,
                   deadline: float | None = None) -> CapabilityMap:
    """Return which cut-outs of a cell can be threaded, with what margin, by which roll and start.

    Args:
        inverse: InverseSimulator, with the workspace and the obstacles of the cell
        grid: CellGrid
        starts: Poses of the gripper from which it has to get there (`InverseSimulator.approach`)
            with the DLO as it hangs; the one that leaves the DLO most stable is chosen. None:
            only the threading is looked at, wherever it begins.
        depths: as for `InverseSimulator.thread`
        executor: as for `parallel.map`; the result does not depend on it
        folder: where parts are kept as they are done; the same call goes on with what is there
        chunk: cut-outs in one piece of work, and in one file
        patience: s of computing for one plan; one that takes longer is 'undecided'
        progress: called as progress(done, total) after each piece, in cut-outs
        deadline: s of computing after which DeadlineExceeded is raised; None: no limit

    Raises:
        InvalidTask: an argument makes no sense, or the folder keeps another map
        DeadlineExceeded: the deadline is over; what is in the folder is kept
    """
    instance('inverse', inverse, InverseSimulator)
    instance('grid', grid, CellGrid)
    starts = items('starts', starts, Pose)
    if depths is not None:
        depths = depths_on(inverse.simulator.rod.length, depths_or_none('depths', depths))
    checked(executor)
    chunk = integer('chunk', chunk, minimum=1, maximum=1_000_000)
    question = Question(inverse, grid, starts, depths,
                        number('patience', patience, above=0))
    steps = Progress(progress, deadline)
    shared = Shared(question)
    batches = {k: Batch(shared, begin, min(begin + chunk, len(grid)))
               for k, begin in enumerate(range(0, len(grid), chunk))}
    store, parts = None, {}
    if folder is not None:
        store = Store(folder, fingerprint(tuple(question), chunk), {
            'positions': grid.positions, 'directions': grid.directions, 'radii': grid.radii,
            'chunk': np.asarray(chunk)})
        parts = {k: part for k in batches if (part := store.part(k)) is not None}
    _done(question, batches, parts, store, executor, steps)
    return _joined(grid, chunk, parts)


def _done(question, batches, parts, store, executor, steps):
    """Do the batches that are not in the dict of `parts`."""
    total, left = len(question.grid), [k for k in batches if k not in parts]
    done = total - sum(batches[k].end - batches[k].begin for k in left)

    def finished(index, part):
        nonlocal done
        k = left[index]
        parts[k] = part
        if store is not None:
            store.keep(k, part)
        done += batches[k].end - batches[k].begin
        steps.done(done, total)

    with Crew(executor, steps.check) as crew:
        crew.run(answers, (batches[k] for k in left), finished)


def _joined(grid, chunk, parts):
    """Return the CapabilityMap of a dict of parts by number, None where one is not done."""
    arrays = {name: np.full((len(grid), *size), *_EMPTY[name], dtype=kind)
              for name, (kind, size) in COLUMNS.items()}
    for k, part in parts.items():
        for name in COLUMNS if part is not None else ():
            arrays[name][k * chunk:(k + 1) * chunk] = part[name]
    return CapabilityMap(grid, **{name: values.reshape(*grid.shape, *values.shape[1:])
                                  for name, values in arrays.items()})


_EMPTY = {name: (-1,) if name == 'start' else ('',) if name == 'outcome' else (np.nan,)
          for name in COLUMNS}


def _plain(name, value, shape, kind):
    """Return an array of strings or integers of a shape; raise InvalidTask."""
    try:
        given = np.array(value)
    except Exception:  # whatever its conversion raises
        given = np.zeros(0)
    if given.dtype.kind != kind or given.shape != shape:
        kinds = 'strings' if kind == 'U' else 'integers'
        raise InvalidTask(f'{name} = {shown(value)}: expected {kinds} of the shape {shape} of '
                          'CapabilityMap.grid')
    return given
