# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a shape may be off, and the discretization on which it is within an accuracy.

Whether an accuracy that was asked for is kept, `Shape.error_estimate` alone says (`judged`). Meshes
are chosen by less on the way there: `basis.truncation_error` bounds the error of most shapes
(`surely_within`), and its leading order tells which mesh will be fine enough (`foreseen`).

Beside `truncation_error` the estimate of random DLOs that hang freely, are held at both ends, or
touch something, was below what is taken as certain here. Of a DLO that has yielded it tells
nothing, nor of point loads, more than half a turn of natural twist, and what varies along the
length.

A permanent set is as exact as the mesh on which it was made, and stays there.
"""

from functools import partial
from math import ceil, sqrt
from typing import Any, NamedTuple

import numpy as np

from dlo_planner.direct.discretization import (
    Discretization,
    Memory,
    even_mesh,
    graded_mesh,
    nodes_at,
    with_breaks,
)
from dlo_planner.direct.equilibrium import AlongWay, corrected_by, equilibrium, estimated, past_of
from dlo_planner.direct.shape import LYING, Shape
from dlo_planner.energy.potential import evaluate, unknowns_of
from dlo_planner.energy.problem import Configuration, Problem, new_configuration, with_gripper
from dlo_planner.geometry.basis import equidistribute, truncation_error
from dlo_planner.geometry.so3 import (
    applied,
    cross,
    jacobians,
    matrix,
    plus,
    transposed_applied,
    vector,
)
from dlo_planner.kernels import kernel
from dlo_planner.minimize.hessian import Hessian, assemble, factorize, new_hessian, solve
from dlo_planner.model.arrays import Bools, Floats
from dlo_planner.model.holds import places_of
from dlo_planner.model.supports import Surroundings
from dlo_planner.model.value import Constant, changed, freeze, same

_FIRST_ELEMENTS, _MOST_ELEMENTS = 48, 8192
_MANY = 512  # elements: a DLO whose error is not known with so many is given up
_FIRST_TERMS, _MOST_TERMS = 12, 48
_PER_BEND = 2.5  # elements on (EI / weight per length)^(1/3), over which a soft DLO bends
_FORESEEN = 2e-3  # the same, of what is expected on a finer mesh
_TURNED = 0.1  # rad: it is another equilibrium
_FALLS = 0.3   # rad: a DLO of halved elements that turns so far on its way falls
_DEFAULT = 1e-3  # of the length
_SOFT = 27.0      # F L^2 / EI: a DLO that is softer hangs down near the gripper
_LEAST = 0.15     # of that: one that is held at both ends is not as narrow as it is soft
_ENOUGH, _MARGIN = 0.75, 0.5  # parts of the accuracy: what is good, and what is aimed at
_AIM = 0.6         # the same, where the error is foreseen
_CLEARLY, _RUBBED = 0.7, 0.35  # the same, of one step on a finer mesh; with friction
_FINER = 1.2       # times as many elements at least
_AGREE = 1.25      # times: two meshes that agree so well on the error of a shape have it right
_FARTHEST = 20     # and at most: so far one shape tells what another mesh will do
_FREE, _HELD, _TOUCHING, _LYING = 4.0, 1.5, 2.5, 1.5  # times `truncation_error`: less
_POINTS = 6      # nodes of a polynomial through an integral
_STABLE = 0.1    # a shape that is less stable magnifies errors
_BEARS = 5e-4    # of the length: below, where it bears on an obstacle may be off by more than bends


def made_with_a_set(shape: Shape) -> bool:
    """Return whether a DLO was bent for good before the step that made a Shape."""
    return shape.state.before is not None and shape.state.before.has_set


def fine_enough(shape: Shape, accuracy: float) -> bool:
    """Return whether the mesh of a Shape is fine enough for an accuracy, m."""
    if surely_within(shape, accuracy):
        return True
    if shape.contacts and _tells(shape, accuracy):
        return _clearly_within(shape, accuracy)
    return not _mode_is_missed(shape, accuracy) and (
        _clearly_within(shape, accuracy) or (
            _error_nearby(shape) if shape.contacts else shape.error_estimate) <= _ENOUGH * accuracy)


def bears_otherwise(shape: Shape, accuracy: float) -> bool:
    """Return whether a DLO of halved elements bears elsewhere, more than `accuracy` away."""
    return bool(shape.contacts) and _error_nearby(shape) > accuracy


def judged(shape: Shape, accuracy: float) -> Shape:
    """Return a Shape as it is if its error is at most `accuracy` (m), else not `converged`.

    How far elsewhere it may have landed in a fall is not asked: no mesh could promise that.
    """
    estimate, landed = shape.state.estimate, shape
    if isinstance(estimate, AlongWay) and estimate.falls:
        landed = changed(shape, state=changed(shape.state, estimate=estimate.where_it_lies))
    if not shape.converged or landed.error_estimate <= accuracy:
        return shape
    missed = landed.error_estimate, accuracy
    return changed(shape, converged=False, state=changed(shape.state, missed=missed))


def _error_nearby(shape: Shape) -> float:
    """Return the `Shape.error_estimate`, but infinity where a DLO of halved elements falls.

    How far elsewhere it lands, which takes ten times as long, does not tell which mesh is fine
    enough.
    """
    estimate = shape.state.estimate
    if not (isinstance(estimate, partial) and estimate.func is estimated):
        return shape.error_estimate
    near = partial(estimate, most=_FALLS)
    return changed(shape, state=changed(shape.state, estimate=near)).error_estimate


def _clearly_within(shape: Shape, accuracy: float) -> bool:
    """Whether a mesh is fine enough for a DLO in contact, by one step on one that is finer.

    That takes all contacts as they are. Another set of them, or what friction did on the way, may
    be further off: that is no matter of the mesh, and `judged` looks at it.
    """
    if not shape.contacts:
        return False
    mesh = shape.state.made_on
    rubbed = any(contact.friction.any() for contact in shape.contacts)
    part = _RUBBED if rubbed else _CLEARLY
    return corrected_by(mesh, shape, past_of(mesh, shape, None)) <= part * accuracy


def _mode_is_missed(shape: Shape, accuracy: float) -> bool:
    """Whether a local mesh shows that a Shape, which its series makes stable, falls aside."""
    mesh = shape.state.made_on
    if not mode_may_be_missed(shape) or mesh.yields and not shape.state.culled:
        return False  # what has yielded would yield again
    there = _freed(shape)
    moved = np.linalg.norm(there.positions - shape.positions, axis=1).max()
    turned = np.abs(there.frames - shape.frames).max()  # a straight DLO may have shed a turn
    return not there.converged or moved > accuracy or turned > _TURNED


def _freed(shape: Shape) -> Shape:
    """Return the equilibrium beside a Shape on its mesh without the series."""
    return equilibrium(shape.state.made_on.local, shape.gripper, shape.element_strains,
                       shape.state.history, shape.holds, culled=shape.state.culled)


def fine_enough_to_bend(mesh: Discretization, fine: str) -> Discretization:
    """Return a Discretization whose elements can bend round obstacles under the DLO's weight."""
    weight = np.linalg.norm(mesh.load)
    length, around = mesh.s[-1], mesh.surroundings
    if weight == 0.0:
        return mesh
    bent = (min(around.rod.stiffness[1:]) * length / weight) ** (1 / 3)
    wanted = min(int(np.ceil(_PER_BEND * length / bent)), _MANY)
    if wanted < mesh.s.size:
        return mesh
    return Discretization(around, even_mesh(length, wanted, around.breaks), fine, _FIRST_TERMS)


