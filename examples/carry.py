# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Two arms carry a cable over a box: planned, timed within the limits of both, and proved.

python examples/carry.py [folder]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    Box,
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    replay,
)
from dlo_planner.tasks import Carry  # noqa: E402


def main():
    """Plan, prove and draw it."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    ahead = (0, 0, 0, 1)
    box = Box(Pose((0.0, 0.0, 0.3), ahead), (0.4, 0.1, 0.6), name='box')
    cable = Rod.circular(1.0, 8e-3, 1500, 5e7, 0.4, max_bend_curvature=25.0, damping=0.01)
    simulator = DirectSimulator(cable, n_elements=32, basis='local', obstacles=[box])
    task = Carry(to=Pose((-0.35, 0.3, 0.6), ahead), far_end_to=Pose((0.35, 0.3, 0.6), ahead),
                 far_end=FarEnd(Pose((0.35, -0.3, 0.6), ahead)), max_force=1.5, max_moment=0.3,
                 clearance=0.01)
    plan = InverseSimulator(simulator).plan(task, start=Pose((-0.35, -0.3, 0.6), ahead))
    print(plan)
    for name, poses in plan.arms.items():
        print(f'{name}: from {poses[0].position} to {poses[-1].position}')
    report = replay(simulator, plan, obstacles=[box], limits=Limits(), tolerance=5e-3)
    motion = report.trajectory
    print(f'safe: {report.safe} {report.reason}')
    print(f'{motion.duration:.1f} s, swings by {report.swing * 1e3:.1f} mm, at the end by '
          f'{report.departure * 1e3:.1f} mm; forces at the grips {motion.motion.grip_force:.2f} N '
          'at most')
    plan.plot(obstacles=[box]).savefig(folder / 'carry.png', dpi=100)


if __name__ == '__main__':
    main()
