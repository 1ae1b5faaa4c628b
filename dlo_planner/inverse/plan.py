"""The answer of the inverse simulation: gripper poses, the shapes they make, and their proof."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from dlo_planner.direct.shape import Shape
from dlo_planner.model.pose import Pose


class PlanStatus(Enum):
    """How much of the task a plan covers."""

    COMPLETE = 'complete'
    PARTIAL = 'partial'  # only ever as the evidence inside `Infeasible`


@dataclass(frozen=True, eq=False)
class Plan:
    """A sequence of gripper poses; n waypoints.

    Attributes:
        depths: (n,) arc length that has gone through the cut-out, m
        grippers: n Pose
        shapes: n Shape, the DLO at each waypoint
        misalignment: (n,) angle between DLO and normal at the cut-out, rad
        miss: (n,) distance of the DLO from the cut-out's centre, m
        times: (n,) seconds from the first waypoint, see `timing`
        fraction: part of the requested waypoints that is reached, 1 for a complete plan
        status: PlanStatus
    """

    depths: np.ndarray
    grippers: list[Pose]
    shapes: list[Shape]
    misalignment: np.ndarray
    miss: np.ndarray
    times: np.ndarray
    fraction: float
    status: PlanStatus

    def __len__(self):
        return len(self.grippers)

    @property
    def residual(self):
        """(n,) `Shape.residual` of each waypoint."""
        return np.array([shape.residual for shape in self.shapes])

    @property
    def stability(self):
        """(n,) `Shape.stability` of each waypoint."""
        return np.array([shape.stability for shape in self.shapes])
