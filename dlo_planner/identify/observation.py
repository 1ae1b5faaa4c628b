# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Observations of a DLO: points of it at rest, or in motion, and where the gripper was then."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.boundary_motion import ends_of, poses
from dlo_planner.direct.grips import between
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import array, direction, instance, items, number, row, shown, vector
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put

_ROUNDING = 1e-9  # of the duration
_AWAY = 2.0        # lengths from the gripper, where no point of a DLO can be


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Value):
    """Points of a DLO at rest, seen at a known pose of the gripper.

    Attributes
    ----------
    gripper : Pose
    points : ndarray, shape (m, 3)
        Points in m, world.
    s : ndarray, shape (m,) or None
        Their arc lengths, m. If None, not known, the nearest points of the DLO count.
    far_end : FarEnd or Pose or array_like or None
        What holds the far end: FarEnd, Pose that clamps it, position (3,) that pins it, or None.
    normal : ndarray, shape (3,), or None
        Of a picture: direction, world, along which the points are not measured, the camera's line
        of sight; what `points` say along it does not count. If None, all of a point is measured.
    initial : Shape or iterable of (Pose, FarEnd or None) or None
        From which shape the search for that of the DLO begins, or from which grips, gripper and far
        end, one after the other, until those of the observation. It decides where the DLO has
        several shapes in the same grips. If None, a free DLO is set down in its natural shape; of
        one that is held at both ends that shape is taken which fits the points best, out of the one
        that it comes to when it is set down and those near the points; in a picture, which hardly
        shows twist, the one with the least energy of those that fit alike.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    gripper: Pose
    points: Floats
    s: Floats | None = None
    far_end: FarEnd | Pose | ArrayLike | None = None
    normal: Floats | None = None
    initial: Shape | Iterable[tuple[Pose, Any]] | None = None

    def __post_init__(self) -> None:
        instance('Observation.gripper', self.gripper, Pose)
        put(self, points=array('Observation.points', self.points, (None, 3)),
            far_end=FarEnd.of(self.far_end))
        if self.s is not None:
            put(self, s=vector('Observation.s', self.s, len(self.points)))
        if self.normal is not None:
            put(self, normal=direction('Observation.normal', self.normal))
        if self.initial is not None and not isinstance(self.initial, Shape):
            put(self, initial=self._checked_way())
        super().__post_init__()

    def _checked_way(self) -> tuple[tuple[Pose, FarEnd | None], ...]:
        """Return the grips from which the search begins as pairs of Pose and FarEnd."""
        out = []
        pairs = items('Observation.initial', self.initial, (tuple, list), least=1)
        for k, pair in enumerate(pairs):
            name = f'Observation.initial[{k}]'
            if len(pair) != 2:  # noqa: PLR2004
                raise InvalidTask(f'{name} = {shown(pair)}: expected the pose of the gripper and '
                                  'the far end')
            out.append((instance(f'{name}[0]', pair[0], Pose), FarEnd.of(pair[1])))
        return tuple(out)


@dataclass(frozen=True, eq=False, repr=False)
class ObservedMotion(Value):
    """Marked points of a DLO in motion, seen while the gripper moves as prescribed.

    Attributes
    ----------
    grippers : iterable of Pose
        The n poses at the times 0, dt, 2 dt, ..., as for `DirectSimulator.simulate`.
    dt : float
        Time step in s.
    times : ndarray, shape (k,)
        Times in s, when the points were seen, from 0 to (n - 1) dt.
    points : ndarray, shape (k, m, 3)
        Points in m, world.
    s : ndarray, shape (m,)
        Their arc lengths, m.
    initial : Shape or None
        Shape at time 0, at rest, in equilibrium or not. If None, the static shape.
    far_ends : iterable of FarEnd or None
        What holds the far end at the n times, all with the same grip, or what `FarEnd.of` takes.
        If None, it is free.
    displacements : ndarray, shape (j, k, m, 3), or None
        What else may have moved the points, m: how far each of j causes moves them if it has its
        standard deviation (a gripper that was not quite where its poses say, a vibration from
        before the first pose). A fit finds how much of each there was; causes are independent.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    grippers: Iterable[Pose]
    dt: float
    times: Floats
    points: Floats
    s: Floats
    initial: Shape | None = None
    far_ends: Iterable[Any] | None = None
    displacements: Floats | None = None

    def __post_init__(self) -> None:
        grippers = tuple(poses(self.grippers, 2))
        far_ends = self._checked_ends(len(grippers))
        dt = number('ObservedMotion.dt', self.dt, above=0)
        duration = (len(grippers) - 1) * dt
        times = row('ObservedMotion.times', self.times, minimum=0)
        if times.max(initial=0.0) > duration * (1 + _ROUNDING):
            raise InvalidTask(f'ObservedMotion.times = {shown(times.tolist())}: expected at most '
                              f'(n - 1) dt = {duration:g} s')
        s = row('ObservedMotion.s', self.s, minimum=0)
        instance('ObservedMotion.initial', self.initial, Shape, optional=True)
        points = array('ObservedMotion.points', self.points, (None, None, 3))
        if points.shape[:2] != (times.size, s.size):
            raise InvalidTask(f'ObservedMotion.points has shape {points.shape}: expected as many '
                              f'rows as ObservedMotion.times, {times.size}, with as many points as '
                              f'ObservedMotion.s, {s.size}')
        put(self, grippers=grippers, dt=dt, times=times, s=s, points=points, far_ends=far_ends)
        if self.displacements is not None:
            put(self, displacements=array('ObservedMotion.displacements', self.displacements,
                                          (None, *points.shape)))
        super().__post_init__()

    def _checked_ends(self, count: int) -> tuple[FarEnd, ...] | None:
        """Return the far ends as FarEnds of one grip, or None where it is free."""
        ends = [FarEnd.of(end) for end in ends_of(self.far_ends, count)]
        grips = {None if end is None else end.grip for end in ends}
        if len(grips) > 1:
            raise InvalidTask(f'ObservedMotion.far_ends: expected one grip for all times, got '
                              f'{sorted(map(str, grips))}')
        return None if grips == {None} else tuple(end for end in ends if end is not None)


