# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The Hessian as a dense matrix, of its blocks per element."""

import numpy as np


def dense(system, hessian):
    """Return the Hessian (3 m, 3 m): for e < f,  d2V / du_f du_e = cross_f twist_jacobian_e."""
    if system.basis.shape[1]:
        return hessian.dense.copy()
    n = system.lengths.size
    blocks = np.zeros((n, 3, n, 3))
    for f in range(n):
        blocks[f, :, f] = hessian.diagonal[f]
        for e in range(f):
            blocks[f, :, e] = hessian.cross[f] @ hessian.twist_jacobian[e]
            blocks[e, :, f] = blocks[f, :, e].T
    return blocks.reshape(3 * n, 3 * n)
