# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What RViz shows: the DLO, the gripper, cut-outs, the plan, obstacles, contacts, the estimate."""

from __future__ import annotations

from collections.abc import Iterable

from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike
from visualization_msgs.msg import MarkerArray

from dlo_planner.direct.shape import Shape
from dlo_planner.model.checks import instance, items
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import OBSTACLES, Obstacle
from dlo_planner.model.pose import Pose
from dlo_planner.plan.plan import Plan
from dlo_planner.view.dlo_items import (
    axes_items,
    contact_items,
    dlo_items,
    estimate_items,
    ghost_items,
)
from dlo_planner.view.scene_items import cutout_items, margin_items, obstacle_items, path_items
from msg_helpers.marker_items import deleting_marker, markers_from_items

_MOST = 10_000  # markers
_COMMAND = 0.1  # m, axes of the command: longer than those of the gripper


def shape_markers(shape: Shape, radius: float | None, frame_id: str, stamp: Time,
                  color: str = 'curvature') -> MarkerArray:
    """Return MarkerArray: the DLO ('dlo'), what its colors mean ('scale'), its gripper ('gripper').

    Parameters
    ----------
    shape : Shape
    radius : float or None
        Radius of the DLO, m; None = thin line.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    color : str, optional
        'curvature' or 'yield', see `dlo_planner.view.colors.coloring`.
    """
    drawn = dlo_items(shape, radius, color)
    return markers_from_items([*drawn, *axes_items('gripper', shape.gripper)], frame_id, stamp)


def contact_markers(shape: Shape, frame_id: str, stamp: Time) -> MarkerArray:
    """Return MarkerArray: arrows of contact forces ('contact'), their sizes in N ('contact force').

    Parameters
    ----------
    shape : Shape
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    """
    return markers_from_items(contact_items(shape), frame_id, stamp)


def plan_markers(cutouts: Iterable[CutOut], grippers: Iterable[Pose], frame_id: str,
                 stamp: Time) -> MarkerArray:
    """Return MarkerArray: rims and normals ('cutout'), the gripper's way ('trajectory').

    Parameters
    ----------
    cutouts : iterable of CutOut
    grippers : iterable of Pose
        The n poses.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    """
    cutouts = items('cutouts', cutouts, CutOut)
    markers = markers_from_items([*cutout_items(cutouts), *path_items(grippers)], frame_id,
                                 stamp).markers
    if len(cutouts) == 1:  # the plan before may have had two
        markers += [deleting_marker('cutout', index, frame_id, stamp) for index in (2, 3)]
    return MarkerArray(markers=markers)


def ghost_markers(shapes: Iterable[Shape], radius: float | None, frame_id: str, stamp: Time,
                  number_shown: int = 6) -> MarkerArray:
    """Return MarkerArray: some of the shapes of a plan, half transparent ('ghost').

    Parameters
    ----------
    shapes : iterable of Shape
        Shapes of the plan.
    radius : float or None
        Radius of the DLO, m; None = thin line.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    number_shown : int, optional
        How many of them.
    """
    return markers_from_items(ghost_items(shapes, radius, number_shown), frame_id, stamp)


def margin_markers(plan: Plan, cutouts: Iterable[CutOut], radius: float | None, frame_id: str,
                   stamp: Time) -> MarkerArray:
    """Return MarkerArray: plates with holes ('plate'), rims colored by margin, and it in mm.

    Parameters
    ----------
    plan : Plan
    cutouts : iterable of CutOut
        Its CutOuts; those without a size are left out.
    radius : float or None
        Radius of the DLO, m. If None, 0.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    """
    return markers_from_items(margin_items(plan, cutouts, radius), frame_id, stamp)


def command_markers(pose: Pose, frame_id: str, stamp: Time) -> MarkerArray:
    """Return MarkerArray: the axes of the pose that the gripper is told to have ('command').

    Parameters
    ----------
    pose : Pose
        Pose of the gripper, x axis = tangent of the DLO.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    """
    return markers_from_items(axes_items('command', pose, _COMMAND), frame_id, stamp)


def estimate_markers(shape: Shape, radius: float | None, points: ArrayLike, frame_id: str,
                     stamp: Time) -> MarkerArray:
    """Return MarkerArray: the DLO as it is estimated ('estimate'), what was seen ('observed').

    Parameters
    ----------
    shape : Shape
        Shape, e.g. `Estimate.shape(gripper)`.
    radius : float or None
        Radius of the DLO, m; None = thin line.
    points : array_like, shape (n, 3)
        Points in m that were seen, world frame; may be empty.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    """
    return markers_from_items(estimate_items(shape, radius, points), frame_id, stamp)


def obstacle_markers(obstacles: Iterable[Obstacle], frame_id: str, stamp: Time) -> MarkerArray:
    """Return MarkerArray: obstacles, half transparent.

    Parameters
    ----------
    obstacles : Iterable
        Obstacles of `model.obstacles`.
    frame_id : str
        Frame id of the world.
    stamp : Time
        builtin_interfaces/Time.
    """
    drawn = obstacle_items(items('obstacles', obstacles, OBSTACLES))
    return markers_from_items(drawn, frame_id, instance('stamp', stamp, Time))
