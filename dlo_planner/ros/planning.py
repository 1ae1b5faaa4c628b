# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What the node plans: cut-outs in, the whole way of the gripper out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time

from dlo_planner.direct.shape import Shape
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.pose import Pose, angle_between
from dlo_planner.plan.plan import Plan
from dlo_planner.ros.scene import Scene
from dlo_planner.settings.threading import Present, Wanted, way_through

_SAME = 1e-3, 5e-3  # m, rad: gripper poses that differ by less are the same


@dataclass(frozen=True)
class Made:
    """A plan, and with what it was made.

    Attributes
    ----------
    scene : Scene
    plan : Plan
    before : Shape or None
        Shape of the DLO before the first pose, or None.
    stamp : Time
        builtin_interfaces/Time of the messages that carry it.
    """

    scene: Scene
    plan: Plan
    before: Shape | None
    stamp: Time

    def is_as(self, other: 'Made') -> bool:
        """Whether another plan is as good as the same one: the same way, in the same scene."""
        return (self.scene.keeps_plans(other.scene) and len(self.plan) == len(other.plan)
                and all(np.linalg.norm(one.position - another.position) <= _SAME[0]
                        and angle_between(one.rotation, another.rotation) <= _SAME[1]
                        for one, another in zip(self.plan.grippers, other.plan.grippers,
                                                strict=True)))


def make_plan(scene: Scene, poses: Sequence[Pose], start: Pose | None,
              shape: Shape | None) -> tuple[Plan, list[CutOut], Shape | None]:
    """Return the Plan through one or two cut-outs, these, and the Shape it begins with or None.

    Parameters
    ----------
    scene : Scene
    poses : sequence of Pose
        Poses of the cut-outs, in the order in which they are passed.
    start : Pose or None
        Pose of the gripper now, or None.
    shape : Shape or None
        Shape of the DLO now, or None; it counts if its gripper is at `start`.

    Raises
    ------
    DloPlannerError
        Refused, with the reason.
    """
    cutouts = [CutOut(pose, radius=scene.cutout_radius) for pose in poses]
    here = (shape is not None and start is not None and scene.standoff
            and np.allclose(shape.gripper.matrix, start.matrix, atol=1e-9))
    wanted = Wanted(scene.waypoints, scene.deepest, scene.limits, scene.standoff,
                    scene.gripper_clearance, scene.tolerance)
    plan = way_through(scene.inverse, cutouts, wanted, Present(start, shape if here else None))
    return plan, cutouts, shape if here else None
