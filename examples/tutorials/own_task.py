# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # A task of your own
#
# A task is a frozen value with two methods: `__post_init__` judges what it is given, and
# `solve(context)` returns the Plan. It is planned, pickled and written to YAML like those of the
# package. This one draws a line with the free end, as a gluing nozzle would.
from dataclasses import dataclass

import numpy as np

from dlo_planner import DirectSimulator, Infeasible, InvalidTask, InverseSimulator, Plan, Pose, Rod
from dlo_planner.penalties import PositionAt, minimize_penalty
from dlo_planner.tasks import PlanContext, Task, put, waypoint_at


@dataclass(frozen=True, eq=False, repr=False)
class DrawLine(Task):
    """The free end goes along a straight line.

    Attributes
    ----------
    begin : ndarray, shape (3,)
        Begin in m.
    end : ndarray, shape (3,)
        End in m.
    points : int
        How many waypoints.
    """

    begin: np.ndarray
    end: np.ndarray
    points: int = 5

    def __post_init__(self):
        put(self, begin=np.array(self.begin, dtype=float), end=np.array(self.end, dtype=float))
        if self.begin.shape != (3,) or self.end.shape != (3,) or not 2 <= self.points <= 1000:
            raise InvalidTask(f'{self}: expected two points (3,) in m, and 2 to 1000 waypoints')
        super().__post_init__()

    def solve(self, context: PlanContext) -> Plan:
        """Return the Plan: at each point the gripper is moved as little as need be."""
        if context.start is None:
            raise InvalidTask('start = None: expected a Pose of the gripper')
        length, gripper, shape = context.rod.length, context.start, None
        builder = context.builder(np.zeros(self.points))
        for share in np.linspace(0, 1, self.points):
            place = self.begin + share * (self.end - self.begin)
            found = minimize_penalty(context.without_obstacles, PositionAt(length, place), gripper,
                                     initial=shape, deadline=context.progress.left())
            if not found.converged:
                raise builder.refusal('equilibrium', found.slope, f'{place} cannot be reached', '')
            gripper, shape = found.gripper, found.shape
            builder.add(waypoint_at(shape, place, length, None))  # judged: workspace, obstacles ...
        return builder.finished()


# %%
# Plan it: the requirements of the simulator, progress and deadline count as for any task.
wire = Rod.circular(0.6, 1.5e-3, 8960, 110e9, 0.34)
inverse = InverseSimulator(DirectSimulator(wire))
start = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
line = DrawLine((0.55, 0.0, 0.95), (0.55, 0.2, 0.95))
plan = inverse.plan(line, start=start)
print(plan)
assert len(plan) == 5 and plan.position_error.max() < 1e-5

# %%
# What is refused says why, and carries the plan up to there.
from dlo_planner import Workspace  # noqa: E402
from dlo_planner.tasks import Requirements  # noqa: E402

low = Requirements(workspace=Workspace((-1, -1, 0), (1, 0.1, 2)))
try:
    inverse.plan(line, start=start, requirements=low)
except Infeasible as error:
    print(error, '- planned before:', len(error.plan))
    assert error.constraint == 'workspace.upper.y'

# %%
# The task as a YAML file, and back.
from dlo_planner.tasks import task_from_yaml, task_to_yaml  # noqa: E402

print(task_to_yaml(line))
assert task_from_yaml(task_to_yaml(line)) == line
