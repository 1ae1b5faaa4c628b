# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # Contact
#
# Obstacles are arguments of the simulator: `Plane`, `Sphere`, `Capsule`, `Cylinder`, `Box`, and
# `Sheet`, a wall with holes. All may have friction.
import numpy as np

from dlo_planner import Capsule, DirectSimulator, InverseSimulator, Pose, Rod

wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
bar = Capsule((0.5, -0.5, 0.7), (0.5, 0.5, 0.7), 0.02)
simulator = DirectSimulator(wire, obstacles=[bar])

# %%
# Lower the wire onto the bar. With contact the way matters: `track` follows the poses, while
# `solve` begins each time with the undeformed wire.
way = [Pose((0, 0, z), (0, 0, 0, 1)) for z in np.linspace(1.0, 0.72, 8)]
lowered = simulator.track(way)
assert all(shape.converged for shape in lowered)
for shape in lowered:
    print([(round(c.s, 3), round(c.force, 4)) for c in shape.contacts])
assert lowered[-1].contacts and lowered[-1].contacts[0].force > 0

# %%
# The inverse task: touch the bar on its top, at s = 0.6 m of the wire. The contact's pose has the
# wire's direction as x axis and the outward normal as z axis. The force is free, which leaves a
# family of solutions; `condition` picks one.
top = Pose((0.5, 0, 0.72), (0, 0, 0, 1))
held = InverseSimulator(simulator).hold_contact(top, s=0.6, condition='least_force')
print(held.grippers[0], held.shapes[0].contacts)
assert abs(held.shapes[0].contacts[0].s - 0.6) < 0.01

# %%
# Slide the wire over the bar, from s = 0.7 m to 0.5 m, with its direction there kept.
slid = InverseSimulator(simulator).slide_contact(top, np.linspace(0.7, 0.5, 5))
print(len(slid), 'poses, largest miss', slid.position_error.max())