def default_accuracy(mesh: Discretization) -> float:
    """Return the accuracy (m) of a DLO of which none is named.

    A soft one hangs down within a part of its length, of the size (EI L / F)^(1/3) by its loads F.
    Errors are by the square of elements as long as that part is: so is the accuracy. Among
    obstacles, which decide where it is bent, it is that of any other.
    """
    if mesh.surroundings.obstacles:
        return _DEFAULT * float(mesh.s[-1])
    system, length = mesh.free, mesh.s[-1]
    force = float(np.sum(np.linalg.norm(system.load.pull, axis=1)))
    softness = force * length**2 / np.min(system.stiffness[:, 1:])
    part = (_SOFT / max(softness, _SOFT)) ** (2 / 3)
    return _DEFAULT * float(length * max(part, _LEAST))


def first_mesh(surroundings: Surroundings, basis: str) -> Discretization:
    """Return the Discretization with which the search for an accuracy begins."""
    s = even_mesh(surroundings.rod.length, _FIRST_ELEMENTS, surroundings.breaks)
    return Discretization(surroundings, s, basis, _FIRST_TERMS)


def mesh_to_begin_with(first: Discretization, fine: str, accuracy: float | None,
                       initial: Shape | None, memory: Memory | None) -> Discretization:
    """Return the Discretization to begin with: in these surroundings, on the mesh of `initial`.

    A permanent set stays on its mesh.
    """
    if accuracy is None:
        return first
    around, known = first.surroundings, None if initial is None else initial.state.mesh
    if memory is not None and (known is None or not same(known.rod, around.rod)):
        initial = known = None  # the set is the simulator's
    if initial is not None and known is not None and surely_within(initial, accuracy, first):
        return first
    past = memory if initial is None else initial.state.history
    s = initial.s if initial is not None else None if memory is None else memory.s
    if (past is not None and past.has_set
            and (known is None or known.basis not in (first.basis, fine))):
        return Discretization(around, with_breaks(past.s, around.breaks), fine, first.n_terms)
    if s is None or known is not None and known.basis not in (first.basis, fine):
        return first
    if known is None:  # of a shape from a file, or a set
        if fine != 'local' or s.size < first.s.size or np.array_equal(s, first.s):
            return first
        return Discretization(around, with_breaks(s, around.breaks), fine, 0)
    if same(known.surroundings, around):
        return known
    s = with_breaks(np.append(s[:-1], around.rod.length), around.breaks)
    return Discretization(around, s, known.basis, known.n_terms)


