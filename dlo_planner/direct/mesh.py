# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the nodes of a DLO are: at equal distances, or graded to the bend; always at its jumps."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dlo_planner.geometry.basis import equidistribute

Breaks: TypeAlias = NDArray[np.float64] | tuple[()]

_NEAR = 0.3  # of an element: a node nearer to a jump moves there


def even_mesh(length: float, elements: int, breaks: Breaks = ()) -> NDArray[np.float64]:
    """Return nodes (elements + 1,): between jumps equal elements, about as long everywhere.

    Shapes: breaks (n,).
    """
    if not len(breaks) or len(breaks) + 1 > elements:
        s = np.arange(elements + 1.0) * np.float64(length / elements)
        s[-1] = length
        return s
    ends = np.concatenate([[0.0], breaks, [length]])
    parts = np.diff(ends)
    shares = np.ones(parts.size, dtype=int)
    for _ in range(elements - parts.size):
        shares[np.argmax(parts / shares)] += 1
    pieces = [np.linspace(a, b, n, endpoint=False)
              for a, b, n in zip(ends[:-1], ends[1:], shares, strict=True)]
    return np.append(np.concatenate(pieces), length)


def graded_mesh(s: NDArray[np.float64], strains: NDArray[np.float64], elements: int,
                breaks: Breaks = ()) -> NDArray[np.float64]:
    """Return nodes that share out evenly the error of arcs of constant strain: `equidistribute`.

    Shapes: s (N + 1,), strains (N, 3), breaks (n,).
    """
    return nodes_at(s, equidistribute(np.diff(s), np.array(strains)), elements, breaks)


def nodes_at(s: NDArray[np.float64], shares: NDArray[np.float64], elements: int,
             breaks: Breaks = ()) -> NDArray[np.float64]:
    """Return nodes (elements + 1,), more where there are jumps, with as much in each element.

    Shapes: s (N + 1,), shares (N + 1,), breaks (n,).
    """
    nodes = np.interp(np.arange(elements + 1.0) * (1.0 / elements), shares, s)
    nodes[0], nodes[-1] = 0.0, s[-1]
    return with_breaks(nodes, breaks)


def with_breaks(s: NDArray[Any], breaks: Breaks) -> NDArray[np.float64]:
    """Return nodes with one at each jump: a near one moves there, else one is added."""
    if not len(breaks):
        return s
    if np.isin(breaks, s).all():
        return s
    inner = s[1:-1]
    after = np.clip(np.searchsorted(breaks, inner), 0, len(breaks) - 1)
    before = np.maximum(after - 1, 0)
    away = np.minimum(np.abs(breaks[after] - inner), np.abs(breaks[before] - inner))
    kept = inner[away > _NEAR * np.minimum(np.diff(s)[1:], np.diff(s)[:-1])]
    return np.concatenate([[0.0], np.union1d(kept, breaks), [s[-1]]])


def straight_between(s: NDArray[np.float64], values: NDArray[np.float64],
                     nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, k) values in the middles of the elements of another mesh, straight in between.

    Shapes: s (N + 1,), values (N, k), nodes (n + 1,).
    """
    middle, wanted = 0.5 * (s[1:] + s[:-1]), 0.5 * (nodes[1:] + nodes[:-1])
    after = np.clip(np.searchsorted(middle, wanted), 1, middle.size - 1)
    share = ((wanted - middle[after - 1]) / (middle[after] - middle[after - 1]))[:, None]
    return (1 - share) * values[after - 1] + share * values[after]


def mapped(s: NDArray[np.float64], values: NDArray[np.float64],
           wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, k): `values` (N, k), constant on the elements of `s`, averaged over `wanted`'s."""
    total = np.vstack([np.zeros(values.shape[1]),
                       np.cumsum(values * np.diff(s)[:, None], axis=0)])
    at_nodes = np.column_stack([np.interp(wanted, s, column) for column in total.T]
                               or [np.zeros((wanted.size, 0))])
    return np.diff(at_nodes, axis=0) / np.diff(wanted)[:, None]
