# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Closed loop: a wire that is not as its data sheet says
#
# 5 % of stiffness and some bend from the coil move the free end by centimeters. An `Observer`
# estimates such errors from points that a camera sees, and `correct` aims the plan anew.
import numpy as np

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Observer, Pose, Rod, Uncertainty
from dlo_planner.identify import Observation, correct

stated = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
hole = CutOut(Pose.looking_along((0, 0, 1), (1, 0, 0)), radius=0.01)
plan = InverseSimulator(DirectSimulator(stated)).thread(hole, depths=np.linspace(0, 0.9, 20))

# %%
# The real wire, which the planner does not know, stands in place of a camera.
real = Rod.circular(1.0, 1.5e-3, 8960, 1.06 * 110e9, 0.34, natural_curvature=(0.03, -0.05))
camera = DirectSimulator(real)
rng = np.random.default_rng(0)


def off(grippers, k):
    """Return by how much the real wire misses the hole at a waypoint."""
    shape = camera.solve(grippers[k], initial=plan.shapes[k])
    return shape.positions_at(wire_at(k)) - hole.center


def wire_at(k):
    """Return the arc length that should stand in the hole at a waypoint."""
    return stated.length - plan.depths[k]


print(f'open loop: {1e3 * np.linalg.norm(off(plan.grippers, 0)):.1f} mm off at the start')

# %%
# `Uncertainty` states what is uncertain, as standard deviations. The estimate starts from it and
# learns from each look. Points may come in any order.
observer = Observer(DirectSimulator(stated), Uncertainty(
    bending_stiffness=0.05, natural_curvature=0.05, curvature_variation=0.03), noise=1e-3)
estimate = observer.begin()
for k in (0, 3, 6):
    seen = camera.solve(plan.grippers[k], initial=plan.shapes[k]).positions[6::4]
    estimate = observer.update(estimate, Observation(
        plan.grippers[k], seen + 1e-3 * rng.normal(size=seen.shape)))

# %%
# The corrected plan, and what it is expected to miss by: a radius that holds 95 %.
aimed = correct(estimate, plan)
before = np.linalg.norm(off(plan.grippers, 0))
after = np.linalg.norm(off(aimed.grippers, 0))
print(f'corrected: {1e3 * after:.2f} mm off, expected {1e3 * aimed.miss.bound[0]:.2f} mm at most')
assert aimed.converged and after < 0.1 * before

# %%
# `ClosedLoop` is the strategy around it: when to look, to plan anew, to go, to correct, to stop.
# `TaskLoop` does all of this, for any robot and camera: the next tutorial. The node runs the same.