def refined(mesh: Discretization, fine: str, shape: Shape,
             accuracy: float) -> Discretization | None:
    """Return a finer Discretization, or None at the limits."""
    around, s = mesh.surroundings, mesh.s
    elements, terms = len(shape.element_strains), mesh.n_terms
    bent = shape.element_strains - mesh.natural
    if mesh.basis != fine:
        s = graded_mesh(s, bent, elements, around.breaks)
        return Discretization(around, s, fine, _FIRST_TERMS)
    tells = _tells(shape, accuracy)
    from_mesh = _bound(shape, mesh) if tells else _error_nearby(shape)
    if elements >= _MANY and not np.isfinite(from_mesh):
        return None
    if fine != 'local':
        from_mesh = _freed(shape).error_estimate
        if shape.error_estimate > 1.5 * from_mesh or from_mesh < 0.3 * _MARGIN * accuracy:
            terms = min(terms + max(2, terms // 4), _MOST_TERMS)
    if from_mesh > 0.8 * _MARGIN * accuracy:
        aim = _ENOUGH if tells else 0.5 * _MARGIN
        growth = np.clip(np.sqrt(from_mesh / (aim * accuracy)), 1.2, 2.5)
        wanted = min(int(np.ceil(growth * elements)), _MOST_ELEMENTS)
        if not made_with_a_set(shape):
            s = graded_mesh(s, bent, wanted, around.breaks)
    if terms == mesh.n_terms and s.size == mesh.s.size:
        return None
    return Discretization(around, s, fine, terms)


def surely_within(shape: Shape, accuracy: float, mesh: Discretization | None = None) -> bool:
    """Return whether a Shape is certain to be within `accuracy` (m), without a further solution."""
    here = shape.state.made_on if mesh is None else mesh
    if (shape.dissipated or not here.bounded_by_truncation
            or shape.contacts and accuracy < _BEARS * shape.s[-1]
            or shape.holds and places_of(shape.holds)
            or shape.stability < _STABLE and (not shape.holds or here.basis != 'local')
            and not _rubs(shape)):
        return False
    return _bound(shape, here) <= accuracy


def _bound(shape: Shape, mesh: Discretization) -> float:
    """Return what the error of a Shape on a mesh is certain to be within, m, by its strains."""
    strains, system = shape.element_strains, mesh.free
    if not mesh.has_nodes(shape.s):
        freeze(strains := mesh.strains_from(shape.s, strains))  # as those of a Shape are
    times = (_LYING if _rubs(shape) else _TOUCHING if shape.contacts else
             _HELD if shape.holds else _FREE)
    return float(times * truncation_error(system.lengths, strains, system.natural, system.scale,
                                          system.basis))


def _rubs(shape: Shape) -> bool:
    """Whether a DLO lies on something and rubs on it, which holds it where it is.

    Its stability magnifies no error then: of 1624 shapes of ordinary scenes, on 48 to 90 elements,
    the estimate was below half of `truncation_error` for 88 %, and below all of it for 97 %. Else
    halved elements led to another shape: where friction lets go, a step leads to one or another, on
    any mesh.
    """
    return (len(shape.contacts) >= LYING and not shape.holds and not shape.dissipated
            and all(one.friction.any() for one in shape.contacts))


def _tells(shape: Shape, accuracy: float) -> bool:
    """Whether `_bound` tells which mesh is fine enough for a DLO that rubs, for an accuracy, m."""
    return (_rubs(shape) and shape.state.made_on.bounded_by_truncation
            and accuracy >= _BEARS * shape.s[-1])


def hanging_surely_within(bounded: bool | Bools, stability: np.ndarray, truncated: np.ndarray,
                          accuracy: float | Floats) -> Bools:
    """Return (n,) what `surely_within` says of DLOs that hang freely; stability, truncated (n,)."""
    return (stability >= _STABLE) & (_FREE * truncated <= accuracy) & bounded


def mode_may_be_missed(shape: Shape) -> bool:
    """Return whether a Shape may be unstable in a way that its series cannot show.

    A series that is short may well follow the shape and still not the mode in which it falls: ten
    Chebyshev terms make a straight rod under tension T L^2 = 50 EI bear 1 % too much torsion.
    """
    return bool(shape.state.made_on.basis != 'local' and shape.stability < _STABLE)


class Foreseen(NamedTuple):
    """A mesh that is expected to be fine enough, and what is expected there."""

    mesh: Discretization
    strains: Floats  # (N, 3), 1/m
    error: float     # m


def foreseen(shape: Shape, accuracy: float, least: float = 0.0) -> Foreseen | None:
    """Return the mesh on which a Shape will be within an `accuracy` (m), and its strains there.

    None where its error does not come from arcs and loads alone, it is off by `least` accuracies or
    less, or no mesh is fine enough.
    """
    known, elements = shape.state.made_on, shape.element_strains.shape[0]
    around = known.surroundings
    if (not shape.state.culled or shape.holds or known.basis != 'local'
            or known.rod.varies or callable(around.load) or not 2 < elements < _MOST_ELEMENTS):
        return None
    own, off, shares, one, there = discretization_errors(
        known.free, shape.gripper.rotation, shape.element_strains, _spread_load(known))
    if not least * accuracy < own <= _FORESEEN * shape.s[-1]:
        return None
    most = min(_FARTHEST * elements, _MOST_ELEMENTS)
    wanted = min(max(ceil(sqrt(one / (_AIM * accuracy))), ceil(_FINER * elements)), most)
    breaks = around.breaks
    points = [s for s, _ in known.rod.point_masses]
    points += around.load_places
    if points:
        breaks = np.union1d(breaks, points)
        breaks = breaks[(breaks > 0) & (breaks < known.s[-1])]
    s = nodes_at(known.s, shares, wanted, breaks)
    strains = resampled_means(known.s, shape.element_strains - off + there / wanted**2, s)
    return Foreseen(Discretization(around, s, 'local', 0), strains, one / wanted**2)


def _spread_load(mesh: Discretization) -> Floats:
    """Return the derivative by the positions, (3,) N/m, of loads that are spread out evenly."""
    mass: Any = mesh.rod.mass_per_length
    load: Any = mesh.surroundings.load
    spread: Floats = -mass * mesh.surroundings.gravity - (0.0 if load is None else load)
    return spread


def with_error_confirmed(shape: Shape, expected: float) -> Shape:
    """Return a Shape with its error to leading order, if that is the `expected` one, m.

    Two meshes that differ and agree on it have it right; else halved elements will tell, which
    takes twice as long as the shape.
    """
    mesh, state = shape.state.made_on, shape.state
    if not state.culled:  # something acts after all
        return shape
    error = discretization_error(mesh.free, shape.gripper.rotation, shape.element_strains,
                                 _spread_load(mesh))
    if not expected / _AGREE <= error <= expected * _AGREE:
        return shape
    return changed(shape, state=changed(state, estimate=Constant(error)))


# ------------------------------------------------------------------------------------------------
# The error of elements of constant strain, to leading order, from what they leave out.
#
# A true strain changes along an element, u(s) = u + u' s from its middle on. To leading order in
# its length h, beside the arc of its mean strain u,
#
# * its end is turned by h^3 / 12  u x u'  more (Magnus: Iserles and Norsett 1999, body frame),
# * and shifted by  - h^3 / 12  u' x t  (the arc's error is the opposite),
# * and a load q per length, which stands on the nodes, bends it by the moment h^2 / 12  t x q too
#   much, on average over the element.
#
# These are put into the equilibrium as if they were given: what the mean strains, frames and
# positions change by is their error. It is one solution with the Hessian that proves the shape.
# On another mesh the same is left out, with its own h: errors there are known before it is made.


@kernel
def discretization_errors(system: Problem, base: Floats, strains: Floats,
                          spread: Floats) -> tuple[float, Floats, Floats, float, Floats]:
    """Return the error of a DLO that hangs freely, and what it is on a mesh graded to its bend.

    Args:
        system: Problem of a local mesh; its `base` is not used
        base: (3, 3), read-only, rotation of the gripper
        strains: (N, 3), read-only, of its equilibrium, 1/m
        spread: (3,) derivative by the positions of the loads that are spread out, N/m
    """
    turned, state, hessian, stable = _linearized(system, base, strains)
    off, there = np.zeros_like(state.q), np.zeros_like(state.q)
    shares = equidistribute(system.lengths, strains.copy())
    if not stable:
        return np.inf, off, shares, np.inf, there
    wanted = np.empty_like(system.lengths)
    for e in range(wanted.size):
        wanted[e] = system.lengths[e] / (shares[e + 1] - shares[e])
    own = _error(turned, state, hessian, spread, system.lengths, off)
    return own, off, shares, _error(turned, state, hessian, spread, wanted, there), there


@kernel
def discretization_error(system: Problem, base: Floats, strains: Floats, spread: Floats) -> float:
    """Return the error of a DLO that hangs freely, m; arguments as of `discretization_errors`."""
    turned, state, hessian, stable = _linearized(system, base, strains)
    if not stable:
        return np.inf
    return _error(turned, state, hessian, spread, system.lengths, np.zeros_like(state.q))


@kernel
def _linearized(system: Problem, base: Floats, strains: Floats) -> Any:
    """Return what is in a gripper, its Configuration, factorized Hessian, and whether stable."""
    turned = with_gripper(system, base.copy(), np.zeros(3))
    state, hessian = new_configuration(turned), new_hessian(turned)
    unknowns_of(turned, strains.copy(), state.q)
    evaluate(turned, state)
    assemble(turned, state, hessian)
    return turned, state, hessian, factorize(turned, hessian, 0.0) <= 0


@kernel
def _error(system: Problem, state: Configuration, hessian: Hessian, spread: Floats, wanted: Floats,
           off: Floats) -> float:
    """Return the error where elements are of lengths `wanted` (N,), fill that of strains (N, 3)."""
    left, shifts, right = np.empty_like(state.q), np.empty_like(state.q), np.empty_like(state.q)
    _left_out(system, state, spread, wanted, left, shifts, right)
    solve(system, hessian, right, off)
    return _moved(system, state, hessian.twist_jacobian, left, shifts, off)


@kernel
def resampled_means(s: Floats, values: Floats, nodes: Floats) -> Floats:
    """Return the means (n, 3) over the elements of a finer mesh of a smooth function.

    By polynomials through its integral at six nodes around each new one, in Lagrange's form.

    Args:
        s: (N + 1,) m; values: (N, 3) means over its elements
        nodes: (n + 1,) m, on the same length
    """
    means, total, before = np.empty((nodes.size - 1, 3)), np.zeros((s.size, 3)), np.zeros(3)
    for e in range(values.shape[0]):
        for i in range(3):
            total[e + 1, i] = total[e, i] + (s[e + 1] - s[e]) * values[e, i]
    count = min(_POINTS, s.size)
    scale, ahead = np.empty(count), np.empty(count + 1)
    first, right = -1, 1
    for k in range(1, nodes.size):
        while right < s.size - 1 and s[right] < nodes[k]:
            right += 1
        begin = min(max(right - count // 2, 0), s.size - count)
        if begin != first:
            first = begin
            for j in range(count):  # of each node the product of its distances to the others
                scale[j] = 1.0
                for other in range(count):
                    if other != j:
                        scale[j] *= s[first + j] - s[first + other]
        ahead[count] = 1.0
        for j in range(count - 1, -1, -1):
            ahead[j] = ahead[j + 1] * (nodes[k] - s[first + j])
        x = y = z = 0.0
        passed, width = 1.0, nodes[k] - nodes[k - 1]
        for j in range(count):
            weight, row = passed * ahead[j + 1] / scale[j], total[first + j]
            x, y, z = x + weight * row[0], y + weight * row[1], z + weight * row[2]
            passed *= nodes[k] - s[first + j]
        means[k - 1, 0] = (x - before[0]) / width
        means[k - 1, 1] = (y - before[1]) / width
        means[k - 1, 2] = (z - before[2]) / width
        before[0], before[1], before[2] = x, y, z
    return means


@kernel
def _left_out(system: Problem, state: Configuration, spread: Floats, wanted: Floats, left: Floats,
              shifts: Floats, right: Floats) -> None:
    """Fill what elements leave out, and the slope of the potential that it makes."""
    n, natural, strains = system.lengths.size, system.natural, state.strains
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(n):
        e = n - 1 - k
        h, scale = system.lengths[e], system.scale[e]
        force = plus(force, vector(state.pull[e + 1]))
        share = h * wanted[e] ** 2 / 12.0
        rate = _rate(system.lengths, strains, natural, e)
        turn = cross(vector(strains[e]), rate)
        begin, end = matrix(state.rotations[e]), matrix(state.rotations[e + 1])
        aside = cross(rate, (1.0, 0.0, 0.0))
        one, other = applied(begin, aside), applied(end, aside)
        shift = (-0.5 * share * (one[0] + other[0]), -0.5 * share * (one[1] + other[1]),
                 -0.5 * share * (one[2] + other[2]))
        tangent = (state.positions[e + 1, 0] - state.positions[e, 0],
                   state.positions[e + 1, 1] - state.positions[e, 1],
                   state.positions[e + 1, 2] - state.positions[e, 2])
        couple, lumped = cross(shift, force), cross(tangent, vector(spread))
        beside = cross(vector(strains[e]), (1.0, 0.0, 0.0))
        one, other = applied(begin, beside), applied(end, beside)
        aside = cross((one[0] + other[0], one[1] + other[1], one[2] + other[2]), vector(spread))
        couple = (couple[0] - 0.5 * share * aside[0], couple[1] - 0.5 * share * aside[1],
                  couple[2] - 0.5 * share * aside[2])
        stress = (system.stiffness[e, 0] * (strains[e, 0] - natural[e, 0]),
                  system.stiffness[e, 1] * (strains[e, 1] - natural[e, 1]),
                  system.stiffness[e, 2] * (strains[e, 2] - natural[e, 2]))
        within = cross(rate, stress)
        bent = (share * lumped[0] / h - h * (moment[0] + 0.5 * couple[0]),
                share * lumped[1] / h - h * (moment[1] + 0.5 * couple[1]),
                share * lumped[2] / h - h * (moment[2] + 0.5 * couple[2]))
        first, last = transposed_applied(begin, bent), transposed_applied(end, bent)
        moment = plus(moment, couple)
        for i in range(3):
            left[e, i] = -share * turn[i] / (h * scale[i])
            shifts[e, i] = shift[i]
            right[e, i] = left[e, i] - scale[i] * (0.5 * (first[i] + last[i]) + share * within[i])


@kernel
def _rate(lengths: Floats, strains: Floats, natural: Floats, e: int) -> Any:
    """Return (3 numbers) the rate at which the strain changes in the middle of element e, 1/m^2."""
    n = lengths.size
    if n < 3:
        return 0.0, 0.0, 0.0
    c = min(max(e, 1), n - 2)
    before, after = 0.5 * (lengths[c - 1] + lengths[c]), 0.5 * (lengths[c] + lengths[c + 1])
    # the slope of a parabola through three elements, at the middle of this one
    place = -before if e < c else after if e > c else 0.0
    one = (2.0 * place - after) / (before * (before + after))
    three = (2.0 * place + before) / (after * (before + after))
    a, b, d = strains[c - 1], strains[c], strains[c + 1]
    u, v, w = natural[c - 1], natural[c], natural[c + 1]
    return (one * (a[0] - u[0] - b[0] + v[0]) + three * (d[0] - w[0] - b[0] + v[0]),
            one * (a[1] - u[1] - b[1] + v[1]) + three * (d[1] - w[1] - b[1] + v[1]),
            one * (a[2] - u[2] - b[2] + v[2]) + three * (d[2] - w[2] - b[2] + v[2]))


@kernel
def _moved(system: Problem, state: Configuration, turning: Floats, left: Floats, shifts: Floats,
           off: Floats) -> float:
    """Return the largest displacement of a node; make `off` (N, 3) the errors of the strains."""
    place, theta, largest = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    for e in range(system.lengths.size):
        h, u, scale = system.lengths[e], state.strains[e], system.scale[e]
        turn = applied(matrix(turning[e]), vector(off[e]))
        for i in range(3):
            off[e, i] = scale[i] * (off[e, i] - left[e, i])
        _, chord = jacobians(h * u[0], h * u[1], h * u[2], h)
        along = applied(chord, (h * off[e, 0], h * off[e, 1], h * off[e, 2]))
        arm = (state.positions[e + 1, 0] - state.positions[e, 0],
               state.positions[e + 1, 1] - state.positions[e, 1],
               state.positions[e + 1, 2] - state.positions[e, 2])
        place = plus(plus(place, cross(theta, arm)), applied(matrix(state.rotations[e]), along))
        place = (place[0] - shifts[e, 0], place[1] - shifts[e, 1], place[2] - shifts[e, 2])
        theta = plus(theta, turn)
        largest = max(largest, place[0] ** 2 + place[1] ** 2 + place[2] ** 2)
    return float(np.sqrt(largest))
