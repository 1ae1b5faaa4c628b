# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a DLO and its gripper go from one planned shape to the next without a jump."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from dlo_planner.direct.continuation import shape_change
from dlo_planner.direct.grasp import Simulator
from dlo_planner.direct.self_passage import passed_between
from dlo_planner.direct.shape import Shape
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import Holds
from dlo_planner.model.pose import Pose, angle_between

_Number = TypeVar('_Number', float, Floats)
_QUIET = 0.1   # rad: a change of shape, besides the gripper's turn, that needs no second look
SURELY_STABLE = 0.1  # stability at both ends of a step, without which the DLO may fall between them
SAME = 1e-3    # of the length: farther apart, two shapes are not the same
# What a step of the gripper may be: a constant and a part per depth, both relative to the length.
# Of 500 random plans 99 % stay below half of the rates; a fold exceeds any.
_TURN, _TURN_RATE = 0.05, 10.0
_SHIFT, _SHIFT_RATE = 0.02, 3.0


def largest_turn(step: _Number) -> _Number:
    """Return the turn of the gripper in rad that a step in depth (of the length) may cause."""
    return _TURN + _TURN_RATE * abs(step)


def largest_shift(step: _Number) -> _Number:
    """Return the same for the gripper's displacement, of the length."""
    return _SHIFT + _SHIFT_RATE * abs(step)


def without_doubt(steps: Floats, length: float) -> tuple[Floats, float]:
    """Return what a step may be so that neither gripper nor DLO jump, without a second look.

    Shapes: steps (k,).
    """
    most = (largest_turn(steps), length * largest_shift(steps), np.full(len(steps), _QUIET))
    return np.array(most), SURELY_STABLE


def excess(one: tuple[Floats, Floats], other: tuple[Floats, Floats], step: float,
           length: float) -> float:
    """Return by how much (m) the gripper turns or moves too far for a step; 0 if it does not.

    A turn counts as the displacement of a point at the DLO's length from the gripper.
    """
    turn = angle_between(one[0], other[0])
    shift = math.hypot(*(other[1] - one[1]).tolist()) / length
    return length * max(0.0, turn - largest_turn(step), shift - largest_shift(step))


def discontinuity(simulator: Simulator, before: Shape | None, shape: Shape) -> Shape | None:
    """Return the Shape that is found when the gripper goes to that of `shape`; None if it is that.

    The direct simulation decides where the shape changes more than the gripper's turn causes, or is
    hardly stable.
    """
    if before is None:
        reached = simulator.solve(shape.gripper)
    else:
        if (min(before.stability, shape.stability) > SURELY_STABLE
                and _follows(before, shape, shape_change(before, shape))):
            return None
        reached = simulator.track([shape.gripper], initial=before)[0]
    return None if reached.converged and not reached.jumped and same(reached, shape) else reached


def passes_itself(simulator: Simulator | None, before: Shape, shape: Shape) -> bool:
    """Return whether the DLO would pass through itself on the way from a Shape to the next.

    Where the straight way of its nodes does, a direct simulation of shorter ways decides; without
    one, or of a part of the DLO, the straight way.
    """
    if passed_between(before, shape, False) is False:
        return False
    if simulator is None or any(one.s[-1] != simulator.rod.length for one in (before, shape)):
        return True
    reached = followed(simulator, before, shape.gripper, shape.holds)
    return not (reached.converged and reached.passed_itself is False)


def followed(simulator: Simulator, before: Shape, gripper: Pose, holds: Holds) -> Shape:
    """Return the Shape in which a DLO follows its grips from the Shape before."""
    return simulator.track([gripper], initial=before, holds=holds)[0]


def solved_as(simulator: Simulator, shape: Shape) -> Shape:
    """Return the Shape that another simulator finds from one, where that is held."""
    return simulator.solve(shape.gripper, shape, holds=shape.holds)


def _follows(before: Shape, shape: Shape, change: float) -> bool:
    """Whether a change of shape in rad is hardly more than the gripper's turn causes."""
    return change < _QUIET or change < _QUIET + angle_between(before.gripper.rotation,
                                                              shape.gripper.rotation)


def same(one: Shape, other: Shape) -> bool:
    """Whether two Shapes in the same gripper, on any meshes, are the same."""
    return bool(apart(one, other) < SAME * one.s[-1])


def apart(one: Shape, other: Shape) -> float:
    """Return the largest distance (m) between two Shapes, at the nodes of `one`.

    Where `other` is shorter, its end counts.
    """
    positions = other.positions_at(np.minimum(one.s, other.s[-1]))
    return float(np.linalg.norm(one.positions - positions, axis=1).max())


def gripper_motion(one: Pose, other: Pose, length: float) -> float:
    """Return the turn in rad plus the shift, in parts of the length (m), between two Poses."""
    shift = np.linalg.norm(other.position - one.position)
    return angle_between(one.rotation, other.rotation) + float(shift) / length
