# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Independent computation (paper, section 4.3.4): many shapes, by as many workers as there are."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from dlo_planner.direct.batch import even, hangs_in_a_loop, scaled_nodes
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, shown
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import freeze
from dlo_planner.parallel.chains import Following
from dlo_planner.parallel.pieces import (
    Piece,
    PieceResult,
    Shared,
    arrays_of,
    result_of,
)
from dlo_planner.parallel.shapes import Columns, Shapes, columns, stacked
from dlo_planner.parallel.workers import Crew, Workers, checked
from dlo_planner.progress import OnProgress, Progress

_AT_ONCE = 64  # gripper poses in one piece of work
_QUICK = 128   # the same of DLOs that hang freely: 10 ms, of which handing it out costs 5 %
_LOOP = 512    # of one that nobody waits for
_FEW, _LAST = 16, 4  # the last pieces: a quarter of what is left, 16 at the least
_MOST = 100_000


def map(simulator: DirectSimulator, work: Iterable[Any], executor: Workers = None, *,  # noqa: A001
        rods: Iterable[Rod] | None = None, chunk: int | None = None,
        progress: OnProgress = None, deadline: float | None = None) -> Shapes | list[Shapes]:
    """Return the shapes at many gripper poses, found by the workers of an executor.

    The result does not depend on the executor, nor on how many workers it has: it is the same bit
    for bit (on machines of one kind), in the order of `work`.

    Parameters
    ----------
    simulator : DirectSimulator
    work : iterable of object
        Sequence of Pose: each by itself, the same bit for bit as `simulator.solve(pose)`; or
        sequence of motions, each a sequence of Pose that is followed like `simulator.track(poses)`,
        in parts of `chunk` poses (`parallel.chains`) where the DLO neither yields nor touches with
        friction: the equilibria and jumps are those of `track`, their numbers differ by what the
        solver leaves open (1e-5 of the length at a seam at most).
    executor : Workers, optional
        `concurrent.futures.Executor`: threads, processes, or a cluster's (extra `[cluster]`:
        `dask.distributed.Client(...).get_executor()`); a function that makes one, which is closed
        at the end. If None, one after the other. Where a function makes it, a pool that has lost a
        process is replaced, and only what it had not finished is done again.
    rods : iterable of Rod, optional
        One rod for each Pose of `work`, which the gripper holds instead of the simulator's: the
        same bit for bit as `simulator.with_rod(rod).solve(pose)`. If None, the simulator's.
    chunk : int, optional
        Poses in one piece of work; the last pieces of poses by themselves have fewer, about 16. If
        None, 64, or 128 of a DLO that hangs freely, each by itself.
    progress : callable, optional
        Called as progress(done, total) after each piece, in poses; where parts do not meet, what is
        done again is not counted.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Returns
    -------
    Shapes or list of Shapes
        Shapes on the simulator's mesh, stretched to the length of each rod; or a list of them, one
        for each motion.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    DeadlineExceeded
        The deadline is over. Pieces that were begun go on to their end, others are canceled; so is
        it where `progress` raises, or `progress.interrupted_by` says so.
    concurrent.futures.BrokenExecutor
        The executor broke: one that was given, or two in a row without a result.
    """
    instance('simulator', simulator, DirectSimulator)
    grippers, chains = _poses(work)
    rods = None if rods is None else _rods(simulator, rods, grippers if chains is None else None)
    checked(executor)
    chunk = _chunk(simulator, chunk, chains is None)
    steps = Progress(progress, deadline)
    with Crew(executor, steps.check) as crew:
        if chains is None:
            return _alone(simulator, grippers, rods, crew, chunk, steps)
        return _followed(simulator, chains, crew, chunk, steps)


