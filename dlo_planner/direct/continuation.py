# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Following one shape through a motion of the gripper, and noticing where it lets go."""

from collections.abc import Callable
from dataclasses import replace
from math import dist
from typing import TypeAlias

import numpy as np

from dlo_planner.direct.discretization import SAMPLES
from dlo_planner.direct.shape import Shape
from dlo_planner.kernels import kernel
from dlo_planner.minimize.leash import largest_turn_between
from dlo_planner.model.arrays import Floats
from dlo_planner.model.far_end import FarEnd
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.model.value import freeze
from dlo_planner.ritz.matrix3 import matrix, times_transposed
from dlo_planner.ritz.rotation import partway, rotation_vector

Equilibrium: TypeAlias = Callable[..., 'tuple[Shape, int]']  # see `follow`

LONGEST_TURN = 0.25  # rad: longer steps of the gripper are cut in any case
_HALVINGS = 7    # a step is cut into 2^7 parts at most before a leap counts as a jump
_LEAP = 0.1      # rad: change of shape that a vanishing step of the gripper cannot cause
_LOST_OF_WORK, _LOST_OF_ELASTIC = 0.2, 0.05  # of energy, by more than which a held DLO has fallen
_SAME = 1e-3      # rad: two shapes that differ by less are one
_FOLLOWING = 3.0  # rad of shape per rad of the gripper: more is looked at in smaller steps


def follow(equilibrium: Equilibrium, previous: Shape, gripper: Pose, far_end: FarEnd | None = None,
           halvings: int = _HALVINGS) -> Shape:
    """Return the Shape at `gripper` that continues `previous`; its `jumped` says if none does.

    None does where the shape changes more than the step can cause, and where the way down from
    `previous` leads off an unstable shape, however small the step: what it continues as has
    lost its stability there, and the DLO takes one of several sides (a pitchfork).

    Parameters
    ----------
    equilibrium : callable
        Function (gripper, initial, far_end, most) -> (Shape, how often an unstable shape was left
        on the way to it); where it leaves `initial` by more than `most` (rad) it may give up.
    previous : Shape
        Shape at the pose where the step starts.
    gripper : Pose
        Pose where it ends.
    far_end : FarEnd or None, optional
        FarEnd where it ends, or None.
    halvings : int, optional
        How often the step may still be cut in two.
    """
    turn = angle_between(previous.gripper.rotation, gripper.rotation)
    if far_end is not None:
        # both ends go in small parts anyway; a fall shows as energy that no work accounts for
        shape, kicks = equilibrium(gripper, previous, far_end)
        return _jumped(shape, shape.jumped or kicks > 0 or fell(previous, shape))
    if turn <= LONGEST_TURN or halvings == 0:
        most = np.inf if halvings == 0 or previous.contacts else _LEAP + _FOLLOWING * turn
        shape, kicks = equilibrium(gripper, previous, None, most)
        if shape.converged and not kicks and not fell(previous, shape):
            return shape
        if halvings == 0:
            return replace(shape, jumped=True)
    halfway = between(previous.gripper, gripper, 0.5)
    middle = follow(equilibrium, previous, halfway, None, halvings - 1)
    if not middle.converged:
        if turn > LONGEST_TURN:
            return replace(middle, jumped=True)
        if not shape.converged and most < np.inf:  # given up on its way: now to where it leads
            shape, _ = equilibrium(gripper, previous, None, np.inf)
        return replace(shape, jumped=True)
    shape = follow(equilibrium, middle, gripper, None, halvings - 1)
    return _jumped(shape, shape.jumped or middle.jumped)


def _jumped(shape: Shape, jumped: bool) -> Shape:
    """Return a Shape that says so; itself, with its error estimate, if it does already."""
    return shape if jumped == shape.jumped else replace(shape, jumped=bool(jumped))


