# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What holds a DLO beside its gripper: where, how, and whether the DLO spans from each to the next.

Holds go by arc length from the gripper on. What lies between two neighbors is a span; the last one
may end free.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import choice, instance, items, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put, same

GRIPS = ('clamped', 'pinned', 'sleeve', 'aligned')
RINGS = {'ring': 'pinned', 'tube': 'aligned'}  # the DLO goes through; how they hold it where it is
FIXTURE = 'fixture'
BORE = 'bore'  # what holds at the mouth of a bore
_SLACK = 1e-9  # of the length
_APART = 1e-6  # of the length: the least distance of two holds, as what is between is an element
_TIP = 1e-9    # of the length: what is nearer to the tip is there
_PARALLEL = 1e-9  # rad: axes of sleeves that differ by less are parallel
_SHARES = {'pinned': (0.0, 0.0, 0.0), 'aligned': (1.0, 0.0, 0.0)}
_SHARES |= {ring: _SHARES[grip] for ring, grip in RINGS.items()}
_ROWS = {'clamped': 6, 'pinned': 3, 'sleeve': 5, 'aligned': 5}
_ROWS |= {ring: _ROWS[grip] for ring, grip in RINGS.items()}
_ALL = np.eye(6)
_ALL_GRIPS = (*GRIPS, *RINGS)


@dataclass(frozen=True, eq=False, repr=False)
class Hold(Value):
    """What holds one place of a DLO beside its gripper: a clip, a clamp, a second gripper.

    Attributes
    ----------
    pose : Pose
        Pose of the DLO's frame there (x axis = tangent); only its position counts if pinned, or in
        a ring.
    grip : str
        'clamped': position and orientation; 'pinned': position; 'sleeve': clamped, but free to
        slide along the pose's x axis; 'aligned': position and tangent, free to turn about its
        tangent. Through two others the DLO slides: 'ring' holds its position, 'tube' its position
        and tangent, as 'pinned' and 'aligned' do, at whatever place is in it.
    s : float or None
        Arc length of the place, m. If None, the tip. It is a place of the DLO, which may move with
        it along a sleeve. Of a ring or tube it is the place that is in it now: that of the shape
        before, where this has the same one (the same `by` and pose, else the next of that name).
    slip : float
        Of a ring or tube: the friction along the DLO, N, that holds it where it is; it slides where
        more would be needed. 0: it slides freely.
    by : str
        What holds there, as messages and pictures name it.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    pose: Pose
    grip: str = 'clamped'
    s: float | None = None
    slip: float = 0.0
    by: str = field(default=FIXTURE, kw_only=True)

    if TYPE_CHECKING:  # an integer is a number, too
        def __init__(self, pose: Pose, grip: str = 'clamped', s: float | None = None,
                     slip: float = 0.0, *, by: str = FIXTURE) -> None: ...

    def __post_init__(self) -> None:
        name = type(self).__name__
        instance(f'{name}.pose', self.pose, Pose)
        choice(f'{name}.grip', self.grip, _ALL_GRIPS)
        if self.s is not None:
            put(self, s=number(f'{name}.s', self.s, above=0))
        if not (isinstance(self.slip, float) and self.slip == 0.0):  # hardly ever
            put(self, slip=number(f'{name}.slip', self.slip, minimum=0, unit='N'))
            if self.slip and not self.is_ring:
                raise InvalidTask(f'{name}.slip = {self.slip:g}: expected 0 with grip = '
                                  f'{self.grip!r}, which holds a place; what slides is a '
                                  f'{" or ".join(RINGS)}')
        if self.is_ring and self.s is None:
            raise InvalidTask(f'{name}.s = None: expected the place that is in the {self.grip} at '
                              'first, m; a tip does not slide through')
        if self.by is not FIXTURE:  # nearly always
            instance(f'{name}.by', self.by, str)
        super().__post_init__()

    @property
    def held(self) -> Floats:
        """Unit vectors (K, 6) of rotation, then of displacement, that the grip does not allow."""
        return held_rows(self.grip, self.pose.rotation)

    @property
    def share(self) -> Floats:
        """Weights (3,) of the frame's axes in its rotation; 0 for an axis that is free."""
        return np.array(_SHARES.get(self.grip, (0.5, 0.5, 0.5)))

    @cached_property
    def slides(self) -> bool:
        """Whether it lets the DLO's place move along its x axis."""
        return self.grip == 'sleeve'

    @cached_property
    def is_ring(self) -> bool:
        """Whether the DLO slides through it."""
        return self.grip in RINGS

    @property
    def stuck(self) -> Hold:
        """What holds the place that is in a ring now, as if it did not slide; else itself."""
        return Hold(self.pose, RINGS[self.grip], self.s, by=self.by) if self.is_ring else self

    def at_place(self, s: float) -> Hold:
        """Return the same ring with another place in it, m."""
        return Hold(self.pose, self.grip, s, self.slip, by=self.by)


