# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cable goes through a hole, hand over hand: planned in stages, each timed and proved.

python examples/thread_in_grasps.py [folder]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    replay,
)
from dlo_planner.tasks import ThreadInGrasps  # noqa: E402


def main():
    """Plan, prove and draw it."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.008)
    sheet = Sheet.around(hole, 0.3, 0.3, 1e-3)
    cable = Rod(1.0, 0.035, 1.2e-3, 1.0e-3, radius=2e-3, damping=0.02)  # as USB cables are
    simulator = DirectSimulator(cable, n_elements=100, basis='local', obstacles=[sheet])
    feed = Pose.looking_along((-0.25, -0.2, 1.0), (0, 0, -1))  # it comes down from a spool
    plan = InverseSimulator(simulator).plan(ThreadInGrasps(hole, 0.5, feed, stroke=0.2))
    print(plan)
    for k, (stage, alone) in enumerate(zip(plan.stages, plan.stage_plans, strict=True)):
        for event in plan.events:
            if event.stage == k:
                print(f'  {event}, where the DLO is at {event.hold.pose.position.round(3)}')
        said = f'{stage.name}: clearance {alone.clearance.min() * 1e3:.1f} mm'
        if alone.arms:
            report = replay(simulator, alone, initial=alone.shapes[0], limits=Limits())
            said += (f', {report.trajectory.duration:.1f} s, safe: {report.safe} {report.reason}'
                     f'swings by {report.swing * 1e3:.1f} mm')
        print(said)
    plan.plot(obstacles=[sheet]).savefig(folder / 'thread_in_grasps.png', dpi=100)


if __name__ == '__main__':
    main()
