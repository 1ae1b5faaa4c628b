# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Which cut-outs of a cell a DLO can be threaded through: a map over many tasks."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from importlib import import_module
from os import PathLike
from pathlib import Path
from time import thread_time
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_planner.errors import DeadlineExceeded, Infeasible, InvalidTask
from dlo_planner.inverse.simulator import InverseSimulator
from dlo_planner.inverse.task import depths_on, depths_or_none
from dlo_planner.inverse.tasks.approach import first_approach
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import (
    array,
    choice,
    instance,
    integer,
    items,
    number,
    results,
    row,
    shown,
)
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, parts_of, put
from dlo_planner.parallel.pool import CachedPayload, Pool, Workers, checked
from dlo_planner.parallel.shapes import as_it_is
from dlo_planner.pictured import BACKEND, Answer
from dlo_planner.plan.plan import Plan
from dlo_planner.progress import OnProgress, Progress, uninterrupted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Part: TypeAlias = dict[str, NDArray[Any]]  # of the answer: columns by name

_MOST_CUTOUTS = 1_000_000_000
_AT_ONCE = 32      # cut-outs in one piece of work
PATIENCE = 30.0    # s
_NUMBERS = ('amount', 'fraction', 'clearance', 'stability', 'roll', 'seconds')

THREADED, UNDECIDED = 'threaded', 'undecided'
LONGEST = 32      # characters of an outcome
_BETTER = 1e-6    # of stability: a start that is better by less is not preferred to one before it
COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {
    'outcome': (f'<U{LONGEST}', ()), 'amount': (float, ()), 'fraction': (float, ()),
    'clearance': (float, ()), 'stability': (float, ()), 'roll': (float, ()), 'start': (int, ()),
    'gripper': (float, (7,)), 'seconds': (float, ())}
_TASK, _PART = 'task.npz', 'part-{:07d}.npz'
QUANTITIES = {'share': 'part of directions and radii that can be threaded',
              'clearance': 'largest clearance [m]', 'stability': 'largest stability',
              'radius': 'narrowest radius that can be threaded [m]'}


