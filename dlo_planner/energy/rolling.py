# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The point of a DLO that is nearest to an obstacle: inside one element, or wherever it rolls to.

The curve and its tangent are continuous, so the nearest point passes from an element to the next
as the shape changes. A contact that stopped at a node would come free of the obstacle there, or be
pressed into it by the sag of the element beside.
"""

from __future__ import annotations

import numpy as np

from dlo_planner.energy.distance import signed_distance
from dlo_planner.energy.outline import gap_at, nodes_of, radius_at, slope_along, taper
from dlo_planner.energy.scene import AXIS, NODE_FACE
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats
from dlo_planner.ritz.kinematics import point_inside

_END = 1e-12    # of an element: nearer to its end a point is the end
_LEAST = 1e-15  # the same: a step that is no step any more


@kernel
def watched(scene, contacts, c, lengths, strains, rotations, positions, normal, hessian):
    """Return gap, element and fraction of a point of Contacts: it rolls, or is fixed where it is.

    Fills normal (3,) and hessian (3, 3) of the distance there.
    """
    o, e, fraction = contacts.obstacle[c], contacts.element[c], contacts.fraction[c]
    if fraction == 0.0:
        return rolled(scene, o, e, lengths, strains, rotations, positions, normal, hessian)
    gap = gap_inside(scene, o, e, fraction, lengths, strains, rotations, positions, normal, hessian)
    return gap, e, fraction


@kernel
def gap_inside(scene, o, e, fraction, lengths, strains, rotations, positions, normal, hessian):
    """Return the gap of a point of element e; fill normal (3,) and hessian (3, 3) of it."""
    rotation, x, offset, point = np.empty((3, 3)), np.empty(3), np.zeros(2), np.empty(3)
    point_inside(lengths, strains, rotations, positions, e, fraction, rotation, x)
    radius = radius_at(scene, o, e, fraction)
    return gap_at(scene, o, rotation, x, radius, offset, point, normal, hessian)


@kernel
def rolled(scene, o, e, lengths, strains, rotations, positions, normal, hessian):
    """Return gap, element and fraction of the point that is nearest to obstacle o, from element e.

    Where the distance still falls at an end of the element, it is followed into the next ones, to
    its first minimum. Fills normal (3,) and hessian (3, 3) of the distance there.
    """
    gap, fraction = nearest_inside(scene, o, e, lengths, strains, rotations, positions, normal,
                                   hessian)
    if scene.feature[o] == NODE_FACE or 0.0 < fraction < 1.0:
        return gap, e, fraction
    step = -1 if fraction == 0.0 else 1
    begin, end = nodes_of(scene, o, lengths.size)
    while begin <= e + step < end and fraction == max(step, 0):
        its_gap, its_fraction = nearest_inside(scene, o, e + step, lengths, strains, rotations,
                                               positions,
                                               normal, hessian)
        if its_fraction == max(-step, 0):  # it rises again: the minimum is the node between
            break
        e, gap, fraction = e + step, its_gap, its_fraction
    return gap, e, fraction


@kernel
def nearest_inside(scene, o, e, lengths, strains, rotations, positions, normal, hessian):
    """Return gap and fraction of the point of element e that is nearest to obstacle o.

    Fills normal (3,) and hessian (3, 3) of the distance there. A safeguarded Newton iteration for
    the zero of dg/ds; the nearest end of the element if there is none inside.
    """
    rotation, x = np.empty((3, 3)), np.empty(3)
    offset, point = np.zeros(2), np.empty(3)
    axial, grows = scene.feature[o] == AXIS, taper(scene, o, e) / lengths[e]
    low, high, fraction, last = 0.0, 1.0, 0.5, 1.0
    if scene.feature[o] == NODE_FACE:
        low = fraction = 1.0
    for iteration in range(60):
        point_inside(lengths, strains, rotations, positions, e, fraction, rotation, x)
        radius = radius_at(scene, o, e, fraction)
        if axial:
            for i in range(3):
                x[i] += scene.origin[i]
            gap = signed_distance(scene, o, x, normal, hessian) - radius
            slope, curve = along_the_dlo(normal, hessian, rotation, strains[e])
            slope -= grows
        else:
            gap = gap_at(scene, o, rotation, x, radius, offset, point, normal, hessian)
            slope, curve = slope_along(scene, o, rotation, strains[e], offset, normal, hessian)
        if slope > 0.0:
            high = fraction
        else:
            low = fraction
        if high - low < 1e-15:
            break
        step = -slope / (curve * lengths[e]) if curve > 0.0 else np.inf
        if abs(step) < _LEAST or 0.5 * last <= abs(step) < _END:
            break  # rounding errors alone are left; to halve the bracket would lead away from here
        target = fraction + step
        if iteration == 0 and curve > 0.0 and not 0.0 < target < 1.0:
            target = 0.0 if target <= 0.0 else 1.0  # look at the end itself
        elif not (low < target < high and abs(step) < 0.5 * last):
            # (where the curvature jumps, as at an obstacle's edge, Newton's steps go to and fro)
            target = 0.5 * (low + high)
        last = abs(target - fraction)
        fraction = target
    if fraction < _END or fraction > 1.0 - _END:
        fraction = 0.0 if fraction < _END else 1.0
    return gap, fraction


@kernel
def along_the_dlo(normal: Floats, hessian: Floats, rotation: Floats,
                  strain: Floats) -> tuple[float, float]:
    """Return dg/ds and d2g/ds2 of the gap along the DLO, where its frame is `rotation`."""
    slope = curve = 0.0
    for i in range(3):
        # t' = kappa_b n - kappa_n b
        change = strain[2] * rotation[i, 1] - strain[1] * rotation[i, 2]
        slope += normal[i] * rotation[i, 0]
        curve += normal[i] * change
        for j in range(3):
            curve += rotation[i, 0] * hessian[i, j] * rotation[j, 0]
    return slope, curve
