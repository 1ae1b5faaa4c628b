# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a DLO pierces the plane of a cut-out."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.model.arrays import Floats
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import Value


@dataclass(frozen=True, eq=False, repr=False)
class Passage(Value):
    """Where a DLO pierces the plane of a cut-out.

    Attributes
    ----------
    depth : float
        Arc length beyond the plane, m; 0: the DLO does not pierce it.
    miss : float
        Largest distance from the center at which the DLO pierces the plane, m; nan if it does not.
    y, z : float
        Coordinates of that point in the axes of the cut-out, m.
    """

    depth: float
    miss: float
    y: float
    z: float


def passage_of(cutout: CutOut, s: Floats, places: Floats) -> Passage:
    """Return the Passage of a line through a CutOut.

    Shapes: s (n,), places (n, 3).
    """
    local = (places - cutout.center) @ cutout.pose.rotation
    before, after = local[:-1], local[1:]
    pierced = np.flatnonzero((before[:, 0] < 0) != (after[:, 0] < 0))
    if not pierced.size:
        return Passage(0.0, np.nan, np.nan, np.nan)
    before, after = before[pierced], after[pierced]
    part = (before[:, 0] / (before[:, 0] - after[:, 0]))[:, None]
    places = (before + part * (after - before))[:, 1:]
    misses = np.linalg.norm(places, axis=1)
    first = s[pierced[0]] + part[0, 0] * (s[1] - s[0])
    worst = misses.argmax()
    return Passage(float(s[-1] - first), float(misses[worst]), *map(float, places[worst]))


def between(places: Floats, tangents: Floats, scaled: Floats, cell: float) -> Floats:
    """Return places on the cubic curve through nodes with unit tangents.

    Shapes: places, tangents (n + 1, 3), scaled (k,).
    """
    k = np.minimum(scaled.astype(int), len(places) - 2)
    x = (scaled - k)[:, None]
    curve: Floats = (
        places[k] * (1 - x) ** 2 * (1 + 2 * x) + places[k + 1] * x**2 * (3 - 2 * x)
        + cell * x * (1 - x) * (tangents[k] * (1 - x) - tangents[k + 1] * x))
    return curve
