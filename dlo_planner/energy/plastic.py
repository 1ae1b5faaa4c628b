# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Plastic bending and torsion: springs that yield, and those of the section of a rod."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dlo_planner.energy.elastic import Elastic, purely_elastic
from dlo_planner.geometry.record import Record
from dlo_planner.kernels import kernel
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.rod import Rod
from dlo_planner.model.section import fibers, layers

# ------------------------------------------------------------------------------------------------
# Plastic bending and torsion, sections 3.2.1, 3.2.2: springs that yield, side by side.
#
# A section is a bundle of springs that share its stiffness: fibers, which bending stretches in
# proportion to their heights over the neutral axis, and layers, which torsion shears. Each is
# elastic and ideally plastic with its own threshold (Besseling 1958, Iwan 1967). The paper's model
# is one spring for torsion and, for curvature as a vector, an ellipse of thresholds that all of
# the section leaves at once; it flows so that the energy used up is least. What never yields
# (hardening) is `energy.elastic`'s.
#
# With the strains of this step u and the set of the steps before p (Eq. of 3.2.2, D_new = u - p),
# W(u) is the energy stored plus the energy newly lost: its minimum is the step's solution, and its
# derivative the moment.


SHARED = 3  # kind of springs that both curvatures strain; 0, 1, 2: one of the strains does


class PlasticSection(Record):
    """How a section yields; J springs, none for an elastic DLO."""

    # (J, 3) unit vector: strain of the spring by torsion and curvatures. A spring is strained by
    # torsion or by curvatures
    direction: Floats
    limit: Floats  # (J,) strain at which it yields, 1/m
    share: Floats  # (J,) its part of the stiffness of its kind
    kind: Ints  # (J,) 0 torsion, 1 curvature about n, 2 about b, SHARED both
    strength: Floats  # (N, 4) stiffness of each kind, N m^2
    # (2,) curvatures about n and b at which what is not firm yields, if no spring bears bending,
    # 1/m; else (0,)
    ellipse: Floats
    # (N, J) plastic strain of each spring in each element, 1/m; with an ellipse (N, J + 2), the
    # plastic curvature last
    set: Floats


@kernel
def yields(effect):
    """Whether a DLO with this PlasticSection, or None, yields anywhere."""
    if effect is None:
        return False
    return effect.share.size > 0


def hinged(effect: PlasticSection, part: float) -> PlasticSection:
    """Return the same with one more element before the first, of a `part` of that one's strength.

    It is set to nothing.
    """
    strength = np.concatenate([part * effect.strength[:1], effect.strength])
    return effect._replace(strength=strength,
                           set=np.concatenate([0.0 * effect.set[:1], effect.set]))


@kernel
def closest_point_projection(d1, d2, k1, k2, l1, l2):
    """Return the curvature (e1, e2) that stays elastic of (d1, d2), and the flow's multiplier.

    The elastic region is the ellipse (e1 / l1)^2 + (e2 / l2)^2 <= 1; the plastic rest is normal to
    it in the moments, which leaves e_i = d_i / (1 + g / (k_i l_i^2)) with one unknown g >= 0.
    """
    a, b = d1 / l1, d2 / l2
    size = np.sqrt(a * a + b * b)
    if size <= 1.0:
        return d1, d2, 0.0
    b1, b2 = k1 * l1 * l1, k2 * l2 * l2
    g = 0.0
    for _ in range(50):
        c1, c2 = 1.0 / (1.0 + g / b1), 1.0 / (1.0 + g / b2)
        x, y = a * c1, b * c2
        size = np.sqrt(x * x + y * y)
        # Newton on 1 / size = 1, which is nearly linear in g (and is, where b1 = b2)
        slope = (x * x * c1 / b1 + y * y * c2 / b2) / size**3
        change = (1.0 - 1.0 / size) / slope
        g += change
        if abs(change) <= 1e-15 * (min(b1, b2) + g):
            break
    c1, c2 = 1.0 / (1.0 + g / b1), 1.0 / (1.0 + g / b2)
    return d1 * c1, d2 * c2, g


@kernel
def _within(strain, limit):
    """Return what of a spring's strain stays elastic."""
    if strain > limit:
        return limit
    if strain < -limit:
        return -limit
    return strain


@kernel
def add_forces(effect, system, state):
    """Add dW/du to `state.slope`; return W, stored and newly lost, in J, twice."""
    if effect is None:
        return 0.0, 0.0
    energy = 0.0
    if effect.share.shape[0]:
        energy = add_plastic(system.lengths, state.strains, system.natural, effect, state.slope)
    return energy, energy