@dataclass(frozen=True, eq=False, repr=False)
class CellGrid(Value):
    """Round cut-outs of a cell: all combinations of P positions, D directions and R radii.

    Attributes
    ----------
    positions : ndarray, shape (P, 3)
        Positions in m, of the centers, in any order.
    directions : ndarray, shape (D, 3)
        In which the free end travels through, of any length but zero.
    radii : ndarray, shape (R,)
        Radii in m.

    Raises
    ------
    InvalidTask
        An array makes no sense; the message names it.
    """

    positions: Floats
    directions: Floats
    radii: Floats

    def __post_init__(self) -> None:
        directions = array('CellGrid.directions', self.directions, (None, 3))
        size = np.abs(directions).max(axis=1, keepdims=True)
        if (size == 0).any():
            raise InvalidTask(f'CellGrid.directions[{int(np.argmin(size))}] = 0: expected a vector '
                              'that is not zero')
        directions = directions / size
        put(self, positions=array('CellGrid.positions', self.positions, (None, 3)),
            directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
            radii=row('CellGrid.radii', self.radii, above=0))
        if len(self) > _MOST_CUTOUTS:
            raise InvalidTask(f'CellGrid.positions: expected at most {_MOST_CUTOUTS} cut-outs in '
                              f'all, got {len(self)}')
        super().__post_init__()

    def __len__(self) -> int:
        return int(np.prod([int(size) for size in self.shape]))

    def __repr__(self) -> str:
        return brief(self, '{} positions, {} directions, {} radii'.format(*self.shape))

    @property
    def shape(self) -> tuple[int, int, int]:
        """(P, D, R)."""
        return len(self.positions), len(self.directions), self.radii.size

    def cutout(self, index: int) -> CutOut:
        """Return one CutOut: radii change first with the index, then directions, then positions.

        Raises
        ------
        InvalidTask
            There is no such index.
        """
        index = integer('index', index, minimum=0, maximum=len(self) - 1)
        p, d, r = np.unravel_index(index, self.shape)
        return CutOut(Pose.looking_along(self.positions[p], self.directions[d]),
                      radius=float(self.radii[r]))


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
        put(self, outcome=as_it_is('CapabilityMap.outcome', self.outcome, shape, 'U', 'strings'),
            start=as_it_is('CapabilityMap.start', self.start, shape, 'i', 'integers'),
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

    def plot(self, *, axis: str = 'y', quantity: str = 'share') -> Figure:  # type: ignore[override]
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
        figure = import_module(BACKEND).plot_map(self, across, quantity, QUANTITIES[quantity])
        return cast('Figure', figure)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> CapabilityMap:
        """Return the map that was saved, or what is done so far of the one kept in a folder.

        Raises
        ------
        InvalidTask
            No map is kept there; the message names it.
        """
        if not os.path.isdir(instance('path', path, (str, os.PathLike))):
            return super().load(path)
        try:
            task = _read(Path(path) / _TASK)
            grid = CellGrid(task['positions'], task['directions'], task['radii'])
            chunk = int(task['chunk'])
        except Exception as error:  # whatever another file makes of the reader
            raise InvalidTask(f'folder = {shown(str(path))}: expected one in which a map is kept, '
                              f'{error}') from None
        return _joined(grid, chunk, {k: _part_in(Path(path), k)
                                     for k in range(-(-len(grid) // chunk))})


def capability_map(inverse: InverseSimulator, grid: CellGrid, executor: Workers = None, *,
                   starts: Iterable[Pose] = (), depths: ArrayLike | None = None,
                   folder: str | PathLike[str] | None = None, chunk: int = _AT_ONCE,
                   patience: float = PATIENCE, progress: OnProgress = None,
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
    query = ReachabilityQuery(inverse, grid, starts, depths,
                              number('patience', patience, above=0))
    parts = answered(lines_of, query, len(grid), chunk, executor, folder, {
        'positions': grid.positions, 'directions': grid.directions, 'radii': grid.radii,
        'chunk': np.asarray(chunk)}, Progress(progress, deadline))
    return _joined(grid, chunk, parts)


def answered(lines: Callable[[Batch], dict[str, NDArray[Any]]], query: tuple[Any, ...], total: int,
             chunk: int, executor: Workers, folder: str | PathLike[str] | None,
             told: dict[str, NDArray[Any]], steps: Progress) -> dict[int, Part]:
    """Return what workers answer to a query about `total` cells, in parts of `chunk`.

    A `folder` keeps them as they are done, what is `told` of the query beside them; the same query
    goes on with what is there.
    """
    payload = CachedPayload(query)
    batches = [Batch(payload, begin, min(begin + chunk, total))
               for begin in range(0, total, chunk)]
    kept, parts = None, dict[int, Part]()
    if folder is not None:
        kept = _folder_of(folder, fingerprint(tuple(query), chunk), told)
        parts = {k: part for k in range(len(batches)) if (part := _part_in(kept, k)) is not None}
    left = [k for k in range(len(batches)) if k not in parts]
    done = total - sum(batches[k].end - batches[k].begin for k in left)

    def finished(index: int, part: Part) -> None:
        nonlocal done
        k = left[index]
        parts[k] = part
        if kept is not None:
            _written(kept / _PART.format(k), part)
        done += batches[k].end - batches[k].begin
        steps.done(done, total)

    with Pool(executor, steps.check) as pool:
        pool.run(lines, (batches[k] for k in left), finished)
    return parts


def columns_of(parts: Mapping[int, Part | None], kinds: Mapping[str, tuple[Any, tuple[int, ...]]],
               total: int, chunk: int) -> dict[str, NDArray[Any]]:
    """Return the columns (total, ...) of parts by number; None where one is not done."""
    arrays = {name: np.full((total, *size), _EMPTY.get(name, np.nan), dtype=kind)
              for name, (kind, size) in kinds.items()}
    for k, part in parts.items():
        if part is not None:
            for name in kinds:
                arrays[name][k * chunk:(k + 1) * chunk] = part[name]
    return arrays


def _joined(grid: CellGrid, chunk: int, parts: Mapping[int, Part | None]) -> CapabilityMap:
    """Return the CapabilityMap of a dict of parts by number, None where one is not done."""
    arrays = columns_of(parts, COLUMNS, len(grid), chunk)
    return CapabilityMap(grid, **{name: values.reshape(*grid.shape, *values.shape[1:])
                                  for name, values in arrays.items()})


_EMPTY: dict[str, Any] = {'start': -1, 'outcome': ''}  # else nan


# Whether one cut-out can be threaded, from where, and with what margin: what workers do.


class ReachabilityQuery(NamedTuple):
    """The question about every cut-out."""

    inverse: InverseSimulator
    grid: CellGrid
    starts: tuple[Pose, ...]  # none: only the threading is planned
    depths: Floats | None     # m
    patience: float           # s of computing for a plan, after which it is undecided


class Batch(NamedTuple):
    """A piece of work: the cells from `begin` up to `end` of a query."""

    query: CachedPayload
    begin: int
    end: int


def lines_of(batch: Batch) -> dict[str, NDArray[Any]]:
    """Return the columns of a Batch; this is what workers do."""
    query = batch.query.content
    lines = [_line(query, query.grid.cutout(index)) for index in range(batch.begin, batch.end)]
    return {name: np.array([line[name] for line in lines], dtype=kind)
            for name, (kind, _) in COLUMNS.items()}


def _line(query: ReachabilityQuery, cutout: CutOut) -> dict[str, Any]:
    """Return a line of the map: the best of all starts, or the refusal that came farthest."""
    begun, starts = thread_time(), query.starts or (None,)
    lines = [_from(query, cutout, k, start) for k, start in enumerate(starts)]
    best = lines[0]
    for line in lines[1:]:
        if _rank(line) > _rank(best) + _BETTER:
            best = line
    return best | {'seconds': thread_time() - begun}


def _rank(line: Mapping[str, Any]) -> float:
    """Return a number that is larger the better a line is: threaded, undecided, refused."""
    if line['outcome'] == THREADED:
        return float(2.0 + line['stability'])
    return 1.5 if line['outcome'] == UNDECIDED else line['fraction']


def _from(query: ReachabilityQuery, cutout: CutOut, index: int,
          start: Pose | None) -> dict[str, Any]:
    """Return the line of one start (a Pose or None)."""
    line: dict[str, Any] = {
        'outcome': THREADED, 'amount': 0.0, 'fraction': 0.0, 'clearance': np.nan,
        'stability': np.nan, 'roll': np.nan, 'start': -1 if start is None else index,
        'gripper': np.full(7, np.nan)}
    inverse, patience, prefix = query.inverse, query.patience, ''
    try:
        plan = inverse.thread(cutout, start=start, depths=query.depths, deadline=patience)
        line |= _margins(plan)
        if start is not None:
            prefix = 'start_phase.'
            way = first_approach(inverse.approach, inverse.simulator.rod.length, cutout, plan,
                                 start, deadline=patience)
            line['stability'] = min(line['stability'], float(way.stability.min()))
    except Infeasible as refused:
        line |= {'outcome': (prefix + refused.constraint)[:LONGEST], 'amount': refused.amount}
        if not prefix:
            line['fraction'] = 0.0 if refused.plan is None else refused.plan.fraction
    except DeadlineExceeded:
        uninterrupted(None)  # by the map's own
        line |= {'outcome': UNDECIDED, 'amount': np.nan}
    return line


def _margins(plan: Plan) -> dict[str, Any]:
    """Return the margins of a Plan and the roll of its first pose."""
    first = plan.grippers[0]
    upright = Pose.looking_along(first.position, first.direction).rotation
    axes = upright.T @ first.rotation
    return {'fraction': plan.fraction, 'clearance': float(plan.clearance.min()),
            'stability': float(plan.stability.min()),
            'roll': float(np.arctan2(axes[2, 1], axes[1, 1])),
            'gripper': np.concatenate([first.position, first.quaternion])}


# What is done already, kept in a folder.


def _folder_of(folder: str | PathLike[str], name: str, task: dict[str, NDArray[Any]]) -> Path:
    """Return the folder in which parts of a task are kept; `name` identifies it, `task` tells it.

    A file is written beside its place and then put there in one step: after a crash it is whole, or
    not there at all.
    """
    path = Path(instance('folder', folder, (str, PathLike)))
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not (path / _TASK).exists():
            _written(path / _TASK, {'name': np.asarray(name), **task})
        known = str(_read(path / _TASK)['name'])
    except (OSError, ValueError) as error:
        raise InvalidTask(f'folder = {shown(str(folder))}: expected one that can be written, '
                          f'{error}') from None
    if known != name:
        raise InvalidTask(f'folder = {shown(str(folder))}: expected one for this task, it '
                          'has parts of another one (what is asked, its DLO or options differ)')
    return path


def _part_in(folder: Path, index: int) -> dict[str, NDArray[Any]] | None:
    """Return the part of a folder; None if it is not there, or its file is damaged."""
    try:
        return _read(folder / _PART.format(index))
    except Exception:  # whatever another file makes of the reader
        return None


def _read(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path) as stored:
        return dict(stored)


def _written(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix='.', suffix='.npz')
    try:
        with os.fdopen(handle, 'wb') as file:
            np.savez_compressed(file, **dict[str, Any](arrays))
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def fingerprint(*contents: Any) -> str:
    """Return a name of the content of values, arrays and numbers, the same in every process."""
    digest = hashlib.sha256()
    for part in _parts(contents):
        digest.update(len(part).to_bytes(8, 'little') + part)
    return digest.hexdigest()[:32]


def _parts(content: Any) -> Iterator[bytes]:
    """Yield bytes that tell a content from others."""
    yield type(content).__name__.encode()
    if isinstance(content, np.ndarray):
        plain = content + 0.0 if content.dtype.kind == 'f' else content  # -0.0 is 0.0
        yield f'{content.dtype.str} {content.shape}'.encode() + plain.tobytes()
    elif isinstance(content, tuple | list):
        yield str(len(content)).encode()
        for part in content:
            yield from _parts(part)
    elif isinstance(content, dict):
        yield from _parts(sorted(content.items(), key=lambda item: str(item[0])))
    elif isinstance(content, Value):
        for name in parts_of(content):
            yield from _parts(getattr(content, name))
    elif is_dataclass(content) and not isinstance(content, type):
        for item in fields(content):
            yield from _parts(getattr(content, item.name))
    elif isinstance(content, float | np.floating):
        yield repr(float(content) + 0.0).encode()
    elif content is None or isinstance(content, str | int | bool | np.integer | np.bool_ | Enum):
        yield str(content).encode()
    elif hasattr(content, '__code__'):
        code = content.__code__
        yield f'{content.__module__}.{content.__qualname__} {code.co_consts}'.encode()
        yield code.co_code
    else:
        yield pickle.dumps(content, protocol=4)
