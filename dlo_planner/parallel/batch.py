# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Independent computation (paper, section 4.3.4): many shapes, by as many workers as there are."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.free_loop import (
    even,
    free_rods,
    free_shapes,
    has_free_loop,
    scaled_nodes,
)
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, integer, items, shown
from dlo_planner.model.holds import Hold, Holds, have_rings, holds_of
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import freeze, put
from dlo_planner.parallel.pool import CachedPayload, Pool, Workers, checked
from dlo_planner.parallel.shapes import TABLES, Columns, Shapes, columns, stacked
from dlo_planner.progress import OnProgress, Progress

_AT_ONCE = 64  # gripper poses in one piece of work
_QUICK = 128   # the same of DLOs that hang freely: 10 ms, of which handing it out costs 5 %
_LOOP = 512    # of one that nobody waits for
_FEW, _LAST = 16, 4  # the last pieces: a quarter of what is left, 16 at the least
_MOST = 100_000
_NO_CONTACTS = {name: columns([], np.zeros(2))[name] for name in TABLES}


def map(simulator: DirectSimulator, work: Iterable[Any], executor: Workers = None, *,  # noqa: A001
        rods: Iterable[Rod] | None = None, holds: Iterable[Hold] = (), chunk: int | None = None,
        progress: OnProgress = None, deadline: float | None = None) -> Shapes | list[Shapes]:
    """Return the shapes at many gripper poses, found by the workers of an executor.

    The result does not depend on the executor, nor on how many workers it has: it is the same bit
    for bit (on machines of one kind), in the order of `work`.

    Parameters
    ----------
    simulator : DirectSimulator
    work : iterable of object
        Sequence of Pose: each by itself, the same bit for bit as `simulator.solve(pose)`; or
        sequence of motions, each a sequence of Pose that one worker follows: the same bit for bit
        as `simulator.track(poses)`.
    executor : Workers, optional
        `concurrent.futures.Executor`: threads, processes, or a cluster's (extra `[cluster]`:
        `dask.distributed.Client(...).get_executor()`); a function that makes one, which is closed
        at the end. If None, one after the other. Where a function makes it, a pool that has lost a
        process is replaced, and only what it had not finished is done again.
    rods : iterable of Rod, optional
        One rod for each Pose of `work`, which the gripper holds instead of the simulator's: the
        same bit for bit as `simulator.with_rod(rod).solve(pose)`. If None, the simulator's.
    holds : iterable of Hold, optional
        What holds all of them beside the gripper, at rest.
    chunk : int, optional
        Poses in one piece of work; the last pieces have fewer, about 16. If None, 64, or 128 of a
        DLO that hangs freely. A motion is one piece.
    progress : callable, optional
        Called as progress(done, total) after each piece, in poses.
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
        The deadline is over. Pieces that an executor has begun go on to their end, others are
        canceled; so is it where `progress` raises, or `progress.interrupted_by` says so.
    concurrent.futures.BrokenExecutor
        The executor broke: one that was given, or two in a row without a result.
    """
    instance('simulator', simulator, DirectSimulator)
    grippers, chains = _poses(work)
    rods = None if rods is None else _rods(simulator, rods, grippers if chains is None else None)
    checked(executor)
    held: Holds = ()
    if not isinstance(holds, tuple) or holds:
        held = _resting(holds, simulator.rod.length)
    quick = chains is None and not held and simulator.mesh.hangs and has_free_loop(simulator)
    chunk = (_QUICK if quick else _AT_ONCE) if chunk is None else integer(
        'chunk', chunk, minimum=1, maximum=_MOST)
    steps = Progress(progress, deadline)
    with Pool(executor, steps.check) as pool:
        if chains is None:
            return _alone(simulator, grippers, rods, held, pool, chunk, steps)
        return _followed(simulator, chains, held, pool, steps)


