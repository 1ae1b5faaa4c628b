# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Through two holes
#
# A wire that has passed one wall has to meet the hole in the next one. `thread_two` solves for
# both crossings at once.
from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Pose, Rod, replay

wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
simulator = DirectSimulator(wire)
first = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)))
second = CutOut(Pose.looking_along((0.3, 0.05, 0.95), (1, 0, 0)))
plan = InverseSimulator(simulator).thread_two(first, second)

# %%
# A gripper has six degrees of freedom. In each hole the wire has to meet the center (two
# equations) and, as well as it can, the normal. `misalignment` says how far the directions are
# off.
print(len(plan), 'poses, miss', plan.position_error.max(), 'm, misalignment',
      plan.misalignment.max(), 'rad')
assert plan.fraction == 1 and plan.stability.min() > 0

# %%
# The slow replay finds the same shapes again, by the direct simulator alone.
report = replay(simulator, plan)
print('replayed miss', report.position_error)
assert report.position_error < 1e-4

# %%
# For three holes and more, `thread_sequence` brings the wire as near to all of them as it can.
