# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bending and torsion, Eq. 2b, 2c: quadratic in the deviation from the natural strains."""

from dlo_planner.kernels import kernel


@kernel
def add_elastic(lengths, strains, natural, stiffness, gradient):
    """Add dW/du (N, 3) to `gradient` and return W = sum of h K (u - natural)^2 / 2, in J.

    Args:
        lengths: (N,) m
        strains, natural: (N, 3) 1/m
        stiffness: (N, 3) GJ, EI_n, EI_b in N m^2
    """
    energy = 0.0
    for e in range(lengths.size):
        for i in range(3):
            deviation = strains[e, i] - natural[e, i]
            moment = lengths[e] * stiffness[e, i] * deviation
            gradient[e, i] += moment
            energy += 0.5 * moment * deviation
    return energy
