# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A compliant hand with a plug in a physics engine: whether it goes into its socket, how hard.

The hand is a body with the apparent mass of a robot under impedance control: springs and dampers
pull it to where it is commanded to be, and what is fed forward acts on it. The plug sits in the
hand with an error that nobody knows; its cable is the chain of `Plant`. The hand's own weight is
compensated, that of the plug and the cable is not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.cell.chain import DLO, SCENE, mujoco
from dlo_planner.cell.plant import Plant
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value

_GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s^2
_EVERY = 2  # steps of time in a cycle of the hand's controller, 2 ms


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


@dataclass(frozen=True, eq=False, repr=False)
class Felt(Value):
    """What a hand felt on the way; forces in N.

    Attributes
    ----------
    largest : float
        The largest force of the socket and all else on plug and hand together.
    commanded : float
        The largest force of the hand, of springs, dampers and what was fed forward.
    above : float
        The longest time for which one of both was above the limit, s.
    """

    largest: float
    commanded: float
    above: float


class HeldPlug(Plant):
    """A plug in a compliant hand, with its cable, at rest at first at `gripper`.

    `error` is where the plug truly sits in the hand, seen from where it is thought to be. The
    other parameters are those of `Plant`.
    """

    def __init__(self, rod: Rod, plug: Plug, gripper: Pose, obstacles: Sequence[Obstacle] = (), *,
                 far_end: FarEnd, error: Pose | None = None, hand: Hand | None = None,
                 limit: float = 20.0, cells: int = 40, step: float = 1e-3) -> None:
        self.plug, self.hand = plug, hand or Hand()
        self._error = error or Pose.identity()
        self._limit, self._above = limit, 0.0
        self.felt = Felt(0.0, 0.0, 0.0)
        super().__init__(rod, gripper.compose(self._error), obstacles, cells=cells, step=step,
                         damping=0.05, far_end=far_end)
        self._let_go()

    @property
    def front(self) -> Pose:
        """Pose of the plug's true front."""
        return self.plug.front(self._body())

    def led(self, gripper: Pose, seconds: float, wrench: Floats | None = None,
            push: Floats | None = None) -> None:
        """Command the hand to a Pose of the gripper, from where it was, evenly within some seconds.

        `wrench` (6,) is fed forward at the plug's front as it is thought to be, world axes; `push`
        (3,) is one more force there, N.
        """
        begin, steps = self.measured, max(1, round(seconds / self._step))
        turn = Rotation.from_matrix(gripper.rotation @ begin.rotation.T).as_rotvec()
        twist = np.concatenate([gripper.position - begin.position, turn]) / seconds
        fed = np.zeros(6) if wrench is None else np.array(wrench)
        fed[:3] += 0.0 if push is None else push
        self._step_is(seconds / steps)
        for k in range(1, steps + 1):
            if k % _EVERY == 1 or k == steps:
                share = k / steps
                goal = Pose.from_rotation(
                    begin.position + share * (gripper.position - begin.position),
                    Rotation.from_rotvec(share * turn).as_matrix() @ begin.rotation)
                self._pull(goal, twist, fed)
            mujoco.mj_step(self._model, self._data)
            self._note(seconds / steps)
        self.time += seconds
        self.measured = gripper

    def _fit(self, gripper: Any) -> None:
        """Add the plug to the gripper's body, as it sits there."""
        back = self.plug.grasp.inverse()
        ends = [back.position + x * back.rotation[:, 0] for x in self.plug.ends]
        gripper.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(self.plug.radius, 0, 0),
                         fromto=np.concatenate(ends), contype=DLO, conaffinity=SCENE, condim=1,
                         friction=(0, 0, 0))

    def _let_go(self) -> None:
        """Give the hand its own mass: until now it was held in its place."""
        model, unit = self._model, self._chain.unit
        model.body_mass[1] = (self.hand.mass + self.plug.mass) / unit
        model.body_inertia[1] = self.hand.inertia / unit
        mujoco.mj_setConst(model, mujoco.MjData(model))
        mujoco.mj_forward(model, self._data)
        self.measured = self.measured.compose(self._error.inverse())

    def _body(self) -> Pose:
        """Where the cable truly begins."""
        return Pose(self._data.qpos[:3], np.roll(self._data.qpos[3:7], -1))

    def _pull(self, goal: Pose, twist: Floats, fed: Floats) -> None:
        """Let the hand be pulled to a goal that moves with a twist, and what is fed forward act."""
        body, hand = self._body(), self.hand
        held = body.compose(self._error.inverse())
        turning = body.rotation @ self._data.qvel[3:6]
        speed = self._data.qvel[:3] + np.cross(turning, held.position - body.position)
        damping = [2 * np.sqrt(k * m) for k, m in (
            (hand.stiffness, hand.mass), (hand.rotational, hand.inertia))]
        force = hand.stiffness * (goal.position - held.position) + damping[0] * (twist[:3] - speed)
        moment = hand.rotational * Rotation.from_matrix(
            goal.rotation @ held.rotation.T).as_rotvec() + damping[1] * (twist[3:] - turning)
        front = self.plug.front(held).position  # where it is thought to be
        weight = self.plug.mass * _GRAVITY
        true = self.plug.front(body)
        center = true.position - 0.5 * self.plug.length * true.rotation[:, 0] - body.position
        self._commanded = float(np.linalg.norm(force + fed[:3]))
        total = force + fed[:3] + weight
        about = (moment + fed[3:] + np.cross(held.position - body.position, force)
                 + np.cross(front - body.position, fed[:3]) + np.cross(center, weight))
        # the hand's mass and the plug's is compensated by the engine, the plug's weight acts here
        self._data.xfrc_applied[1, :3] = total / self._chain.unit
        self._data.xfrc_applied[1, 3:] = about / self._chain.unit

    def _note(self, seconds: float) -> None:
        """Note the forces of a step."""
        felt = float(np.linalg.norm(self._touched()))
        over = max(felt, self._commanded) > self._limit
        self._above = self._above + seconds if over else 0.0
        self.felt = Felt(max(self.felt.largest, felt), max(self.felt.commanded, self._commanded),
                         max(self.felt.above, self._above))

    def _touched(self) -> Floats:
        """Return the sum (3,) of all forces that touch the plug, N."""
        wrench, total = np.zeros(6), np.zeros(3)
        for k, contact in enumerate(self._data.contact):
            bodies = self._model.geom_bodyid[contact.geom]
            if 1 not in bodies:
                continue
            mujoco.mj_contactForce(self._model, self._data, k, wrench)
            sign = 1.0 if bodies[1] == 1 else -1.0  # the normal goes from the first to the second
            total += sign * contact.frame.reshape(3, 3).T @ wrench[:3]
        return self._chain.unit * total
