# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A piece of work: some gripper poses, and the shapes that a worker finds there."""

from collections.abc import Sequence
from functools import lru_cache
from pickle import dumps, loads
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.batch import (
    Filled,
    even,
    hanging_rods,
    hanging_shapes,
    hangs_in_a_loop,
    scaled_nodes,
)
from dlo_planner.direct.shape import Shape
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.model.arrays import Floats
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import freeze, put
from dlo_planner.parallel.shapes import Columns, columns, stacked
from dlo_planner.progress import Progress

_KNOWN = 8  # contents that a worker keeps
NO_CONTACTS = columns([], np.zeros(2))['contact_table']


class Shared:
    """Something that many pieces of work need: a worker unpacks it once and keeps it."""

    def __init__(self, content: Any) -> None:
        self.content = content
        self._packed: bytes | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        if self._packed is None:
            self._packed = dumps(self.content, protocol=5)
        return _unpacked, (self._packed,)


@lru_cache(maxsize=_KNOWN)
def _unpacked(packed: bytes) -> Shared:
    return Shared(loads(packed))


class Piece(NamedTuple):
    """Gripper poses to be followed, as arrays: a pickled Pose costs ten times as much.

    Attributes
    ----------
    simulator : Shared
        Shared DirectSimulator.
    positions : ndarray, shape (m, 3)
        Positions in m.
    rotations : ndarray, shape (m, 3, 3)
    anew : tuple of int
        Indices of poses that begin from the natural shape, whatever comes before.
    start : Shape or None
        Shape before the first pose, or None.
    dropped : int
        So many shapes at the beginning are not given back.
    ends : bool
        Whether the first and the last Shape are given back as well.
    seconds : float or None
        Seconds of computing that are left. If None, no limit.
    rods : sequence of Rod or None
        The m rods that the gripper holds instead of the simulator's, each begun anew. If None,
        that.
    """

    simulator: Shared
    positions: Floats
    rotations: Floats
    anew: tuple[int, ...] = ()
    start: Shape | None = None
    dropped: int = 0
    ends: bool = False
    seconds: float | None = None
    rods: tuple[Rod, ...] | None = None


class PieceResult(NamedTuple):
    """The result of a Piece: `columns`, and Shapes on request.

    Attributes
    ----------
    rows : Columns
        dict of arrays, see `shapes.columns`.
    first : Shape or None
        The first Shape, where it is not given back otherwise.
    last : Shape or None
        Shape from which the next piece goes on: the last that converged, or nearly did.
    """

    rows: Columns
    first: Shape | None = None
    last: Shape | None = None

    @property
    def size(self) -> int:
        """Number of shapes."""
        return len(self.rows['converged'])


def piece_of(simulator: Shared, grippers: Sequence[Pose], **more: Any) -> Piece:
    """Return the Piece of some Poses."""
    return Piece(simulator, *arrays_of(grippers), **more)


def arrays_of(grippers: Sequence[Pose]) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) of n Poses, read-only."""
    n = len(grippers)
    return (_rows([pose.position for pose in grippers]).reshape(n, 3),
            _rows([pose.rotation for pose in grippers]).reshape(n, 3, 3))


def _rows(arrays: list[Any]) -> Floats:
    """Return the numbers of some arrays in a row, read-only: `np.array` takes ten times as long."""
    try:
        return np.frombuffer(b''.join(arrays))
    except TypeError:  # some are transposed in memory
        return np.frombuffer(b''.join([one.tobytes() for one in arrays]))


def result_of(piece: Piece) -> PieceResult:
    """Return the PieceResult of a Piece; workers call it."""
    simulator = piece.simulator.content
    if piece.rods is not None:
        return PieceResult(_each_rod(simulator, piece))
    if len(piece.anew) == len(piece.positions) and hangs_in_a_loop(simulator):
        return _each_alone(simulator, piece)
    grippers = [_pose(*both) for both in zip(piece.positions, piece.rotations, strict=True)]
    starts = sorted({0, *piece.anew})
    shapes = []
    for begin, end in zip(starts, [*starts[1:], len(grippers)], strict=True):
        shapes += simulator.track(grippers[begin:end], deadline=piece.seconds,
                                  initial=None if begin in piece.anew else piece.start)
    rows = columns(shapes[piece.dropped:], simulator.mesh.s)
    if not piece.ends:
        return PieceResult(rows)
    good = [shape for shape in shapes if shape.converged or shape.nearly]
    return PieceResult(rows, shapes[0] if piece.dropped else None,
                       good[-1] if good else piece.start)


def _each_alone(simulator: DirectSimulator, piece: Piece) -> PieceResult:
    """Return the PieceResult in each gripper, by the compiled loop where the DLO hangs freely."""
    n = len(piece.positions)
    filled = Filled.new(n, simulator.mesh.s.size - 1)
    steps = Progress(deadline=piece.seconds)
    good = hanging_shapes(simulator, piece.positions, piece.rotations, filled)
    touching = [NO_CONTACTS]
    for k in np.flatnonzero(~good):
        shape = simulator.solve(_pose(piece.positions[k], piece.rotations[k]))
        for name, values in columns([shape], simulator.mesh.s).items():
            if name != 'contact_table':
                filled.columns[name][k] = values[0]
            elif len(values):
                touching.append(values + k * (np.arange(values.shape[1]) == 0))
        steps.check()
    return PieceResult(filled.columns | {'contact_table': np.concatenate(touching)})


def _each_rod(simulator: DirectSimulator, piece: Piece) -> Columns:
    """Return `columns` of one shape of each rod, on nodes like the simulator's."""
    rods, s = piece.rods or (), simulator.mesh.s
    n = len(rods)
    parts: dict[int, Columns] = {}
    loop = np.array([k for k, rod in enumerate(rods) if even(simulator, rod)], dtype=np.int64)
    if loop.size:
        rows, good = hanging_rods(simulator, [rods[k] for k in loop],
                                  piece.positions[loop], piece.rotations[loop])
        rows['contact_table'] = NO_CONTACTS
        if loop.size == n and good.all():
            return rows
        for row, k in enumerate(loop):
            if good[row]:
                parts[k] = {name: values[row:row + 1] for name, values in rows.items()}
    for k in (k for k in range(n) if k not in parts):
        one = simulator.with_rod(rods[k])
        shape = one.solve(_pose(piece.positions[k], piece.rotations[k]))
        parts[k] = columns([shape], scaled_nodes(s, rods[k].length))
    return stacked([parts[k] for k in range(n)])


def _pose(position: Floats, rotation: Floats) -> Pose:
    """Return a Pose with exactly these axes, which `Pose.from_rotation` would make orthonormal."""
    pose = object.__new__(Pose)
    put(pose, position=position.copy(), rotation=rotation.copy())
    freeze(list(pose.__dict__.values()))
    return pose
