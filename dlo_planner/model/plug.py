# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""A plug at the beginning of a DLO, which the hand holds: a rigid body, part of the hand.

It bends nothing and nothing of it is solved for: the DLO begins at its rear. What the hand has to
give at the plug's front is what it gives the DLO, carried there, and what bears the plug's weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dlo_planner.model.arrays import Floats
from dlo_planner.model.checks import instance, number, vector
from dlo_planner.model.pose import Pose
from dlo_planner.model.value import Value, put


@dataclass(frozen=True, eq=False, repr=False)
class Plug(Value):
    """A rigid plug that the hand holds; the DLO leaves it at its rear.

    Its frame is that of its front: origin in the middle of it, x axis the direction in which it is
    inserted. It stands there as a cylinder with rounded ends, from rear to front.

    Attributes
    ----------
    length : float
        From rear to front, m; at least its diameter.
    radius : float
        m.
    mass : float
        kg; its center is in the middle.
    grasp : Pose
        Pose of the gripper's frame in the frame of the plug: where the DLO leaves it, x axis along
        the DLO. If None, at its rear, straight backwards, with the same z axis.

    Raises
    ------
    InvalidTask
        An argument makes no sense; the message names it.
    """

    length: float
    radius: float
    mass: float
    grasp: Pose = None  # type: ignore[assignment]  # a Pose from then on

    if TYPE_CHECKING:  # what may be given
        def __init__(self, length: float, radius: float, mass: float,
                     grasp: Pose | None = None) -> None: ...

    def __post_init__(self) -> None:
        put(self, length=number('Plug.length', self.length, above=0))
        put(self, radius=number('Plug.radius', self.radius, above=0, maximum=0.5 * self.length),
            mass=number('Plug.mass', self.mass, minimum=0))
        if self.grasp is None:
            put(self, grasp=Pose((-self.length, 0, 0), (0, 0, 1, 0)))
        instance('Plug.grasp', self.grasp, Pose)
        super().__post_init__()

    @property
    def ends(self) -> tuple[float, float]:
        """Places along x of the middles of its rounded ends, rear and front, m."""
        return self.radius - self.length, -self.radius

    def front(self, gripper: Pose) -> Pose:
        """Return the Pose of its front when the gripper is at a Pose."""
        pose: Pose = instance('gripper', gripper, Pose)
        return pose.compose(self.grasp.inverse())

    def wrench(self, gripper: Pose, on_dlo: ArrayLike, gravity: ArrayLike) -> Floats:
        """Return (6,) what the hand has to give at the plug's front, world axes.

        Force (N) before moment about the front's middle (N m). It is what a controller of forces
        at the front subtracts of what it feels there, with the opposite sign.

        Parameters
        ----------
        gripper : Pose
        on_dlo : array_like, shape (6,)
            What the gripper exerts on the DLO, as `Shape.gripper_wrench`, about its own origin.
        gravity : array_like, shape (3,)
            m/s^2.
        """
        front, exerted = self.front(gripper), vector('on_dlo', on_dlo, 6)
        borne = -self.mass * vector('gravity', gravity, 3)
        rear = gripper.position - front.position
        center = -0.5 * self.length * front.rotation[:, 0]
        return np.concatenate([exerted[:3] + borne, exerted[3:] + np.cross(rear, exerted[:3])
                               + np.cross(center, borne)])