def solve_many(simulator: DirectSimulator, grippers: Iterable[Pose] | Pose, *,
               rods: Iterable[Rod] | None = None, holds: Iterable[Hold] = (),
               progress: OnProgress = None, deadline: float | None = None) -> Shapes:
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
    holds : iterable of Hold, optional
        What holds all of them beside the gripper, at rest.
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
    held: Holds = ()
    if not isinstance(holds, tuple) or holds:
        held = _resting(holds, simulator.rod.length)
    loop = not held and simulator.mesh.hangs and has_free_loop(simulator)
    shapes = map(simulator, grippers, rods=rods, holds=held, chunk=_LOOP if loop else _AT_ONCE,
                 progress=progress, deadline=deadline)
    assert isinstance(shapes, Shapes)  # there are no motions in it
    return shapes


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
           holds: Holds, pool: Pool, chunk: int, steps: Progress) -> Shapes:
    """Return the Shapes at Poses, each by itself, of the simulator's rod or of one rod each."""
    parts, payload = list(_parts(len(grippers), chunk, pool.shares)), CachedPayload(simulator)
    positions, rotations = arrays_of(grippers)
    found = _computed((Piece(payload, positions[begin:end], rotations[begin:end], False,
                             steps.left(), None if rods is None else tuple(rods[begin:end]),
                             holds)
                       for begin, end in parts), [end - begin for begin, end in parts], pool, steps)
    s = simulator.mesh.s
    lengths = [] if rods is None else [rod.length for rod in rods]
    if any(length != s[-1] for length in lengths):
        nodes = [scaled_nodes(s, length) for length in lengths]
        s = nodes[0] if len(set(lengths)) == 1 else np.array(nodes)
    none = columns([], s) | {'wrenches': np.zeros((0, len(holds), 6))}
    return _shapes(simulator, grippers, stacked(found) if found else none, s, holds)


def _parts(n: int, chunk: int, shared: bool) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of n poses: `chunk` in each, fewer at the end where workers share them.

    Who has done the last piece waits for the others: not as long, where the last ones are small.
    """
    begin = 0
    while begin < n:
        most = chunk if not shared else min(chunk, max(_FEW, (n - begin) // _LAST))
        yield begin, min(begin + most, n)
        begin += most


def _resting(holds: Iterable[Hold], length: float) -> Holds:
    """Return Holds of a DLO of `length` (m) that are the same for all; raise InvalidTask."""
    held = holds_of(None, holds, length)
    if have_rings(held):
        raise InvalidTask(f'holds = {shown(held)}: expected none that the DLO slides through, as '
                          'each shape would be held at other places')
    return held


def _followed(simulator: DirectSimulator, motions: Sequence[Sequence[Pose]], holds: Holds,
              pool: Pool, steps: Progress) -> list[Shapes]:
    """Return the Shapes of each motion."""
    payload = CachedPayload(simulator)
    found = _computed((Piece(payload, *arrays_of(motion), True, steps.left(), None, holds)
                       for motion in motions), [len(motion) for motion in motions], pool, steps)
    return [_shapes(simulator, motion, rows, simulator.mesh.s, holds)
            for motion, rows in zip(motions, found, strict=True)]


def _computed(pieces: Iterable['Piece'], sizes: Sequence[int], pool: Pool,
              steps: Progress) -> list[Columns]:
    """Return the `columns` of each Piece; `sizes` are their numbers of poses."""
    found: dict[int, Columns] = {}

    def finished(index: int, rows: Columns) -> None:
        found[index] = rows
        steps.done(sum(sizes[k] for k in found), sum(sizes))

    pool.run(columns_of, pieces, finished)
    return [found[index] for index in range(len(sizes))]


def _shapes(simulator: DirectSimulator, grippers: Sequence[Pose], rows: Columns,
            s: Floats, holds: Holds) -> Shapes:
    if simulator.surroundings.pinned:
        grippers = [Pose.from_rotation(gripper.position, np.array(frames[0]))
                    for gripper, frames in zip(grippers, rows['frames'], strict=True)]
    freeze(rows)  # all new: Shapes need not copy them
    return Shapes(tuple(grippers), s, holds=holds, **rows)


# What workers do.


class Piece(NamedTuple):
    """Gripper poses as arrays (a pickled Pose costs ten times as much), and what is there."""

    simulator: CachedPayload  # a DirectSimulator
    positions: Floats         # (m, 3)
    rotations: Floats         # (m, 3, 3)
    followed: bool            # one after the other; else each from the natural shape
    seconds: float | None     # of computing that are left
    rods: tuple[Rod, ...] | None = None  # the m rods that are held instead of the simulator's
    holds: Holds = ()


def arrays_of(grippers: Sequence[Pose]) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) of n Poses."""
    return (np.array([pose.position for pose in grippers]).reshape(-1, 3),
            np.array([pose.rotation for pose in grippers]).reshape(-1, 3, 3))


