# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Independent computation (paper, section 4.3.4): many shapes, by as many workers as there are."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, integer, items, shown
from dlo_planner.model.pose import Pose
from dlo_planner.parallel.chains import Following
from dlo_planner.parallel.pieces import Found, Shared, found, piece_of
from dlo_planner.parallel.shapes import Columns, Shapes, columns, stacked
from dlo_planner.parallel.workers import Crew, Workers, checked
from dlo_planner.progress import OnProgress, Progress

_AT_ONCE = 64  # gripper poses in one piece of work
_MOST = 100_000


def map(simulator: DirectSimulator, work: Iterable[Any], executor: Workers = None, *,  # noqa: A001
        chunk: int = _AT_ONCE, progress: OnProgress = None,
        deadline: float | None = None) -> Shapes | list[Shapes]:
    """Return the shapes at many gripper poses, found by the workers of an executor.

    The result does not depend on the executor, nor on how many workers it has: it is the same bit
    for bit (on machines of one kind), in the order of `work`.

    Parameters
    ----------
    simulator : DirectSimulator
    work : iterable of object
        Sequence of Pose: each by itself, the same bit for bit as `simulator.solve(pose)`; or
        sequence of motions, each a sequence of Pose that is followed like `simulator.track(poses)`.
        A motion of more than `chunk` + 1 poses is cut into parts, where the DLO neither yields nor
        touches with friction. A part begins with a shape that was found from the natural one, or
        among obstacles with one that was followed on a coarse motion. Where that is not the one in
        which the part before it ends, the part is followed again from there. The equilibria and
        jumps are those of `track`; their numbers differ by what the solver leaves open (1e-5 of the
        length at a seam at most).
    executor : Workers, optional
        `concurrent.futures.Executor`: threads, processes, or a cluster's (extra `[cluster]`:
        `dask.distributed.Client(...).get_executor()`); a function that makes one, which is closed
        at the end. If None, one after the other. A pool that has lost a process is replaced, and
        only what it was working on is done again.
    chunk : int, optional
        Poses in one piece of work.
    progress : callable, optional
        Called as progress(done, total) after each piece, in poses; where parts do not meet, what is
        done again is not counted.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Returns
    -------
    Shapes or list of Shapes
        Shapes on the simulator's mesh; or a list of them, one for each motion.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    DeadlineExceeded
        The deadline is over. Pieces that were begun go on to their end, others are canceled; so is
        it where `progress` raises, or `progress.interrupted_by` says so.
    concurrent.futures.BrokenExecutor
        The executor broke, again and again or for good.
    """
    instance('simulator', simulator, DirectSimulator)
    grippers, chains = _poses(work)
    checked(executor)
    chunk = integer('chunk', chunk, minimum=1, maximum=_MOST)
    steps = Progress(progress, deadline)
    with Crew(executor, steps.check) as crew:
        if chains is not None:
            return _followed(simulator, chains, crew, chunk, steps)
        return _alone(simulator, grippers, crew, chunk, steps)


def solve_many(simulator: DirectSimulator, grippers: Iterable[Pose], *, progress: OnProgress = None,
               deadline: float | None = None) -> Shapes:
    """Return the shapes at many gripper poses, each the same bit for bit as `simulator.solve`.

    Parameters
    ----------
    simulator : DirectSimulator
    grippers : iterable of Pose
        Sequence of Pose.
    progress : callable, optional
        Called as progress(done, total) now and then.
    deadline : float, optional
        Seconds of computing after which DeadlineExceeded is raised. If None, no limit.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    found_ = map(simulator, items('grippers', grippers, Pose), progress=progress, deadline=deadline)
    assert isinstance(found_, Shapes)  # there are no motions in it
    return found_


def _poses(work: Iterable[Any]) -> tuple[tuple[Pose, ...], list[tuple[Pose, ...]] | None]:
    """Return (Poses, None), or ((), motions), each a tuple of Poses."""
    work = items('work', work, object)
    if all(isinstance(one, Pose) for one in work):
        return work, None
    for k, one in enumerate(work):
        if isinstance(one, Pose) != isinstance(work[0], Pose):
            raise InvalidTask(f'work[{k}] = {shown(one)}: expected all of it to be Pose, or '
                              'sequences of Pose')
    return (), [items(f'work[{k}]', one, Pose, least=1) for k, one in enumerate(work)]


def _alone(simulator: DirectSimulator, grippers: Sequence[Pose], crew: Crew, chunk: int,
           steps: Progress) -> Shapes:
    """Return the Shapes at Poses, each by itself."""
    count, shared = _Count(steps, len(grippers)), Shared(simulator)
    pieces = (piece_of(shared, grippers[k:k + chunk], seconds=steps.left(),
                       anew=tuple(range(len(grippers[k:k + chunk]))))
              for k in range(0, len(grippers), chunk))
    return _shapes(simulator, grippers,
                   [one.rows for one in crew.run(found, pieces, count.finished)])


def _followed(simulator: DirectSimulator, chains: Sequence[Sequence[Pose]], crew: Crew, chunk: int,
              steps: Progress) -> list[Shapes]:
    """Return the Shapes of each motion."""
    total = sum(len(chain) for chain in chains)
    count = _Count(steps, total)
    rows = Following(simulator, chains, chunk, steps).rows(crew, count.finished)
    return [_shapes(simulator, chain, parts) for chain, parts in zip(chains, rows, strict=True)]


class _Count:
    """Reports how many of all shapes are found."""

    def __init__(self, steps: Progress, total: int) -> None:
        self._steps, self._total, self._done = steps, total, 0

    def finished(self, _: int, result: Found) -> None:
        """Report one more piece."""
        self._done += len(result.rows['converged'])
        self._steps.done(self._done, self._total)


def _shapes(simulator: DirectSimulator, grippers: Sequence[Pose],
            rows: Sequence[Columns]) -> Shapes:
    s = simulator.mesh.s
    found_ = stacked(rows or [columns([], s)])
    if simulator.surroundings.pinned:
        grippers = [Pose.from_rotation(gripper.position, np.array(frames[0]))
                    for gripper, frames in zip(grippers, found_['frames'], strict=True)]
    return Shapes(tuple(grippers), s, **found_)