@kernel
def may_act(effect, system, strains, positions, before):
    """Whether any spring yields at strains (N, 3), 1/m, of a DLO that is set to nothing."""
    if effect is None:
        return False
    natural, direction, limit, ellipse = (system.natural, effect.direction, effect.limit,
                                          effect.ellipse)
    for e in range(strains.shape[0]):
        d0, d1, d2 = (strains[e, 0] - natural[e, 0], strains[e, 1] - natural[e, 1],
                      strains[e, 2] - natural[e, 2])
        for j in range(limit.size):
            if not abs(direction[j, 0] * d0 + direction[j, 1] * d1
                       + direction[j, 2] * d2) < limit[j]:
                return True
        if ellipse.size > 0 and not (d1 / ellipse[0]) ** 2 + (d2 / ellipse[1]) ** 2 < 1.0:
            return True
    return False


@kernel
def add_stiffness(effect, system, state, diagonal):
    """Add d2W by the scaled strains to diagonal (N, 3, 3)."""
    if effect is None:
        return
    if effect.share.shape[0]:
        add_plastic_stiffness(system.lengths, state.strains, system.natural, effect, system.scale,
                              diagonal)


@kernel
def add_plastic(lengths: Floats, strains: Floats, natural: Floats, layers: PlasticSection,
                gradient: Floats) -> float:
    """Add dW/du (N, 3) to `gradient` and return W, stored and newly lost, in J.

    Args:
        lengths: (N,) m; strains, natural: (N, 3) 1/m
        layers: PlasticSection
    """
    energy = 0.0
    direction, limit, share, kind = layers.direction, layers.limit, layers.share, layers.kind
    strength, plastic_strain = layers.strength, layers.set
    for e in range(lengths.size):
        h = lengths[e]
        d0 = strains[e, 0] - natural[e, 0]
        d1 = strains[e, 1] - natural[e, 1]
        d2 = strains[e, 2] - natural[e, 2]
        m0 = m1 = m2 = density = 0.0
        for j in range(limit.size):
            a0, a1, a2 = direction[j]
            away = a0 * d0 + a1 * d1 + a2 * d2 - plastic_strain[e, j]
            elastic = _within(away, limit[j])
            moment = strength[e, kind[j]] * share[j] * elastic
            m0 += moment * a0
            m1 += moment * a1
            m2 += moment * a2
            density += moment * (away - 0.5 * elastic)
        gradient[e, 0] += h * m0
        gradient[e, 1] += h * m1
        gradient[e, 2] += h * m2
        energy += h * density
        if layers.ellipse.size > 0:
            k1, k2, x1, x2, e1, e2, _ = _in_ellipse(e, d1, d2, layers)
            gradient[e, 1] += h * k1 * e1
            gradient[e, 2] += h * k2 * e2
            energy += h * (k1 * e1 * (x1 - 0.5 * e1) + k2 * e2 * (x2 - 0.5 * e2))
    return energy


@kernel
def _in_ellipse(e, d1, d2, layers):
    """Return stiffness, curvature since the set, what of it is elastic (2 each), the multiplier."""
    k1, k2 = layers.strength[e, 1], layers.strength[e, 2]
    first = layers.limit.size
    x1, x2 = d1 - layers.set[e, first], d2 - layers.set[e, first + 1]
    e1, e2, g = closest_point_projection(x1, x2, k1, k2, layers.ellipse[0], layers.ellipse[1])
    return k1, k2, x1, x2, e1, e2, g


@kernel
def add_plastic_stiffness(lengths, strains, natural, layers, scale, diagonal):
    """Add d2W by the scaled strains to diagonal (N, 3, 3), scale: (N, 3)."""
    direction, limit, share, kind = layers.direction, layers.limit, layers.share, layers.kind
    strength, plastic_strain = layers.strength, layers.set
    for e in range(lengths.size):
        d0 = strains[e, 0] - natural[e, 0]
        d1 = strains[e, 1] - natural[e, 1]
        d2 = strains[e, 2] - natural[e, 2]
        k00 = k11 = k22 = k12 = 0.0
        for j in range(limit.size):
            a0, a1, a2 = direction[j]
            if abs(a0 * d0 + a1 * d1 + a2 * d2 - plastic_strain[e, j]) <= limit[j]:
                k = strength[e, kind[j]] * share[j]
                k00 += k * a0 * a0
                k11 += k * a1 * a1
                k22 += k * a2 * a2
                k12 += k * a1 * a2
        if layers.ellipse.size > 0:
            b11, b22, b12 = _ellipse_stiffness(e, d1, d2, layers)
            k11, k22, k12 = k11 + b11, k22 + b22, k12 + b12
        h, s0, s1, s2 = lengths[e], scale[e, 0], scale[e, 1], scale[e, 2]
        diagonal[e, 0, 0] += h * s0 * s0 * k00
        diagonal[e, 1, 1] += h * s1 * s1 * k11
        diagonal[e, 2, 2] += h * s2 * s2 * k22
        diagonal[e, 1, 2] += h * s1 * s2 * k12
        diagonal[e, 2, 1] += h * s1 * s2 * k12