def check_points(name: str, seen: Observation | ObservedMotion, length: float) -> None:
    """Raise InvalidTask where points cannot be of a DLO of this length, m, as it is held.

    Some may be outliers, but not half of them: these are in another unit, or another frame.
    """
    if seen.s is not None and ((seen.s < 0) | (seen.s > length)).any():
        raise InvalidTask(f'{name}.s: expected 0 to the length {length:g} m')
    if isinstance(seen, Observation):
        held = seen.gripper.position
    else:
        grippers = tuple(seen.grippers)
        index = np.rint(seen.times / seen.dt).astype(int)
        held = np.array([one.position for one in grippers])[index][:, None]
    off = seen.points - held
    if isinstance(seen, Observation) and seen.normal is not None:
        off = off - np.outer(off @ seen.normal, seen.normal)
    away = float(np.median(np.linalg.norm(off, axis=-1))) if seen.points.size else 0
    if away > _AWAY * length:
        raise InvalidTask(f'{name}.points: half of them are {away:.3g} m or more from the gripper: '
                          f'expected the length {length:g} m at most, in m and world')


def gripper_at(stamps: ArrayLike, grippers: Iterable[Pose], stamp: float) -> Pose:
    """Return the gripper's Pose at the stamp of an image, between stamped poses.

    Between two poses the position is linear in time, and the rotation turns evenly about one axis.

    Parameters
    ----------
    stamps : array_like, shape (n,)
        Stamps in s, ascending, of the poses; on the clock of the image.
    grippers : iterable of Pose
        The n poses.
    stamp : float
        Stamp in s, of the image: when it was taken, not when it arrived.

    Raises
    ------
    InvalidTask
        An argument makes no sense, or the stamp is outside those of the poses.
    """
    stamps, grippers = row('stamps', stamps), poses(grippers, 1)
    stamp = number('stamp', stamp)
    if (np.diff(stamps) <= 0).any():
        raise InvalidTask(f'stamps = {shown(stamps.tolist())}: expected times that grow')
    if stamps.size != len(grippers):
        raise InvalidTask(f'grippers has {len(grippers)} entries: expected one per stamp, '
                          f'{stamps.size}')
    if not stamps[0] <= stamp <= stamps[-1]:
        raise InvalidTask(f'stamp = {stamp:.9g}: expected one between those of the poses, '
                          f'{stamps[0]:.9g} to {stamps[-1]:.9g} s')
    after = min(int(np.searchsorted(stamps, stamp, side='right')), stamps.size - 1)
    if after == 0:
        return grippers[0]
    share = (stamp - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    return between(grippers[after - 1], grippers[after], float(share))
