# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""Primitives to be drawn <-> visualization_msgs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, Vector3
from geometry_msgs.msg import Pose as PoseMsg
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, integer, items
from dlo_planner.model.holds import Hold
from dlo_planner.plan.stage import arm_of
from dlo_planner.view.primitives import Primitive
from msg_helpers.poses import header, pose_from_msg, pose_msg

_TYPES = {'line': Marker.LINE_STRIP, 'segments': Marker.LINE_LIST, 'arrow': Marker.ARROW,
          'box': Marker.CUBE, 'ball': Marker.SPHERE, 'cylinder': Marker.CYLINDER,
          'text': Marker.TEXT_VIEW_FACING, 'points': Marker.SPHERE_LIST,
          'triangles': Marker.TRIANGLE_LIST}
_HOLD = 0.08  # m, arrow of a hold: as long as the axes of the gripper
_KINDS = {type_: kind for kind, type_ in _TYPES.items()}


def markers_from_primitives(drawn: Iterable[Primitive], frame_id: str, stamp: Time) -> MarkerArray:
    """Return a MarkerArray that shows Primitives."""
    header(frame_id, instance('stamp', stamp, Time))  # also judges them if there is no item
    return MarkerArray(markers=[_marker(item, header(frame_id, stamp))
                                for item in items('drawn', drawn, Primitive)])


def deleting_marker(group: str, index: int, frame_id: str, stamp: Time) -> Marker:
    """Return the Marker that takes the Primitive of this name away."""
    return Marker(header=header(frame_id, instance('stamp', stamp, Time)),
                  ns=instance('group', group, str), action=Marker.DELETE,
                  id=integer('index', index, minimum=-2**31, maximum=2**31 - 1))


def holds_msg(holds: Iterable[Hold], frame_id: str, stamp: Time) -> MarkerArray:
    """Return an arrow for each Hold, in place of those before: its pose, and what holds there.

    `ns` is the name of the arm or fixture, `text` the grip and the place: 'clamped at 0.5 m',
    'pinned at the tip'.
    """
    top = header(frame_id, instance('stamp', stamp, Time))
    markers = [Marker(header=top, action=Marker.DELETEALL)]
    for index, hold in enumerate(items('holds', holds, Hold)):
        at = 'the tip' if hold.s is None else f'{hold.s:.6g} m'
        markers.append(Marker(
            header=top, ns=arm_of(hold), id=index, action=Marker.ADD, type=Marker.ARROW,
            pose=pose_msg(hold.pose), text=f'{hold.grip} at {at}',
            scale=Vector3(x=_HOLD, y=0.1 * _HOLD, z=0.1 * _HOLD),
            color=ColorRGBA(r=0.0, g=0.6, b=0.3, a=1.0)))
    return MarkerArray(markers=markers)


def primitives_after(known: dict[tuple[str, int], Primitive],
                msg: MarkerArray) -> dict[tuple[str, int], Primitive]:
    """Return the dict of Primitives by name after a MarkerArray, as RViz would show it.

    What cannot be shown is left out: types that Primitives do not have, values that are not finite.
    """
    instance('msg', msg, MarkerArray)
    after = dict(instance('known', known, dict))
    for marker in msg.markers:
        if marker.action == Marker.DELETEALL:
            after = {name: item for name, item in after.items()
                     if marker.ns and name[0] != marker.ns}
        elif marker.action == Marker.DELETE:
            after.pop((marker.ns, marker.id), None)
        elif marker.action == Marker.ADD and marker.type in _KINDS:
            try:
                after[marker.ns, marker.id] = _item(marker)
            except InvalidTask:
                after.pop((marker.ns, marker.id), None)
    return after


def _marker(item: Primitive, top: Header) -> Marker:
    """Return the Marker of an Primitive, whose numbers are known to be good."""
    r, g, b = item.color
    (px, py, pz), (x, y, z, w) = item.pose.position.tolist(), item.pose.quaternion.tolist()
    pose = PoseMsg(position=Point(x=px, y=py, z=pz), orientation=Quaternion(x=x, y=y, z=z, w=w))
    marker = Marker(header=top, ns=item.group, id=item.index, action=Marker.ADD,
                    type=_TYPES[item.kind], pose=pose, text=item.text,
                    color=ColorRGBA(r=r, g=g, b=b, a=item.alpha))
    x, y, z = (1.0, 1.0, 1.0) if item.kind == 'triangles' else item.size.tolist()
    marker.scale = Vector3(x=x, y=y, z=z)
    if item.kind == 'points':
        marker.scale = Vector3(x=x, y=x, z=x)
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in item.points.tolist()]
    if item.colors is not None:
        marker.colors = [ColorRGBA(r=r, g=g, b=b, a=item.alpha)
                         for r, g, b in item.colors.tolist()]
    return marker


def _item(marker: Marker) -> Primitive:
    colors = None
    if marker.colors and len(marker.colors) == len(marker.points):
        colors = [(color.r, color.g, color.b) for color in marker.colors]
    color = marker.color
    return Primitive(marker.ns, marker.id, _KINDS[marker.type],
                np.clip((color.r, color.g, color.b), 0.0, 1.0), min(max(color.a, 0.0), 1.0),
                [(p.x, p.y, p.z) for p in marker.points], colors, pose_from_msg(marker.pose),
                (marker.scale.x, marker.scale.y, marker.scale.z), marker.text)
