"""The Kirchhoff equations of a hanging rod as a boundary value problem, left to SciPy.

Nothing of the package is used but the rod's numbers: state (x, quaternion, moment), the force is
the weight beyond s, clamped at s = 0, free at s = L.
"""

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation


def true_rod(rod, gripper, guess, gravity=(0.0, 0.0, -9.81), tol=1e-10):
    """Return positions at guess.s; `guess` (a Shape) only tells which branch is meant."""
    gravity = np.array(gravity)
    stiffness = rod.stiffness

    def weight_beyond(s):
        mass = rod.mass_per_length * (rod.length - s) + rod.tip_mass
        return gravity[:, None] * mass

    def slope(s, y):
        quaternion = y[3:7] / np.linalg.norm(y[3:7], axis=0)
        turn = Rotation.from_quat(quaternion.T)
        tangent = turn.apply([1.0, 0.0, 0.0]).T
        strain = turn.inv().apply(y[7:].T).T / stiffness[:, None] + rod.natural_strains(s).T
        x, y_, z, w = quaternion
        a, b, c = strain
        rate = 0.5 * np.array([w * a + y_ * c - z * b, w * b + z * a - x * c,
                               w * c + x * b - y_ * a, -x * a - y_ * b - z * c])
        return np.vstack([tangent, rate, -np.cross(tangent.T, weight_beyond(s).T).T])

    def ends(start, end):
        return np.concatenate([start[:3] - gripper.position, start[3:7] - gripper.quaternion,
                               end[7:]])

    quaternions = Rotation.from_matrix(guess.frames).as_quat()
    for k in range(len(quaternions)):  # one sheet of the double cover, the gripper's
        other = gripper.quaternion if k == 0 else quaternions[k - 1]
        quaternions[k] *= np.sign(quaternions[k] @ other)
    moments = np.einsum('kij,kj->ki', guess.frames,
                        (guess.strains - rod.natural_strains(guess.s)) * stiffness)
    first = np.vstack([guess.positions.T, quaternions.T, moments.T])
    found = solve_bvp(slope, ends, guess.s, first, tol=tol, max_nodes=200_000)
    assert found.success, found.message
    return found.sol(guess.s)[:3].T
