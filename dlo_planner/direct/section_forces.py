# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Forces and moments inside a DLO at rest, from what acts on it and how it is strained.

Where the DLO is cut at s, the part beyond exerts a force n and a moment m on the part before.
Balance of the part beyond gives both: n is the sum of the forces that act there, and back from
the tip m grows by dr x n and by the moments that act. A contact of a rectangular DLO is beside its
axis, and nobody says where: there m is that of the strains. Its mean over an element, along the
axes that turn with the DLO, is the moment of the element's strain, as the minimum of the potential
says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dlo_planner.direct.discretization import Discretization
from dlo_planner.energy.loads import node_masses
from dlo_planner.model.arrays import Floats, Ints
from dlo_planner.model.checks import figure, results
from dlo_planner.model.rod import BACK
from dlo_planner.model.value import brief, put
from dlo_planner.pictured import Reported

_SAME = 1e-9     # of the length: places that are nearer are one
_SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0


@dataclass(frozen=True, eq=False, repr=False)
class SectionForces(Reported):
    """Forces and moments inside a DLO along its length.

    Every place stands twice, as it is seen from before and from beyond: where a contact, a hold or
    a load acts the two differ. In between, forces and moments are smooth. All are what the part
    beyond the place exerts on the part before it, by the axes (t, n, b) of the frame there.

    Attributes
    ----------
    s : ndarray, shape (m,)
        Arc lengths in m, ascending, from 0 (just beyond the gripper) to L (just before the tip).
    force : ndarray, shape (m, 3)
        Tension (> 0 where the DLO is pulled) and the shear forces along n and b, N.
    moment : ndarray, shape (m, 3)
        Torque, and the bending moments about n and b, N m; each has the sign of its strain.
    imbalance : float
        Size in N of what all forces on the DLO together leave over; 0 at rest.
    """

    s: Floats
    force: Floats
    moment: Floats
    imbalance: float

    def __post_init__(self) -> None:
        s = results('SectionForces.s', self.s, (None,))
        put(self, s=s, imbalance=figure('SectionForces.imbalance', self.imbalance),
            **{name: results(f'SectionForces.{name}', getattr(self, name), (s.size, 3))
               for name in ('force', 'moment')})
        super().__post_init__()

    def __repr__(self) -> str:
        force, moment = (np.linalg.norm(one, axis=1).max(initial=0.0)
                         for one in (self.force, self.moment))
        return brief(self, f'{self.s.size} places', f'at most {force:.3g} N, {moment:.3g} N m')

    @property
    def tension(self) -> Floats:
        """(m,) N, > 0 where the DLO is pulled."""
        return self.force[:, 0]

    @property
    def shear(self) -> Floats:
        """(m, 2) N, along n and along b."""
        return self.force[:, 1:]

    @property
    def torque(self) -> Floats:
        """(m,) N m, about the tangent."""
        return self.moment[:, 0]

    @property
    def bending_moment(self) -> Floats:
        """(m, 2) N m, about n and about b."""
        return self.moment[:, 1:]

    def at_nodes(self, s: Floats) -> tuple[Floats, Floats]:
        """Return forces and moments (N + 1, 3) at nodes `s` (N + 1,): the mean of both sides."""
        both = []
        for values in (self.force, self.moment):
            before = values[np.minimum(np.searchsorted(self.s, s), self.s.size - 1)]
            beyond = values[np.maximum(np.searchsorted(self.s, s, side='right') - 1, 0)]
            both.append(0.5 * (before + beyond))
        return both[0], both[1]

    def joined(self, beyond: SectionForces, at: float) -> SectionForces:
        """Return those of a DLO whose part before s = `at` has these, its part beyond it others.

        Both parts begin where they are held, and the axes of this one head back.
        """
        return SectionForces(
            np.concatenate([at - self.s[::-1], at + beyond.s]),
            np.vstack([self.force[::-1] * BACK, beyond.force]),
            np.vstack([self.moment[::-1] * BACK, beyond.moment]),
            float(np.hypot(self.imbalance, beyond.imbalance)))


