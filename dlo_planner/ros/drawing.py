"""What RViz sees of the node: all markers in one latched message."""

from threading import Lock

from visualization_msgs.msg import MarkerArray

from dlo_planner.ros.qos import LATCHED


class Drawing:
    """Publishes all markers: whoever comes late gets one latched message and must see it all."""

    def __init__(self, node):
        self._lock, self._parts = Lock(), {}
        self._out = node.create_publisher(MarkerArray, '~/markers', LATCHED)

    def draw(self, what: str, markers: MarkerArray):
        """Replace the markers of one part of the picture.

        Args:
            what: name of the part
            markers: MarkerArray
        """
        with self._lock:
            self._parts = {**self._parts, what: markers.markers}
            everything = sum(self._parts.values(), [])
        self._out.publish(MarkerArray(markers=everything))
