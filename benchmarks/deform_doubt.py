# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a recording leaves in doubt, and how far that moves the markers.

The two markers of a gripper are 25 mm apart, so that their noise turns the gripper: by what is left
of it after smoothing. And a cable moves already when a recording begins, from motions that were not
recorded: any displacement of the grippers in the half second before stands for them. Both move the
markers by far more than their own noise, and alike for instants and markers that are neighbors; a
fit that takes them for noise is neither as exact as it could be nor free of bias.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.deform_data import Array, Recording
from dlo_planner import DirectSimulator, FarEnd, ObservedMotion, Pose

_BEFORE = 0.05      # of the length: deviation of the grippers in the motion before
_SMALL = 5e-3       # rad, m: displacement by which derivatives are taken


def doubted(one: ObservedMotion, recording: Recording, frames: range, direct: DirectSimulator
            ) -> ObservedMotion:
    """Return an ObservedMotion with what else may have displaced its points.

    Args:
        recording, frames: what it was made of; the poses that come before the frames are a lead
        direct: with the cable as far as it is known
    """
    here = _seen(direct, one)
    away = []
    for twists in _doubts(one, recording, frames, direct.rod.length):
        part = min(1.0, _SMALL / np.abs(twists).max())
        there = _seen(direct, _moved(one, part * twists))
        if here is not None and there is not None:
            away.append((there - here) / part)
    return replace(one, displacements=np.array(away)) if away else one


def _doubts(one: ObservedMotion, recording: Recording, frames: range, length: float
            ) -> Iterator[Array]:
    """Yield (2, poses, 6): rotation vectors and displacements of both ends, rad and m."""
    far_ends = list(one.far_ends)
    held = list(one.grippers), [end.pose for end in far_ends]
    count = len(far_ends)
    lead = count - len(frames)
    for end, (poses, direction) in enumerate(zip(held, recording.directions, strict=True)):
        apart = np.linalg.norm(direction.values, axis=1).mean()
        axes = np.array([pose.rotation for pose in poses])
        for doubt in direction.doubts[:, frames] / apart:
            turn = np.concatenate([np.full(lead, doubt[0]), doubt])[:, None]
            for across in (1, 2):
                twists = np.zeros((2, count, 6))
                twists[end, :, :3] = turn * axes[:, :, across]
                yield twists
    x = np.arange(lead) / max(lead, 1)
    for bump in ((1 - x) ** 3, 8 * x**2 * (1 - x) ** 3):
        for end in range(2):
            for axis in range(3, 6):
                twists = np.zeros((2, count, 6))
                twists[end, :lead, axis] = _BEFORE * length * bump
                yield twists


def _moved(one: ObservedMotion, twists: Array) -> ObservedMotion:
    """Return the motion with its ends moved by twists (2, poses, 6)."""
    ends = list(one.far_ends)
    grippers = [_displaced(pose, twist) for pose, twist in zip(one.grippers, twists[0],
                                                               strict=True)]
    return replace(one, grippers=grippers,
                   far_ends=[FarEnd(_displaced(end.pose, twist), end.grip)
                             for end, twist in zip(ends, twists[1], strict=True)])


def _displaced(pose: Pose, twist: Array) -> Pose:
    return Pose.from_rotation(pose.position + twist[3:],
                              Rotation.from_rotvec(twist[:3]).as_matrix() @ pose.rotation)


def _seen(direct: DirectSimulator, one: ObservedMotion) -> Array | None:
    """Return where the points are (k, m, 3), or None; in even steps: differences stay smooth."""
    motion = direct.simulate(one.grippers, one.dt, far_ends=one.far_ends, tolerance=np.inf)
    if not motion.converged:
        return None
    instants = (one.times / one.dt).round().astype(int)
    return np.array([motion.shapes[k].positions_at(one.s) for k in instants])
