# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What a user writes; `test_annotations.py` has it checked by mypy, and runs it."""

from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

from dlo_planner import (
    Box,
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Limits,
    Plan,
    Pose,
    Rod,
    Shape,
    Sheet,
    Trajectory,
    replay,
)
from dlo_planner.results import ValidationReport

Floats = NDArray[np.float64]


def tip(shape: Shape) -> Floats:
    """Return the position (3,) of the free end, m."""
    return shape.at(float(shape.s[-1])).position


def gripper_path(plan: Plan) -> list[Floats]:
    """Return the gripper's positions (3,) at the waypoints, m."""
    assert_type(plan.grippers, tuple[Pose, ...])
    assert_type(plan.clearance, Floats)
    return [point.gripper.position for point in plan]


def threaded(rod: Rod, cutout: CutOut) -> Plan | None:
    """Return a plan through a cut-out, None if there is none."""
    simulator = DirectSimulator(rod, obstacles=[Sheet.around(cutout)])
    try:
        return InverseSimulator(simulator).thread(cutout, depths=[0.02, 0.04])
    except Infeasible as error:
        assert_type(error.waypoint, int)
        assert_type(error.plan, Any)  # errors import nothing that may raise them
        return None


def main() -> None:
    """Predict, plan, time and check."""
    rod = Rod.circular(0.4, 1e-3, 8960, 110e9, 0.34)
    shape = DirectSimulator(rod, obstacles=[Box(Pose.identity(), (0.1, 0.1, 0.1))]).solve(
        Pose((0, 0, 0.5), (0, 0, 0, 1)))
    assert_type(shape, Shape)
    print(tip(shape) @ np.array([0.0, 0.0, 1.0]))
    plan = threaded(rod, CutOut(Pose.looking_along((0.4, 0.0, 0.5), [1.0, 0.0, 0.0]), radius=0.02))
    if plan is None:
        return
    print(gripper_path(plan)[0])
    motion = Trajectory(plan, Limits(linear_speed=0.05), tolerance=np.inf)
    poses, velocities, _ = motion.at([0.0, motion.duration])
    assert_type(poses, list[Pose])
    assert_type(velocities, Floats)
    report = replay(DirectSimulator(rod), plan)
    assert_type(report, ValidationReport)
    print(report.summary())


if __name__ == '__main__':
    main()
