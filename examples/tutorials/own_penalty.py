# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
# %%
# # A penalty of your own
#
# `minimize_penalty` and the task `Minimize` take any value with two methods: `residuals(shape)`,
# numbers whose squares add up to the penalty, and `slopes(shape, sensitivity)`, their derivatives
# by the gripper's rotation (rad) and displacement (m). This one keeps the tangent of the DLO at
# some arc lengths as it is in a given shape.
from dataclasses import dataclass

import numpy as np

from dlo_planner import DirectSimulator, InverseSimulator, Minimize, Pose, Rod
from dlo_planner.penalties import PositionAt, Sensitivity, Value, put


@dataclass(frozen=True, eq=False, repr=False)
class SameTangents(Value):
    """The tangents (k, 3) at arc lengths (k,) stay as they are."""

    s: np.ndarray
    tangents: np.ndarray
    weight: float = 1.0

    def __post_init__(self):
        put(self, s=np.array(self.s, dtype=float), tangents=np.array(self.tangents, dtype=float))
        super().__post_init__()

    def residuals(self, shape):
        """Return (3 k,)."""
        return self.weight * np.ravel([shape.frame_at(s)[0][:, 0] - tangent
                                       for s, tangent in zip(self.s, self.tangents, strict=True)])

    def slopes(self, shape, sensitivity):
        """Return (3 k, 6): a tangent t turns with the rate w x t, w (3, 6) by the gripper."""
        return self.weight * np.vstack([
            np.cross(sensitivity.at(s)[:3].T, shape.frame_at(s)[0][:, 0]).T for s in self.s])


# %%
# Derivatives are easily wrong. Differences between predicted shapes tell at once.
wire = Rod.circular(1.0, 1.5e-3, 8960, 110e9, 0.34)
simulator = DirectSimulator(wire)
start = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
before = simulator.solve(start)
places = (0.7, 0.85, 1.0)
same = SameTangents(places, [before.at(s).direction for s in places], weight=5.0)

sensitivity = Sensitivity(before)
for k, step in enumerate(1e-6 * np.eye(6)):
    ahead, back = (same.residuals(sensitivity.moved(sign * step)) for sign in (1, -1))
    assert np.abs((ahead - back) / 2e-6 - same.slopes(before, sensitivity)[:, k]).max() < 1e-5

# %%
# Bring the free end 10 cm up and to the left, the last part as it was. A task is a value too: it
# can be written to a file and read again, penalties of your own included.
target = before.positions[-1] + [0.0, 0.1, 0.1]
task = Minimize([PositionAt(1.0, target), same])
plan = InverseSimulator(simulator).plan(task, start=start)
shape = plan.shapes[0]
print('free end', np.linalg.norm(shape.positions[-1] - target), 'm off, tangents',
      np.abs(same.residuals(shape)).max() / same.weight, 'off')
assert np.linalg.norm(shape.positions[-1] - target) < 1e-4
assert np.abs(same.residuals(shape)).max() / same.weight < 1e-3
assert type(task).from_dict(task.to_dict()) == task

# %%
# The package has one for a whole stretch: `KeepTangent(begin, end, direction)`.
