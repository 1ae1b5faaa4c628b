# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Bringing the grip of a held far end, and the gripper, to where a step begins its search."""

import numpy as np

from dlo_planner.direct.continuation import between
from dlo_planner.direct.discretization import Discretization
from dlo_planner.direct.hinge import hinge_unknowns, own_unknowns, turn_of, with_hinge
from dlo_planner.direct.history import History
from dlo_planner.direct.shape import Shape
from dlo_planner.energy.potential import placed
from dlo_planner.minimize.held import led
from dlo_planner.model.arrays import Floats
from dlo_planner.model.far_end import FarEnd, held_rows
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.ritz.rotation import partway

_TURN, _SHIFT = 0.3, 0.08  # rad, part of the length: how far a grip goes in one part
_FINER = 4   # times the parts of a way that is not found in larger ones
_FINEST = 3  # times they are made smaller


def lead(discretization: Discretization, strains: Floats, grippers: tuple[Pose, Pose],
         far_ends: tuple[FarEnd, FarEnd], history: History,
         parts: int) -> tuple[Pose, Floats, History]:
    """Return gripper, strains (N, 3) and the past near the end of a straight way of both grips.

    What is left is the last part. Where the DLO does not follow, the way is left there.

    Parameters
    ----------
    strains : ndarray, shape (N, 3)
        Strains at the beginning.
    grippers : tuple
        Two Poses.
    far_ends : tuple
        Two FarEnds of the same grip.
    parts : int
        Number of parts into which the way is cut.
    """
    begin, end = grippers
    held, far_end = far_ends
    done = 0.0
    for finer in range(_FINEST):
        count = int(np.ceil(parts * _FINER**finer * (1.0 - done) - 1e-9))
        if count <= 1:
            break
        shares = done + (1.0 - done) * np.arange(1, count) / count
        gripped, bases = _way(begin, end, shares)
        held_at, axes = _way(held.pose, far_end.pose, shares)
        system = discretization.system(bases[0], gripped[0], history,
                                       FarEnd(Pose.from_rotation(held_at[0], axes[0]), held.grip))
        rows = np.array([held_rows(held.grip, one) for one in axes])
        rows[:, :, :3] *= discretization.lever
        q = discretization.unknowns(strains)
        if discretization.surroundings.pinned:
            bases[:] = system.base
            q, gone = led(with_hinge(system), hinge_unknowns(system, q), bases, held_at - gripped,
                          axes, rows)
            begin, end = (Pose.from_rotation(pose.position, system.base @ turn_of(system, q))
                          for pose in (begin, end))
            q = own_unknowns(system, q)
        else:
            q, gone = led(system, q, bases, held_at - gripped, axes, rows)
        strains = discretization.strains_of(q)
        history = history.leaving(hold=system.hold.multiplier)
        if gone == len(shares):
            break
        done = shares[gone - 1] if gone else done
    return end, strains, history


def _way(one: Pose, other: Pose, shares: Floats) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) at shares (n,) of a straight way."""
    turned = [partway(one.rotation, other.rotation, share) for share in shares.tolist()]
    return one.position + shares[:, None] * (other.position - one.position), np.array(turned)


def grip_before(discretization: Discretization, previous: Shape | None, strains: Floats,
                begin: Pose, far_end: FarEnd | None) -> FarEnd | None:
    """Return the FarEnd, of the kind of `far_end` or None, that holds the end where it is now."""
    if far_end is None:
        return None
    if previous is not None:
        end = Pose.from_rotation(previous.positions[-1], previous.frames[-1])
    else:
        state = placed(discretization.system(begin.rotation), strains)
        end = Pose.from_rotation(begin.position + state.positions[-1], state.rotations[-1])
    return FarEnd(end, far_end.grip)


def grip_at(held: FarEnd | None, far_end: FarEnd | None, share: float) -> FarEnd | None:
    """Return the FarEnd at a `share` of the way from `held` to `far_end`."""
    if held is None or far_end is None or share == 1.0:
        return far_end
    return FarEnd(between(held.pose, far_end.pose, share), far_end.grip)


def parts_between(begin: Pose, gripper: Pose, held: FarEnd | None, far_end: FarEnd | None,
                  length: float) -> int:
    """Return in how many parts the motion is to be made at least; 0 if there is none."""
    pairs = [(begin, gripper)]
    if held is not None and far_end is not None:
        pairs.append((held.pose, far_end.pose))
    parts: float = 0.0
    for one, other in pairs:
        shift = float(np.linalg.norm(other.position - one.position))
        turn = angle_between(one.rotation, other.rotation)
        if far_end is None:
            parts = max(parts, 1.0 if shift + turn > 0 else 0.0)
        else:
            if far_end.grip == 'pinned' and one is not begin:
                turn = 0.0
            parts = max(parts, shift / (_SHIFT * length), turn / _TURN)
    return int(np.ceil(parts - 1e-9))
