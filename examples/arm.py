# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A wire is threaded by a robot arm: the gripper's trajectory as that of the arm's joints.

python examples/arm.py [robot.urdf tool_link folder-with-packages]; else a UR5 of the package
example-robot-data. Needs the extra `[arm]`.
"""

import sys
from importlib.metadata import distribution
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Pose,
    Rod,
    Trajectory,
)
from dlo_planner.arm import Arm, joint_trajectory, rolls_freely  # noqa: E402

WIRE = Rod.circular(0.35, 1e-3, 8960.0, 110e9, 0.34)
HOLE = CutOut(Pose.looking_along((0.75, 0.1, 0.5), (1, 0, 0)), radius=0.008)
TOOL = Pose((0.0, 0.0, 0.1), (0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)))  # x along the tool's z


def ur5():
    """Return the URDF, the tool link and the folder of packages of a UR5."""
    file = next(file for file in distribution('example-robot-data').files
                if file.name == 'ur5_robot.urdf')
    path = Path(file.locate()).resolve()
    return path, 'tool0', path.parents[4]


def main():
    """Plan, and print where the joints are when."""
    urdf, tool_link, folder = sys.argv[1:] or ur5()
    arm = Arm(Path(urdf).read_text(), tool_link, packages=(str(folder),))
    simulator = DirectSimulator(WIRE)
    plan = InverseSimulator(simulator).thread(HOLE, depths=np.linspace(0, 0.3, 25))
    trajectory = Trajectory(plan)
    joints = joint_trajectory(trajectory, arm, TOOL, free_roll=rolls_freely(simulator, plan))
    print(joints)
    print(f'the tool is off by {joints.position_error:.1e} m and {joints.angle_error:.1e} rad at '
          f'most; links stay {joints.self_clearance:.3f} m apart; rolled by {joints.roll:.2f} rad')
    times = np.linspace(0, joints.duration, 6)
    positions, speeds, _ = joints.at(times)
    print('time   ', *joints.joint_names)
    for time, row, speed in zip(times, positions, speeds, strict=True):
        print(f'{time:5.2f} s', *(f'{one:8.3f} ({rate:+.3f}/s)'
                                  for one, rate in zip(row, speed, strict=True)))


if __name__ == '__main__':
    main()
