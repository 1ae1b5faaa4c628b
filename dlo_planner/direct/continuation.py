"""Following one shape through a motion of the gripper, and noticing where it lets go."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.model.pose import Pose

_LONGEST_TURN = 0.25  # rad: longer steps of the gripper are cut in any case
_SAMPLES = np.linspace(0, 1, 33)[1:-1]  # of the length
_HALVINGS = 7    # a step is cut into 2^7 parts at most before a leap counts as a jump
_LEAP = 0.1      # rad: change of shape that a vanishing step of the gripper cannot cause
_FOLLOWING = 3.0  # rad of shape per rad of the gripper: more is looked at in smaller steps


def follow(equilibrium, previous, gripper, halvings=_HALVINGS):
    """Return the Shape at `gripper` that continues `previous`; its `jumped` says if none does.

    Args:
        equilibrium: function (gripper, initial) -> (Shape, kicks)
        previous: Shape at the pose where the step starts
        gripper: Pose where it ends
        halvings: how often the step may still be cut in two
    """
    turn = Rotation.from_matrix(gripper.rotation @ previous.gripper.rotation.T).magnitude()
    if turn <= _LONGEST_TURN or halvings == 0:
        shape, _ = equilibrium(gripper, previous)
        if shape.converged and shape_change(previous, shape) <= _LEAP + _FOLLOWING * turn:
            return shape
        if halvings == 0:
            return replace(shape, jumped=True)
    halfway = between(previous.gripper, gripper, 0.5)
    middle = follow(equilibrium, previous, halfway, halvings - 1)
    if not middle.converged:
        return replace(shape, jumped=True)
    shape = follow(equilibrium, middle, gripper, halvings - 1)
    return replace(shape, jumped=shape.jumped or middle.jumped)


def shape_change(one, other):
    """Return the largest change of a node's rotation relative to the gripper, in rad."""
    samples = _SAMPLES * one.s[-1]
    here, there = (shape.frames[np.searchsorted(shape.s, samples)] for shape in (one, other))
    between = one.gripper.rotation @ other.gripper.rotation.T
    smallest = (here * (between @ there)).sum(axis=(1, 2)).min()  # traces of the rotations
    return float(np.arccos(np.clip((smallest - 1) / 2, -1, 1)))


def between(one, other, fraction):
    """Return the Pose at `fraction` of the way: position linear, rotation about one fixed axis."""
    turn = Rotation.from_matrix(other.rotation @ one.rotation.T).as_rotvec()
    rotation = Rotation.from_rotvec(fraction * turn).as_matrix() @ one.rotation
    return Pose.from_rotation(one.position + fraction * (other.position - one.position), rotation)
