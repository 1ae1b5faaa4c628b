# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The shift that a Hessian needs to be positive definite.

Of a growing row the first that is enough. Most of those before are found to be too small by a
matrix of 3 x 3, that of the Hessian on bends like those of a DLO that falls over.
"""

import numpy as np

from dlo_planner.energy.effects import row_count
from dlo_planner.kernels import kernel
from dlo_planner.minimize.linear import factorize, is_definite
from dlo_planner.minimize.riccati import inverse3

LEAST_SHIFT = 1e-3


@kernel
def _definite_on(a, shift):
    """Whether a (6 numbers) + shift I is positive definite."""
    return inverse3((a[0] + shift, a[1] + shift, a[2] + shift, a[3], a[4], a[5]))[1] == 0


@kernel
def safe_shift(system, hessian, shift):
    """Factorize with the first shift in a growing row that leaves no negative pivot."""
    even = _on_even_bends(system, hessian)  # a DLO that falls does so nearly like this
    while not (_definite_on(even, shift) and is_definite(system, hessian, shift)):
        shift = max(LEAST_SHIFT, 4.0 * shift)
        if shift > 1e12:
            factorize(system, hessian, shift)  # to its end, whatever it is
            break
    return shift


@kernel
def _on_even_bends(system, hessian):
    """Return an assembled Hessian on even torsion and bends, more near the gripper.

    As 6 numbers (00, 11, 22, 01, 02, 12); where that is not looked at, those of the identity. No
    eigenvalue of it is below the smallest one of the Hessian.
    """
    xx = yy = zz = xy = xz = yz = size = where = 0.0
    if system.basis.shape[1] > 0 or row_count(hessian.border) > 0:
        return 1.0, 1.0, 1.0, xy, xz, yz
    lengths, length = system.lengths, np.sum(system.lengths)
    jacobians, crosses, diagonals = hessian.twist_jacobian, hessian.cross, hessian.diagonal
    theta = np.zeros((jacobians.shape[1], 3))  # how what lies beyond moves, by each of them
    for e in range(lengths.size):
        jacobian, cross, own = jacobians[e], crosses[e], diagonals[e]
        bend = np.sqrt(lengths[e]) * (1.2 - where / length)
        where += lengths[e]
        square = bend * bend
        size += square
        xx, yy, zz = xx + square * own[0, 0], yy + square * own[1, 1], zz + square * own[2, 2]
        xy, xz, yz = xy + square * own[0, 1], xz + square * own[0, 2], yz + square * own[1, 2]
        for k in range(theta.shape[0]):
            a, b, c = bend * cross[0, k], bend * cross[1, k], bend * cross[2, k]
            x, y, z = theta[k, 0], theta[k, 1], theta[k, 2]
            xx, yy, zz = xx + 2.0 * a * x, yy + 2.0 * b * y, zz + 2.0 * c * z
            xy, xz, yz = xy + a * y + b * x, xz + a * z + c * x, yz + b * z + c * y
            for i in range(3):
                theta[k, i] += bend * jacobian[k, i]
    return xx / size, yy / size, zz / size, xy / size, xz / size, yz / size
