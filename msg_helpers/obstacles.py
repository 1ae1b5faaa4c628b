# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""visualization_msgs -> obstacles, as RViz shows them."""

from collections.abc import Mapping

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.errors import InvalidTask
from dlo_planner.model.checks import instance, shown
from dlo_planner.model.obstacles import Box, Capsule, Sphere
from msg_helpers.poses import pose_from_msg

_ALIKE = 1e-6  # relative: sizes that count as the same


def obstacles_after(known: Mapping[tuple[str, int], Box | Capsule | Sphere], msg: MarkerArray,
                    frame_id: str, name: str) -> dict[tuple[str, int], Box | Capsule | Sphere]:
    """Return the dict of obstacles, by (namespace, id), after a visualization_msgs/MarkerArray.

    CUBE is a Box, SPHERE a Sphere, CYLINDER the Capsule around it (its ends are round and stand out
    by the radius). DELETE takes one away, DELETEALL all (of a namespace, if one is named).

    Parameters
    ----------
    known : dict
        dict before.
    msg : MarkerArray
    frame_id : str
        The only frame that is understood.
    name : str
        How the sender knows the message.

    Raises
    ------
    InvalidTask
        Naming marker, field and value; nothing of the message counts then.
    """
    instance('known', known, dict)
    instance('msg', msg, MarkerArray)
    instance('frame_id', frame_id, str)
    instance('name', name, str)
    after = dict(known)
    for index, marker in enumerate(msg.markers):
        where = f'{name}.markers[{index}]'
        if marker.action == Marker.DELETEALL:
            after = {key: value for key, value in after.items()
                     if marker.ns and key[0] != marker.ns}
        elif marker.action == Marker.DELETE:
            after.pop((marker.ns, marker.id), None)
        elif marker.action == Marker.ADD:
            if marker.header.frame_id != frame_id:
                raise InvalidTask(f'{where}.header.frame_id = {shown(marker.header.frame_id)}: '
                                  f'expected {frame_id!r}')
            try:
                after[marker.ns, marker.id] = _obstacle(marker)
            except InvalidTask as error:
                raise InvalidTask(f'{where}: {error}') from None
        else:
            raise InvalidTask(f'{where}.action = {marker.action}: expected ADD, DELETE or '
                              'DELETEALL')
    return after


def _obstacle(marker: Marker) -> Box | Capsule | Sphere:
    pose = pose_from_msg(marker.pose)
    x, y, z = size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise InvalidTask(f'scale = {size.tolist()}: expected three numbers above 0 m')
    if marker.type == Marker.CUBE:
        return Box(pose, size)
    if marker.type == Marker.SPHERE:
        if np.ptp(size) > _ALIKE * x:
            raise InvalidTask(f'scale = {size.tolist()}: expected three times the same, a sphere')
        return Sphere(pose.position, x / 2)
    if marker.type == Marker.CYLINDER:
        if abs(x - y) > _ALIKE * x:
            raise InvalidTask(f'scale = {size.tolist()}: expected a round cylinder, x = y')
        along = 0.5 * z * pose.rotation[:, 2]
        return Capsule(pose.position - along, pose.position + along, x / 2)
    raise InvalidTask(f'type = {marker.type}: expected CUBE, SPHERE or CYLINDER')