def section_forces(mesh: Discretization, frame_at: Callable[[float], tuple[Floats, Floats]],
                   gripper: Floats, acting: tuple[Floats, Floats],
                   bent: Floats | None) -> SectionForces:
    """Return the SectionForces of a shape at rest.

    Shapes: gripper (3,), its force on the DLO, N; acting (k,) and (k, 6), arc lengths in m and
    forces and moments of contacts and holds; bent (N, 3), strains of the elements since they bore
    no moment, 1/m, where these tell the moments. `frame_at` returns axes (3, 3) and position (3,)
    at an arc length.
    """
    rod, gravity, s = mesh.rod, mesh.surroundings.gravity, mesh.s
    points = node_masses(rod, s) - rod.node_masses(s)  # on the nodes around them
    on_nodes = np.hstack([-mesh.free.load.pull - points[:, None] * gravity, mesh.moments])
    carried = [*rod.point_masses, (rod.length, rod.tip_mass)]
    where = np.concatenate([s, _snapped(s, acting[0]),
                            _snapped(s, np.array([at for at, _ in carried]))])
    what = np.vstack([on_nodes, acting[1], [[*(mass * gravity), 0.0, 0.0, 0.0]
                                            for _, mass in carried]])

    ends = np.union1d(s, where)
    order = np.argsort(where, kind='stable')
    after = np.vstack([np.cumsum(what[order][::-1], axis=0)[::-1], np.zeros(6)])
    # what acts at the end of a piece or beyond it
    beyond = after[np.searchsorted(where[order], ends[:-1], side='right')]
    acts = beyond[:, :3]
    looks = np.sort(np.concatenate([ends, 0.5 * (ends[1:] + ends[:-1])]))
    frames, positions = (np.array(one) for one in zip(*map(frame_at, looks), strict=True))
    sides = [0, 1, 2] + 2 * np.arange(ends.size - 1)[:, None]  # of each piece, its middle between
    frames, positions = frames[sides], positions[sides]

    element: Ints = np.searchsorted(s, ends[:-1], side='right') - 1
    if bent is None:
        turns = np.cross(positions[:, 2] - positions[:, 0], acts)
        begin = np.cumsum(turns[::-1], axis=0)[::-1] + beyond[:, 3:]
        moments = np.stack([begin, begin - turns], axis=1)
    else:
        moments = _strained(element, np.diff(ends), frames, positions, acts,
                            mesh.free.stiffness * bent)
    force = np.repeat(acts[:, None], 2, axis=1)
    middles, lengths = 0.5 * (s[1:] + s[:-1]), np.diff(s)
    spread, load = rod.masses_per_length(middles)[:, None] * gravity, mesh.surroundings.load
    if load is not None:
        spread += np.array([load(at) for at in middles] if callable(load) else load, dtype=float)
    for side in (0, 1):  # nodes bear what is spread along the elements
        share = ((ends[side:ends.size - 1 + side] - s[element]) / lengths[element])[:, None]
        weight = lengths[element, None] * spread[element]
        force[:, side] += (0.5 - share) * weight
        arm = 0.5 * share * (1.0 - share) * lengths[element, None] * frames[:, 2 * side, :, 0]
        moments[:, side] -= np.cross(arm, weight)
    turned = frames[:, ::2]
    left = gripper + after[0, :3]
    return SectionForces(
        np.stack([ends[:-1], ends[1:]], axis=1).ravel(),
        np.einsum('jkmi,jkm->jki', turned, force).reshape(-1, 3),
        np.einsum('jkmi,jkm->jki', turned, moments).reshape(-1, 3), float(np.linalg.norm(left)))


def _snapped(s: Floats, places: Floats) -> Floats:
    """Return places (k,) in m, each that is next to a node of `s` (N + 1,) there."""
    beside = np.clip(np.searchsorted(s, places), 1, s.size - 1)
    nearest = np.where(places - s[beside - 1] < s[beside] - places, s[beside - 1], s[beside])
    result: Floats = np.where(np.abs(nearest - places) <= _SAME * s[-1], nearest, places)
    return result


def _strained(element: Ints, lengths: Floats, frames: Floats, positions: Floats, force: Floats,
              strained: Floats) -> Floats:
    """Return the moments (J, 2, 3) at both ends of J pieces, in each of which a force is constant.

    Shapes: element and lengths (J,), of the pieces; frames (J, 3, 3, 3) and positions (J, 3, 3) of
    begin, middle and end; force (J, 3) N; strained (N, 3), the moments of the elements' strains in
    the axes there, N m. All else by the world's axes.
    """
    count = len(strained)
    moved = positions - positions[:, :1]
    change = -np.cross(moved, force[:, None])  # of the moment since the piece began
    gained = np.cumsum(change[:, 2], axis=0) - change[:, 2]
    first = np.searchsorted(element, np.arange(count))
    change += (gained - gained[first][element])[:, None]  # since the element began
    weights = lengths[:, None] * _SIMPSON
    whole = np.bincount(element, lengths, count)
    mean, known = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(mean, element, np.einsum('jk,jkmi->jim', weights, frames))
    np.add.at(known, element, np.einsum('jk,jkmi,jkm->ji', weights, frames, change))
    begin = np.linalg.solve(mean, (whole[:, None] * strained - known)[:, :, None])[:, :, 0]
    result: Floats = begin[element][:, None] + change[:, ::2]
    return result
