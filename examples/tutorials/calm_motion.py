# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Motions that arrive calm
#
# A plan is a path. Followed at any speed, the wire swings and misses. A `Trajectory` is the fastest
# motion found along the path that keeps limits and, in its own simulation, leaves the wire within
# a tolerance.
import numpy as np

from dlo_planner import CutOut, DirectSimulator, InverseSimulator, Limits, Pose, Rod, Trajectory

wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34, damping=(0.5, 0.01))
simulator = DirectSimulator(wire)
hole = CutOut(Pose.looking_along((1.0, 0.2, 0.8), (1, 1, 0)))
plan = InverseSimulator(simulator).thread(hole, depths=np.linspace(0, 0.2, 8))

# %%
# How does the wire swing? `modes` gives natural frequencies, damping and mode shapes at rest.
modes = plan.shapes[0].modes(2)
print('periods', modes.periods, 's')

# %%
# Two motions: the fastest within the limits, which nobody simulates (`tolerance=np.inf`), and the
# one that is simulated and stays within 3 mm.
fastest = Trajectory(plan, Limits(), tolerance=np.inf)
calm = Trajectory(plan, Limits(), tolerance=3e-3)
print(f'fastest {fastest.duration:.2f} s, calm {calm.duration:.2f} s')
assert calm.duration >= fastest.duration

# %%
# `at` gives poses, velocities and accelerations at any times, as a controller needs them.
poses, velocities, accelerations = calm.at(np.linspace(0, calm.duration, 5))
print(poses[-1], velocities[-1])
assert np.abs(velocities[-1]).max() < 1e-9  # it ends at rest

# %%
# `mode_margin` says by which part the frequencies may be off before the miss is twice the
# tolerance.
print('frequencies may be off by', calm.mode_margin)
