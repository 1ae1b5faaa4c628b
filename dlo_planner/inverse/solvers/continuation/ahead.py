# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Passings of a threading that are found many in one call, as long as nothing is in doubt."""

from dlo_planner.inverse.solvers.conditions import Aligned
from dlo_planner.inverse.solvers.continuation.following import Passing
from dlo_planner.model.arrays import Floats

_AT_ONCE = 32  # that are found in one call
_LATER = 8     # depths until that is tried again, where one was in doubt


class Ahead:
    """What `Aligned.onward` finds at one depth after another.

    Parameters
    ----------
    aligned : Aligned
    depths : ndarray, shape (n,)
        All depths in order, m.
    """

    def __init__(self, aligned: Aligned, depths: Floats) -> None:
        self._aligned, self._depths = aligned, depths
        self._ready: list[Passing] = []  # the next ones, the last first
        self._doubtful = 0  # where more are looked for

    def passing(self, before: Passing, index: int) -> Passing | None:
        """Return the Passing at the depth of an index; None: it has to be looked for by itself."""
        if not self._ready and index >= self._doubtful:
            ahead = self._depths[index:index + _AT_ONCE]
            self._ready = self._aligned.onward(before, ahead)[::-1]
            self._doubtful = index + max(len(self._ready), _LATER)
        return self._ready.pop() if self._ready else None
