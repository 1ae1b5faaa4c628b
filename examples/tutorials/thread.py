# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Thread a wire through a hole
#
# The inverse simulator finds the gripper poses that bring the free end through a cut-out and push
# the wire on, so that it passes the center of the hole along its normal all the time.
import numpy as np

from dlo_planner import (
    CutOut,
    DirectSimulator,
    Infeasible,
    InverseSimulator,
    Limits,
    Pose,
    Rod,
    replay,
)

wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34, damping=(0.5, 0.01))
simulator = DirectSimulator(wire)
hole = CutOut(Pose.looking_along((1.0, 0.2, 0.8), (1, 1, 0)), radius=0.01)

# %%
# `depths` are the lengths, in m, that are through the hole at each waypoint.
plan = InverseSimulator(simulator).thread(hole, depths=np.linspace(0, 0.9, 30))
print(plan.summary())
assert plan.fraction == 1

# %%
# Each waypoint carries its proof: the miss at the hole, the stability of the shape, the room
# between the wire and the rim.
print(plan.position_error.max(), plan.stability.min(), plan.clearance.min())
assert plan.position_error.max() < 1e-6 and plan.stability.min() > 0 and plan.clearance.min() > 0

# %%
# `replay` executes the plan in the direct simulator, slowly and then in motion. `report.safe` is
# the answer to "may I run this on the robot?", `report.reason` says why not.
report = replay(simulator, plan, limits=Limits(), tolerance=3e-3)
print(report.safe, report.reason, report.max_tracking_error)
assert report.safe

# %%
# What cannot be done is refused by name. 1 mm of the same copper falls sideways before its free
# end is level:
thin = Rod.circular(1.0, 1e-3, 8960, 110e9, 0.34)
try:
    InverseSimulator(DirectSimulator(thin)).thread(CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0))))
except Infeasible as refused:
    reason = refused
print(reason, '|', reason.waypoint, reason.constraint)

# %%
# `plan.plot()` draws the plan, `plan.animate('film.gif')` makes a film, `plan.save('plan.npz')`
# keeps it.
