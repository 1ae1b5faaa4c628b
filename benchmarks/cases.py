# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What is computed: the paper's benchmarks, and scenes in which the DLO touches something."""

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner import Box, Capsule, CutOut, DirectSimulator, FarEnd, Plane, Pose, Rod, Sheet

ANGLES = (*range(0, 181, 10), *range(170, -1, -10))  # degrees, benchmark C: up, over, and back
SMOOTH = tuple(np.linspace(0, 72, 37))
BAR = Capsule((0.3, -0.5, 0.7), (0.3, 0.5, 0.7), 0.02)

_UP = (0, 0, 1)
_TABLE = Box(Pose((0.5, 0, 0.05), (0, 0, 0, 1)), (2, 2, 0.2))
_BESIDE = Box(Pose((0.2, 0.5, 0.5), (0, 0, 0, 1)), (0.2, 0.2, 0.2))
IDLE = {  # what may act on the wire and never does, of the benchmarks that hang it at 1 m
    'a floor never touched': lambda: {'obstacles': [Plane((0, 0, 0.2), _UP)]},
    'a plane 50 m below': lambda: {'obstacles': [Plane((0, 0, -50), _UP)]},
    'a yield stress never reached': lambda: {'rod': wire(yield_curvature=10.0)},
    'a table, a box and a sheet in reach': lambda: {'obstacles': [
        _TABLE, _BESIDE, Sheet.around(hole((0.9, -0.6, 0.8), radius=0.02))]},
}


def wire(diameter=1e-3, **more):
    """Return the paper's copper wire of 1 m, or a thicker one."""
    return Rod.circular(1.0, diameter, 8960.0, 110e9, 0.34, **more)


def local(n=64, rod=None, **more):
    """Return a DirectSimulator with one unknown strain per element."""
    return DirectSimulator(rod or wire(), basis='local', n_elements=n, **more)


def chebyshev(n=64, rod=None, **more):
    """Return a DirectSimulator with ten Chebyshev terms."""
    return DirectSimulator(rod or wire(), n_elements=n, **more)


def swinging():
    """Return the grippers of 1 s, 10 ms apart: it goes aside by 0.1 m and back."""
    return [level(1.0, 0.1 * np.sin(0.01 * np.pi * k) ** 2) for k in range(101)]


def turned(degrees):
    """Return the gripper of benchmarks A, B (0 degrees) and C."""
    return Pose((0, 0, 1), Rotation.from_euler('y', -degrees, degrees=True).as_quat())


def level(height, x=0.0):
    """Return a level gripper at a height."""
    return Pose((x, 0, height), (0, 0, 0, 1))


def random_poses(count, seed=0):
    """Return poses in any direction."""
    rng = np.random.default_rng(seed)
    return [Pose((0, 0, 0), rng.normal(size=4)) for _ in range(count)]


def random_ends(count, seed=0, cone=np.pi / 3):
    """Return pairs of poses of a gripper and of a far end, slack to taut, of a wire of 1 m.

    The end is .3 to .99 m away in any direction, and turned from the gripper by up to `cone`, rad.
    """
    rng, pairs = np.random.default_rng(seed), []
    for gripper in random_poses(count, seed):
        away, turn = rng.normal(size=3), rng.normal(size=3)
        away *= rng.uniform(0.3, 0.99) / np.linalg.norm(away)
        turn *= rng.uniform(0.0, cone) / np.linalg.norm(turn)
        pairs.append((gripper, Pose.from_rotation(
            away, Rotation.from_rotvec(turn).as_matrix() @ gripper.rotation)))
    return pairs


def rotations(poses):
    """Return (n, 3, 3) of Poses, as the floor takes them."""
    return np.array([pose.rotation for pose in poses])


def hole(position, **size):
    """Return a CutOut that is passed along x."""
    return CutOut(Pose.looking_along(position, (1, 0, 0)), **size)


def scenes(friction=0.2):
    """Return name -> (DirectSimulator, poses): a wire lowered in steps of 10 mm."""
    edge = Rotation.from_euler('zx', (30, 45), degrees=True)
    up = Rotation.align_vectors([(0, 0, 1)], [(1, 1, 1)])[0]
    down = [level(z) for z in np.arange(0.98, 0.70, -0.01)]
    return {
        'oblique edge of a box': (_touching(
            [Box(Pose((0.4, 0, 0.65), edge.as_quat()), (0.3, 0.2, 0.2), friction)]), down),
        'corner of a box': (_touching(
            [Box(Pose((0.4, 0.01, 0.65), up.as_quat()), (0.2, 0.2, 0.2), friction)]), down),
        'hole in a sheet': (_touching(
            [Sheet.around(hole((0.4, 0, 1.0), radius=0.02), friction=friction)]),
            [level(z) for z in np.arange(1.0, 0.88, -0.01)]),
    }


def _touching(obstacles):
    return DirectSimulator(wire(1.5e-3), obstacles=obstacles)


def held(distance=0.8, height=1.0):
    """Return the FarEnd of a wire that is clamped at both ends."""
    return FarEnd(level(height, distance))
