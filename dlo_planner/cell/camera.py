# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A camera that sees some points on the DLO, late and with errors."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.cell.plant import Plant
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, integer, number, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import Value, put

_FAR = 0.1  # of the length: half side of the cube about the DLO in which outliers lie
_NEAR = 2 / 3       # of the length: the free third begins there
_MOST_HIDDEN = 0.6  # of the length, of the rest
_SPELL = 0.5, 2.0   # s, in which the free third is hidden
_LONG_BEFORE = -60.0  # s: a run begins in the midst of spells
# of the length, from the hole along its axis, beside the axis, and downward: the second cable's
# ends and sag
_ALONG, _BESIDE, _SLACK = (-0.05, -0.9), (0.03, 0.12), (0.02, 0.1)
_ROUNDING = 1e-9  # s
_CARRIED_BY = 0.4  # of the length, before the hidden part: what a tracker moves that along with
_LEAST_NODES = 9  # of a tracker: three are in that part then, which tell how it turns


@dataclass(frozen=True, eq=False, repr=False)
class Image(Value):
    """One image."""

    stamp: float  # time at which it was taken, as the camera says, s
    points: Floats  # (n, 3) points in m, world axes, in no order
    # (3,) hole in m, world axes, the center of the hole as seen. If None, not looked at
    hole: Floats | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Value):
    """The properties of a camera."""

    rate: float = 15.0  # images per s
    latency: float = 0.06  # time from taking an image to its arrival, s
    noise: float = 1e-3  # standard deviation of each coordinate of each point, m
    # standard deviation of each coordinate of an error that is constant during a run, m
    bias: float = 0.0
    # (3,) m, a further constant error, world axes
    offset: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    # (3,) rad, rotation vector of a constant turn of all that it sees, world axes, and (3,) m, the
    # point about which, from the center of the hole
    turn: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    turned_about: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    # (3,) m/s and (3,) rad/s, by which `offset` and `turn` grow from the beginning of a run on, as
    # where a mount warms up
    drift: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    turn_drift: Floats = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    # number of points in each image, drawn evenly from the visible part of the DLO
    points: int = 20
    outliers: float = 0.0  # share of the points that are displaced to anywhere near the DLO
    # share of the points that lie on another cable, which stays where it hangs: between two places
    # beside the way of the DLO, a few hundredths of its length from it
    second_cable: float = 0.0
    # share of the length that is never seen, in one piece within the first two thirds: an estimate
    # needs the free third
    hidden: float = 0.0
    # share of the time in which the free third is hidden as well, in spells of 0.5 to 2 s
    blind: float = 0.0
    # whether its tracker fills in the free third where it is hidden: with the places that it saw
    # last, moved as a rigid body along with the rest of the DLO, without noise of their own
    fills_in: bool = False
    stamp_error: float = 0.0  # by how much stamps are too late, s
    sees_hole: bool = False  # whether it looks at the hole as well, with the same noise and bias

    def __post_init__(self) -> None:
        limits: dict[str, Any] = {'rate': {'above': 0}, 'outliers': {'minimum': 0, 'maximum': 1},
                                  'second_cable': {'minimum': 0, 'maximum': 1},
                                  'hidden': {'minimum': 0, 'maximum': 2 / 3}, 'stamp_error': {},
                                  'blind': {'minimum': 0, 'maximum': 1}}
        for item in fields(self):
            if item.type is float:
                put(self, **{item.name: number(f'Camera.{item.name}', getattr(self, item.name),
                                               **limits.get(item.name, {'minimum': 0}))})
        put(self, sees_hole=flag('Camera.sees_hole', self.sees_hole),
            fills_in=flag('Camera.fills_in', self.fills_in))
        put(self, points=integer('Camera.points', self.points, maximum=10_000,
                                 minimum=_LEAST_NODES if self.fills_in else 1),
            **{name: vector(f'Camera.{name}', getattr(self, name), 3)
               for name in ('offset', 'turn', 'turned_about', 'drift', 'turn_drift')})
        if self.outliers + self.second_cable > 1:
            raise InvalidTask(f'Camera.second_cable = {self.second_cable:g}: expected at most 1 '
                              f'together with outliers = {self.outliers:g}')
        if self.blind and self.hidden > _MOST_HIDDEN:
            raise InvalidTask(f'Camera.hidden = {self.hidden:g}: expected at most '
                              f'{_MOST_HIDDEN:g} where blind is not 0: nothing is seen else')
        super().__post_init__()


GOOD = Camera()
BAD = Camera(bias=0.5e-3, outliers=0.1, hidden=1 / 3, stamp_error=0.06)


