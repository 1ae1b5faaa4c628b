# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which cut-outs of a cell a DLO can be threaded through: a map over many tasks."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_planner.errors import InvalidTask
from dlo_planner.extras import extra
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import depths_on, depths_or_none
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, integer, items, number, results, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import brief, put
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
from dlo_planner.pictured import Answer
from dlo_planner.progress import OnProgress, Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AT_ONCE = 32      # cut-outs in one piece of work
_MOST = 10_000     # depths
_PATIENCE = 30.0   # s
_NUMBERS = ('amount', 'fraction', 'clearance', 'stability', 'roll', 'seconds')

_SLICES = 12      # that are drawn
_ALIKE = 1e-6   # m: positions in one slice
QUANTITIES = {'share': 'part of directions and radii that can be threaded',
              'clearance': 'largest clearance [m]', 'stability': 'largest stability',
              'radius': 'narrowest radius that can be threaded [m]'}


@dataclass(frozen=True, eq=False, repr=False)
class CapabilityMap(Answer):
    """Which cut-outs can be threaded; arrays (P, D, R) by position, direction and radius.

    Attributes
    ----------
    grid : CellGrid
    outcome : ndarray
        'threaded'; or the constraint that was not kept, as `Infeasible.constraint`, after
        'start_phase.' where it is the way from the start; 'undecided' where time was over; '' where
        it was not looked at.
    amount : ndarray
        By how much the constraint is broken, in its unit; nan where that is not known.
    fraction : ndarray
        Part of the waypoints that is reached.
    clearance : ndarray
        Clearance in m, least of the threading.
    stability : ndarray
        Least of all shapes; nan: no plan.
    roll : ndarray
        Roll in rad, of the gripper in its first pose about its x axis, 0 where that is upright.
    start : ndarray
        Index of the start; -1: none.
    gripper : ndarray, shape (P, D, R, 7)
        Its first pose: position in m, quaternion x, y, z, w; nan: no plan.
    seconds : ndarray
        CPU time of computing; not compared.
    """

    grid: CellGrid
    outcome: Floats
    amount: Floats
    fraction: Floats
    clearance: Floats
    stability: Floats
    roll: Floats
    start: Floats
    gripper: Floats
    seconds: Floats = field(compare=False)

    def __post_init__(self) -> None:
        shape = instance('CapabilityMap.grid', self.grid, CellGrid).shape
        outcome, start = (_plain(f'CapabilityMap.{name}', getattr(self, name), shape, kind)
                          for name, kind in (('outcome', 'U'), ('start', 'i')))
        put(self, outcome=outcome, start=start,
            gripper=results('CapabilityMap.gripper', self.gripper, (*shape, 7)),
            **{name: results(f'CapabilityMap.{name}', getattr(self, name), shape)
               for name in _NUMBERS})
        super().__post_init__()

    def __repr__(self) -> str:
        n, open_ = len(self.grid), int((self.outcome == '').sum())
        return brief(self, f'{n} cut-outs', f'{int(self.threaded.sum())} threaded',
                     f'{int((self.outcome == UNDECIDED).sum())} undecided',
                     f'{open_} not looked at' if open_ else '')

    @property
    def threaded(self) -> Floats:
        """(P, D, R) whether the cut-out can be threaded."""
        result: Floats = self.outcome == THREADED
        return result

    @property
    def least_radius(self) -> Floats:
        """(P, D) m, of the narrowest cut-out there that can be threaded; infinite: none can."""
        result: Floats = np.where(self.threaded, self.grid.radii, np.inf).min(axis=2)
        return result

    def plot(self, *, axis: str = 'y', quantity: str = 'share') -> 'Figure':  # type: ignore[override]
        """Draw the positions in slices across an axis, colored by a quantity; needs matplotlib.

        Crosses stand where no cut-out can be threaded, dots where none has been looked at. Of more
        than 12 slices 12 are shown.

        Parameters
        ----------
        axis : str, optional
            'x', 'y' or 'z' of the world, across which the slices lie.
        quantity : str, optional
            'share' of all directions and radii; or the best of them in 'clearance', 'stability' or
            'radius'.

        Raises
        ------
        InvalidTask
            An argument makes no sense.
        MissingExtra
            Matplotlib is not installed.
        """
        across = 'xyz'.index(choice('axis', axis, ('x', 'y', 'z')))
        choice('quantity', quantity, tuple(QUANTITIES))
        first, second = (k for k in range(3) if k != across)
        places = self.grid.positions
        levels = np.unique(np.round(places[:, across] / _ALIKE)) * _ALIKE
        levels = levels[np.unique(np.linspace(
            0, levels.size - 1, min(levels.size, _SLICES)).astype(int))]
        values, known = _best(self, quantity), (self.outcome != '').any(axis=(1, 2))
        low, high = 0.0, 1.0
        if quantity != 'share' and np.isfinite(values).any():
            low, high = np.nanmin(values), np.nanmax(values)
        columns = min(levels.size, 4)
        figure: Figure = extra('matplotlib.figure', 'figures', 'pictures').Figure(
            figsize=(1.5 + 3.2 * columns, 1.5 + 3.0 * -(-levels.size // columns)),
            layout='constrained')
        axes = figure.subplots(-(-levels.size // columns), columns, squeeze=False, sharex=True,
                               sharey=True).ravel()
        for axis_, level in zip(axes, levels, strict=False):
            in_slice = np.abs(places[:, across] - level) <= _ALIKE
            some = in_slice & np.isfinite(values)
            drawn = axis_.scatter(*places[some][:, [first, second]].T, c=values[some], s=60,
                                  vmin=low, vmax=max(high, low + 1e-12), cmap='viridis', marker='s')
            empty, unknown = in_slice & known & ~some, in_slice & ~known
            axis_.plot(*places[empty][:, [first, second]].T, 'x', color='tab:red', ms=5)
            axis_.plot(*places[unknown][:, [first, second]].T, '.', color='0.7', ms=3)
            axis_.set(title=f'{axis} = {level:.3g} m', aspect='equal', xlabel=f'{"xyz"[first]} [m]',
                      ylabel=f'{"xyz"[second]} [m]')
            axis_.grid(alpha=0.3)
        for axis_ in axes[levels.size:]:
            axis_.set_visible(False)
        figure.colorbar(drawn, ax=list(axes[:levels.size]), label=QUANTITIES[quantity])
        figure.suptitle(repr(self), fontsize=10)
        return figure

    @classmethod
    def load(cls, path: str | PathLike[str]) -> 'CapabilityMap':
        """Return the map that was saved, or what is done so far of the one kept in a folder.

        Raises
        ------
        InvalidTask
            No map is kept there; the message names it.
        """
        if not os.path.isdir(instance('path', path, (str, os.PathLike))):
            return super().load(path)
        folder = path
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
                   folder: str | PathLike[str] | None = None, chunk: int = _AT_ONCE,
                   patience: float = _PATIENCE, progress: OnProgress = None,
                   deadline: float | None = None) -> CapabilityMap:
    """Return which cut-outs of a cell can be threaded, with what margin, by which roll and start.

    Parameters
    ----------
    inverse : InverseSimulator
        InverseSimulator, with the workspace and the obstacles of the cell.
    grid : CellGrid
    starts : iterable of Pose, optional
        Poses of the gripper from which it has to get there (`InverseSimulator.approach`) with
        the DLO as it hangs; the one that leaves the DLO most stable is chosen. None: only the
        threading is looked at, wherever it begins.
    depths : array_like, optional
        As for `InverseSimulator.thread`.
    executor : Workers, optional
        As for `parallel.map`; the result does not depend on it.
    folder : str or PathLike, optional
        Where parts are kept as they are done; the same call goes on with what is there.
    chunk : int, optional
        Cut-outs in one piece of work, and in one file.
    patience : float, optional
        Seconds of computing for one plan; one that takes longer is 'undecided'.
    progress : callable, optional
        Called as progress(done, total) after each piece, in cut-outs.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense, or the folder keeps another map.
    DeadlineExceeded
        The deadline is over; what is in the folder is kept.
    """
    instance('inverse', inverse, InverseSimulator)
    instance('grid', grid, CellGrid)
    starts = items('starts', starts, Pose)
    if depths is not None:
        depths = depths_on(inverse.simulator.rod.length, depths_or_none('depths', depths))
    checked(executor)
    chunk = integer('chunk', chunk, minimum=1, maximum=1_000_000)
    question = Question(inverse, grid, items('starts', starts, Pose), depths,
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


def _done(question: Question, batches: Mapping[int, Batch],
          parts: dict[int, dict[str, NDArray[Any]]], store: Store | None, executor: Workers,
          steps: Progress) -> None:
    """Do the batches that are not in the dict of `parts`."""
    total, left = len(question.grid), [k for k in batches if k not in parts]
    done = total - sum(batches[k].end - batches[k].begin for k in left)

    def finished(index: int, part: dict[str, NDArray[Any]]) -> None:
        nonlocal done
        k = left[index]
        parts[k] = part
        if store is not None:
            store.keep(k, part)
        done += batches[k].end - batches[k].begin
        steps.done(done, total)

    with Crew(executor, steps.check) as crew:
        crew.run(answers, (batches[k] for k in left), finished)


def _joined(grid: CellGrid, chunk: int,
            parts: Mapping[int, dict[str, NDArray[Any]] | None]) -> CapabilityMap:
    """Return the CapabilityMap of a dict of parts by number, None where one is not done."""
    arrays = {name: np.full((len(grid), *size), _EMPTY.get(name, np.nan), dtype=kind)
              for name, (kind, size) in COLUMNS.items()}
    for k, part in parts.items():
        if part is not None:
            for name in COLUMNS:
                arrays[name][k * chunk:(k + 1) * chunk] = part[name]
    return CapabilityMap(grid, **{name: values.reshape(*grid.shape, *values.shape[1:])
                                  for name, values in arrays.items()})


_EMPTY: dict[str, Any] = {'start': -1, 'outcome': ''}  # else nan


def _best(capability: CapabilityMap, quantity: str) -> Floats:
    """Return (P,) the quantity of a picture at each position; nan where nothing can be threaded."""
    threaded = capability.threaded
    some = threaded.any(axis=(1, 2))
    if quantity == 'share':
        return np.where(some, threaded.mean(axis=(1, 2)), np.nan)
    if quantity == 'radius':
        return np.where(some, capability.least_radius.min(axis=1), np.nan)
    values = np.where(threaded, getattr(capability, quantity), -np.inf).max(axis=(1, 2))
    return np.where(some, values, np.nan)


def _growing(depths: Floats) -> Floats:
    falling = np.diff(depths) < 0
    if falling.any():
        bad = int(np.argmax(falling)) + 1
        raise InvalidTask(f'depths[{bad}] = {depths[bad]}: expected not less than the one before')
    return depths


def _plain(name: str, value: object, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
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
