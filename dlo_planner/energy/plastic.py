"""Plastic bending and torsion, sections 3.2.1, 3.2.2: layers that yield, side by side.

A section is a bundle of J layers that share its stiffness; each is elastic and ideally plastic
with its own threshold (Besseling 1958, Iwan 1967). One layer is the paper's model, W = integral of
the stress-strain diagram; layers of rising thresholds are an elastic core with a plastic rim; a
layer that never yields is hardening. Curvature is a vector: it yields when it leaves the ellipse of
the thresholds, and flows so that the energy used up is least. Torsion yields by itself.

With the strains of this step u and the set of the steps before p (Eq. of 3.2.2, D_new = u - p),
W(u) is the energy stored plus the energy newly lost: its minimum is the step's solution, and its
derivative the moment.
"""

import numpy as np

from dlo_planner.kernels import kernel
from dlo_planner.ritz.record import Record, makes


class Layers(Record):
    """How a section yields; J layers, none for an elastic DLO.

    Attributes:
        share: (J, 2) of the torsional and of the bending stiffness; sums 1 without viscosity
        limit: (J, 3) torsion and curvatures about n and b at which the layer yields, 1/m
        set: (N, J, 3) plastic strain of each layer in each element, 1/m
    """

    share: np.ndarray
    limit: np.ndarray
    set: np.ndarray


@makes(Layers)
@kernel
def _new_layers(share, limit, set):
    return Layers(share, limit, set)


@kernel
def yielded(d1, d2, k1, k2, l1, l2):
    """Return the curvature (e1, e2) that stays elastic of (d1, d2), and the flow's multiplier.

    The elastic region is the ellipse (e1 / l1)^2 + (e2 / l2)^2 <= 1; the plastic rest is normal to
    it in the moments, which leaves e_i = d_i / (1 + g / (k_i l_i^2)) with one unknown g >= 0.

    Args:
        d1, d2: curvature less the plastic one; k1, k2: stiffness; l1, l2: thresholds
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
def _layer(e, j, strains, natural, stiffness, share, limits, known):
    """Return layer j's stiffness, its strain since its set and what of that is elastic (3 each).

    The last result is the multiplier of `yielded`.
    """
    limit = limits[j]
    k0 = stiffness[e, 0] * share[j, 0]
    k1 = stiffness[e, 1] * share[j, 1]
    k2 = stiffness[e, 2] * share[j, 1]
    d0 = strains[e, 0] - natural[e, 0] - known[e, j, 0]
    d1 = strains[e, 1] - natural[e, 1] - known[e, j, 1]
    d2 = strains[e, 2] - natural[e, 2] - known[e, j, 2]
    e1, e2, g = yielded(d1, d2, k1, k2, limit[1], limit[2])
    return (k0, k1, k2), (d0, d1, d2), (min(max(d0, -limit[0]), limit[0]), e1, e2), g


@kernel
def add_plastic(lengths, strains, natural, stiffness, layers, gradient):
    """Add dW/du (N, 3) to `gradient` and return W, stored and newly lost, in J.

    Args: as `energy.elastic.add_elastic`, and `layers`, a Layers.
    """
    energy = 0.0
    share, limits, known = layers.share, layers.limit, layers.set
    for e in range(lengths.size):
        h = lengths[e]
        for j in range(share.shape[0]):
            (k0, k1, k2), (d0, d1, d2), (e0, e1, e2), _ = _layer(e, j, strains, natural, stiffness,
                                                                 share, limits, known)
            gradient[e, 0] += h * k0 * e0
            gradient[e, 1] += h * k1 * e1
            gradient[e, 2] += h * k2 * e2
            energy += h * (k0 * e0 * (d0 - 0.5 * e0) + k1 * e1 * (d1 - 0.5 * e1)
                           + k2 * e2 * (d2 - 0.5 * e2))
    return energy


@kernel
def add_plastic_stiffness(lengths, strains, natural, stiffness, layers, scale, diagonal):
    """Add d2W by the scaled strains to diagonal (N, 3, 3), scale: (N, 3)."""
    share, limits, known = layers.share, layers.limit, layers.set
    for e in range(lengths.size):
        h = lengths[e]
        s0, s1, s2 = scale[e]
        for j in range(share.shape[0]):
            limit = limits[j]
            (k0, k1, k2), (d0, _, _), (_, e1, e2), g = _layer(e, j, strains, natural, stiffness,
                                                              share, limits, known)
            if abs(d0) <= limit[0]:
                diagonal[e, 0, 0] += h * k0 * s0 * s0
            c1 = c2 = 1.0
            v1 = v2 = 0.0
            if g > 0.0:
                q1, q2 = 1.0 / (limit[1] * limit[1]), 1.0 / (limit[2] * limit[2])
                c1, c2 = 1.0 / (1.0 + g * q1 / k1), 1.0 / (1.0 + g * q2 / k2)
                size = np.sqrt(e1 * e1 * c1 * q1 * q1 / k1 + e2 * e2 * c2 * q2 * q2 / k2)
                v1, v2 = e1 * c1 * q1 / size, e2 * c2 * q2 / size
            diagonal[e, 1, 1] += h * s1 * s1 * (k1 * c1 - v1 * v1)
            diagonal[e, 2, 2] += h * s2 * s2 * (k2 * c2 - v2 * v2)
            diagonal[e, 1, 2] -= h * s1 * s2 * v1 * v2
            diagonal[e, 2, 1] -= h * s1 * s2 * v1 * v2


@kernel
def settled(lengths, strains, natural, stiffness, layers):
    """Return the set (N, J, 3) after the step to `strains`, and the energy lost in it, J."""
    share, limits, known = layers.share, layers.limit, layers.set
    new = known.copy()
    lost = 0.0
    for e in range(lengths.size):
        for j in range(share.shape[0]):
            (k0, k1, k2), (d0, d1, d2), (e0, e1, e2), _ = _layer(e, j, strains, natural, stiffness,
                                                                 share, limits, known)
            new[e, j, 0] += d0 - e0
            new[e, j, 1] += d1 - e1
            new[e, j, 2] += d2 - e2
            lost += lengths[e] * (k0 * e0 * (d0 - e0) + k1 * e1 * (d1 - e1) + k2 * e2 * (d2 - e2))
    return new, lost
