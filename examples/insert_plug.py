# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plug whose cable trails to a fixed end is inserted: planned, proved, and what to feed forward.

python examples/insert_plug.py [folder]
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Uncertainty,
    replay,
    robustness,
)
from dlo_planner.tasks import InsertPlug, Plug  # noqa: E402


def main():
    """Plan, prove and draw it."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    cable = Rod.circular(0.5, 6e-3, 2500, 6e7, 0.4, damping=0.01)
    socket = Pose.looking_along((0.2, 0.2, 0.05), (0, -1, 0))
    wall = Sheet(socket, 0.1, 0.1, 0.002, (CutOut(socket, radius=6.25e-3),), name='socket')
    simulator = DirectSimulator(cable, n_elements=32, basis='local', obstacles=[wall])
    plug = Plug(length=0.03, radius=6e-3, mass=0.02)
    task = InsertPlug(socket, plug, depths=np.linspace(0, 0.015, 7),
                      far_end=FarEnd(Pose.looking_along((0, 0, 0), (-1, 0, 0))))
    start = Pose((0.2, 0.35, 0.12), task.gripper_at(0.0).quaternion)
    plan = InverseSimulator(simulator).plan(task, start=start)
    print(plan)
    for stage in plan.stages:
        print(f'{stage.name}: the hand gives {stage.metric("plug_force").max():.2f} N and '
              f'{stage.metric("plug_moment").max():.3f} N m at most')
    errors = robustness(simulator, plan, Uncertainty(gripper_position=2e-3, gripper_rotation=0.04))
    wrong = np.linalg.norm(errors.plug_wrenches[-1].reshape(2, 3), axis=1)
    print(f'with a grasp that is 2 mm and 0.04 rad off about each axis: wrong by {wrong[0]:.2f} N '
          f'and {wrong[1]:.3f} N m in the socket')
    report = replay(simulator, plan, obstacles=[wall], limits=Limits(), tolerance=5e-3)
    print(f'safe: {report.safe} {report.reason}')
    plan.plot(obstacles=[wall]).savefig(folder / 'insert_plug.png', dpi=100)


if __name__ == '__main__':
    main()
