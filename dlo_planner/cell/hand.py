# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A DLO in a compliant hand, in a physics engine: a robot under impedance control.

The hand is a body with the apparent mass that the controller gives it: a spring and a damper draw
it to where it is commanded to be, and a wrench that is fed forward acts on it. With that of the
plan the hand is where the plan has it, and what pulls more or less than planned moves it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.cell.chain import mujoco
from dlo_planner.cell.plant import Plant
from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import vector
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value


@dataclass(frozen=True, eq=False, repr=False)
class Hand(Value):
    """A hand under impedance control, critically damped.

    Attributes
    ----------
    stiffness : float
        N/m.
    rotational : float
        N m/rad.
    mass : float
        Apparent mass, kg, and
    inertia : float
        kg m^2, as a controller shapes them.
    """

    stiffness: float = 500.0
    rotational: float = 20.0
    mass: float = 2.0
    inertia: float = 0.02


class InHand(Plant):
    """A DLO in a compliant hand, at rest at first at `gripper`, which holds it until then.

    `move` commands the hand; `measured` is where its encoders see it. Where the DLO truly sits in
    it, Truth says (`gripper_shift`, `gripper_turn`). The other parameters are those of `Plant`.
    """

    def __init__(self, rod: Rod, gripper: Pose, obstacles: Iterable[Obstacle] = (), *,
                 hand: Hand | None = None, **plant: Any) -> None:
        self.hand, self._fed = hand or Hand(), np.zeros(6)
        self.commanded = 0.0  # N, of springs, dampers and what is fed forward, as it is now
        super().__init__(rod, gripper, obstacles, **plant)
        self._back = Pose.from_rotation(self.truth.gripper_shift, self._turn).inverse()
        # (3, 3) by which the hand moves, seen from the DLO's beginning, as this turns
        self._swing = np.cross(np.eye(3), self._back.position)
        self._damping = [2 * np.sqrt(k * m) for k, m in (
            (self.hand.stiffness, self._mass), (self.hand.rotational, self.hand.inertia))]
        model, unit = self._model, self._chain.unit
        model.body_mass[1] = self._mass / unit
        model.body_inertia[1] = self.hand.inertia / unit
        mujoco.mj_setConst(model, mujoco.MjData(model))
        mujoco.mj_forward(model, self._data)

    def feed(self, wrench: ArrayLike) -> None:
        """Feed a wrench (6,) forward from now on, N and N m, world axes, about the gripper.

        As `Shape.gripper_wrench`: what the hand exerts on the DLO.
        """
        self._fed = np.array(vector('wrench', wrench, 6))

    @property
    def _mass(self) -> float:
        """The mass of the hand and of what it has, kg."""
        return self.hand.mass

    def _body(self) -> Pose:
        """Where the DLO truly begins."""
        return Pose(self._data.qpos[:3], np.roll(self._data.qpos[3:7], -1))

    def _load(self, axes: Floats) -> Floats:
        """Return what else acts on the hand, N and N m (6,), about where the DLO begins.

        `axes` (3, 3): those of the DLO there.
        """
        del axes
        return np.zeros(6)

    def move(self, gripper: Pose, seconds: float, far_end: Pose | None = None,
             hands: Mapping[int, Pose] | None = None) -> None:
        """Command the hand to a Pose, from where it was commanded to be, as `Plant.move`."""
        super().move(gripper, seconds, far_end, hands)
        self.measured = self._body().compose(self._back)

    def _advance(self, place: Floats, quaternion: Floats, twist: Floats) -> None:
        """Make one step; the hand is drawn to where the DLO would begin at a place."""
        data, hand, back = self._data, self.hand, self._back.position
        goal, axes, off = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
        mujoco.mju_quat2Mat(goal.reshape(-1), quaternion)
        mujoco.mju_quat2Mat(axes.reshape(-1), data.qpos[3:7])
        mujoco.mju_subQuat(off, quaternion, data.qpos[3:7])  # in the DLO's axes
        speeds = (twist[:3] + goal @ (twist[3:] @ self._swing)
                  - data.qvel[:3] - axes @ (data.qvel[3:6] @ self._swing))
        force = (hand.stiffness * (place + goal @ back - data.qpos[:3] - axes @ back)
                 + self._damping[0] * speeds + self._fed[:3])
        moment = (hand.rotational * axes @ off + self._fed[3:]
                  + self._damping[1] * (goal @ twist[3:] - axes @ data.qvel[3:6]))
        self.commanded = float(np.linalg.norm(force))
        acts = np.concatenate([force, moment + axes @ (self._swing @ (force @ axes))])
        # the hand's own weight is compensated
        data.xfrc_applied[1] = (acts + self._load(axes)) / self._chain.unit
        mujoco.mj_step(self._model, data)
        if data.ncon:
            self._feel()
