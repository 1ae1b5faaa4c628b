# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""What ~/markers shows, all of it in every message: a latched topic keeps only the last one."""

from collections.abc import Callable, Iterable
from threading import Event, Lock
from time import sleep

from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker, MarkerArray

from dlo_planner.direct.shape import Shape
from dlo_planner.model.cutout import CutOut
from dlo_planner.plan.plan import Plan
from msg_helpers.marker_items import deleting_marker
from msg_helpers.markers import (
    contact_markers,
    ghost_markers,
    margin_markers,
    plan_markers,
    shape_markers,
)

_PAUSE = 0.03  # s between pictures, if something has changed
_LOOK = 0.1    # s between looks whether somebody looks


class Picture:
    """Collects what is to be seen by parts, and publishes all of it when some part has changed.

    Parts are told at any rate by any thread, which costs next to nothing; markers are made when
    `flush` is called, of the newest alone. Whatever was shown once and is not now is deleted in
    each message, so it does not matter which ones a subscriber has missed.

    Parameters
    ----------
    publish : callable
        Takes a MarkerArray.
    """

    def __init__(self, publish: Callable[[MarkerArray], object]) -> None:
        self._publish = publish
        self._telling, self._flushing = Lock(), Lock()
        self._news, self._closed = Event(), False
        # part -> function that makes its MarkerArrays; not made yet
        self._told: dict[str, Callable[[], Iterable[MarkerArray]]] = {}
        self._parts: dict[str, list[Marker]] = {}
        # (namespace, id) -> (frame_id, stamp) when it was last shown
        self._ever: dict[tuple[str, int], tuple[str, Time]] = {}

    def show(self, part: str, make: Callable[[], Iterable[MarkerArray]] = tuple) -> None:
        """Replace one part by the MarkerArrays that `make` returns; by default nothing is left."""
        with self._telling:
            self._told[part] = make
        self._news.set()

    def run(self, watched: Callable[[], bool], flush: Callable[[], object]) -> None:
        """Call `flush` where there is news and somebody is `watched()` to look, until `close`."""
        while not self._closed:
            if self._news.wait(_LOOK) and watched():
                self._news.clear()
                flush()
                sleep(_PAUSE)
            elif self._news.is_set():
                sleep(_LOOK)

    def close(self) -> None:
        """End `run`."""
        self._closed = True

    def flush(self) -> bool:
        """Publish if something has changed, and return whether it has; what `make` raises passes.

        Called a few ten times a second.
        """
        with self._flushing:
            with self._telling:
                told, self._told = self._told, {}
            problems = []
            for part, make in told.items():
                try:
                    self._parts[part] = [marker for array in make() for marker in array.markers
                                         if marker.action == Marker.ADD]
                except Exception as error:  # the other parts are shown all the same
                    problems.append(error)
            if told:
                self._publish(self._message())
        if problems:
            raise problems[0]
        return bool(told)

    def _message(self) -> MarkerArray:
        shown = [marker for markers in self._parts.values() for marker in markers]
        names = {(marker.ns, marker.id) for marker in shown}
        gone = [deleting_marker(group, index, frame_id, stamp)
                for (group, index), (frame_id, stamp) in self._ever.items()
                if (group, index) not in names]
        self._ever |= {(marker.ns, marker.id): (marker.header.frame_id, marker.header.stamp)
                       for marker in shown}
        return MarkerArray(markers=[*gone, *shown])


def markers_of_shape(shape: Shape, radius: float | None, frame_id: str, stamp: Time,
                     color: str) -> tuple[MarkerArray, ...]:
    """Return the MarkerArrays of a live Shape: DLO, gripper, contact forces."""
    return (shape_markers(shape, radius, frame_id, stamp, color),
            contact_markers(shape, frame_id, stamp))


def markers_of_plan(plan: Plan, cutouts: Iterable[CutOut], radius: float | None, frame_id: str,
                    stamp: Time) -> tuple[MarkerArray, ...]:
    """Return the MarkerArrays of a Plan: cut-outs, the gripper's way, margins, ghost shapes."""
    return (plan_markers(cutouts, plan.grippers, frame_id, stamp),
            margin_markers(plan, cutouts, radius, frame_id, stamp),
            ghost_markers(plan.shapes, radius, frame_id, stamp))
