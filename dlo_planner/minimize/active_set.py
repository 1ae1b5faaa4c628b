# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The active set: which points inside elements may touch an obstacle.

It is chosen anew where forces and shape have been found, and in the first steps of `relaxation`.
Where a DLO lies along an obstacle the choice may alternate without an end. A set that only grows
comes to an end: the exchange method of semi-infinite programs (Hettich and Kortanek, SIAM Review
35, 1993), of which a contact is one, a condition at every point of the DLO.

Some elements bend just as the obstacle does that they bear on. As long as the obstacle's curvature
is less an element bears at one point, which rolls, and where it is more at both nodes. In a range
of loads between it is neither: the force spreads over the element, whose curvature is the
obstacle's. Both nodes and the middle carry it then.
"""

import numpy as np

from dlo_planner.energy.gap import (
    clear_between,
    closest_point,
    follow_closest_point,
    gap_at,
    gap_inside,
    is_face,
    longest_stretch,
    minima_in_element,
    next_touching,
    node_gap,
    node_range,
    sliding,
    slope_along,
    taper,
)
from dlo_planner.energy.scene import AXIS, FACE, MESH, NODE_FACE, is_convex
from dlo_planner.geometry.kinematics import point_inside
from dlo_planner.kernels import kernel
from dlo_planner.minimize.contact_table import with_contacts_of, with_springs

_SAG = 2e-6      # of the length: an element that comes no nearer than its nodes by more is flat
_MIDDLE, _BESIDE = 0.5, 0.01  # of an element
_EVEN, _LEAVES = 2.0, 40.0   # times the sag: how much a gap bends along an element
_SNUG = 0.3     # rad: an element whose slope against an obstacle changes by more has its own bend
_DEEP = 0.02    # of an element: a node that is deeper inside is on its way out
_LEVEL = 1e-12  # the same, by rounding errors alone
_NEXT = 0.2      # of an element: least share of its ends in a force
AT_NODE = 2e-3  # of an element: a point nearer to its end, or to another point, has come there
_NEARBY = 5     # elements: a DLO that bears within so many as well lies along the obstacle
_END = 5        # elements of a series, at its free end, that may be kept flat
_SHARP = 8.0    # times the sag: how much a gap bends along an element that is not flat


@kernel
def update_active_set(system, state):
    """Return the Contacts that watch the points inside elements which matter now.

    Points of friction are kept; multipliers go to the nearest new point on the same obstacle, from
    where the old one has rolled to, and from the nodes beside it. Also returned is whether there is
    a point where none was.
    """
    old = system.effects.contact.contacts
    at, places = rolled_to(system, state)
    inside, fixed = contact_candidates(system, state, places)
    count = inside.shape[0]
    multiplier = np.zeros(count)
    news = False
    taken = np.zeros(old.element.size, dtype=np.bool_)
    for c in range(count):
        best = _former(old, at, places, taken, inside[c, 0], inside[c, 1], fixed[c])
        if best >= 0:
            taken[best] = True
            multiplier[c] = old.multiplier[best]
        for b in range(old.element.size if fixed[c] <= 0.0 else 0):  # have they met?
            if (old.obstacle[b] == inside[c, 1] and not taken[b] and at[b] == inside[c, 0]
                    and old.fraction[b] <= 0.0
                    and (fixed[c] == 0.0 or abs(places[b] - at[b] + fixed[c]) < AT_NODE)):
                taken[b] = True
                multiplier[c] += old.multiplier[b]
        news = news or best < 0 or at[best] != inside[c, 0]
        if fixed[c] > 0.0:
            if best >= 0 and old.fraction[best] <= 0.0:
                multiplier[c] = _spread(old.node[inside[c, 1]], inside[c, 0],
                                        places[best] - inside[c, 0], multiplier[c])
        else:
            multiplier[c] += _taken_from_nodes(
                system, inside[c, 0], inside[c, 1], _follows(inside, c), _follows(inside, c + 1))
    for b in range(old.element.size):
        if old.obstacle[b] >= 0 and not taken[b]:
            _hand_over(system, state, b)
    rubs = old.obstacle < 0
    nothing = np.zeros((count, 3))
    return with_contacts_of(
        old, np.concatenate((inside[:, 0], old.element[rubs])),
        np.concatenate((inside[:, 1], old.obstacle[rubs])),
        np.concatenate((multiplier, old.multiplier[rubs])),
        np.concatenate((fixed, old.fraction[rubs])),
        np.concatenate((nothing, old.anchor[rubs])), np.concatenate((nothing, old.normal[rubs])),
        np.concatenate((nothing, old.shear[rubs]))), news


@kernel
def _former(old, at, places, taken, e, o, fixed):
    """Return which of the old points goes on as the one in element e on obstacle o, or -1.

    Of several that it may be one in the same element; beside a hole the nearest one.
    """
    best = -1
    for b in range(old.element.size):
        if (old.obstacle[b] == o and not taken[b] and abs(at[b] - e) <= 1
                and (best < 0 or fixed >= 0.0 and at[b] == e or fixed < 0.0
                     and abs(places[b] - e + fixed) < abs(places[best] - e + fixed))):
            best = b
    return best


@kernel
def _follows(inside, c):
    """Whether candidate c is in the same element and on the same obstacle as the one before."""
    return (0 < c < inside.shape[0] and inside[c - 1, 0] == inside[c, 0]
            and inside[c - 1, 1] == inside[c, 1])


@kernel
def free_to_roll(system, state, old):
    """Return the ContactSet `old` as a step begins in which points may roll far.

    Those that have rolled to the same element are one, and so are a point and the node that it has
    come to. The middle of an element that bends as the obstacle does, and that alone bears on it,
    is a point that rolls.
    """
    at, places = rolled_to(system, state)
    node, multiplier, fraction = old.node.copy(), old.multiplier.copy(), old.fraction.copy()
    kept, last = np.ones(at.size, dtype=np.bool_), system.lengths.size
    for c in range(at.size):
        o, e = old.obstacle[c], old.element[c]
        if o < 0:
            continue
        if fraction[c] > 0.0 and 0 < e < last - 1:
            alone = True
            for k in range(node.shape[1]):
                alone = alone and (node[o, k] <= 0.0 or k == e or k == e + 1)
            for b in range(at.size):
                alone = alone and (b == c or old.obstacle[b] != o)
            if alone:
                fraction[c] = 0.0
                multiplier[c] += max(node[o, e], 0.0) + max(node[o, e + 1], 0.0)
                node[o, e] = node[o, e + 1] = 0.0
        for b in range(c):
            if (kept[c] and kept[b] and fraction[c] <= 0.0 and fraction[b] <= 0.0
                    and old.obstacle[b] == o and at[b] == at[c]
                    and abs(places[b] - places[c]) < AT_NODE):
                kept[c] = False
                multiplier[b] += multiplier[c]
        k = at[c] + (places[c] - at[c] > 0.5)  # a node alone would not roll
        if (kept[c] and fraction[c] <= 0.0 and 0 < k < last and abs(places[c] - k) < AT_NODE
                and system.effects.contact.scene.feature[o] == AXIS):
            multiplier[c] += max(node[o, k], 0.0)
            node[o, k] = 0.0
    return with_contacts_of(with_springs(old, old.stiffness, node, multiplier), old.element[kept],
                            old.obstacle[kept], multiplier[kept], fraction[kept],
                            old.anchor[kept], old.normal[kept], old.shear[kept])


@kernel
def _taken_from_nodes(system, e, o, follows, leads):
    """Return the multipliers of both nodes of element e, N, which are zero from now on.

    They are farther from the obstacle than the point between them. As contacts of their own they
    would share its force in a way that nothing decides, where it is hardly beside one of them. Of
    two points in the element the first one has the first node, which the other one `follows`.
    """
    taken = 0.0
    if system.effects.contact.scene.feature[o] != NODE_FACE:
        node = system.effects.contact.contacts.node[o]
        for k in range(e + follows, e + 2 - leads):
            taken += node[k]
            node[k] = 0.0
    return taken


@kernel
def rolled_to(system, state):
    """Return the elements (C,) in which the Contacts' points are at `state`, and plus fractions."""
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    at, normal, hessian = contacts.element.copy(), np.empty(3), np.empty((3, 3))
    places = np.zeros(at.size)
    for c in range(at.size):
        if contacts.obstacle[c] >= 0:
            _, at[c], fraction = closest_point(scene, contacts, c, system.lengths, state.strains,
                                               state.rotations, state.positions, normal, hessian)
            places[c] = at[c] + fraction
    return at, places


