# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the section of a rod consists of: `energy.elastic`, and springs of `energy.plastic`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.energy.elastic import Elastic, purely_elastic
from dlo_planner.energy.plastic import SHARED, Layers
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.fibers import fibers, layers
from dlo_planner.model.rod import Rod

_SAME = 1e-9  # of the stiffness: as near as two axes of one section are
_PROBES = 33  # nodes where a stiffness that varies is compared


class _Springs(NamedTuple):
    """Springs of a section, as of a Layers: direction (J, 3), limit (J,) 1/m, share (J,), kind."""

    direction: Floats
    limit: Floats
    share: Floats
    kind: Ints


def elastic_part(rod: Rod) -> Elastic:
    """Return the Elastic of a Rod."""
    if not rod.yields:
        return purely_elastic()
    return Elastic(np.full(3, float(rod.hardening)), np.zeros((0, 3)))


def yielding_layers(rod: Rod, stiffness: Floats) -> Layers:
    """Return the Layers of a Rod without a set; without springs if it does not yield.

    Parameters
    ----------
    rod : Rod
        The DLO.
    stiffness : ndarray, shape (N, 3)
        Stiffness of the elements, N m^2.
    """
    elements = len(stiffness)
    strength = np.column_stack([stiffness, np.zeros(elements)])
    springs: list[_Springs] = []
    ellipse, hardening = np.zeros(0), 0.0
    if rod.yields:
        hardening = rod.hardening
        springs.append(_torsion(rod))
        if rod.yield_curvature is None:
            springs += [_one(1), _one(2)]
        elif rod.section_model == 'ideal':
            ellipse = _thresholds(rod)
        else:
            springs += _bending(rod, strength)
    joined = _Springs(*map(np.concatenate, zip(_NONE, *springs, strict=True)))
    return Layers(*joined, (1 - hardening) * strength, ellipse,
                  np.zeros((elements, joined.limit.size + ellipse.size)))


def _thresholds(rod: Rod) -> Floats:
    """Return the curvatures (2,) in 1/m about n and b at which a Rod begins to yield."""
    return np.array(rod.yield_curvature, dtype=float)


def _bending(rod: Rod, strength: Floats) -> list[_Springs]:
    """Return the springs of bending; what fibers share goes over to the last column of `strength`.

    A homogeneous section has EI_n k_n^2 = EI_b k_b^2, k the thresholds. What one axis has beyond
    that goes to layers which only this axis bends, so that both have their stiffness and their
    curve.
    """
    outline, bore = rod.section_outline
    first, second = _thresholds(rod).tolist()
    ratio = (first / second) ** 2
    fits = _all_fit(rod, ratio)
    shared = strength[:, 1].copy()
    if not fits:
        shared = np.minimum(shared, strength[:, 2] / ratio)
    strength[:, 1] -= shared
    strength[:, 2] -= ratio * shared
    strength[:, SHARED] = shared
    together = _fibers(*fibers(outline, bore), first, second)
    if fits:
        return [together]
    alone = layers(outline, bore)
    return [_along(1, *alone, first), _along(2, *alone, second), together]


def _all_fit(rod: Rod, ratio: float) -> bool:
    """Whether the stiffness about both axes is that of one section, all along the rod."""
    probes = np.linspace(0, rod.length, _PROBES)
    _, first, second = rod.mean_stiffnesses(probes).T
    return bool((np.abs(second - ratio * first) <= _SAME * second).all())


def _torsion(rod: Rod) -> _Springs:
    if rod.yield_torsion is None:
        return _one(0)
    if rod.section_model == 'ideal':
        return _one(0, rod.yield_torsion)
    outline, bore = rod.section_outline
    return _along(0, *layers('rectangular' if outline == 'rectangular' else 'torsion', bore),
                  rod.yield_torsion)


def _one(axis: int, limit: float = np.inf) -> _Springs:
    """Return the spring of a whole section that one strain strains evenly."""
    return _along(axis, np.ones(1), np.ones(1), limit)


def _along(axis: int, heights: Floats, weights: Floats, threshold: float) -> _Springs:
    """Return springs that one of the three strains strains, in proportion to their heights."""
    size = heights.size
    return _Springs(np.tile(np.eye(3)[axis], (size, 1)), threshold / heights, weights * heights**2,
                    np.full(size, axis))


def _fibers(heights: Floats, weights: Floats, first: float, second: float) -> _Springs:
    """Return springs that both curvatures strain, in proportion to heights over thresholds."""
    strain = heights / (first, second)
    size = np.linalg.norm(strain, axis=1)
    direction = np.column_stack([np.zeros(size.size), strain / size[:, None]])
    return _Springs(direction, 1 / size, weights * (first * size) ** 2,
                    np.full(size.size, SHARED))


_NONE = _Springs(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))
