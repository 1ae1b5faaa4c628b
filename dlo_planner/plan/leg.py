# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One leg of a gripper's path: splines through poses, without corners, or a dwell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.value import Value, put


class LegPoints(NamedTuple):
    """A leg at n parameters u.

    Derivatives are by u; the linear ones before the angular ones, world axes: of the rotation
    vector that turns the gripper, not of coordinates of its rotation.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        Positions in m.
    rotations : ndarray, shape (n, 3, 3)
    first : ndarray, shape (n, 6)
        First derivatives, m and rad.
    second : ndarray, shape (n, 6)
        Second derivatives.
    """

    positions: Floats
    rotations: Floats
    first: Floats
    second: Floats


@dataclass(frozen=True, eq=False)
class Leg(Value):
    """A path without corners, or a dwell: twice continuously differentiable within.

    SciPy's cubic spline of the positions and its rotation spline.

    Attributes
    ----------
    knots : ndarray, shape (m,)
        Parameters of the poses, increasing, m >= 2.
    positions : ndarray, shape (m, 3)
        Positions in m.
    rotations : ndarray, shape (m, 3, 3)
    """

    knots: Floats
    positions: Floats
    rotations: Floats
    _position: CubicSpline = field(init=False, repr=False, compare=False)
    _turn: RotationSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        since = self.knots - self.knots[0]
        put(self, _position=CubicSpline(since, self.positions),
            _turn=RotationSpline(since, Rotation.from_matrix(self.rotations)))
        super().__post_init__()

    @property
    def still(self) -> bool:
        """Whether it is a dwell."""
        return bool((self.positions == self.positions[0]).all()
                    and (self.rotations == self.rotations[0]).all())

    def poses(self, u: Floats) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and rotations (n, 3, 3) at parameters `u` (n,)."""
        since = np.clip(u, *self.knots[[0, -1]]) - self.knots[0]
        return self._position(since), self._turn(since).as_matrix()

    def at(self, u: Floats) -> LegPoints:
        """Return the LegPoints at parameters u.

        Shapes: u (n,).
        """
        positions, rotations = self.poses(u)
        since = np.clip(u, *self.knots[[0, -1]]) - self.knots[0]
        # the rotation spline's own are in the gripper's axes; turned as they are, because the
        # turning of those axes adds the cross product of the rate with itself
        first, second = (np.hstack([self._position(since, order), np.einsum(
            'nij,nj->ni', rotations, self._turn(since, order))]) for order in (1, 2))
        return LegPoints(positions, rotations, first, second)

    def control_points(self, a: Floats, b: Floats) -> Floats:
        """Return (n, 4, 3) m: the path of the origin from a to b is in the convex hull of the four.

        They are those of a Bezier curve, so their polygon is no shorter than the path.

        Shapes: a, b (n,).
        """
        from_a, from_b, middle = a - self.knots[0], b - self.knots[0], self._middle(a, b)
        third = (b - a)[:, None] / 3
        c = self._position.c[:, middle]
        slopes = [(3 * c[0] * x + 2 * c[1]) * x + c[2]
                  for x in ((t - self._position.x[middle])[:, None] for t in (from_a, from_b))]
        first, last = self._position(from_a), self._position(from_b)
        return np.stack([first, first + third * slopes[0], last - third * slopes[1], last], axis=1)

    def bounds(self, a: Floats, b: Floats) -> Floats:
        """Return (n, 2, 3) bounds of derivatives by u between parameters a and b.

        [:, 0]: of the sizes of the position's first to third derivative. [:, 1]: of the angular
        rate and of its first two derivatives. Polynomials are bounded by their control points. The
        rate is J phi' of the rotation vector phi since the last knot, a cubic polynomial, and
        J = integral of exp(-s phi) over s = 0...1: |J| <= 1, |J'| <= |phi'| / 2,
        |J''| <= |phi''| / 2 + |phi'|^2 / 3.

        Shapes: a, b (n,).
        """
        middle = self._middle(a, b)
        place, turn = (_polynomial_bounds(spline.c[:, middle], a - self.knots[0] - spline.x[middle],
                                          b - self.knots[0] - spline.x[middle])
                       for spline in (self._position, self._turn.interpolator))
        first, second, third = turn.T
        return np.stack([place, np.stack([
            first, second + 0.5 * first**2, third + 1.5 * first * second + first**3 / 3], axis=1)],
            axis=1)

    def pieces(self, least: int = 1) -> tuple[Floats, Floats]:
        """Return parameters a, b (n,) of the pieces between knots, each cut in `least` parts."""
        edges = np.concatenate([np.linspace(one, other, least, endpoint=False) for one, other in
                                zip(self.knots, self.knots[1:], strict=False)] + [self.knots[-1:]])
        return edges[:-1], edges[1:]

    def _middle(self, a: Floats, b: Floats) -> Ints:
        """Return the indices (n,) of the pieces between knots in which [a, b] lie."""
        index = np.searchsorted(self.knots, 0.5 * (a + b), side='right') - 1
        return np.clip(index, 0, self.knots.size - 2)


def _polynomial_bounds(c: Floats, a: Floats, b: Floats) -> Floats:
    """Return (n, 3) bounds of the sizes of a cubic's first to third derivatives within [a, b].

    Shapes: c (4, n, 3), a, b (n,).
    """
    a, b = a[:, None], b[:, None]
    slopes = [(3 * c[0] * x + 2 * c[1]) * x + c[2] for x in (a, b)]
    bends = [6 * c[0] * x + 2 * c[1] for x in (a, b)]
    between = slopes[0] + 0.5 * (b - a) * bends[0]  # the control point in the middle
    return np.stack([np.max([np.linalg.norm(v, axis=1) for v in vectors], axis=0)
                     for vectors in ((*slopes, between), bends, (6 * c[0],))], axis=1)
