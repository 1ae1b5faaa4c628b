# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A rod that slides through rings, by shooting on the Kirchhoff equations (SciPy's DOP853).

Nothing of the package is used but the rod's numbers. The state is (x, quaternion, force, moment),
force and moment those of the part beyond on the part before; in a ring both jump by what it
exerts. Unknown are force and moment at the gripper, what the rings exert, and which places are in
them; known are where rings and far end are, and by how much the material force jumps in a ring.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation


def shot(shape, weight, jumps):
    """Return positions at `shape.s`, and the places in the rings, m; the shape is where it begins.

    weight: (3,) N/m. jumps: of each ring by how much the material force beyond it is larger, N;
    None: its place is known.
    """
    rod, length = shape.rod, float(shape.s[-1])
    stiffness, weight = rod.stiffness, np.asarray(weight)
    rings = [hold for hold in shape.holds if hold.s is not None]
    tip = shape.far_end
    scale = np.array([1.0, 1.0, 1.0, length, length, length]) * min(stiffness) / length**2

    def slope(_, y):
        turn = Rotation.from_quat(y[3:7]).as_matrix()
        strain = turn.T @ y[10:] / stiffness
        p, q, r, w = y[3:7]
        a, b, c = strain
        rate = 0.5 * np.array([w * a + q * c - r * b, w * b + r * a - p * c,
                               w * c + p * b - q * a, -p * a - q * b - r * c])
        return np.concatenate([turn[:, 0], rate, -weight, -np.cross(turn[:, 0], y[7:10])])

    def material(y):
        turn = Rotation.from_quat(y[3:7]).as_matrix()
        moment = turn.T @ y[10:]
        return y[7:10] @ turn[:, 0] + 0.5 * moment @ (moment / stiffness)

    def integrated(unknown):
        places = unknown[:len(rings)] * length
        wrenches = unknown[len(rings):].reshape(-1, 6) * scale
        y = np.concatenate([shape.gripper.position, shape.gripper.quaternion, -wrenches[0]])
        begin, left, parts = 0.0, [], []
        for ring, s, wrench, jump in zip(rings, places, wrenches[1:], jumps, strict=True):
            part = solve_ivp(slope, (begin, s), y, 'DOP853', rtol=1e-9, atol=1e-10,
                             dense_output=True)
            parts.append((begin, s, part.sol))
            y, begin = part.y[:, -1].copy(), s
            turn = Rotation.from_quat(y[3:7]).as_matrix()
            left += list((y[:3] - ring.pose.position) / length)
            before = material(y)
            y[7:] -= wrench
            axes = ring.pose.rotation
            if ring.grip in ('tube', 'aligned'):
                left += [turn[:, 0] @ axes[:, 1], turn[:, 0] @ axes[:, 2],
                         wrench[3:] @ turn[:, 0] / scale[3]]
            else:
                left += list(wrench[3:] / scale[3:])
            left.append(s / length - ring.s / length if jump is None
                        else (material(y) - before - jump) / scale[0])
        part = solve_ivp(slope, (begin, length), y, 'DOP853', rtol=1e-9, atol=1e-10,
                         dense_output=True)
        parts.append((begin, length, part.sol))
        y = part.y[:, -1]
        if tip is None:
            left += list(y[7:] / scale)
        else:
            turned = tip.pose.rotation.T @ Rotation.from_quat(y[3:7]).as_matrix()
            left += list((y[:3] - tip.pose.position) / length)
            left += list(Rotation.from_matrix(turned).as_rotvec())
        return np.array(left), parts

    first = np.concatenate([[ring.s / length for ring in rings], shape.gripper_wrench / scale,
                            *(wrench / scale for wrench in shape.wrenches[:len(rings)])])
    found = root(lambda unknown: integrated(unknown)[0], first, tol=1e-11)
    assert np.abs(found.fun).max() < 1e-8, found.message
    _, parts = integrated(found.x)
    positions = [next(sol(s)[:3] for begin, end, sol in parts if s <= end + 1e-12)
                 for s in shape.s]
    return np.array(positions), found.x[:len(rings)] * length
