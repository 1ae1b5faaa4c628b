# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""The cut-outs that a capability map asks about."""

from dataclasses import dataclass

import numpy as np

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, integer, row
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, brief, put

_MOST = 1_000_000_000  # cut-outs


@dataclass(frozen=True, eq=False, repr=False)
class CellGrid(Value):
    """Round cut-outs of a cell: all combinations of P positions, D directions and R radii.

    Attributes
    ----------
    positions : ndarray, shape (P, 3)
        Positions in m, of the centers, in any order.
    directions : ndarray, shape (D, 3)
        In which the free end travels through, of any length but zero.
    radii : ndarray, shape (R,)
        Radii in m.

    Raises
    ------
    InvalidTask
        An array makes no sense; the message names it.
    """

    positions: Floats
    directions: Floats
    radii: Floats

    def __post_init__(self) -> None:
        directions = array('CellGrid.directions', self.directions, (None, 3))
        size = np.abs(directions).max(axis=1, keepdims=True)
        if (size == 0).any():
            raise InvalidTask(f'CellGrid.directions[{int(np.argmin(size))}] = 0: expected a vector '
                              'that is not zero')
        directions = directions / size
        put(self, positions=array('CellGrid.positions', self.positions, (None, 3)),
            directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
            radii=row('CellGrid.radii', self.radii, above=0))
        if len(self) > _MOST:
            raise InvalidTask(f'CellGrid.positions: expected at most {_MOST} cut-outs in all, got '
                              f'{len(self)}')
        super().__post_init__()

    def __len__(self) -> int:
        return int(np.prod([int(size) for size in self.shape]))

    def __repr__(self) -> str:
        return brief(self, '{} positions, {} directions, {} radii'.format(*self.shape))

    @property
    def shape(self) -> tuple[int, int, int]:
        """(P, D, R)."""
        return len(self.positions), len(self.directions), self.radii.size

    def cutout(self, index: int) -> CutOut:
        """Return one CutOut: radii change first with the index, then directions, then positions.

        Raises
        ------
        InvalidTask
            There is no such index.
        """
        index = integer('index', index, minimum=0, maximum=len(self) - 1)
        p, d, r = np.unravel_index(index, self.shape)
        return CutOut(Pose.looking_along(self.positions[p], self.directions[d]),
                      radius=float(self.radii[r]))
