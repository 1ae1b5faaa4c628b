"""What the node plans: cut-outs in, the whole way of the gripper out."""

from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time

from dlo_planner.direct.shape import Shape
from dlo_planner.inverse.plan import Plan, joined
from dlo_planner.inverse.threading import kept_before
from dlo_planner.model.cutout import CutOut
from dlo_planner.ros.scene import Scene


@dataclass(frozen=True)
class Made:
    """A plan, and with what it was made.

    Attributes:
        scene: Scene; plan: Plan
        before: Shape of the DLO before the first pose, or None
        stamp: builtin_interfaces/Time of the messages that carry it
    """

    scene: Scene
    plan: Plan
    before: Shape | None
    stamp: Time


def make_plan(scene, poses, start, shape):
    """Return the Plan through one or two cut-outs, these, and the Shape it begins with or None.

    Args:
        scene: Scene
        poses: Poses of the cut-outs, in the order in which they are passed
        start: Pose of the gripper now, or None
        shape: Shape of the DLO now, or None; it counts if its gripper is at `start`

    Raises:
        DloPlannerError: refused, with the reason
    """
    cutouts = [CutOut(pose, radius=scene.cutout_radius) for pose in poses]
    depths = np.linspace(0.0, scene.deepest * scene.direct.rod.length, scene.waypoints)
    speeds = {'linear_speed': scene.linear_speed, 'angular_speed': scene.angular_speed}
    thread = scene.inverse.thread if len(cutouts) == 1 else scene.inverse.thread_two
    plan = thread(*cutouts, start=start, depths=depths, **speeds)
    if scene.gripper_clearance:
        plan = scene.inverse.check(kept_before(plan, cutouts[0], scene.gripper_clearance, True))
    if scene.standoff and start is not None:
        here = shape is not None and np.allclose(shape.gripper.matrix, start.matrix, atol=1e-9)
        way = scene.inverse.start_phase(cutouts[0], plan, start, standoff=scene.standoff,
                                        initial=shape if here else None, **speeds)
        return scene.inverse.check(joined(way, plan)), cutouts, shape if here else None
    return plan, cutouts, None