@kernel
def _ellipse_stiffness(e, d1, d2, layers):
    """Return the derivatives (nn, bb, nb) of the moments by the curvatures."""
    k1, k2, _, _, e1, e2, g = _in_ellipse(e, d1, d2, layers)
    if g == 0.0:
        return k1, k2, 0.0
    q1, q2 = 1.0 / layers.ellipse[0] ** 2, 1.0 / layers.ellipse[1] ** 2
    c1, c2 = 1.0 / (1.0 + g * q1 / k1), 1.0 / (1.0 + g * q2 / k2)
    size = np.sqrt(e1 * e1 * c1 * q1 * q1 / k1 + e2 * e2 * c2 * q2 * q2 / k2)
    v1, v2 = e1 * c1 * q1 / size, e2 * c2 * q2 / size
    return k1 * c1 - v1 * v1, k2 * c2 - v2 * v2, -v1 * v2


@kernel
def return_map(lengths: Floats, strains: Floats, natural: Floats,
               layers: PlasticSection) -> tuple[Floats, float]:
    """Return the set after the step to `strains`, as `layers.set`, and the energy lost in it, J."""
    direction, limit, share, kind = layers.direction, layers.limit, layers.share, layers.kind
    strength, plastic_strain = layers.strength, layers.set
    new = plastic_strain.copy()
    lost = 0.0
    for e in range(lengths.size):
        d0 = strains[e, 0] - natural[e, 0]
        d1 = strains[e, 1] - natural[e, 1]
        d2 = strains[e, 2] - natural[e, 2]
        for j in range(limit.size):
            a0, a1, a2 = direction[j]
            away = a0 * d0 + a1 * d1 + a2 * d2 - plastic_strain[e, j]
            elastic = _within(away, limit[j])
            new[e, j] += away - elastic
            lost += lengths[e] * strength[e, kind[j]] * share[j] * elastic * (away - elastic)
        if layers.ellipse.size > 0:
            k1, k2, x1, x2, e1, e2, _ = _in_ellipse(e, d1, d2, layers)
            new[e, limit.size] += x1 - e1
            new[e, limit.size + 1] += x2 - e2
            lost += lengths[e] * (k1 * e1 * (x1 - e1) + k2 * e2 * (x2 - e2))
    return new, lost


@kernel
def set_strains(stiffness: Floats, layers: PlasticSection) -> Floats:
    """Return (N, 3) the strains since the natural ones at which no moment acts, 1/m.

    Args:
        stiffness: (N, 3); layers: a PlasticSection, in which nothing yields on the way there
    """
    out = np.zeros(stiffness.shape)
    springs = layers.limit.size
    for e in range(stiffness.shape[0]):
        for j in range(springs):
            k = layers.strength[e, layers.kind[j]] * layers.share[j] * layers.set[e, j]
            for i in range(3):
                out[e, i] += k * layers.direction[j, i] / stiffness[e, i]
        for i in range(layers.ellipse.size):
            out[e, 1 + i] += (layers.strength[e, 1 + i] / stiffness[e, 1 + i]
                              * layers.set[e, springs + i])
    return out


# ------------------------------------------------------------------------------------------------
# What the section of a rod consists of: `energy.elastic`, and the springs above.


_SAME = 1e-9  # of the stiffness: as near as two axes of one section are
_PROBES = 33  # nodes where a stiffness that varies is compared


class _Springs(NamedTuple):
    """Springs as of a PlasticSection: direction (J, 3), limit (J,) 1/m, share (J,), kind."""

    direction: Floats
    limit: Floats
    share: Floats
    kind: Ints


def elastic_part(rod: Rod) -> Elastic:
    """Return the Elastic of a Rod."""
    if not rod.yields:
        return purely_elastic()
    return Elastic(np.full(3, float(rod.hardening)), np.zeros((0, 3)))


def yielding_layers(rod: Rod, stiffness: Floats) -> PlasticSection:
    """Return the PlasticSection of a Rod without a set; without springs if it does not yield.

    Shapes: stiffness (N, 3).
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
    return PlasticSection(*joined, (1 - hardening) * strength, ellipse,
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
