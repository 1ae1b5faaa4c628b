# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cable is laid through clips and a fork: planned, pressed in, proved stage by stage.

python examples/route.py [folder]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))
from dlo_planner import (  # noqa: E402
    DirectSimulator,
    FarEnd,
    InverseSimulator,
    Plane,
    Pose,
    Rod,
    replay,
)
from dlo_planner.tasks import Clip, Fork, Route  # noqa: E402


def main():
    """Plan, prove and draw it."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'demo_output')
    folder.mkdir(parents=True, exist_ok=True)
    seat = Pose.looking_along  # tangents point from the gripper on
    board = Plane((0, 0, 0), (0, 0, 1), name='board')
    cable = Rod(1.0, 0.02, 4e-3, 2e-3, radius=3e-3)
    simulator = DirectSimulator(cable, n_elements=64, basis='local', obstacles=[board])
    fittings = [Clip(seat((0.15, 0.0, 0.1), (-1.0, -0.1, 0)), push=0.15, room=8e-4),
                Fork(seat((0.30, 0.03, 0.1), (-1.0, -0.3, 0)), push=0.1, room=8e-4, slip=0.2),
                Clip(seat((0.44, 0.10, 0.1), (-1.0, -0.6, 0)), push=0.15, room=8e-4)]
    plug = FarEnd(seat((0, 0, 0.1), (-1, 0, 0)))
    plan = InverseSimulator(simulator).plan(Route(fittings, far_end=plug),
                                            start=seat((0.98, 0, 0.2), (-1, 0, 0)))
    print(plan)
    for event in plan.events:
        print(f'before {plan.stages[event.stage].name}: {event}')
    last = plan.shapes[-1]
    for hold, wrench, tension in zip(last.holds, last.wrenches, plan.tensions[-1], strict=False):
        print(f'{hold.by}: s = {hold.s if hold.s is not None else last.s[-1]:.3f} m, bears '
              f'{(wrench[:3] @ wrench[:3]) ** 0.5:.2f} N, before it the tension is {tension:.2f} N')
    reports = [replay(simulator.without_obstacles(), stage, initial=stage.shapes[0])
               for stage in plan.stage_plans]
    print(f'replayed: {all(report.converged for report in reports)}, at most '
          f'{1e3 * max(report.deviation for report in reports):.2g} mm off')
    plan.plot(obstacles=[board]).savefig(folder / 'route.png', dpi=100)


if __name__ == '__main__':
    main()
