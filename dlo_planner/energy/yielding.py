# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the section of a rod consists of: `energy.elastic`, and springs of `energy.plastic`."""

import numpy as np

from dlo_planner.energy.elastic import Elastic, elastic_alone
from dlo_planner.energy.plastic import SHARED, Layers
from dlo_planner.model.fibers import fibers, layers

_SAME = 1e-9  # of the stiffness: as near as two axes of one section are
_PROBES = 33  # nodes where a stiffness that varies is compared


def elastic_part(rod):
    """Return the Elastic of a Rod."""
    if not rod.yields:
        return elastic_alone()
    return Elastic(np.full(3, float(rod.hardening)), np.zeros((0, 3)))


def yielding_layers(rod, stiffness):
    """Return the Layers of a Rod without a set; without springs if it does not yield.

    Args:
        stiffness: (N, 3) of the elements, N m^2
    """
    elements = len(stiffness)
    strength = np.column_stack([stiffness, np.zeros(elements)])
    springs, ellipse, hardening = [], np.zeros(0), 0.0
    if rod.yields:
        hardening = rod.hardening
        springs.append(_torsion(rod))
        if rod.yield_curvature is None:
            springs += [_one(1), _one(2)]
        elif rod.section_model == 'ideal':
            ellipse = np.array(rod.yield_curvature)
        else:
            springs += _bending(rod, strength)
    direction, limit, share, kind = map(np.concatenate, zip(_NONE, *springs, strict=True))
    return Layers(direction, limit, share, kind, (1 - hardening) * strength, ellipse,
                  np.zeros((elements, limit.size + ellipse.size)))


def _bending(rod, strength):
    """Return the springs of bending; what fibers share goes over to the last column of `strength`.

    A homogeneous section has EI_n k_n^2 = EI_b k_b^2, k the thresholds. What one axis has beyond
    that goes to layers which only this axis bends, so that both have their stiffness and their
    curve.
    """
    outline, bore = rod.section_outline
    first, second = rod.yield_curvature
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


def _all_fit(rod, ratio):
    """Whether the stiffness about both axes is that of one section, all along the rod."""
    probes = np.linspace(0, rod.length, _PROBES)
    _, first, second = rod.mean_stiffnesses(probes).T
    return bool((np.abs(second - ratio * first) <= _SAME * second).all())


def _torsion(rod):
    if rod.yield_torsion is None:
        return _one(0)
    if rod.section_model == 'ideal':
        return _one(0, rod.yield_torsion)
    outline, bore = rod.section_outline
    return _along(0, *layers('rectangular' if outline == 'rectangular' else 'torsion', bore),
                  rod.yield_torsion)


def _one(axis, limit=np.inf):
    """Return the spring of a whole section that one strain strains evenly."""
    return _along(axis, np.ones(1), np.ones(1), limit)


def _along(axis, heights, weights, threshold):
    """Return springs that one of the three strains strains, in proportion to their heights."""
    size = heights.size
    return (np.tile(np.eye(3)[axis], (size, 1)), threshold / heights, weights * heights**2,
            np.full(size, axis))


def _fibers(heights, weights, first, second):
    """Return springs that both curvatures strain, in proportion to heights over thresholds."""
    strain = heights / (first, second)
    size = np.linalg.norm(strain, axis=1)
    direction = np.column_stack([np.zeros(size.size), strain / size[:, None]])
    return direction, 1 / size, weights * (first * size) ** 2, np.full(size.size, SHARED)


_NONE = np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64)
