# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a penalty is, and how its arguments are judged."""

from typing import Protocol

import numpy as np

from dlo_planner.direct.sensitivity import Sensitivity
from dlo_planner.direct.shape import Shape
from dlo_planner.errors import InvalidTask
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number
from dlo_planner.model.value import Value


class Weighted(Protocol):
    """A penalty with a weight."""

    @property
    def weight(self) -> float:
        """Its weight."""


class Residuals(Protocol):
    """A penalty: the sum of the squares of its residuals."""

    def residuals(self, shape: Shape) -> Floats:
        """Return (k,)."""

    def slopes(self, shape: Shape, sensitivity: Sensitivity) -> Floats:
        """Return (k, 6), derivatives by rotation (rad) and displacement (m) of the gripper."""


def length_of(penalty: Value, name: str) -> float:
    """Return an attribute that must not be negative, or raise InvalidTask."""
    return number(f'{type(penalty).__name__}.{name}', getattr(penalty, name), minimum=0)


def weight_of(penalty: Weighted) -> float:
    """Return the weight of a penalty, or raise InvalidTask."""
    return number(f'{type(penalty).__name__}.weight', penalty.weight, above=0)


def judged(shape: Shape, *sensitivity: Sensitivity) -> None:
    """Raise InvalidTask unless these are a Shape and, if given, its Sensitivity."""
    instance('shape', shape, Shape)
    for one in sensitivity:
        if instance('sensitivity', one, Sensitivity).shape.s.size != shape.s.size:
            raise InvalidTask(f'shape = {shape!r}: expected the one of the sensitivity')


def cross_matrix(v: Floats) -> Floats:
    """Return the matrix (3, 3) of turn x v, the change of a vector v (3,) by a rotation `turn`."""
    x, y, z = v.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
