"""The smallest eigenvalue of the Hessian and its mode: is it a minimum, and if not, which way down.

Lanczos on the inverse of H + shift I (Golub and Van Loan, ch. 10), with full orthogonalisation.
In the scaled unknowns the elastic part of H is the identity: 1 is a rod that feels no load, 0 a
shape that is neutral, a negative value one that falls over.
"""

import numpy as np
from numba import njit

from dlo_planner.minimize.linear import solve

_STEPS = 40


@njit(cache=True)
def lowest_mode(system, hessian, shift, tolerance):
    """Return the smallest eigenvalue of H and its unit mode (m, 3).

    Args:
        hessian: factorised with `shift`, without negative pivots
        shift: of that factorisation
        tolerance: relative accuracy of the eigenvalue of the inverse
    """
    m = system.lengths.size if system.basis.shape[1] == 0 else system.basis.shape[1]
    steps = min(_STEPS, 3 * m)
    vectors = np.empty((steps + 1, m, 3))
    diagonal = np.empty(steps)
    side = np.empty(steps)
    # A fixed start without symmetry: it must have a part along every mode.
    seed = 12345
    for e in range(m):
        for i in range(3):
            seed = (1103515245 * seed + 12345) % 2147483648
            vectors[0, e, i] = (0.5 + seed / 2147483648.0) / (1.0 + 0.1 * e)
    vectors[0] /= np.sqrt(np.sum(vectors[0] ** 2))
    image = np.empty((m, 3))
    previous = 0.0
    used = steps
    for k in range(steps):
        solve(system, hessian, vectors[k], image)
        diagonal[k] = np.sum(image * vectors[k])
        for j in range(k + 1):
            image -= np.sum(image * vectors[j]) * vectors[j]
        side[k] = np.sqrt(np.sum(image * image))
        if side[k] < 1e-13 * abs(diagonal[k]):
            used = k + 1
            break
        vectors[k + 1] = image / side[k]
        if k % 4 == 3:
            top = np.linalg.eigvalsh(_tridiagonal(diagonal, side, k + 1))[-1]
            if abs(top - previous) < tolerance * top:
                used = k + 1
                break
            previous = top
    values, modes = np.linalg.eigh(_tridiagonal(diagonal, side, used))
    mode = np.zeros((m, 3))
    for k in range(used):
        mode += modes[k, used - 1] * vectors[k]
    mode /= np.sqrt(np.sum(mode * mode))
    return 1.0 / values[used - 1] - shift, mode


@njit(cache=True)
def _tridiagonal(diagonal, side, size):
    matrix = np.zeros((size, size))
    for k in range(size):
        matrix[k, k] = diagonal[k]
        if k:
            matrix[k, k - 1] = side[k - 1]
            matrix[k - 1, k] = side[k - 1]
    return matrix
