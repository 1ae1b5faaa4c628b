"""What RViz shows: the DLO coloured by curvature, the gripper, the cut-out, the trajectory."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.direct.shape import Shape
from dlo_planner.model.checks import instance, integer, items, number
from dlo_planner.model.cutout import CutOut
from dlo_planner.model.obstacles import Box, Capsule, Sphere
from dlo_planner.model.pose import Pose
from msg_helpers.poses import header, point_msg, pose_msg

_THIN = 0.002  # m, of a line whose radius is not known
_AXIS = 0.05   # m, length of drawn axes
_MOST = 10_000  # markers
_SHOWN_RADIUS = 0.02  # m, of a cut-out without a size
_RED, _GREEN, _BLUE = (0.9, 0.1, 0.1), (0.1, 0.8, 0.1), (0.15, 0.3, 1.0)
_ORANGE, _GREY = (1.0, 0.6, 0.0), (0.6, 0.6, 0.6)


def shape_markers(shape, radius, frame_id, stamp) -> MarkerArray:
    """Return MarkerArray: the DLO as a tube, blue (straight) to red (sharpest bend); its gripper.

    Args:
        shape: Shape
        radius: of the DLO, m; None = thin line
        frame_id: of the world; stamp: builtin_interfaces/Time
    """
    instance('shape', shape, Shape)
    radius = None if radius is None else number('radius', radius, minimum=0)
    tube = _line('dlo', 0, frame_id, stamp, 2 * radius if radius else _THIN, _GREY)
    tube.points = [point_msg(position) for position in shape.positions.tolist()]
    curvature = np.linalg.norm(shape.strains[:, 1:], axis=1)
    share = curvature / max(curvature.max(), 1e-12)
    tube.colors = [_colour((value, 0.2, 1 - value)) for value in share.tolist()]
    return MarkerArray(markers=[tube, *_axes('gripper', shape.gripper, frame_id, stamp)])


def plan_markers(cutouts, grippers, frame_id, stamp) -> MarkerArray:
    """Return MarkerArray: the cut-outs' rims and normals, the gripper's way with its directions.

    Args:
        cutouts: CutOuts; grippers: n Pose
        frame_id: of the world; stamp: builtin_interfaces/Time
    """
    cutouts = items('cutouts', cutouts, CutOut)
    grippers = items('grippers', grippers, Pose)
    holes = []
    for index, cutout in enumerate(cutouts):
        rim = _line('cutout', 2 * index, frame_id, stamp, _THIN, _ORANGE)
        rim.pose = pose_msg(cutout.pose)
        rim.points = [point_msg(point) for point in _rim(cutout)]
        normal = _arrow('cutout', 2 * index + 1, frame_id, stamp, _ORANGE)
        normal.points = [point_msg(cutout.centre),
                         point_msg(cutout.centre + _AXIS * cutout.normal)]
        holes += [rim, normal]
    if len(cutouts) == 1:  # the plan before may have had two
        holes += [_gone('cutout', index, frame_id, stamp) for index in (2, 3)]
    way = _line('trajectory', 0, frame_id, stamp, _THIN, _GREEN)
    way.points = [point_msg(pose.position) for pose in grippers]
    ticks = _line('trajectory', 1, frame_id, stamp, _THIN / 2, _GREEN)
    ticks.type = Marker.LINE_LIST
    ticks.points = [point_msg(end) for pose in grippers
                    for end in (pose.position, pose.position + _AXIS * pose.direction)]
    return MarkerArray(markers=[*holes, way, ticks])


def obstacle_markers(obstacles, before, frame_id, stamp) -> MarkerArray:
    """Return MarkerArray: obstacles (Box, Sphere, Capsule), half transparent.

    Args:
        before: how many have been shown before, so that those too many disappear
    """
    obstacles = items('obstacles', obstacles, (Box, Sphere, Capsule))
    before = integer('before', before, minimum=0, maximum=_MOST)
    header(frame_id, instance('stamp', stamp, Time))
    markers = []
    for index, obstacle in enumerate(obstacles):
        marker = _marker('obstacle', index, frame_id, stamp, _GREY)
        marker.color.a = 0.5
        if isinstance(obstacle, Box):
            marker.type, pose, size = Marker.CUBE, obstacle.pose, obstacle.size
        elif isinstance(obstacle, Sphere):
            marker.type, pose = Marker.SPHERE, Pose(obstacle.centre, (0.0, 0.0, 0.0, 1.0))
            size = (2 * obstacle.radius,) * 3
        else:
            along = obstacle.end - obstacle.start
            pose = Pose.looking_along(0.5 * (obstacle.start + obstacle.end), along)
            pose = Pose.from_rotation(pose.position, pose.rotation[:, [1, 2, 0]])
            marker.type = Marker.CYLINDER
            size = (2 * obstacle.radius, 2 * obstacle.radius, np.linalg.norm(along))
        marker.pose = pose_msg(pose)
        marker.scale = Vector3(**dict(zip('xyz', map(float, size), strict=True)))
        markers.append(marker)
    return MarkerArray(markers=[*markers, *(_gone('obstacle', index, frame_id, stamp)
                                            for index in range(len(obstacles), before))])


def _gone(namespace, index, frame_id, stamp):
    marker = _marker(namespace, index, frame_id, stamp, _GREY)
    marker.action = Marker.DELETE
    return marker


def _rim(cutout):
    if cutout.width is not None:
        y, z = cutout.width / 2, cutout.height / 2
        return np.array([(0, y, z), (0, -y, z), (0, -y, -z), (0, y, -z), (0, y, z)])
    angle = np.linspace(0, 2 * np.pi, 49)
    radius = cutout.radius or _SHOWN_RADIUS
    return radius * np.column_stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)])


def _axes(namespace, pose, frame_id, stamp):
    arrows = []
    for axis, colour in enumerate((_RED, _GREEN, _BLUE)):
        arrow = _arrow(namespace, axis, frame_id, stamp, colour)
        tip = pose.position + _AXIS * pose.rotation[:, axis]
        arrow.points = [point_msg(pose.position), point_msg(tip)]
        arrows.append(arrow)
    return arrows


def _marker(namespace, index, frame_id, stamp, colour):
    marker = Marker(header=header(frame_id, stamp), ns=namespace, id=index, action=Marker.ADD,
                    color=_colour(colour))
    marker.pose.orientation.w = 1.0
    return marker


def _line(namespace, index, frame_id, stamp, width, colour):
    marker = _marker(namespace, index, frame_id, stamp, colour)
    marker.type = Marker.LINE_STRIP
    marker.scale = Vector3(x=float(width), y=0.0, z=0.0)
    return marker


def _arrow(namespace, index, frame_id, stamp, colour):
    marker = _marker(namespace, index, frame_id, stamp, colour)
    marker.type = Marker.ARROW
    marker.scale = Vector3(x=0.004, y=0.008, z=0.01)
    marker.points = [Point(), Point()]
    return marker


def _colour(rgb):
    r, g, b = (float(value) for value in rgb)
    return ColorRGBA(r=r, g=g, b=b, a=1.0)