@kernel
def _spread(node, e, fraction, force):
    """Spread the force of a point that has rolled over both nodes and the middle of element e."""
    x = min(max(fraction, _NEXT), 1.0 - _NEXT)
    node[e] += (1.0 - x) ** 2 * force
    node[e + 1] += x**2 * force
    return 2.0 * x * (1.0 - x) * force


@kernel
def contact_candidates(system, state, places):
    """Return (C, 2) element and obstacle where the DLO may touch inside an element, and fractions.

    A fraction (C,) is 0 where the point rolls, or less: it rolls from there.

    Where a DLO lies along an obstacle, with a row of nodes that bear, its nearly flat elements
    bear at their nodes. A contact by itself is a point that rolls along the DLO, flat or not:
    two nodes in its place would lock the direction of the DLO there.

    In between are elements that bend just as the obstacle does.
    """
    scene = system.effects.contact.scene
    n, pushed = system.lengths.size, system.effects.contact.contacts.node
    sag, level = _SAG * np.sum(system.lengths), _LEVEL * np.sum(system.lengths)
    longest, alone = np.max(system.lengths), system.basis.shape[1] == 0
    points = np.empty((2 * n * scene.kind.size, 2), dtype=np.int64)
    fixed, hugs = np.zeros(2 * n * scene.kind.size), np.zeros(n, dtype=np.bool_)
    lowest, where = np.empty(2), np.empty(2)
    count = 0
    x, normal, hessian = np.empty(3), np.empty(3), np.empty((3, 3))
    rotation, offset, point = np.empty((3, 3)), np.zeros(2), np.empty(3)
    nobody = np.zeros(n + 1)
    gaps, normals, offsets = np.empty(n + 1), np.empty((n + 1, 3)), np.empty((n + 1, 2))
    for o in range(scene.kind.size):
        gaps[:] = np.inf
        hugs[:] = False
        stretched = longest_stretch(scene, o, state.strains)
        begin, end = node_range(scene, o, n)
        k = begin
        while k <= end:
            gaps[k] = node_gap(scene, o, k, state.rotations, state.positions, offset, point,
                               normals[k], hessian)
            offsets[k] = offset
            k = next_touching(system.lengths, nobody, k, stretched * (gaps[k] - 2 * longest))
        for e in range(begin if alone else max(begin, n - _END), end):
            hugs[e] = _hugs_at(system, state, o, e, gaps, places)
        for e in range(begin, end):
            near = min(gaps[e], gaps[e + 1])
            if near > system.lengths[e]:
                continue
            if scene.feature[o] == NODE_FACE:
                if gaps[e + 1] < 0.5 * system.lengths[e] and _rounds(
                        scene, o, sag, state.rotations[e + 1], state.positions[e + 1]):
                    points[count, 0], points[count, 1] = e, o
                    count += 1
                continue
            if hugs[e]:
                points[count, 0], points[count, 1], fixed[count] = e, o, _MIDDLE
                count += 1
            if (hugs[e] or e > 0 and hugs[e - 1] and _presses(system, o, e, gaps)
                    or e + 1 < n and hugs[e + 1] and _presses(system, o, e + 1, gaps)):
                continue
            winding = not is_convex(scene, o)
            if scene.kind[o] == MESH and clear_between(
                    scene, o, e, gaps[e], gaps[e + 1], system.lengths, state.strains,
                    state.rotations, state.positions):
                continue
            grows = taper(scene, o, e) / system.lengths[e]
            if (not winding
                    and (gap_slope(state.rotations[e], state.strains[e], offsets[e],
                                normals[e]) >= grows
                         or gap_slope(state.rotations[e + 1], state.strains[e], offsets[e + 1],
                                   normals[e + 1]) <= grows)):
                continue  # a convex body is nearest at a node
            minima = minima_in_element(scene, o, e, system.lengths, state.strains, state.rotations,
                                       state.positions, lowest, where)
            for k in range(minima):
                gap, fraction = lowest[k], where[k]
                if gap >= 0.5 * system.lengths[e]:
                    continue
                point_inside(system.lengths, state.strains, state.rotations, state.positions, e,
                             fraction, rotation, x)
                gap_at(scene, o, rotation, x, 0.0, offset, point, normal, hessian)
                if scene.feature[o] == FACE and not _rounds(scene, o, sag, rotation, x):
                    continue
                _, curve = slope_along(scene, o, rotation, state.strains[e], offset, normal,
                                       hessian)
                sharp = curve * system.lengths[e] ** 2 > _SHARP * sag or gap < near - sag
                if sharp or gap < near - level and not _lies(pushed[o], gaps, e):
                    points[count, 0], points[count, 1] = e, o
                    fixed[count] = -fraction if winding else 0.0
                    count += 1
    return points[:count], fixed[:count]


