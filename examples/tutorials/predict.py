# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Predict a shape
#
# A gripper holds one end of a copper wire. Where is the other end?
#
# The DLO is a `Rod`: all that the simulator needs to know about it, in SI units. `Rod.circular`,
# `Rod.tube` and `Rod.rectangular` compute stiffness and weight from a section and a material.
import numpy as np

from dlo_planner import DirectSimulator, Pose, Rod

wire = Rod.circular(length=1.0, diameter=1.5e-3, density=8960, youngs_modulus=110e9,
                    poisson_ratio=0.34)
print(wire.bending_stiffness)  # N m^2, about both axes of the section

# %%
# A simulator belongs to one rod and one surrounding. The x axis of the gripper's pose is the
# tangent of the DLO there; here it looks along the world's x axis, 1 m above the floor.
simulator = DirectSimulator(wire)
gripper = Pose.looking_along((0, 0, 1), (1, 0, 0))
shape = simulator.solve(gripper)
print('free end', shape.positions[-1])

# %%
# Look at the proof before you use a shape. `converged` says whether the solver finished,
# `stability` whether the DLO stays there (1: no load, 0: about to fall over), `error_estimate`
# how far nodes may be off, in m.
assert shape.converged and shape.stability > 0
print(shape.residual, shape.stability, shape.error_estimate)
print('force and moment on the gripper', shape.gripper_wrench)

# %%
# With `accuracy=` the simulator picks its own mesh. What both predict agrees within the estimates.
fine = DirectSimulator(wire, accuracy=1e-6).solve(gripper)
gap = np.linalg.norm(fine.positions[-1] - shape.positions[-1])
print(f'{1e3 * gap:.4f} mm apart')
assert gap <= shape.error_estimate + fine.error_estimate

# %%
# A motion is a sequence of poses. `track` lets the DLO follow slowly: each shape begins with the
# one before it, and `jumped` says where the DLO had to leap into another shape. `simulate` is the
# same with inertia and damping.
way = [Pose.looking_along((0, 0, 1), (np.cos(a), 0, np.sin(a))) for a in np.linspace(0, 1, 11)]
followed = simulator.track(way)
assert all(one.converged for one in followed)
print('free end at the end', followed[-1].positions[-1], 'jumps', sum(
    one.jumped for one in followed))

# %%
# `shape.plot()` draws it (extra `figures`), `shape.summary()` is a table, `shape.save('wire.npz')`
# keeps all numbers exactly.
print(shape.summary())