def solve_many(simulator: DirectSimulator, grippers: Iterable[Pose] | Pose, *,
               rods: Iterable[Rod] | None = None, progress: OnProgress = None,
               deadline: float | None = None) -> Shapes:
    """Return the shapes at many gripper poses, or of many rods, each bit for bit as `solve` does.

    Shapes of DLOs that hang freely come from one compiled loop, also where their rods differ but
    each is the same along its length.

    Parameters
    ----------
    simulator : DirectSimulator
    grippers : iterable of Pose, or Pose
        Sequence of Pose; with rods one for each rod, or one Pose for all.
    rods : iterable of Rod, optional
        Rods that the gripper holds, each instead of the simulator's, with as many elements: as
        `simulator.with_rod(rod).solve(gripper)` finds. If None, the simulator's own.
    progress : callable, optional
        Called as progress(done, total) now and then.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    if rods is not None:
        rods = items('rods', rods, Rod)
        if isinstance(grippers, Pose):
            grippers = [grippers] * len(rods)
        grippers = items('grippers', grippers, Pose)
        if len(grippers) == 1:
            grippers = grippers * len(rods)
    grippers = items('grippers', grippers, Pose)
    if rods is not None and len(grippers) != len(rods):
        raise InvalidTask(f'grippers has {len(grippers)} entries: expected one Pose for each of '
                          f'{len(rods)} rods, or one for all')
    instance('simulator', simulator, DirectSimulator)
    # one loop fills the arrays of all, where nothing is long
    chunk = _LOOP if simulator.mesh.hangs and hangs_in_a_loop(simulator) else _AT_ONCE
    shapes = map(simulator, grippers, rods=rods, chunk=chunk, progress=progress, deadline=deadline)
    assert isinstance(shapes, Shapes)  # there are no motions in it
    return shapes


def _chunk(simulator: DirectSimulator, chunk: int | None, each_alone: bool) -> int:
    """Return how many poses are in one piece of work."""
    if chunk is None:
        quick = each_alone and simulator.mesh.hangs and hangs_in_a_loop(simulator)
        return _QUICK if quick else _AT_ONCE
    return integer('chunk', chunk, minimum=1, maximum=_MOST)


def _rods(simulator: DirectSimulator, rods: Iterable[Rod],
          grippers: Sequence[Pose] | None) -> tuple[Rod, ...]:
    """Return a tuple of Rods, one for each gripper, that the simulator can have; InvalidTask."""
    rods = items('rods', rods, Rod)
    if grippers is None:
        raise InvalidTask('rods: expected none where work has motions, each of which is of the '
                          'simulator\'s rod')
    if len(rods) != len(grippers):
        raise InvalidTask(f'rods has {len(rods)} entries: expected one Rod for each of '
                          f'{len(grippers)} Pose of work')
    for rod in rods:
        if not even(simulator, rod):
            simulator.surroundings.of_rod(rod)  # raises what is wrong with it there
    return rods


def _poses(work: Iterable[Any]) -> tuple[tuple[Pose, ...], list[tuple[Pose, ...]] | None]:
    """Return (Poses, None), or ((), motions), each a tuple of Poses."""
    work = items('work', work, object)
    if {type(one) for one in work} == {Pose} or all(isinstance(one, Pose) for one in work):
        return work, None
    for k, one in enumerate(work):
        if isinstance(one, Pose) != isinstance(work[0], Pose):
            raise InvalidTask(f'work[{k}] = {shown(one)}: expected all of it to be Pose, or '
                              'sequences of Pose')
    return (), [items(f'work[{k}]', one, Pose, least=1) for k, one in enumerate(work)]


def _alone(simulator: DirectSimulator, grippers: Sequence[Pose], rods: Sequence[Rod] | None,
           crew: Crew, chunk: int, steps: Progress) -> Shapes:
    """Return the Shapes at Poses, each by itself, of the simulator's rod or of one rod each."""
    n, shared = len(grippers), Shared(simulator)
    parts = list(_parts(n, chunk, crew.shares))
    positions, rotations = arrays_of(grippers)
    gathered = _Gathered(_Count(steps, n), n, parts)
    pieces = (Piece(shared, positions[begin:end], rotations[begin:end], seconds=steps.left(),
                    anew=tuple(range(end - begin)),
                    rods=None if rods is None else tuple(rods[begin:end]))
              for begin, end in parts)
    crew.run(result_of, pieces, gathered.finished)
    s = simulator.mesh.s
    lengths = [] if rods is None else [rod.length for rod in rods]
    if any(length != s[-1] for length in lengths):
        nodes = [scaled_nodes(s, length) for length in lengths]
        s = nodes[0] if len(set(lengths)) == 1 else np.array(nodes)
    return _shapes(simulator, grippers, gathered.parts, s)


def _parts(n: int, chunk: int, shared: bool) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of n poses: `chunk` in each, fewer at the end where workers share them.

    Who has done the last piece waits for the others: not as long, where the last ones are small.
    """
    begin = 0
    while begin < n:
        most = chunk if not shared else min(chunk, max(_FEW, (n - begin) // _LAST))
        yield begin, min(begin + most, n)
        begin += most


def _followed(simulator: DirectSimulator, chains: Sequence[Sequence[Pose]], crew: Crew, chunk: int,
              steps: Progress) -> list[Shapes]:
    """Return the Shapes of each motion."""
    total = sum(len(chain) for chain in chains)
    count = _Count(steps, total)
    rows = Following(simulator, chains, chunk, steps).rows(crew, count.finished)
    return [_shapes(simulator, chain, parts) for chain, parts in zip(chains, rows, strict=True)]


class _Count:
    """Reports how many of all shapes have been computed."""

    def __init__(self, steps: Progress, total: int) -> None:
        self._steps, self._total, self._done = steps, total, 0

    def finished(self, _: int, result: PieceResult) -> None:
        """Report one more piece."""
        self._done += result.size
        self._steps.done(self._done, self._total)


class _Gathered:
    """The columns of all shapes, each written to its place while others are computed."""

    def __init__(self, count: _Count, n: int, parts: Sequence[tuple[int, int]]) -> None:
        self._count, self._n, self._parts = count, n, parts
        self._columns: Columns = {}
        self._tables: dict[int, Floats] = {}

    def finished(self, index: int, result: PieceResult) -> None:
        """Take the rows of a piece."""
        rows, (first, end) = result.rows, self._parts[index]
        if len(self._parts) == 1:
            self._columns = rows
            self._count.finished(index, result)
            return
        for name, values in rows.items():
            if name == 'contact_table':
                self._tables[index] = values + first * (np.arange(values.shape[1]) == 0)
                continue
            if name not in self._columns:
                self._columns[name] = np.empty((self._n, *values.shape[1:]), values.dtype)
            self._columns[name][first:end] = values
        self._count.finished(index, result)
        rows.clear()  # the next piece has its memory

    @property
    def parts(self) -> list[Columns]:
        """What there is, as `_shapes` takes it."""
        if self._tables:
            tables = [self._tables[index] for index in sorted(self._tables)]
            return [self._columns | {'contact_table': np.concatenate(tables)}]
        return [self._columns] if self._columns else []


def _shapes(simulator: DirectSimulator, grippers: Sequence[Pose], rows: Sequence[Columns],
            s: Floats | None = None) -> Shapes:
    s = simulator.mesh.s if s is None else s
    arrays = rows[0] if len(rows) == 1 else stacked(rows or [columns([], s)])
    if simulator.surroundings.pinned:
        grippers = [Pose.from_rotation(gripper.position, np.array(frames[0]))
                    for gripper, frames in zip(grippers, arrays['frames'], strict=True)]
    freeze(arrays)  # all new: Shapes need not copy them
    return Shapes(tuple(grippers), s, **arrays)
