# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""By how much an estimated DLO will miss the centers of a plan, and how certain that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number, results, row
from dlo_planner.model.value import Value, brief, put

_MOST = 1_000_000  # largest index of a waypoint
_SHARE = 0.95     # probability that a bound is kept
_POINTS = 1024    # that represent a normal distribution in a plane
_DRAWN = 4096     # misses at all waypoints together


@dataclass(frozen=True, eq=False, repr=False)
class PredictedMiss(Value):
    """Misses at waypoints of a plan: by how much the DLO passes beside k centers.

    Attributes
    ----------
    waypoints : ndarray, shape (k,)
        Indices of the waypoints in the plan, once for each center that one passes.
    off : ndarray, shape (k, 3)
        Vectors in m from the center to where the estimated DLO is nearest to it, world axes; a DLO
        that is too short is extended straight on.
    joint : ndarray, shape (3 k, 3 k)
        Covariance of all of `off` across the DLO, m^2: waypoint by waypoint, in each x, y, z.
    bound : ndarray, shape (k,)
        Radii about the center inside which the DLO passes with a probability of 95 %, m; infinite
        where no shape was found.
    """

    waypoints: Floats
    off: Floats
    joint: Floats
    bound: Floats

    def __post_init__(self) -> None:
        waypoints = row('PredictedMiss.waypoints', self.waypoints, least=0, minimum=0,
                        maximum=_MOST)
        parts = {name: results(f'PredictedMiss.{name}', getattr(self, name), shape)
                 for name, shape in (('off', (None, 3)), ('joint', (None, None)),
                                     ('bound', (None,)))}
        for name, count in (('off', 1), ('joint', 3), ('bound', 1)):
            if {*parts[name].shape[:2 if name == 'joint' else 1]} != {count * waypoints.size}:
                raise InvalidTask(f'PredictedMiss.{name} has shape {parts[name].shape}, '
                                  f'PredictedMiss.waypoints {waypoints.size} entries: expected '
                                  f'{count} for each')
        put(self, waypoints=waypoints.astype(int), **parts)
        super().__post_init__()

    def __repr__(self) -> str:
        worst = self.bound.max(initial=0.0)
        return brief(self, f'{np.unique(self.waypoints).size} waypoints',
                     f'most likely up to {self.distance.max(initial=0.0):.2g} m',
                     f'with 95 % up to {worst:.2g} m')

    @property
    def distance(self) -> Floats:
        """Most likely distances (k,) from the centers, m."""
        result: Floats = np.linalg.norm(self.off, axis=1)
        return result

    @property
    def covariance(self) -> Floats:
        """Covariances (k, 3, 3) of `off`, m^2."""
        k = np.arange(self.waypoints.size)
        return self.joint.reshape(k.size, 3, k.size, 3)[k, :, k]

    @property
    def together(self) -> float:
        """Radius inside which the DLO passes all centers at all waypoints with 95 %, m.

        The quantile of the largest miss of 4096 draws from the normal distribution of all, always
        the same; their share of 95 % is right to 0.4 %.
        """
        if not self.bound.size:
            return 0.0
        if not np.isfinite(self.bound).all():
            return float('inf')
        values, vectors = np.linalg.eigh(self.joint)
        drawn = np.random.default_rng(0).standard_normal((_DRAWN, values.size)) * np.sqrt(
            np.maximum(values, 0.0)) @ vectors.T + self.off.ravel()
        misses = np.linalg.norm(drawn.reshape(_DRAWN, -1, 3), axis=2).max(axis=1)
        return float(np.quantile(misses, _SHARE))

    def inside(self, room: float) -> bool:
        """Return whether every bound is at most `room` (m)."""
        room = number('room', room, minimum=0)
        return bool((self.bound <= room).all())


def bound_of(off: Floats, covariance: Floats) -> float:
    """Return the radius about a center that holds 95 % of a normal distribution in a plane."""
    values, vectors = np.linalg.eigh(covariance)
    points = off + _PLANE * np.sqrt(np.maximum(values, 0.0)) @ vectors.T  # all equally likely
    return float(np.quantile(np.linalg.norm(points, axis=1), _SHARE))


def _plane() -> Floats:
    """Return points (k, 2), equally likely, of a standard normal distribution in a plane.

    On a spiral in steps of the golden angle: radii and directions are evenly likely.
    """
    k = np.arange(_POINTS)
    radii = np.sqrt(-2 * np.log1p(-(k + 0.5) / _POINTS))
    angles = np.pi * (3 - np.sqrt(5)) * k
    result: Floats = radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return result


_PLANE = _plane()
