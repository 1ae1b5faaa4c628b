# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a DLO carries from one step to the next: what the terms of its potential have left.

ACTING lists the terms, those of `energy.terms` that simulators offer. One that depends on how the
DLO is held, leaves something to the next step or is reported is a Part in `terms` or a file of its
own, and a line in ACTING.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from dlo_planner.direct.contact import Touch
from dlo_planner.direct.surroundings import Surroundings
from dlo_planner.direct.terms import FarHold, Held, Left, Part, PermanentSet, Solved, filed
from dlo_planner.energy.inertia import InertiaTerm, no_inertia
from dlo_planner.energy.loads import Load
from dlo_planner.energy.plastic import elastic_part
from dlo_planner.energy.terms import TERMS, Terms
from dlo_planner.errors import InvalidTask
from dlo_planner.geometry.record import Record
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import row, shown
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import FrozenDict, Value, freeze, owned, put, same

if TYPE_CHECKING:
    from dlo_planner.direct.discretization import Discretization

class Inertia(Part):
    """Inertia, `energy.inertia`, which `direct.integrator` brings; at rest there is none."""

    name = 'anchor'
    rests = True

    def record(self, mesh: Discretization, left: Left, held: Held) -> InertiaTerm:
        """Return the InertiaTerm of a DLO at rest."""
        return no_inertia()


ACTING: tuple[Part, ...] = (PermanentSet(), Inertia(), FarHold(), Touch())


def always(rod: Rod, pull: Floats) -> Terms:
    """Return the Terms that act on every DLO: elasticity, and loads whose `pull` (N + 1, 3)."""
    known = {'elastic': elastic_part(rod), 'load': Load(pull)}
    return Terms(*[known.get(name) for name in TERMS])


def others(mesh: Discretization, left: Left) -> dict[str, Record | None]:
    """Return all others by their names, without a past: empty where there is no such thing."""
    return {part.name: part.record(mesh, left, Held()) for part in ACTING if part.name in TERMS}


def changing(mesh: Discretization, held: Held) -> list[Part]:
    """Return those that depend on what is left and how the DLO is held there."""
    return [part for part in ACTING if part.changes(mesh, held)]


_SAME = 1e-9  # of the length
_NOWHERE = np.zeros((0, 3))


@dataclass(frozen=True, eq=False, repr=False)
class Memory(Value):
    """The past of a Shape, as far as the next step depends on it.

    Attributes
    ----------
    s : ndarray, shape (N + 1,)
        Arc lengths of the nodes of its mesh, m.
    left : dict
        Arrays by name: what each of `direct.memory.ACTING` left.
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
        if not isinstance(self.left, FrozenDict):  # which holds what nobody else can change
            put(self, left=FrozenDict({name: owned(np.asarray(one))
                                       for name, one in self.left.items()}))
        put(self, s=owned(self.s), positions=owned(self.positions), tangents=owned(self.tangents))

    @classmethod
    def empty(cls, mesh: Discretization) -> Memory:
        """Return the past, on a mesh, of a DLO that has none."""
        left = {name: array for part in ACTING for name, array in part.empty(mesh, mesh.s).items()}
        freeze(left)
        return cls(mesh.s, FrozenDict(left), _NOWHERE, _NOWHERE, mesh.surroundings)

    @classmethod
    def after(cls, solved: Solved, positions: Floats, tangents: Floats) -> Memory:
        """Return the past of a DLO after a step, with its nodes' positions and tangents then."""
        left = {name: array for part in ACTING for name, array in part.leaves(solved).items()}
        return cls(solved.mesh.s, left, positions, tangents, solved.mesh.surroundings)

    def judged(self, length: float) -> Memory:
        """Return the same past, from a file, if it can be of a DLO of that length, m."""
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

    def followed(self, positions: Floats, tangents: Floats, **left: Any) -> Memory:
        """Return the past after a step that left nothing else than arrays of some names."""
        freeze((positions, tangents, left))
        after = FrozenDict({**self.left, **left}) if left else self.left
        return Memory(self.s, after, positions, tangents, self.of)

    def leaving(self, **left: Any) -> Memory:
        """Return the same past with other arrays of some names in `left`."""
        return replace(self, left={**self.left, **left})

    def underway(self, solved: Solved) -> Memory:
        """Return the same past with the forces in the middle of a step."""
        return self.leaving(**{name: array for part in ACTING
                               for name, array in part.underway(solved).items()})

    def resampled(self, s: Floats) -> Memory:
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

    def with_contacts(self, later: Memory) -> Memory:
        """Return the same past with the forces of contacts and grips after the step."""
        return self.leaving(**{name: array for part in ACTING
                               for name,
                               array in part.with_contacts(self.left, later.left).items()})

    def with_forces(self, other: Memory) -> Memory:
        """Return the same past with all of another one but what belongs to the rod."""
        return self.leaving(**{name: other.left[name] for part in ACTING if not part.of_rod
                               for name in part.cleared(other.left)})

    def lasting(self) -> Memory:
        """Return what belongs to the rod: no forces, and not the way so far."""
        none = np.zeros((0, 3))
        cleared = self.leaving(**{name: array for part in ACTING if not part.of_rod
                                  for name, array in part.cleared(self.left).items()})
        return replace(cleared, positions=none, tangents=none)

    @property
    def lasts(self) -> bool:
        """Whether the DLO is for good another one than it was made."""
        return any(part.lasts(self.left) for part in ACTING)


def past_on(mesh: Discretization, history: Memory | None, own: Memory | None = None) -> Memory:
    """Return `history` on a mesh, as far as it belongs to the DLO there.

    What an effect left for good belongs to a rod; contacts and grips to a rod and all that acts on
    it: all by value. What does not belong there is forgotten.
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


def _suits(history: Memory, mesh: Discretization) -> bool:
    """Whether what was left for good can be this rod's: its own, or of a rod that is not known."""
    return (all(part.fits(history.left, mesh.start.left) for part in ACTING if part.of_rod)
            and (history.of is None or same(history.of.rod, mesh.rod)))
