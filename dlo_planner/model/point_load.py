# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A dead load at one point of a DLO."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import number, vector
from dlo_planner.model.value import Value, put


@dataclass(frozen=True, eq=False, repr=False)
class PointLoad(Value):
    """A force and a moment of constant size and direction at a point of the DLO.

    Attributes
    ----------
    force : ndarray, shape (3,)
        Force in N, world axes.
    moment : ndarray, shape (3,)
        Moment in N m, world axes.
    s : float or None
        Arc length of the point, m. If None, the tip.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    force: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]  # an array from then on
    moment: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    s: float | None = None

    if TYPE_CHECKING:  # what may be given
        def __init__(self, force: ArrayLike = (0.0, 0.0, 0.0), moment: ArrayLike = (0.0, 0.0, 0.0),
                     s: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, force=vector('PointLoad.force', self.force, 3),
            moment=vector('PointLoad.moment', self.moment, 3))
        if self.s is not None:
            put(self, s=number('PointLoad.s', self.s, minimum=0))
        super().__post_init__()
