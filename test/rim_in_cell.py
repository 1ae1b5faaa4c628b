# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A cable of 0.6 m through a level hole by one hand and the rim, in the cell's engine.

`python test/rim_in_cell.py` plans it and executes the stages in open loop, all as planned but the
engine: printed is how far the cable is from the plan at the end of each stage, how far it moves
where the hand opens, and how much has passed.
"""

import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent.parent)]

from dlo_planner import (  # noqa: E402
    CutOut,
    DirectSimulator,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Trajectory,
)
from dlo_planner.cell.plant import STEP, Plant  # noqa: E402
from dlo_planner.tasks import ThreadInGrasps  # noqa: E402

CABLE = Rod(0.6, 0.035, 1.2e-3, 1.0e-3, radius=2e-3, damping=0.02)
HOLE = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=8e-3)
FEED = Pose.looking_along((-0.2, -0.1, 1.0), (0, 0, -1))
RIM = Sheet.around(HOLE, 0.3, 0.3, 1e-3, friction=0.5)
PERIOD, WAIT = 0.02, 3.0  # s


def rest(plant, seconds):
    for _ in range(int(seconds / PERIOD)):
        plant.move(FEED, PERIOD)


def main():
    direct = DirectSimulator(CABLE, basis='local', n_elements=100, obstacles=[RIM])
    plan = InverseSimulator(direct).plan(ThreadInGrasps(HOLE, 0.36, FEED, grip_distance=0.04,
                                                        on_rim=True))
    print(plan, [str(event) for event in plan.events], flush=True)
    limits = Limits(linear_speed=0.05, angular_speed=0.3)
    hands = [plan.shapes[0].holds[0],
             *(event.hold for event in plan.events if event.kind == 'close')]
    plant = Plant(CABLE, FEED, [RIM], step=STEP, cells=60, damping=0.02, hands=hands)
    plant.close(0, hands[0].pose)
    s, closed = np.linspace(0, 1, 41) * plant.length, 0
    for k, stage in enumerate(plan.stage_plans):
        for event in (one for one in plan.events if one.stage == k):
            rest(plant, WAIT)
            if event.kind == 'close':
                closed += 1
                print(f'  caught {plant.close(closed, event.hold.pose):.4f} m off', flush=True)
                continue
            before = plant.points(s)
            plant.open(closed)
            rest(plant, WAIT)
            moved = np.linalg.norm(plant.points(s) - before, axis=1).max()
            print(f'  opened, moves by {moved:.4f} m', flush=True)
        if stage.arms:  # in contact nothing is simulated for a trajectory
            motion = Trajectory(stage, limits, simulator=direct, tolerance=np.inf)
            times = PERIOD * np.arange(1, int(motion.duration / PERIOD) + 2)
            for pose in motion.arm('first').poses(times):
                plant.move(FEED, PERIOD, hands={closed: pose})
        off = np.linalg.norm(plant.points(s) - stage.shapes[-1].positions_at(s), axis=1).max()
        print(f'{stage.starts[0][0]}: {off:.4f} m off, passed {plant.passage(HOLE).depth:.4f} m '
              f'of {stage.depths[-1]:.4f}', flush=True)


if __name__ == '__main__':
    main()
