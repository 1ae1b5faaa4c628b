# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Modes along a path, matched by likeness: a mode stays itself where frequencies cross."""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.optimize import linear_sum_assignment

from dlo_planner.direct.modes import MOST, Linearized, Modes, modes_from, solved
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import integer, items

_SPARE = 4     # more modes than asked for are computed: a followed one may have become faster
_EQUAL = 1e-6  # relative difference of squares of frequencies that count as one


def modes_along(shapes: Iterable[Shape], n: int = 4) -> tuple[Modes, ...]:
    """Return the Modes of each shape; mode i of one continues mode i of the one before.

    The n slowest modes of the first shape are followed: the modes of the next shape are assigned
    so that the sum of `Modes.overlap` is largest. Modes of equal frequency, as of a round DLO that
    hangs straight, are first turned together so as to be most like those before. Where an overlap
    is small, the steps along the path are too long to tell which mode is which.

    Parameters
    ----------
    shapes : iterable of Shape
        In the order of the path, as from `DirectSimulator.track`; meshes may differ.
    n : int, optional
        How many modes; there may be fewer, see `Shape.modes`.

    Raises
    ------
    InvalidTask
        A shape that has no modes, see `Shape.modes`, or fewer than the one before.
    """
    shapes = items('shapes', shapes, Shape)
    n = integer('n', n, minimum=1, maximum=MOST)
    tracked: list[Modes] = []
    for k, shape in enumerate(shapes):
        linear = Linearized(shape, f'shapes[{k}]')
        if not tracked:
            vibration = linear.resolving(n + _SPARE)
            squares, found = solved(vibration, n, linear.name)
            tracked.append(modes_from(linear, vibration, squares, found,
                                      np.arange(squares.size)))
        else:
            tracked.append(_continued(tracked[-1], linear))
    return tuple(tracked)


def _continued(before: Modes, linear: Linearized) -> Modes:
    """Return the Modes of a Linearized shape that continue the Modes `before`."""
    vibration = linear.resolving(len(before) + _SPARE)
    squares, found = solved(vibration, len(before) + _SPARE, linear.name)
    if squares.size < len(before):
        raise InvalidTask(f'{linear.name}: expected one with {len(before)} modes or more, as the '
                          f'one before, it has {squares.size}')
    weighted = displacements_on(before, linear.shape.s) * vibration.masses[:, None]
    like = np.einsum('mki,kic->mc', weighted, vibration.jacobian)  # products with the coordinates
    for one in _equal(squares):
        found[:, one] = _turned(like, found[:, one])
    product = like @ found
    _, places = linear_sum_assignment(-np.abs(product))
    likeness = product[np.arange(len(before)), places]
    signs = np.where(likeness < 0, -1.0, 1.0)
    return modes_from(linear, vibration, squares[places], found[:, places] * signs, places,
                      np.minimum(np.abs(likeness), 1.0))


def displacements_on(modes: Modes, s: np.ndarray) -> np.ndarray:
    """Return (n, N + 1, 3) the displacements of Modes, m, on another mesh: nodes s (N + 1,), m.

    Linear between the nodes of the modes. A DLO of another length is scaled to this one.
    """
    if s.size == modes.s.size and (s == modes.s).all():
        return modes.displacements
    flat = np.moveaxis(modes.displacements, 1, 2).reshape(-1, modes.s.size)
    at = np.array([np.interp(s / s[-1], modes.s / modes.s[-1], one) for one in flat])
    return np.moveaxis(at.reshape(len(modes), 3, s.size), 2, 1)


def _equal(squares: Floats) -> Iterator[slice]:
    """Yield slices of ascending squares (n,) of frequencies that are equal."""
    ends = np.flatnonzero(np.diff(squares) > _EQUAL * squares[1:]) + 1
    for begin, end in zip([0, *ends], [*ends, squares.size], strict=True):
        if end - begin > 1:
            yield slice(begin, end)


def _turned(like: Floats, found: Floats) -> Floats:
    """Return modes (c, g) of equal frequency, combined to be most like g modes before.

    Orthogonal Procrustes: Golub and Van Loan, Matrix Computations, ch. 6.4.

    Shapes: like (n, c).
    """
    product = like @ found
    nearest = np.sort(np.argsort(-np.sum(product**2, axis=1), kind='stable')[:found.shape[1]])
    left, _, right = np.linalg.svd(product[nearest], full_matrices=True)
    count = len(nearest)
    turn = right.T.copy()
    turn[:, :count] = right[:count].T @ left.T
    result: Floats = found @ turn
    return result
