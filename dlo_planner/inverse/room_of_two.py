# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Threading through two cut-outs with room in both, where no shape passes both centers.

As through one cut-out (`inverse.most_room`) all shapes that the DLO can come to are looked at, at
some depths in the first. Each is turned about the vertical so that it leads from the first center
to the second, and displaced so that both lose the same part of their room. Dynamic programming
finds the way; the shapes on it are followed, exact as any. The search takes the DLO for straight in
each hole; what counts is the clearance at the waypoints, which are judged as those of any plan.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dlo_planner.direct.shape import Shape, carried
from dlo_planner.direct.simulator import DirectSimulator
from dlo_planner.inverse.equilibria import headings_to
from dlo_planner.inverse.most_room import Passage, RoomSearch, planned_along, search_of
from dlo_planner.inverse.reachable import Reachable
from dlo_planner.inverse.route import Threading
from dlo_planner.model.arrays import Floats
from dlo_planner.plan.goals import Through
from dlo_planner.plan.margin import DEVIATIONS, rating, upright_room
from dlo_planner.plan.plan import Plan
from dlo_planner.plan.waypoint import Waypoint, waypoint_at

_BLEND = 0.25  # of the length: from there on a cut-out ahead counts
_CONE = 0.5    # by how much a DLO that aims at it may miss it, as a part of the way to it


def thread_two_with_room(simulator: DirectSimulator, task: Threading) -> Plan:
    """Return the Plan of a Threading through two cut-outs, whose centers may be missed.

    Both have a size, and room for an upright DLO. Infeasible: no way with room in both was found.
    """
    search = search_of(simulator, task)
    two, passed = _Two(search, task), task.holes(simulator.rod.length)
    length, (first, second) = simulator.rod.length, (one.center for one in task.cutouts)

    def waypoint(shape: Shape, depth: float) -> Waypoint:
        s = length - depth
        shape = carried(shape, first - shape.frame_at(s)[1])
        there, (off, _, _) = Through(second, s).nearest(shape)
        shape = carried(shape, -float(two.part * nearness(there - length, length)) * off)
        made, there = waypoint_at(shape, first, s, None), Through(second, s).passage(shape)
        return passed.passed(made.with_via_point(second, there) if there <= length else made)

    return planned_along(simulator, task, search.through(task, two.passages, 'both holes'),
                         waypoint)


def nearness(beyond: Floats | float, length: float) -> Floats:
    """Return how much cut-outs count that are so far beyond the free end of a DLO, m: 0 to 1."""
    share = np.clip(1 - np.asarray(beyond) / (_BLEND * length), 0, 1)
    counts: Floats = share**2 * (3 - 2 * share)
    return counts


class _Two:
    """How the shapes of a search pass the two cut-outs of a Threading."""

    def __init__(self, search: RoomSearch, task: Threading) -> None:
        self._search, (self._first, self._second) = search, task.cutouts
        self._chord = np.array(self._second.center - self._first.center)
        self._bound = task.demands.surface.bound
        self._rooms = np.array([upright_room(one, task.demands.surface) for one in task.cutouts])
        # The first takes this part of a miss: so both lose the same part of their room.
        self.part = float(self._rooms[0] / self._rooms.sum())

    def passages(self, shapes: Reachable) -> Iterator[Passage]:
        """Yield the Passage at each depth."""
        for s in (shapes.s[-1] - self._search.depths).tolist():
            self._search.demands.progress.check()
            yield self._passage(shapes, s)

    def _passage(self, shapes: Reachable, s: float) -> Passage:
        """Return the Passage of shapes that pass the first cut-out at s, m."""
        length, (begin, tangent) = float(shapes.s[-1]), shapes.hanging.at(s)
        there, at, along = _at_distance(shapes, s, begin, float(np.linalg.norm(self._chord)))
        turns = headings_to(at - begin, self._chord, shapes.up)
        which = np.repeat(np.arange(len(begin)), len(turns) // len(begin))
        chord, tangent, along = (np.einsum('kij,kj->ki', turns, one[which])
                                 for one in (at - begin, tangent, along))
        misses = self._chord - chord
        slide = np.einsum('ki,ki->k', misses, along)
        misses -= slide[:, None] * along  # across the DLO
        there = there[which] + slide
        beyond = np.maximum(there - length, 0.0)
        cosines = np.column_stack([tangent @ self._first.normal, along @ self._second.normal])
        rooms = cosines * (self._rooms + self._bound) - self._bound
        share = nearness(beyond, length)
        shift = self.part * share[:, None] * misses
        off = np.linalg.norm(misses, axis=1)
        # A DLO that has not come to the second aims at it, and may do so roughly.
        rooms[:, 1] += _CONE * beyond
        left = rooms - np.column_stack([self.part * share * off, (1 - self.part * share) * off])
        good = np.flatnonzero((rooms > 0).all(axis=1) & (left > 0).all(axis=1))
        which, turns, shift, there, left = (
            which[good], turns[good], shift[good], there[good], left[good])
        rated = np.column_stack([
            rating(left[:, k], left[:, k] - DEVIATIONS * self._search.misses_at(which, arcs),
                   float(self._rooms[k]))
            for k, arcs in enumerate((np.full(len(which), s), there))])
        aims = 1 - share[good] * (1 - left[:, 1] / rooms[good, 1])
        rated[:, 1] = np.where(there > length, aims, rated[:, 1])
        return Passage(which, turns @ shapes.frames[which, 0],
                       shift - np.einsum('kij,kj->ki', turns, begin[which]),
                       rated.min(axis=1)).best()


def _at_distance(shapes: Reachable, s: float, begin: Floats,
                 apart: float) -> tuple[Floats, Floats, Floats]:
    """Return where n shapes are first so far (m) from their places (n, 3) at s, m.

    Those are arc lengths (n,), places (n, 3), and tangents (n, 3); a DLO that ends before it is
    extended straight.
    """
    away = np.linalg.norm(shapes.positions - begin[:, None], axis=2)
    far = (away >= apart) & (shapes.s > s)
    k = np.where(far.any(axis=1), far.argmax(axis=1), shapes.s.size - 1)
    rows = np.arange(len(k))
    # on the line through the node, nearest at s + `foot` to the beginning
    places, tangents = shapes.positions[rows, k], shapes.frames[rows, k, :, 0]
    along = np.einsum('ki,ki->k', places - begin, tangents)
    aside = away[rows, k]**2 - along**2
    on = np.sqrt(np.maximum(apart**2 - aside, 0.0)) - along
    return shapes.s[k] + on, places + on[:, None] * tangents, tangents
