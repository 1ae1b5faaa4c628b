# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What cases are drawn from: random numbers of a stated seed, gripper poses, rods."""

from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import Pose, Rod

SEED = 29
_SHAKEN = 1e-12  # of poses, where it is tried whether an answer hangs on rounding errors


class Given:
    """Random numbers of one case, and its poses.

    Attributes:
        rng: numpy's Generator
        number: of the case, of its kind
    """

    def __init__(self, kind, number, shake=0):
        own = crc32(kind.encode()), number
        self.rng, self.number = np.random.default_rng([SEED, *own]), number
        self._shaken = np.random.default_rng([shake, *own]) if shake else None

    def pose(self, position, quaternion):
        """Return a Pose, moved by a rounding error where the case is shaken."""
        position, quaternion = (np.array(one, dtype=float) for one in (position, quaternion))
        if self._shaken is not None:
            quaternion = quaternion / np.linalg.norm(quaternion)
            size = max(1.0, np.abs(position).max())
            position = position + _SHAKEN * size * self._shaken.normal(size=3)
            quaternion = quaternion + _SHAKEN * self._shaken.normal(size=4)
        return Pose(position, quaternion)

    def turned(self, position, turn):
        """Return the pose that a rotation vector (3,) turns from the world's axes."""
        return self.pose(position, Rotation.from_rotvec(turn).as_quat())

    def along(self, position, direction):
        """Return the pose that looks along a direction (3,)."""
        return self.pose(position, Pose.looking_along(position, direction).quaternion)

    def anywhere(self, length=1.0):
        """Return any pose."""
        return self.pose(length * self.rng.normal(size=3), self.rng.normal(size=4))

    def way(self, start, shift, turn, count):
        """Return poses on the way from a Pose (which is left out), even steps of both.

        Args:
            shift: (3,) m; turn: (3,) rotation vector in world axes
        """
        base, parts = Rotation.from_quat(start.quaternion), np.arange(1, count + 1) / count
        return [self.pose(start.position + part * np.asarray(shift), (
            Rotation.from_rotvec(part * np.asarray(turn)) * base).as_quat()) for part in parts]

    def between(self, low, high):
        """Return a number whose logarithm is even."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def direction(self):
        """Return a unit vector (3,)."""
        vector = self.rng.normal(size=3)
        return vector / np.linalg.norm(vector)

    def rod(self, load=(0.1, 1e3), length=None, **more):
        """Return a Rod: wire, hose, strip, or any; straight, bent or twisted.

        Args:
            load: its weight times L^2 / EI, from and to
        """
        length = self.between(0.2, 5.0) if length is None else length
        load, kind = self.between(*load), self.rng.integers(6)
        size = length * self.between(1e-3, 1e-2)
        density, poisson = self.between(500, 9000), self.rng.uniform(0.1, 0.45)
        if kind == 0:
            modulus = _modulus(np.pi / 4 * size**2, np.pi / 64 * size**4, density, length, load)
            return Rod.circular(length, size, density, modulus, poisson, **more)
        if kind == 1:
            inner = 0.7 * size
            modulus = _modulus(np.pi / 4 * (size**2 - inner**2),
                               np.pi / 64 * (size**4 - inner**4), density, length, load)
            return Rod.tube(length, size, inner, density, modulus, poisson, **more)
        if kind == 2:
            width = size * self.between(1.5, 10)
            modulus = _modulus(width * size, width * size**3 / 12, density, length, load)
            return Rod.rectangular(length, width, size, density, modulus, poisson, **more)
        weight = 0.05
        stiff = weight * 9.81 * length**3 / load
        pair = [stiff, stiff * (self.between(1, 50) if self.rng.random() < 0.6 else 1.0)]
        if self.rng.random() < 0.5:
            pair.reverse()
        if kind >= 4:
            more['natural_curvature'] = tuple(self.rng.normal(size=2) * 1.5 / length)
        if kind == 5:
            more['natural_twist'] = self.rng.normal() / length
        if self.rng.random() < 0.2:
            more['tip_mass'] = weight * length * self.between(0.05, 1)
        return Rod(length, weight, tuple(pair), stiff * self.between(0.2, 3), **{
            'radius': size / 2, **more})


def _modulus(area, moment, density, length, load):
    """Return the modulus (Pa) with which the weight of a rod is `load` times EI / L^2."""
    return 9.81 * density * area * length**3 / (load * moment)
