# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # The closed loop with a robot and a camera of your own
#
# `TaskLoop` looks, plans for the DLO that it sees, goes, corrects and stops. It knows no clock, no
# message and no thread, so it runs wherever your robot and your camera do. Here a simulated wire,
# stiffer and more bent than its data sheet says, stands in place of both.
import numpy as np

from dlo_planner import (
    CutOut,
    DirectSimulator,
    DloPlannerError,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    Sheet,
    Thread,
    Uncertainty,
)
from dlo_planner.closed_loop import DloEstimator, EstimatorConfig, Feedback, LoopTask, TaskLoop
from dlo_planner.identify import Phase

stated = Rod.circular(0.3, 1e-3, 8960, 110e9, 0.34)
hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0.2, 0.1)), radius=4e-3)
start = Pose.looking_along((-0.36, -0.1, 1.02), (1, 0, 0))


class Cell:
    """Your robot and your camera: where the gripper is, where points of the wire are seen."""

    def __init__(self):
        self.rng, self.time, self.gripper = np.random.default_rng(0), 0.0, start
        self.real = DirectSimulator(Rod.circular(0.3, 1e-3, 8960, 1.06 * 110e9, 0.34,
                                                 natural_curvature=(0.2, -0.3)))
        self.shape = self.real.solve(start)
        self.sheet_is_off = np.array([0.0, 3e-3, -2e-3])

    def seen(self):
        """Return points of the wire in any order, and the center of the hole; 0.5 mm of noise."""
        self.shape = self.real.solve(self.gripper, self.shape)
        points = np.vstack([self.shape.positions_at(self.rng.uniform(0, 0.3, 20)),
                            hole.center + self.sheet_is_off])
        points += 0.5e-3 * self.rng.normal(size=points.shape)
        return points[:-1], points[-1]


# %%
# What is uncertain is stated as standard deviations. The defaults of `EstimatorConfig` are those of
# a usual camera: its calibration leaves 1 mm and 0.5 mrad, its stamps are wrong by 50 ms. Where the
# camera sees the hole as well, its own errors cancel.
seeing = EstimatorConfig(Uncertainty(bending_stiffness=0.05, natural_curvature=0.3,
                                     gripper_position=0.5e-3, gripper_rotation=3e-3),
                         noise=0.5e-3, cutout=3e-3)
simulator = DirectSimulator(stated, obstacles=[Sheet.around(hole)])
observing = DloEstimator(simulator, seeing)
task = LoopTask(InverseSimulator(simulator), Thread(hole, np.linspace(0, 0.1, 8)), standoff=0.03,
                limits=Limits(0.2, 1.0))
loop, cell, period = TaskLoop(task, observing, start, look=1.0, period=0.05), Cell(), 0.05

# %%
# The loop. Hand in where the gripper is measured, and what is seen, with the stamps of one clock;
# do the `work` that is asked for (plans, which take seconds: on a real robot in a thread); send the
# pose of each period to the robot. Points from a tracker that fills in what is hidden have to come
# in the same order each time, so that what it only carried along is told from what it saw.
while loop.phase not in (Phase.DONE, Phase.STOP):
    cell.time += period
    observing.gripper(cell.time, cell.gripper)
    loop.gripper(Feedback(cell.gripper, cell.time, stamp=cell.time))
    if observing.due(cell.time):
        points, center = cell.seen()
        try:
            observing.hole(hole.center, center)
            observing.look(cell.time, points)
        except DloPlannerError as error:  # a look that tells nothing
            print(error)
    command = loop.tick(cell.time)
    if command is not None:
        cell.gripper = command
    if (work := loop.work) is not None:
        try:
            loop.finish(work, work())
        except DloPlannerError as error:
            loop.finish(work, error)

# %%
# How it ended: `loop.reason` says why it stopped, if it did. `loop.miss_bound_95` is the largest
# miss that was expected at the entry, with 95 %.
plane = hole.pose.rotation.T @ (cell.real.solve(cell.gripper, cell.shape).positions.T
                                - (hole.center + cell.sheet_is_off)[:, None])
miss = np.hypot(*(np.interp(0.0, plane[0], row) for row in plane[1:]))
print(f'{loop.phase.value} after {cell.time:.1f} s; off the center by {1e3 * miss:.2f} mm, '
      f'promised {1e3 * loop.miss_bound_95:.2f} mm; the sheet is '
      f'{1e3 * np.linalg.norm(cell.sheet_is_off):.1f} mm from where it was stated')
assert loop.phase is Phase.DONE, loop.reason
assert miss < loop.miss_bound_95 < task.room