def leapt(equilibrium: Equilibrium, previous: Shape, shape: Shape, kicks: int) -> bool:
    """Return whether `shape`, found from `previous` in one step, does not continue it.

    Parameters
    ----------
    equilibrium, previous
        As for `follow`.
    shape : Shape
        What `equilibrium` returned for the whole step, and `kicks` with it.
    """
    if fell(previous, shape) or kicks and shape.far_end is not None:
        return True
    if not kicks:
        return False
    # A long step may pass by unstable shapes that the motion itself does not meet.
    followed = follow(equilibrium, previous, shape.gripper)
    return followed.jumped or shape_change(followed, shape) > _SAME


def fell(previous: Shape, shape: Shape) -> bool:
    """Return whether `shape` does not continue `previous` in a single step of the grippers.

    It changed more than the gripper's turn (and, in contact, its shift) can cause, or, with its
    far end held, lost energy that no work accounts for.
    """
    if shape.far_end is not None or shape.pinned:
        return _lost(previous, shape)
    turn = angle_between(previous.gripper.rotation, shape.gripper.rotation)
    return shape_change(previous, shape) > _allowed(previous, shape, turn)


def _lost(previous: Shape, shape: Shape) -> bool:
    """Whether less energy is left than the work of both grips accounts for."""
    one, other = previous.gripper, shape.gripper
    work = (_work(one.rotation, other.rotation, one.position, other.position,
                  previous.gripper_wrench, shape.gripper_wrench)
            + _work(previous.frames[-1], shape.frames[-1], previous.positions[-1],
                    shape.positions[-1], previous.far_wrench, shape.far_wrench))
    lost = previous.energy + work - shape.energy - (shape.dissipated - previous.dissipated)
    return lost > _LOST_OF_WORK * abs(work) + _LOST_OF_ELASTIC * previous.elastic_energy


@kernel
def _work(one: Floats, other: Floats, begin: Floats, end: Floats, before: Floats,
          after: Floats) -> float:
    """Return the work in J of a grip on a straight way, its force changing evenly.

    Args:
        one, other: (3, 3), read-only, rotations of the grip at both ends of the way
        begin, end: (3,), read-only, its positions there, m
        before, after: (6,), read-only, its force and moment on the DLO there, N, N m
    """
    turn = rotation_vector(times_transposed(matrix(other), matrix(one)))
    work = 0.0
    for i in range(3):
        work += (before[i] + after[i]) * (end[i] - begin[i])
        work += (before[3 + i] + after[3 + i]) * turn[i]
    return 0.5 * work


def _allowed(previous: Shape, shape: Shape, turn: float) -> float:
    """Return the change of shape in rad that a step of the grippers may cause."""
    allowed = _LEAP + _FOLLOWING * turn
    if previous.contacts or shape.contacts:
        # where it touches, the gripper's displacement deforms the DLO as well
        shift = dist(shape.gripper.position, previous.gripper.position)
        allowed += 2 * _FOLLOWING * shift / float(previous.s[-1])
    return allowed


def shape_change(one: Shape, other: Shape) -> float:
    """Return the largest change of a node's rotation relative to the gripper, in rad."""
    if one.s is other.s and one.state.mesh is not None:
        result: float = largest_turn_between(one.frames, other.frames, one.gripper.rotation,
                                             other.gripper.rotation, one.state.mesh.sampled)
        return result
    if np.array_equal(one.s, other.s):
        at = np.searchsorted(one.s, SAMPLES * one.s[-1])
        here, there = one.frames[at], other.frames[at]
    else:  # nodes of two meshes are not at the same places
        samples = SAMPLES * one.s[-1]
        here, there = (np.array([shape.frame_at(s)[0] for s in samples / one.s[-1] * shape.s[-1]])
                       for shape in (one, other))
    freeze((here, there))
    change: float = largest_turn_between(here, there, one.gripper.rotation, other.gripper.rotation,
                                         np.arange(SAMPLES.size))
    return change


def between(one: Pose, other: Pose, fraction: float) -> Pose:
    """Return the Pose at `fraction` of the way: position linear, rotation about one fixed axis."""
    return Pose.from_rotation(one.position + fraction * (other.position - one.position),
                              partway(one.rotation, other.rotation, float(fraction)))
