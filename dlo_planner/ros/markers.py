# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What ~/markers shows, all of it in every message: a latched topic keeps only the last one."""

from collections.abc import Callable, Iterable
from threading import Event, Lock
from time import sleep

from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.view.primitives import Primitive
from msg_helpers.markers import deleting_marker, markers_from_primitives

_PAUSE = 0.03  # s between messages, if something has changed
_LOOK = 0.1    # s between looks whether somebody looks


class MarkerCache:
    """Collects what is to be seen by parts, from any thread; `flush` publishes all of the newest.

    Each message deletes whatever was shown before and is not now: subscribers may miss some.
    """

    def __init__(self, publish: Callable[[MarkerArray], object]) -> None:
        self._publish = publish
        self._lock, self._flushing = Lock(), Lock()
        self._changed, self._closed = Event(), False
        self._waiting: dict[str, Callable[[], list[Marker]]] = {}  # of each part, not made yet
        self._parts: dict[str, list[Marker]] = {}
        # (namespace, id) -> (frame_id, stamp) when it was last shown
        self._ever: dict[tuple[str, int], tuple[str, Time]] = {}

    def show(self, part: str, frame_id: str, stamp: Time,
             make: Callable[[], Iterable[Primitive]]) -> None:
        """Replace one part by the Primitives that `make` returns."""
        with self._lock:
            self._waiting[part] = lambda: markers_from_primitives(make(), frame_id, stamp).markers
        self._changed.set()

    def hide(self, part: str) -> None:
        """Leave nothing of one part."""
        self.show(part, '', Time(), tuple)

    def run(self, watched: Callable[[], bool], flush: Callable[[], object]) -> None:
        """Call `flush` where something changed and somebody is `watched()`; until `close`."""
        while not self._closed:
            if self._changed.wait(_LOOK) and watched():
                self._changed.clear()
                flush()
                sleep(_PAUSE)
            elif self._changed.is_set():
                sleep(_LOOK)

    def close(self) -> None:
        """End `run`."""
        self._closed = True

    def flush(self) -> bool:
        """Publish if something has changed; return whether it has. What `make` raises passes."""
        with self._flushing:
            with self._lock:
                waiting, self._waiting = self._waiting, {}
            problems = []
            for part, make in waiting.items():
                try:
                    self._parts[part] = make()
                except Exception as error:  # the other parts are shown all the same
                    problems.append(error)
            if waiting:
                self._publish(self._message())
        if problems:
            raise problems[0]
        return bool(waiting)

    def _message(self) -> MarkerArray:
        shown = [marker for markers in self._parts.values() for marker in markers]
        names = {(marker.ns, marker.id) for marker in shown}
        gone = [deleting_marker(group, index, frame_id, stamp)
                for (group, index), (frame_id, stamp) in self._ever.items()
                if (group, index) not in names]
        self._ever |= {(marker.ns, marker.id): (marker.header.frame_id, marker.header.stamp)
                       for marker in shown}
        return MarkerArray(markers=[*gone, *shown])
