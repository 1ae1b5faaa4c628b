# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A penalty on a stretch of the DLO whose tangent leaves a direction."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.inverse.penalty import judged
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import direction, number
from dlo_planner.model.value import Value, put

_POINTS = 9  # at which the tangent is looked at, evenly


@dataclass(frozen=True, eq=False, repr=False)
class KeepTangent(Value):
    """The DLO's tangent keeps a direction on a stretch: the root mean square of its deviation.

    Attributes
    ----------
    begin : float
        Arc length where the stretch begins, m.
    end : float
        Arc length where the stretch ends, m.
    direction : ndarray, shape (3,)
        Direction of the tangent, of any length but zero.
    weight : float
        Weight in 1/rad.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    ARC_LENGTHS: ClassVar[tuple[str, ...]] = ('begin', 'end')

    begin: float
    end: float
    direction: Floats
    weight: float = 1.0

    if TYPE_CHECKING:  # what may be given
        def __init__(self, begin: float, end: float, direction: ArrayLike,
                     weight: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        begin, end = (number(f'KeepTangent.{name}', getattr(self, name), minimum=0)
                      for name in ('begin', 'end'))
        if end < begin:
            raise InvalidTask(f'KeepTangent.end = {end:g}: expected at least begin = {begin:g}')
        put(self, begin=begin, end=end, direction=direction('KeepTangent.direction',
                                                            self.direction),
            weight=number('KeepTangent.weight', self.weight, above=0))
        super().__post_init__()

    def residuals(self, shape: Shape) -> Floats:
        """Return (27,): differences of unit vectors, 3 at each of 9 points."""
        judged(shape)
        return self._share * np.ravel([shape.frame_at(s)[0][:, 0] - self.direction
                                       for s in self._points])

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        """Return (27, 6), by rotation (rad) and displacement (m) of the gripper."""
        judged(shape, sensitivity)
        return self._share * np.vstack([
            np.cross(sensitivity.at(s)[:3].T, shape.frame_at(s)[0][:, 0]).T
            for s in self._points])

    @property
    def _points(self) -> Floats:
        return np.linspace(self.begin, self.end, _POINTS)

    @property
    def _share(self) -> float:
        return self.weight / float(np.sqrt(_POINTS))
