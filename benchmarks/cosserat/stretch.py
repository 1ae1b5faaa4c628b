# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a cord is stretched: which arc length of the stretched one was which of the unstretched.

The package's DLO does not stretch. One that does is found by turns: a shape gives the tension, the
tension a stretched DLO of the same mass and the same moments, which gives a shape. What stays the
same in all turns is an extensible Kirchhoff rod: EI and GJ are moment per angle per unstretched
length, so per stretched length they are 1 + e times as large, and mass per length 1 + e times as
small, in each element.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.varying import Table, stepwise

_NEGLIGIBLE = 1e-6  # strains: what they displace is less than this part of the length


@dataclass(frozen=True, eq=False)
class Stretch:
    """Axial strains along a cord.

    Attributes
    ----------
    free, stretched : ndarray, shape (n + 1,)
        Arc lengths of the same nodes, m.
    strains : ndarray, shape (n,)
        Strains between them.
    """

    free: Floats
    stretched: Floats
    strains: Floats

    @classmethod
    def none(cls, length: float) -> 'Stretch':
        """Return that of a cord without tension."""
        ends = np.array([0.0, length])
        return cls(ends, ends, np.zeros(1))

    @classmethod
    def along(cls, free: Floats, strains: Floats) -> 'Stretch':
        """Return that of strains (n,) between nodes at unstretched arc lengths (n + 1,), m."""
        stretched = np.concatenate([[0.0], np.cumsum(np.diff(free) * (1 + strains))])
        return cls(free, stretched, strains)

    @property
    def length(self) -> float:
        """m, stretched."""
        return float(self.stretched[-1])

    @property
    def any(self) -> bool:
        """Whether there is any that counts."""
        return bool(np.abs(self.strains).max() > _NEGLIGIBLE)

    def to_stretched(self, s: ArrayLike) -> Floats:
        """Return stretched arc lengths of unstretched ones, m."""
        result: Floats = np.interp(np.asarray(s, dtype=float), self.free, self.stretched)
        return result

    def to_free(self, s: ArrayLike) -> Floats:
        """Return unstretched arc lengths of stretched ones, m."""
        result: Floats = np.interp(np.asarray(s, dtype=float), self.stretched, self.free)
        return result

    def change(self, other: 'Stretch') -> float:
        """Return the largest difference of strain to another one."""
        middle = 0.5 * (self.free[1:] + self.free[:-1])
        where = np.searchsorted(other.free, middle) - 1
        return float(np.abs(self.strains - other.strains[where]).max())

    def times(self, value: float, power: int) -> 'Table | float':
        """Return value (1 + strain)^power along the stretched cord, a number without strain."""
        return stepwise(self.stretched, value * (1 + self.strains) ** power) if self.any else value