@kernel
def _hand_over(system, state, c):
    """Move the force of a point that is not watched any more to the nodes beside it that bear.

    Or to the one that it has come to, if that is pressed in. That of the middle of an element which
    does not bend as the obstacle any more goes to the nodes beside the nearest point, wherever that
    is.
    """
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    o, e, fraction = contacts.obstacle[c], state.attached.element[c], state.attached.fraction[c]
    node, force, normal, hessian = (contacts.node[o], contacts.multiplier[c], np.empty(3),
                                    np.empty((3, 3)))
    spreads = contacts.fraction[c] > 0.0
    if spreads:
        _, e, fraction = follow_closest_point(scene, o, e, 0.0, system.lengths, state.strains,
                                              state.rotations, state.positions, normal, hessian)
    if node[e] > 0.0 and node[e + 1] > 0.0 or spreads and e > 0:
        node[e] += (1.0 - fraction) * force
        node[e + 1] += fraction * force
    elif not is_face(scene, o) and not AT_NODE < fraction < 1.0 - AT_NODE:
        k, offset, x = max(1, e + (fraction > 0.5)), np.zeros(2), np.empty(3)
        gap = node_gap(scene, o, k, state.rotations, state.positions, offset, x, normal, hessian)
        if gap < 0.0:
            node[k] += force


