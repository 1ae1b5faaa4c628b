# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A compliant hand with a plug in a physics engine: whether it goes into its socket, how hard.

The plug sits in the hand (`dlo_planner.cell.hand`) with an error that nobody knows; its cable is
the chain of `Plant`. The hand's own weight is compensated, that of the plug and the cable is not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlo_planner.cell.chain import DLO, SCENE, mujoco
from dlo_planner.cell.hand import Hand, InHand
from dlo_planner.cell.truth import Truth
from dlo_planner.model.arrays import Floats
from dlo_planner.model.holds import FarEnd
from dlo_planner.model.obstacles import Obstacle
from dlo_planner.model.plug import Plug
from dlo_planner.model.pose import Pose
from dlo_planner.model.rod import Rod
from dlo_planner.model.value import Value

_GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s^2


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


class HeldPlug(InHand):
    """A plug in a compliant hand, with its cable, at rest at first at `gripper`.

    `error` is where the plug truly sits in the hand, seen from where it is thought to be. The
    other parameters are those of `InHand`.
    """

    def __init__(self, rod: Rod, plug: Plug, gripper: Pose, obstacles: Sequence[Obstacle] = (), *,
                 far_end: FarEnd, error: Pose | None = None, hand: Hand | None = None,
                 limit: float = 20.0, cells: int = 40, step: float = 1e-3) -> None:
        self.plug = plug
        self._limit, self._above = limit, 0.0
        front = plug.front(Pose.identity())
        self._center = front.position - 0.5 * plug.length * front.rotation[:, 0]
        self._weight = plug.mass * _GRAVITY
        self.felt = Felt(0.0, 0.0, 0.0)
        sits = error or Pose.identity()
        super().__init__(rod, gripper, obstacles, hand=hand, cells=cells, step=step, damping=0.05,
                         far_end=far_end, truth=Truth(
                             gripper_shift=sits.position,
                             gripper_turn=Rotation.from_matrix(sits.rotation).as_rotvec()))

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
        fed = np.zeros(6) if wrench is None else np.array(wrench)
        fed[:3] += 0.0 if push is None else push
        fed[3:] += np.cross(self.plug.front(gripper).position - gripper.position, fed[:3])
        self.feed(fed)
        self.move(gripper, seconds)

    @property
    def _mass(self) -> float:
        return self.hand.mass + self.plug.mass

    def _load(self, axes: Floats) -> Floats:
        """Return the plug's weight, and its moment."""
        return np.concatenate([self._weight, np.cross(axes @ self._center, self._weight)])

    def _advance(self, place: Floats, quaternion: Floats, twist: Floats) -> None:
        """Make one step, and note what is felt."""
        super()._advance(place, quaternion, twist)
        felt, seconds = float(np.linalg.norm(self._touched())), self._model.opt.timestep
        over = max(felt, self.commanded) > self._limit
        self._above = self._above + seconds if over else 0.0
        self.felt = Felt(max(self.felt.largest, felt), max(self.felt.commanded, self.commanded),
                         max(self.felt.above, self._above))

    def _fit(self, gripper: Any) -> None:
        """Add the plug to the gripper's body, as it sits there."""
        back = self.plug.grasp.inverse()
        ends = [back.position + x * back.rotation[:, 0] for x in self.plug.ends]
        gripper.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(self.plug.radius, 0, 0),
                         fromto=np.concatenate(ends), contype=DLO, conaffinity=SCENE, condim=1,
                         friction=(0, 0, 0))

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
