# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO carries from one step to the next: what the effects on it have left."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from dlo_planner.direct.acting import ACTING
from dlo_planner.direct.part import Left, Solved, filed
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import row, shown
from dlo_planner.model.value import FrozenDict, Value, put, same

if TYPE_CHECKING:  # it imports this file
    from dlo_planner.direct.discretization import Discretization

_SAME = 1e-9  # of the length
_NOWHERE = np.zeros((0, 3))


@dataclass(frozen=True, eq=False, repr=False)
class History(Value):
    """The past of a Shape, as far as the next step depends on it.

    Attributes
    ----------
    s : ndarray, shape (N + 1,)
        Arc lengths of the nodes of its mesh, m.
    left : dict
        Arrays by name: what each of `direct.acting.ACTING` left.
    positions : ndarray, shape (N + 1, 3)
        Positions of the nodes at the end of it, m; (0, 3) without a step so far.
    tangents : ndarray, shape (N + 1, 3)
        Tangents of the nodes at the end of it; (0, 3) without a step so far.
    of : Surroundings or None
        Surroundings in which it happened. If None, not known, as of a shape from a file.
    """

    s: Floats
    left: Left
    positions: Floats
    tangents: Floats
    of: Surroundings | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.left, FrozenDict):
            put(self, left=FrozenDict({name: np.asarray(one) for name, one in self.left.items()}))
        super().__post_init__()

    @classmethod
    def empty(cls, mesh: Discretization) -> History:
        """Return the past, on a mesh, of a DLO that has none."""
        left = {name: array for part in ACTING for name, array in part.empty(mesh, mesh.s).items()}
        return cls._of(mesh.s, left, (_NOWHERE, _NOWHERE), mesh.surroundings)

    @classmethod
    def _of(cls, s: Floats, left: Left, way: tuple[Floats, Floats],
            of: Surroundings | None) -> History:
        """Return a History of arrays as parts make them: quicker, nothing is to be judged."""
        history = object.__new__(cls)
        for content in (s, *way, *left.values()):
            content.flags.writeable = False
        put(history, s=s, left=FrozenDict(left), positions=way[0], tangents=way[1], of=of)
        return history

    @classmethod
    def after(cls, solved: Solved, positions: Floats, tangents: Floats) -> History:
        """Return the past of a DLO after a step, with its nodes' positions and tangents then."""
        left = {name: array for part in ACTING for name, array in part.leaves(solved).items()}
        return cls(solved.mesh.s, left, positions, tangents, solved.mesh.surroundings)

    def judged(self, length: float) -> History:
        """Return the same past, from a file, if it can be of a DLO of that length, m.

        Raises
        ------
        InvalidTask
            Naming an array that cannot be.
        """
        s = row('past_s', self.s, least=2, minimum=0)
        if s[0] != 0 or (np.diff(s) <= 0).any() or abs(s[-1] - length) > _SAME * length:
            raise InvalidTask(f'past_s = {shown(s.tolist())}: expected arc lengths that grow from '
                              f'0 to {length:g}')
        left = {name: filed(self.left, name, np.shape(one)) for name, one in self.left.items()}
        for part in ACTING:
            left |= part.judged(self.left, s.size)
        size = (s.size if len(self.positions) else 0, 3)
        way = {name: filed({name: getattr(self, name)}, name, size)
               for name in ('positions', 'tangents')}
        return replace(self, s=s, left=left, **way)

    def followed(self, positions: Floats, tangents: Floats, **left: Any) -> History:
        """Return the past after a step that left nothing else than arrays of some names."""
        if left:
            return History._of(self.s, {**self.left, **left}, (positions, tangents), self.of)
        after = object.__new__(History)
        positions.flags.writeable = tangents.flags.writeable = False
        put(after, s=self.s, left=self.left, positions=positions, tangents=tangents, of=self.of)
        return after

    def leaving(self, **left: Any) -> History:
        """Return the same past with other arrays of some names in `left`."""
        return replace(self, left={**self.left, **left})

    def underway(self, solved: Solved) -> History:
        """Return the same past with the forces in the middle of a step."""
        return self.leaving(**{name: array for part in ACTING
                               for name, array in part.underway(solved).items()})

    def resampled(self, s: Floats) -> History:
        """Return the same past on another mesh `s` (n + 1,), m."""
        if s is self.s or np.array_equal(s, self.s):
            return self
        positions, tangents = self.positions, self.tangents
        if len(positions):
            curve = scipy.interpolate.CubicHermiteSpline(self.s, positions, tangents)
            positions, tangents = curve(s), curve(s, 1)
        moved = self.leaving(**{name: array for part in ACTING
                                for name, array in part.resampled(self.left, self.s, s).items()})
        return replace(moved, s=s, positions=positions, tangents=tangents)

    def with_contacts(self, later: History) -> History:
        """Return the same past with the forces of contacts and grips after the step."""
        return self.leaving(**{name: array for part in ACTING
                               for name,
                               array in part.with_contacts(self.left, later.left).items()})

    def with_forces(self, other: History) -> History:
        """Return the same past with all of another one but what belongs to the rod."""
        return self.leaving(**{name: other.left[name] for part in ACTING if not part.of_rod
                               for name in part.cleared(other.left)})

    def lasting(self) -> History:
        """Return what belongs to the rod: no forces, and not the way so far."""
        none = np.zeros((0, 3))
        cleared = self.leaving(**{name: array for part in ACTING if not part.of_rod
                                  for name, array in part.cleared(self.left).items()})
        return replace(cleared, positions=none, tangents=none)

    @property
    def lasts(self) -> bool:
        """Whether the DLO is for good another one than it was made."""
        return any(part.lasts(self.left) for part in ACTING)


def past_on(mesh: Discretization, history: History | None, own: History | None = None) -> History:
    """Return `history` on a mesh, as far as it belongs to the DLO there.

    What an effect left for good belongs to a rod; contacts and grips to a rod and all that acts on
    it: all by value. What does not belong there is forgotten.

    Parameters
    ----------
    mesh : Discretization
    history : History or None
    own : History or None, optional
        History that counts if `history` is None or of another rod. If None, no past.
    """
    if history is not None and history.of is mesh.surroundings and history.s is mesh.s:
        return history  # most steps: the one before was made here
    if history is None or not _suits(history, mesh):
        history = own
    if history is None or not _suits(history, mesh):
        return mesh.start
    known = history.of is None or same(history.of, mesh.surroundings)
    fits = [part.fits(history.left, mesh.start.left) for part in ACTING]
    if not (known and all(fits)):
        history = history.lasting().leaving(**{
            name: array for part, good in zip(ACTING, fits, strict=True) if not good
            for name, array in part.empty(mesh, history.s).items()})
    return history.resampled(mesh.s)


def _suits(history: History, mesh: Discretization) -> bool:
    """Whether what was left for good can be this rod's: its own, or of a rod that is not known."""
    return (all(part.fits(history.left, mesh.start.left) for part in ACTING if part.of_rod)
            and (history.of is None or same(history.of.rod, mesh.rod)))