@kernel
def _lies(node, gaps, e):
    """Whether the DLO bears on an obstacle at both ends of element e, or near but not beside it."""
    if node[e] > 0.0 and node[e + 1] > 0.0:
        return True
    for k in range(max(1, e - _NEARBY), min(node.size, e + 2 + _NEARBY)):
        if (node[k] > 0.0 or gaps[k] < 0.0) and not e - 1 <= k <= e + 2:
            return True
    return False


@kernel
def gap_slope(rotation, strain, offset, normal):
    """Return the slope along the DLO of the distance of a point at an offset from the axis."""
    w0 = 1.0 + strain[1] * offset[1] - strain[2] * offset[0]
    w1, w2 = -strain[0] * offset[1], strain[0] * offset[0]
    slope = 0.0
    for i in range(3):
        slope += normal[i] * (rotation[i, 0] * w0 + rotation[i, 1] * w1 + rotation[i, 2] * w2)
    return slope


@kernel
def _rounds(scene, o, sag, rotation, position):
    """Whether an obstacle is nearest between the edges of a section, and sharply so."""
    offset, point, normal, hessian = np.zeros(2), np.empty(3), np.empty(3), np.empty((3, 3))
    moves, curves = np.empty((3, 3)), np.empty((3, 3))
    gap_at(scene, o, rotation, position, 0.0, offset, point, normal, hessian)
    if sliding(scene, o, False, rotation, normal, offset, normal, hessian, moves, curves) == 0:
        return False
    half = abs(scene.offset[o, 0 if abs(offset[0]) < scene.offset[o, 0] else 1])
    return curves[0, 0] * half**2 > 8 * sag


