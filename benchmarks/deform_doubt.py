# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a recording leaves in doubt, and how far that moves the markers.

The two markers of a gripper are 25 mm apart, so that their noise turns the gripper: by what is left
of it after smoothing. And a cable moves already when a recording begins, from motions that were not
recorded: any displacement of the grippers in the half second before stands for them. Both move the
markers by far more than their own noise, and alike for instants and markers that are neighbors; a
fit that takes them for noise is neither as exact as it could be nor free of bias.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.deform_data import Array, Recording
from dlo_planner import DirectSimulator, FarEnd, NotConverged, Pose
from dlo_planner.identify import ObservedMotion

_BEFORE = 0.05      # of the length: deviation of the grippers in the motion before
_SMALL = 5e-3       # rad, m: displacement by which derivatives are taken
_ROUGHNESSES = np.inf, 1e-4  # of steps: even ones, of which differences are smooth, if they do


def doubted(one: ObservedMotion, recording: Recording, frames: range, direct: DirectSimulator
            ) -> ObservedMotion:
    """Return an ObservedMotion with what else may have displaced its points.

    Args:
        recording, frames: what it was made of; the poses that come before the frames are a lead
        direct: with the cable as far as it is known

    Raises:
        NotConverged: the motion of that cable cannot be simulated
    """
    for roughness in _ROUGHNESSES:
        here = _seen(direct, one, roughness)
        if here is not None:
            break
    else:
        raise NotConverged(f'recording {recording.name}: its motion could not be simulated')
    away = [_away(one, twists, here, lambda moved: _seen(direct, moved, roughness))
            for twists in _doubts(one, recording, frames, direct.rod.length)]
    return replace(one, displacements=np.array(away))


def _away(one: ObservedMotion, twists: Array, here: Array, seen: Callable[..., Array | None]
          ) -> Array:
    """Return by how much (k, m, 3) points move with twists (2, poses, 6) of both ends, m.

    A motion that cannot be simulated is rare, and has others beside it.
    """
    small = min(1.0, _SMALL / np.abs(twists).max())
    for part in small * np.array([1.0, -1.0, 0.5, -0.5, 2.0, -2.0]):
        there = seen(_moved(one, part * twists))
        if there is not None:
            return np.asarray((there - here) / part)
    raise NotConverged('a motion could not be simulated with its ends moved by any small part of '
                       'what they may be off')


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


def _seen(direct: DirectSimulator, one: ObservedMotion, roughness: float) -> Array | None:
    """Return where the points are (k, m, 3), or None; roughness: tolerance, of the length."""
    motion = direct.simulate(one.grippers, one.dt, far_ends=one.far_ends,
                             tolerance=roughness * direct.rod.length)
    if not motion.converged:
        return None
    instants = (one.times / one.dt).round().astype(int)
    return np.array([motion.shapes[k].positions_at(one.s) for k in instants])