class Viewer:
    """A Camera during one run, its errors by `rng`: hands out its images as they arrive."""

    def __init__(self, camera: Camera, rng: np.random.Generator) -> None:
        self._camera, self._rng = camera, rng
        self._bias = camera.bias * rng.standard_normal(3)
        self._from = rng.uniform(0, 2 / 3 - camera.hidden)
        self._next: float | None = None  # the first image is taken at once
        self._own, = rng.spawn(1)  # what is drawn from rng stays as it was without what is new
        self._spells = _spells(camera.blind, self._own)
        self._spell = next(self._spells)
        self._second: tuple[Floats, Floats] | None = None
        # s (k,) of nodes of the tracker, as parts of the length, and where they are (k, 3)
        self._nodes: tuple[Floats, Floats] | None = None
        self._coming: list[tuple[float, Image]] = []

    def images(self, plant: Plant, cutout: CutOut) -> tuple[Image, ...]:
        """Return the Images that have arrived since the last call.

        A call takes one image at most, so calls have to be more frequent than images.
        """
        if self._next is None:
            self._next = plant.time
        if plant.time >= self._next - _ROUNDING:
            self._next += 1 / self._camera.rate
            self._coming.append((plant.time + self._camera.latency, self._image(plant, cutout)))
        there = [image for time, image in self._coming if time <= plant.time + _ROUNDING]
        self._coming = self._coming[len(there):]
        return tuple(there)

    def _image(self, plant: Plant, cutout: CutOut) -> Image:
        camera, rng = self._camera, self._rng
        while plant.time >= self._spell[1]:
            self._spell = next(self._spells)
        seen = _NEAR if self._spell[0] <= plant.time else 1.0  # the free third is hidden
        visible = rng.uniform(0, seen - camera.hidden, camera.points)
        visible[visible > self._from] += camera.hidden
        points = plant.points(plant.length * visible)
        kind = rng.random(camera.points)
        wild = kind < camera.outliers
        points[wild] += rng.uniform(-_FAR, _FAR, (wild.sum(), 3)) * plant.length
        other = kind >= 1 - camera.second_cable
        if other.any():
            points[other] = self._on_second_cable(int(other.sum()), plant.length, cutout)
        points = self._seen(points, plant.time, cutout) + (
            camera.noise * rng.standard_normal(points.shape))
        if camera.fills_in:
            points = self._tracked(plant, cutout, seen)
        hole = None
        if camera.sees_hole:
            center = cutout.center + plant.truth.shift_of(0)
            hole = vector('hole', self._seen(center, plant.time, cutout)
                          + camera.noise * rng.standard_normal(3), 3)
        return Image(plant.time + camera.stamp_error, points, hole)

    def _seen(self, places: Floats, time: float, cutout: CutOut) -> Floats:
        """Return where places (..., 3) are seen at a time, s, but for noise."""
        camera = self._camera
        about = cutout.center + camera.turned_about
        turn = Rotation.from_rotvec(camera.turn + time * camera.turn_drift).as_matrix()
        seen: Floats = ((places - about) @ turn.T + about + self._bias
                        + camera.offset + time * camera.drift)
        return seen

    def _tracked(self, plant: Plant, cutout: CutOut, seen: float) -> Floats:
        """Return the nodes (k, 3) of a tracker that sees the DLO up to a part of its length.

        Those beyond are where they were, moved as the last ones before them were since then.
        """
        s = np.linspace(0, 1, self._camera.points)
        own = self._own
        now = self._seen(plant.points(plant.length * s), plant.time, cutout) + (
            self._camera.noise * own.standard_normal((s.size, 3)))
        hidden = s > seen
        if hidden.any() and self._nodes is not None:
            known = self._nodes[1]
            near = ~hidden & (s > seen - _CARRIED_BY)
            middle = known[near].mean(axis=0), now[near].mean(axis=0)
            turn, _ = Rotation.align_vectors(now[near] - middle[1], known[near] - middle[0])
            now[hidden] = turn.apply(known[hidden] - middle[0]) + middle[1]
        self._nodes = s, now
        return now

    def _on_second_cable(self, count: int, length: float, cutout: CutOut) -> Floats:
        """Return places (count, 3) on a slack cable, a parabola."""
        own = self._own
        if self._second is None:
            angles, away = own.uniform(0, 2 * np.pi, 2), own.uniform(*_BESIDE, 2) * length
            local = np.column_stack([np.array(_ALONG) * length, away * np.cos(angles),
                                     away * np.sin(angles)])
            self._second = (cutout.center + local @ cutout.pose.rotation.T,
                            own.uniform(*_SLACK) * length * np.array([0.0, 0.0, -1.0]))
        (begin, end), sag = self._second
        x = own.uniform(0, 1, count)[:, None]
        places: Floats = begin + x * (end - begin) + 4 * x * (1 - x) * sag
        return places


def _spells(share: float, rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Yield begin and end, in s, of the spells that are a share of the time."""
    if not share:
        yield np.inf, np.inf
    end = _LONG_BEFORE
    while True:
        begin = end + rng.exponential(np.mean(_SPELL) * (1 - share) / share)
        end = begin + rng.uniform(*_SPELL)
        yield begin, end