@dataclass(frozen=True, eq=False, repr=False)
class FarEnd(Hold):
    """A second grip that holds the far end of a DLO: a Hold of its tip.

    Attributes
    ----------
    pose : Pose
        Pose of the DLO's end frame (x axis = tangent); only its position counts if pinned.
    grip : str
        'clamped': position and orientation; 'pinned': position; 'sleeve': clamped, but free to
        slide along the pose's x axis; 'aligned': position and tangent, free to turn about its
        tangent.
    """

    s: float | None = field(default=None, init=False, repr=False)
    slip: float = field(default=0.0, init=False, repr=False)
    by: str = field(default=FIXTURE, init=False, repr=False)

    if TYPE_CHECKING:
        def __init__(self, pose: Pose, grip: str = 'clamped') -> None: ...

    @classmethod
    def of(cls, value: Hold | Pose | ArrayLike | None) -> FarEnd | None:
        """Return a FarEnd from one, a Pose (clamped), a position (3,) (pinned), or None."""
        if value is None or isinstance(value, FarEnd):
            return value
        if isinstance(value, Hold):
            held = tip_held(value)
            assert held is not None
            return cls(held.pose, held.grip)
        if isinstance(value, Pose):
            return cls(value)
        return cls(Pose(vector('far_end', value, 3), (0.0, 0.0, 0.0, 1.0)), 'pinned')


Holds = tuple[Hold, ...]  # by arc length, the tip's last


def place_of(hold: Hold, length: float) -> float:
    """Return the arc length of the place of a Hold, m, of a DLO of `length` (m)."""
    return length if hold.s is None else hold.s


def posed(hold: Hold, pose: Pose) -> Hold:
    """Return the same Hold, of the same place, at another Pose."""
    if isinstance(hold, FarEnd):
        return FarEnd(pose, hold.grip)
    return Hold(pose, hold.grip, hold.s, hold.slip, by=hold.by)


def held_rows(grip: str, rotation: Floats) -> Floats:
    """Return (K, 6) unit vectors of rotation, then of displacement, that a grip does not allow.

    World axes. If the grip allows one about or along the pose's x axis, its y and z axes remain.

    Shapes: rotation (..., 3, 3); then (..., K, 6) are returned.
    """
    grip, many = RINGS.get(grip, grip), rotation.shape[:-2]
    if grip in ('clamped', 'pinned'):
        return np.tile(_ALL if grip == 'clamped' else _ALL[3:], (*many, 1, 1))
    rows, across = np.zeros((*many, 5, 6)), np.swapaxes(rotation, -1, -2)[..., 1:, :]
    if grip == 'aligned':
        rows[..., :2, :3], rows[..., 2:, 3:] = across, _ALL[3:, 3:]
    else:
        rows[..., :3, :3], rows[..., 3:, 3:] = _ALL[:3, :3], across
    return rows


def tip_held(value: Hold | Pose | ArrayLike | None) -> Hold | None:
    """Return the Hold of the tip that `far_end` says, as it is or made by `FarEnd.of`."""
    if not isinstance(value, Hold):
        return FarEnd.of(value)
    if value.s is not None:
        raise InvalidTask(f'far_end = {value!r}: expected a hold of the tip, s = None; others are '
                          'for `holds`')
    return value