@kernel
def _hugs_at(system, state, o, e, gaps, places):
    """Return whether an element bends just as the obstacle does, and has to be kept to that.

    This begins where the point that rolls in it is not the nearest any more, or both nodes bear and
    what is between them is pressed in (not in a series, where elements wave); it ends where the
    middle does not bear, or an end does not while the element bends less than the obstacle.
    """
    scene, contacts = system.effects.contact.scene, system.effects.contact.contacts
    sag = _SAG * np.sum(system.lengths)
    if e == 0 or scene.feature[o] == NODE_FACE or np.isinf(gaps[e] + gaps[e + 1]):
        return False
    if min(gaps[e], gaps[e + 1]) < -_DEEP * system.lengths[e]:
        return False
    first, second = _presses(system, o, e, gaps), _presses(system, o, e + 1, gaps)
    old = -1
    for c in range(contacts.element.size):
        if (contacts.obstacle[c] == o and -_BESIDE <= places[c] - e <= 1.0 + _BESIDE
                and (old < 0 or contacts.multiplier[c] > contacts.multiplier[old])):
            old = c
    if old < 0 and not (first and second):
        return False
    normal, hessian = np.empty(3), np.empty((3, 3))
    middle = gap_inside(scene, o, e, _MIDDLE, system.lengths, state.strains,
                        state.rotations, state.positions, normal, hessian)
    curved = 4.0 * (gaps[e] - 2.0 * middle + gaps[e + 1])  # of the gap, times the length squared
    if abs(curved) > _SNUG * system.lengths[e]:
        return False
    if old < 0:
        return middle < -sag and system.basis.shape[1] == 0
    bears = contacts.multiplier[old] > contacts.stiffness * middle
    if contacts.fraction[old] <= 0.0 or not (first or second):
        return bears and curved < _EVEN * sag
    return bears and (first and second or curved <= _LEAVES * sag)


@kernel
def _presses(system, o, k, gaps):
    """Return whether a spring at node k _presses on obstacle o."""
    contacts = system.effects.contact.contacts
    return contacts.node[o, k] > contacts.stiffness * gaps[k]


@kernel
def enlarge_active_set(system, state):
    """Return Contacts with all points of the Problem's, and whether others have joined them.

    One joins that is deeper in an obstacle than flat elements may be. The middle of an element that
    bends as the obstacle does replaces a point that rolls in it, with its multiplier.
    """
    old = system.effects.contact.contacts
    at, places = rolled_to(system, state)
    inside, fixed = contact_candidates(system, state, places)
    kept = np.ones(old.element.size, dtype=np.bool_)
    joins, force = np.zeros(inside.shape[0], dtype=np.bool_), np.zeros(inside.shape[0])
    for p in range(inside.shape[0]):
        e, o = inside[p]
        joins[p] = (_candidate_gap(system, state, o, e, fixed[p]) < -_SAG * np.sum(system.lengths)
                    and not _is_known(old, at, places, e, o, fixed[p]))
        for c in range(old.element.size if joins[p] and fixed[p] > 0.0 else 0):
            if kept[c] and old.obstacle[c] == o and at[c] == e and old.fraction[c] <= 0.0:
                kept[c] = False
                force[p] += old.multiplier[c]
    none = np.zeros((np.sum(joins), 3))
    return with_contacts_of(
        old, np.concatenate((old.element[kept], inside[joins, 0])),
        np.concatenate((old.obstacle[kept], inside[joins, 1])),
        np.concatenate((old.multiplier[kept], force[joins])),
        np.concatenate((old.fraction[kept], fixed[joins])),
        np.concatenate((old.anchor[kept], none)), np.concatenate((old.normal[kept], none)),
        np.concatenate((old.shear[kept], none))), none.shape[0] > 0


@kernel
def _candidate_gap(system, state, o, e, fixed):
    """Return the gap in m of the middle of element e, if `fixed`, or of where it is nearest."""
    scene, normal, hessian = system.effects.contact.scene, np.empty(3), np.empty((3, 3))
    if fixed > 0.0:
        return gap_inside(scene, o, e, _MIDDLE, system.lengths, state.strains, state.rotations,
                          state.positions, normal, hessian)
    gap, _, _ = follow_closest_point(scene, o, e, -fixed, system.lengths, state.strains,
                                     state.rotations, state.positions, normal, hessian)
    return gap


@kernel
def _is_known(contacts, at, places, e, o, fixed):
    """Whether such a point on obstacle o is in element e by now; at, places: of `rolled_to`."""
    for c in range(at.size):
        if (contacts.obstacle[c] == o and at[c] == e
                and (contacts.fraction[c] > 0.0) == (fixed > 0.0)
                and (fixed >= 0.0 or abs(places[c] - e + fixed) < AT_NODE)):
            return True
    return False
