# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Into a fitting by sight: how far a DLO that is seen misses a mouth, and what the gripper does.

A Route leads a DLO past each mouth at a standoff before it goes in. What is uncertain of the DLO,
as its stiffness, has it pass there elsewhere than planned, by more than the room of the mouth. The
points on it that a camera sees there tell by how much, and the DLO's sensitivity tells the motion
of the gripper that takes it away: there, and at each further waypoint of that entry the one for as
much. It differs, since the DLO is bowed above the mouth and nearly straight in it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.shape import Shape
from dlo_planner.inverse.aiming import part_led, straightness
from dlo_planner.inverse.tasks.route import Fitting, aim_at
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, instance, row

_BESIDE = 0.1    # of the length, before and behind the mouth: what is seen there tells
_PLACES = 401    # of the DLO there, among which the nearest one to a point is
_TERMS = 3       # of what is off along the DLO: it is even, turned and bent
_LEAST = 2 * _TERMS  # points that tell it
_PASSES = 3      # in which what is no point on the DLO is told
_OUTLIER = 4.0   # times the median: what is farther off is none


class SeenMiss(NamedTuple):
    """By how much a DLO is seen to pass a mouth elsewhere than planned, aside and out of it, m."""

    miss: Floats   # (2,)
    error: Floats  # (2,) standard deviations, of errors of the points that are independent


def seen_miss(shape: Shape, fitting: Fitting, points: ArrayLike) -> SeenMiss:
    """Return the SeenMiss of a DLO before the mouth of a fitting.

    Parameters
    ----------
    shape : Shape
        As the DLO is planned to be there.
    fitting : Fitting
        Clip, Fork or Peg that the DLO is about to go into.
    points : array_like, shape (n, 3)
        Points on the DLO that are seen while the gripper stands, m, world axes, in any order, those
        of several images together. What is far from all others is left out.

    Returns
    -------
    SeenMiss
        Its error is infinite where too few points near the mouth are seen.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    instance('shape', shape, Shape)
    instance('fitting', fitting, Fitting)
    seen = array('points', points, (None, 3))
    level, beside = aim_at(fitting).level(shape), _BESIDE * float(shape.s[-1])
    s = np.linspace(max(level - beside, 0.0), min(level + beside, part_led(shape)), _PLACES)
    places = shape.positions_at(s)
    tangents = np.gradient(places, s, axis=0)
    nearest = np.linalg.norm(seen[:, None] - places, axis=2).argmin(axis=1)
    inside = (nearest > 0) & (nearest < _PLACES - 1)
    seen, nearest = seen[inside], nearest[inside]
    off, along = seen - places[nearest], tangents[nearest]
    off = (off - (off * along).sum(axis=1)[:, None] * along) @ aim_at(fitting).places.T
    powers = ((s[nearest] - level) / beside)[:, None] ** np.arange(_TERMS)
    rest = off - np.median(off, axis=0) if len(off) else off
    for _ in range(_PASSES):
        sizes = np.linalg.norm(rest, axis=1)
        kept = sizes <= _OUTLIER * np.median(sizes) if sizes.size else sizes > 0
        if kept.sum() < _LEAST:
            return SeenMiss(np.full(2, np.nan), np.full(2, np.inf))
        fitted = np.linalg.lstsq(powers[kept], off[kept], rcond=None)[0]
        rest = off - powers @ fitted
    variance = (rest[kept]**2).sum(axis=0) / (kept.sum() - _TERMS)
    share = np.linalg.pinv(powers[kept].T @ powers[kept])[0, 0]
    return SeenMiss(fitted[0], np.sqrt(variance * share))


def centered(shape: Shape, fitting: Fitting, miss: ArrayLike) -> Floats:
    """Return the twist (6,) of the gripper that takes a miss away, rad and m, world axes.

    What was seen above a mouth, summed over all looks, is taken away at each waypoint from there to
    the seat, by the twist for its own shape, and smoothly between: one twist for all of them would
    be three times too much where the DLO is drawn straight.

    To first order, about the gripper's own origin, rotation before displacement: it is as far from
    what holds the DLO next to it as before.

    Parameters
    ----------
    shape : Shape
        As the DLO is planned to be there.
    fitting : Fitting
        Clip, Fork or Peg that the DLO is about to go into.
    miss : array_like, shape (2,)
        As of a SeenMiss, or the sum of several, m.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """
    instance('shape', shape, Shape)
    instance('fitting', fitting, Fitting)
    rows = row('miss', miss, least=2, most=2) / shape.s[-1]
    return aim_at(fitting).step(shape, rows, straightness(shape))