def columns_of(piece: Piece) -> Columns:
    """Return the `columns` of a Piece; workers call it."""
    simulator = piece.simulator.content
    if piece.rods is not None:
        return _each_rod(simulator, piece)
    if not piece.followed and not piece.holds and has_free_loop(simulator):
        return _each_alone(simulator, piece)
    grippers = [_pose(*both) for both in zip(piece.positions, piece.rotations, strict=True)]
    steps = Progress(deadline=piece.seconds)
    shapes = [shape for motion in ([grippers] if piece.followed else [[one] for one in grippers])
              for shape in simulator.track(motion, holds=piece.holds, deadline=steps.left())]
    return columns(shapes, simulator.mesh.s)


def _each_alone(simulator: DirectSimulator, piece: Piece) -> Columns:
    """Return `columns` in each gripper, by the compiled loop where the DLO hangs freely."""
    steps = Progress(deadline=piece.seconds)
    rows, good = free_shapes(simulator, piece.positions, piece.rotations)
    tables = {name: [none] for name, none in _NO_CONTACTS.items()}
    for k in np.flatnonzero(~good):
        shape = simulator.solve(_pose(piece.positions[k], piece.rotations[k]))
        for name, values in columns([shape], simulator.mesh.s).items():
            if name not in TABLES:
                rows[name][k] = values[0]
            elif len(values):
                tables[name].append(values + k * (np.arange(values.shape[1]) == 0))
        steps.check()
    return rows | {name: np.concatenate(parts) for name, parts in tables.items()}


def _each_rod(simulator: DirectSimulator, piece: Piece) -> Columns:
    """Return `columns` of one shape of each rod, on nodes like the simulator's."""
    rods, s = piece.rods or (), simulator.mesh.s
    n = len(rods)
    parts: dict[int, Columns] = {}
    loop = np.array([k for k, rod in enumerate(rods)
                     if even(simulator, rod) and not piece.holds], dtype=np.int64)
    if loop.size:
        rows, good = free_rods(simulator, [rods[k] for k in loop],
                               piece.positions[loop], piece.rotations[loop])
        rows |= _NO_CONTACTS
        if loop.size == n and good.all():
            return rows
        for row, k in enumerate(loop):
            if good[row]:
                parts[k] = {name: values[row:row + 1] for name, values in rows.items()}
    for k in (k for k in range(n) if k not in parts):
        one = simulator.with_rod(rods[k])
        shape = one.solve(_pose(piece.positions[k], piece.rotations[k]), holds=piece.holds)
        parts[k] = columns([shape], scaled_nodes(s, rods[k].length))
    return stacked([parts[k] for k in range(n)])


def _pose(position: Floats, rotation: Floats) -> Pose:
    """Return a Pose with exactly these axes, which `Pose.from_rotation` would make orthonormal."""
    pose = object.__new__(Pose)
    put(pose, position=position.copy(), rotation=rotation.copy())
    freeze(list(pose.__dict__.values()))
    return pose
