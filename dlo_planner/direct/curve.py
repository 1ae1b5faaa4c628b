# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The geometry of a shape: arcs of constant strain, one after the other."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number, row
from dlo_planner.model.pose import Pose
from dlo_planner.pictured import Pictured
from dlo_planner.ritz.kinematics import frame_along

_ROUNDING = 1e-9  # of the length


class ForKernels(NamedTuple):
    """Arrays of a Curve of N elements for kernels, which take no read-only ones.

    Attributes
    ----------
    lengths : ndarray, shape (N,)
        Of the elements, m.
    strains : ndarray, shape (N, 3)
        Of the elements, 1/m.
    frames : ndarray, shape (N + 1, 3, 3)
        Of the nodes.
    positions : ndarray, shape (N + 1, 3)
        Of the nodes, m.
    """

    lengths: Floats
    strains: Floats
    frames: Floats
    positions: Floats


class Curve(Pictured):
    """What a Shape knows of its own geometry; a base of it.

    Attributes
    ----------
    s, positions, frames, element_strains : ndarray
        As of `Shape`.
    """

    s: Floats
    positions: Floats
    frames: Floats
    element_strains: Floats

    @property
    def tangents(self) -> Floats:
        """(N_L + 1, 3) unit tangents at the nodes."""
        return self.frames[:, :, 0]

    @property
    def strains(self) -> Floats:
        """(N_L + 1, 3) strains at the nodes, 1/m, interpolated from the elements' middles."""
        u = self.element_strains
        if len(u) == 1:
            return np.repeat(u, 2, axis=0)
        h = np.diff(self.s)[:, None]
        inner = (h[1:] * u[:-1] + h[:-1] * u[1:]) / (h[1:] + h[:-1])
        first = u[0] - (u[1] - u[0]) * h[0] / (h[0] + h[1])
        last = u[-1] + (u[-1] - u[-2]) * h[-1] / (h[-1] + h[-2])
        return np.vstack([first, inner, last])

    @property
    def bend_radius(self) -> Floats:
        """(N_L,) radius of curvature of the elements, m; infinite where straight."""
        with np.errstate(divide='ignore'):
            return 1 / np.hypot(self.element_strains[:, 1], self.element_strains[:, 2])

    def at(self, s: float) -> Pose:
        """Return the Pose (x axis = tangent) at arc length `s` in m, on the element's exact arc.

        Raises
        ------
        InvalidTask
            `s` is outside [0, L].
        """
        s = number('s', s, minimum=0, maximum=float(self.s[-1]))
        rotation, position = self.frame_at(s)
        return Pose.from_rotation(position, rotation)

    def positions_at(self, s: ArrayLike) -> Floats:
        """Return (m, 3) positions in m at arc lengths `s` (m,) in m, as `at`, but quicker.

        Raises
        ------
        InvalidTask
            One is outside [0, L].
        """
        s = row('s', s, least=0, minimum=0, maximum=float(self.s[-1]))
        return np.array([self.frame_at(value)[1] for value in s]).reshape(-1, 3)

    def frame_at(self, s: float) -> tuple[Floats, Floats]:
        """Return axes (3, 3) and position (3,) at `s` in m: `at` for inner loops.

        Raises
        ------
        InvalidTask
            `s` is outside [0, L] by more than rounding.
        """
        length = self.s[-1]
        if not (isinstance(s, float) and 0.0 <= s <= length):
            s = number('s', s, minimum=-_ROUNDING * length, maximum=(1 + _ROUNDING) * length)
            s = min(max(s, 0.0), length)
        found: tuple[Floats, Floats] = frame_along(self.s, self.element_strains, self.frames,
                                                   self.positions, s)
        return found

    @cached_property
    def for_kernels(self) -> 'ForKernels':
        """What kernels read; nothing else is to.

        Copies: read-only arrays are another type for numba, and would compile everything again.
        """
        return ForKernels(np.diff(self.s), self.element_strains.copy(), self.frames.copy(),
                          self.positions.copy())
