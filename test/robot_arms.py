# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Arms of example-robot-data, trajectories for them, and kinematics of their URDF by hand."""

from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlo_planner import Limits, Pose
from dlo_planner.arm import Arm
from dlo_planner.plan.path import GripperPath
from dlo_planner.trajectory.timed_path import TimedPath, fastest_law


def _robots():
    """Return the folder of the robots of example-robot-data, which has no module to ask."""
    try:
        files = distribution('example-robot-data').files
    except PackageNotFoundError:
        pytest.skip('example-robot-data is not installed', allow_module_level=True)
    file = next(file for file in files if file.name == 'panda.urdf')
    return Path(file.locate()).resolve().parents[2]


pytest.importorskip('pinocchio', reason='the extra [arm] is not installed')
ROBOTS = _robots()
PACKAGES = (str(ROBOTS.parent.parent),)  # the folder of the package example-robot-data
PANDA_READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
UR5_READY = np.array([0.3, -1.5, 1.8, -0.9, 1.2, 0.4])


@cache
def urdf(path):
    return (ROBOTS / path).read_text()


@cache
def panda(**more):
    return Arm(urdf('panda_description/urdf/panda.urdf'), 'panda_hand_tcp', packages=PACKAGES,
               **more)


@cache
def ur5(name='ur5_robot', **more):
    return Arm(urdf(f'ur_description/urdf/{name}.urdf'), 'tool0', packages=PACKAGES, **more)


@cache
def kinova():
    return Arm(urdf('kinova_description/robots/kinova.urdf'), 'j2s6s200_end_effector',
               packages=PACKAGES)


def timed(poses, limits=None):
    """Return the TimedPath through Poses within limits, that looks at no DLO."""
    limits = limits or Limits()
    path = GripperPath.through(poses, np.linspace(0, 1, len(poses)), 1.0)
    return TimedPath(path, tuple(fastest_law(leg, limits) for leg in path.legs), limits)


def way(begin, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), number=9):
    """Return Poses that go from one by a shift, and turn by a rotation vector, world axes."""
    parts = np.linspace(0, 1, number)
    return [Pose.from_rotation(begin.position + part * np.array(shift),
                               Rotation.from_rotvec(part * np.array(turn)).as_matrix()
                               @ begin.rotation) for part in parts]


def placed_by_hand(text, link, positions):
    """Return (4, 4): the frame of a link in the root link, multiplied out of the URDF.

    Args:
        positions: dict of joint positions; others stand at 0
    """
    joints = {joint.find('child').get('link'): joint
              for joint in ElementTree.fromstring(text).findall('joint')}
    matrix = np.eye(4)
    while link in joints:
        joint = joints[link]
        matrix = _origin(joint) @ _moved(joint, positions.get(joint.get('name'), 0.0)) @ matrix
        link = joint.find('parent').get('link')
    return matrix


def _numbers(element, name, default):
    text = None if element is None else element.get(name)
    return np.array(default if text is None else [float(part) for part in text.split()])


def _origin(element):
    origin, matrix = element.find('origin'), np.eye(4)
    matrix[:3, :3] = Rotation.from_euler('xyz', _numbers(origin, 'rpy', (0.0,) * 3)).as_matrix()
    matrix[:3, 3] = _numbers(origin, 'xyz', (0.0,) * 3)
    return matrix


def _moved(joint, position):
    axis, matrix = _numbers(joint.find('axis'), 'xyz', (1.0, 0.0, 0.0)), np.eye(4)
    if joint.get('type') == 'prismatic':
        matrix[:3, 3] = axis * position
    elif joint.get('type') in ('revolute', 'continuous'):
        matrix[:3, :3] = Rotation.from_rotvec(axis * position).as_matrix()
    return matrix


def corners_by_hand(text, packages):
    """Yield the link and the corners (k, 3), in its axes, of each collision mesh or box."""
    for link in ElementTree.fromstring(text).findall('link'):
        for collision in link.findall('collision'):
            mesh, box = (collision.find(f'geometry/{kind}') for kind in ('mesh', 'box'))
            if mesh is not None:
                name = mesh.get('filename').removeprefix('package://')
                corners = np.concatenate(_triangles(Path(packages[0]) / name))
                corners = np.unique(corners, axis=0) * _numbers(mesh, 'scale', (1.0,) * 3)
            else:
                half = 0.5 * _numbers(box, 'size', None)
                corners = half * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, 8).T
            matrix = _origin(collision)
            yield link.get('name'), corners @ matrix[:3, :3].T + matrix[:3, 3]


def _triangles(path):
    """Return the triangles (k, 3, 3) of a binary STL."""
    row = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('more', '<u2')])
    return np.fromfile(path, row, offset=84)['corners'].astype(float)