def holds_of(far_end: Hold | Pose | ArrayLike | None, holds: Iterable[Hold], length: float,
             name: str = 'holds') -> Holds:
    """Return the Holds of a DLO of `length` (m) in their order; raise InvalidTask.

    `far_end` is one of the tip, or what `FarEnd.of` takes; `name`: of `holds` in messages.
    """
    tip = tip_held(far_end)
    if isinstance(holds, tuple) and not holds:  # nearly always
        return () if tip is None else (tip,)
    given: tuple[Hold, ...] = items(name, holds, Hold)
    found = [hold if hold.s is None or hold.s < (1.0 - _TIP) * length else _of_tip(hold, length)
             for hold in given]
    if tip is not None:
        found.append(tip)
    found.sort(key=lambda hold: place_of(hold, length))
    before = 0.0
    for hold in found:
        s = place_of(hold, length)
        if s - before < _APART * length:
            others = 'the gripper' if before == 0.0 else f'one at s = {before:.9g} m'
            raise InvalidTask(f'{name}: expected places at least {_APART * length:.3g} m apart, '
                              f'got s = {s:.9g} m beside {others}')
        before = s
    return tuple(found)


def _of_tip(hold: Hold, length: float) -> Hold:
    """Return a Hold whose place is the tip; raise InvalidTask if it is beyond."""
    s = place_of(hold, length)
    if s > (1.0 + _TIP) * length:
        raise InvalidTask(f'{type(hold).__name__}.s = {s:.9g}: expected a place on the DLO, at '
                          f'most {length:.9g} m')
    if hold.is_ring:
        raise InvalidTask(f'{type(hold).__name__}.s = {s:.9g}: expected a place before the tip, at '
                          f'{length:.9g} m: there the DLO is about to leave the {hold.grip}')
    return Hold(hold.pose, hold.grip, by=hold.by)


def places_of(holds: Holds) -> tuple[float, ...]:
    """Return the arc lengths of those that are not at the tip, m."""
    return tuple(hold.s for hold in holds if hold.s is not None)


def alike(some: Holds, others: Holds) -> bool:
    """Whether the same places are held in the same ways, wherever they are.

    Whatever place is in a ring.
    """
    if len(some) != len(others):
        return False
    for one, other in zip(some, others, strict=True):
        if one.grip != other.grip or one.slip != other.slip or (
                one.s != other.s and one.grip not in RINGS):
            return False
    return True


def have_rings(holds: Holds) -> bool:
    """Whether the DLO slides through any of them."""
    for hold in holds:  # noqa: SIM110  (a generator takes as long as all else that a step asks)
        if hold.grip in RINGS:
            return True
    return False


def counterpart(hold: Hold, holds: Holds, among: Holds) -> Hold | None:
    """Return what one of `holds` was `among` those before; None: it was not there.

    A place is the same; a ring is the one of the same name and pose, else as many rings of that
    name are before it.
    """
    if hold.grip not in RINGS:
        for other in among:
            if other.s == hold.s and other.grip not in RINGS:
                return other
        return None
    rings, before = ([other for other in each if other.is_ring and other.by == hold.by]
                     for each in (holds, among))
    for other in before:
        if other.pose is hold.pose or same(other.pose, hold.pose):
            return other
    index = next(k for k, other in enumerate(rings) if other is hold)
    return before[index] if index < len(before) else None


def carried_on(holds: Holds, before: Holds) -> Holds:
    """Return Holds, their rings with the places that were in them `before`, as far as known."""
    if not have_rings(holds):
        return holds
    found = []
    for hold in holds:
        known = counterpart(hold, holds, before) if hold.is_ring else None
        found.append(hold if known is None or known.s is None or known.s == hold.s
                     else hold.at_place(known.s))
    return tuple(found)


def row_count(holds: Holds) -> int:
    """Return how many motions Holds do not allow."""
    count = 0
    for hold in holds:
        count += _ROWS[hold.grip]
    return count


