# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Inertia, Eq. 12, 13: each mass is drawn to where it would be without forces.

Whatever the time integrator, a step minimizes the static potential plus

    W_dyn = sum of weight |x - anchor|^2 / 2

over the nodes; the integrator (`direct.dynamics`) says where the anchors are and how strong.
The section's own rotational inertia is neglected (of order (d/L)^2).
"""

from dlo_planner.kernels import kernel


@kernel
def add_anchor(anchor, weight, positions, pull):
    """Add dW/dx (N + 1, 3) to `pull` and return W in J.

    Args:
        anchor: (N + 1, 3) m, or (0, 3) without inertia
        weight: (N + 1,) N/m, or (0,)
        positions: (N + 1, 3) m
    """
    energy = 0.0
    for k in range(weight.size):
        for i in range(3):
            away = positions[k, i] - anchor[k, i]
            pull[k, i] += weight[k] * away
            energy += 0.5 * weight[k] * away * away
    return energy
