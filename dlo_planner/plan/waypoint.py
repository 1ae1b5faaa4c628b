# SPDX-FileCopyrightText: Copyright 2026 the dlo_planner contributors
# SPDX-License-Identifier: Apache-2.0
"""One waypoint of a plan in the making: a shape in its place."""

from dataclasses import dataclass, replace

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.plan.clearance import hole_clearances

_FREE = (np.inf,) * 3


@dataclass(frozen=True)
class Waypoint:
    """A Shape in its place, and how well it passes a center."""

    shape: Shape
    misalignment: float = 0.0
    position_error: float = 0.0
    via_points: tuple = ()
    clearances: tuple = ()
    sheets: tuple = ()

    @property
    def clearance(self):
        """Smallest of the clearances, m."""
        return min((float(min(rooms)) for rooms in self.clearances), default=np.inf)

    def with_via_point(self, center, s):
        """Return the same waypoint, its error that of the worse of this and another center."""
        other = float(np.linalg.norm(self.shape.frame_at(s)[1] - center))
        return replace(self, position_error=max(self.position_error, other),
                       via_points=(*self.via_points, (center, s, None)))

    def with_clearances(self, cutouts, sheets, surface):
        """Return the same waypoint with its clearances in CutOuts.

        Args:
            sheets: the Sheet of each, or None
            surface: Surface of the DLO
        """
        both = [(sheet, cutout.normal) for cutout, sheet in zip(cutouts, sheets, strict=True)]
        return replace(
            self, sheets=tuple(one for one in both if one[0] is not None), clearances=tuple(
                _FREE if sheet is None else hole_clearances(sheet, normal, surface, self.shape)
                for sheet, normal in both))


def waypoint_of(shape, center, s, normal):
    """Return the Waypoint of a Shape carried so that it passes `center` at `s`: section 5.2.

    Args:
        normal: (3,) along which it should pass; None: along any
    """
    return waypoint_at(shape.moved(center - shape.frame_at(s)[1]), center, s, normal)


def waypoint_at(shape, center, s, normal):
    """Return the Waypoint of a Shape that should pass `center` at `s`, where it is."""
    axes, position = shape.frame_at(s)
    angle = 0.0
    if normal is not None:
        along = axes[:, 0] @ normal
        angle = np.arctan2(np.linalg.norm(axes[:, 0] - along * normal), along)
    return Waypoint(shape, float(angle), float(np.linalg.norm(position - center)),
                    ((center, s, normal),))