def tip_of(holds: Holds) -> FarEnd | None:
    """Return what holds the tip, or None."""
    if not holds or holds[-1].s is not None:
        return None
    last = holds[-1]
    return last if isinstance(last, FarEnd) else FarEnd(last.pose, last.grip)


class Span(NamedTuple):
    """What a DLO has to span from a grip to the next."""

    begin: int       # the hold that it begins at, by its index; -1: the gripper
    distance: float  # m, the least that is to be spanned
    length: float    # m, of the DLO between
    at: float        # m, arc length where it begins

    def reaches(self, loaded: bool) -> bool:
        """Return whether the DLO spans it with finite tension.

        It hardly stretches: where less than 1e-9 of it is left to sag, its weight decides nothing
        that could be computed. Without any load it may be just as long.
        """
        return self.distance < (1.0 - (_SLACK if loaded else -_SLACK)) * self.length


def spans_of(holds: Holds, gripper: Pose, length: float) -> list[Span]:
    """Return the Span before each hold, of a DLO of `length` (m)."""
    found: list[Span] = []
    origin, at, axis = gripper.position, 0.0, None
    for k, hold in enumerate(holds):
        place, pose, own = length if hold.s is None else hold.s, hold.pose, None
        away = pose.position - origin
        if hold.grip == 'sleeve':
            own = pose.rotation[:, 0]
            away = away - (away @ own) * own
        if axis is not None:
            away = _across(away[None], axis[None], None if own is None else own[None])[0]
        found.append(Span(k - 1, sqrt(away @ away), place - at, at))
        origin, at, axis = pose.position, place, own
    return found


def spans_along(holds: Holds, origins: Floats, targets: Floats, axes: Floats,
                length: float) -> list[list[Span]]:
    """Return the same at n instants, of grippers at origins (n, 3).

    Shapes: targets (n, A, 3), axes (n, A, 3, 3) of the holds.
    """
    distances, parts, before, at = [], [], None, 0.0
    for k, hold in enumerate(holds):
        away, own = targets[:, k] - origins, None
        if hold.slides:
            own = axes[:, k, :, 0]
            away = away - np.sum(away * own, axis=1)[:, None] * own
        if before is not None:
            away = _across(away, before, own)
        distances.append(np.linalg.norm(away, axis=1).tolist())
        parts.append((k - 1, place_of(hold, length) - at, at))
        origins, at, before = targets[:, k], place_of(hold, length), own
    return [[Span(begin, distance, part, at)
             for (begin, part, at), distance in zip(parts, row, strict=True)]
            for row in zip(*distances, strict=True)]


def _across(away: Floats, axis: Floats, other: Floats | None) -> Floats:
    """Return what is left of ways (n, 3) across axes (n, 3) of sleeves, and across `other` ones.

    They are across the others already.
    """
    if other is not None:  # the distance of two lines
        axis = axis - np.sum(axis * other, axis=1)[:, None] * other
        size = np.linalg.norm(axis, axis=1)[:, None]
        axis = np.divide(axis, size, out=np.zeros_like(axis), where=size > _PARALLEL)
    left: Floats = away - np.sum(away * axis, axis=1)[:, None] * axis
    return left


def unreached(holds: Holds, gripper: Pose, length: float, loaded: bool) -> str:
    """Return in words which neighbors are out of reach of each other; '' where none is."""
    said = []
    for span in spans_of(holds, gripper, length):
        if span.reaches(loaded):
            continue
        hold = holds[span.begin + 1]
        if span.begin < 0 and hold.s is None:
            said.append(f'the far end is held {span.distance:.9g} m from the gripper, the DLO is '
                        f'{length:.9g} m long')
            continue
        begin = 'the gripper' if span.begin < 0 else named(holds[span.begin])
        said.append(f'{named(hold)} is {span.distance:.9g} m from {begin}, the DLO between them '
                    f'is {span.length:.9g} m long')
    return '; '.join(said)


def named(hold: Hold) -> str:
    """Return a Hold in few words, as messages name it."""
    if hold.s is None:
        return 'the far end' if hold.by == FIXTURE else f'the far end ({hold.by})'
    return f'{hold.by} at s = {hold.s:.6g} m'
