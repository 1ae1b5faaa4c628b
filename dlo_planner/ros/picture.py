"""What ~/markers shows, all of it in every message: a latched topic keeps only the last one."""

from threading import Lock

from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker, MarkerArray

from msg_helpers.marker_items import deleting_marker
from msg_helpers.markers import (
    contact_markers,
    ghost_markers,
    margin_markers,
    plan_markers,
    shape_markers,
)


class Picture:
    """Collects markers by parts, and publishes them all when one part changes; thread-safe.

    Whatever was shown once and is not now is deleted in each message, so it does not matter which
    ones a subscriber has missed.

    Args:
        publish: takes a MarkerArray
    """

    def __init__(self, publish):
        self._publish = publish
        self._lock = Lock()
        self._parts = {}      # name -> list of Markers
        self._ever = {}       # (namespace, id) -> (frame_id, stamp) when it was last shown

    def show(self, part: str, *arrays: MarkerArray) -> None:
        """Replace what one part shows; no arrays: nothing of it is left."""
        markers = [marker for array in arrays for marker in array.markers
                   if marker.action == Marker.ADD]
        with self._lock:
            self._parts = {**self._parts, part: markers}
            self._publish(self._message())

    def _message(self):
        shown = [marker for markers in self._parts.values() for marker in markers]
        names = {(marker.ns, marker.id) for marker in shown}
        gone = [deleting_marker(*name, frame_id, stamp)
                for name, (frame_id, stamp) in self._ever.items() if name not in names]
        self._ever |= {(marker.ns, marker.id): (marker.header.frame_id, marker.header.stamp)
                       for marker in shown}
        return MarkerArray(markers=[*gone, *shown])


def markers_of_shape(shape, radius, frame_id: str, stamp: Time, color: str) -> tuple:
    """Return the MarkerArrays of a live Shape: DLO, gripper, contact forces."""
    return (shape_markers(shape, radius, frame_id, stamp, color),
            contact_markers(shape, frame_id, stamp))


def markers_of_plan(plan, cutouts, radius, frame_id: str, stamp: Time) -> tuple:
    """Return the MarkerArrays of a Plan: cut-outs, the gripper's way, margins, ghost shapes."""
    return (plan_markers(cutouts, plan.grippers, frame_id, stamp),
            margin_markers(plan, cutouts, radius, frame_id, stamp),
            ghost_markers(plan.shapes, radius, frame_id, stamp))
