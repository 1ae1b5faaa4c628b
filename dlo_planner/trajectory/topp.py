# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The fastest motion through a leg within limits, by time-optimal path parametrization.

toppra (Pham and Pham, IEEE Transactions on Robotics 34, 2018) finds the largest rate at each place.
Its constraints here are limits of the lengths of vectors, not of single coordinates, and bounds of
the DLO's quasi-static deviation.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.path import Leg
from dlo_planner.plan.requirements import Limits

_CORNERS = 16     # of the polygon that stands for a disc
_PLACES = 120     # of the grid of rates, at least
_PER_PIECE = 3    # of them between two knots, at least
_FASTEST = 1e3    # du/dt, where no limit bounds it: 1000 times the plan's pace
_ENDLESS = 1e9    # in place of an infinite limit, which toppra does not take
_STILL = 1e-12    # length of a derivative below which its direction has no meaning


@dataclass(frozen=True)
class DeviationBound:
    """The bounds |slopes u'' + bends u'^2| <= most at each of n parameters, for m quantities."""

    parameters: Floats  # (n,)
    slopes: Floats  # (n, m)
    bends: Floats  # (n, m)
    most: Floats  # (n, m)


class _Parameters(NamedTuple):
    """A constraint of toppra at n parameters: F (a u'' + b u'^2 + c) <= g, with bounds of both."""

    a: Floats  # (n, k)
    b: Floats
    c: Floats
    sides: Floats  # (n, m, k) the matrices F
    most: Floats  # (n, m) the right-hand sides g
    accelerations: Floats | None = None  # (n, 2) or None least and largest u''
    squares: Floats | None = None  # (n, 2) or None least and largest u'^2


def fastest_rates(leg: Leg, limits: Limits,
                  bound: DeviationBound | None = None) -> tuple[Floats, Floats]:
    """Return parameters (m,) and the largest rates du/dt (m,) there, from rest to rest."""
    import toppra  # noqa: PLC0415  (it imports matplotlib: only where it is used)
    from toppra.algorithm import TOPPRA  # noqa: PLC0415

    logging.getLogger('toppra').setLevel(logging.ERROR)
    kept, path = _constraints(toppra, leg, limits, bound), _path(toppra, leg)
    pieces = max(_PER_PIECE, -(-_PLACES // (leg.knots.size - 1)))
    places = np.append(leg.pieces(pieces)[0], leg.knots[-1])
    _, rates, _ = TOPPRA(kept, path, gridpoints=places).compute_parameterization(0, 0)
    if rates is None or not np.isfinite(rates).all() or not (rates[1:-1] > 0).all():
        raise InvalidTask('limits: no motion along the path was found that keeps them')
    rates[[0, -1]] = 0.0
    return places, rates


def _path(toppra: Any, leg: Leg) -> Any:
    """Return a Leg as a path of toppra."""

    class Path(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc]
        """Derivatives by the parameter: linear and angular, world axes."""

        dof, waypoints = 6, None
        path_interval = leg.knots[[0, -1]]

        def __call__(self, u: ArrayLike, order: int = 0) -> Floats:
            positions, _, first, second = leg.at(np.atleast_1d(u))
            return (np.hstack([positions, positions]), first, second)[order]

    return Path()


def _constraints(toppra: ModuleType, leg: Leg, limits: Limits,
                 bound: DeviationBound | None) -> list[Any]:
    """Return toppra's constraints for the Limits and, if there is one, for a DeviationBound."""

    class Constraint(toppra.constraint.LinearConstraint):  # type: ignore[misc, name-defined]
        """A function of the parameters u (n,) that returns _Parameters."""

        def __init__(self, at: Callable[[Floats], _Parameters]) -> None:
            super().__init__()
            self.at = at

        def get_dof(self) -> int:
            return 6

        def compute_constraint_params(self, _: Any, u: Floats, *__: Any, **___: Any) -> _Parameters:
            return self.at(u)

    finite = np.minimum(limits.sizes, _ENDLESS)
    kept = [Constraint(partial(_sizes, arm, slice(3 * k, 3 * k + 3), *finite[:2, k]))
            for arm in leg.all_arms for k in (0, 1)]
    return kept if bound is None else [*kept, Constraint(partial(_bounds, bound))]


def _sizes(leg: Leg, part: slice, speed: float, acceleration: float, u: Floats) -> _Parameters:
    """Return bounds of speed and acceleration of some coordinates, as the lengths of vectors."""
    first, second = (derivative[:, part] for derivative in leg.at(u)[2:])
    size = np.linalg.norm(first, axis=1)
    along = (first * second).sum(axis=1) / np.maximum(size, _STILL)
    across = np.sqrt(np.maximum((second**2).sum(axis=1) - along**2, 0))
    angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    sides = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    most = np.full((u.size, _CORNERS), acceleration * np.cos(np.pi / _CORNERS))
    fastest = np.minimum(speed / np.maximum(size, _STILL), _FASTEST) ** 2
    return _Parameters(np.stack([size, 0 * size], axis=1), np.stack([along, across], axis=1),
                       np.zeros((u.size, 2)), np.repeat(sides[None], u.size, axis=0), most, None,
                       np.stack([0 * fastest, fastest], axis=1))


def _bounds(bound: DeviationBound, u: Floats) -> _Parameters:
    """Return the bounds of a DeviationBound."""
    slopes, bends, most = (make_interp_spline(bound.parameters, known, k=1)(
        np.clip(u, *bound.parameters[[0, -1]]))
        for known in (bound.slopes, bound.bends, bound.most))
    both = np.eye(slopes.shape[1])
    sides = np.repeat(np.vstack([both, -both])[None], u.size, axis=0)
    return _Parameters(slopes, bends, 0 * slopes, sides, np.hstack([most, most]))
