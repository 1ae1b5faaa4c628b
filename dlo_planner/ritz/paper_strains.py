# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's description of bending and torsion: (q_d, q_kappa, q_tau), sections 3.3.1, 3.3.2.

q_d is the direction of curvature (the angle of its axis from n about t), q_kappa its amount, q_tau
the torsion. The components used elsewhere are (torsion, curvature about n, curvature about b) =
(q_tau, q_kappa cos q_d, q_kappa sin q_d), exactly. Where there is no curvature its direction is
not defined, and small changes of shape are large changes of q_d: the reason why the
components are what the simulators use.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats


def from_components(strains: ArrayLike) -> Floats:
    """Return (n, 3) q_d in (-pi, pi], q_kappa >= 0, q_tau of component strains (n, 3).

    Without curvature q_d is 0.
    """
    torsion, about_n, about_b = np.asarray(strains, dtype=float).T
    amount = np.hypot(about_n, about_b)
    direction = np.where(amount > 0, np.arctan2(about_b, about_n), 0.0)
    return np.column_stack([direction, amount, torsion])


def to_components(described: ArrayLike) -> Floats:
    """Return (n, 3) torsion, curvature about n, about b of (q_d, q_kappa, q_tau) (n, 3).

    A negative q_kappa is curvature in the opposite direction.
    """
    direction, amount, torsion = np.asarray(described, dtype=float).T
    return np.column_stack([torsion, amount * np.cos(direction), amount * np.sin(direction)])


def add(one: ArrayLike, other: ArrayLike) -> Floats:
    """Return the sum (n, 3) of two deformations (n, 3), both (q_d, q_kappa, q_tau): Eq. 14."""
    d1, k1, t1 = np.asarray(one, dtype=float).T
    d2, k2, t2 = np.asarray(other, dtype=float).T
    amount = np.sqrt(np.maximum(k1**2 + k2**2 + 2 * k1 * k2 * np.cos(d1 - d2), 0.0))  # Eq. 14b
    direction = np.arctan2(k1 * np.sin(d1) + k2 * np.sin(d2), k1 * np.cos(d1) + k2 * np.cos(d2))
    return np.column_stack([np.where(amount > 0, direction, 0.0), amount, t1 + t2])   # Eq. 14a


def element_rotation(described: ArrayLike, length: float) -> Floats:
    """Return the rotation (3, 3) from the far end of a short element to its near end: Eq. 16.

    R(t, q_d) R(n, q_kappa ds) R(t, -q_d) R(t, q_tau ds): bending first, then torsion. For
    ds -> 0 it is the exponential of the components, which treats both alike.

    Parameters
    ----------
    described : array_like, shape (3,)
        q_d, q_kappa, q_tau.
    length : float
        Length of the element (ds), m.
    """
    direction, amount, torsion = np.asarray(described, dtype=float)
    return (_about_t(direction) @ _about_n(amount * length) @ _about_t(-direction)
            @ _about_t(torsion * length))


def _about_t(angle: float) -> Floats:
    result: Floats = scipy.spatial.transform.Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
    return result


def _about_n(angle: float) -> Floats:
    result: Floats = scipy.spatial.transform.Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    return result
