# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A camera that sees some points on the DLO, late and with errors."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dlo_planner.cell.plant import Plant
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import flag, integer, number, vector
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.value import Value, put

_FAR = 0.1  # of the length: half side of the cube about the DLO in which outliers lie
_ROUNDING = 1e-9  # s


@dataclass(frozen=True, eq=False, repr=False)
class Image(Value):
    """One image.

    Attributes
    ----------
    stamp : float
        Time at which it was taken, as the camera says, s.
    points : ndarray, shape (n, 3)
        Points in m, world axes, in no order.
    hole : ndarray, shape (3,) or None
        Hole in m, world axes, the center of the hole as seen. If None, not looked at.
    """

    stamp: float
    points: Floats
    hole: Floats | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Value):
    """The properties of a camera.

    Attributes
    ----------
    rate : float
        Images per s.
    latency : float
        Time from taking an image to its arrival, s.
    noise : float
        Standard deviation of each coordinate of each point, m.
    bias : float
        Standard deviation of each coordinate of an error that is constant during a run, m.
    points : int
        Number of points in each image, drawn evenly from the visible part of the DLO.
    outliers : float
        Share of the points that are displaced to anywhere near the DLO.
    hidden : float
        Share of the length that is never seen, in one piece within the first two thirds: an
        estimate needs the free third.
    stamp_error : float
        By how much stamps are too late, s.
    sees_hole : bool
        Whether it looks at the hole as well, with the same noise and bias.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it, its value and what would be right.
    """

    rate: float = 15.0
    latency: float = 0.06
    noise: float = 1e-3
    bias: float = 0.0
    points: int = 20
    outliers: float = 0.0
    hidden: float = 0.0
    stamp_error: float = 0.0
    sees_hole: bool = False

    def __post_init__(self) -> None:
        limits: dict[str, Any] = {'rate': {'above': 0}, 'outliers': {'minimum': 0, 'maximum': 1},
                                  'hidden': {'minimum': 0, 'maximum': 2 / 3}, 'stamp_error': {}}
        for item in fields(self):
            if item.type is float:
                put(self, **{item.name: number(f'Camera.{item.name}', getattr(self, item.name),
                                               **limits.get(item.name, {'minimum': 0}))})
        put(self, points=integer('Camera.points', self.points, minimum=1, maximum=10_000),
            sees_hole=flag('Camera.sees_hole', self.sees_hole))
        super().__post_init__()


GOOD = Camera()
BAD = Camera(bias=0.5e-3, outliers=0.1, hidden=1 / 3, stamp_error=0.06)


class Viewer:
    """A Camera during one run: hands out its images as they arrive.

    Parameters
    ----------
    camera : Camera
    rng : np.random.Generator
        Generator of its errors.
    """

    def __init__(self, camera: Camera, rng: np.random.Generator) -> None:
        self._camera, self._rng = camera, rng
        self._bias = camera.bias * rng.standard_normal(3)
        self._from = rng.uniform(0, 2 / 3 - camera.hidden)
        self._next: float | None = None  # the first image is taken at once
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
        visible = rng.uniform(0, 1 - camera.hidden, camera.points)
        visible[visible > self._from] += camera.hidden
        points = plant.points(plant.length * visible)
        wild = rng.random(camera.points) < camera.outliers
        points[wild] += rng.uniform(-_FAR, _FAR, (wild.sum(), 3)) * plant.length
        points += self._bias + camera.noise * rng.standard_normal(points.shape)
        hole = None
        if camera.sees_hole:
            hole = vector('hole', cutout.center + plant.truth.hole_shift + self._bias
                          + camera.noise * rng.standard_normal(3), 3)
        return Image(plant.time + camera.stamp_error, points, hole)
