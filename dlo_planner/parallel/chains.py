# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One motion by many workers: parts that begin at once, and are judged where they meet.

The shape that a DLO takes on a motion follows from the one before. Where it is elastic and nothing
rubs, the only thing that it follows from it is which of several equilibria it is. So a part of the
motion may begin with a shape that was found differently, if the part before it turns out to end in
this shape.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.direct.step import step
from dlo_planner.model.pose import Pose
from dlo_planner.parallel.pieces import Piece, PieceResult, Shared, piece_of, result_of
from dlo_planner.parallel.shapes import Columns
from dlo_planner.parallel.workers import Crew
from dlo_planner.progress import Progress

_SAME = 1e-5  # of the length, and rad: by how much two results for one equilibrium may differ


def may_be_cut(simulator: DirectSimulator) -> bool:
    """Whether the motion to a shape decides only which equilibrium it is.

    What yields remembers its way, and so does what rubs (paper: the first two conditions).
    """
    return not simulator.rod.yields and not any(one.friction for one in simulator.obstacles)


def parts_of(simulator: DirectSimulator, chain: Sequence[Pose], size: int) -> list[range]:
    """Return which poses of a motion each part finds; the first begins from the natural shape."""
    if not may_be_cut(simulator):
        return [range(len(chain))]
    # the pose at which two parts meet is the last one of the part before
    ends = [*range(size + 1, len(chain), size), len(chain)]
    return [range(*both) for both in zip([0, *ends], ends, strict=False)]


class Following:
    """Follows chains of gripper poses, in parts where that can be done.

    Parameters
    ----------
    simulator : DirectSimulator
    chains : sequence of sequence of Pose
        Sequences of Pose.
    size : int
        Poses in a part, at most.
    steps : Progress
    """

    def __init__(self, simulator: DirectSimulator, chains: Sequence[Sequence[Pose]], size: int,
                 steps: Progress) -> None:
        self._simulator, self._shared, self._steps = simulator, Shared(simulator), steps
        self._jobs = [(chain, part) for chain in chains
                      for part in parts_of(simulator, chain, size)]

    def rows(self, crew: Crew,
             finished: Callable[[int, PieceResult], object]) -> list[list[Columns]]:
        """Return for each chain the `columns` of its parts, in order."""
        results = _results(crew, self._first_pieces(), finished)
        seams = {k for k, (_, part) in enumerate(self._jobs) if part.start}
        doubtful = sorted(seams)
        while wrong := [k for k in doubtful if not _meet(results[k - 1], results[k])]:
            # the first of them begins with what is right now, so there is one less at least
            pieces = [self._after(k, results[k - 1].last) for k in wrong]
            for k, again in zip(wrong, _results(crew, pieces, lambda *_: None), strict=True):
                results[k] = again
            doubtful = sorted(seams & {*wrong, *(k + 1 for k in wrong)})
        rows: list[list[Columns]] = []
        for (_, part), result in zip(self._jobs, results, strict=True):
            rows += [] if part.start else [[]]
            rows[-1].append(result.rows)
        return rows

    def _first_pieces(self) -> Iterator[Piece]:
        """Yield all parts, each with a shape to begin with that needs no other part."""
        known = None
        for k, (chain, part) in enumerate(self._jobs):
            if not part.start:
                known = None
                yield self._piece(k, part, ends=part.stop < len(chain))
                continue
            shape = None
            if self._simulator.obstacles:  # on a coarse motion
                known = known or self._simulator.solve(chain[0])
                shape, = self._simulator.track([chain[part.start - 1]], initial=known,
                                               deadline=self._steps.left())
            if shape is not None and shape.converged:
                known = shape
                yield self._after(k, shape)
            else:
                yield self._piece(k, range(part.start - 1, part.stop), dropped=1, ends=True)

    def _after(self, k: int, start: Shape | None) -> Piece:
        """Return the Piece of a part that goes on from the Shape `start`."""
        return self._piece(k, self._jobs[k][1], start=start, ends=True)

    def _piece(self, k: int, part: range, **more: Any) -> Piece:
        chain = self._jobs[k][0]
        return piece_of(self._shared, chain[part.start:part.stop], seconds=self._steps.left(),
                        **more)


def _results(crew: Crew, pieces: Iterable[Piece],
             finished: Callable[[int, PieceResult], object]) -> list[PieceResult]:
    """Return the PieceResults; those of Pieces with a start have it as their first Shape."""
    given = []

    def noted() -> Iterator[Piece]:
        for piece in pieces:
            given.append(piece)
            yield piece

    results = crew.run(result_of, noted(), finished)
    return [result if piece.dropped else PieceResult(result.rows, piece.start, result.last)
            for piece, result in zip(given, results, strict=True)]


def _meet(before: PieceResult, after: PieceResult) -> bool:
    """Whether one PieceResult goes on from the end of the other."""
    last, first = before.last, after.first
    if last is first:
        return True
    if last is None or first is None or not (last.converged and first.converged):
        return False
    if not np.array_equal(last.gripper.position, first.gripper.position):
        return False  # the last shapes of the part before have failed
    if not np.array_equal(last.s, first.s):
        first, _ = step(last.state.made_on, last.gripper, first)
    return bool(first.converged
                and np.abs(last.positions - first.positions).max() <= _SAME * last.s[-1]
                and np.abs(last.frames - first.frames).max() <= _SAME)
